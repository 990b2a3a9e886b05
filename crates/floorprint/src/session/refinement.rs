//! Fits every scan to the map of all key scans, once the loops are closed.

use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic};
use crate::scan_matcher::{MatcherConfig, PoseBelief, match_scan};
use crate::surface::{SurfaceMap, SurfaceScan};
use rayon::prelude::*;

/// How far a scan may be off after the loops were closed: standard deviations, metres and radians.
const SIGMA_M: f64 = 0.05;
const SIGMA_RAD: f64 = 0.02;
/// A scan of which less than this share lies on the map is left where it was.
const MIN_INLIER_SHARE: f64 = 0.5;

/// The map that scans make at their poses, world from body.
#[must_use]
pub(super) fn map_of(scans: &[SurfaceScan], poses: &[Pose2], matcher: &MatcherConfig) -> SurfaceMap {
    let mut map = SurfaceMap::new(matcher.cell_m);
    for (scan, pose) in scans.iter().zip(poses) {
        map.add_scan(pose, scan);
    }
    map
}

/// The poses at which each scan fits a map best, near where it is.
#[must_use]
pub(super) fn refine(map: &SurfaceMap, scans: &[SurfaceScan], poses: &[Pose2], matcher: &MatcherConfig) -> Vec<Pose2> {
    let information = inverse(&isotropic(SIGMA_M, SIGMA_RAD));
    scans
        .par_iter()
        .zip(poses)
        .map(|(scan, pose)| {
            let found = match_scan(map, scan, &PoseBelief { pose: *pose, information }, matcher);
            if found.inlier_share < MIN_INLIER_SHARE { *pose } else { found.belief.pose }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::{Walls, poses_along};

    #[test]
    fn every_scan_is_fitted_to_the_map_of_all() {
        let walls = Walls::room();
        let truth = poses_along(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0]], 0.1);
        let matcher = MatcherConfig::default();
        let scan = |pose: &Pose2| SurfaceScan::new(&walls.scan_from(pose, 361), &matcher.thinning());
        let mut scans: Vec<SurfaceScan> = truth.iter().map(scan).collect();
        let map = map_of(&scans, &truth, &matcher);
        let moved = |(k, pose): (usize, &Pose2)| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            Pose2::new(pose.x + sign * 0.03, pose.y - 0.02, pose.theta + sign * 0.01)
        };
        let off: Vec<Pose2> = truth.iter().enumerate().map(moved).collect();
        // The last one shows something else: its pose stays.
        let last = scans.len() - 1;
        scans[last] = scans[last].seen_from(&Pose2::new(0.3, 0.9, 0.7));
        let refined = refine(&map, &scans, &off, &matcher);
        assert_eq!(refined.len(), off.len());
        assert_eq!(refined.last(), off.last());
        for (truth, pose) in truth.iter().zip(&refined).take(last) {
            assert!(truth.between(pose).distance() < 0.005, "{truth:?} {pose:?}");
        }
        assert_eq!(map_of(&[], &[], &matcher).surfaces().count(), 0);
    }
}
