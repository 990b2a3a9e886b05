//! The estimated trajectory as a function of time: poses at the scans, odometry in between.

use super::dead_reckoning::DeadReckoning;
use crate::geometry::Pose2;
use crate::sensors::StampedPose;

/// Estimated poses `world_from_body` at the scans' stamps.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Poses with stamps that increase strictly.
    poses: Vec<StampedPose>,
}

impl Trajectory {
    /// A trajectory through `poses`, given in the order of the scans. A pose whose stamp does
    /// not lie after those before it has no place in time and is left out.
    #[must_use]
    pub fn new(poses: &[StampedPose]) -> Self {
        let mut ordered: Vec<StampedPose> = Vec::with_capacity(poses.len());
        for pose in poses {
            if ordered.last().is_none_or(|last| pose.stamp_s > last.stamp_s) {
                ordered.push(*pose);
            }
        }
        Self { poses: ordered }
    }

    /// The body's pose at any time (seconds): dead reckoning from the scan before and from the
    /// scan after, blended by the distance in time. Outside the trajectory it is dead
    /// reckoning from the nearest end; without any pose it is dead reckoning itself.
    #[must_use]
    pub fn pose_at(&self, stamp_s: f64, dead_reckoning: &DeadReckoning) -> Pose2 {
        let from = |known: &StampedPose| known.pose.compose(&dead_reckoning.motion(known.stamp_s, stamp_s));
        let next = self.poses.partition_point(|pose| pose.stamp_s <= stamp_s);
        match (next.checked_sub(1).map(|index| &self.poses[index]), self.poses.get(next)) {
            (Some(before), Some(after)) => {
                let share = (stamp_s - before.stamp_s) / (after.stamp_s - before.stamp_s);
                from(before).interpolate(&from(after), share)
            }
            (Some(nearest), None) | (None, Some(nearest)) => from(nearest),
            (None, None) => dead_reckoning.pose_at(stamp_s),
        }
    }

    /// The poses in order of time.
    #[must_use]
    pub fn poses(&self) -> &[StampedPose] {
        &self.poses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamped(stamp_s: f64, x: f64, y: f64) -> StampedPose {
        StampedPose { stamp_s, pose: Pose2::new(x, y, 0.0) }
    }

    #[test]
    fn meets_the_known_poses_and_blends_their_corrections() {
        let odometry = DeadReckoning::new(vec![stamped(0.0, 0.0, 0.0), stamped(1.0, 0.8, 0.0), stamped(2.0, 1.0, 0.0)]);
        let trajectory = Trajectory::new(&[stamped(0.0, 5.0, 0.0), stamped(2.0, 6.0, 0.2)]);
        assert_eq!(trajectory.pose_at(0.0, &odometry), Pose2::new(5.0, 0.0, 0.0));
        assert_eq!(trajectory.pose_at(2.0, &odometry), Pose2::new(6.0, 0.2, 0.0));
        let middle = trajectory.pose_at(1.0, &odometry);
        assert!((middle.x - 5.8).abs() < 1e-12 && (middle.y - 0.1).abs() < 1e-12);
    }

    #[test]
    fn dead_reckoning_leads_on_outside_and_interpolates_where_there_is_no_odometry() {
        let odometry = DeadReckoning::new(vec![stamped(0.0, 0.0, 0.0), stamped(3.0, 3.0, 0.0)]);
        let trajectory = Trajectory::new(&[stamped(1.0, 0.0, 0.0), stamped(2.0, 1.0, 0.0)]);
        assert!((trajectory.pose_at(3.0, &odometry).x - 2.0).abs() < 1e-12);
        assert!((trajectory.pose_at(0.0, &odometry).x + 1.0).abs() < 1e-12);
        assert!((trajectory.pose_at(1.5, &DeadReckoning::default()).x - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_stamp_that_runs_backwards_has_no_place_in_time() {
        let trajectory = Trajectory::new(&[stamped(1.0, 0.0, 0.0), stamped(0.5, 9.0, 0.0), stamped(2.0, 1.0, 0.0)]);
        assert_eq!(trajectory.poses().len(), 2);
    }
}
