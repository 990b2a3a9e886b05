//! The readings of a recording by sensor, without the scans' ranges.

use super::lag::Turns;
use crate::SensorId;
use crate::config::Config;
use crate::geometry::{Pose2, wrap_angle};
use crate::odometry::gyro::YawRate;
use crate::odometry::{LEAP_S, OdometryError, OdometrySource, confirms, is_complete};
use crate::sensors::{EncoderReading, Record, Records, Stream};

/// What a survey looks at: usable readings, each sensor's in its own order.
#[derive(Debug, Default)]
pub(crate) struct Readings {
    pub(super) encoders: Vec<EncoderReading>,
    /// By their stamps, which increase.
    pub(super) yaw_rates: Vec<YawRate>,
    /// Stamps of the robot's own odometry, seconds, and its headings, radians.
    pub(super) stated: Vec<(f64, f64)>,
    /// The same of the poses that the first LiDAR's scans carry.
    carried: Vec<(f64, f64)>,
    /// Whether any scan carries a pose.
    is_carried: bool,
    stated_motion: Motion,
    carried_motion: Motion,
    /// Scans that can become frames.
    pub(crate) usable_scans: usize,
    /// Sensor and stamp of every record.
    stamps_s: Vec<(Sensor, f64)>,
}

/// Whether poses differ from each other.
#[derive(Debug, Default)]
struct Motion {
    first: Option<Pose2>,
    is_there: bool,
}

impl Motion {
    fn add(&mut self, pose: Pose2) {
        self.is_there |= *self.first.get_or_insert(pose) != pose;
    }
}

/// One sensor.
type Sensor = (Stream, SensorId);

impl Readings {
    /// Walks through the records; each is asked for once.
    pub(crate) fn of<R: Records + ?Sized>(records: &R) -> Self {
        let mut readings = Self::default();
        for record in (0..records.count()).filter_map(|position| records.record(position)) {
            readings.add(&record);
        }
        readings.yaw_rates.sort_by(|a, b| a.stamp_s.total_cmp(&b.stamp_s));
        readings
    }

    fn add(&mut self, record: &Record) {
        let stamp_s = record.stamp_s();
        let finite = stamp_s.is_finite();
        match record {
            Record::Scan(scan) => {
                let pose = scan.odometry.filter(|pose| finite && pose.is_finite());
                self.is_carried |= pose.is_some();
                pose.into_iter().for_each(|pose| self.carried_motion.add(pose));
                if scan.sensor == SensorId::default() {
                    self.carried.extend(pose.map(|pose| (stamp_s, pose.theta)));
                }
                self.usable_scans += usize::from(is_complete(scan));
            }
            Record::Encoders(reading) => {
                if finite && reading.left_ticks.is_finite() && reading.right_ticks.is_finite() {
                    self.encoders.push(*reading);
                }
            }
            Record::Imu(reading) => {
                let rate_rad_s = reading.angular_velocity_rad_s[2];
                if finite && rate_rad_s.is_finite() {
                    self.yaw_rates.push(YawRate { stamp_s, rate_rad_s });
                }
            }
            Record::Odometry(stamped) => {
                if finite && stamped.pose.is_finite() {
                    self.stated.push((stamp_s, stamped.pose.theta));
                    self.stated_motion.add(stamped.pose);
                }
            }
        }
        self.stamps_s.push((record.sensor(), stamp_s));
    }

    /// What a sensor states of the body's turns.
    pub(super) fn turns(&self, stream: Stream, config: &Config) -> Turns {
        let mut turns = Turns::default();
        match stream {
            Stream::Encoders => {
                let Some(wheels) = &config.robot.wheels else { return turns };
                for reading in &self.encoders {
                    let difference_m =
                        reading.right_ticks * wheels.right_m_per_tick - reading.left_ticks * wheels.left_m_per_tick;
                    turns.add(reading.stamp_s, difference_m / wheels.track_width_m);
                }
            }
            Stream::Imu => {
                for pair in self.yaw_rates.windows(2) {
                    let elapsed_s = pair[1].stamp_s - pair[0].stamp_s;
                    turns.add(pair[1].stamp_s, 0.5 * (pair[0].rate_rad_s + pair[1].rate_rad_s) * elapsed_s);
                }
            }
            Stream::Odometry | Stream::Scans => {
                let poses = if self.stated.is_empty() { &self.carried } else { &self.stated };
                for pair in poses.windows(2) {
                    turns.add(pair[1].0, wrap_angle(pair[1].1 - pair[0].1));
                }
            }
        }
        turns
    }

    /// Fails where no scan can become a frame.
    pub(crate) fn check_scans(&self) -> Result<(), OdometryError> {
        let found = self.stamps_s.iter().filter(|((stream, _), _)| *stream == Stream::Scans).count();
        if self.usable_scans > 0 { Ok(()) } else { Err(OdometryError::NoScans { found }) }
    }

    /// The sensors that have records, in order.
    pub(super) fn sensors(&self) -> Vec<Sensor> {
        let mut sensors: Vec<Sensor> = self.stamps_s.iter().map(|(sensor, _)| *sensor).collect();
        sensors.sort_unstable();
        sensors.dedup();
        sensors
    }

    /// A sensor's stamps as they are, seconds.
    pub(super) fn stamps_s(&self, sensor: Sensor) -> Vec<f64> {
        self.stamps_s.iter().filter(|(other, _)| *other == sensor).map(|&(_, stamp_s)| stamp_s).collect()
    }

    /// A sensor's records: their positions among all, and when they come if a sensor's records come in their order,
    /// seconds: never decreasing, stray stamps left out.
    pub(super) fn times_s(&self, sensor: Sensor) -> Vec<(usize, f64)> {
        let own = self.stamps_s.iter().enumerate().filter(|(_, (other, _))| *other == sensor);
        own.map(|(position, _)| position).zip(never_decreasing(&self.stamps_s(sensor))).collect()
    }

    /// The positions of all records in the order of time, each sensor's records in their own order.
    pub(crate) fn in_order_of_time(&self) -> Vec<usize> {
        let mut times: Vec<(usize, f64)> = self.sensors().into_iter().flat_map(|sensor| self.times_s(sensor)).collect();
        times.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        times.into_iter().map(|(position, _)| position).collect()
    }

    /// Whether poses are stated, but always the same: logs without odometry have zeros in its place.
    pub(super) fn has_poses_that_stand(&self) -> bool {
        self.has_poses() && !self.stated_motion.is_there && !self.carried_motion.is_there
    }

    fn has_poses(&self) -> bool {
        self.is_carried || !self.stated.is_empty()
    }

    /// The source that the configuration asks for, or with `Auto` the best that is there.
    pub(crate) fn choose_source(&self, config: &Config) -> Result<OdometrySource, OdometryError> {
        let needs = |wanted, missing, there: bool| {
            if there { Ok(()) } else { Err(OdometryError::SourceMissing { wanted, missing }) }
        };
        let source = match config.odometry.source {
            OdometrySource::Auto if self.has_poses() && !self.has_poses_that_stand() => OdometrySource::Log,
            OdometrySource::Auto if self.encoders.is_empty() => OdometrySource::ScanMatching,
            OdometrySource::Auto if self.yaw_rates.is_empty() => OdometrySource::Wheels,
            OdometrySource::Auto => OdometrySource::WheelsAndGyro,
            chosen => chosen,
        };
        match source {
            OdometrySource::Wheels => needs("wheels", "encoder readings", !self.encoders.is_empty())?,
            OdometrySource::WheelsAndGyro => {
                needs("wheels_and_gyro", "encoder readings", !self.encoders.is_empty())?;
                needs("wheels_and_gyro", "IMU readings", !self.yaw_rates.is_empty())?;
            }
            OdometrySource::Log => needs("log", "odometry poses", self.has_poses())?,
            OdometrySource::Auto | OdometrySource::ScanMatching => {}
        }
        Ok(source)
    }
}

/// When a sensor's records with these stamps come if they come in their order, seconds: a stray stamp is that of the
/// record before.
pub(super) fn never_decreasing(stamps_s: &[f64]) -> Vec<f64> {
    let mut newest_s = None;
    let time_s = |(index, &stamp_s): (usize, &f64)| {
        let is_near = newest_s.is_some_and(|newest_s: f64| (stamp_s - newest_s).abs() <= LEAP_S);
        let next_s = stamps_s.get(index + 1).copied().unwrap_or(stamp_s);
        if stamp_s.is_finite() && (is_near || confirms(newest_s, stamp_s, next_s)) {
            newest_s = Some(newest_s.map_or(stamp_s, |newest_s| newest_s.max(stamp_s)));
        }
        newest_s.unwrap_or(f64::NEG_INFINITY)
    };
    stamps_s.iter().enumerate().map(time_s).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{Scan, ScanGeometry};
    use std::sync::Arc;

    #[test]
    fn poses_that_never_move_are_no_odometry() {
        let geometry = Arc::new(ScanGeometry {
            angles_rad: vec![0.0],
            time_offsets_s: vec![0.0],
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return: false,
        });
        let scan = |stamp_s: f64, pose: Pose2| {
            let (sensor, geometry) = (SensorId::default(), Arc::clone(&geometry));
            Record::Scan(Scan { sensor, stamp_s, ranges_m: vec![1.0], geometry, odometry: Some(pose) })
        };
        let chosen = |last: Pose2, config: &Config| {
            let zero = Pose2::IDENTITY;
            let records = [scan(0.0, zero), scan(1.0, zero), scan(2.0, last)];
            Readings::of(&records[..]).choose_source(config).unwrap()
        };
        let mut config = Config::default();
        assert_eq!(chosen(Pose2::IDENTITY, &config), OdometrySource::ScanMatching);
        assert_eq!(chosen(Pose2::new(0.0, 0.0, 0.001), &config), OdometrySource::Log);
        // Who asks for it gets it.
        config.odometry.source = OdometrySource::Log;
        assert_eq!(chosen(Pose2::IDENTITY, &config), OdometrySource::Log);
    }
}
