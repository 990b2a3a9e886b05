//! Fits every scan to the map of all key scans, once the loops are closed.

use super::StoredScan;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic};
use crate::scan_matcher::{MatcherConfig, PoseBelief, match_scan};
use crate::surface::{SurfaceMap, SurfaceScan, Thinning};
use rayon::prelude::*;
use std::borrow::Cow;

/// How far a scan may be off after the loops were closed: standard deviations, metres and radians.
const SIGMA_M: f64 = 0.05;
const SIGMA_RAD: f64 = 0.02;
/// A scan of which less than this share lies on the map is left where it was.
const MIN_INLIER_SHARE: f64 = 0.5;

/// The surfaces of so many scans are in memory at once (about 40 MB): those of a long drive are made again when they are
/// needed again.
const SCANS_AT_ONCE: usize = 8192;

/// The surfaces of all key scans.
pub(super) struct KeyScanSurfaces<'a> {
    scans: &'a [StoredScan],
    thinning: Thinning,
    at_once: usize,
    /// The first ones; all where these are not many.
    first: Vec<SurfaceScan>,
}

impl<'a> KeyScanSurfaces<'a> {
    pub(super) fn new(scans: &'a [StoredScan], thinning: Thinning) -> Self {
        Self::with_at_once(scans, thinning, SCANS_AT_ONCE)
    }

    fn with_at_once(scans: &'a [StoredScan], thinning: Thinning, at_once: usize) -> Self {
        let mut surfaces = Self { scans, thinning, at_once, first: Vec::new() };
        if scans.len() <= at_once {
            surfaces.first = surfaces.made(scans);
        }
        surfaces
    }

    fn made(&self, scans: &[StoredScan]) -> Vec<SurfaceScan> {
        scans.par_iter().map(|scan| SurfaceScan::new(&scan.points.unpack(), &self.thinning)).collect()
    }

    /// Some after others: each time the surfaces, and the poses that belong to them.
    fn pieces<'b>(&'b self, poses: &'b [Pose2]) -> impl Iterator<Item = (Cow<'b, [SurfaceScan]>, &'b [Pose2])> {
        self.scans.chunks(self.at_once).zip(poses.chunks(self.at_once)).map(|(scans, poses)| {
            let surfaces =
                if self.first.is_empty() { Cow::Owned(self.made(scans)) } else { Cow::Borrowed(&self.first[..]) };
            (surfaces, poses)
        })
    }

    /// The map that they make at poses, world from body.
    #[must_use]
    pub(super) fn map_at(&self, poses: &[Pose2], matcher: &MatcherConfig) -> SurfaceMap {
        let mut map = SurfaceMap::new(matcher.cell_m);
        for (scans, poses) in self.pieces(poses) {
            scans.iter().zip(poses).for_each(|(scan, pose)| map.add_scan(pose, scan));
        }
        map
    }

    /// The poses at which each fits a map best, near where it is.
    #[must_use]
    pub(super) fn refined(&self, map: &SurfaceMap, poses: &[Pose2], matcher: &MatcherConfig) -> Vec<Pose2> {
        self.pieces(poses).flat_map(|(scans, poses)| refine(map, &scans, poses, matcher)).collect()
    }
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

    use crate::compact_scan::CompactScan;

    #[test]
    fn every_scan_is_fitted_to_the_map_of_all() {
        let walls = Walls::room();
        let truth = poses_along(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0]], 0.1);
        let last = truth.len() - 1;
        let matcher = MatcherConfig::default();
        // The last one shows something else: its pose stays.
        let elsewhere = truth[last].compose(&Pose2::new(0.3, 0.9, 0.7));
        let seen_from = truth[..last].iter().chain([&elsewhere]);
        let stored = |(frame, pose): (usize, &Pose2)| StoredScan {
            frame,
            points: CompactScan::new(&walls.scan_from(pose, 361)),
            is_drawn: true,
        };
        let scans: Vec<StoredScan> = seen_from.enumerate().map(stored).collect();
        let surfaces = KeyScanSurfaces::new(&scans, matcher.thinning());
        let map = KeyScanSurfaces::new(&scans[..last], matcher.thinning()).map_at(&truth, &matcher);
        let moved = |(k, pose): (usize, &Pose2)| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            Pose2::new(pose.x + sign * 0.03, pose.y - 0.02, pose.theta + sign * 0.01)
        };
        let off: Vec<Pose2> = truth.iter().enumerate().map(moved).collect();
        let refined = surfaces.refined(&map, &off, &matcher);
        assert_eq!(refined.len(), off.len());
        assert_eq!(refined.last(), off.last());
        for (truth, pose) in truth.iter().zip(&refined).take(last) {
            assert!(truth.between(pose).distance() < 0.005, "{truth:?} {pose:?}");
        }
        assert_eq!(KeyScanSurfaces::new(&[], matcher.thinning()).map_at(&[], &matcher).surfaces().count(), 0);
        // How many are in memory at once changes nothing.
        let few = KeyScanSurfaces::with_at_once(&scans, matcher.thinning(), 3);
        assert_eq!(few.refined(&map, &off, &matcher), refined);
        let [all, of_few] = [&surfaces, &few].map(|surfaces| surfaces.map_at(&off, &matcher));
        assert!(all.surfaces().eq(of_few.surfaces()));
    }
}
