//! The frames of a recorded or simulated drive.

use crate::config::Config;
use crate::frame::Frame;
use crate::odometry::{
    DeadReckoning, Finding, OdometryCorrections, OdometryError, SynchronisationSummary, Synchronizer,
};
use crate::sensors::{Record, Records, StampedPose};
use crate::survey::{Readings, Survey};
use std::collections::VecDeque;

/// The frames of a drive, made one by one by the [`Synchronizer`] that a live robot uses, as often as they are asked for.
///
/// The records are a slice in memory, or any other [`Records`]; each is asked for once at the beginning and once more
/// for every [`Pass`].
#[derive(Debug)]
pub struct Frames<'a, R: Records + ?Sized = [Record]> {
    records: &'a R,
    config: Config,
    corrections: Option<OdometryCorrections>,
    findings: Vec<Finding>,
    /// The records' positions in the order in which they are pushed.
    order: Vec<usize>,
    usable_scans: usize,
}

impl<'a> Frames<'a> {
    /// Looks through the records: a survey where the configuration asks for one.
    ///
    /// # Errors
    /// When there is no usable scan, when the odometry asked for cannot be made from these records, or when a setting
    /// of `[scan]`, `[odometry]` or `[robot]` cannot work.
    pub fn new(records: &'a [Record], config: &Config) -> Result<Self, OdometryError> {
        Self::of(records, config)
    }
}

impl<'a, R: Records + ?Sized> Frames<'a, R> {
    /// The same of records that need not be in memory.
    ///
    /// # Errors
    /// As [`new`](Frames::new).
    pub fn of(records: &'a R, config: &Config) -> Result<Self, OdometryError> {
        let readings = Readings::of(records);
        readings.check_scans()?;
        Self::of_readings(records, &readings, config)
    }

    /// Dead reckoning of a drive without a LiDAR: the body's pose at each reading of the odometry, the first of which is
    /// the identity; with what was used, dropped and noticed.
    ///
    /// # Errors
    /// When there is no odometry either, when the odometry asked for cannot be made from these records, or when a
    /// setting of `[scan]`, `[odometry]` or `[robot]` cannot work.
    pub fn without_scans(
        records: &'a R,
        config: &Config,
    ) -> Result<(Vec<StampedPose>, SynchronisationSummary), OdometryError> {
        let readings = Readings::of(records);
        let frames = Self::of_readings(records, &readings, config)?;
        let mut pass = frames.iter();
        if let Some(synchronizer) = pass.synchronizer() {
            synchronizer.expect_no_scan(readings.choose_source(config)?);
        }
        pass.by_ref().for_each(drop);
        if let Some(error) = pass.error() {
            return Err(error.clone());
        }
        let start = pass.path.first().ok_or(OdometryError::NoScans { found: 0 })?.pose;
        let mut poses: Vec<StampedPose> =
            DeadReckoning::new(pass.path.iter().copied()).seen_from(&start).knots().collect();
        // Of two poses at one time the later one holds: readings came at the same time, or were stamped backwards.
        poses.reverse();
        poses.dedup_by_key(|stamped| stamped.stamp_s);
        poses.reverse();
        Ok((poses, pass.summary()))
    }

    fn of_readings(records: &'a R, readings: &Readings, config: &Config) -> Result<Self, OdometryError> {
        let survey = Survey::of_readings(records, readings, config)?;
        let (corrections, findings) = match config.odometry.survey {
            true => (Some(survey.corrections), survey.findings),
            false => (None, Vec::new()),
        };
        let (order, usable_scans) = (readings.in_order_of_time(), readings.usable_scans);
        Ok(Self { records, config: config.clone(), corrections, findings, order, usable_scans })
    }

    /// Pushes the records in the order in which they stand instead of the order of their stamps.
    #[must_use]
    pub fn in_order_of_arrival(mut self) -> Self {
        self.order.sort_unstable();
        self
    }

    /// The frames as a live session made them that recorded these records: pushed in the order in which they stand, with
    /// the corrections that it had, if any.
    #[must_use]
    pub fn as_received(mut self, corrections: Option<OdometryCorrections>) -> Self {
        (self.corrections, self.findings) = (corrections, Vec::new());
        self.in_order_of_arrival()
    }

    /// What a survey of the records found for the synchroniser; `None` where the configuration asks for no survey.
    #[must_use]
    pub fn corrections(&self) -> Option<&OdometryCorrections> {
        self.corrections.as_ref()
    }

    /// The records' positions in the order in which they are pushed.
    #[must_use]
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// Number of frames, unless some scans come twice; at least one.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "there is always a frame")]
    pub fn len(&self) -> usize {
        self.usable_scans.div_ceil(self.config.scan.every)
    }

    /// The frames in order, from the first record on.
    #[must_use]
    pub fn iter(&self) -> Pass<'_, R> {
        let (synchronizer, error) = match Synchronizer::new(&self.config, self.corrections.as_ref()) {
            Ok(synchronizer) => (Some(synchronizer), None),
            Err(error) => (None, Some(error)),
        };
        Pass {
            records: self.records,
            order: &self.order,
            findings: &self.findings,
            synchronizer,
            error,
            position: 0,
            finished: false,
            ready: VecDeque::new(),
            path: Vec::new(),
            knots: 0,
        }
    }

    /// A pass to its end, the frames left out.
    fn walked(&self) -> Pass<'_, R> {
        let mut pass = self.iter();
        pass.by_ref().for_each(drop);
        pass
    }

    /// Dead reckoning over the whole drive, `start_from_body`, by a pass of its own; see [`Pass::dead_reckoning`].
    #[must_use]
    pub fn dead_reckoning(&self) -> DeadReckoning {
        self.walked().dead_reckoning()
    }

    /// Dead reckoning at each frame's stamp, by a pass of its own.
    #[must_use]
    pub fn dead_reckoned_poses(&self) -> Vec<StampedPose> {
        self.iter().map(|frame| StampedPose { stamp_s: frame.stamp_s, pose: frame.dead_reckoning }).collect()
    }

    /// What was used, dropped and noticed, by a pass of its own; see [`Pass::summary`].
    #[must_use]
    pub fn summary(&self) -> SynchronisationSummary {
        self.walked().summary()
    }
}

/// One pass through a drive, from its first record to its last.
#[derive(Debug)]
pub struct Pass<'a, R: Records + ?Sized = [Record]> {
    records: &'a R,
    order: &'a [usize],
    findings: &'a [Finding],
    synchronizer: Option<Synchronizer>,
    error: Option<OdometryError>,
    position: usize,
    finished: bool,
    ready: VecDeque<Frame>,
    /// Dead reckoning so far, `odometry_from_body`.
    path: Vec<StampedPose>,
    /// How many knots of it have been taken.
    knots: usize,
}

impl<R: Records + ?Sized> Iterator for Pass<'_, R> {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Some(frame);
            }
            let synchronizer = self.synchronizer.as_mut().filter(|_| !self.finished)?;
            let frames = match self.order.get(self.position) {
                Some(&position) => {
                    self.position += 1;
                    self.records
                        .record(position)
                        .map_or(Ok(Vec::new()), |record| synchronizer.push(record.into_owned()))
                }
                None => {
                    self.finished = true;
                    synchronizer.finish()
                }
            };
            match frames {
                Ok(frames) => self.ready.extend(frames),
                Err(error) => (self.error, self.finished) = (Some(error), true),
            }
            let (knots, count) = synchronizer.dead_reckoning().knots_from(self.knots);
            self.path.extend(knots);
            self.knots = count;
        }
    }
}

impl<R: Records + ?Sized> Pass<'_, R> {
    /// Why there are no more frames, where that was not the end of the drive.
    #[must_use]
    pub fn error(&self) -> Option<&OdometryError> {
        self.error.as_ref()
    }

    /// The synchroniser, for what it can be told on the way.
    pub fn synchronizer(&mut self) -> Option<&mut Synchronizer> {
        self.synchronizer.as_mut()
    }

    /// Dead reckoning so far, `start_from_body`: the identity at the first frame's stamp.
    #[must_use]
    pub fn dead_reckoning(&self) -> DeadReckoning {
        let origin = self.synchronizer.as_ref().map(Synchronizer::origin).unwrap_or_default();
        DeadReckoning::new(self.path.iter().copied()).seen_from(&origin)
    }

    /// What was used, dropped and noticed so far; what the survey found comes first.
    #[must_use]
    pub fn summary(&self) -> SynchronisationSummary {
        let mut summary = self.synchronizer.as_ref().map(Synchronizer::summary).unwrap_or_default();
        summary.findings.splice(0..0, self.findings.iter().copied());
        summary
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorId;
    use crate::geometry::Pose2;
    use crate::odometry::{Dropped, OdometrySource};
    use crate::sensors::{EncoderReading, ImuReading, Scan, ScanGeometry, StampAt, WheelConfig};
    use proptest::prelude::*;
    use std::sync::Arc;

    const M_PER_TICK: f64 = 0.002;

    fn geometry() -> Arc<ScanGeometry> {
        Arc::new(ScanGeometry {
            angles_rad: vec![-1.0, 0.0, 1.0],
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
    fn without_a_lidar_there_is_dead_reckoning_by_whatever_odometry_there_is() {
        let arc = |k: u32| {
            let stamp_s = f64::from(k) * 0.025;
            // Half a metre a second, and a tenth of a radian.
            let (left, right) = (0.0125 - 0.000_625, 0.0125 + 0.000_625);
            (stamp_s, ticks(stamp_s, left / M_PER_TICK, right / M_PER_TICK))
        };
        let stated = |k: u32| {
            let pose =
                Pose2::new(7.0, 8.0, 1.0).compose(&Pose2::exp([0.0125, 0.0, 0.0025].map(|rate| f64::from(k) * rate)));
            Record::Odometry(StampedPose { stamp_s: f64::from(k) * 0.025, pose })
        };
        let wheels: Vec<Record> = (0..=800).map(|k| arc(k).1).collect();
        let with_gyro: Vec<Record> = (0..=800).flat_map(|k| [arc(k).1, gyro(arc(k).0, 0.1)]).collect();
        let log: Vec<Record> = (0..=800).map(stated).collect();
        for (records, source) in
            [(wheels, OdometrySource::Wheels), (with_gyro, OdometrySource::WheelsAndGyro), (log, OdometrySource::Log)]
        {
            for survey in [true, false] {
                let mut config = config();
                config.odometry.survey = survey;
                let (poses, summary) = Frames::without_scans(records.as_slice(), &config).unwrap();
                assert_eq!((summary.source, summary.scans), (source, 0));
                assert_eq!(poses[0].pose, Pose2::IDENTITY);
                assert!(poses.len() >= 800 && poses.windows(2).all(|pair| pair[0].stamp_s < pair[1].stamp_s));
                let last = poses[poses.len() - 1];
                let truth = Pose2::exp([10.0, 0.0, 2.0]);
                assert!(last.pose.between(&truth).distance() < 0.05, "{source:?} {survey} {last:?}");
            }
        }
        let nothing = Frames::without_scans([gyro(0.0, 0.0), gyro(1.0, 0.0)].as_slice(), &config());
        assert_eq!(nothing.err(), Some(OdometryError::NoScans { found: 0 }));
    }

    #[test]
    fn encoders_without_calibration_are_an_error() {
        let records = [ticks(0.0, 0.0, 0.0), scan(1.0)];
        assert_eq!(Frames::new(&records, &Config::default()).err(), Some(OdometryError::NoWheelCalibration));
    }

    #[test]
    fn outside_the_odometry_s_span_the_motion_is_unknown() {
        let mut records: Vec<Record> = (0..=100).map(|k| ticks(f64::from(k) * 0.02, 5.0, 5.0)).collect();
        records.extend([scan(-1.0), scan(1.0), scan(2.05), scan(3.0)]);
        let frames = frames(&records, &config());
        let known: Vec<_> = frames.iter().map(|frame| frame.motion.is_some()).collect();
        assert_eq!(known, [false, false, true, false]);
        assert!(frames.summary().findings.contains(&Finding::OutsideOdometry { scans: 2 }));
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
        for survey in [true, false] {
            let mut config = config();
            config.odometry.survey = survey;
            let last = frames(&records, &config).iter().nth(1).and_then(|frame| frame.motion).unwrap();
            // Without a survey the first second and a half passes before the bias is known.
            let turn_rad = if survey { 0.0 } else { 0.02 * 1.6 };
            assert!((last.theta - turn_rad).abs() < 0.006, "{last:?}");
            assert!((last.distance() - 0.02 * (9.9 - 4.975) / 0.025).abs() < 1e-3, "{last:?}");
        }
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
        let (frame, dead_reckoning) = (frames.iter().next().unwrap(), frames.dead_reckoning());
        let Some(Record::Scan(scan)) = records.last() else { panic!("the last record is a scan") };
        for (ray, point) in frame.scan.hits.iter().enumerate() {
            let (sin, cos) = scan.geometry.angles_rad[ray].sin_cos();
            let range_m = f64::from(scan.ranges_m[ray]);
            let body = dead_reckoning.pose_at(1.0 + 0.04 * ray as f64);
            let truth = body.transform_point([0.2 + range_m * cos, range_m * sin]);
            assert!((f64::from(point[0]) - truth[0]).hypot(f64::from(point[1]) - truth[1]) < 1e-4, "{ray}");
        }
        assert!(dead_reckoning.motion(1.0, 1.08).theta > 0.05, "the test needs a turning body");
    }

    #[test]
    fn passes_are_alike_and_arrival_in_order_changes_nothing() {
        let mut records = Vec::new();
        for k in 0..400 {
            let stamp_s = f64::from(k) * 0.025;
            records.extend([ticks(stamp_s, 4.0, 5.0), gyro(stamp_s + 0.001, 0.1), scan(stamp_s + 0.002)]);
        }
        let (config, bytes) = (config(), |pass: Pass| pass.map(|frame| format!("{frame:?}")).collect::<Vec<_>>());
        let frames = frames(&records, &config);
        let first = bytes(frames.iter());
        assert_eq!((first.len(), frames.len()), (400, 400));
        assert_eq!(bytes(frames.iter()), first);
        assert_eq!(bytes(super::Frames::new(&records, &config).unwrap().in_order_of_arrival().iter()), first);
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

    proptest! {
        #[test]
        fn every_tick_is_used_once_whatever_the_scans_stamps(
            drive in drive(), stamps in prop::collection::vec(-0.5..4.0_f64, 1..50),
        ) {
            let mut config = config();
            config.odometry.source = OdometrySource::Wheels;
            config.robot.wheels.as_mut().unwrap().track_width_m = 1e12;
            let mut records = drive.clone();
            records.push(scan(-1.0));
            let mut stamps = stamps;
            stamps.sort_by(f64::total_cmp);
            records.extend(stamps.into_iter().map(scan));
            records.push(scan(9.0));
            let frames = frames(&records, &config);
            let sum: f64 = frames
                .iter()
                .scan(Pose2::IDENTITY, |before, frame| {
                    let motion = before.between(&frame.dead_reckoning);
                    *before = frame.dead_reckoning;
                    Some(motion.x)
                })
                .sum();
            let ticks: f64 = drive
                .iter()
                .map(|record| match record {
                    Record::Encoders(reading) => f64::midpoint(reading.left_ticks, reading.right_ticks),
                    _ => 0.0,
                })
                .sum();
            prop_assert!((sum - ticks * M_PER_TICK).abs() < 1e-9);
        }

        #[test]
        fn extra_scans_change_no_pose(drive in drive(), extra in prop::collection::vec(0.0..1.5_f64, 0..20)) {
            let config = config();
            let mut records = drive;
            records.extend([scan(0.0), scan(0.5), scan(1.0)]);
            let plain = frames(&records, &config).dead_reckoned_poses();
            let mut stamps = extra;
            stamps.extend([0.5, 1.0]);
            stamps.sort_by(f64::total_cmp);
            stamps.dedup();
            records.truncate(records.len() - 2);
            records.extend(stamps.into_iter().map(scan));
            let more = frames(&records, &config).dead_reckoned_poses();
            prop_assert!(plain.iter().all(|pose| more.contains(pose)), "{plain:?} {more:?}");
        }
    }
}
