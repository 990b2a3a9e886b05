//! The particle filter.

mod config;
mod correlation;
mod genealogy;
mod grisetti;
mod kld_sampling;
mod odometry_scale;
mod odometry_trust;
mod rao_blackwellized;
mod resampler;
mod shared_map;
mod weights;

pub use config::{AdaptiveConfig, FilterConfig, FilterKind, ResamplerKind};
pub use grisetti::{GrisettiConfig, GrisettiFilter, Proposal};
pub use kld_sampling::particles_needed;
pub use rao_blackwellized::RaoBlackwellizedFilter;
pub use resampler::resample;
pub use shared_map::SharedMapFilter;

use crate::geometry::Pose2;

/// What a filter says about one scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterStep {
    /// The best particle's pose, world from body.
    pub pose: Pose2,
    /// Effective number of particles, 1 / Σ w² (report eq. 22).
    pub effective_particles: f64,
    /// Share of the scan's points that lie on the map.
    pub inlier_share: f64,
    /// How well the scan fits: mean log-likelihood per point, or the share of eq. 21's hits.
    pub score: f64,
    /// Whether the particles were drawn anew.
    pub resampled: bool,
    /// Whether scan and odometry contradicted each other, so that the scan alone decided.
    pub odometry_rejected: bool,
}
