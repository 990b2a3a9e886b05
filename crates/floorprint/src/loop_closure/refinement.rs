//! Fits every scan to the map of all scans, once the loops are closed.

use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::map::SurfaceMap;
use crate::scan_matcher::{MatcherConfig, PoseBelief, SurfaceScan, match_scan};
use nalgebra::Matrix3;

/// How far a scan may be off after the loops were closed: standard deviations, metres and radians.
const SIGMA_M: f64 = 0.05;
const SIGMA_RAD: f64 = 0.02;
/// A scan of which less than this share lies on the map is left where it was.
const MIN_INLIER_SHARE: f64 = 0.5;

/// The map that some of a drive's scans make at their poses: those whose numbers, ascending, are given.
#[must_use]
pub fn map_of(
    key_frames: &[usize],
    frames: impl Iterator<Item = Frame>,
    poses: &[Pose2],
    matcher: &MatcherConfig,
) -> SurfaceMap {
    let mut map = SurfaceMap::new(matcher.cell_m);
    let mut due = key_frames.iter().peekable();
    for ((number, frame), pose) in frames.enumerate().zip(poses) {
        if due.next_if_eq(&&number).is_some() {
            map.add_scan(pose, &SurfaceScan::new(&frame.scan, matcher));
        }
    }
    map
}

/// The poses at which each scan fits the map best, near where it is. Poses without a frame stay.
#[must_use]
pub fn refine(
    map: &SurfaceMap,
    frames: impl Iterator<Item = Frame>,
    poses: &[Pose2],
    matcher: &MatcherConfig,
) -> Vec<Pose2> {
    let information = Matrix3::from_diagonal(&[SIGMA_M.powi(-2), SIGMA_M.powi(-2), SIGMA_RAD.powi(-2)].into());
    let mut refined: Vec<Pose2> = frames
        .zip(poses)
        .map(|(frame, pose)| {
            let scan = SurfaceScan::new(&frame.scan, matcher);
            let found = match_scan(map, &scan, &PoseBelief { pose: *pose, information }, matcher);
            if found.inlier_share < MIN_INLIER_SHARE { *pose } else { found.belief.pose }
        })
        .collect();
    refined.extend_from_slice(&poses[refined.len()..]);
    refined
}
