//! `[filter]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[filter]`: the particle filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterConfig {
    /// Which filter runs.
    pub kind: FilterKind,
    /// Number of particles.
    #[schemars(range(min = 1, max = 100000))]
    pub particles: usize,
    /// How particles are drawn anew.
    pub resampler: ResamplerKind,
    /// Particles are drawn anew when the effective number falls below this share of them (report eq. 22).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub resample_below: f64,
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self {
            kind: FilterKind::RaoBlackwellized,
            particles: 1,
            resampler: ResamplerKind::Systematic,
            resample_below: 0.5,
        }
    }
}

/// Which filter runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// The report's: many poses, one map.
    SharedMap,
    /// A map for every particle, poses drawn from the measurement.
    #[default]
    RaoBlackwellized,
    /// A grid for every particle, matched at key scans only: the algorithm of Grisetti, Stachniss & Burgard 2007.
    Grisetti2007,
}

/// How particles are drawn anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ResamplerKind {
    /// One draw in each of N equal parts (the report's).
    Stratified,
    /// One draw in all, repeated at equal steps.
    #[default]
    Systematic,
    /// Whole shares first, the rest by chance.
    Residual,
}
