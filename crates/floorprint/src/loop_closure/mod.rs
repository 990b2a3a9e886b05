//! Closing loops: places recognised again put the whole drive right.

mod close_loops;
mod config;
mod refinement;
mod submap;
#[cfg(test)]
mod tests;

pub use close_loops::{ClosedLoops, ClosureReport, Verdict, close_loops};
pub use config::LoopClosureConfig;
pub use refinement::{map_of, refine};
pub use submap::Submap;

use crate::geometry::Pose2;
use crate::scan_matcher::SurfaceScan;
use nalgebra::Matrix3;
use std::sync::Arc;

/// A scan that went into the map.
#[derive(Debug, Clone)]
pub struct KeyScan {
    /// Which of the frames it was, counted from 0.
    pub position: usize,
    /// Pose of the body, world from body.
    pub pose: Pose2,
    /// Covariance of the pose over (x, y, θ) in the world's axes, given the map it was matched to.
    pub covariance: Matrix3<f64>,
    /// Its points, in the body's frame.
    pub scan: Arc<SurfaceScan>,
}

/// The drive's poses after its loops were closed: each pose moves with the submaps around it.
#[must_use]
pub fn corrected_poses(poses: &[Pose2], key_scans: &[KeyScan], closed: &ClosedLoops) -> Vec<Pose2> {
    // Corrections hold at the first key scan of each submap; in between they change evenly along the path.
    let anchors: Vec<(usize, Pose2)> = closed
        .submaps
        .iter()
        .zip(&closed.world_from_submap)
        .map(|(submap, corrected)| {
            (key_scans[submap.key_scans.start].position, corrected.compose(&submap.front_end_from_submap.inverse()))
        })
        .collect();
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
