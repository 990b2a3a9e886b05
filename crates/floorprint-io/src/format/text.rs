//! Text with a reading a line, as it is quickly written by any program: CSV, or TUM trajectories with scans.
//!
//! | line | columns |
//! |---|---|
//! | odometry | `t, x, y, yaw` |
//! | odometry as TUM | `t x y z qx qy qz qw` |
//! | scan | `t, angle_min, angle_max, range, range …` |
//! | wheels | `encoders, t, left, right`: running counts |
//! | inertial unit | `imu, t, wx, wy, wz, ax, ay, az` |
//!
//! Seconds, metres, radians, m/s²; yaw and angles counter-clockwise from straight ahead. Columns are separated by commas,
//! semicolons or blanks. Each line may begin with what it is (`odometry` or `odom`, `scan`, `encoders`, `imu`); without
//! a word four columns are odometry, eight are TUM, and ten or more are a scan. Where nothing came back a range is 0 or
//! `inf`. Lines that begin with `#` or `%`, and a first line of names, are skipped. One file holds all, in the order of
//! processing; or a folder holds files called `scan…` and `odom…`, `encoders…`, `imu…`, whose lines are sorted by time.

use super::Format;
use crate::data_set::{DataSet, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::lines::Lines;
use crate::number::Tokens;
use crate::source::{FileSource, InputHash, Source};
use floorprint::SensorId;
use floorprint::geometry::{Pose2, Pose3};
use floorprint::sensors::{EncoderReading, ImuReading, Record, RobotConfig, Scan, ScanGeometry, StampedPose};
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

pub(super) const FORMAT: Format = Format {
    name: "text",
    description: "text with a reading a line (t,x,y,yaw and t,angle_min,angle_max,ranges…)",
    scans: "lines of t, angle_min, angle_max and ranges",
    has_topics: false,
    recognises,
    read,
};

/// The fewest columns of a scan without a word before it: more than a TUM line has.
const SCAN_COLUMNS: usize = 10;

/// Ranges below this are "nothing came back", metres: no LiDAR measures nearer.
const NEAREST_M: f32 = 1e-3;

/// Endings of the files of a folder.
const ENDINGS: [&str; 3] = [".csv", ".txt", ".tum"];

/// What a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Odometry,
    Encoders,
    Imu,
    Scan,
}

impl Kind {
    /// By the word that a line or the name of a file begins with.
    fn of(word: &[u8]) -> Option<Self> {
        let word = word.to_ascii_lowercase();
        [(&b"odom"[..], Self::Odometry), (b"encoder", Self::Encoders), (b"imu", Self::Imu), (b"scan", Self::Scan)]
            .into_iter()
            .find_map(|(begin, kind)| word.starts_with(begin).then_some(kind))
    }
}

/// Whether a line that says what it is, or could be nothing else, stands in the beginning: a scan in which not nearly all
/// numbers are whole ones, as the counts and millimetres of encoder logs are.
fn recognises(source: &Source) -> bool {
    match source {
        Source::File(file) => file.head_lines().any(|line| {
            let line = separated(line);
            let Some((word, kind, numbers)) = taken_apart(&line, None) else { return false };
            match kind {
                Kind::Scan => {
                    let is_fan = numbers[1].abs() <= 7.0 && numbers[2].abs() <= 7.0 && numbers[1] < numbers[2];
                    let whole = numbers.iter().filter(|number| number.fract() == 0.0).count();
                    is_fan && (word || 2 * whole < numbers.len() || numbers[1..3].iter().all(|a| a.fract() != 0.0))
                }
                _ => word,
            }
        }),
        Source::Folder(_) => files(source).iter().any(|(kind, _)| *kind == Kind::Scan),
    }
}

/// The files of a folder by what they hold.
fn files(source: &Source) -> Vec<(Kind, PathBuf)> {
    let Source::Folder(folder) = source else { return Vec::new() };
    let file = |name: &String| {
        let lower = name.to_ascii_lowercase();
        let is_text = ENDINGS.iter().any(|ending| lower.strip_suffix(".gz").unwrap_or(&lower).ends_with(ending));
        Some((Kind::of(lower.as_bytes()).filter(|_| is_text)?, folder.path.join(name)))
    };
    let mut files: Vec<(Kind, PathBuf)> = folder.names.iter().filter_map(file).collect();
    files.sort();
    files
}

fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let mut reader = Reader::default();
    let input_hash = match source {
        Source::File(file) => {
            reader.read(file, None, options)?;
            file.hash()
        }
        Source::Folder(_) => {
            let mut hash = InputHash::default();
            for (kind, path) in files(source) {
                let bytes = crate::regular_file::read_regular(&path)?;
                hash.add_content(&path, &bytes);
                reader.read(&FileSource::new(&path, bytes)?, Some(kind), options)?;
            }
            // A stable sort: at equal stamps what moved comes before what was seen.
            reader.records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
            hash.finish()
        }
    };
    if reader.records.is_empty() {
        return Err(Problem::new(source.path(), "no line with a reading").expected(FORMAT.description).into());
    }
    let Reader { records, dropped, mut notes, .. } = reader;
    let has = |wanted: fn(&Record) -> bool| records.iter().any(wanted);
    if has(|record| matches!(record, Record::Encoders(_))) {
        notes.push(
            "counts of encoders: robot.wheels (left_m_per_tick, right_m_per_tick, track_width_m) says what they mean"
                .to_owned(),
        );
    } else if !has(|record| matches!(record, Record::Odometry(_))) {
        notes.push("no odometry: the motion between scans comes from matching them".to_owned());
    }
    Ok(DataSet {
        format: FORMAT,
        robot: RobotConfig { name: FORMAT.name.to_owned(), ..RobotConfig::default() },
        records,
        images: None,
        dropped,
        notes,
        input_hash,
        bag: None,
        live: None,
        unpacked: None,
    })
}

/// A line in which semicolons are commas, and what are commas beside them are decimal points if there are no others.
fn separated(line: &[u8]) -> Cow<'_, [u8]> {
    if !line.contains(&b';') {
        return Cow::Borrowed(line);
    }
    let has_points = line.contains(&b'.');
    let otherwise = |&byte: &u8| match byte {
        b';' => b',',
        b',' if !has_points => b'.',
        byte => byte,
    };
    Cow::Owned(line.iter().map(otherwise).collect())
}

/// Whether a line says what it is, what it is, and its numbers.
fn taken_apart(line: &[u8], of_file: Option<Kind>) -> Option<(bool, Kind, Vec<f64>)> {
    let mut tokens = Tokens::new(line);
    let word = tokens.clone().next().filter(|word| word[0].is_ascii_alphabetic());
    let word = word.and_then(Kind::of);
    if word.is_some() {
        tokens.next();
    }
    let mut numbers = Vec::new();
    while tokens.clone().next().is_some() {
        numbers.push(tokens.number()?);
    }
    let kind = word.or(of_file).or(match numbers.len() {
        4 | 8 => Some(Kind::Odometry),
        SCAN_COLUMNS.. => Some(Kind::Scan),
        _ => None,
    })?;
    let fits = match (kind, numbers.len()) {
        (Kind::Odometry, columns) => matches!(columns, 4 | 8),
        (Kind::Encoders, columns) => columns == 3,
        (Kind::Imu, columns) => columns == 7,
        (Kind::Scan, columns) => columns >= 4,
    };
    let finite = if kind == Kind::Scan { &numbers[..numbers.len().min(3)] } else { &numbers[..] };
    (fits && finite.iter().all(|number| number.is_finite())).then_some((word.is_some(), kind, numbers))
}

/// What was read so far.
#[derive(Default)]
struct Reader {
    records: Vec<Record>,
    dropped: DropCounts,
    notes: Vec<String>,
    geometry: Option<([u64; 2], Arc<ScanGeometry>)>,
    /// Running counts of the wheels.
    counts: Option<[f64; 2]>,
}

impl Reader {
    fn read(&mut self, file: &FileSource, kind: Option<Kind>, options: &OpenOptions) -> Result<(), ReadError> {
        let mut budget = file.budget(options);
        let mut lines = Lines::new(file.content());
        loop {
            match lines.next_line() {
                Ok(Some(line)) if line.is_empty() || line.starts_with(b"#") || line.starts_with(b"%") => {}
                Ok(Some(line)) => {
                    let line = separated(line);
                    match taken_apart(&line, kind) {
                        Some((_, kind, numbers)) => {
                            let taken = budget.take::<f32>(numbers.len()).and_then(|()| budget.take::<Record>(1));
                            taken.ok_or_else(|| budget.exceeded(&file.path))?;
                            self.take(kind, &numbers);
                        }
                        // Names of columns.
                        None if lines.number() == 1 => {}
                        None => self.dropped.add(DropReason::MalformedLine),
                    }
                }
                Ok(None) => return Ok(()),
                Err(error) => {
                    self.dropped.add(DropReason::MalformedLine);
                    self.notes.push(file.cut_off_note(lines.number(), &error));
                    return Ok(());
                }
            }
        }
    }

    fn take(&mut self, kind: Kind, numbers: &[f64]) {
        let record = match (kind, numbers) {
            (Kind::Odometry, &[stamp_s, x, y, theta]) => {
                Record::Odometry(StampedPose { stamp_s, pose: Pose2::new(x, y, theta) })
            }
            (Kind::Odometry, &[stamp_s, x, y, z, qx, qy, qz, qw]) => {
                let pose = Pose3::from_quaternion([x, y, z], [qx, qy, qz, qw]).in_plane();
                Record::Odometry(StampedPose { stamp_s, pose })
            }
            (Kind::Encoders, &[stamp_s, left, right]) => {
                let [left_before, right_before] = self.counts.replace([left, right]).unwrap_or([left, right]);
                let (left_ticks, right_ticks) = (left - left_before, right - right_before);
                Record::Encoders(EncoderReading { stamp_s, left_ticks, right_ticks })
            }
            (Kind::Imu, &[stamp_s, wx, wy, wz, ax, ay, az]) => Record::Imu(ImuReading {
                stamp_s,
                angular_velocity_rad_s: [wx, wy, wz],
                linear_acceleration_m_s2: [ax, ay, az],
            }),
            (Kind::Scan, [stamp_s, first_rad, last_rad, ranges @ ..]) => Record::Scan(Scan {
                sensor: SensorId::default(),
                stamp_s: *stamp_s,
                ranges_m: ranges.iter().map(|&range_m| range_m as f32).collect(),
                geometry: self.geometry(*first_rad, *last_rad, ranges.len()),
                odometry: None,
            }),
            _ => return self.dropped.add(DropReason::MalformedLine),
        };
        self.records.push(record);
    }

    /// The geometry of a scan: made once while it stays the same.
    fn geometry(&mut self, first_rad: f64, last_rad: f64, rays: usize) -> Arc<ScanGeometry> {
        let key = [first_rad.to_bits(), last_rad.to_bits()];
        if let Some((known, geometry)) = &self.geometry
            && (*known, geometry.angles_rad.len()) == (key, rays)
        {
            return Arc::clone(geometry);
        }
        let step_rad = (last_rad - first_rad) / rays.saturating_sub(1).max(1) as f64;
        let geometry = Arc::new(ScanGeometry {
            angles_rad: (0..rays).map(|ray| first_rad + ray as f64 * step_rad).collect(),
            time_offsets_s: vec![0.0; rays],
            range_min_m: NEAREST_M,
            range_max_m: f32::INFINITY,
            below_minimum_is_no_return: true,
        });
        self.geometry = Some((key, Arc::clone(&geometry)));
        geometry
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::fs;
    use std::path::Path;

    fn file(text: &[u8]) -> Source {
        Source::File(FileSource::new(Path::new("drive.csv"), text.to_vec()).unwrap())
    }

    fn read_text(text: &str) -> DataSet {
        let source = file(text.as_bytes());
        assert!(recognises(&source), "{text}");
        read(&source, &OpenOptions::default()).unwrap()
    }

    #[test]
    fn every_kind_of_line_is_read_with_and_without_its_word() {
        let text = "stamp;kind;whatever\n\
            # a comment\n\
            0.0, 1.0, 2.0, 0.5\n\
            odom;0.1;1.5;2.0;0.5\n\
            0.2 2.0 2.0 0 0 0 0.70710678 0.70710678\n\
            imu, 0.2, 0, 0, 0.1, 0, 0, 9.8\n\
            encoders, 0.2, 100, 200\n\
            encoders, 0.3, 110, 220\n\
            0.3, -1.5, 1.5, 1, 2, 0, inf, nan, 6, 7\n\
            scan, 0.4, -1.5, 1.5, 3.25\n\
            garbage\n";
        let log = read_text(text);
        assert_eq!((log.records.len(), log.dropped.count(DropReason::MalformedLine)), (8, 1));
        let Record::Odometry(tum) = log.records[2] else { panic!("{:?}", log.records[2]) };
        assert!((tum.pose.theta - std::f64::consts::FRAC_PI_2).abs() < 1e-7 && tum.pose.x == 2.0);
        let Record::Encoders(reading) = log.records[5] else { panic!("{:?}", log.records[5]) };
        assert_eq!((reading.left_ticks, reading.right_ticks), (10.0, 20.0));
        let scans: Vec<&Scan> = log.scans().collect();
        assert_eq!((scans[0].ranges_m.len(), scans[0].geometry.angles_rad[6]), (7, 1.5));
        use floorprint::sensors::Ray;
        let rays: Vec<Ray> = scans[0].ranges_m.iter().map(|&range_m| scans[0].geometry.classify(range_m)).collect();
        assert!(matches!(rays[1], Ray::Hit(_)) && matches!(rays[2..5], [Ray::NoReturn, Ray::NoReturn, Ray::Invalid]));
        assert_eq!(scans[1].ranges_m, [3.25]);
    }

    #[test]
    fn commas_beside_semicolons_are_decimal_points() {
        let log = read_text("1700000000,25;-1,5;1,5;2,5;2,25;2,125;3;3;3;3,5\nodom;1700000000,5;1,5;2,0;0,25\n");
        assert_eq!((log.records.len(), log.dropped.total()), (2, 0));
        let scan = log.scans().next().unwrap();
        assert_eq!((scan.stamp_s, &scan.ranges_m[..3]), (1_700_000_000.25, &[2.5, 2.25, 2.125][..]));
        let Record::Odometry(stamped) = log.records[1] else { panic!("{:?}", log.records[1]) };
        assert_eq!((stamped.stamp_s, stamped.pose), (1_700_000_000.5, Pose2::new(1.5, 2.0, 0.25)));
    }

    #[test]
    fn scans_are_known_by_whole_angles_or_whole_ranges_but_not_by_both() {
        for text in ["1.5 -2 2 1.25 1.5 1.25 1.5 1.75 2.5 3.5\n", "1 -1.5 1.5 1 2 3 4 5 6 7\n"] {
            assert!(recognises(&file(text.as_bytes())), "{text}");
        }
    }

    #[test]
    fn a_folder_with_a_file_for_each_sensor_is_sorted_by_time() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("Scans.csv"), "t,angle_min,angle_max\n1,-1,1,2,2,2\n2,-1,1,2,2,2\n").unwrap();
        fs::write(folder.path().join("odometry.tum"), "1 0 0 0 0 0 0 1\n1.5 1 0 0 0 0 0 1\n").unwrap();
        fs::write(folder.path().join("notes.txt"), "nothing of interest").unwrap();
        let source = Source::open(folder.path()).unwrap();
        assert!(recognises(&source));
        let log = read(&source, &OpenOptions::default()).unwrap();
        let stamps: Vec<f64> = log.records.iter().map(Record::stamp_s).collect();
        assert_eq!((stamps, log.dropped.total()), (vec![1.0, 1.0, 1.5, 2.0], 0));
        assert!(matches!(log.records[..2], [Record::Odometry(_), Record::Scan(_)]));
    }

    #[test]
    fn other_numbers_are_not_taken_for_scans() {
        let encoders = format!("100000 -1 1 2 0 0 0 170.1 {}\n", "1500 ".repeat(682));
        for text in [
            encoders.as_str(),
            "1 2 3\n",
            "1 2 3 4\n",
            "FLASER 3 1.5 1.5 1.5 0 0 0 0 0 0 1.0 h 1.0\n",
            "{\"scan\": 1}\n",
        ] {
            assert!(!recognises(&file(text.as_bytes())), "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_log_or_an_error(text in "[-a-z0-9.,; \n]{1,200}") {
            let after = format!("0,0,0,0\n{text}");
            let log = read(&file(after.as_bytes()), &OpenOptions::default()).unwrap();
            prop_assert!(!log.records.is_empty());
        }
    }
}
