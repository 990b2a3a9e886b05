//! `[texture]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[texture]`: the colour map of the floor (report eqs. 23–29).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TextureConfig {
    /// Side of a cell of the floor map, metres.
    #[schemars(range(min = 0.005, max = 1.0))]
    pub resolution_m: f64,
    /// How several images of one cell become one colour.
    pub blend: Blend,
    /// How much sharper views are preferred: the weight of a view is (1 + (l/r)²) to minus this
    /// power, l the length that its pixel covers on the floor, r the side of a cell. 0 weighs all alike.
    #[schemars(range(min = 0.0, max = 20.0))]
    pub sharpness: f64,
    /// Floor farther from the camera than this is not painted, metres along the optical axis.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub distance_max_m: f64,
    /// A depth pixel belongs to the floor when it lies within this height of the fitted plane, metres.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub plane_tolerance_m: f64,
    /// The fitted floor may be tilted against the stated camera mount by at most this, radians.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub tilt_max_rad: f64,
    /// The fitted floor may lie above or below the stated one by at most this, metres.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub height_error_max_m: f64,
    /// Time constant over which the floor planes of neighbouring images are averaged, seconds.
    #[schemars(range(min = 0.0))]
    pub tilt_smoothing_s: f64,
    /// A disparity and a colour image form a pair when their stamps differ by at most this, seconds.
    #[schemars(range(min = 0.0))]
    pub pairing_gap_max_s: f64,
    /// An image is used when the body has moved by at least this since the last one that was, metres, or
    /// has turned by `image_spacing_rad`. 0 uses every image.
    #[schemars(range(min = 0.0))]
    pub image_spacing_m: f64,
    /// The same for turns, radians. 0 uses every image.
    #[schemars(range(min = 0.0))]
    pub image_spacing_rad: f64,
    /// Whether brightness and tint of the images are balanced where they show the same floor.
    pub exposure_compensation: bool,
}

impl Default for TextureConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.02,
            blend: Blend::Mean,
            sharpness: 4.0,
            distance_max_m: 4.0,
            plane_tolerance_m: 0.008,
            tilt_max_rad: 0.07,
            height_error_max_m: 0.06,
            tilt_smoothing_s: 5.0,
            pairing_gap_max_s: 0.1,
            image_spacing_m: 0.1,
            image_spacing_rad: 0.1,
            exposure_compensation: true,
        }
    }
}

/// How several images of one cell become one colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// The weighted mean.
    #[default]
    Mean,
    /// The weighted median of each channel: what was there only once (a passer-by) disappears.
    Median,
    /// The newest image that sees the cell sharply.
    Newest,
}
