//! A robot's calibration: where its sensors sit and what their numbers mean.

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
    /// The RGB-D camera; absent when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
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
