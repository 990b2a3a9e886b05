//! How far the odometry of one step can be trusted (report eqs. 12–13).

use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use nalgebra::Matrix3;
use rand_distr::{Distribution, StandardNormal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[motion]`: noise of the motion between two scans. The shares add up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// Standard deviation of the position at every step, metres.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sigma_m: f64,
    /// Standard deviation of the position per metre travelled.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sigma_m_per_m: f64,
    /// Standard deviation of the heading at every step, radians.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sigma_rad: f64,
    /// Standard deviation of the heading per radian turned.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sigma_rad_per_rad: f64,
    /// Standard deviation of the heading per metre travelled, radians.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub sigma_rad_per_m: f64,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self { sigma_m: 0.01, sigma_m_per_m: 0.15, sigma_rad: 0.01, sigma_rad_per_rad: 0.15, sigma_rad_per_m: 0.05 }
    }
}

/// No step is more certain than this (m², rad²).
const SMALLEST_VARIANCE: f64 = 1e-10;

impl MotionConfig {
    /// Standard deviations of a step in position (metres) and heading (radians).
    #[must_use]
    pub fn sigmas(&self, motion: &Pose2) -> (f64, f64) {
        let (distance_m, turn_rad) = (motion.distance(), motion.theta.abs());
        (
            self.sigma_m + self.sigma_m_per_m * distance_m,
            self.sigma_rad + self.sigma_rad_per_rad * turn_rad + self.sigma_rad_per_m * distance_m,
        )
    }

    /// Inverse covariance of a step over (x, y, θ); the same in every direction of the plane.
    #[must_use]
    pub fn information(&self, motion: &Pose2) -> Matrix3<f64> {
        self.scaled_information(motion, 1.0)
    }

    /// The same with the standard deviation of the position multiplied by a factor.
    #[must_use]
    pub fn scaled_information(&self, motion: &Pose2, position_factor: f64) -> Matrix3<f64> {
        let (sigma_m, sigma_rad) = self.sigmas(motion);
        let sigma_m = position_factor * sigma_m;
        // Even where no noise is stated the odometry is only nearly certain, to keep the sums finite.
        let of_variance = |variance: f64| variance.max(SMALLEST_VARIANCE).recip();
        let (position, heading) = (of_variance(sigma_m * sigma_m), of_variance(sigma_rad * sigma_rad));
        Matrix3::from_diagonal(&[position, position, heading].into())
    }

    /// A sample of the pose after `motion` (eq. 13): the noise is added in the world's axes,
    /// three-dimensional (x, y, θ), although the report calls it "2D".
    #[must_use]
    pub fn sample(&self, pose: &Pose2, motion: &Pose2, seed: u64, step: u64, particle: u64) -> Pose2 {
        let mut random = generator(seed, Stage::Motion, step, particle);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (sigma_m, sigma_rad) = self.sigmas(motion);
        let moved = pose.compose(motion);
        Pose2::new(moved.x + sigma_m * normal(), moved.y + sigma_m * normal(), moved.theta + sigma_rad * normal())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_scatter_as_stated() {
        let config = MotionConfig::default();
        let motion = Pose2::new(1.0, 0.0, 0.5);
        let (sigma_m, sigma_rad) = config.sigmas(&motion);
        let samples: Vec<Pose2> = (0..4000).map(|k| config.sample(&Pose2::IDENTITY, &motion, 1, 2, k)).collect();
        let spread = |value: fn(&Pose2) -> f64, mean: f64| {
            (samples.iter().map(|p| (value(p) - mean).powi(2)).sum::<f64>() / samples.len() as f64).sqrt()
        };
        assert!((spread(|p| p.x, 1.0) / sigma_m - 1.0).abs() < 0.05);
        assert!((spread(|p| p.y, 0.0) / sigma_m - 1.0).abs() < 0.05);
        assert!((spread(|p| p.theta, 0.5) / sigma_rad - 1.0).abs() < 0.05);
    }
}
