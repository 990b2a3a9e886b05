//! CARMEN logs (`.clf`, `.log`, also gzipped): one message a line, in the order in which they are to be processed.
//!
//! | message | what follows its name |
//! |---|---|
//! | `FLASER` | count, ranges, laser's pose, base's pose |
//! | `ROBOTLASER1` | type, start angle, field of view, step, longest range, accuracy, mode, count, ranges, count, remissions, laser's pose, base's pose, five more |
//! | `RAWLASER1` | as `ROBOTLASER1` up to the remissions: without poses |
//! | `ODOM` | base's pose, two velocities, acceleration |
//! | `PARAM` | name, value |
//!
//! A stamp, a host's name and the logger's stamp end every line; the first stamp counts. Poses are x, y
//! (metres) and θ (radians) by the robot's own odometry. Stamps may run backwards: the order of the lines
//! is right. What is not stated is found out when all is read:
//!
//! * **Angles** of `FLASER`: the parameters' field of view and step where they fit the number of rays,
//!   else what scanners with that number of rays do (see [`usual_angles`]).
//! * **The laser's place**: where the laser's pose differs from the base's by the same motion on all lines,
//!   that motion; else the parameters `robot_frontlaser_offset` and the like; else the base's origin.
//! * **Longest range**: the mark for "nothing came back" (see [`no_return_mark_m`]), else the stated one.
//!
//! Source: the CARMEN toolkit's logger (`readlog.c`).

use super::Format;
use crate::budget::Budget;
use crate::calibration;
use crate::data_set::{DataSet, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError, quoted};
use crate::lines::Lines;
use crate::number::Tokens;
use crate::source::{FileSource, Source};
use floorprint::SensorId;
use floorprint::geometry::{Mount, Pose2, wrap_angle};
use floorprint::sensors::{Record, Scan, ScanGeometry, StampedPose};
use floorprint::survey::no_return_mark_m;
use std::collections::BTreeMap;
use std::sync::Arc;

pub(super) const FORMAT: Format = Format {
    name: "carmen",
    description: "a CARMEN log (FLASER, ROBOTLASER1, ODOM … lines)",
    scans: "FLASER, ROBOTLASER1 or RAWLASER1 lines",
    has_topics: false,
    recognises,
    read,
};

/// Messages by which a log is recognised.
const MESSAGES: [&[u8]; 8] =
    [b"FLASER", b"RLASER", b"ROBOTLASER1", b"RAWLASER1", b"ODOM", b"PARAM", b"SYNC", b"TRUEPOS"];

/// Messages of lasers that are not used: a laser that looks backwards sees the same walls later.
const OTHER_LASERS: [&[u8]; 9] = [
    b"RLASER",
    b"LASER3",
    b"LASER4",
    b"ROBOTLASER0",
    b"ROBOTLASER2",
    b"RAWLASER2",
    b"RAWLASER3",
    b"RAWLASER4",
    b"REMISSIONFLASER",
];

/// Values behind the ranges of a FLASER line at the least: two poses and a stamp.
const FLASER_TAIL: usize = 7;

/// Most rays of a scan that are believed.
const MOST_RAYS: usize = 1 << 16;

/// Lasers are not mounted farther than this from the base's origin, metres: what is farther is no mount.
const FARTHEST_MOUNT_M: f64 = 3.0;

fn recognises(source: &Source) -> bool {
    let Source::File(file) = source else { return false };
    file.head_lines().any(|line| {
        line.starts_with(b"# CARMEN") || Tokens::new(line).next().is_some_and(|name| MESSAGES.contains(&name))
    })
}

fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Source::File(file) = source else {
        return Err(Problem::new(source.path(), "a folder").expected(FORMAT.description).into());
    };
    let mut log = Log::default();
    let mut budget = file.budget(options);
    let mut lines = Lines::new(file.content());
    loop {
        match lines.next_line() {
            Ok(Some(line)) => log.take(line, &mut budget).ok_or_else(|| budget.exceeded(&file.path))?,
            Ok(None) => break,
            Err(error) => {
                log.dropped.add(DropReason::MalformedLine);
                log.cut_off = Some(file.cut_off_note(lines.number(), &error));
                break;
            }
        }
    }
    log.finish(file)
}

/// What a log says about scans, the fuller message first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ScanMessage {
    RobotLaser,
    Flaser,
    RawLaser,
}

/// What a line says of its rays.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Layout {
    count: usize,
    /// Angle of the first ray and step from ray to ray, radians; none when the line does not say.
    angles_rad: Option<[f64; 2]>,
    /// Longest range, metres; infinite when the line does not say.
    range_max_m: f32,
}

/// A scan as its line has it.
struct LoggedScan {
    message: ScanMessage,
    layout: Layout,
    ranges_m: Vec<f32>,
    /// The laser's and the base's pose by the robot's odometry.
    poses: Option<[Pose2; 2]>,
    stamp_s: f64,
}

/// What has been read of a log so far.
#[derive(Default)]
struct Log {
    scans: Vec<LoggedScan>,
    /// Odometry between the scans, each with the number of scans before it.
    odometry: Vec<(usize, StampedPose)>,
    parameters: Parameters,
    dropped: DropCounts,
    /// How many lines there were.
    lines: usize,
    /// What is wrong with the first garbled line, and where it is.
    first_garbled: Option<(usize, String)>,
    /// What the user is told where the file breaks off.
    cut_off: Option<String>,
}

impl Log {
    /// Takes one line, and the memory for what it says; `None` when that is too much.
    fn take(&mut self, line: &[u8], budget: &mut Budget) -> Option<()> {
        let (scans, odometry) = (self.scans.len(), self.odometry.len());
        self.take_line(line);
        // Each becomes a record in the end.
        budget.take::<(usize, StampedPose, Record)>(self.odometry.len() - odometry)?;
        if self.scans.len() > scans
            && let [.., scan] = &self.scans[..]
        {
            budget.take::<(LoggedScan, Record)>(1)?;
            budget.take::<f32>(scan.ranges_m.len())?;
            // Angles and times of the rays are held once for scans that are alike.
            let is_alike = self.scans.iter().rev().nth(1).is_some_and(|before| before.layout == scan.layout);
            budget.take::<[f64; 2]>(if is_alike { 0 } else { scan.ranges_m.len() })?;
        }
        Some(())
    }

    fn take_line(&mut self, line: &[u8]) {
        self.lines += 1;
        let mut tokens = Tokens::new(line);
        let Some(name) = tokens.next() else { return };
        let scan = match name {
            b"FLASER" => parse_flaser(&mut tokens),
            b"ROBOTLASER1" => parse_laser(&mut tokens, ScanMessage::RobotLaser),
            b"RAWLASER1" => parse_laser(&mut tokens, ScanMessage::RawLaser),
            b"ODOM" => {
                match parse_odom(&mut tokens) {
                    Some(odometry) => self.odometry.push((self.scans.len(), odometry)),
                    None => self.drop_garbled(line),
                }
                return;
            }
            b"PARAM" => return self.parameters.take(&mut tokens),
            other if OTHER_LASERS.contains(&other) => return self.dropped.add(DropReason::OtherLaser),
            _ => return,
        };
        match scan {
            Some(scan) if scan.ranges_m.is_empty() => self.dropped.add(DropReason::EmptyScan),
            Some(scan) => self.scans.push(scan),
            None => self.drop_garbled(line),
        }
    }

    /// Drops a line that breaks off or does not hold what its message holds.
    fn drop_garbled(&mut self, line: &[u8]) {
        self.dropped.add(DropReason::MalformedLine);
        self.first_garbled.get_or_insert_with(|| (self.lines, complaint(line)));
    }

    fn finish(self, file: &FileSource) -> Result<DataSet, ReadError> {
        if self.scans.is_empty() && self.odometry.is_empty() {
            let found = match &self.first_garbled {
                Some((line, complaint)) => {
                    let lines = self.dropped.count(DropReason::MalformedLine);
                    format!("lines with scans or odometry: {lines}, none of them whole; line {line} {complaint}")
                }
                None => "no line with a scan or with odometry".to_owned(),
            };
            return Err(Problem::new(&file.path, found).expected(format!("{}, or ODOM lines", FORMAT.scans)).into());
        }
        let mut notes = Vec::from_iter(self.cut_off.clone());
        if self.dropped.count(DropReason::OtherLaser) > 0 {
            notes.push("scans of lasers other than the front one (RLASER and the like) are not used".to_owned());
        }
        let message = self.used_message();
        let is_used = |scan: &&LoggedScan| scan.message == message;
        if self.scans.iter().any(|scan| scan.message != message) {
            notes.push("the log has its scans in several kinds of messages; the fullest kind is used".to_owned());
        }
        let backwards = |pair: &[f64]| pair[1] < pair[0];
        let stamps_s: Vec<f64> = self.scans.iter().filter(is_used).map(|scan| scan.stamp_s).collect();
        let jumps = stamps_s.windows(2).filter(|pair| backwards(pair)).count();
        if jumps > 0 {
            notes.push(format!("stamps of scans that run backwards: {jumps}; the order of the file is kept"));
        }
        let mut robot = calibration::carmen();
        robot.lidar.mount = mount(self.scans.iter().filter(is_used)).unwrap_or(self.parameters.mount);
        let mark_m =
            no_return_mark_m(|| self.scans.iter().filter(is_used).flat_map(|scan| scan.ranges_m.iter().copied()));
        notes.push(match mark_m {
            _ if self.scans.is_empty() => match &self.first_garbled {
                Some((line, complaint)) => {
                    format!("no line with a scan is whole, so no map can be made: line {line} {complaint}")
                }
                None => format!("no {}: there is no LiDAR and so no map, only dead reckoning", FORMAT.scans),
            },
            Some(mark_m) => format!("readings of {mark_m} m and more mean that nothing came back"),
            None => "no reading stands out as the mark for \"nothing came back\"".to_owned(),
        });
        let mut geometries = Geometries { parameters: &self.parameters, mark_m, known: BTreeMap::new() };
        let mut records = Vec::with_capacity(self.scans.len() + self.odometry.len());
        let mut odometry = self.odometry.into_iter().peekable();
        for (index, scan) in self.scans.into_iter().enumerate() {
            while let Some((_, stamped)) = odometry.next_if(|&(scans_before, _)| scans_before <= index) {
                records.push(Record::Odometry(stamped));
            }
            if scan.message == message {
                records.push(Record::Scan(Scan {
                    sensor: SensorId::default(),
                    stamp_s: scan.stamp_s,
                    geometry: geometries.of(scan.layout),
                    ranges_m: scan.ranges_m,
                    odometry: scan.poses.map(|[_laser, base]| base),
                }));
            }
        }
        records.extend(odometry.map(|(_, stamped)| Record::Odometry(stamped)));
        Ok(DataSet {
            format: FORMAT,
            robot,
            records,
            images: None,
            dropped: self.dropped,
            notes,
            input_hash: file.hash(),
            bag: None,
            live: None,
            unpacked: None,
        })
    }

    /// The message whose scans are used: newer logs write each scan as `RAWLASER1` and as `ROBOTLASER1`.
    fn used_message(&self) -> ScanMessage {
        let count = |message| self.scans.iter().filter(|scan| scan.message == message).count();
        let (robot_laser, flaser) = (count(ScanMessage::RobotLaser), count(ScanMessage::Flaser));
        match (robot_laser, flaser) {
            (0, 0) => ScanMessage::RawLaser,
            _ if robot_laser >= flaser => ScanMessage::RobotLaser,
            _ => ScanMessage::Flaser,
        }
    }
}

/// What is wrong with a garbled line, as far as it is easily told.
fn complaint(line: &[u8]) -> String {
    let tokens = &mut Tokens::new(line);
    let announced = tokens.next().filter(|&name| name == b"FLASER").and_then(|_| tokens.count());
    let values = Iterator::count(tokens);
    match announced {
        Some(announced) if values < announced.saturating_add(FLASER_TAIL) => {
            format!("announces {announced} ranges, but {values} values follow, poses and stamp included")
        }
        _ => format!("is {}", quoted(line)),
    }
}

fn parse_flaser(tokens: &mut Tokens) -> Option<LoggedScan> {
    let ranges_m = parse_ranges(tokens)?;
    Some(LoggedScan {
        message: ScanMessage::Flaser,
        layout: Layout { count: ranges_m.len(), angles_rad: None, range_max_m: f32::INFINITY },
        ranges_m,
        poses: Some([parse_pose(tokens)?, parse_pose(tokens)?]),
        stamp_s: tokens.stamp()?,
    })
}

fn parse_laser(tokens: &mut Tokens, message: ScanMessage) -> Option<LoggedScan> {
    let [_laser_type, start_rad, _field_of_view] = tokens.triple()?;
    let [step_rad, range_max_m, _accuracy] = tokens.triple()?;
    let _remission_mode = tokens.next()?;
    let ranges_m = parse_ranges(tokens)?;
    // Early logs have no remissions, not even their count; poses always have a decimal point.
    let before_remissions = tokens.clone();
    match tokens.count() {
        Some(0) => {}
        Some(remissions) => drop(tokens.nth(remissions - 1)?),
        None => *tokens = before_remissions,
    }
    let poses = match message {
        ScanMessage::RobotLaser => Some([parse_pose(tokens)?, parse_pose(tokens)?]),
        _ => None,
    };
    // Velocities and safety distances follow, in newer logs one more of them.
    let rest: Vec<&[u8]> = tokens.collect();
    let &[.., stamp, _host, _logger_stamp] = &rest[..] else { return None };
    Some(LoggedScan {
        message,
        layout: Layout {
            count: ranges_m.len(),
            angles_rad: (step_rad > 0.0).then_some([start_rad, step_rad]),
            range_max_m: if range_max_m > 0.0 { range_max_m as f32 } else { f32::INFINITY },
        },
        ranges_m,
        poses,
        stamp_s: Tokens::new(stamp).stamp()?,
    })
}

/// A count and as many ranges. A range may be no number or infinite, but it must be there.
fn parse_ranges(tokens: &mut Tokens) -> Option<Vec<f32>> {
    let count = tokens.count().filter(|&count| count <= MOST_RAYS)?;
    let mut ranges_m = Vec::with_capacity(count);
    for _ in 0..count {
        ranges_m.push(tokens.number()? as f32);
    }
    Some(ranges_m)
}

fn parse_pose(tokens: &mut Tokens) -> Option<Pose2> {
    let [x, y, theta] = tokens.triple()?;
    Some(Pose2::new(x, y, theta))
}

fn parse_odom(tokens: &mut Tokens) -> Option<StampedPose> {
    let pose = parse_pose(tokens)?;
    let _velocities_and_acceleration = tokens.triple()?;
    Some(StampedPose { stamp_s: tokens.stamp()?, pose })
}

/// What `PARAM` lines say of the front laser.
#[derive(Default)]
struct Parameters {
    mount: Mount,
    field_of_view_rad: Option<f64>,
    step_rad: Option<f64>,
}

impl Parameters {
    fn take(&mut self, tokens: &mut Tokens) {
        let (Some(name), Some(value)) = (tokens.next(), tokens.finite()) else { return };
        match name {
            b"robot_frontlaser_offset" => self.mount.x_m = value,
            b"robot_frontlaser_side_offset" => self.mount.y_m = value,
            b"robot_frontlaser_angular_offset" => self.mount.yaw_rad = value,
            b"laser_front_laser_fov" | b"laser_laser1_fov" => self.field_of_view_rad = Some(value.to_radians()),
            b"laser_front_laser_resolution" | b"laser_laser1_resolution" => self.step_rad = Some(value.to_radians()),
            _ => {}
        }
    }

    /// First angle and step as the parameters state them, where they fit the number of rays:
    /// the last ray may lie at the end of the field of view or one step before it.
    fn angles(&self, count: usize) -> Option<[f64; 2]> {
        let (field_of_view_rad, step_rad) = (self.field_of_view_rad?, self.step_rad?);
        let steps = (field_of_view_rad / step_rad).round();
        (step_rad > 0.0 && (steps == count as f64 || steps + 1.0 == count as f64))
            .then_some([-field_of_view_rad / 2.0, step_rad])
    }
}

/// First angle and step, radians, of scanners with so many rays when nothing is stated.
///
/// Scanners measure at fixed steps over a fixed field of view, and drivers often leave out the last ray:
/// 180 rays are 181 less one, at 1°. Known: 180° at 1°, ½° and ¼°; 100° at ¼° (SICK LMS 2xx); 270° at ½°
/// and ¼° (SICK LMS 1xx, Hokuyo UTM-30LX); 240° in steps of 360°/1024 (Hokuyo URG-04LX). Any other number
/// of rays is spread over 180°, which was the only field of view when these messages were made.
fn usual_angles(count: usize) -> [f64; 2] {
    let (field_of_view_deg, step_deg) = match count {
        180 | 181 => (180.0, 1.0),
        360 | 361 => (180.0, 0.5),
        720 | 721 => (180.0, 0.25),
        400 | 401 => (100.0, 0.25),
        540 | 541 => (270.0, 0.5),
        1080 | 1081 => (270.0, 0.25),
        682 | 683 => (681.0 * 360.0 / 1024.0, 360.0 / 1024.0),
        _ => (180.0, 180.0 / (count.max(2) - 1) as f64),
    };
    [-f64::to_radians(field_of_view_deg) / 2.0, f64::to_radians(step_deg)]
}

/// A layout as a key: the number of rays, and the bits of the stated angles and range.
type LayoutKey = (usize, Option<[u64; 2]>, u32);

/// The geometries that occur, made once each.
struct Geometries<'a> {
    parameters: &'a Parameters,
    mark_m: Option<f32>,
    known: BTreeMap<LayoutKey, Arc<ScanGeometry>>,
}

impl Geometries<'_> {
    fn of(&mut self, layout: Layout) -> Arc<ScanGeometry> {
        let Layout { count, angles_rad, range_max_m } = layout;
        let key = (count, angles_rad.map(|angles_rad| angles_rad.map(f64::to_bits)), range_max_m.to_bits());
        if let Some(geometry) = self.known.get(&key) {
            return Arc::clone(geometry);
        }
        let stated = angles_rad.or_else(|| self.parameters.angles(count));
        let [start_rad, step_rad] = stated.unwrap_or_else(|| usual_angles(count));
        let geometry = Arc::new(ScanGeometry {
            angles_rad: (0..count).map(|ray| start_rad + ray as f64 * step_rad).collect(),
            time_offsets_s: vec![0.0; count],
            range_min_m: 0.01,
            // What the data show outdoes what was configured.
            range_max_m: self.mark_m.unwrap_or(range_max_m),
            below_minimum_is_no_return: false,
        });
        self.known.insert(key, Arc::clone(&geometry));
        geometry
    }
}

/// The laser's place on the base, if its pose differs from the base's by the same motion on nearly all lines.
///
/// In logs whose first pose was corrected afterwards the two drift apart: these say nothing of the mount,
/// and neither do logs in which both are the same.
fn mount<'a>(scans: impl Iterator<Item = &'a LoggedScan> + Clone) -> Option<Mount> {
    /// Stated poses are rounded; so may their difference be.
    const TOLERANCE: f64 = 5e-3;
    let motions = || scans.clone().filter_map(|scan| scan.poses).map(|[laser, base]| base.between(&laser));
    let first = motions().next()?;
    let median = |value: &dyn Fn(Pose2) -> f64| {
        let mut values: Vec<f64> = motions().map(value).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let turned = median(&|motion| wrap_angle(motion.theta - first.theta));
    let usual = Pose2::new(median(&|motion| motion.x), median(&|motion| motion.y), first.theta + turned);
    let agrees = |motion: &Pose2| {
        (motion.x - usual.x).abs() < TOLERANCE
            && (motion.y - usual.y).abs() < TOLERANCE
            && wrap_angle(motion.theta - usual.theta).abs() < TOLERANCE
    };
    let agreeing = motions().filter(agrees).count();
    let is_constant = agreeing as f64 >= 0.99 * motions().count() as f64;
    let is_mount = usual.distance() <= FARTHEST_MOUNT_M && !agrees(&Pose2::IDENTITY);
    (is_constant && is_mount).then(|| Mount { x_m: usual.x, y_m: usual.y, yaw_rad: usual.theta, ..Mount::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use proptest::prelude::*;
    use std::io::Write;
    use std::path::Path;

    const TAIL: &str = "host 0.1";

    fn read_bytes(bytes: Vec<u8>) -> Result<DataSet, ReadError> {
        read(&Source::File(FileSource::new(Path::new("test.clf"), bytes)?), &OpenOptions::default())
    }

    fn read_text(text: &str) -> DataSet {
        read_bytes(text.as_bytes().to_vec()).unwrap()
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn flaser(ranges: &[f32], laser: &str, base: &str, stamp: f64) -> String {
        let ranges: String = ranges.iter().map(|range| format!("{range:.2} ")).collect();
        format!("FLASER {} {ranges}{laser} {base} {stamp} {TAIL}\n", ranges.split_whitespace().count())
    }

    /// A small log with all that occurs in logs.
    fn small_log() -> String {
        let ranges: Vec<f32> = (0..181).map(|ray| 1.0 + ray as f32 / 100.0).collect();
        let mut text = "# CARMEN Logfile\nPARAM robot_frontlaser_offset 0.25 0 host 0\n".to_owned();
        for step in 0..30 {
            let pose = format!("{}.0 0.0 0.0", step);
            text += &format!("ODOM {pose} 0.1 0.0 0.0 {} {TAIL}\n", step as f64 + 0.5);
            text += &flaser(&ranges, &pose, &pose, step as f64 + 0.6);
        }
        text
    }

    #[test]
    fn the_base_s_odometry_is_the_second_pose_and_the_first_gives_the_mount() {
        // The laser is 0.3 m ahead and 0.1 m to the left, and the base turns round.
        let text = flaser(&[2.0; 4], "0.3 0.1 0", "0 0 0", 1.0)
            + &flaser(&[2.0; 4], "4.68889 1.94334 3.0", "5.0 2.0 3.0", 2.0);
        let log = read_text(&text);
        assert_eq!(log.scans().last().unwrap().odometry, Some(Pose2::new(5.0, 2.0, 3.0)));
        let mount = log.robot.lidar.mount;
        assert!((mount.x_m - 0.3).abs() < 1e-5 && (mount.y_m - 0.1).abs() < 1e-5, "{mount:?}");
    }

    #[test]
    fn corrected_poses_are_no_mount() {
        let text: String = (0..50)
            .map(|i| flaser(&[2.0; 4], &format!("{} 0.{i:02} 0", 1.01 * i as f64), &format!("{i} 0 0"), i as f64))
            .collect();
        assert_eq!(read_text(&text).robot.lidar.mount, Mount::default());
    }

    #[test]
    fn parameters_give_the_mount_where_the_poses_do_not() {
        let log = read_text(&small_log());
        assert_eq!(log.robot.lidar.mount.x_m, 0.25);
        assert_eq!((log.scans().count(), log.records.len(), log.dropped.total()), (30, 60, 0));
        assert!(matches!(log.records[0], Record::Odometry(_)) && matches!(log.records[1], Record::Scan(_)));
    }

    #[test]
    fn robot_lasers_state_their_own_geometry() {
        let line = |stamp: f64| {
            let common = "0 -2.356194 4.712389 1.570796 30.0 0.01 0 4 1.0 2.0 3.0 30.0";
            format!(
                "RAWLASER1 {common} 2 7 8 {stamp} {TAIL}\n\
                 ROBOTLASER1 {common} 2 7 8 1.2 0.0 0.0 1.0 0.0 0.0 0.5 0.0 0.3 0.3 10.0 {stamp} {TAIL}\n\
                 ROBOTLASER1 {common} 1.2 0.0 0.0 1.0 0.0 0.0 0.5 0.0 0.3 0.3 {} {TAIL}\n",
                stamp + 0.5
            )
        };
        let log = read_text(&(line(1.0) + &line(2.0)));
        let stamps: Vec<f64> = log.scans().map(|scan| scan.stamp_s).collect();
        assert_eq!(stamps, [1.0, 1.5, 2.0, 2.5]);
        let scan = log.scans().next().unwrap();
        assert_eq!(scan.odometry, Some(Pose2::new(1.0, 0.0, 0.0)));
        assert_eq!(scan.geometry.angles_rad[0], -2.356194);
        assert!((scan.geometry.angles_rad[3] - 2.356194).abs() < 1e-5);
        assert_eq!(scan.geometry.range_max_m, 30.0);
        assert!((log.robot.lidar.mount.x_m - 0.2).abs() < 1e-9);
        assert_eq!(log.dropped.total(), 0);
    }

    #[test]
    fn ranges_without_a_field_of_view_get_the_usual_one() {
        for (count, first_deg, last_deg) in [
            (180, -90.0, 89.0),
            (181, -90.0, 90.0),
            (360, -90.0, 89.5),
            (361, -90.0, 90.0),
            (401, -50.0, 50.0),
            (541, -135.0, 135.0),
            (1081, -135.0, 135.0),
            (682, -119.707, 119.707 - 0.3516),
            (91, -90.0, 90.0),
            (1, -90.0, -90.0),
        ] {
            let log = read_text(&flaser(&vec![2.0; count], "0 0 0", "0 0 0", 1.0));
            let angles = &log.scans().next().unwrap().geometry.angles_rad;
            let (first, last) = (angles[0].to_degrees(), angles[count - 1].to_degrees());
            assert!((first - first_deg).abs() < 0.36 && (last - last_deg).abs() < 0.36, "{count}: {first} to {last}");
        }
    }

    #[test]
    fn stated_angles_are_believed_where_they_fit() {
        let parameters = "PARAM laser_front_laser_fov 90 0 h 0\nPARAM laser_front_laser_resolution 0.5 0 h 0\n";
        for (count, first_deg) in [(181, -45.0), (180, -45.0), (361, -90.0)] {
            let log = read_text(&(parameters.to_owned() + &flaser(&vec![2.0; count], "0 0 0", "0 0 0", 1.0)));
            assert!((log.scans().next().unwrap().geometry.angles_rad[0].to_degrees() - first_deg).abs() < 1e-9);
        }
    }

    #[test]
    fn the_number_of_rays_may_change_and_stamps_may_run_backwards() {
        let log = read_text(
            &(flaser(&[2.0; 4], "0 0 0", "0 0 0", 3.0)
                + &flaser(&[2.0; 6], "0 0 0", "0 0 0", 1.0)
                + &flaser(&[], "0 0 0", "0 0 0", 1.0)
                + "RLASER 1 2.0 0 0 0 0 0 0 1 h 1\nFLASER 3 1.0 2.0\nFLASER x\n"
                + &flaser(&[2.0; 4], "0 0 0", "0 0 0", 4.0)),
        );
        let stamps: Vec<f64> = log.scans().map(|scan| scan.stamp_s).collect();
        assert_eq!(stamps, [3.0, 1.0, 4.0]);
        assert!(log.scans().all(|scan| scan.geometry.len() == scan.ranges_m.len()));
        let counts: Vec<_> = log.dropped.iter().collect();
        assert_eq!(counts, [(DropReason::MalformedLine, 2), (DropReason::EmptyScan, 1), (DropReason::OtherLaser, 1)]);
        assert!(log.notes.iter().any(|note| note.ends_with("backwards: 1; the order of the file is kept")));
    }

    #[test]
    fn gzipped_logs_may_have_several_members() {
        let text = small_log();
        let (first, second) = text.as_bytes().split_at(text.len() / 2);
        for behind in ["", "\0\0\0", "what is no gzip data"] {
            let log = read_bytes([gzip(first), gzip(second), behind.into()].concat()).unwrap();
            assert_eq!((log.scans().count(), log.dropped.total()), (30, 0));
        }
    }

    #[test]
    fn a_gzipped_log_that_was_cut_off_is_used_as_far_as_it_goes() {
        let bytes = gzip(small_log().as_bytes());
        let log = read_bytes(bytes[..bytes.len() / 2].to_vec()).unwrap();
        assert!((1..30).contains(&log.scans().count()));
        assert_eq!(log.dropped.count(DropReason::MalformedLine), 1);
        assert!(log.notes[0].contains("cut off or damaged") && log.notes[0].contains("first"), "{:?}", log.notes);
    }

    #[test]
    fn what_unpacks_to_a_thousandfold_is_refused_unless_allowed() {
        let lines = 3_500_000;
        let bomb = gzip("ODOM 0 0 0 0 0 0 1.0 h 1\n".repeat(lines).as_bytes());
        let error = read_bytes(bomb.clone()).map(|log| log.records.len()).unwrap_err();
        assert!(error.problem().advice.contains("--max-expansion"), "{error}");
        let source = Source::File(FileSource::new(Path::new("test.clf"), bomb).unwrap());
        let options = OpenOptions { max_expansion: 1000.0, ..OpenOptions::default() };
        assert_eq!(read(&source, &options).map(|log| log.records.len()).unwrap(), lines);
    }

    #[test]
    fn a_log_without_anything_to_use_is_an_error() {
        assert!(read_text_error("# CARMEN Logfile\nPARAM a b\nSYNC x\n").contains("FLASER"));
        let cut_off = read_text_error("# CARMEN Logfile\nFLASER 100000000000 1 2\nFLASER x\n");
        assert!(cut_off.contains("odometry: 2,") && cut_off.contains("line 2 announces 100000000000"), "{cut_off}");
        assert!(cut_off.contains("but 2 values follow"), "{cut_off}");
        let no_time = flaser(&[2.0; 500], "0 0 0", "0 0 0", 1e308);
        let message = read_text_error(&no_time);
        assert!(message.contains("line 1 is \"FLASER 500 2.00") && message.len() < 300, "{message}");
    }

    #[test]
    fn a_log_of_odometry_alone_says_that_there_are_no_scans() {
        let log = read_text("ODOM 1.0 0.0 0.0 0.1 0.0 0.0 1.0 host 0.1\n");
        assert_eq!(
            log.notes,
            ["no FLASER, ROBOTLASER1 or RAWLASER1 lines: there is no LiDAR and so no map, only dead reckoning"]
        );
    }

    #[test]
    fn a_gzipped_nothing_is_empty() {
        for nothing in [vec![], gzip(b"")] {
            let error = read_bytes(nothing).unwrap_err();
            assert!(error.to_string().contains("empty"), "{error}");
        }
    }

    fn read_text_error(text: &str) -> String {
        read_bytes(text.as_bytes().to_vec()).unwrap_err().to_string()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn damaged_logs_are_survived(
            damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..30),
            cut in any::<prop::sample::Index>(),
            zipped in any::<bool>()
        ) {
            let mut bytes = if zipped { gzip(small_log().as_bytes()) } else { small_log().into_bytes() };
            for (position, byte) in damage {
                let position = position.index(bytes.len());
                bytes[position] = byte;
            }
            bytes.truncate(1 + cut.index(bytes.len()));
            if let Ok(log) = read_bytes(bytes) {
                prop_assert!(log.scans().all(|scan| scan.geometry.len() == scan.ranges_m.len()));
            }
        }
    }
}
