//! The configuration: small sections named like the modules that read them.
//!
//! Layers, later wins: defaults in code → the data set's calibration → preset →
//! the user's file → single settings. See [`Config::resolve`].

use crate::filter::FilterConfig;
use crate::map::MapConfig;
use crate::odometry::{OdometryConfig, ScanConfig};
use crate::scan_matcher::MatcherConfig;
use crate::sensors::RobotConfig;
use crate::texture::TextureConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything that shapes a run. The defaults are the preset `default`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Seed of every random draw. Any number is a seed; none means "random".
    pub seed: u64,
    /// Calibration of the robot.
    pub robot: RobotConfig,
    /// Dead reckoning.
    pub odometry: OdometryConfig,
    /// From raw scans to points.
    pub scan: ScanConfig,
    /// The occupancy grid.
    pub map: MapConfig,
    /// Scan matching.
    pub matcher: MatcherConfig,
    /// The particle filter.
    pub filter: FilterConfig,
    /// The floor texture.
    pub texture: TextureConfig,
}
