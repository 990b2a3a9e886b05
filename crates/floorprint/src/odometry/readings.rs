//! What the records hold for dead reckoning, and the trajectory made of it.

use super::config::OdometrySource;
use super::dead_reckoning::DeadReckoning;
use super::differential_drive::{WheelStep, wheel_steps};
use super::encoder_clock::EncoderClock;
use super::gyro_bias::estimate_bias;
use super::gyro_heading::{GyroHeading, yaw_rates};
use super::low_pass::low_pass;
use super::summary::Dropped;
use super::synchronizer::OdometryError;
use super::track_width::effective_track_width_m;
use super::wheel_odometry::integrate;
use crate::config::Config;
use crate::sensors::{EncoderReading, ImuReading, Record, StampedPose, WheelConfig};

/// The records that tell of the body's motion, sorted by kind, each in the order of the records.
#[derive(Debug, Default)]
pub(super) struct Readings {
    encoders: Vec<EncoderReading>,
    imu: Vec<ImuReading>,
    /// `odometry_from_body`, from pose records and from scans that carry a pose.
    poses: Vec<StampedPose>,
}

impl Readings {
    /// Sorts in one more record, unless one of its numbers is not finite.
    pub(super) fn add(&mut self, record: &Record, dropped: &mut Dropped) {
        let finite = record.stamp_s().is_finite();
        match record {
            Record::Encoders(reading) => {
                if finite && reading.left_ticks.is_finite() && reading.right_ticks.is_finite() {
                    self.encoders.push(*reading);
                } else {
                    dropped.encoder_readings += 1;
                }
            }
            Record::Imu(reading) => {
                if finite && reading.angular_velocity_rad_s[2].is_finite() {
                    self.imu.push(*reading);
                } else {
                    dropped.imu_readings += 1;
                }
            }
            Record::Odometry(stamped) => {
                if finite && stamped.pose.is_finite() {
                    self.poses.push(*stamped);
                } else {
                    dropped.odometry_poses += 1;
                }
            }
            Record::Scan(scan) => {
                if let Some(pose) = scan.odometry {
                    if finite && pose.is_finite() {
                        self.poses.push(StampedPose { stamp_s: scan.stamp_s, pose });
                    } else {
                        dropped.odometry_poses += 1;
                    }
                }
            }
        }
    }

    /// The source that the configuration asks for, or with `Auto` the best that is there.
    pub(super) fn choose_source(&self, config: &Config) -> Result<OdometrySource, OdometryError> {
        let needs = |wanted, missing, there: bool| {
            if there { Ok(()) } else { Err(OdometryError::SourceMissing { wanted, missing }) }
        };
        let source = match config.odometry.source {
            OdometrySource::Auto if !self.poses.is_empty() => OdometrySource::Log,
            OdometrySource::Auto if self.encoders.is_empty() => OdometrySource::ScanMatching,
            OdometrySource::Auto if self.imu.is_empty() => OdometrySource::Wheels,
            OdometrySource::Auto => OdometrySource::WheelsAndGyro,
            chosen => chosen,
        };
        match source {
            OdometrySource::Wheels => needs("wheels", "encoder readings", !self.encoders.is_empty())?,
            OdometrySource::WheelsAndGyro => {
                needs("wheels_and_gyro", "encoder readings", !self.encoders.is_empty())?;
                needs("wheels_and_gyro", "IMU readings", !self.imu.is_empty())?;
            }
            OdometrySource::Log => needs("log", "odometry poses", !self.poses.is_empty())?,
            OdometrySource::Auto | OdometrySource::ScanMatching => {}
        }
        Ok(source)
    }

    /// The odometry trajectory from `source`, with remarks for the user.
    pub(super) fn dead_reckoning(
        self,
        source: OdometrySource,
        config: &Config,
        notes: &mut Vec<String>,
    ) -> Result<DeadReckoning, OdometryError> {
        let wheels = || config.robot.wheels.as_ref().ok_or(OdometryError::NoWheelCalibration);
        Ok(match source {
            OdometrySource::Wheels | OdometrySource::WheelsAndGyro => {
                DeadReckoning::new(self.wheel_odometry(source, wheels()?, config, notes))
            }
            OdometrySource::Log => DeadReckoning::new(self.poses),
            OdometrySource::Auto | OdometrySource::ScanMatching => {
                notes.push("no odometry: the motion is predicted from scan matching alone".to_owned());
                DeadReckoning::default()
            }
        })
    }

    fn wheel_odometry(
        &self,
        source: OdometrySource,
        wheels: &WheelConfig,
        config: &Config,
        notes: &mut Vec<String>,
    ) -> Vec<StampedPose> {
        let steps = wheel_steps(&self.encoders, &self.counting_stamps_s(config, notes), wheels);
        if self.imu.is_empty() {
            notes.push("no IMU: yaw from the wheels".to_owned());
            return integrate(&steps, &GyroHeading::default(), wheels.track_width_m).knots;
        }
        let gyro = self.gyro_heading(&steps, config, notes);
        let fitted_m = effective_track_width_m(&steps, &gyro);
        if let Some(fitted_m) = fitted_m {
            notes.push(format!(
                "the wheels' yaw fits the gyro best with a track width of {fitted_m:.3} m (robot.wheels.track_width_m is {:.3})",
                wheels.track_width_m
            ));
        }
        if source == OdometrySource::Wheels {
            return integrate(&steps, &GyroHeading::default(), wheels.track_width_m).knots;
        }
        let odometry = integrate(&steps, &gyro, fitted_m.unwrap_or(wheels.track_width_m));
        if odometry.moved_without_gyro_s > 0.0 {
            let silent_s = odometry.moved_without_gyro_s;
            notes.push(format!("the IMU is silent for {silent_s:.2} s of motion: yaw from the wheels there"));
        }
        odometry.knots
    }

    /// When each encoder reading was counted, seconds.
    fn counting_stamps_s(&self, config: &Config, notes: &mut Vec<String>) -> Vec<f64> {
        let clock = config.odometry.repair_encoder_stamps.then(|| EncoderClock::find(&self.encoders)).flatten();
        let Some(clock) = clock else { return self.encoders.iter().map(|reading| reading.stamp_s).collect() };
        let late = clock.delays_s(&self.encoders).filter(|&delay_s| delay_s > clock.period_s).count();
        if late > 0 {
            notes.push(format!(
                "{late} encoder readings were stamped late, by up to {:.0} ms: put back on the encoder's clock of {:.2} ms",
                1e3 * clock.delays_s(&self.encoders).fold(0.0, f64::max),
                1e3 * clock.period_s
            ));
        }
        clock.stamps_s
    }

    /// The gyro's heading, bias taken off and smoothed as configured.
    fn gyro_heading(&self, steps: &[WheelStep], config: &Config, notes: &mut Vec<String>) -> GyroHeading {
        let (stamps_s, mut rates) = yaw_rates(&self.imu);
        let bias = estimate_bias(config.odometry.gyro_bias, steps, &stamps_s, &rates);
        notes.extend(bias.remark(config.odometry.gyro_bias));
        for (rate, &stamp_s) in rates.iter_mut().zip(&stamps_s) {
            *rate -= bias.at(stamp_s);
        }
        if config.odometry.gyro_low_pass_hz > 0.0 {
            low_pass(&mut rates, &stamps_s, config.odometry.gyro_low_pass_hz);
        }
        GyroHeading::new(stamps_s, &rates)
    }
}
