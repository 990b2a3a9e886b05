//! Moves a true trajectory in a frame of its own, of a part of the robot that is not the body's origin, to where
//! it can be compared with an estimate.
//!
//! Poses are measured in the frame of a reflector map, a camera system or a building, and of whatever was
//! measured: `truth_from_measured(t) = truth_from_world · world_from_body(t) · body_from_measured`. Both constant
//! motions are estimated from the two trajectories, as in hand-eye calibration. With positions as complex
//! numbers and u = exp(iφ) that turns the world, a position p with heading θ is measured at
//!
//! `u·p + exp(iθ)·n + t`, where n = u·m for the measured point m of the body,
//!
//! which is linear: n and t are eliminated, and the best u of length 1 is the direction of the correlation that
//! is left. m shows only where the robot turns; where it hardly does, the body's origin is taken to be what was
//! measured.

use super::{EvaluationError, StampIndex};
use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use nalgebra::Complex;
use serde::Serialize;

/// A true pose within this time of an estimate's stamp is taken as it is, seconds.
const STAMP_TOLERANCE_S: f64 = 1e-4;
/// The truth is interpolated between poses that are no farther apart than this, seconds.
const MAX_TRUTH_GAP_S: f64 = 0.5;
/// What was measured shows once the headings' variance (1 − the square of their mean vector's length) is larger:
/// a spread of about ±18°.
const LEAST_HEADING_VARIANCE: f64 = 0.1;
/// The world's heading shows in the positions once they spread by more than this, square metres; else in the headings.
const LEAST_POSITION_VARIANCE_M2: f64 = 1e-2;

/// The motions between a true trajectory and the estimate's world and body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TruthAlignment {
    /// `truth_from_world`: the frame of the truth.
    pub truth_from_world: Pose2,
    /// `body_from_measured`: the part of the robot that was measured. Its heading is always estimated.
    pub body_from_measured: Pose2,
    /// Whether the place of what was measured shows in the data; else it is taken to be the body's origin.
    pub place_is_known: bool,
}

impl TruthAlignment {
    /// Estimates both motions.
    ///
    /// # Errors
    /// [`EvaluationError::NoCommonTime`] when no estimated pose has a true pose at its time.
    pub fn estimate(estimate: &[StampedPose], truth: &[StampedPose]) -> Result<Self, EvaluationError> {
        let (estimate, truth) = (StampIndex::new(estimate), StampIndex::new(truth));
        let at = |stamp_s| truth.interpolated(stamp_s, STAMP_TOLERANCE_S, MAX_TRUTH_GAP_S);
        let pairs: Vec<(Pose2, Pose2)> =
            estimate.poses().iter().filter_map(|pose| Some((pose.pose, at(pose.stamp_s)?))).collect();
        if pairs.is_empty() {
            return Err(EvaluationError::NoCommonTime {
                estimates: estimate.poses().len(),
                estimate_span: estimate.describe_span(),
                truth_span: truth.describe_span(),
            });
        }
        Ok(Self::of_pairs(&pairs))
    }

    /// The truth as the estimate's `world_from_body`.
    #[must_use]
    pub fn apply(&self, truth: &[StampedPose]) -> Vec<StampedPose> {
        let (world_from_truth, measured_from_body) =
            (self.truth_from_world.inverse(), self.body_from_measured.inverse());
        let moved = |pose: &Pose2| world_from_truth.compose(pose).compose(&measured_from_body);
        truth.iter().map(|true_pose| StampedPose { pose: moved(&true_pose.pose), ..*true_pose }).collect()
    }

    /// Of pairs of an estimated and a true pose, at least one.
    fn of_pairs(pairs: &[(Pose2, Pose2)]) -> Self {
        let column = |value: &dyn Fn(&(Pose2, Pose2)) -> Complex<f64>| Column::of(pairs.iter().map(value).collect());
        let position = column(&|(estimate, _)| Complex::new(estimate.x, estimate.y));
        let turn = column(&|(estimate, _)| Complex::from_polar(1.0, estimate.theta));
        let measured = column(&|(_, truth)| Complex::new(truth.x, truth.y));
        let heading = column(&|(estimate, truth)| Complex::from_polar(1.0, truth.theta - estimate.theta)).mean.arg();

        // What of a column a point beside the body's origin explains, and what is left.
        let without_turn = |column: &Column| {
            let lever = column.covariance(&turn) / turn.variance();
            (lever, column.less(&turn, lever))
        };
        let turns = turn.variance() > LEAST_HEADING_VARIANCE;
        let eliminated = turns.then(|| [without_turn(&position), without_turn(&measured)]);
        // Whoever drives along one circle all the time might as well turn on the spot.
        let eliminated = eliminated.filter(|[(_, position), _]| position.variance() > LEAST_POSITION_VARIANCE_M2);
        let (phi, n) = match &eliminated {
            Some([(position_lever, position), (measured_lever, measured)]) => {
                let phi = measured.covariance(position).arg();
                (phi, measured_lever - Complex::from_polar(1.0, phi) * position_lever)
            }
            None if position.variance() > LEAST_POSITION_VARIANCE_M2 => {
                (measured.covariance(&position).arg(), Complex::default())
            }
            None => (heading, Complex::default()),
        };
        let unit = Complex::from_polar(1.0, phi);
        let origin = measured.mean - unit * position.mean - turn.mean * n;
        let place = n * unit.conj();
        Self {
            truth_from_world: Pose2::new(origin.re, origin.im, phi),
            body_from_measured: Pose2::new(place.re, place.im, heading - phi),
            place_is_known: eliminated.is_some(),
        }
    }
}

/// Values at the common stamps, with their mean.
struct Column {
    values: Vec<Complex<f64>>,
    mean: Complex<f64>,
}

impl Column {
    fn of(values: Vec<Complex<f64>>) -> Self {
        let mean = values.iter().sum::<Complex<f64>>() / values.len() as f64;
        Self { values, mean }
    }

    /// The mean of `self · other*` about their means.
    fn covariance(&self, other: &Self) -> Complex<f64> {
        let products = self.values.iter().zip(&other.values).map(|(a, b)| (a - self.mean) * (b - other.mean).conj());
        products.sum::<Complex<f64>>() / self.values.len() as f64
    }

    fn variance(&self) -> f64 {
        self.covariance(self).re
    }

    /// `self − factor · other`.
    fn less(&self, other: &Self, factor: Complex<f64>) -> Self {
        Self::of(self.values.iter().zip(&other.values).map(|(a, b)| a - factor * b).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-9.0..9.0_f64, -9.0..9.0_f64, -3.0..3.0_f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
    }

    /// A drive that turns by about `turn` radians, ever faster.
    fn drive(turn: f64) -> Vec<StampedPose> {
        let mut pose = Pose2::IDENTITY;
        (0..60)
            .map(|k| {
                let stamped = StampedPose { stamp_s: f64::from(k) * 0.1, pose };
                pose = pose.compose(&Pose2::new(0.1, 0.0, turn * f64::from(k) / 1770.0));
                stamped
            })
            .collect()
    }

    proptest! {
        #[test]
        fn whatever_was_measured_in_whatever_frame_is_found(frame in pose(), place in pose()) {
            let estimate = drive(3.0);
            let moved = |pose: &Pose2| frame.compose(pose).compose(&place);
            let truth: Vec<_> = estimate.iter().map(|p| StampedPose { pose: moved(&p.pose), ..*p }).collect();
            let alignment = TruthAlignment::estimate(&estimate, &truth).unwrap();
            prop_assert!(alignment.place_is_known);
            prop_assert!(alignment.body_from_measured.between(&place).distance() < 1e-6, "{alignment:?}");
            for (aligned, estimated) in alignment.apply(&truth).iter().zip(&estimate) {
                prop_assert!(aligned.pose.between(&estimated.pose).distance() < 1e-6);
                prop_assert!(aligned.pose.between(&estimated.pose).theta.abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_drive_straight_ahead_does_not_show_what_was_measured() {
        let estimate = drive(0.1);
        let frame = Pose2::new(4.0, 1.0, 3.1);
        let truth: Vec<_> = estimate.iter().map(|p| StampedPose { pose: frame.compose(&p.pose), ..*p }).collect();
        let alignment = TruthAlignment::estimate(&estimate, &truth).unwrap();
        assert!(!alignment.place_is_known && alignment.body_from_measured.distance() == 0.0);
        assert!(alignment.truth_from_world.between(&frame).distance() < 1e-9);
        assert!(TruthAlignment::estimate(&estimate, &[]).is_err());
    }
}
