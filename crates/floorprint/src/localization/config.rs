//! `[localization]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[localization]`: finding and keeping the pose in a finished map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LocalizationConfig {
    /// A pose is claimed once it is this probable against all others and against one that nothing proposed.
    #[schemars(range(min = 0.5, max = 1.0))]
    pub claim_probability: f64,
    /// Least share of the rays that end where the map shows something, of a pose that is claimed after a search: in a map
    /// that explains less than four fifths of what is seen another place may do so as well.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub claim_on_map: f64,
    /// … or, where half of that is on the map, this share of the rays that do not end on small things in front: people.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub claim_in_view: f64,
    /// Once it is more probable than this that the robot is lost, its pose is no longer claimed.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lost_probability: f64,
    /// Largest number of particles of all hypotheses together; how many are used follows from how uncertain the pose is.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub particles: usize,
    /// Points of the newest scans that are searched for in the whole map.
    #[schemars(range(min = 16, max = 1000))]
    pub search_points: usize,
    /// Places that score less than the best by more than this are not proposed; 1 is a perfect fit.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub search_margin: f64,
    /// Largest number of places that a search proposes.
    #[schemars(range(min = 1, max = 10000))]
    pub search_most: usize,
    /// Blocks of poses that a search looks at, at most: what bounds its work.
    #[schemars(range(min = 1))]
    pub search_blocks: usize,
    /// Blocks of poses that are looked at with each scan: what bounds the work of a step.
    #[schemars(range(min = 1))]
    pub search_blocks_per_scan: usize,
    /// Standard deviation of a start that is given, metres …
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub start_sigma_m: f64,
    /// … and radians.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub start_sigma_rad: f64,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            claim_probability: 0.9995,
            claim_on_map: 0.8,
            claim_in_view: 0.9,
            lost_probability: 0.5,
            particles: 100_000,
            search_points: 64,
            search_margin: 0.25,
            search_most: 64,
            search_blocks: 160_000,
            search_blocks_per_scan: 8_000,
            start_sigma_m: 0.2,
            start_sigma_rad: 0.1,
        }
    }
}
