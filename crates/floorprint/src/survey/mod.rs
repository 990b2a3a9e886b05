//! A look through a whole recording before it is solved: what only the future tells, as plain numbers and findings.
//!
//! One finding a file. The same [`Synchronizer`](crate::odometry::Synchronizer) runs with and without a survey: its
//! corrections take the place of what the synchroniser would learn on the way.

mod encoder_clock;
mod gyro_bias;
mod lag;
mod no_return;
mod readings;
mod scan_pair;
mod silence;
mod track_width;

pub use no_return::no_return_mark_m;
pub(crate) use readings::Readings;
pub(crate) use scan_pair::motion_between;
pub use silence::silences;

use crate::SensorId;
use crate::config::Config;
use crate::odometry::differential_drive::WheelStep;
use crate::odometry::gyro::YawRate;
use crate::odometry::{Finding, OdometryCorrections, OdometryError, OdometrySource, median, validate};
use crate::sensors::{Records, Stream, WheelConfig};

/// What a recording shows when it is looked at as a whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// What the synchroniser is told.
    pub corrections: OdometryCorrections,
    /// What the user should know.
    pub findings: Vec<Finding>,
}

impl Survey {
    /// Looks through the records; each is asked for once.
    ///
    /// # Errors
    /// When there is no usable scan, when the odometry asked for cannot be made from these records, or when a setting
    /// of `[scan]`, `[odometry]` or `[robot]` cannot work.
    pub fn of<R: Records + ?Sized>(records: &R, config: &Config) -> Result<Self, OdometryError> {
        let readings = Readings::of(records);
        readings.check_scans()?;
        Self::of_readings(records, &readings, config)
    }

    /// The same of readings that are sorted already, among which there need be no scan.
    pub(crate) fn of_readings<R: Records + ?Sized>(
        records: &R,
        readings: &Readings,
        config: &Config,
    ) -> Result<Self, OdometryError> {
        validate(config)?;
        let source = readings.choose_source(config)?;
        let mut survey = Self {
            corrections: OdometryCorrections {
                source,
                delay_s: config.odometry.delay_s,
                encoder_clock: None,
                gyro_bias: Default::default(),
                track_width_m: None,
                lag: config.robot.lag,
            },
            findings: silence::findings(readings),
        };
        if source != OdometrySource::Log && readings.has_poses_that_stand() {
            survey.findings.push(Finding::StandingOdometry);
        }
        if config.odometry.learn_lag {
            survey.look_at_clocks(records, readings, config);
        }
        match (source, &config.robot.wheels) {
            (OdometrySource::Wheels | OdometrySource::WheelsAndGyro, Some(wheels)) => {
                survey.look_at_wheels(readings, wheels, config);
            }
            (OdometrySource::Wheels | OdometrySource::WheelsAndGyro, None) => {
                return Err(OdometryError::NoWheelCalibration);
            }
            (OdometrySource::Log, _) => {
                survey.wait_for(0.0, readings.stated.iter().map(|(stamp_s, _)| *stamp_s));
            }
            (OdometrySource::Auto | OdometrySource::ScanMatching, _) => survey.findings.push(Finding::NoOdometry),
        }
        Ok(survey)
    }

    /// Learns the lags that are not configured.
    fn look_at_clocks<R: Records + ?Sized>(&mut self, records: &R, readings: &Readings, config: &Config) {
        let corrections = &mut self.corrections;
        let streams: &[Stream] = match corrections.source {
            OdometrySource::Log => &[Stream::Odometry],
            OdometrySource::Wheels => &[Stream::Encoders],
            // Wheels slip when a turn begins; where a gyro tells the turn, theirs is no matter.
            OdometrySource::WheelsAndGyro => &[Stream::Imu],
            OdometrySource::Auto | OdometrySource::ScanMatching => &[],
        };
        let scans = readings.times_s((Stream::Scans, SensorId::default()));
        for &stream in streams {
            let lag_s = match stream {
                Stream::Encoders => &mut corrections.lag.encoders_s,
                Stream::Imu => &mut corrections.lag.imu_s,
                Stream::Odometry | Stream::Scans => &mut corrections.lag.odometry_s,
            };
            if *lag_s != 0.0 {
                continue;
            }
            if let Some(found_s) = lag::find(records, &scans, &readings.turns(stream, config), config) {
                *lag_s = found_s;
                self.findings.push(Finding::Lag { sensor: stream, late_s: found_s });
            }
        }
    }

    fn look_at_wheels(&mut self, readings: &Readings, wheels: &WheelConfig, config: &Config) {
        let clock = config.odometry.repair_encoder_stamps.then(|| encoder_clock::find(&readings.encoders)).flatten();
        let mut counted_s: Vec<f64> = match &clock {
            Some(clock) => clock.counted_s.clone(),
            None => readings.encoders.iter().map(|reading| reading.stamp_s).collect(),
        };
        self.wait_for(clock.as_ref().map_or(0.0, |clock| clock.longest_s), counted_s.iter().copied());
        let (scale, lag) = (&config.robot.scale, self.corrections.lag);
        counted_s.iter_mut().for_each(|counted_s| *counted_s -= lag.encoders_s);
        let steps = steps(readings, &counted_s, wheels);
        if let Some(clock) = clock {
            self.findings.extend(clock.finding);
            self.corrections.encoder_clock = Some(clock.correction);
        }
        if readings.yaw_rates.is_empty() {
            self.findings.push(Finding::NoImu);
            return;
        }
        let yaw_rates: Vec<YawRate> = readings
            .yaw_rates
            .iter()
            .map(|rate| YawRate { stamp_s: rate.stamp_s - lag.imu_s, rate_rad_s: scale.gyro * rate.rate_rad_s })
            .collect();
        let (bias, finding) = gyro_bias::find(config.odometry.gyro_bias, &steps, &yaw_rates);
        self.findings.extend(finding);
        let fitted_m = track_width::find(&steps, &yaw_rates, &bias);
        let stated_m = wheels.track_width_m;
        self.findings.extend(fitted_m.map(|fitted_m| Finding::TrackWidth { fitted_m, stated_m }));
        self.corrections.gyro_bias = bias;
        self.corrections.track_width_m = fitted_m;
    }

    /// Lets scans wait for odometry that comes late and seldom; where there is no hurry nothing need be missed.
    fn wait_for(&mut self, longest_delay_s: f64, stamps_s: impl Iterator<Item = f64> + Clone) {
        let mut intervals_s: Vec<f64> =
            stamps_s.clone().skip(1).zip(stamps_s).map(|(later_s, earlier_s)| later_s - earlier_s).collect();
        let usual_s = median(&mut intervals_s).unwrap_or(0.0).max(0.0);
        self.corrections.delay_s = self.corrections.delay_s.max(longest_delay_s + 3.0 * usual_s);
    }
}

/// The steps of all readings, counted at the given times (seconds).
fn steps(readings: &Readings, counted_s: &[f64], wheels: &WheelConfig) -> Vec<WheelStep> {
    let Some(&first_s) = counted_s.first() else { return Vec::new() };
    let mut until_s = first_s - counted_s.get(1).map_or(0.0, |second_s| second_s - first_s).max(0.0);
    let step = |(reading, &counted_s)| {
        let step = WheelStep::new(reading, until_s, counted_s, wheels);
        until_s = step.to_s;
        step
    };
    readings.encoders.iter().zip(counted_s).map(step).collect()
}
