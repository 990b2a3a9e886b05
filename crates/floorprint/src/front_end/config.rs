//! `[filter]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[filter]`: the particle filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterConfig {
    /// Which filter runs.
    pub kind: FilterKind,
    /// Number of particles; at most 1000 where each has a map of its own, as with all filters but `shared_map`.
    #[schemars(range(min = 1, max = 100000))]
    pub particles: usize,
    /// How particles are resampled.
    pub resampler: ResamplerKind,
    /// Particles are resampled when the effective number falls below this share of them (report eq. 22).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub resample_below: f64,
    /// Share of a scan's log-likelihood that counts in the weights (`rao_blackwellized`): scans that follow each
    /// other see the same surfaces with the same errors, so that their evidence is not independent.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub evidence_share: f64,
    /// Whether the number of particles follows from how uncertain the pose is.
    pub adaptive: AdaptiveConfig,
}

/// `[filter.adaptive]`: the number of particles follows from how uncertain the pose is (KLD sampling, Fox 2003).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AdaptiveConfig {
    /// Whether particles that are resampled become fewer or more; else their number stays `filter.particles`.
    pub enabled: bool,
    /// Least number of particles.
    #[schemars(range(min = 2, max = 100000))]
    pub least: usize,
    /// Largest number of particles.
    #[schemars(range(min = 1, max = 100000))]
    pub most: usize,
    /// Kullback–Leibler divergence between the particles and the belief that they stand for.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub error: f64,
    /// How sure it is that the divergence is no larger: quantile of the standard normal distribution (2.33: 99 %).
    #[schemars(range(min = 0.0, max = 10.0))]
    pub quantile_sigmas: f64,
    /// Poses are told apart by bins of this side, metres …
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub bin_m: f64,
    /// … and by this much heading, radians.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub bin_rad: f64,
}

impl Default for AdaptiveConfig {
    fn default() -> Self {
        Self { enabled: false, least: 5, most: 500, error: 0.05, quantile_sigmas: 2.33, bin_m: 0.1, bin_rad: 0.05 }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self {
            kind: FilterKind::RaoBlackwellized,
            particles: 1,
            resampler: ResamplerKind::Systematic,
            resample_below: 0.5,
            evidence_share: 0.1,
            adaptive: AdaptiveConfig::default(),
        }
    }
}

impl FilterConfig {
    /// Most particles that have a map of their own: half a gigabyte, and a tenth of a second or more for each scan.
    pub(crate) const MOST_WITH_MAPS: usize = 1000;

    /// Most particles that the filter may come to have.
    pub(crate) fn most_particles(&self) -> usize {
        if self.adaptive.enabled { self.adaptive.most } else { self.particles }
    }

    /// How many particles a filter begins with.
    #[must_use]
    pub fn first_particles(&self) -> usize {
        let AdaptiveConfig { enabled, least, most, .. } = self.adaptive;
        if enabled { self.particles.clamp(least.min(most), most) } else { self.particles }.max(1)
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

/// How particles are resampled.
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
