//! The calibration of an RGB-D camera as recordings state it: two pinhole cameras.

use crate::geometry::Mount;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[robot.depth_camera]`: an RGB-D camera whose depth images are millimetres; recordings with images bring theirs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DepthCameraConfig {
    /// How much the inverse of the depth scatters from pixel to pixel, 1/m: for triangulating cameras the error of the
    /// disparity over focal length and baseline. A Kinect's unit of disparity is 0.003.
    #[serde(default = "usual_noise")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub inverse_depth_noise_per_m: f64,
    /// Nearest depth that is used, along the optical axis, metres.
    #[serde(default = "usual_nearest")]
    #[schemars(range(min = 0.0))]
    pub depth_min_m: f64,
    /// Farthest depth that is used, along the optical axis, metres.
    #[serde(default = "usual_farthest")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub depth_max_m: f64,
    /// The camera to which depth images belong; the colour camera itself where they are registered to it.
    pub depth: PinholeConfig,
    /// The camera to which colour images belong.
    pub color: PinholeConfig,
}

/// A pinhole camera: mount, intrinsics and distortion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PinholeConfig {
    /// Where it sits, above the floor; its x axis looks ahead (not its optical axis convention).
    pub mount: Mount,
    /// Columns of its images.
    #[schemars(range(min = 1))]
    pub columns_px: u32,
    /// Rows of its images.
    #[schemars(range(min = 1))]
    pub rows_px: u32,
    /// Focal length along columns, pixels.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub focal_columns_px: f64,
    /// Focal length along rows, pixels.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub focal_rows_px: f64,
    /// Column of the principal point, pixels.
    pub center_column_px: f64,
    /// Row of the principal point, pixels.
    pub center_row_px: f64,
    /// Distortion of the lens: k1, k2, p1, p2, k3 (`plumb_bob`) and k4, k5, k6 (`rational_polynomial`); what is left out is 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub distortion: Vec<f64>,
}

impl DepthCameraConfig {
    /// Two cameras with what is usual of depth images.
    #[must_use]
    pub fn new(depth: PinholeConfig, color: PinholeConfig) -> Self {
        Self {
            inverse_depth_noise_per_m: usual_noise(),
            depth_min_m: usual_nearest(),
            depth_max_m: usual_farthest(),
            depth,
            color,
        }
    }
}

fn usual_noise() -> f64 {
    0.003
}

/// Structured light and stereo cameras see nothing nearer.
fn usual_nearest() -> f64 {
    0.3
}

fn usual_farthest() -> f64 {
    10.0
}
