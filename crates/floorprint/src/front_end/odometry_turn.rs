//! By how much this robot's odometry turns too little or too much, learnt from scans that tell the heading without it.
//!
//! Wheels of unequal size turn a robot a little with every metre, a track width that is not quite known with every turn; neither
//! averages out as noise does (UMBmark, Borenstein & Feng 1996). Where a scan shows little, that is most of the error.

use super::odometry_trust::MORE_CERTAIN;
use crate::geometry::{Pose2, wrap_angle};
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// The turn that the odometry misses, by weighted least squares over the steps so far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryTurn {
    /// Normal equations over (path in metres, turn in radians).
    information: Matrix2<f64>,
    missed: Vector2<f64>,
}

/// It takes about so many metres, or radians, to believe that the odometry is not right.
const BELIEVED_RIGHT: f64 = 10.0;
/// Over so many metres, or radians, what was learnt fades: tyres and loads change.
const MEMORY: f64 = 300.0;
/// A step counts no more than so many standard deviations off: wheels that slip say nothing about the others.
const LARGEST_SIGMAS: f64 = 2.0;

impl Default for OdometryTurn {
    fn default() -> Self {
        Self { information: Matrix2::identity() * BELIEVED_RIGHT, missed: Vector2::zeros() }
    }
}

impl OdometryTurn {
    /// A motion as the odometry states it, with the turn that it misses.
    #[must_use]
    pub fn correct(&self, measured: &Pose2) -> Pose2 {
        let missed_rad =
            self.information.try_inverse().map_or(0.0, |inverse| cause(measured).dot(&(inverse * self.missed)));
        // The way is bent: half of the turn comes before it.
        let half = Pose2::new(0.0, 0.0, 0.5 * missed_rad);
        half.compose(measured).compose(&half)
    }

    /// Learns from a step: what the odometry measured and what the scan says, both seen from the pose before; the standard
    /// deviation of the heading as stated (radians), and what the scan alone knows of it, as information (1/rad²).
    pub fn learn(&mut self, measured: &Pose2, matched: &Pose2, sigma_rad: f64, scan_information_rad: f64) {
        let cause = cause(measured);
        let length = cause.abs().sum();
        if length == 0.0 || sigma_rad <= 0.0 || scan_information_rad < MORE_CERTAIN / (sigma_rad * sigma_rad) {
            return;
        }
        let most_rad = LARGEST_SIGMAS * sigma_rad;
        let missed_rad = wrap_angle(matched.theta - measured.theta).clamp(-most_rad, most_rad);
        let kept = (-length / MEMORY).exp();
        let believed = Matrix2::identity() * BELIEVED_RIGHT;
        self.information = believed + (self.information - believed) * kept + cause * cause.transpose() / length;
        self.missed = self.missed * kept + cause * missed_rad / length;
    }
}

/// What a turn may be missed of: the path, backwards negative (metres), and the turn (radians).
fn cause(measured: &Pose2) -> Vector2<f64> {
    Vector2::new(measured.distance().copysign(measured.x), measured.theta)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Odometry that misses `per_m` and `per_rad` of its turns, in steps of 30 cm with curves to both sides; the headings of
    /// scans err by 5 mrad to and fro.
    fn drive(steps: usize, per_m: f64, per_rad: f64) -> OdometryTurn {
        let mut turn = OdometryTurn::default();
        for step in 0..steps {
            let ahead_m = if step % 7 == 0 { -0.3 } else { 0.3 };
            let turned_rad = 0.2 * (0.1 * step as f64).sin();
            let jitter_rad = if step % 2 == 0 { 0.01 } else { -0.01 };
            let measured = Pose2::new(ahead_m, 0.0, turned_rad);
            let missed_rad = per_m * ahead_m + per_rad * turned_rad;
            let matched = Pose2::new(ahead_m, 0.0, turned_rad + missed_rad + jitter_rad);
            turn.learn(&measured, &matched, 0.04, 1e6);
        }
        turn
    }

    proptest! {
        #[test]
        fn turns_that_the_odometry_misses_are_learnt(per_m in -0.03..0.03_f64, per_rad in -0.1..0.1_f64) {
            let turn = drive(4000, per_m, per_rad);
            let straight = turn.correct(&Pose2::new(1.0, 0.0, 0.0));
            prop_assert!((straight.theta - per_m).abs() < 0.1 * per_m.abs() + 1e-3, "{} for {per_m}", straight.theta);
            prop_assert!((straight.y - 0.5 * straight.theta).abs() < 1e-3);
            let turned = turn.correct(&Pose2::new(0.0, 0.0, 1.0)).theta - 1.0;
            prop_assert!((turned - per_rad).abs() < 0.5 * per_rad.abs() + 5e-3, "{turned} for {per_rad}");
            let backwards = turn.correct(&Pose2::new(-1.0, 0.0, 0.0));
            prop_assert!((backwards.theta + straight.theta).abs() < 1e-12);
        }
    }

    #[test]
    fn a_few_steps_and_scans_that_do_not_know_teach_little() {
        assert!(drive(10, 0.02, 0.0).correct(&Pose2::new(1.0, 0.0, 0.0)).theta < 0.01);
        let mut turn = OdometryTurn::default();
        turn.learn(&Pose2::new(1.0, 0.0, 0.0), &Pose2::new(1.0, 0.0, 0.1), 0.05, 100.0);
        turn.learn(&Pose2::IDENTITY, &Pose2::new(0.0, 0.0, 0.1), 0.01, 1e6);
        assert_eq!(turn, OdometryTurn::default());
    }
}
