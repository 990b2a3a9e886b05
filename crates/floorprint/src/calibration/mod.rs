//! Calibration from an ordinary drive, without targets: wheels, gyro, odometry, the LiDARs' mounts and the clocks.
//!
//! The scans alone show how the LiDAR moved (`scan_path.rs`); the odometry states how the body moved (`readings.rs`). Both
//! are the same motion seen from two places of one rigid body, so over every stretch of the drive
//! R(ψ)·s = d + (R(θ) − I)·m (A. Censi et al.: Simultaneous calibration of odometry and sensor parameters for mobile
//! robots, T-RO 2013), s being the LiDAR's motion, d and θ the body's, m and ψ the mount; which is solved for mount,
//! scales and lag together. How far a parameter is to be trusted is seen from how much it changes when a tenth of the
//! drive is left out (jackknife). The drive is solved again with what was found, until that stays.

mod fit;
mod parameter;
mod readings;
mod scan_path;

pub use parameter::{Parameter, Unit};

use crate::SensorId;
use crate::config::Config;
use crate::odometry::{OdometryError, OdometrySource};
use crate::sensors::{LidarConfig, Record, RobotConfig};
use crate::slam::SlamError;
use crate::survey::Survey;
use fit::{Fit, Known};
use readings::Readings;
use scan_path::ScanPath;
use thiserror::Error;

/// The drive is solved so many times at the most.
const ROUNDS: usize = 3;
/// It is not solved again when nothing changed by more than this share of its uncertainty.
const SETTLED: f64 = 0.3;
/// Fewer stretches than this tell nothing.
const LEAST_STRETCHES: usize = 12;

/// Why a drive calibrates nothing.
#[derive(Debug, Error)]
pub enum CalibrationError {
    /// No frame can be made of the records.
    #[error(transparent)]
    Odometry(#[from] OdometryError),
    /// A frame cannot be processed.
    #[error(transparent)]
    Slam(#[from] SlamError),
    /// There is nothing beside the LiDAR.
    #[error(
        "there is no odometry beside the LiDAR, or none that ever moves, and so nothing to compare it with; drive for a few minutes where walls are in view"
    )]
    NoOdometry,
    /// The robot hardly moved where the scans fit.
    #[error(
        "only {found} stretches of driving can be compared, expected {LEAST_STRETCHES} or more; drive for a few minutes where walls are in view, with turns in both directions"
    )]
    TooShort {
        /// Number of stretches.
        found: usize,
    },
}

/// What a drive tells of the robot.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Each parameter with what was found.
    pub parameters: Vec<Parameter>,
    /// The robot as it was configured, with all that the drive tells in its place.
    pub robot: RobotConfig,
    /// How many stretches of the drive were compared, by the first LiDAR.
    pub stretches: usize,
    /// What is left between scans and odometry over a stretch: standard deviations, metres and radians.
    pub residual: [f64; 2],
}

impl Calibration {
    /// Calibrates the robot of `config` by a drive.
    ///
    /// # Errors
    /// When the drive cannot be solved, has no odometry, or is too short.
    pub fn of(records: &[Record], config: &Config) -> Result<Self, CalibrationError> {
        let mut config = config.clone();
        // Lags are found here, and more closely.
        config.odometry.learn_lag = false;
        let survey = Survey::of(records, &config)?;
        let source = survey.corrections.source;
        if matches!(source, OdometrySource::ScanMatching | OdometrySource::Auto) {
            return Err(CalibrationError::NoOdometry);
        }
        let readings = Readings::of(records, survey.corrections, &config.robot);
        let before = &config.robot.clone();
        let (first, stretches, residual) = one_lidar(records, &readings, &mut config, SensorId::default())?;
        let mut parameters: Vec<Parameter> = first;
        for further in 0..before.further_lidars.len() {
            let sensor = SensorId(u8::try_from(further + 1).unwrap_or(u8::MAX));
            let mut alone = config.clone();
            // What wheels and gyro are was found with the first LiDAR; here only where this one sits is new.
            let (found, ..) = one_lidar(records, &readings, &mut alone, sensor)?;
            parameters.extend(found.into_iter().filter(Parameter::is_of_mount).map(|found| found.of_lidar(further)));
            config.robot.further_lidars[further].mount = alone.robot.lidar.mount;
        }
        for parameter in &mut parameters {
            parameter.before = parameter.in_robot(before).unwrap_or(parameter.before);
        }
        Ok(Self { parameters, robot: config.robot, stretches, residual })
    }
}

/// Calibrates one LiDAR and the odometry against each other, and puts what was found into `config`.
fn one_lidar(
    records: &[Record],
    readings: &Readings,
    config: &mut Config,
    sensor: SensorId,
) -> Result<(Vec<Parameter>, usize, [f64; 2]), CalibrationError> {
    let lidar: LidarConfig = config.robot.lidar_of(sensor).clone();
    let alone: Vec<Record> = records.iter().filter_map(|record| readings.seen_by(record, sensor)).collect();
    config.robot.lidar = lidar;
    let mut last: Option<Vec<Parameter>> = None;
    for round in 1.. {
        let mut single = config.clone();
        single.robot.further_lidars.clear();
        let path = ScanPath::of(&alone, &single)?;
        let stretches = path.stretches();
        if stretches.len() < LEAST_STRETCHES {
            return Err(CalibrationError::TooShort { found: stretches.len() });
        }
        let body = Fit::new(&path, &stretches, &readings.body, Known::of(&config.robot, readings.source)).solve();
        let mut parameters = parameter::of_body(&body, &config.robot, readings.source);
        if let Some(gyro) = &readings.gyro {
            let gyro = Fit::new(&path, &stretches, gyro, Known::of_gyro(&config.robot)).solve();
            parameters.extend(parameter::of_gyro(&gyro, &config.robot));
        }
        for parameter in parameters.iter().filter(|parameter| parameter.is_told) {
            parameter.put_into(&mut config.robot);
        }
        let settled = last.is_some_and(|last| {
            let moved = |(a, b): (&Parameter, &Parameter)| (a.found - b.found).abs() > SETTLED * b.sigma;
            !last.iter().zip(&parameters).any(moved)
        });
        if settled || round == ROUNDS {
            return Ok((parameters, stretches.len(), body.residual));
        }
        last = Some(parameters);
    }
    Err(CalibrationError::NoOdometry)
}
