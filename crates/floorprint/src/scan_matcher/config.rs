//! `[matcher]`.

use crate::surface::Thinning;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[matcher]`: scan matching.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MatcherConfig {
    /// Side of a cell of the map that is matched against, metres.
    #[schemars(range(min = 0.005, max = 0.5))]
    pub cell_m: f64,
    /// Points of a scan are thinned to this distance along surfaces, metres.
    #[schemars(range(min = 0.0))]
    pub point_spacing_m: f64,
    /// Points of a scan are thinned further where there would be many more than this.
    #[schemars(range(min = 20))]
    pub max_points: usize,
    /// Largest number of Gauss–Newton steps.
    #[schemars(range(min = 1, max = 1000))]
    pub iterations: usize,
    /// Steps smaller than this end the search, metres.
    #[schemars(range(min = 0.0))]
    pub stop_step_m: f64,
    /// Steps smaller than this end the search, radians.
    #[schemars(range(min = 0.0))]
    pub stop_step_rad: f64,
    /// Standard deviation of a point's distance from a flat surface, metres.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub sigma_m: f64,
    /// Standard deviation of a point's distance from a surface without direction, metres.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub rough_sigma_m: f64,
    /// Scale of the robust weights during the approach, standard deviations.
    #[schemars(range(min = 0.5, max = 100.0))]
    pub wide_gate_sigmas: f64,
    /// Scale of the robust weights once the scan lies about right, standard deviations.
    #[schemars(range(min = 0.5, max = 100.0))]
    pub gate_sigmas: f64,
    /// Points beyond this number no longer add certainty: their errors are not independent.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub independent_points: f64,
    /// A scan is written into the map after the robot moved by this much, metres …
    #[schemars(range(min = 0.0))]
    pub insert_distance_m: f64,
    /// … or turned by this much, radians.
    #[schemars(range(min = 0.0))]
    pub insert_angle_rad: f64,
    /// Where fewer than this share of a scan's points lie on the map, the odometry is not
    /// believed and the neighbourhood is searched.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub search_below_inlier_share: f64,
    /// Largest offset of that search in x and in y, metres.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub search_distance_m: f64,
    /// Largest offset of that search in heading, radians.
    #[schemars(range(min = 0.0, max = 3.2))]
    pub search_angle_rad: f64,
}

impl MatcherConfig {
    /// How many points of a scan are matched.
    #[must_use]
    pub fn thinning(&self) -> Thinning {
        Thinning { point_spacing_m: self.point_spacing_m, max_points: self.max_points }
    }
}

impl Default for MatcherConfig {
    fn default() -> Self {
        Self {
            cell_m: 0.05,
            point_spacing_m: Thinning::default().point_spacing_m,
            max_points: Thinning::default().max_points,
            iterations: 12,
            stop_step_m: 2e-4,
            stop_step_rad: 1e-4,
            sigma_m: 0.02,
            rough_sigma_m: 0.05,
            wide_gate_sigmas: 6.0,
            gate_sigmas: 2.0,
            independent_points: 100.0,
            insert_distance_m: 0.15,
            insert_angle_rad: 0.1,
            search_below_inlier_share: 0.75,
            search_distance_m: 0.6,
            search_angle_rad: 0.8,
        }
    }
}
