//! The trajectory of a drive that was put right at some of its frames.

use crate::back_end::Anchor;
use crate::geometry::Pose2;

/// The drive's poses, moved along with those of some of its frames, the `anchors` in order. In between the
/// correction changes evenly along the path, but for places at which the robot was kidnapped.
#[must_use]
pub fn corrected_poses(poses: &[Pose2], anchors: &[Anchor]) -> Vec<Pose2> {
    let mut corrections: Vec<(usize, Pose2)> = Vec::with_capacity(anchors.len());
    for anchor in anchors {
        let correction = anchor.pose.compose(&poses[anchor.frame].inverse());
        if let (Some(first), Some(&(_, before))) = (anchor.interruption, corrections.last()) {
            corrections.push((first.saturating_sub(1), before));
            corrections.push((first, correction));
        }
        corrections.push((anchor.frame, correction));
    }
    let anchors = corrections;
    let mut path_m = Vec::with_capacity(poses.len());
    let mut total = 0.0;
    for (index, pose) in poses.iter().enumerate() {
        if index > 0 {
            total += poses[index - 1].between(pose).distance() + 1e-6;
        }
        path_m.push(total);
    }
    let mut segment = 0;
    poses
        .iter()
        .enumerate()
        .map(|(index, pose)| {
            while segment + 1 < anchors.len() && anchors[segment + 1].0 <= index {
                segment += 1;
            }
            let Some(&(from, before)) = anchors.get(segment) else { return *pose };
            let moved_before = before.compose(pose);
            let Some(&(to, after)) = anchors.get(segment + 1) else { return moved_before };
            let share = ((path_m[index] - path_m[from]) / (path_m[to] - path_m[from])).clamp(0.0, 1.0);
            moved_before.interpolate(&after.compose(pose), share)
        })
        .collect()
}
