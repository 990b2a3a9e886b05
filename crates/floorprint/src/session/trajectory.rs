//! The trajectory of a drive that was put right at some of its frames.

use crate::back_end::Anchor;
use crate::geometry::Pose2;
use crate::sensors::StampedPose;

/// Moves the drive's poses along with those of some of its frames, the `anchors` in order. In between the
/// correction changes evenly along the path, but for places at which the robot was kidnapped.
pub fn correct_poses(poses: &mut [StampedPose], anchors: &[Anchor]) {
    let mut corrections: Vec<(usize, Pose2)> = Vec::with_capacity(anchors.len());
    for anchor in anchors {
        let correction = anchor.pose.compose(&poses[anchor.frame].pose.inverse());
        if let (Some(first), Some(&(_, before))) = (anchor.interruption, corrections.last()) {
            corrections.push((first.saturating_sub(1), before));
            corrections.push((first, correction));
        }
        corrections.push((anchor.frame, correction));
    }
    let step_m = |from: &Pose2, to: &Pose2| from.between(to).distance() + 1e-6;
    // How far it is to each of those frames: they are few beside all poses.
    let mut in_order: Vec<(usize, usize)> = corrections.iter().enumerate().map(|(k, (frame, _))| (*frame, k)).collect();
    in_order.sort_unstable();
    let mut paths_m = vec![0.0; corrections.len()];
    let mut due = in_order.into_iter().peekable();
    let mut path_m = 0.0;
    for frame in 0..poses.len() {
        if frame > 0 {
            path_m += step_m(&poses[frame - 1].pose, &poses[frame].pose);
        }
        while let Some((_, correction)) = due.next_if(|(at, _)| *at == frame) {
            paths_m[correction] = path_m;
        }
    }
    let (mut path_m, mut before, mut segment) = (0.0, None, 0);
    for (frame, stamped) in poses.iter_mut().enumerate() {
        let pose = stamped.pose;
        path_m += before.replace(pose).map_or(0.0, |before| step_m(&before, &pose));
        while segment + 1 < corrections.len() && corrections[segment + 1].0 <= frame {
            segment += 1;
        }
        let Some((_, before)) = corrections.get(segment) else { return };
        let moved_before = before.compose(&pose);
        stamped.pose = match corrections.get(segment + 1) {
            Some((_, after)) => {
                let [from_m, to_m] = [paths_m[segment], paths_m[segment + 1]];
                let share = ((path_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
                moved_before.interpolate(&after.compose(&pose), share)
            }
            None => moved_before,
        };
    }
}

/// The same of poses without stamps.
#[cfg(test)]
pub(crate) fn corrected_poses(poses: &[Pose2], anchors: &[Anchor]) -> Vec<Pose2> {
    let mut stamped: Vec<StampedPose> = poses.iter().map(|&pose| StampedPose { stamp_s: 0.0, pose }).collect();
    correct_poses(&mut stamped, anchors);
    stamped.iter().map(|stamped| stamped.pose).collect()
}
