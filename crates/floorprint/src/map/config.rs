//! `[map]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[map]`: the occupancy grid (report §III.A.2).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MapConfig {
    /// Side of a cell, metres.
    #[schemars(range(min = 0.005, max = 2.0))]
    pub resolution_m: f64,
    /// Log-odds added to the cell in which a ray ends; the report's 4 log 9.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub hit_log_odds: f64,
    /// Log-odds taken off the cells that a ray passes; the report's log 9.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub pass_log_odds: f64,
    /// Log-odds stay within ± this; the report's 100.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub limit_log_odds: f64,
    /// Rays do not free the cells within this distance of the surface on which they end, unless
    /// they meet it squarely, in cells; 0 frees all cells before the end, as the report does.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub grazing_clearance_cells: f64,
    /// The final map is drawn from scans at least this far apart, metres …
    pub redraw_distance_m: f64,
    /// … or turned by at least this much, radians.
    pub redraw_angle_rad: f64,
}

impl Default for MapConfig {
    fn default() -> Self {
        let log_gamma = 9.0_f64.ln();
        Self {
            resolution_m: 0.05,
            hit_log_odds: 4.0 * log_gamma,
            pass_log_odds: log_gamma,
            limit_log_odds: 100.0,
            grazing_clearance_cells: 1.0,
            redraw_distance_m: 0.1,
            redraw_angle_rad: 0.05,
        }
    }
}
