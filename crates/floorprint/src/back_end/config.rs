//! `[loop_closure]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[loop_closure]`: recognising places again, and the pose graph that puts the drive right.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LoopClosureConfig {
    /// Whether loops are closed.
    pub enabled: bool,
    /// Scans are matched against what the last this many metres of the drive showed (between half of
    /// it and all of it): older places are connected in by closures, not by chance.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub window_m: f64,
    /// Length of the path that makes one submap, metres.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub submap_length_m: f64,
    /// Largest number of older submaps that a submap is compared with.
    pub candidates: usize,
    /// Submaps whose middles are estimated to lie within this distance (and the uncertainty about it)
    /// are compared, metres.
    #[schemars(range(min = 0.0))]
    pub candidate_distance_m: f64,
    /// Of the passes over a place that show nothing new the key scans of this many, the newest, are kept for the map, so
    /// that a session grows with the area that was seen and not with time.
    #[schemars(range(min = 0, max = 1000000))]
    pub passes_kept: usize,
    /// Largest number of hypotheses about the drive that are held for possible while it is not clear which
    /// of several places that look the same the robot came back to; 1 always bets on the likeliest.
    #[schemars(range(min = 1, max = 1000))]
    pub hypotheses: usize,
    /// Standard deviation of the position after one metre of scan matching, metres; grows with the
    /// square root of the path.
    #[schemars(range(min = 0.0001, max = 10.0))]
    pub drift_sigma_m: f64,
    /// Standard deviation of the heading after one metre of scan matching, radians.
    #[schemars(range(min = 0.00001, max = 3.2))]
    pub drift_sigma_rad: f64,
    /// A place counts as recognised when at least this share of a submap's surfaces lies on the other's.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_inlier_share: f64,
    /// Standard deviation that a closure has at least in position, metres.
    #[schemars(range(min = 0.0001, max = 10.0))]
    pub closure_sigma_m: f64,
    /// Standard deviation that a closure has at least in heading, radians.
    #[schemars(range(min = 0.00001, max = 3.2))]
    pub closure_sigma_rad: f64,
    /// How often every scan is fitted to the map of all of them in the end; 0 leaves the graph's result.
    #[schemars(range(min = 0, max = 100))]
    pub refinements: usize,
}

impl Default for LoopClosureConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            window_m: 20.0,
            submap_length_m: 4.0,
            candidates: 4,
            candidate_distance_m: 6.0,
            passes_kept: 8,
            hypotheses: 6,
            drift_sigma_m: 0.01,
            drift_sigma_rad: 0.002,
            min_inlier_share: 0.6,
            closure_sigma_m: 0.015,
            closure_sigma_rad: 0.003,
            refinements: 1,
        }
    }
}
