//! `[grisetti]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[grisetti]`: the filter of Grisetti, Stachniss & Burgard 2007. The defaults are those of
/// their implementation, GMapping (its names in parentheses).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GrisettiConfig {
    /// Where a particle is drawn from.
    pub proposal: Proposal,
    /// A scan is matched when the robot has moved this far since the last one, metres (linearUpdate) …
    #[schemars(range(min = 0.0))]
    pub update_distance_m: f64,
    /// … or has turned by this much, radians (angularUpdate).
    #[schemars(range(min = 0.0))]
    pub update_angle_rad: f64,
    /// Standard deviation of the odometry's position per metre of a step (srr).
    #[schemars(range(min = 0.0))]
    pub motion_m_per_m: f64,
    /// Standard deviation of the odometry's position per radian of a step, metres (str).
    #[schemars(range(min = 0.0))]
    pub motion_m_per_rad: f64,
    /// Standard deviation of the odometry's heading per metre of a step, radians (srt).
    #[schemars(range(min = 0.0))]
    pub motion_rad_per_m: f64,
    /// Standard deviation of the odometry's heading per radian of a step (stt).
    #[schemars(range(min = 0.0))]
    pub motion_rad_per_rad: f64,
    /// Side of the cells of the particles' maps, metres (delta).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub cell_m: f64,
    /// A cell is occupied when more than this share of the rays that visited it ended in it (fullnessThreshold).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub full_share: f64,
    /// Whether rays clear the cells that they pass in the particles' maps (generateMap).
    pub trace_rays: bool,
    /// First step of the hill climb, metres (lstep).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub step_m: f64,
    /// First step of the hill climb, radians (astep).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub step_rad: f64,
    /// How often the hill climb halves its steps (iterations).
    pub halvings: u32,
    /// A ray whose end lies d off scores exp(−d² / this), m² (sigma).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub score_square_m2: f64,
    /// A ray whose end lies d off has the log-likelihood −d² / this, m² (lsigma).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub likelihood_square_m2: f64,
    /// A ray that ends near nothing counts in the likelihood like one whose squared distance is this, m²
    /// (nullLikelihood).
    #[schemars(range(min = 0.0))]
    pub missed_square_m2: f64,
    /// Matching has failed when the scores of all rays add up to no more than this (minimumScore).
    #[schemars(range(min = 0.0))]
    pub minimum_score: f64,
    /// The proposal is sampled at the optimum and this far to either side of it, metres (llsamplestep).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub sample_m: f64,
    /// The proposal is sampled at the optimum and this far to either side of it, radians (lasamplestep).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub sample_rad: f64,
    /// Log-weights are divided by this and by the number of particles: rays are not independent (ogain).
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub weight_smoothing: f64,
}

impl Default for GrisettiConfig {
    fn default() -> Self {
        Self {
            proposal: Proposal::Optimum,
            update_distance_m: 1.0,
            update_angle_rad: 0.5,
            motion_m_per_m: 0.1,
            motion_m_per_rad: 0.1,
            motion_rad_per_m: 0.2,
            motion_rad_per_rad: 0.2,
            cell_m: 0.05,
            full_share: 0.1,
            trace_rays: true,
            step_m: 0.05,
            step_rad: 0.05,
            halvings: 5,
            score_square_m2: 0.05,
            likelihood_square_m2: 0.075,
            missed_square_m2: 0.5,
            minimum_score: 0.0,
            sample_m: 0.01,
            sample_rad: 0.005,
            weight_smoothing: 3.0,
        }
    }
}

/// Where a particle is drawn from when its scan has been matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Proposal {
    /// A Gaussian around the optimum that a sample of the odometry leads to, weighted by the
    /// evidence: the paper's.
    Gaussian,
    /// The optimum that a sample of the odometry leads to, weighted by its likelihood: what GMapping ships.
    #[default]
    Optimum,
}
