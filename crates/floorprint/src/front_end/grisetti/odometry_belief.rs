//! What the odometry since the last matched scan says, with the noise of GMapping's motion
//! model summed up over its steps to first order.

use super::GrisettiConfig;
use crate::geometry::{Pose2, wrap_angle};
use nalgebra::{Matrix3, Vector3};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Share of the noise along a step that acts across it (sxy in GMapping).
const CROSS_SHARE: f64 = 0.3;

/// A Gaussian over the motion since the last matched scan.
#[derive(Debug, Clone)]
pub(super) struct OdometryBelief {
    /// The body now, seen from the body at the last matched scan.
    pub(super) motion: Pose2,
    /// Of the motion's (x, y, θ).
    covariance: Matrix3<f64>,
    /// Sum of the steps' lengths, metres.
    path_m: f64,
    /// Sum of the steps' turns, radians.
    turned_rad: f64,
}

impl OdometryBelief {
    /// No motion, no doubt.
    pub(super) fn new() -> Self {
        Self { motion: Pose2::IDENTITY, covariance: Matrix3::zeros(), path_m: 0.0, turned_rad: 0.0 }
    }

    /// Goes on by a step of the odometry.
    pub(super) fn extend(&mut self, step: &Pose2, config: &GrisettiConfig) {
        let (along, across, turn) = (step.x.abs(), step.y.abs(), step.theta.abs());
        let cross = CROSS_SHARE * config.motion_m_per_m;
        let sigma = Vector3::new(
            config.motion_m_per_m * along + config.motion_m_per_rad * turn + cross * across,
            config.motion_m_per_m * across + config.motion_m_per_rad * turn + cross * along,
            config.motion_rad_per_rad * turn + config.motion_rad_per_m * step.distance(),
        );
        let (sin, cos) = self.motion.theta.sin_cos();
        let rotation = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        // An error of the heading so far turns the step.
        let (x, y) = (cos * step.x - sin * step.y, sin * step.x + cos * step.y);
        let turning = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, 0.0, 0.0, 1.0);
        let noise = Matrix3::from_diagonal(&sigma.component_mul(&sigma));
        self.covariance = turning * self.covariance * turning.transpose() + rotation * noise * rotation.transpose();
        self.motion = self.motion.compose(step);
        self.path_m += step.distance();
        self.turned_rad += turn;
    }

    /// Whether the robot has moved far enough for the next scan to be matched.
    pub(super) fn is_due(&self, config: &GrisettiConfig) -> bool {
        self.path_m >= config.update_distance_m || self.turned_rad >= config.update_angle_rad
    }

    /// The inverse of the covariance; zero where there is none.
    pub(super) fn information(&self) -> Matrix3<f64> {
        self.covariance.try_inverse().unwrap_or_else(Matrix3::zeros)
    }

    /// A sample of the pose that the motion leads to from `start`.
    pub(super) fn sample(&self, start: &Pose2, random: &mut impl Rng) -> Pose2 {
        start.compose(&draw(&self.motion, &self.covariance, random))
    }

    /// Logarithm of the density of coming from `start` to `end`, up to a constant, given [`information`](Self::information).
    pub(super) fn log_density(&self, start: &Pose2, end: &Pose2, information: &Matrix3<f64>) -> f64 {
        let motion = start.between(end);
        let off = Vector3::new(
            motion.x - self.motion.x,
            motion.y - self.motion.y,
            wrap_angle(motion.theta - self.motion.theta),
        );
        -0.5 * off.dot(&(information * off))
    }
}

/// A sample of a Gaussian over (x, y, θ); the mean where the covariance is singular.
pub(super) fn draw(mean: &Pose2, covariance: &Matrix3<f64>, random: &mut impl Rng) -> Pose2 {
    let normal = Vector3::from_fn(|_, _| StandardNormal.sample(&mut *random));
    let offset = covariance.cholesky().map_or_else(Vector3::zeros, |factor| factor.l() * normal);
    Pose2::new(mean.x + offset.x, mean.y + offset.y, mean.theta + offset.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stage, generator};

    /// GMapping's own way: noise on every step.
    fn walk(steps: &[Pose2], config: &GrisettiConfig, random: &mut impl Rng) -> Pose2 {
        steps.iter().fold(Pose2::IDENTITY, |pose, step| {
            let mut belief = OdometryBelief::new();
            belief.extend(step, config);
            belief.sample(&pose, random)
        })
    }

    #[test]
    fn one_gaussian_scatters_like_noise_on_every_step() {
        let config = GrisettiConfig::default();
        let steps: Vec<Pose2> = (0..20).map(|k| Pose2::new(0.05, 0.0, if k < 10 { 0.04 } else { 0.0 })).collect();
        let mut belief = OdometryBelief::new();
        steps.iter().for_each(|step| belief.extend(step, &config));
        let mut random = generator(1, Stage::Motion, 0, 0);
        let samples: Vec<Vector3<f64>> =
            (0..4000).map(|_| (walk(&steps, &config, &mut random).to_vector()) - belief.motion.to_vector()).collect();
        let mut covariance = Matrix3::zeros();
        samples.iter().for_each(|off| covariance += off * off.transpose() / samples.len() as f64);
        assert!((covariance - belief.covariance).norm() < 0.08 * belief.covariance.norm());
    }

    #[test]
    fn scans_are_due_by_distance_or_turn() {
        let config = GrisettiConfig::default();
        let mut belief = OdometryBelief::new();
        belief.extend(&Pose2::new(0.9, 0.0, 0.2), &config);
        assert!(!belief.is_due(&config));
        let mut turned = belief.clone();
        turned.extend(&Pose2::new(0.0, 0.0, -0.4), &config);
        assert!(turned.is_due(&config));
        belief.extend(&Pose2::new(-0.2, 0.0, 0.0), &config);
        assert!(belief.is_due(&config));
    }

    #[test]
    fn the_prediction_is_the_likeliest() {
        let config = GrisettiConfig::default();
        let mut belief = OdometryBelief::new();
        belief.extend(&Pose2::new(0.5, 0.1, 0.2), &config);
        let (start, information) = (Pose2::new(3.0, -1.0, 2.0), belief.information());
        let at = |offset: [f64; 3]| {
            let [x, y, theta] = offset;
            let motion = belief.motion;
            let end = start.compose(&Pose2::new(motion.x + x, motion.y + y, motion.theta + theta));
            belief.log_density(&start, &end, &information)
        };
        assert!(at([0.0; 3]).abs() < 1e-12);
        for offset in [[0.1, 0.0, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.1]] {
            assert!(at(offset) < -0.1);
        }
    }
}
