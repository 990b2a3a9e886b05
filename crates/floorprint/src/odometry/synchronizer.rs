//! The synchroniser: sensor records in, one by one, frames for the filter out.
//!
//! Nothing is taken from the future: a scan waits until the odometry has passed it, for `odometry.delay_s` of the
//! data's own time at the most, and as long again for records that come late. What comes out depends on the records'
//! stamps and on their order within each sensor alone, not on how the sensors' records come mixed, as long as none
//! comes later than that. Scans of one LiDAR stay in their order: where a log's stamps run backwards, its order is right.

use super::config::OdometrySource;
use super::corrections::OdometryCorrections;
use super::dead_reckoning::DeadReckoning;
use super::deskew::SweepMotion;
use super::error::OdometryError;
use super::finding::Finding;
use super::gyro::YawRate;
use super::scan_projection::Projections;
use super::scan_queue::{ScanQueue, Wait, Waiting};
use super::stamp_filter::StampFilter;
use super::stated_odometry::StatedOdometry;
use super::summary::{Dropped, SynchronisationSummary};
use super::wheel_odometry::WheelOdometry;
use crate::SensorId;
use crate::config::Config;
use crate::frame::{BodyScan, Frame};
use crate::geometry::Pose2;
use crate::sensors::{EncoderReading, ImuReading, Record, Scan, StampedPose};
use std::collections::VecDeque;

/// Scans this far outside the odometry's span still count as inside it, seconds: about the
/// time between two readings.
const SPAN_TOLERANCE_S: f64 = 0.1;
/// Stamps of a LiDAR may run back by this much for the motion to be known still, seconds.
const BACKWARDS_S: f64 = 2.0;
/// No robot is faster than this, m/s.
const FASTEST_M_S: f64 = 50.0;
/// Steps that are no longer than this are the filter's to judge, however fast: a robot may be carried, and
/// stamps may stand still, metres.
const JUMP_M: f64 = 100.0;
/// A reading is taken to repeat one of so many before it when all its numbers are the same.
const REMEMBERED: usize = 8;

/// Makes frames of records, pushed one by one.
///
/// Memory is bounded: no more is kept than the delay needs.
#[derive(Debug)]
pub struct Synchronizer {
    /// One usable scan in this many becomes a frame.
    every: usize,
    /// How late records may come, and how long scans wait for the odometry, seconds.
    delay_s: f64,
    surveyed: bool,
    /// The latest stamp of all, seconds: what time it is in the data.
    clock_s: f64,
    scans: ScanQueue,
    encoders: StampFilter<EncoderReading>,
    imu: StampFilter<ImuReading>,
    poses: StampFilter<StampedPose>,
    remembered_ticks: VecDeque<[u64; 3]>,
    /// How late the gyro's stamps are, seconds, and what its rates are multiplied by.
    gyro_lag_s: f64,
    gyro_scale: f64,
    sources: Sources,
    projections: Projections,
    /// Longest sweep so far, seconds.
    sweep_s: f64,
    /// `odometry_from_start`: the odometry's pose at the first frame for which it is known.
    origin: Option<Pose2>,
    previous: Option<Previous>,
    /// Latest key of a scan that has had its turn, seconds.
    passed_s: f64,
    usable: usize,
    unknown: usize,
    jumps: usize,
    largest_jump_m: f64,
    summary: SynchronisationSummary,
}

/// Where motion can come from.
#[derive(Debug)]
struct Sources {
    wanted: OdometrySource,
    /// What is used; `None` as long as that is open.
    chosen: Option<Source>,
    wheels: Option<WheelOdometry>,
    /// Poses of the robot's own odometry.
    stated: StatedOdometry,
    /// Poses that the first LiDAR's scans carry.
    carried: StatedOdometry,
    /// When each was first seen, seconds.
    first_ticks_s: Option<f64>,
    first_yaw_rate_s: Option<f64>,
    first_stated_s: Option<f64>,
    first_carried_s: Option<f64>,
}

/// Where motion comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// The wheels, and the gyro as it comes.
    Wheels,
    /// Poses of the robot's own odometry.
    Stated,
    /// Poses that the first LiDAR's scans carry.
    Carried,
    /// Nowhere.
    Nothing,
}

/// What the next frame's motion starts from.
#[derive(Debug, Clone, Copy)]
struct Previous {
    dead_reckoning: Pose2,
    is_known: bool,
    stamp_s: f64,
}

/// Whether the odometry says where the body was.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Motion {
    /// It may still.
    Open,
    /// It does, by what was known at a time (seconds).
    Known(f64),
    /// It never will; by what was known at a time (seconds).
    Unknown(f64),
}

impl Synchronizer {
    /// Nothing seen yet. `corrections` are what a [`Survey`](crate::survey::Survey) found out beforehand; without any
    /// they are learnt on the way.
    ///
    /// # Errors
    /// When a setting of `[scan]`, `[odometry]` or `[robot]` cannot work.
    pub fn new(config: &Config, corrections: Option<&OdometryCorrections>) -> Result<Self, OdometryError> {
        validate(config)?;
        let lag = corrections.map_or(config.robot.lag, |corrections| corrections.lag);
        let wanted = corrections.map_or(config.odometry.source, |corrections| corrections.source);
        let wheels = config.robot.wheels.as_ref().map(|wheels| {
            let uses_gyro = wanted != OdometrySource::Wheels;
            WheelOdometry::new(wheels, uses_gyro, lag.encoders_s, &config.odometry, corrections)
        });
        let delay_s = corrections.map_or(config.odometry.delay_s, |corrections| corrections.delay_s);
        Ok(Self {
            every: config.scan.every,
            delay_s: delay_s + lag.largest_s(),
            surveyed: corrections.is_some(),
            clock_s: f64::NEG_INFINITY,
            scans: ScanQueue::new(1 + config.robot.further_lidars.len()),
            encoders: StampFilter::default(),
            imu: StampFilter::default(),
            poses: StampFilter::default(),
            remembered_ticks: VecDeque::new(),
            gyro_lag_s: lag.imu_s,
            gyro_scale: config.robot.scale.gyro,
            sources: Sources {
                wanted,
                chosen: match wanted {
                    OdometrySource::Wheels | OdometrySource::WheelsAndGyro => Some(Source::Wheels),
                    OdometrySource::ScanMatching => Some(Source::Nothing),
                    OdometrySource::Auto | OdometrySource::Log => None,
                },
                wheels,
                stated: StatedOdometry::new(config.robot.scale, lag.odometry_s),
                carried: StatedOdometry::new(config.robot.scale, lag.odometry_s),
                first_ticks_s: None,
                first_yaw_rate_s: None,
                first_stated_s: None,
                first_carried_s: None,
            },
            projections: Projections::new(&config.robot, &config.scan),
            sweep_s: 0.0,
            origin: None,
            previous: None,
            passed_s: f64::NEG_INFINITY,
            usable: 0,
            unknown: 0,
            jumps: 0,
            largest_jump_m: 0.0,
            summary: SynchronisationSummary {
                source: wanted,
                scans: 0,
                frames: 0,
                dropped: Dropped::default(),
                findings: Vec::new(),
            },
        })
    }

    /// Takes in the next record and gives the frames that are ready now, in order: none, or as many as were waiting
    /// for it.
    ///
    /// # Errors
    /// The record is the first that needs a calibration of the wheels, and there is none.
    pub fn push(&mut self, record: Record) -> Result<Vec<Frame>, OdometryError> {
        self.take(record);
        self.advance(self.clock_s)
    }

    /// Uses a source from the first record on, though no scan will ask for it.
    pub(crate) fn expect_no_scan(&mut self, source: OdometrySource) {
        self.sources.chosen = Some(match source {
            OdometrySource::Wheels | OdometrySource::WheelsAndGyro => Source::Wheels,
            OdometrySource::Log => Source::Stated,
            OdometrySource::Auto | OdometrySource::ScanMatching => Source::Nothing,
        });
    }

    /// The frames of the scans that still wait; no record comes any more.
    ///
    /// # Errors
    /// As [`push`](Self::push); and when the odometry that was asked for never came.
    pub fn finish(&mut self) -> Result<Vec<Frame>, OdometryError> {
        if let Some(reading) = self.encoders.finish() {
            self.take_ticks(reading);
        }
        if let Some(reading) = self.imu.finish() {
            self.take_imu(&reading);
        }
        if let Some(pose) = self.poses.finish() {
            self.take_pose(pose);
        }
        self.scans.finish();
        let frames = self.advance(f64::INFINITY)?;
        self.sources.check()?;
        Ok(frames)
    }

    /// The latest stretch of dead reckoning, `odometry_from_body`, from some seconds before the scans that wait. Its
    /// frame is the odometry's own; see [`origin`](Self::origin).
    #[must_use]
    pub fn dead_reckoning(&self) -> &DeadReckoning {
        self.sources.path()
    }

    /// `odometry_from_start`: the body's pose by odometry at the first frame, from which frames count their dead
    /// reckoning.
    #[must_use]
    pub fn origin(&self) -> Pose2 {
        self.origin.unwrap_or(Pose2::IDENTITY)
    }

    /// Number of scans that wait for their turn.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.scans.len()
    }

    /// What was used, dropped and noticed so far.
    #[must_use]
    pub fn summary(&self) -> SynchronisationSummary {
        let mut summary = self.summary.clone();
        summary.source = self.sources.in_use();
        let wheels = matches!(summary.source, OdometrySource::Wheels | OdometrySource::WheelsAndGyro);
        let findings = &mut summary.findings;
        if wheels {
            if !self.surveyed && self.sources.first_yaw_rate_s.is_none() {
                findings.push(Finding::NoImu);
            }
            findings.extend(self.sources.wheels.iter().flat_map(WheelOdometry::findings));
        } else if !self.surveyed && summary.source != OdometrySource::Log {
            findings.push(Finding::NoOdometry);
        }
        findings.extend(self.projections.findings());
        if self.jumps > 0 {
            findings.push(Finding::Jumps { count: self.jumps, largest_m: self.largest_jump_m });
        }
        if self.unknown > 0 && self.sources.chosen.is_some_and(|source| source != Source::Nothing) {
            findings.push(Finding::OutsideOdometry { scans: self.unknown });
        }
        summary
    }

    /// Sorts in a record, unless one of its numbers is not finite.
    fn take(&mut self, record: Record) {
        let finite = record.stamp_s().is_finite();
        let dropped = &mut self.summary.dropped;
        match record {
            Record::Scan(scan) => {
                if scan.odometry.is_some_and(|pose| !pose.is_finite()) {
                    dropped.odometry_poses += 1;
                } else if let Some(pose) = scan.odometry.filter(|_| finite && scan.sensor == SensorId::default()) {
                    self.sources.first_carried_s.get_or_insert(scan.stamp_s);
                    let newest_s = self.sources.carried.last().map(|last| last.stamp_s);
                    if newest_s.is_none_or(|newest_s| scan.stamp_s > newest_s) {
                        self.sources.carried.push(StampedPose { stamp_s: scan.stamp_s, pose });
                    }
                }
                let believed_s = self.scans.push(scan, self.clock_s, dropped);
                self.clock_s = believed_s.map_or(self.clock_s, |stamp_s| self.clock_s.max(stamp_s));
            }
            Record::Encoders(reading) => {
                if !(finite && reading.left_ticks.is_finite() && reading.right_ticks.is_finite()) {
                    dropped.encoder_readings += 1;
                    return;
                }
                let numbers = [reading.stamp_s, reading.left_ticks, reading.right_ticks].map(f64::to_bits);
                if self.remembered_ticks.contains(&numbers) {
                    dropped.readings_repeated += 1;
                    return;
                }
                self.remembered_ticks.push_back(numbers);
                if self.remembered_ticks.len() > REMEMBERED {
                    self.remembered_ticks.pop_front();
                }
                for (reading, is_believed) in
                    self.encoders.push(reading.stamp_s, reading, self.clock_s).into_iter().flatten()
                {
                    if is_believed {
                        self.take_ticks(reading);
                    } else {
                        self.summary.dropped.readings_of_stray_stamp += 1;
                    }
                }
            }
            Record::Imu(reading) => {
                if !(finite && reading.angular_velocity_rad_s[2].is_finite()) {
                    dropped.imu_readings += 1;
                    return;
                }
                for (reading, is_believed) in
                    self.imu.push(reading.stamp_s, reading, self.clock_s).into_iter().flatten()
                {
                    if is_believed {
                        self.take_imu(&reading);
                    } else {
                        self.summary.dropped.readings_of_stray_stamp += 1;
                    }
                }
            }
            Record::Odometry(stamped) => {
                if !(finite && stamped.pose.is_finite()) {
                    dropped.odometry_poses += 1;
                    return;
                }
                for (stamped, is_believed) in
                    self.poses.push(stamped.stamp_s, stamped, self.clock_s).into_iter().flatten()
                {
                    if is_believed {
                        self.take_pose(stamped);
                    } else {
                        self.summary.dropped.readings_of_stray_stamp += 1;
                    }
                }
            }
        }
    }

    fn take_ticks(&mut self, reading: EncoderReading) {
        self.clock_s = self.clock_s.max(reading.stamp_s);
        self.sources.first_ticks_s.get_or_insert(reading.stamp_s);
        if let Some(wheels) = &mut self.sources.wheels {
            wheels.add_ticks(reading);
        }
    }

    fn take_imu(&mut self, reading: &ImuReading) {
        self.clock_s = self.clock_s.max(reading.stamp_s);
        self.sources.first_yaw_rate_s.get_or_insert(reading.stamp_s);
        let yaw_rate = YawRate {
            stamp_s: reading.stamp_s - self.gyro_lag_s,
            rate_rad_s: self.gyro_scale * reading.angular_velocity_rad_s[2],
        };
        if let Some(wheels) = &mut self.sources.wheels
            && !wheels.add_yaw_rate(yaw_rate)
        {
            self.summary.dropped.readings_too_late += 1;
        }
    }

    fn take_pose(&mut self, stamped: StampedPose) {
        self.clock_s = self.clock_s.max(stamped.stamp_s);
        self.sources.first_stated_s.get_or_insert(stamped.stamp_s);
        match self.sources.stated.last() {
            Some(last) if last == stamped => self.summary.dropped.readings_repeated += 1,
            Some(last) if stamped.stamp_s < last.stamp_s => {
                // Scans that carry their poses need none of those stated between them.
                self.summary.dropped.readings_too_late += usize::from(self.sources.first_carried_s.is_none());
            }
            _ => self.sources.stated.push(stamped),
        }
    }

    /// Gives the frames that are ready when it is `clock_s` (seconds) in the data.
    fn advance(&mut self, clock_s: f64) -> Result<Vec<Frame>, OdometryError> {
        // All that happened until here has arrived.
        let known_s = clock_s - self.delay_s;
        if let Some(wheels) = &mut self.sources.wheels {
            wheels.advance(known_s);
        }
        let mut frames = Vec::new();
        while let Some((lidar, front, wait)) = self.scans.front(known_s) {
            let known_s = match wait {
                Wait::ForOtherLidars => break,
                Wait::ForOdometry => known_s,
                Wait::TooLong => f64::INFINITY,
            };
            let mut motion = Motion::Unknown(f64::NEG_INFINITY);
            if let Some(scan) = &front.scan {
                let sweep_s = self.projections.of(scan).sweep_s();
                let [first_s, last_s] = sweep_s.unwrap_or([0.0; 2]);
                self.sweep_s = self.sweep_s.max(last_s.max(0.0) - first_s.min(0.0));
                motion = self.sources.motion(front, scan, sweep_s, self.delay_s, known_s)?;
            }
            if motion == Motion::Open {
                break;
            }
            let Some(waiting) = self.scans.pop(lidar) else { break };
            frames.extend(self.frame(waiting, motion));
        }
        if clock_s < f64::INFINITY {
            self.sources.forget_before(clock_s - 2.0 * self.delay_s - 2.0 * self.sweep_s - BACKWARDS_S - 1.0);
        }
        Ok(frames)
    }

    /// The frame of a scan whose turn has come; none where the scan is not used.
    fn frame(&mut self, waiting: Waiting, motion: Motion) -> Option<Frame> {
        let index = self.summary.scans;
        self.summary.scans += 1;
        let scan = waiting.scan?;
        if waiting.key_s < self.passed_s {
            self.summary.dropped.scans_too_late += 1;
            return None;
        }
        self.passed_s = waiting.key_s;
        self.usable += 1;
        if !(self.usable - 1).is_multiple_of(self.every) {
            return None;
        }
        let (is_known, step, dead_reckoning) = self.step(&scan, motion);
        let body_scan = self.project(&scan, motion);
        let elapsed_s = self.previous.map_or(0.0, |previous| scan.stamp_s - previous.stamp_s).max(0.0);
        self.previous = Some(Previous { dead_reckoning, is_known, stamp_s: scan.stamp_s });
        self.summary.frames += 1;
        Some(Frame { index, stamp_s: scan.stamp_s, elapsed_s, motion: step, dead_reckoning, scan: body_scan })
    }

    /// Whether the pose at a scan is known, the motion since the frame before, and the pose seen from the start.
    fn step(&mut self, scan: &Scan, motion: Motion) -> (bool, Option<Pose2>, Pose2) {
        let carried = self.sources.carried_pose(scan);
        let (is_known, known_s) = match motion {
            Motion::Known(known_s) => (true, known_s),
            Motion::Unknown(known_s) => (carried.is_some(), known_s),
            Motion::Open => (false, f64::NEG_INFINITY),
        };
        let path = self.sources.path();
        let odometry_from_body = carried.unwrap_or_else(|| path.pose_at_known(scan.stamp_s, known_s));
        if self.origin.is_none() && (is_known || path.span_known_s(known_s).is_some()) {
            // What was driven while frames did not know of it counts from the odometry's beginning.
            let start = path.first().filter(|_| self.previous.is_some());
            self.origin = Some(start.unwrap_or(odometry_from_body));
        }
        let dead_reckoning = self.origin.map_or(Pose2::IDENTITY, |origin| origin.between(&odometry_from_body));
        self.unknown += usize::from(!is_known);
        let Some(previous) = self.previous else {
            return (is_known, is_known.then_some(Pose2::IDENTITY), dead_reckoning);
        };
        let step = previous.dead_reckoning.between(&dead_reckoning);
        let apart_s = (scan.stamp_s - previous.stamp_s).abs();
        let jumped = step.distance() > JUMP_M + FASTEST_M_S * apart_s;
        if jumped {
            self.jumps += 1;
            self.largest_jump_m = self.largest_jump_m.max(step.distance());
        }
        (is_known, (is_known && previous.is_known && !jumped).then_some(step), dead_reckoning)
    }

    /// The scan's points in the body's frame.
    fn project(&mut self, scan: &Scan, motion: Motion) -> BodyScan {
        let range_noise_m = self.projections.learn_noise_m(scan);
        let Motion::Known(known_s) = motion else {
            let skew = self.projections.skew(scan);
            return BodyScan { range_noise_m, skew, ..self.projections.of(scan).project(scan, None) };
        };
        let projection = self.projections.of(scan);
        let path = self.sources.path();
        let body_at = |offset_s: f64| path.pose_at_known(scan.stamp_s + offset_s, known_s);
        let sweep = projection.sweep_s().and_then(|sweep_s| SweepMotion::new(body_at, sweep_s));
        BodyScan { range_noise_m, ..projection.project(scan, sweep) }
    }
}

impl Sources {
    /// The source in use, the gyro counted once it has spoken.
    fn in_use(&self) -> OdometrySource {
        match (self.chosen, self.wanted) {
            (Some(Source::Wheels), OdometrySource::Wheels) => OdometrySource::Wheels,
            (Some(Source::Wheels), _) if self.first_yaw_rate_s.is_some() => OdometrySource::WheelsAndGyro,
            (Some(Source::Wheels), _) => OdometrySource::Wheels,
            (Some(Source::Stated | Source::Carried), _) => OdometrySource::Log,
            (Some(Source::Nothing), _) => OdometrySource::ScanMatching,
            (None, wanted) => wanted,
        }
    }

    /// The trajectory by the source in use, `odometry_from_body`.
    fn path(&self) -> &DeadReckoning {
        static NOWHERE: DeadReckoning = DeadReckoning::nowhere();
        match self.chosen {
            Some(Source::Wheels) => self.wheels.as_ref().map_or(&NOWHERE, WheelOdometry::path),
            Some(Source::Stated) => self.stated.path(),
            Some(Source::Carried) => self.carried.path(),
            Some(Source::Nothing) | None => &NOWHERE,
        }
    }

    /// The pose that a scan carries, where the log's poses are used.
    fn carried_pose(&self, scan: &Scan) -> Option<Pose2> {
        let uses_log = matches!(self.chosen, Some(Source::Stated | Source::Carried));
        scan.odometry.filter(|pose| uses_log && !self.carried.corrects() && pose.is_finite())
    }

    /// Whether the pose at a scan is known when all that happened until `known_s` (seconds) has arrived.
    fn motion(
        &mut self,
        waiting: &Waiting,
        scan: &Scan,
        sweep_s: Option<[f64; 2]>,
        delay_s: f64,
        known_s: f64,
    ) -> Result<Motion, OdometryError> {
        let until_s = waiting.key_s + sweep_s.map_or(0.0, |[_, last_s]| last_s.max(0.0));
        // What comes later than this says nothing of the scan.
        let limit_s = until_s + delay_s;
        let is_over = known_s >= limit_s;
        if self.chosen.is_none() {
            self.choose(scan, limit_s, is_over)?;
        }
        match self.chosen {
            Some(Source::Nothing) => return Ok(Motion::Unknown(f64::NEG_INFINITY)),
            None if is_over => return Ok(Motion::Unknown(f64::NEG_INFINITY)),
            None => return Ok(Motion::Open),
            Some(_) if sweep_s.is_none() && self.carried_pose(scan).is_some() => {
                return Ok(Motion::Known(f64::NEG_INFINITY));
            }
            Some(_) => {}
        }
        let Some([from_s, to_s]) = self.path().span_known_s(limit_s) else {
            return Ok(if is_over { Motion::Unknown(limit_s) } else { Motion::Open });
        };
        if to_s < until_s && !is_over {
            return Ok(Motion::Open);
        }
        let has_place = scan.stamp_s <= waiting.key_s && scan.stamp_s >= waiting.key_s - BACKWARDS_S;
        let begun = scan.stamp_s >= from_s - SPAN_TOLERANCE_S;
        let goes_on = to_s >= until_s || scan.stamp_s <= to_s + SPAN_TOLERANCE_S;
        Ok(if has_place && begun && goes_on { Motion::Known(limit_s) } else { Motion::Unknown(limit_s) })
    }

    /// Chooses the best source that was there by `limit_s` (seconds), once it is certain which that is.
    fn choose(&mut self, scan: &Scan, limit_s: f64, is_over: bool) -> Result<(), OdometryError> {
        let there = |first_s: Option<f64>| first_s.is_some_and(|first_s| first_s <= limit_s);
        if scan.odometry.is_some_and(|pose| pose.is_finite()) {
            self.chosen = Some(Source::Carried);
        } else if there(self.first_stated_s) {
            self.chosen = Some(Source::Stated);
        } else if is_over && there(self.first_carried_s) {
            self.chosen = Some(Source::Carried);
        } else if is_over && there(self.first_ticks_s) && self.wanted == OdometrySource::Auto {
            if self.wheels.is_none() {
                return Err(OdometryError::NoWheelCalibration);
            }
            self.chosen = Some(Source::Wheels);
        }
        Ok(())
    }

    /// Whether what was asked for has come.
    fn check(&self) -> Result<(), OdometryError> {
        let missing = |wanted, missing| Err(OdometryError::SourceMissing { wanted, missing });
        match self.wanted {
            OdometrySource::Wheels if self.first_ticks_s.is_none() => missing("wheels", "encoder readings"),
            OdometrySource::WheelsAndGyro if self.first_ticks_s.is_none() => {
                missing("wheels_and_gyro", "encoder readings")
            }
            OdometrySource::WheelsAndGyro if self.first_yaw_rate_s.is_none() => {
                missing("wheels_and_gyro", "IMU readings")
            }
            OdometrySource::Log if self.first_stated_s.or(self.first_carried_s).is_none() => {
                missing("log", "odometry poses")
            }
            OdometrySource::Wheels | OdometrySource::WheelsAndGyro if self.wheels.is_none() => {
                Err(OdometryError::NoWheelCalibration)
            }
            _ => Ok(()),
        }
    }

    fn forget_before(&mut self, stamp_s: f64) {
        if let Some(wheels) = &mut self.wheels {
            wheels.forget_before(stamp_s);
        }
        self.stated.forget_before(stamp_s);
        self.carried.forget_before(stamp_s);
    }
}

/// Checks the settings that frames are made by.
///
/// # Errors
/// The first setting that cannot work.
pub(crate) fn validate(config: &Config) -> Result<(), OdometryError> {
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
    let delay_s = odometry.delay_s;
    check(delay_s >= 0.0 && delay_s.is_finite(), "odometry.delay_s", delay_s, "0 or more")?;
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
mod tests;
