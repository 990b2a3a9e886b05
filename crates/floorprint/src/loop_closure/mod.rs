//! Closing loops: places recognised again put the whole drive right.

mod comparison;
mod config;
mod conflict;
mod doubt;
mod hypothesis;
mod loop_closer;
mod refinement;
mod relocation;
mod report;
mod retirement;
mod second_look;
mod submap;
#[cfg(test)]
mod tests;

pub use comparison::{Atlas, Comparison, Placement};
pub use config::LoopClosureConfig;
pub use doubt::Doubt;
pub use hypothesis::{Closure, Hypothesis};
pub use loop_closer::{ClosedLoops, LoopCloser};
pub use refinement::{map_of, refine};
pub use relocation::{Found, Kidnapping};
pub use report::{ClosureLoad, ClosureReport, Verdict};
pub use submap::{Link, Submap, SubmapBuilder};

use crate::geometry::Pose2;
use crate::scan_matcher::SurfaceScan;
use nalgebra::Matrix3;
use std::sync::Arc;

/// A scan that went into the map.
#[derive(Debug, Clone)]
pub struct KeyScan {
    /// Which of the frames it was, counted from 0.
    pub frame: usize,
    /// Pose of the body, world from body.
    pub pose: Pose2,
    /// Covariance of the motion since the key scan before over (x, y, θ) in the world's axes,
    /// given the map that the scans on the way were matched to.
    pub covariance: Matrix3<f64>,
    /// Its points, in the body's frame.
    pub scan: Arc<SurfaceScan>,
    /// Where scans had ceased to fit, so that the map begins anew with this one.
    pub starts_anew: Option<Interruption>,
}

/// Scans that suddenly show something else: the robot was carried elsewhere, or much moved around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interruption {
    /// The first frame that did not fit the map before.
    pub frame: usize,
    /// Whether nothing fitted any more. Else the robot may be where it was thought to be.
    pub is_certain: bool,
}

/// A frame whose pose is known, from which those around it follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Which frame it is, counted from 0.
    pub frame: usize,
    /// Its pose, world from body.
    pub pose: Pose2,
    /// Where the robot was carried here from elsewhere: the first frame at the new place.
    pub starts_anew: Option<usize>,
}

/// The drive's poses, moved along with those of some of its frames, the `anchors` in order. In between the
/// correction changes evenly along the path, but for places at which the robot was carried elsewhere.
#[must_use]
pub fn corrected_poses(poses: &[Pose2], anchors: &[Anchor]) -> Vec<Pose2> {
    let mut corrections: Vec<(usize, Pose2)> = Vec::with_capacity(anchors.len());
    for anchor in anchors {
        let correction = anchor.pose.compose(&poses[anchor.frame].inverse());
        if let (Some(first), Some(&(_, before))) = (anchor.starts_anew, corrections.last()) {
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
