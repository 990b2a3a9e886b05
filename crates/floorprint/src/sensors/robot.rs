//! A robot's calibration: where its sensors sit and what their numbers mean.

use super::DepthCameraConfig;
use crate::geometry::Mount;
use crate::ids::SensorId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[robot]`: the calibration. Data sets bring theirs; every value can be overridden.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RobotConfig {
    /// Name of the calibration, for reports.
    pub name: String,
    /// The planar LiDAR.
    pub lidar: LidarConfig,
    /// Further planar LiDARs, each with a mount and timing of its own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub further_lidars: Vec<LidarConfig>,
    /// The wheels; absent when the data hold no encoder counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheels: Option<WheelConfig>,
    /// The Kinect of the course, whose depth images are disparities; absent when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
    /// Any other RGB-D camera; absent when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_camera: Option<DepthCameraConfig>,
    /// What the numbers of gyro and odometry are multiplied by.
    pub scale: ScaleConfig,
    /// How late sensors' stamps are.
    pub lag: LagConfig,
}

impl RobotConfig {
    /// The calibration of a LiDAR; that of the first where the number names none.
    #[must_use]
    pub fn lidar_of(&self, sensor: SensorId) -> &LidarConfig {
        let further = usize::from(sensor.0).checked_sub(1);
        further.and_then(|position| self.further_lidars.get(position)).unwrap_or(&self.lidar)
    }
}

/// `[robot.lidar]`: mount and timing of the planar LiDAR.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LidarConfig {
    /// Where the LiDAR sits.
    pub mount: Mount,
    /// Time from the first ray of a scan to its last, seconds; 0 when unknown.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sweep_duration_s: f64,
    /// Which moment of the sweep a scan's stamp names.
    pub stamp_at: StampAt,
}

/// Which moment of a scan its stamp names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StampAt {
    /// The first ray.
    Start,
    /// Half way between the first and the last ray.
    #[default]
    Middle,
    /// The last ray.
    End,
}

/// `[robot.wheels]`: geometry of a differential or skid-steered drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelConfig {
    /// Metres of floor per tick on the left.
    pub left_m_per_tick: f64,
    /// Metres of floor per tick on the right.
    pub right_m_per_tick: f64,
    /// Distance between the wheels' contact lines that makes the wheels' yaw right, metres.
    /// For a skid-steered robot this is larger than the mechanical track.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub track_width_m: f64,
}

/// `[robot.scale]`: what readings are multiplied by to be right.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScaleConfig {
    /// The gyro's yaw rate, its bias taken off.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 10.0))]
    pub gyro: f64,
    /// Distances between the poses that the robot's own odometry states.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 10.0))]
    pub odometry_distance: f64,
    /// Turns between these poses.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 10.0))]
    pub odometry_turn: f64,
}

impl Default for ScaleConfig {
    fn default() -> Self {
        Self { gyro: 1.0, odometry_distance: 1.0, odometry_turn: 1.0 }
    }
}

/// `[robot.lag]`: how late the stamps of sensors are beside the LiDAR's, seconds; negative when they are early.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LagConfig {
    /// Of the wheels' encoders.
    #[schemars(range(min = -2.0, max = 2.0))]
    pub encoders_s: f64,
    /// Of the inertial unit.
    #[schemars(range(min = -2.0, max = 2.0))]
    pub imu_s: f64,
    /// Of the robot's own odometry.
    #[schemars(range(min = -2.0, max = 2.0))]
    pub odometry_s: f64,
}

impl LagConfig {
    /// The largest lag either way, seconds.
    pub(crate) fn largest_s(&self) -> f64 {
        self.encoders_s.abs().max(self.imu_s.abs()).max(self.odometry_s.abs())
    }
}

/// `[robot.camera]`: mount, intrinsics and disparity model of an RGB-D camera (report eqs. 23–28).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Where the depth camera sits; its x axis looks ahead (not its optical axis convention).
    pub mount: Mount,
    /// Focal length of the depth camera, pixels.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub depth_focal_px: f64,
    /// Column of the depth camera's principal point, pixels.
    pub depth_center_column_px: f64,
    /// Row of the depth camera's principal point, pixels.
    pub depth_center_row_px: f64,
    /// `dd = disparity_scale · d + disparity_offset` (eq. 23).
    pub disparity_scale: f64,
    /// See `disparity_scale`.
    pub disparity_offset: f64,
    /// `depth = depth_numerator / dd`, metres (eq. 24).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub depth_numerator_m: f64,
    /// The colour pixel of a depth pixel (eqs. 25–26): column = (`color_focal`·u + `color_baseline`·dd + `color_column_offset`) / `color_divisor`.
    pub color_focal: f64,
    /// See `color_focal`; −4.5 · 1750.46 in the report.
    pub color_baseline: f64,
    /// See `color_focal`; 19276 in the report.
    pub color_column_offset: f64,
    /// row = (`color_focal`·v + `color_row_offset`) / `color_divisor`; 16662 in the report.
    pub color_row_offset: f64,
    /// See `color_focal`; 585.051 in the report.
    pub color_divisor: f64,
    /// Depths outside these limits are not used, metres: nearest.
    #[schemars(range(min = 0.0))]
    pub depth_min_m: f64,
    /// Farthest depth that is used, metres.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub depth_max_m: f64,
}
