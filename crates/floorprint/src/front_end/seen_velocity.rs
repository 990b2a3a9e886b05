//! How the body moves while its LiDAR sweeps, as scans themselves show it.
//!
//! Where no odometry tells the motion, a sweep is undone with the velocity that the scans before it showed. If that is not
//! what it is now, points seen before the middle of the sweep come out on one side of where they are and those seen after
//! it on the other: the scan fits where the body stood in the middle all the same. So velocities are taken from middle to
//! middle, and the error of one does not feed the next, as it would from stamp to stamp.

use crate::frame::{BodyScan, Skew};
use crate::geometry::Pose2;
use crate::odometry::deskew::deskewed;
use serde::{Deserialize, Serialize};

/// The body's velocity from scan to scan.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct SeenVelocity {
    /// Metres a second ahead and to the left, radians a second.
    twist: [f64; 3],
    /// The body in the middle of a sweep lately, if there was one to be believed.
    last: Option<Middle>,
}

/// The body in the middle of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Middle {
    odom_from_body: Pose2,
    /// When that was, seconds after the newest scan's stamp.
    after_stamp_s: f64,
}

/// Over less than this share of the usual time between two scans a velocity is not taken: stamps jitter, and some scans come
/// twice.
const LEAST_PACES: f64 = 0.75;

/// What moves points by less than this makes no difference, metres and radians.
const LITTLE_M: f64 = 1e-3;
const LITTLE_RAD: f64 = 2e-4;

impl SeenVelocity {
    /// The scan as a body would have seen it that stood still.
    pub(super) fn undone_in(&self, scan: &BodyScan) -> BodyScan {
        deskewed(scan, self.twist)
    }

    /// Hears where a scan that was undone was taken, so long after the one before; scans usually come so long after each other
    /// (seconds).
    pub(super) fn observe(&mut self, odom_from_body: &Pose2, skew: Option<&Skew>, elapsed_s: f64, usual_s: f64) {
        let after_stamp_s = skew.map_or(0.0, middle_s);
        let moved = Pose2::exp(self.twist.map(|speed| speed * after_stamp_s));
        let middle = Middle { odom_from_body: odom_from_body.compose(&moved), after_stamp_s };
        let Some(last) = self.last.as_mut().filter(|_| elapsed_s > 0.0) else {
            self.last = Some(middle);
            return;
        };
        last.after_stamp_s -= elapsed_s;
        let between_s = middle.after_stamp_s - last.after_stamp_s;
        if between_s > LEAST_PACES * usual_s {
            self.twist = last.odom_from_body.between(&middle.odom_from_body).log().map(|part| part / between_s);
            *last = middle;
        }
    }

    /// The same of a scan that is looked at only to undo it better: it will be observed yet.
    pub(super) fn foresee(&mut self, odom_from_body: &Pose2, skew: &Skew, elapsed_s: f64, usual_s: f64) {
        let last = self.last;
        self.observe(odom_from_body, Some(skew), elapsed_s, usual_s);
        self.last = last;
    }

    /// Whether it makes no difference to a scan which of both it is undone with.
    pub(super) fn undoes_as_much_as(&self, other: &Self, skew: &Skew) -> bool {
        let longest_s = f64::from(skew.hits_s.iter().copied().map(f32::abs).fold(0.0, f32::max));
        let [ahead, left, turn] = [0, 1, 2].map(|axis| longest_s * (self.twist[axis] - other.twist[axis]));
        ahead.hypot(left) < LITTLE_M && turn.abs() < LITTLE_RAD
    }

    /// The next scan may be from anywhere: how the body moves is not known any more.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }
}

/// The mean time of a scan's hits, seconds after its stamp; 0 without any.
fn middle_s(skew: &Skew) -> f64 {
    skew.hits_s.iter().copied().map(f64::from).sum::<f64>() / skew.hits_s.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Sweeps of all kinds of a body with one velocity. A scan that is undone with another one fits where the body stood
        /// in the middle of its sweep.
        #[test]
        fn a_velocity_that_was_wrong_is_right_after_two_scans(
            truth in [-1.0..1.0_f64, -0.3..0.3_f64, -1.5..1.5_f64],
            wrong in [-1.0..1.0_f64, -0.3..0.3_f64, -1.5..1.5_f64],
            first_s in -0.1..0.1_f32,
            sweep_s in 0.0..0.2_f32,
        ) {
            let skew = Skew { hits_s: vec![first_s, first_s + 0.5 * sweep_s, first_s + sweep_s], ..Skew::default() };
            let middle_s = middle_s(&skew);
            let at = |time_s: f64| Pose2::exp(truth.map(|speed| speed * time_s));
            let mut velocity = SeenVelocity { twist: wrong, last: None };
            let matched = |velocity: &SeenVelocity, stamp_s: f64| {
                at(stamp_s + middle_s).compose(&Pose2::exp(velocity.twist.map(|speed| -speed * middle_s)))
            };
            for scan in 0..2 {
                let pose = matched(&velocity, 0.1 * f64::from(scan));
                let before = velocity;
                velocity.foresee(&pose, &skew, 0.1, 0.1);
                prop_assert_eq!(velocity.last, before.last);
                velocity.observe(&matched(&velocity, 0.1 * f64::from(scan)), Some(&skew), 0.1, 0.1);
            }
            for (found, truth) in velocity.twist.iter().zip(truth) {
                prop_assert!((found - truth).abs() < 1e-9, "{found} and {truth}");
            }
            // Nor do scans at one time, or at an earlier one, of which it is not known how far they lie apart.
            let mut confused = velocity;
            confused.observe(&Pose2::new(5.0, 0.0, 0.0), Some(&skew), 0.0, 0.1);
            prop_assert_eq!(confused.twist, velocity.twist);
            // A scan that comes twice says nothing of it, nor does it spoil what the next one says.
            let before = velocity;
            velocity.observe(&matched(&velocity, 0.1).compose(&Pose2::new(0.01, 0.0, 0.0)), Some(&skew), 0.001, 0.1);
            prop_assert_eq!(velocity.twist, before.twist);
            velocity.observe(&matched(&velocity, 0.2), Some(&skew), 0.099, 0.1);
            for (found, truth) in velocity.twist.iter().zip(truth) {
                prop_assert!((found - truth).abs() < 1e-9, "{found} and {truth}");
            }
        }
    }
}
