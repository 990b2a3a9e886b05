//! The poses that the robot's own odometry states, put right by what is known of its scale and its clock.

use super::dead_reckoning::DeadReckoning;
use crate::geometry::Pose2;
use crate::sensors::{ScaleConfig, StampedPose};

/// Dead reckoning from stated poses.
#[derive(Debug, Default)]
pub(super) struct StatedOdometry {
    scale: ScaleConfig,
    /// How late the stamps are beside the LiDAR's, seconds.
    lag_s: f64,
    /// The last pose as it was stated, and as it was put right.
    last: Option<(StampedPose, Pose2)>,
    path: DeadReckoning,
}

impl StatedOdometry {
    /// Nothing stated yet.
    pub(super) fn new(scale: ScaleConfig, lag_s: f64) -> Self {
        Self { scale, lag_s, ..Self::default() }
    }

    /// Whether poses are not used as they are stated.
    pub(super) fn corrects(&self) -> bool {
        self.lag_s != 0.0 || self.scales()
    }

    fn scales(&self) -> bool {
        self.scale.odometry_distance != 1.0 || self.scale.odometry_turn != 1.0
    }

    /// Takes in the next stated pose, `odometry_from_body`.
    pub(super) fn push(&mut self, stated: StampedPose) {
        let pose = match self.last {
            Some((last, pose)) if self.scales() => {
                let step = last.pose.between(&stated.pose);
                let [distance, turn] = [self.scale.odometry_distance, self.scale.odometry_turn];
                pose.compose(&Pose2::new(distance * step.x, distance * step.y, turn * step.theta))
            }
            _ => stated.pose,
        };
        self.last = Some((stated, pose));
        self.path.push(StampedPose { stamp_s: stated.stamp_s - self.lag_s, pose }, stated.stamp_s);
    }

    /// The last pose as it was stated.
    pub(super) fn last(&self) -> Option<StampedPose> {
        self.last.map(|(stated, _)| stated)
    }

    /// The trajectory so far, `odometry_from_body`.
    pub(super) fn path(&self) -> &DeadReckoning {
        &self.path
    }

    /// Forgets the past before a time, seconds.
    pub(super) fn forget_before(&mut self, stamp_s: f64) {
        self.path.forget_before(stamp_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_scaled_and_stamps_put_back() {
        let scale = ScaleConfig { odometry_distance: 2.0, odometry_turn: 0.5, ..ScaleConfig::default() };
        let mut odometry = StatedOdometry::new(scale, 0.25);
        let start = Pose2::new(3.0, 1.0, 0.5);
        for (stamp_s, step) in [(1.0, Pose2::IDENTITY), (2.0, Pose2::new(0.5, 0.0, 0.4))] {
            odometry.push(StampedPose { stamp_s, pose: start.compose(&step) });
        }
        let moved = odometry.path().motion(0.75, 1.75);
        assert!((moved.x - 1.0).abs() < 1e-12 && (moved.theta - 0.2).abs() < 1e-12, "{moved:?}");
        assert_eq!(odometry.last().map(|last| last.stamp_s), Some(2.0));
        assert!(odometry.corrects() && !StatedOdometry::default().corrects());
    }
}
