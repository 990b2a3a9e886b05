//! What is simulated besides the world: the robot, its sensors' errors and faults.

use super::SimulationError;
use super::fault::{Fault, clock_error_s};
use crate::geometry::Pose2;
use crate::sensors::RobotConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A simulation's settings. The defaults are the course's robot with errors of the size that its sensors show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationConfig {
    /// The robot's calibration, as the robot believes it to be.
    pub robot: RobotConfig,
    /// Time of the first moment, seconds.
    pub start_stamp_s: f64,
    /// How the robot drives.
    pub motion: MotionConfig,
    /// The planar LiDAR.
    pub lidar: LidarSimulationConfig,
    /// The wheels and their encoders.
    pub wheels: WheelSimulationConfig,
    /// The inertial unit.
    pub imu: ImuSimulationConfig,
    /// The RGB-D camera.
    pub camera: CameraSimulationConfig,
    /// A base that states its own pose, in place of wheels and inertial unit; absent where encoders are read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose_odometry: Option<PoseOdometryConfig>,
    /// What goes wrong, and when.
    pub faults: Vec<Fault>,
}

impl Default for SimulationConfig {
    fn default() -> Self {
        Self {
            robot: RobotConfig::ece276a(),
            start_stamp_s: 1_300_000_000.0,
            motion: MotionConfig::default(),
            lidar: LidarSimulationConfig::default(),
            wheels: WheelSimulationConfig::default(),
            imu: ImuSimulationConfig::default(),
            camera: CameraSimulationConfig::default(),
            pose_odometry: None,
            faults: Vec::new(),
        }
    }
}

/// How the robot drives along its route.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// Speed on straight stretches, m/s.
    pub speed_m_s: f64,
    /// Speeding up and slowing down, m/s².
    pub acceleration_m_s2: f64,
    /// Largest yaw rate, rad/s.
    pub turn_rate_rad_s: f64,
    /// Largest change of the yaw rate, rad/s².
    pub turn_acceleration_rad_s2: f64,
    /// Standstill before the drive, from which the gyro's bias can be found, seconds.
    pub standstill_s: f64,
    /// How far the robot starts off its route's direction, at most, radians either way.
    pub start_heading_error_rad: f64,
    /// How far an omnidirectional robot looks to either side of where it drives, radians; 0 for all others.
    pub look_aside_rad: f64,
    /// How long it takes to look to either side and back, seconds.
    pub look_aside_period_s: f64,
    /// When the robot stands still on its way, and for how long: seconds since the start, seconds.
    pub pauses_s: Vec<[f64; 2]>,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self {
            speed_m_s: 1.0,
            acceleration_m_s2: 0.6,
            turn_rate_rad_s: 1.2,
            turn_acceleration_rad_s2: 2.5,
            standstill_s: 5.0,
            start_heading_error_rad: 0.1,
            look_aside_rad: 0.0,
            look_aside_period_s: 20.0,
            pauses_s: Vec::new(),
        }
    }
}

/// The planar LiDAR.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LidarSimulationConfig {
    /// Rays of a scan.
    pub beams: usize,
    /// Angle from the first ray to the last, radians; half of it on either side of straight ahead.
    pub field_of_view_rad: f64,
    /// Scans a second.
    pub rate_hz: f64,
    /// Nearest range that is measured, metres.
    pub range_min_m: f64,
    /// Farthest range that is measured, metres.
    pub range_max_m: f64,
    /// Standard deviation of a range below 10 m, metres.
    pub near_noise_m: f64,
    /// Standard deviation of a range from 10 m on, metres.
    pub far_noise_m: f64,
    /// Share of rays that end early on something that is not there (dust, mixed pixels).
    pub short_share: f64,
    /// Share of rays from which nothing comes back.
    pub dropout_share: f64,
    /// What is added to every range, metres: the sensor's systematic error.
    pub range_bias_m: f64,
    /// Standard deviation that grows with the range, as a share of it (triangulating sensors).
    pub noise_share: f64,
    /// How many times the noise grows as the light that comes back fades: far, grazing or dark surfaces.
    pub weak_return_noise: f64,
    /// Share of the rays that graze an edge of something near and end between it and what stands behind.
    pub mixed_pixel_share: f64,
    /// Share of rays that sunlight drowns at the farthest range; at half of it a quarter.
    pub sunlight_share: f64,
    /// By how much the stamps of scans are late, seconds; negative when they are early.
    pub stamp_delay_s: f64,
}

impl Default for LidarSimulationConfig {
    fn default() -> Self {
        Self {
            beams: 1081,
            field_of_view_rad: 1.5 * std::f64::consts::PI,
            rate_hz: 40.0,
            range_min_m: 0.1,
            range_max_m: 30.0,
            near_noise_m: 0.01,
            far_noise_m: 0.03,
            short_share: 0.01,
            dropout_share: 0.003,
            range_bias_m: 0.0,
            noise_share: 0.0,
            weak_return_noise: 0.0,
            mixed_pixel_share: 0.0,
            sunlight_share: 0.0,
            stamp_delay_s: 0.0,
        }
    }
}

/// The wheels and their encoders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WheelSimulationConfig {
    /// Readings a second.
    pub rate_hz: f64,
    /// Standard deviation of each side's scale error, as a share of the distance (wheel radius, tyre pressure).
    pub scale_error: f64,
    /// Standard deviation of a reading's slip, as a share of the distance within it.
    pub slip_noise: f64,
    /// By how much the wheels turn too far in a bend, as a share: the track is wider than the robot believes.
    pub track_error: f64,
}

impl Default for WheelSimulationConfig {
    fn default() -> Self {
        Self { rate_hz: 40.0, scale_error: 0.004, slip_noise: 0.03, track_error: 0.0 }
    }
}

/// A base that states its own pose: a differential drive with its own gyro, or an omnidirectional one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseOdometryConfig {
    /// Poses a second.
    pub rate_hz: f64,
    /// By which share it overstates every length.
    pub length_error: f64,
    /// By which share it overstates every turn.
    pub turn_error: f64,
    /// How far it believes to turn while driving straight on, radians a metre.
    pub drift_rad_per_m: f64,
    /// Standard deviation of a pose's slip, as a share of the way and of the turn since the last.
    pub slip_noise: f64,
}

impl Default for PoseOdometryConfig {
    fn default() -> Self {
        Self { rate_hz: 20.0, length_error: 0.01, turn_error: 0.01, drift_rad_per_m: 0.002, slip_noise: 0.05 }
    }
}

/// The inertial unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImuSimulationConfig {
    /// Whether the robot has one.
    pub is_there: bool,
    /// Readings a second.
    pub rate_hz: f64,
    /// Standard deviation of a reading of the angular velocity, rad/s.
    pub gyro_noise_rad_s: f64,
    /// Standard deviation of the gyro's constant bias, rad/s.
    pub gyro_bias_rad_s: f64,
    /// How fast the bias wanders: standard deviation of its change over one second, rad/s.
    pub gyro_drift_rad_s: f64,
    /// Standard deviation of a reading of the acceleration, m/s².
    pub acceleration_noise_m_s2: f64,
}

impl Default for ImuSimulationConfig {
    fn default() -> Self {
        Self {
            is_there: true,
            rate_hz: 100.0,
            gyro_noise_rad_s: 0.004,
            gyro_bias_rad_s: 0.008,
            gyro_drift_rad_s: 5e-5,
            acceleration_noise_m_s2: 0.05,
        }
    }
}

/// The RGB-D camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSimulationConfig {
    /// Disparity images a second, and as many colour images a little later each; 0 for no camera.
    pub rate_hz: f64,
    /// Standard deviation of a disparity, raw units, before it is rounded.
    pub disparity_noise: f64,
    /// Share of colour images that are missing.
    pub missing_color_share: f64,
    /// Standard deviation of an image's exposure, as a share of its brightness.
    pub exposure_variation: f64,
    /// How much darker an image's corners are than its centre, as a share.
    pub vignetting: f64,
    /// Standard deviation of a pixel's noise, of 255.
    pub color_noise: f64,
}

impl Default for CameraSimulationConfig {
    fn default() -> Self {
        Self {
            rate_hz: 2.0,
            disparity_noise: 0.35,
            missing_color_share: 0.05,
            exposure_variation: 0.0,
            vignetting: 0.0,
            color_noise: 2.0,
        }
    }
}

impl SimulationConfig {
    /// The same robot with a LiDAR as the public logs around the year 2000 have it: 180 rays one degree
    /// apart, 80 m of range, five scans a second; no camera.
    #[must_use]
    pub fn with_sparse_lidar(mut self) -> Self {
        self.lidar = LidarSimulationConfig {
            beams: 180,
            field_of_view_rad: 179.0_f64.to_radians(),
            rate_hz: 5.0,
            range_max_m: 80.0,
            far_noise_m: 0.02,
            ..self.lidar
        };
        self.camera.rate_hz = 0.0;
        self
    }

    /// The same robot with its LiDAR elsewhere: `body_from_lidar`, its height and tilt as they are.
    #[must_use]
    pub fn with_lidar_at(mut self, body_from_lidar: Pose2) -> Self {
        let mount = &mut self.robot.lidar.mount;
        (mount.x_m, mount.y_m, mount.yaw_rad) = (body_from_lidar.x, body_from_lidar.y, body_from_lidar.theta);
        self
    }

    /// The same robot without any error: every number follows from the truth, up to encoder ticks and pixels.
    #[must_use]
    pub fn without_noise(mut self) -> Self {
        let lidar = &mut self.lidar;
        (lidar.near_noise_m, lidar.far_noise_m, lidar.short_share, lidar.dropout_share) = (0.0, 0.0, 0.0, 0.0);
        (lidar.range_bias_m, lidar.noise_share, lidar.mixed_pixel_share, lidar.sunlight_share) = (0.0, 0.0, 0.0, 0.0);
        lidar.stamp_delay_s = 0.0;
        (self.wheels.scale_error, self.wheels.slip_noise, self.wheels.track_error) = (0.0, 0.0, 0.0);
        if let Some(odometry) = &mut self.pose_odometry {
            (odometry.length_error, odometry.turn_error) = (0.0, 0.0);
            (odometry.drift_rad_per_m, odometry.slip_noise) = (0.0, 0.0);
        }
        let imu = &mut self.imu;
        (imu.gyro_noise_rad_s, imu.gyro_bias_rad_s, imu.gyro_drift_rad_s) = (0.0, 0.0, 0.0);
        imu.acceleration_noise_m_s2 = 0.0;
        let camera = &mut self.camera;
        (camera.disparity_noise, camera.missing_color_share) = (0.0, 0.0);
        (camera.exposure_variation, camera.vignetting, camera.color_noise) = (0.0, 0.0, 0.0);
        self
    }

    /// What the clock shows of an odometry's or inertial unit's reading, seconds, at a time since the start of the drive.
    pub(super) fn stamp_s(&self, time_s: f64) -> f64 {
        self.start_stamp_s + time_s + clock_error_s(&self.faults, time_s, false)
    }

    /// The same of a scan.
    pub(super) fn scan_stamp_s(&self, time_s: f64) -> f64 {
        self.start_stamp_s + time_s + (self.lidar.stamp_delay_s + clock_error_s(&self.faults, time_s, true))
    }

    /// Checks that every value can be simulated.
    ///
    /// # Errors
    /// The first setting that is out of its bounds.
    pub fn validate(&self) -> Result<(), SimulationError> {
        let positive = [
            ("motion.speed_m_s", self.motion.speed_m_s),
            ("motion.acceleration_m_s2", self.motion.acceleration_m_s2),
            ("motion.turn_rate_rad_s", self.motion.turn_rate_rad_s),
            ("motion.turn_acceleration_rad_s2", self.motion.turn_acceleration_rad_s2),
            ("lidar.rate_hz", self.lidar.rate_hz),
            ("lidar.field_of_view_rad", self.lidar.field_of_view_rad),
            ("lidar.range_max_m", self.lidar.range_max_m),
            ("wheels.rate_hz", self.wheels.rate_hz),
            ("imu.rate_hz", self.imu.rate_hz),
            ("motion.look_aside_period_s", self.motion.look_aside_period_s),
            ("pose_odometry.rate_hz", self.pose_odometry.as_ref().map_or(1.0, |odometry| odometry.rate_hz)),
        ];
        let not_negative = [
            ("motion.standstill_s", self.motion.standstill_s),
            ("motion.start_heading_error_rad", self.motion.start_heading_error_rad),
            ("lidar.range_min_m", self.lidar.range_min_m),
            ("lidar.near_noise_m", self.lidar.near_noise_m),
            ("lidar.far_noise_m", self.lidar.far_noise_m),
            ("lidar.noise_share", self.lidar.noise_share),
            ("lidar.weak_return_noise", self.lidar.weak_return_noise),
            ("motion.look_aside_rad", self.motion.look_aside_rad),
            ("wheels.scale_error", self.wheels.scale_error),
            ("wheels.slip_noise", self.wheels.slip_noise),
            ("imu.gyro_noise_rad_s", self.imu.gyro_noise_rad_s),
            ("imu.gyro_bias_rad_s", self.imu.gyro_bias_rad_s),
            ("imu.gyro_drift_rad_s", self.imu.gyro_drift_rad_s),
            ("imu.acceleration_noise_m_s2", self.imu.acceleration_noise_m_s2),
            ("camera.rate_hz", self.camera.rate_hz),
            ("camera.disparity_noise", self.camera.disparity_noise),
            ("camera.exposure_variation", self.camera.exposure_variation),
            ("camera.color_noise", self.camera.color_noise),
        ];
        let shares = [
            ("lidar.short_share", self.lidar.short_share),
            ("lidar.dropout_share", self.lidar.dropout_share),
            ("lidar.mixed_pixel_share", self.lidar.mixed_pixel_share),
            ("lidar.sunlight_share", self.lidar.sunlight_share),
            ("camera.missing_color_share", self.camera.missing_color_share),
            ("camera.vignetting", self.camera.vignetting),
        ];
        let refuse = |key: &'static str, found: f64, expected: &'static str| {
            Err(SimulationError::InvalidSetting { key, found, expected })
        };
        for (key, found) in positive {
            if !(found > 0.0 && found.is_finite()) {
                return refuse(key, found, "a number above 0");
            }
        }
        for (key, found) in not_negative {
            if !(found >= 0.0 && found.is_finite()) {
                return refuse(key, found, "0 or a number above");
            }
        }
        for (key, found) in shares {
            if !(0.0..=1.0).contains(&found) {
                return refuse(key, found, "a share from 0 to 1");
            }
        }
        if self.lidar.beams < 2 {
            return refuse("lidar.beams", self.lidar.beams as f64, "at least 2");
        }
        if let Some((key, found, expected)) = self.faults.iter().find_map(Fault::impossible_setting) {
            return refuse(key, found, expected);
        }
        let odometry = self.pose_odometry.clone().unwrap_or_default();
        let finite = [
            ("lidar.range_bias_m", self.lidar.range_bias_m),
            ("lidar.stamp_delay_s", self.lidar.stamp_delay_s),
            ("wheels.track_error", self.wheels.track_error),
            ("pose_odometry.length_error", odometry.length_error),
            ("pose_odometry.turn_error", odometry.turn_error),
            ("pose_odometry.drift_rad_per_m", odometry.drift_rad_per_m),
            ("pose_odometry.slip_noise", odometry.slip_noise),
        ];
        for (key, found) in finite {
            if !(-100.0..=100.0).contains(&found) {
                return refuse(key, found, "a number from -100 to 100");
            }
        }
        for pause_s in &self.motion.pauses_s {
            if !pause_s.iter().all(|seconds| (0.0..=1e6).contains(seconds)) {
                return refuse("motion.pauses_s", pause_s[0].max(pause_s[1]), "seconds from 0 to a million");
            }
        }
        if !self.start_stamp_s.is_finite() {
            return refuse("start_stamp_s", self.start_stamp_s, "a number of seconds");
        }
        Ok(())
    }
}
