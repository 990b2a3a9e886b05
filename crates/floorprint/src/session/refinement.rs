//! Fits every scan to the map of all key scans, once the loops are closed.

use super::StoredScan;
use crate::compact_scan::CompactScan;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic};
use crate::scan_matcher::{MatcherConfig, PoseBelief, match_scan};
use crate::surface::{SurfaceMap, SurfaceScan, Thinning};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// How far a scan may be off after the loops were closed: standard deviations, metres and radians.
const SIGMA_M: f64 = 0.05;
const SIGMA_RAD: f64 = 0.02;
/// A scan of which less than this share lies on the map is left where it was.
const MIN_INLIER_SHARE: f64 = 0.5;

/// Surfaces of key scans stay in memory up to so many bytes; those of the others are made each time they are needed.
const KEPT_BYTES: usize = 24 << 20;
/// Surfaces of so many scans are made at once.
const SCANS_AT_ONCE: usize = 1024;
/// The map of more key scans than these (some 8 km of new ground: 100 MB) is made region by region …
const SCANS_OF_ONE_MAP: usize = 50_000;
/// … which are squares with this side, metres.
const REGION_M: f64 = 128.0;
/// A fit moves no point by more than this, metres.
const FARTHEST_MOVE_M: f64 = 10.0;

/// Fits scans to the map that all key scans make.
pub(super) struct Refinement<'a> {
    scans: &'a [StoredScan],
    matcher: &'a MatcherConfig,
    thinning: Thinning,
    limits: Limits,
    /// The surfaces of the first key scans.
    kept: Vec<SurfaceScan>,
}

/// What keeps the memory bounded that this takes; nothing of it changes the results.
#[derive(Debug, Clone, Copy)]
struct Limits {
    kept_bytes: usize,
    scans_at_once: usize,
    scans_of_one_map: usize,
    region_m: f64,
}

/// Scans that are fitted to one map.
struct Region {
    /// The key scans that the map is made of, as far as these see.
    seen: Vec<usize>,
    key_scans: Vec<usize>,
    between: Vec<usize>,
}

impl<'a> Refinement<'a> {
    pub(super) fn new(scans: &'a [StoredScan], matcher: &'a MatcherConfig) -> Self {
        let limits = Limits {
            kept_bytes: KEPT_BYTES,
            scans_at_once: SCANS_AT_ONCE,
            scans_of_one_map: SCANS_OF_ONE_MAP,
            region_m: REGION_M,
        };
        Self::within(scans, matcher, limits)
    }

    fn within(scans: &'a [StoredScan], matcher: &'a MatcherConfig, limits: Limits) -> Self {
        let mut refinement = Self { scans, matcher, thinning: matcher.thinning(), limits, kept: Vec::new() };
        let mut bytes = 0;
        for some in scans.chunks(limits.scans_at_once) {
            if bytes > limits.kept_bytes {
                break;
            }
            let surfaces: Vec<SurfaceScan> = some.par_iter().map(|scan| refinement.surfaces(&scan.points)).collect();
            bytes += surfaces.iter().map(|scan| scan.len() * size_of::<[f32; 4]>()).sum::<usize>();
            refinement.kept.extend(surfaces);
        }
        refinement
    }

    fn surfaces(&self, points: &CompactScan) -> SurfaceScan {
        SurfaceScan::new(&points.unpack(), &self.thinning)
    }

    fn of_key_scan(&self, number: usize) -> Cow<'_, SurfaceScan> {
        match self.kept.get(number) {
            Some(kept) => Cow::Borrowed(kept),
            None => Cow::Owned(self.surfaces(&self.scans[number].points)),
        }
    }

    /// The map that key scans make at their poses, world from body.
    fn map_of(&self, numbers: &[usize], poses: &[Pose2]) -> SurfaceMap {
        let mut map = SurfaceMap::new(self.matcher.cell_m);
        for some in numbers.chunks(self.limits.scans_at_once) {
            let surfaces: Vec<Cow<'_, SurfaceScan>> = some.par_iter().map(|&number| self.of_key_scan(number)).collect();
            some.iter().zip(&surfaces).for_each(|(&number, scan)| map.add_scan(&poses[number], scan));
        }
        map
    }

    /// The poses at which each key scan fits the map of all of them best, near where it is; and those of scans between
    /// them, which have no say in the map. All poses are world from body.
    #[must_use]
    pub(super) fn fitted(&self, poses: &[Pose2], between: &[(&CompactScan, Pose2)]) -> (Vec<Pose2>, Vec<Pose2>) {
        let (mut of_key_scans, mut of_between) =
            (poses.to_vec(), between.iter().map(|(_, pose)| *pose).collect::<Vec<_>>());
        for Region { seen, key_scans, between: these } in self.regions(poses, between) {
            let map = self.map_of(&seen, poses);
            let fit = |scan: &SurfaceScan, pose: &Pose2| fitted(&map, scan, pose, self.matcher);
            let found: Vec<Pose2> =
                key_scans.par_iter().map(|&number| fit(&self.of_key_scan(number), &poses[number])).collect();
            key_scans.iter().zip(found).for_each(|(&number, pose)| of_key_scans[number] = pose);
            let found: Vec<Pose2> =
                these.par_iter().map(|&number| fit(&self.surfaces(between[number].0), &between[number].1)).collect();
            these.iter().zip(found).for_each(|(&number, pose)| of_between[number] = pose);
        }
        (of_key_scans, of_between)
    }

    /// Which scans are fitted to one map: those in a square, so that the map of a long drive is never there in one piece.
    fn regions(&self, poses: &[Pose2], between: &[(&CompactScan, Pose2)]) -> Vec<Region> {
        if poses.len() <= self.limits.scans_of_one_map {
            let all: Vec<usize> = (0..poses.len()).collect();
            return vec![Region { seen: all.clone(), key_scans: all, between: (0..between.len()).collect() }];
        }
        let side_m = self.limits.region_m;
        let mut regions: BTreeMap<[i64; 2], [Vec<usize>; 2]> = BTreeMap::new();
        let square = |pose: &Pose2| [pose.x, pose.y].map(|coordinate| (coordinate / side_m).floor() as i64);
        for (number, pose) in poses.iter().enumerate() {
            regions.entry(square(pose)).or_default()[0].push(number);
        }
        for (number, (_, pose)) in between.iter().enumerate() {
            regions.entry(square(pose)).or_default()[1].push(number);
        }
        let reach_m: Vec<f64> = self.scans.par_iter().map(|scan| scan.points.unpack().reach_m()).collect();
        let of_between = |&number: &usize| between[number].0.unpack().reach_m();
        let region = |([column, row], [key_scans, between]): ([i64; 2], [Vec<usize>; 2])| {
            let reaches_m = key_scans.iter().map(|&number| reach_m[number]).chain(between.iter().map(of_between));
            let looked_at_m = reaches_m.fold(0.0, f64::max) + FARTHEST_MOVE_M;
            let away_m = |coordinate: f64, number: i64| {
                let low_m = number as f64 * side_m;
                (low_m - coordinate).max(coordinate - low_m - side_m).max(0.0)
            };
            let is_seen = |number: &usize| {
                let pose = &poses[*number];
                away_m(pose.x, column).hypot(away_m(pose.y, row)) < looked_at_m + reach_m[*number]
            };
            Region { seen: (0..poses.len()).filter(is_seen).collect(), key_scans, between }
        };
        regions.into_iter().map(region).collect()
    }
}

/// The pose at which a scan fits a map best, near where it is.
fn fitted(map: &SurfaceMap, scan: &SurfaceScan, pose: &Pose2, matcher: &MatcherConfig) -> Pose2 {
    let information = inverse(&isotropic(SIGMA_M, SIGMA_RAD));
    let found = match_scan(map, scan, &PoseBelief { pose: *pose, information }, matcher);
    if found.inlier_share < MIN_INLIER_SHARE { *pose } else { found.belief.pose }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::{Walls, poses_along};

    fn stored(poses: &[Pose2]) -> Vec<StoredScan> {
        let scan = |(frame, pose): (usize, &Pose2)| {
            let points = CompactScan::new(&Walls::room().scan_from(pose, 361));
            StoredScan { frame, points, is_drawn: true }
        };
        poses.iter().enumerate().map(scan).collect()
    }

    fn moved(poses: &[Pose2]) -> Vec<Pose2> {
        let moved = |(k, pose): (usize, &Pose2)| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            Pose2::new(pose.x + sign * 0.03, pose.y - 0.02, pose.theta + sign * 0.01)
        };
        poses.iter().enumerate().map(moved).collect()
    }

    #[test]
    fn every_scan_is_fitted_to_the_map_of_all() {
        let truth = poses_along(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0]], 0.1);
        let (last, matcher) = (truth.len() - 1, MatcherConfig::default());
        let mut scans = stored(&truth);
        let refinement = Refinement::new(&scans, &matcher);
        let map = refinement.map_of(&(0..scans.len()).collect::<Vec<_>>(), &truth);
        let off = moved(&truth);
        for (scan, (truth, off)) in refinement.kept.iter().zip(truth.iter().zip(&off)) {
            assert!(truth.between(&fitted(&map, scan, off, &matcher)).distance() < 0.005);
        }
        // One that shows something else stays where it is.
        let other = refinement.kept[last].seen_from(&Pose2::new(0.3, 0.9, 0.7));
        assert_eq!(fitted(&map, &other, &off[last], &matcher), off[last]);
        // They are fitted to the map that they make where they are, and so is what was seen between them.
        let between = [(&scans[3].points, off[4])];
        let (of_key_scans, of_between) = refinement.fitted(&off, &between);
        let map = refinement.map_of(&(0..scans.len()).collect::<Vec<_>>(), &off);
        let fits = refinement.kept.iter().zip(&off).map(|(scan, pose)| fitted(&map, scan, pose, &matcher));
        assert_eq!(of_key_scans, fits.collect::<Vec<_>>());
        assert_ne!(of_key_scans, off);
        assert_eq!(of_between[0], fitted(&map, &refinement.kept[3], &off[4], &matcher));
        scans.clear();
        assert!(Refinement::new(&scans, &matcher).fitted(&[], &[]).0.is_empty());
    }

    #[test]
    fn how_memory_is_bounded_changes_nothing() {
        let mut truth = poses_along(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0]], 0.1);
        let (scans, matcher) = ([stored(&truth), stored(&truth)].concat(), MatcherConfig::default());
        // A second room beyond what can be seen from the first.
        truth.extend(truth.clone().iter().map(|pose| Pose2::new(pose.x + 40.0, pose.y, pose.theta)));
        let off = moved(&truth);
        let between = [(&scans[3].points, off[4]), (&scans[5].points, off[off.len() - 4])];
        let all = Refinement::new(&scans, &matcher);
        let limits = Limits { kept_bytes: 30_000, scans_at_once: 3, scans_of_one_map: 5, region_m: 1.5 };
        let few = Refinement::within(&scans, &matcher, limits);
        assert!(few.kept.len() < scans.len() / 2 && all.kept.len() == scans.len());
        let regions = few.regions(&off, &between);
        assert!(regions.len() > 3 && regions.iter().all(|region| region.seen.len() < scans.len()));
        assert_eq!(few.fitted(&off, &between), all.fitted(&off, &between));
    }
}
