//! A simulated drive: what the sensors deliver and what is true.

use super::SimulationError;
use super::camera::Eye;
use super::config::SimulationConfig;
use super::fault::{Fault, within};
use super::floor_raster::FloorRaster;
use super::inertial_unit::imu_readings;
use super::lidar::Lidar;
use super::pose_odometry::odometry_poses;
use super::ray_caster::RayCaster;
use super::trajectory::Trajectory;
use super::wheel_encoders::{WheelCounts, wheel_counts};
use super::world::World;
use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use crate::sensors::{ImuReading, Record, Records, Scan, ScanGeometry, StampedPose};
use rand::RngExt;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

/// When the first scan is taken, seconds into the drive: no two sensors tick together.
const FIRST_SCAN_S: f64 = 0.5017;
/// When the first disparity image is taken, seconds into the drive.
const FIRST_IMAGE_S: f64 = 1.0;
/// How much later than its disparity image a colour image is taken, seconds.
const COLOR_DELAY_S: f64 = 0.013;

/// A drive through a world. Scans and images are made when they are asked for: each
/// follows from its number and the seed alone, so that the longest drive fits into memory.
#[derive(Debug, Clone)]
pub struct SimulatedDrive {
    pub(super) world: World,
    pub(super) config: SimulationConfig,
    pub(super) seed: u64,
    pub(super) caster: RayCaster,
    pub(super) trajectory: Trajectory,
    /// The frame of all truth: the body's pose at the first scan, `building_from_start`.
    pub(super) start: Pose2,
    lidar: Lidar,
    scan_times_s: Vec<f64>,
    wheel_counts: Vec<WheelCounts>,
    odometry: Vec<StampedPose>,
    imu: Vec<ImuReading>,
    pub(super) disparity_times_s: Vec<f64>,
    pub(super) color_times_s: Vec<f64>,
    pub(super) depth_eye: OnceLock<Eye>,
    pub(super) color_eye: OnceLock<Eye>,
    pub(super) floor_raster: FloorRaster,
}

/// Drives the robot through the world; all errors of the sensors come from the seed.
///
/// # Errors
/// A setting that cannot be simulated.
pub fn simulate(world: World, config: SimulationConfig, seed: u64) -> Result<SimulatedDrive, SimulationError> {
    config.validate()?;
    let limit_rad = config.motion.start_heading_error_rad;
    let heading_error_rad = generator(seed, Stage::World, 0, 0).random_range(-limit_rad..=limit_rad);
    let trajectory = Trajectory::drive(&world, &config.motion, &config.faults, heading_error_rad);
    let interval_s = 1.0 / config.lidar.rate_hz;
    let scans = ((trajectory.duration_s() - FIRST_SCAN_S) / interval_s).max(0.0) as usize + 1;
    let arrives = |time_s: &f64| {
        !config.faults.iter().any(|fault| match *fault {
            Fault::LidarDropout { from_s, for_s } => within(*time_s, from_s, for_s),
            _ => false,
        })
    };
    let images = match &config.robot.camera {
        Some(_) if config.camera.rate_hz > 0.0 => {
            ((trajectory.duration_s() - FIRST_IMAGE_S) * config.camera.rate_hz).max(0.0) as usize
        }
        _ => 0,
    };
    let image_times_s = (0..images).map(|image| FIRST_IMAGE_S + image as f64 / config.camera.rate_hz);
    let mut random = generator(seed, Stage::Sensors, u64::MAX, super::SENSOR_COLOR);
    Ok(SimulatedDrive {
        disparity_times_s: image_times_s.clone().collect(),
        color_times_s: image_times_s
            .filter(|_| !random.random_bool(config.camera.missing_color_share))
            .map(|time_s| time_s + COLOR_DELAY_S)
            .collect(),
        depth_eye: OnceLock::new(),
        color_eye: OnceLock::new(),
        floor_raster: FloorRaster::new(world.bounds_m()),
        scan_times_s: (0..scans).map(|scan| FIRST_SCAN_S + scan as f64 * interval_s).filter(arrives).collect(),
        wheel_counts: wheel_counts(&config, seed, &trajectory),
        odometry: odometry_poses(&config, seed, &trajectory),
        imu: imu_readings(&config, seed, &trajectory),
        caster: world.ray_caster(),
        lidar: Lidar::new(&config),
        start: trajectory.at(FIRST_SCAN_S).pose(),
        trajectory,
        world,
        config,
        seed,
    })
}

impl SimulatedDrive {
    /// The world that was driven through.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &SimulationConfig {
        &self.config
    }

    /// The seed.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Length of the drive, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.trajectory.duration_s()
    }

    /// Number of scans.
    #[must_use]
    pub fn scan_count(&self) -> usize {
        self.scan_times_s.len()
    }

    /// When the scan of a number was truly taken, seconds since the start of the drive.
    #[must_use]
    pub fn scan_time_s(&self, index: usize) -> Option<f64> {
        self.scan_times_s.get(index).copied()
    }

    /// The body's true pose at the first scan in the world's frame: `building_from_start`.
    #[must_use]
    pub fn start(&self) -> Pose2 {
        self.start
    }

    /// What all scans have in common.
    #[must_use]
    pub fn scan_geometry(&self) -> &Arc<ScanGeometry> {
        &self.lidar.geometry
    }

    /// The scan of a number below [`scan_count`](Self::scan_count).
    #[must_use]
    pub fn scan(&self, index: usize) -> Scan {
        self.lidar.scan(self, index, self.scan_times_s[index])
    }

    /// Ticks of the four wheels.
    #[must_use]
    pub fn wheel_counts(&self) -> &[WheelCounts] {
        &self.wheel_counts
    }

    /// What the base states of its pose, `odometry_from_body`; nothing where encoders are read.
    #[must_use]
    pub fn odometry(&self) -> &[StampedPose] {
        &self.odometry
    }

    /// Readings of the inertial unit.
    #[must_use]
    pub fn imu_readings(&self) -> &[ImuReading] {
        &self.imu
    }

    /// All records in the order of their stamps, in memory.
    #[must_use]
    pub fn records(&self) -> Vec<Record> {
        let scans: Vec<Scan> = (0..self.scan_count()).into_par_iter().map(|index| self.scan(index)).collect();
        self.merge(scans.into_iter()).collect()
    }

    /// All records in the order of their stamps, each scan made when its turn comes.
    pub fn stream(&self) -> impl Iterator<Item = Record> + '_ {
        self.merge((0..self.scan_count()).map(|index| self.scan(index)))
    }

    fn merge<'a>(&'a self, scans: impl Iterator<Item = Scan> + 'a) -> impl Iterator<Item = Record> + 'a {
        let mut imu = self.imu.iter().copied().map(Record::Imu).peekable();
        let mut wheels = self.wheel_counts.iter().map(|counts| Record::Encoders(counts.reading())).peekable();
        let mut odometry = self.odometry.iter().copied().map(Record::Odometry).peekable();
        let mut scan_stamps_s = self.scan_times_s.iter().map(|&time_s| self.config.scan_stamp_s(time_s)).peekable();
        let mut scans = scans.map(Record::Scan);
        std::iter::from_fn(move || {
            // At equal stamps what moved comes before what was seen.
            let next = |stamp_s: Option<f64>| stamp_s.unwrap_or(f64::INFINITY);
            let imu_s = next(imu.peek().map(Record::stamp_s));
            let wheels_s = next(wheels.peek().map(Record::stamp_s));
            let odometry_s = next(odometry.peek().map(Record::stamp_s));
            let scan_s = next(scan_stamps_s.peek().copied());
            if wheels_s <= imu_s && wheels_s <= scan_s && wheels_s <= odometry_s {
                wheels.next()
            } else if odometry_s <= imu_s && odometry_s <= scan_s {
                odometry.next()
            } else if imu_s <= scan_s {
                imu.next()
            } else {
                scan_stamps_s.next();
                scans.next()
            }
        })
    }

    /// The body's true pose at every scan, with the scan's stamp, in the frame of the first.
    #[must_use]
    pub fn truth(&self) -> Vec<StampedPose> {
        let stamped = |&time_s: &f64| StampedPose {
            stamp_s: self.config.scan_stamp_s(time_s),
            pose: self.start.between(&self.trajectory.at(time_s).pose()),
        };
        self.scan_times_s.iter().map(stamped).collect()
    }

    /// The body's true pose at a stamp of a clock that was never set (seconds), in the frame of the first scan's pose.
    #[must_use]
    pub fn true_pose(&self, stamp_s: f64) -> Pose2 {
        self.start.between(&self.trajectory.at(stamp_s - self.config.start_stamp_s).pose())
    }
}

/// All wheel readings, then all of the inertial unit, then all stated poses, then all scans: each kind in the order of its
/// stamps, and only that order counts for [`Frames`](crate::Frames).
impl Records for SimulatedDrive {
    fn count(&self) -> usize {
        self.wheel_counts.len() + self.imu.len() + self.odometry.len() + self.scan_count()
    }

    fn record(&self, position: usize) -> Option<Cow<'_, Record>> {
        let (wheels, imu) = (self.wheel_counts.len(), self.imu.len());
        let before_scans = wheels + imu + self.odometry.len();
        let record = if position < wheels {
            Record::Encoders(self.wheel_counts[position].reading())
        } else if position < wheels + imu {
            Record::Imu(self.imu[position - wheels])
        } else if position < before_scans {
            Record::Odometry(self.odometry[position - wheels - imu])
        } else if position < self.count() {
            Record::Scan(self.scan(position - before_scans))
        } else {
            return None;
        };
        Some(Cow::Owned(record))
    }
}
