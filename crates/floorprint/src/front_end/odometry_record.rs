//! By how much this robot's odometry has turned out to err, against what is stated of it.
//!
//! [`OdometryTrust`](super::odometry_trust::OdometryTrust) never believes much more than is stated, because wheels slip and
//! reports come late: a scan that sees enough puts that right. Where a scan shows a few trees and poles only, it fits in many
//! places by chance, and what the odometry has proven on the way so far says more than that.

use super::odometry_trust::{LARGEST_RATIO, tells_motion};
use crate::geometry::{Pose2, wrap_angle};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Variances of errors against what is stated: of a translation, each of its axes, and of a turn.
///
/// A scan's own error is in the step that leads to it and, the other way round, in the next one. What two steps in a row have
/// in common is therefore not the odometry's; the covariance of successive innovations tells the two apart (Mehra 1970).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryRecord {
    squared_ratio_m: f64,
    squared_ratio_rad: f64,
    /// Over how many steps, up to what is remembered.
    steps: f64,
    /// The error of the last step in its standard deviations: of the translation, in the axes of the body after it, and of the
    /// turn; none where nothing was learnt of it.
    last: Option<Vector3<f64>>,
}

/// What is stated counts as so many steps.
const STATED_STEPS: f64 = 5.0;
/// The mean is over the last so many.
const STEPS_REMEMBERED: f64 = 200.0;
/// Errors of steps to come may be this much larger than those so far.
const MARGIN: f64 = 2.0;
/// Nothing is ever proven to be better than this share of what is stated.
const LEAST: f64 = 0.02;

impl Default for OdometryRecord {
    fn default() -> Self {
        Self { squared_ratio_m: 1.0, squared_ratio_rad: 1.0, steps: STATED_STEPS, last: None }
    }
}

impl OdometryRecord {
    /// Information of a motion, the same with errors as they have turned out to be. It is never less than what is stated.
    #[must_use]
    pub fn proven(&self, stated: &Matrix3<f64>) -> Matrix3<f64> {
        let [position, heading] = self.shares().map(f64::recip);
        let gains = Matrix3::from_diagonal(&[position, position, heading].into());
        gains * stated * gains
    }

    /// Standard deviations of errors, with a margin, as shares of what is stated: of a translation and of a turn.
    #[must_use]
    pub fn shares(&self) -> [f64; 2] {
        [self.squared_ratio_m, self.squared_ratio_rad].map(|ratio| (MARGIN * ratio.max(0.0).sqrt()).clamp(LEAST, 1.0))
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
        let before = self.last.take();
        if sigma_m <= 0.0 || sigma_rad <= 0.0 || !tells_motion(measured, sigma_m, scan_information) {
            return;
        }
        let off = measured.between(matched);
        let ratio = Vector3::new(off.x / sigma_m, off.y / sigma_m, wrap_angle(off.theta) / sigma_rad);
        let ratio = ratio.map(|ratio| ratio.clamp(-LARGEST_RATIO, LARGEST_RATIO));
        self.last = Some(ratio);
        let Some(before) = before else { return };
        // The axes of the last step's end are those of this one's begin; turned by the step they are its own.
        let (sin, cos) = matched.theta.sin_cos();
        let before = Vector3::new(cos * before.x + sin * before.y, cos * before.y - sin * before.x, before.z);
        let variances = ratio.component_mul(&(ratio + 2.0 * before));
        self.steps = (self.steps + 1.0).min(STEPS_REMEMBERED);
        let learn = |mean: &mut f64, variance: f64| *mean += (variance - *mean) / self.steps;
        learn(&mut self.squared_ratio_m, 0.5 * (variances.x + variances.y));
        learn(&mut self.squared_ratio_rad, variances.z);
    }

    /// Hears of a step of which nothing is known.
    pub fn miss(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion_model::MotionConfig;

    /// Steps of a metre in which odometry and scan differ by so much, to the one side as long as `is_to_the_left`.
    fn drive(
        steps: usize,
        error_m: f64,
        error_rad: f64,
        information: f64,
        is_to_the_left: impl Fn(usize) -> bool,
    ) -> OdometryRecord {
        let mut record = OdometryRecord::default();
        for step in 0..steps {
            let sign = if is_to_the_left(step) { 1.0 } else { -1.0 };
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

    /// As likely followed by the same as by the other: errors that are the odometry's own.
    fn by_chance(step: usize) -> bool {
        (step / 2).is_multiple_of(2)
    }

    fn stated() -> Matrix3<f64> {
        Matrix3::from_diagonal(&[39.0, 39.0, 278.0].into())
    }

    fn gains(record: OdometryRecord) -> Vector3<f64> {
        record.proven(&stated()).diagonal().component_div(&stated().diagonal())
    }

    #[test]
    fn what_has_proven_good_is_believed_as_far_as_it_has() {
        assert_eq!(drive(0, 0.0, 0.0, 1e6, by_chance).proven(&stated()), stated());
        assert_eq!(drive(300, 0.5, 0.3, 1e6, by_chance).proven(&stated()), stated(), "never less than stated");
        // A tenth of what is stated, with a margin of two, is a fifth in the end.
        let proven = gains(drive(2000, 0.016, 0.02, 1e6, by_chance));
        assert!((proven[0] - 25.0).abs() < 4.0 && (proven[2] - 2.25).abs() < 0.4, "{proven}");
        let perfect = gains(drive(3000, 0.0, 0.0, 1e6, by_chance));
        assert!((perfect[0] * LEAST.powi(2) - 1.0).abs() < 0.3, "{perfect}");
        let of_nothing = drive(300, 0.0, 0.0, 1.0, by_chance);
        assert_eq!(of_nothing, OdometryRecord::default(), "scans that know less tell nothing");
    }

    #[test]
    fn what_the_next_step_takes_back_is_the_error_of_a_scan() {
        let to_and_fro = |step: usize| step.is_multiple_of(2);
        let [own, of_scans] =
            [gains(drive(300, 0.05, 0.03, 1e6, by_chance)), gains(drive(300, 0.05, 0.03, 1e6, to_and_fro))];
        assert!(of_scans[0] > 10.0 * own[0] && of_scans[2] > 10.0 * own[2], "{of_scans}, {own}");
        // A bend that is always the same is not taken back.
        let bend = gains(drive(300, 0.05, 0.03, 1e6, |_| true));
        assert!(bend[0] <= own[0] && bend[2] <= own[2], "{bend}, {own}");
    }

    #[test]
    fn steps_of_which_nothing_is_known_part_those_before_from_those_after() {
        let mut record = OdometryRecord::default();
        let scan = Matrix3::identity() * 1e6;
        for _ in 0..100 {
            record.learn(&Pose2::new(1.1, 0.0, 0.0), &Pose2::new(1.0, 0.0, 0.0), [0.16, 0.06], &scan);
            record.miss();
        }
        assert_eq!(record, OdometryRecord::default());
    }
}
