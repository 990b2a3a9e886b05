//! Leaves out images taken where the one before was taken: standing still shows nothing new.

use crate::geometry::Pose2;

/// Which of the images taken at `poses`, in the order of time, are kept: those for which the
/// body has moved by `distance_m` or turned by `angle_rad` since the last one that was kept.
///
/// An image without a finite pose is kept and does not count as a place.
#[must_use]
pub fn spaced(poses: &[Pose2], distance_m: f64, angle_rad: f64) -> Vec<bool> {
    let mut last: Option<Pose2> = None;
    let is_kept = |pose: &Pose2| {
        if !pose.is_finite() {
            return true;
        }
        let near = last.is_some_and(|last| {
            let motion = last.between(pose);
            motion.distance() < distance_m && motion.theta.abs() < angle_rad
        });
        if !near {
            last = Some(*pose);
        }
        !near
    };
    poses.iter().map(is_kept).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_that_stands_is_seen_once_and_a_slow_one_at_even_steps() {
        let standing = [Pose2::IDENTITY; 5];
        assert_eq!(spaced(&standing, 0.1, 0.1), [true, false, false, false, false]);
        let slow: Vec<_> = (0..9).map(|step| Pose2::new(0.03125 * f64::from(step), 0.0, 0.0)).collect();
        let kept = [true, false, false, false, true, false, false, false, true];
        assert_eq!(spaced(&slow, 0.125, 0.1), kept);
        let turning: Vec<_> = (0..9).map(|step| Pose2::new(0.0, 0.0, 3.0 + 0.03125 * f64::from(step))).collect();
        assert_eq!(spaced(&turning, 0.1, 0.125), kept);
    }

    #[test]
    fn without_a_spacing_or_a_pose_every_image_is_kept() {
        assert_eq!(spaced(&[Pose2::IDENTITY; 3], 0.0, 0.1), [true; 3]);
        let lost = Pose2::new(f64::NAN, 0.0, 0.0);
        assert_eq!(spaced(&[Pose2::IDENTITY, lost, Pose2::IDENTITY], 0.1, 0.1), [true, true, false]);
    }
}
