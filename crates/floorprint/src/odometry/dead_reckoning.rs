//! Dead reckoning: the pose that odometry alone gives, as a continuous function of time.
//!
//! The trajectory is a list of knots with a constant body twist between them. Because the
//! motion between two times is always the difference of two values of one function, every
//! encoder count is used exactly once whatever the scans' stamps are; pairing each scan
//! with the nearest reading loses some counts and uses others twice.

use crate::geometry::Pose2;
use crate::sensors::StampedPose;

/// The odometry trajectory `start_from_body` over time.
#[derive(Debug, Clone, Default)]
pub struct DeadReckoning {
    /// Knots in order; stamps never decrease. Two knots at one stamp are a jump.
    knots: Vec<StampedPose>,
}

impl DeadReckoning {
    /// A trajectory through `knots`. A knot whose stamp lies before its predecessor's is
    /// taken to be as late as that one, so that no motion is lost.
    #[must_use]
    pub fn new(mut knots: Vec<StampedPose>) -> Self {
        for index in 1..knots.len() {
            knots[index].stamp_s = knots[index].stamp_s.max(knots[index - 1].stamp_s);
        }
        Self { knots }
    }

    /// The pose at a time (seconds), along the constant twist between the knots around it.
    /// Before the first knot and after the last the pose is theirs; without knots it is the identity.
    #[must_use]
    pub fn pose_at(&self, stamp_s: f64) -> Pose2 {
        let next = self.knots.partition_point(|knot| knot.stamp_s <= stamp_s);
        match (next.checked_sub(1).map(|index| &self.knots[index]), self.knots.get(next)) {
            (Some(before), Some(after)) => {
                let share = (stamp_s - before.stamp_s) / (after.stamp_s - before.stamp_s);
                before.pose.interpolate(&after.pose, share)
            }
            (Some(knot), None) | (None, Some(knot)) => knot.pose,
            (None, None) => Pose2::IDENTITY,
        }
    }

    /// The motion from one time to another, `body_at_from_from_body_at_to`, seconds.
    #[must_use]
    pub fn motion(&self, from_s: f64, to_s: f64) -> Pose2 {
        self.pose_at(from_s).between(&self.pose_at(to_s))
    }

    /// First and last time at which the motion is known, seconds; `None` without odometry.
    #[must_use]
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.knots.first()?.stamp_s, self.knots.last()?.stamp_s])
    }

    /// The knots in order of time.
    #[must_use]
    pub fn knots(&self) -> &[StampedPose] {
        &self.knots
    }

    /// The same trajectory seen from `origin`, a pose of its own frame.
    #[must_use]
    pub fn seen_from(mut self, origin: &Pose2) -> Self {
        for knot in &mut self.knots {
            knot.pose = origin.between(&knot.pose);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn knot(stamp_s: f64, x: f64, theta: f64) -> StampedPose {
        StampedPose { stamp_s, pose: Pose2::new(x, 0.0, theta) }
    }

    #[test]
    fn holds_the_pose_outside_its_span() {
        let path = DeadReckoning::new(vec![knot(1.0, 0.0, 0.0), knot(2.0, 1.0, 0.0)]);
        assert_eq!(path.pose_at(0.0).x, 0.0);
        assert!((path.pose_at(1.25).x - 0.25).abs() < 1e-12);
        assert_eq!(path.pose_at(9.0).x, 1.0);
        assert_eq!(DeadReckoning::default().pose_at(1.0), Pose2::IDENTITY);
    }

    #[test]
    fn stamps_that_run_backwards_lose_no_motion() {
        let path = DeadReckoning::new(vec![knot(1.0, 0.0, 0.0), knot(0.5, 1.0, 0.0), knot(2.0, 3.0, 0.0)]);
        assert_eq!(path.motion(0.9, 2.5).x, 3.0);
    }

    proptest! {
        #[test]
        fn motions_between_any_times_add_up_to_the_whole(
            steps in prop::collection::vec((0.0..0.2_f64, -0.2..0.2_f64, -0.3..0.3_f64), 2..40),
            mut cuts in prop::collection::vec(-1.0..10.0_f64, 0..40),
        ) {
            let mut knots = vec![knot(0.0, 0.0, 0.0)];
            for (dt, ds, turn) in steps {
                let last = knots[knots.len() - 1];
                let pose = last.pose.compose(&Pose2::exp([ds, 0.0, turn]));
                knots.push(StampedPose { stamp_s: last.stamp_s + dt, pose });
            }
            let end = knots[knots.len() - 1].pose;
            let path = DeadReckoning::new(knots);
            cuts.extend([-1.0, 10.0]);
            cuts.sort_by(f64::total_cmp);
            let sum = cuts.windows(2).fold(Pose2::IDENTITY, |sum, cut| sum.compose(&path.motion(cut[0], cut[1])));
            prop_assert!(sum.between(&end).distance() < 1e-9);
        }
    }
}
