//! `[texture]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[texture]`: the colour map of the floor (report eqs. 23–29).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TextureConfig {
    /// Side of a cell of the floor map, metres.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub resolution_m: f64,
}

impl Default for TextureConfig {
    fn default() -> Self {
        Self { resolution_m: 0.02 }
    }
}
