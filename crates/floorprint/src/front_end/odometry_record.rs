//! By how much this robot's odometry has turned out to err, against what is stated of it.
//!
//! [`OdometryTrust`](super::odometry_trust::OdometryTrust) never believes much more than is stated, because wheels slip and
//! reports come late: a scan that sees enough puts that right. Where a scan shows a few trees and poles only, it fits in many
//! places by chance, and what the odometry has proven on the way so far says more than that.

use super::odometry_trust::{error_m, squared_ratio, tells_motion};
use crate::geometry::{Pose2, wrap_angle};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Mean squared ratios of errors to what is stated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryRecord {
    /// Of a translation, each of its axes.
    squared_ratio_m: f64,
    /// Of a turn.
    squared_ratio_rad: f64,
    /// Over how many steps, up to what is remembered.
    steps: f64,
}

/// What is stated counts as so many steps.
const STATED_STEPS: f64 = 5.0;
/// The mean is over the last so many.
const STEPS_REMEMBERED: f64 = 200.0;
/// Errors of steps to come may be this much larger than those so far.
const MARGIN: f64 = 2.0;
/// Nothing is ever proven to be better than this share of what is stated.
const LEAST: f64 = 0.1;

impl Default for OdometryRecord {
    fn default() -> Self {
        Self { squared_ratio_m: 1.0, squared_ratio_rad: 1.0, steps: STATED_STEPS }
    }
}

impl OdometryRecord {
    /// Information of a motion, the same with errors as they have turned out to be. It is never less than what is stated.
    #[must_use]
    pub fn proven(&self, stated: &Matrix3<f64>) -> Matrix3<f64> {
        let gain = |squared_ratio: f64| (MARGIN * squared_ratio.sqrt()).clamp(LEAST, 1.0).recip();
        let [position, heading] = [self.squared_ratio_m, self.squared_ratio_rad].map(gain);
        let gains = Matrix3::from_diagonal(&[position, position, heading].into());
        gains * stated * gains
    }

    /// Learns from a step: what the odometry measured and what the scan says, both seen from the pose before, and the
    /// information of the latter; standard deviations of position and heading as stated, metres and radians.
    pub fn learn(
        &mut self,
        measured: &Pose2,
        matched: &Pose2,
        [sigma_m, sigma_rad]: [f64; 2],
        scan_information: &Matrix3<f64>,
    ) {
        if sigma_m <= 0.0 || sigma_rad <= 0.0 || !tells_motion(measured, sigma_m, scan_information) {
            return;
        }
        let error_rad = wrap_angle(matched.theta - measured.theta).abs();
        self.steps = (self.steps + 1.0).min(STEPS_REMEMBERED);
        let learn = |mean: &mut f64, ratio: f64| *mean += (ratio - *mean) / self.steps;
        learn(&mut self.squared_ratio_m, squared_ratio(error_m(measured, matched), sigma_m));
        learn(&mut self.squared_ratio_rad, squared_ratio(error_rad, sigma_rad));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion_model::MotionConfig;

    fn drive(steps: usize, error_m: f64, error_rad: f64, information: f64) -> OdometryRecord {
        let mut record = OdometryRecord::default();
        for step in 0..steps {
            let sign = if step % 2 == 0 { 1.0 } else { -1.0 };
            let measured = Pose2::new(1.0 + sign * error_m, sign * error_m, sign * error_rad);
            let scan = Matrix3::identity() * information;
            record.learn(
                &measured,
                &Pose2::new(1.0, 0.0, 0.0),
                MotionConfig::default().sigmas(&measured).into(),
                &scan,
            );
        }
        record
    }

    #[test]
    fn what_has_proven_good_is_believed_as_far_as_it_has() {
        let stated = Matrix3::from_diagonal(&[39.0, 39.0, 278.0].into());
        assert_eq!(drive(0, 0.0, 0.0, 1e6).proven(&stated), stated);
        assert_eq!(drive(300, 0.5, 0.3, 1e6).proven(&stated), stated, "never less than stated");
        // A tenth of what is stated, with a margin of two, is a fifth in the end.
        let gains = |record: OdometryRecord| record.proven(&stated).diagonal().component_div(&stated.diagonal());
        let proven = gains(drive(2000, 0.016, 0.02, 1e6));
        assert!((proven[0] - 25.0).abs() < 4.0 && (proven[2] - 2.25).abs() < 0.4, "{proven}");
        let perfect = gains(drive(3000, 0.0, 0.0, 1e6));
        assert!((perfect[0] - LEAST.powi(-2)).abs() < 1e-6, "{perfect}");
        assert_eq!(drive(300, 0.0, 0.0, 1.0), OdometryRecord::default(), "scans that know less tell nothing");
    }
}
