//! The synchroniser: sensor records in, frames for the filter out.
//!
//! All records can be had at any time, so dead reckoning is made first, over the whole drive; a
//! frame is then made of each scan when it is asked for, and nothing is kept of it. Scans stay in
//! the order of the records: where a log's stamps run backwards, its order is right.

use super::config::{OdometrySource, ScanConfig};
use super::dead_reckoning::DeadReckoning;
use super::deskew::SweepMotion;
use super::readings::Readings;
use super::scan_projection::ScanProjection;
use super::summary::{Dropped, SynchronisationSummary};
use crate::SensorId;
use crate::config::Config;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::sensors::{Ray, Record, Records, RobotConfig, Scan, StampedPose};
use std::borrow::Cow;
use thiserror::Error;

/// Scans this far outside the odometry's span still count as inside it, seconds: about the
/// time between two readings.
const SPAN_TOLERANCE_S: f64 = 0.1;
/// Tables are kept for this many scan geometries; further ones are built for each scan.
const KEPT_PROJECTIONS: usize = 16;

/// Why no frames can be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OdometryError {
    /// There is nothing to localise with.
    #[error("the data set holds no usable LiDAR scan ({found} in all)")]
    NoScans {
        /// Scans in the data set.
        found: usize,
    },
    /// The odometry that was asked for cannot be had from these data.
    #[error(
        "odometry.source = \"{wanted}\" needs {missing}, but the data set holds none: choose another source or \"auto\""
    )]
    SourceMissing {
        /// The value of `odometry.source`.
        wanted: &'static str,
        /// What is not there.
        missing: &'static str,
    },
    /// Encoder counts without a calibration.
    #[error(
        "the data set holds encoder counts, but robot.wheels is not set: give left_m_per_tick, right_m_per_tick and track_width_m, or choose another odometry.source"
    )]
    NoWheelCalibration,
    /// A setting that cannot work.
    #[error("{key} = {found}: expected {expected}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: f64,
        /// What it has to be.
        expected: &'static str,
    },
}

/// The frames of a drive, made one by one as they are asked for, as often as they are asked for.
///
/// The records are a slice in memory, or any other [`Records`].
#[derive(Debug)]
pub struct Frames<'a, R: Records + ?Sized = [Record]> {
    records: &'a R,
    robot: RobotConfig,
    scan_config: ScanConfig,
    dead_reckoning: DeadReckoning,
    /// Tables for each LiDAR and geometry of its scans.
    projections: Vec<(SensorId, ScanProjection)>,
    places: Vec<Place>,
    summary: SynchronisationSummary,
}

/// Where a frame's scan is found and what odometry says of it.
#[derive(Debug, Clone, Copy)]
struct Place {
    record: usize,
    scan: usize,
    projection: Option<usize>,
    dead_reckoning: Pose2,
    motion: Option<Pose2>,
    stamp_s: f64,
}

impl<'a> Frames<'a> {
    /// Makes dead reckoning and chooses the scans that become frames.
    ///
    /// # Errors
    /// When there is no usable scan, when the odometry asked for cannot be made from these
    /// records, or when a setting of `[scan]`, `[odometry]` or `[robot.wheels]` cannot work.
    pub fn new(records: &'a [Record], config: &Config) -> Result<Self, OdometryError> {
        Self::of(records, config)
    }
}

impl<'a, R: Records + ?Sized> Frames<'a, R> {
    /// The same of records that need not be in memory; each is asked for once here, a scan once more
    /// for its frame.
    ///
    /// # Errors
    /// As [`new`](Frames::new).
    pub fn of(records: &'a R, config: &Config) -> Result<Self, OdometryError> {
        validate(config)?;
        let mut frames = Self {
            records,
            robot: config.robot.clone(),
            scan_config: config.scan.clone(),
            dead_reckoning: DeadReckoning::default(),
            projections: Vec::new(),
            places: Vec::new(),
            summary: SynchronisationSummary {
                source: config.odometry.source,
                scans: 0,
                frames: 0,
                dropped: Dropped::default(),
                notes: Vec::new(),
            },
        };
        let readings = frames.sort_records();
        let summary = &mut frames.summary;
        summary.source = readings.choose_source(config)?;
        frames.dead_reckoning = readings.dead_reckoning(summary.source, config, &mut summary.notes)?;
        if frames.places.is_empty() {
            return Err(OdometryError::NoScans { found: frames.summary.scans });
        }
        frames.note_steep_rays();
        frames.place_on_odometry();
        Ok(frames)
    }

    /// Number of frames; at least one.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "there is always a frame")]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// The frame at a position from 0 to [`len`](Self::len).
    #[must_use]
    pub fn frame(&self, position: usize) -> Option<Frame> {
        let place = self.places.get(position)?;
        let record = self.records.record(place.record)?;
        let Record::Scan(scan) = record.as_ref() else { return None };
        let built;
        let projection = match place.projection {
            Some(index) => &self.projections[index].1,
            None => {
                built = ScanProjection::new(&scan.geometry, self.robot.lidar_of(scan.sensor), &self.scan_config);
                &built
            }
        };
        let motion =
            projection.sweep_s().and_then(|sweep_s| SweepMotion::new(&self.dead_reckoning, scan.stamp_s, sweep_s));
        Some(Frame {
            index: place.scan,
            stamp_s: scan.stamp_s,
            elapsed_s: position
                .checked_sub(1)
                .map_or(0.0, |before| scan.stamp_s - self.places[before].stamp_s)
                .max(0.0),
            motion: place.motion,
            dead_reckoning: place.dead_reckoning,
            scan: projection.project(scan, motion),
        })
    }

    /// The frames in order.
    pub fn iter(&self) -> impl Iterator<Item = Frame> + '_ {
        (0..self.len()).filter_map(|position| self.frame(position))
    }

    /// Dead reckoning over the whole drive, `start_from_body`: the identity at the first frame's stamp.
    #[must_use]
    pub fn dead_reckoning(&self) -> &DeadReckoning {
        &self.dead_reckoning
    }

    /// Dead reckoning at each frame's stamp.
    pub fn dead_reckoned_poses(&self) -> impl Iterator<Item = StampedPose> + '_ {
        self.places.iter().map(|place| StampedPose { stamp_s: place.stamp_s, pose: place.dead_reckoning })
    }

    /// What was used, dropped and noticed.
    #[must_use]
    pub fn summary(&self) -> &SynchronisationSummary {
        &self.summary
    }

    /// Walks through the records: the readings of odometry are kept, scans that are unusable are
    /// dropped, and of the rest one in `scan.every` gets its place.
    fn sort_records(&mut self) -> Readings {
        let records = self.records;
        let mut readings = Readings::default();
        let mut previous: Option<Cow<'_, Record>> = None;
        let mut usable = 0;
        for (position, record) in (0..records.count()).filter_map(|at| Some((at, records.record(at)?))) {
            readings.add(&record, &mut self.summary.dropped);
            let Record::Scan(scan) = record.as_ref() else { continue };
            let number = self.summary.scans;
            self.summary.scans += 1;
            let projection = self.projection_of(scan);
            let counter = if !scan.stamp_s.is_finite() {
                &mut self.summary.dropped.scans_without_stamp
            } else if scan.ranges_m.len() != scan.geometry.len() {
                &mut self.summary.dropped.scans_of_wrong_length
            } else if previous.as_deref().is_some_and(|previous| repeats(previous, scan)) {
                &mut self.summary.dropped.scans_repeated
            } else if !says_something(scan) {
                &mut self.summary.dropped.scans_without_valid_ray
            } else {
                if usable % self.scan_config.every == 0 {
                    self.places.push(Place {
                        record: position,
                        scan: number,
                        projection,
                        dead_reckoning: Pose2::IDENTITY,
                        motion: None,
                        stamp_s: scan.stamp_s,
                    });
                }
                usable += 1;
                previous = Some(record);
                continue;
            };
            *counter += 1;
        }
        self.summary.frames = self.places.len();
        readings
    }

    /// Tells of rays that cannot be used.
    fn note_steep_rays(&mut self) {
        for (_, projection) in &self.projections {
            let steep = projection.steep_rays();
            if steep > 0 {
                self.summary.notes.push(format!(
                    "rays of a scan that are too steep to see walls and are not used: {steep} of {}",
                    projection.rays()
                ));
            }
        }
    }

    /// The index of the tables for a scan's geometry, built when it is new.
    fn projection_of(&mut self, scan: &Scan) -> Option<usize> {
        if let Some(index) = self
            .projections
            .iter()
            .rposition(|(sensor, projection)| *sensor == scan.sensor && projection.fits(&scan.geometry))
        {
            return Some(index);
        }
        if self.projections.len() == KEPT_PROJECTIONS {
            return None;
        }
        let projection = ScanProjection::new(&scan.geometry, self.robot.lidar_of(scan.sensor), &self.scan_config);
        self.projections.push((scan.sensor, projection));
        Some(self.projections.len() - 1)
    }

    /// Gives every frame its dead reckoning and the motion since the frame before.
    fn place_on_odometry(&mut self) {
        let (records, log_poses) = (self.records, self.summary.source == OdometrySource::Log);
        let stated_pose = |place: &Place| {
            let record = log_poses.then(|| records.record(place.record)).flatten()?;
            let Record::Scan(scan) = record.as_ref() else { return None };
            scan.odometry.filter(Pose2::is_finite)
        };
        let mut origin = None;
        let mut previous: Option<(Pose2, bool, f64)> = None;
        let (mut unknown, mut jumps, mut largest_jump_m) = (0, 0, 0.0_f64);
        for place in &mut self.places {
            let stated = stated_pose(place);
            let origin = *origin.get_or_insert_with(|| {
                let first = stated.unwrap_or_else(|| self.dead_reckoning.pose_at(place.stamp_s));
                self.dead_reckoning = std::mem::take(&mut self.dead_reckoning).seen_from(&first);
                first
            });
            let stated = stated.map(|pose| origin.between(&pose));
            let known = stated.is_some() || within(self.dead_reckoning.span_s(), place.stamp_s);
            let pose = stated.unwrap_or_else(|| self.dead_reckoning.pose_at(place.stamp_s));
            place.dead_reckoning = pose;
            place.motion = known.then_some(Pose2::IDENTITY);
            if let Some((before, known_before, before_s)) = previous {
                let step = before.between(&pose);
                let apart_s = (place.stamp_s - before_s).abs();
                let jumped = step.distance() > JUMP_M + FASTEST_M_S * apart_s;
                place.motion = (known && known_before && !jumped).then_some(step);
                if jumped {
                    largest_jump_m = largest_jump_m.max(step.distance());
                    jumps += 1;
                }
            }
            unknown += usize::from(!known);
            previous = Some((pose, known, place.stamp_s));
        }
        if jumps > 0 {
            let note = format!(
                "jumps of the odometry faster than any robot, which were not believed: {jumps}; the largest {largest_jump_m:.0} m"
            );
            self.summary.notes.push(note);
        }
        if unknown > 0 && self.summary.source != OdometrySource::ScanMatching {
            self.summary.notes.push(format!("scans outside the odometry's span, whose motion is unknown: {unknown}"));
        }
    }
}

/// No robot is faster than this, m/s.
const FASTEST_M_S: f64 = 50.0;

/// Steps that are no longer than this are the filter's to judge, however fast: a robot may be carried, and
/// stamps may stand still, metres.
const JUMP_M: f64 = 100.0;

fn repeats(previous: &Record, scan: &Scan) -> bool {
    matches!(previous, Record::Scan(previous)
        if previous.sensor == scan.sensor && previous.stamp_s == scan.stamp_s && previous.ranges_m == scan.ranges_m)
}

/// Whether any ray says something: a hit, or that nothing came back.
fn says_something(scan: &Scan) -> bool {
    scan.ranges_m.iter().any(|&range_m| scan.geometry.classify(range_m) != Ray::Invalid)
}

fn within(span_s: Option<[f64; 2]>, stamp_s: f64) -> bool {
    span_s.is_some_and(|[from_s, to_s]| stamp_s >= from_s - SPAN_TOLERANCE_S && stamp_s <= to_s + SPAN_TOLERANCE_S)
}

fn validate(config: &Config) -> Result<(), OdometryError> {
    let check = |holds: bool, key: &'static str, found: f64, expected: &'static str| {
        if holds { Ok(()) } else { Err(OdometryError::Setting { key, found, expected }) }
    };
    let (scan, odometry) = (&config.scan, &config.odometry);
    check(scan.every >= 1, "scan.every", scan.every as f64, "1 or more")?;
    check(scan.range_min_m >= 0.0, "scan.range_min_m", scan.range_min_m, "0 or more")?;
    check(scan.range_max_m > scan.range_min_m, "scan.range_max_m", scan.range_max_m, "more than scan.range_min_m")?;
    check(scan.no_return_clear_m >= 0.0, "scan.no_return_clear_m", scan.no_return_clear_m, "0 or more")?;
    let low_pass_hz = odometry.gyro_low_pass_hz;
    check(low_pass_hz >= 0.0, "odometry.gyro_low_pass_hz", low_pass_hz, "0 (off) or more")?;
    for lidar in std::iter::once(&config.robot.lidar).chain(&config.robot.further_lidars) {
        let sweep_s = lidar.sweep_duration_s;
        check(sweep_s >= 0.0 && sweep_s.is_finite(), "robot.lidar.sweep_duration_s", sweep_s, "0 or more")?;
    }
    let Some(wheels) = &config.robot.wheels else { return Ok(()) };
    for (key, found) in [
        ("robot.wheels.left_m_per_tick", wheels.left_m_per_tick),
        ("robot.wheels.right_m_per_tick", wheels.right_m_per_tick),
    ] {
        check(found != 0.0 && found.is_finite(), key, found, "a finite number other than 0")?;
    }
    let track_width_m = wheels.track_width_m;
    check(track_width_m > 0.0, "robot.wheels.track_width_m", track_width_m, "more than 0")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{EncoderReading, ImuReading, ScanGeometry, StampAt, WheelConfig};
    use proptest::prelude::*;
    use std::sync::Arc;

    const M_PER_TICK: f64 = 0.002;

    fn geometry() -> Arc<ScanGeometry> {
        Arc::new(ScanGeometry {
            angles_rad: vec![-0.5, 0.0, 0.5],
            time_offsets_s: vec![0.0; 3],
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return: false,
        })
    }

    fn scan_of(stamp_s: f64, ranges_m: Vec<f32>, odometry: Option<Pose2>) -> Record {
        Record::Scan(Scan { sensor: SensorId::default(), stamp_s, ranges_m, geometry: geometry(), odometry })
    }

    fn scan(stamp_s: f64) -> Record {
        scan_of(stamp_s, vec![1.0, 2.0, 3.0], None)
    }

    fn ticks(stamp_s: f64, left: f64, right: f64) -> Record {
        Record::Encoders(EncoderReading { stamp_s, left_ticks: left, right_ticks: right })
    }

    fn gyro(stamp_s: f64, rate: f64) -> Record {
        Record::Imu(ImuReading {
            stamp_s,
            angular_velocity_rad_s: [0.0, 0.0, rate],
            linear_acceleration_m_s2: [0.0, 0.0, 9.81],
        })
    }

    fn config() -> Config {
        let mut config = Config::default();
        config.robot.wheels =
            Some(WheelConfig { left_m_per_tick: M_PER_TICK, right_m_per_tick: M_PER_TICK, track_width_m: 0.5 });
        config
    }

    fn frames<'a>(records: &'a [Record], config: &Config) -> Frames<'a> {
        Frames::new(records, config).unwrap()
    }

    #[test]
    fn unusable_scans_are_dropped_and_counted() {
        let records = [
            scan(1.0),
            scan(1.0),
            scan(f64::NAN),
            scan_of(2.0, vec![1.0], None),
            scan_of(3.0, vec![f32::NAN, 0.0, -1.0], None),
            scan_of(4.0, vec![f32::INFINITY; 3], None),
        ];
        let frames = frames(&records, &config());
        let summary = frames.summary();
        assert_eq!(frames.iter().map(|frame| frame.index).collect::<Vec<_>>(), [0, 5]);
        assert_eq!((summary.scans, summary.frames), (6, 2));
        let expected = Dropped {
            scans_repeated: 1,
            scans_without_stamp: 1,
            scans_of_wrong_length: 1,
            scans_without_valid_ray: 1,
            ..Dropped::default()
        };
        assert_eq!(summary.dropped, expected);
    }

    #[test]
    fn no_scan_is_an_error() {
        assert_eq!(Frames::new(&[], &config()).err(), Some(OdometryError::NoScans { found: 0 }));
    }

    #[test]
    fn encoders_without_calibration_are_an_error() {
        let records = [ticks(0.0, 0.0, 0.0), scan(1.0)];
        assert_eq!(Frames::new(&records, &Config::default()).err(), Some(OdometryError::NoWheelCalibration));
    }

    #[test]
    fn without_odometry_the_motion_is_unknown() {
        let records = [scan(1.0), scan(2.0)];
        let frames = frames(&records, &config());
        assert!(frames.iter().all(|frame| frame.motion.is_none() && frame.dead_reckoning == Pose2::IDENTITY));
        assert_eq!(frames.summary().source, OdometrySource::ScanMatching);
    }

    #[test]
    fn stamps_that_run_backwards_keep_the_log_s_order() {
        let at = |x| Some(Pose2::new(x, 0.0, 0.0));
        let ranges = || vec![1.0, 2.0, 3.0];
        let records =
            [scan_of(10.0, ranges(), at(5.0)), scan_of(9.0, ranges(), at(6.0)), scan_of(11.0, ranges(), at(8.0))];
        let frames: Vec<Frame> = frames(&records, &config()).iter().collect();
        let motions: Vec<_> = frames.iter().filter_map(|frame| frame.motion).map(|motion| motion.x).collect();
        assert_eq!(motions, [0.0, 1.0, 2.0]);
        assert_eq!(frames.iter().map(|frame| frame.elapsed_s).collect::<Vec<_>>(), [0.0, 0.0, 2.0]);
        assert_eq!(frames[2].dead_reckoning.x, 3.0);
    }

    #[test]
    fn a_jump_of_the_odometry_that_no_robot_can_make_is_not_believed() {
        let places = [(0.0, 0.0), (0.2, 1.0), (0.4, 701.0), (0.6, 702.0)];
        let scan = |(stamp_s, x)| scan_of(stamp_s, vec![1.0, 2.0, 3.0], Some(Pose2::new(x, 0.0, 0.0)));
        let records = places.map(scan);
        let frames = frames(&records, &config());
        let motions: Vec<_> = frames.iter().map(|frame| frame.motion.map(|motion| motion.x)).collect();
        assert_eq!(motions, [Some(0.0), Some(1.0), None, Some(1.0)]);
        assert!(frames.summary().notes.iter().any(|note| note.contains("not believed: 1; the largest 700 m")));
    }

    #[test]
    fn outside_the_odometry_s_span_the_motion_is_unknown() {
        let mut records: Vec<Record> = (0..=100).map(|k| ticks(f64::from(k) * 0.02, 5.0, 5.0)).collect();
        records.extend([scan(-1.0), scan(1.0), scan(2.05), scan(3.0)]);
        let frames = frames(&records, &config());
        let known: Vec<_> = frames.iter().map(|frame| frame.motion.is_some()).collect();
        assert_eq!(known, [false, false, true, false]);
        assert!(frames.summary().notes.iter().any(|note| note.ends_with("is unknown: 2")));
    }

    #[test]
    fn the_gyro_s_bias_is_found_at_rest_and_taken_off() {
        let mut records = Vec::new();
        for k in 0..400 {
            let stamp_s = f64::from(k) * 0.025;
            records.push(ticks(stamp_s, if k < 200 { 0.0 } else { 10.0 }, if k < 200 { 0.0 } else { 10.0 }));
        }
        records.extend((-5..1005).map(|k| gyro(f64::from(k) * 0.01, 0.02)));
        records.extend([scan(0.0), scan(9.9)]);
        let frames = frames(&records, &config());
        let last = frames.frame(1).and_then(|frame| frame.motion).unwrap();
        assert!(last.theta.abs() < 1e-6 && (last.x - 0.02 * (9.9 - 4.975) / 0.025).abs() < 1e-6, "{last:?}");
    }

    #[test]
    fn a_setting_that_cannot_work_is_named() {
        let mut config = config();
        config.scan.every = 0;
        let message = Frames::new(&[scan(0.0)], &config).err().map(|error| error.to_string());
        assert_eq!(message.as_deref(), Some("scan.every = 0: expected 1 or more"));
    }

    #[test]
    fn points_of_a_sweep_are_put_where_they_stood() {
        let mut config = config();
        config.robot.lidar.mount.x_m = 0.2;
        config.robot.lidar.sweep_duration_s = 0.08;
        config.robot.lidar.stamp_at = StampAt::Start;
        let mut records: Vec<Record> = (0..100).map(|k| ticks(f64::from(k) * 0.02, 4.0, 9.0)).collect();
        records.push(scan(1.0));
        let frames = frames(&records, &config);
        let frame = frames.frame(0).unwrap();
        let Some(Record::Scan(scan)) = records.last() else { panic!("the last record is a scan") };
        for (ray, point) in frame.scan.hits.iter().enumerate() {
            let (sin, cos) = scan.geometry.angles_rad[ray].sin_cos();
            let range_m = f64::from(scan.ranges_m[ray]);
            let body = frames.dead_reckoning().pose_at(1.0 + 0.04 * ray as f64);
            let truth = body.transform_point([0.2 + range_m * cos, range_m * sin]);
            assert!((f64::from(point[0]) - truth[0]).hypot(f64::from(point[1]) - truth[1]) < 1e-4, "{ray}");
        }
        assert!(frames.dead_reckoning().motion(1.0, 1.08).theta > 0.05, "the test needs a turning body");
    }

    fn drive() -> impl Strategy<Value = Vec<Record>> {
        prop::collection::vec((1..80i32, -9..30i32, -9..30i32, -2.0..2.0_f64), 20..80).prop_map(|steps| {
            let mut stamp_s = 0.0;
            let mut records = Vec::new();
            for (interval, left, right, rate) in steps {
                stamp_s += f64::from(interval) / 1000.0;
                records.push(ticks(stamp_s, f64::from(left), f64::from(right)));
                records.push(gyro(stamp_s - 0.003, rate));
            }
            records
        })
    }

    fn total_ticks(records: &[Record]) -> f64 {
        let mean = |record: &Record| match record {
            Record::Encoders(reading) => f64::midpoint(reading.left_ticks, reading.right_ticks),
            _ => 0.0,
        };
        records.iter().map(mean).sum()
    }

    proptest! {
        #[test]
        fn every_tick_is_used_once_whatever_the_scans_stamps(
            drive in drive(), stamps in prop::collection::vec(-0.5..4.0_f64, 1..50),
        ) {
            let mut config = config();
            config.odometry.source = OdometrySource::Wheels;
            config.robot.wheels.as_mut().unwrap().track_width_m = 1e12;
            let mut records = drive.clone();
            records.push(scan(-10.0));
            let mut stamps = stamps;
            stamps.sort_by(f64::total_cmp);
            records.extend(stamps.into_iter().map(scan));
            records.push(scan(10.0));
            let frames = frames(&records, &config);
            let sum: f64 = frames
                .iter()
                .scan(Pose2::IDENTITY, |before, frame| {
                    let motion = before.between(&frame.dead_reckoning);
                    *before = frame.dead_reckoning;
                    Some(motion.x)
                })
                .sum();
            prop_assert!((sum - total_ticks(&drive) * M_PER_TICK).abs() < 1e-9);
        }

        #[test]
        fn extra_scans_change_no_pose(
            drive in drive(), extra in prop::collection::vec(0.0..1.5_f64, 0..20),
        ) {
            let config = config();
            let mut records = drive;
            records.extend([scan(0.0), scan(0.5), scan(1.0)]);
            let plain: Vec<_> = frames(&records, &config).dead_reckoned_poses().collect();
            let mut stamps = extra;
            stamps.extend([0.5, 1.0]);
            stamps.sort_by(f64::total_cmp);
            stamps.dedup();
            records.truncate(records.len() - 2);
            records.extend(stamps.into_iter().map(scan));
            let more: Vec<_> = frames(&records, &config).dead_reckoned_poses().collect();
            prop_assert!(plain.iter().all(|pose| more.contains(pose)));
        }

        #[test]
        fn motions_add_up_to_dead_reckoning(drive in drive(), every in 1..4usize) {
            let mut config = config();
            config.scan.every = every;
            let mut records = drive;
            records.extend((0..40).map(|k| scan(f64::from(k) * 0.02)));
            let mut sum = Pose2::IDENTITY;
            for frame in frames(&records, &config).iter() {
                sum = sum.compose(&frame.motion.unwrap_or(Pose2::IDENTITY));
                prop_assert!(sum.between(&frame.dead_reckoning).distance() < 1e-9);
            }
        }
    }
}
