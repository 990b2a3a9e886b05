//! What a filter says about one scan.

use crate::geometry::Pose2;
use crate::key_scan::Drift;
use nalgebra::Matrix3;

/// What a filter says about one scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterStep {
    /// The best particle's pose in the front end's frame, `odom_from_body`.
    pub pose: Pose2,
    /// Effective number of particles, 1 / Σ w² (report eq. 22).
    pub effective_particles: f64,
    /// Share of the scan's points that lie on the map.
    pub inlier_share: f64,
    /// How well the scan fits: mean log-likelihood per point, or the share of eq. 21's hits.
    pub score: f64,
    /// Whether the particles were resampled.
    pub resampled: bool,
    /// Whether scan and odometry contradicted each other, so that the scan alone decided.
    pub odometry_rejected: bool,
    /// Covariance of the motion since the last scan that was written into the map, over (x, y, θ) in the axes of the
    /// front end's frame; zero where a filter does not tell.
    pub covariance: Matrix3<f64>,
    /// By how much that motion may be off beyond its covariance.
    pub drift: Drift,
}
