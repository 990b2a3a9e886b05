//! By how much this robot's odometry reads long or short, learnt from scans that tell the motion without it.
//!
//! Worn or soft tyres make every length a few per cent wrong. Where a scan says nothing about one direction, as along a
//! bare corridor, that error would go into the trajectory with every metre.

use crate::geometry::Pose2;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Ratio of true lengths to those that the odometry states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryScale {
    /// Path by the scans and by the odometry, where scans could tell, metres; what is long past fades.
    matched_m: f64,
    measured_m: f64,
}

/// It takes about so many metres to believe that the odometry is not right.
const BELIEVED_RIGHT_M: f64 = 10.0;
/// A scan tells the motion without the odometry if it is this certain along it: standard deviation, metres.
const CERTAIN_M: f64 = 0.02;
/// Over so many metres what was learnt fades: tyres and loads change.
const MEMORY_M: f64 = 300.0;
/// A step counts no more than this ratio off, beside what scans err, metres: slipping wheels say nothing about the others.
const LARGEST_CHANGE: f64 = 0.2;
const LARGEST_ERROR_M: f64 = 0.03;

impl Default for OdometryScale {
    fn default() -> Self {
        Self { matched_m: BELIEVED_RIGHT_M, measured_m: BELIEVED_RIGHT_M }
    }
}

impl OdometryScale {
    /// The true length of what the odometry states as one.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.matched_m / self.measured_m
    }

    /// A motion as the odometry states it, at its true length.
    #[must_use]
    pub fn correct(&self, measured: &Pose2) -> Pose2 {
        let ratio = self.ratio();
        Pose2::new(ratio * measured.x, ratio * measured.y, measured.theta)
    }

    /// Learns from a step: what the odometry measured and what the scan says, both seen from the pose before; the
    /// information of the latter in the world's axes, in which that pose had a `heading_rad`.
    pub fn learn(&mut self, measured: &Pose2, matched: &Pose2, heading_rad: f64, scan_information: &Matrix3<f64>) {
        let length_m = measured.distance();
        let (sin, cos) = (heading_rad + measured.y.atan2(measured.x)).sin_cos();
        let ahead = Vector3::new(cos, sin, 0.0);
        let variance_m2 = scan_information.try_inverse().map_or(f64::INFINITY, |of_scan| ahead.dot(&(of_scan * ahead)));
        // Judged by the odometry's own length it would learn from what that overstates.
        if length_m == 0.0 || variance_m2 > CERTAIN_M * CERTAIN_M {
            return;
        }
        let along_m = (measured.x * matched.x + measured.y * matched.y) / length_m;
        let kept = (-length_m / MEMORY_M).exp();
        let faded = |learnt_m: f64, step_m: f64| BELIEVED_RIGHT_M + kept * (learnt_m - BELIEVED_RIGHT_M) + step_m;
        self.measured_m = faded(self.measured_m, length_m);
        let most_off_m = LARGEST_CHANGE * length_m + LARGEST_ERROR_M;
        self.matched_m = faded(self.matched_m, along_m.clamp(length_m - most_off_m, length_m + most_off_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIGMA_M: f64 = 0.005;

    /// Odometry that reads `ratio` times too short, in steps of 5 cm or backwards; the scans err by a centimetre to and fro.
    fn drive(steps: usize, ratio: f64, direction_rad: f64, information: &Matrix3<f64>) -> OdometryScale {
        let mut scale = OdometryScale::default();
        for step in 0..steps {
            let ahead = if step % 3 == 0 { -0.05 } else { 0.05 };
            let jitter = if step % 2 == 0 { 0.01 } else { -0.01 };
            let measured = Pose2::new(ahead, 0.0, 0.02);
            let matched = Pose2::new(ratio * ahead + jitter, -jitter, 0.02);
            scale.learn(&measured, &matched, direction_rad, information);
        }
        scale
    }

    proptest! {
        #[test]
        fn what_odometry_reads_too_much_or_too_little_is_learnt(ratio in 0.94..1.06_f64, direction_rad in -3.0..3.0_f64) {
            let certain = Matrix3::identity() * SIGMA_M.powi(-2);
            let corrected = drive(8000, ratio, direction_rad, &certain).correct(&Pose2::new(1.0, -0.5, 0.3));
            prop_assert!((corrected.x - ratio).abs() < 0.004, "{corrected:?} for {ratio}");
            prop_assert!((corrected.y + 0.5 * ratio).abs() < 0.002);
            prop_assert_eq!(corrected.theta, 0.3);
            let half_way = drive(200, ratio, direction_rad, &certain).correct(&Pose2::new(1.0, 0.0, 0.0)).x;
            prop_assert!((half_way - 1.0).abs() < 0.75 * (ratio - 1.0).abs() + 1e-3, "{half_way} for {ratio}");
        }
    }

    #[test]
    fn along_a_bare_corridor_nothing_is_learnt() {
        let corridor = Matrix3::from_diagonal(&[1.0, 1e6, 1e6].into());
        assert_eq!(drive(400, 0.95, 0.0, &corridor), OdometryScale::default());
        assert_ne!(drive(400, 0.95, std::f64::consts::FRAC_PI_2, &corridor), OdometryScale::default());
        let mut scale = OdometryScale::default();
        scale.learn(&Pose2::IDENTITY, &Pose2::new(0.1, 0.0, 0.0), 0.0, &(Matrix3::identity() * 1e6));
        assert_eq!(scale, OdometryScale::default());
    }

    #[test]
    fn a_slipping_wheel_counts_for_little() {
        let mut scale = OdometryScale::default();
        (0..20)
            .for_each(|_| scale.learn(&Pose2::new(0.5, 0.0, 0.0), &Pose2::IDENTITY, 0.0, &(Matrix3::identity() * 1e6)));
        assert!(scale.correct(&Pose2::new(1.0, 0.0, 0.0)).x > 0.8);
    }
}
