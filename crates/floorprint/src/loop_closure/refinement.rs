//! Fits every scan to the map of all scans, once the loops are closed.

use super::KeyScan;
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

/// The map that key scans make at their poses.
#[must_use]
pub fn map_of(key_scans: &[KeyScan], poses: &[Pose2], cell_m: f64) -> SurfaceMap {
    let mut map = SurfaceMap::new(cell_m);
    for key_scan in key_scans {
        map.add_scan(&poses[key_scan.frame], &key_scan.scan);
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
