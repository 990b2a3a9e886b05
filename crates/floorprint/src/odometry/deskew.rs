//! De-skewing: undoing the body's motion while the LiDAR sweeps.
//!
//! A ray taken at an offset τ from the scan's stamp is seen from the body as it stands at
//! τ. With the constant twist (v, ω) of the dead reckoning, that body is `exp(τ·(v, ω))`
//! away from the body at the stamp; the exponential is expanded to the third order in the
//! angle and the second in the translation, which leaves well under a millimetre for
//! sweeps of 0.1 s.

use super::dead_reckoning::DeadReckoning;
use crate::geometry::Pose2;

/// Sweeps that turn the body by less than this are left alone, radians: 1 mm at 30 m.
const STILL_RAD: f64 = 3e-5;
/// Sweeps that move the body by less than this are left alone, metres.
const STILL_M: f64 = 1e-4;

/// The body's motion during a sweep: one twist before the scan's stamp and one after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SweepMotion {
    /// x and y in m/s, θ in rad/s, in the body's frame at the stamp.
    before: [f32; 3],
    after: [f32; 3],
}

impl SweepMotion {
    /// The motion around `stamp_s` for rays between the two offsets (seconds); `None` when it
    /// is too small to matter.
    pub(super) fn new(dead_reckoning: &DeadReckoning, stamp_s: f64, [first_s, last_s]: [f64; 2]) -> Option<Self> {
        let body = dead_reckoning.pose_at(stamp_s);
        let toward = |offset_s: f64| -> (Pose2, [f32; 3]) {
            if offset_s == 0.0 {
                return (Pose2::IDENTITY, [0.0; 3]);
            }
            let motion = body.between(&dead_reckoning.pose_at(stamp_s + offset_s));
            (motion, motion.log().map(|coordinate| (coordinate / offset_s) as f32))
        };
        let ((to_first, before), (to_last, after)) = (toward(first_s.min(0.0)), toward(last_s.max(0.0)));
        let still = |motion: Pose2| motion.theta.abs() < STILL_RAD && motion.distance() < STILL_M;
        (!still(to_first) || !still(to_last)).then_some(Self { before, after })
    }

    /// Where a point seen at `offset_s` lies in the body's frame at the stamp, metres.
    #[inline]
    pub(super) fn to_stamp(self, offset_s: f32, x_m: f32, y_m: f32) -> [f32; 2] {
        let [vx, vy, omega] = if offset_s < 0.0 { self.before } else { self.after };
        let angle = omega * offset_s;
        let half = 0.5 * angle;
        let (sin, cos) = (angle - angle * angle * angle / 6.0, 1.0 - half * angle);
        let (dx, dy) = (vx * offset_s, vy * offset_s);
        [dx - half * dy + cos * x_m - sin * y_m, dy + half * dx + sin * x_m + cos * y_m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::StampedPose;
    use proptest::prelude::*;

    /// A body that starts at the identity and keeps one twist for two seconds.
    fn constant_twist(twist: [f64; 3]) -> DeadReckoning {
        let at = |stamp_s: f64| StampedPose { stamp_s, pose: Pose2::exp(twist.map(|speed| speed * stamp_s)) };
        DeadReckoning::new((0..=20).map(|tenth| at(f64::from(tenth) / 10.0)).collect())
    }

    #[test]
    fn a_body_at_rest_needs_no_deskewing() {
        assert_eq!(SweepMotion::new(&constant_twist([0.0; 3]), 1.0, [-0.05, 0.05]), None);
        assert_eq!(SweepMotion::new(&DeadReckoning::default(), 1.0, [-0.05, 0.05]), None);
    }

    proptest! {
        #[test]
        fn a_static_point_is_recovered_under_a_constant_twist(
            v in -2.0..2.0_f64, sideways in -0.3..0.3_f64, omega in -3.0..3.0_f64,
            offset_s in -0.05..0.05_f64, x in -20.0..20.0_f64, y in -20.0..20.0_f64,
        ) {
            let path = constant_twist([v, sideways, omega]);
            let Some(motion) = SweepMotion::new(&path, 1.0, [-0.05, 0.05]) else { return Ok(()) };
            let truth = [x, y];
            let at_stamp = path.pose_at(1.0).inverse().transform_point(truth);
            let seen = path.pose_at(1.0 + offset_s).inverse().transform_point(truth);
            let [dx, dy] = motion.to_stamp(offset_s as f32, seen[0] as f32, seen[1] as f32);
            prop_assert!((f64::from(dx) - at_stamp[0]).abs() < 2e-3, "{dx} {at_stamp:?}");
            prop_assert!((f64::from(dy) - at_stamp[1]).abs() < 2e-3, "{dy} {at_stamp:?}");
        }
    }
}
