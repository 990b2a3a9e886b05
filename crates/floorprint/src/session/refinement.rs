//! Fits every scan to the map of all key scans, once the loops are closed.

use super::StoredScan;
use crate::StopSignal;
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
    /// Once it is given scans are left where they are.
    stop: &'a StopSignal,
    thinning: Thinning,
    limits: Limits,
    /// The surfaces of the first key scans.
    kept: Vec<SurfaceScan>,
    /// The map that was made last, where there is but one.
    map: Option<SurfaceMap>,
}

/// What keeps the memory bounded that this takes; nothing of it changes the results.
#[derive(Debug, Clone, Copy)]
struct Limits {
    kept_bytes: usize,
    scans_at_once: usize,
    scans_of_one_map: usize,
    region_m: f64,
}

/// A scan that is fitted: where it is, world from body, and how far it sees, metres.
type Fitted = (Pose2, f64);

/// Scans that are fitted to one map.
struct Region {
    /// The key scans that the map is made of, as far as these see.
    seen: Vec<usize>,
    /// Those that are fitted.
    fitted: Vec<usize>,
}

impl<'a> Refinement<'a> {
    pub(super) fn new(scans: &'a [StoredScan], matcher: &'a MatcherConfig, stop: &'a StopSignal) -> Self {
        let limits = Limits {
            kept_bytes: KEPT_BYTES,
            scans_at_once: SCANS_AT_ONCE,
            scans_of_one_map: SCANS_OF_ONE_MAP,
            region_m: REGION_M,
        };
        Self::within(scans, matcher, stop, limits)
    }

    fn within(scans: &'a [StoredScan], matcher: &'a MatcherConfig, stop: &'a StopSignal, limits: Limits) -> Self {
        let thinning = matcher.thinning();
        let mut refinement = Self { scans, matcher, stop, thinning, limits, kept: Vec::new(), map: None };
        let mut bytes = 0;
        for some in scans.chunks(limits.scans_at_once) {
            if bytes > limits.kept_bytes || stop.is_given() {
                break;
            }
            let surfaces: Vec<SurfaceScan> = some.par_iter().map(|scan| refinement.of(scan)).collect();
            bytes += surfaces.iter().map(|scan| scan.len() * size_of::<[f32; 4]>()).sum::<usize>();
            refinement.kept.extend(surfaces);
        }
        refinement
    }

    fn of(&self, scan: &StoredScan) -> SurfaceScan {
        SurfaceScan::new(&scan.points.unpack(), &self.thinning)
    }

    fn of_key_scan(&self, number: usize) -> Cow<'_, SurfaceScan> {
        match self.kept.get(number) {
            Some(kept) => Cow::Borrowed(kept),
            None => Cow::Owned(self.of(&self.scans[number])),
        }
    }

    /// The map that key scans make at their poses, world from body.
    fn map_of(&self, numbers: &[usize], poses: &[Pose2]) -> SurfaceMap {
        let mut map = SurfaceMap::new(self.matcher.cell_m);
        for some in numbers.chunks(self.limits.scans_at_once) {
            if self.stop.is_given() {
                break;
            }
            let surfaces: Vec<Cow<'_, SurfaceScan>> = some.par_iter().map(|&number| self.of_key_scan(number)).collect();
            some.iter().zip(&surfaces).for_each(|(&number, scan)| map.add_scan(&poses[number], scan));
        }
        map
    }

    /// The poses at which each key scan fits the map of all of them best, near where it is; world from body.
    #[must_use]
    pub(super) fn fitted(&mut self, poses: &[Pose2]) -> Vec<Pose2> {
        self.map = None;
        let fitted = |(scan, pose): (&StoredScan, &Pose2)| (*pose, self.reach_m(&scan.points));
        let fitted: Vec<Fitted> = self.scans.par_iter().zip(poses).map(fitted).collect();
        let (fitted, map) = self.each_fitted(poses, &fitted, |number| self.of_key_scan(number));
        self.map = map;
        fitted
    }

    /// Those of scans that have no say in the map, of which half of the points will do, to the map that the key scans made
    /// at their `poses` when these were [`fitted`](Self::fitted) last.
    #[must_use]
    pub(super) fn fitted_between(&self, poses: &[Pose2], between: &[(&CompactScan, Pose2)]) -> Vec<Pose2> {
        let halved = self.thinning.halved();
        let fitted = between.par_iter().map(|(points, pose)| (*pose, self.reach_m(points)));
        let fitted: Vec<Fitted> = fitted.collect();
        // They are many: their surfaces are made one by one.
        let surfaces = |number: usize| Cow::Owned(SurfaceScan::new(&between[number].0.unpack(), &halved));
        self.each_fitted(poses, &fitted, surfaces).0
    }

    /// Fits each scan to the map of the key scans; gives that, too, if it was made in one piece.
    fn each_fitted<'s>(
        &self,
        poses: &[Pose2],
        scans: &[Fitted],
        surfaces: impl Fn(usize) -> Cow<'s, SurfaceScan> + Sync,
    ) -> (Vec<Pose2>, Option<SurfaceMap>) {
        let fit = |map: &SurfaceMap, number: usize| {
            let pose = &scans[number].0;
            if self.stop.is_given() { *pose } else { fitted(map, &surfaces(number), pose, self.matcher) }
        };
        if self.is_one_map() {
            let made = self.map.is_none().then(|| self.map_of(&(0..poses.len()).collect::<Vec<_>>(), poses));
            let found = match made.as_ref().or(self.map.as_ref()) {
                Some(map) => (0..scans.len()).into_par_iter().map(|number| fit(map, number)).collect(),
                None => Vec::new(),
            };
            return (found, made);
        }
        let mut all: Vec<Pose2> = scans.iter().map(|(pose, _)| *pose).collect();
        for region in self.regions(poses, scans) {
            let map = self.map_of(&region.seen, poses);
            let found: Vec<Pose2> = region.fitted.par_iter().map(|&number| fit(&map, number)).collect();
            region.fitted.iter().zip(found).for_each(|(&number, pose)| all[number] = pose);
        }
        (all, None)
    }

    fn is_one_map(&self) -> bool {
        self.scans.len() <= self.limits.scans_of_one_map
    }

    /// How far a scan sees, where that is asked for.
    fn reach_m(&self, points: &CompactScan) -> f64 {
        if self.is_one_map() { f64::INFINITY } else { points.unpack().reach_m() }
    }

    /// Which scans are fitted to one map: those in a square, so that the map of a long drive is never there in one piece.
    fn regions(&self, poses: &[Pose2], scans: &[Fitted]) -> Vec<Region> {
        let side_m = self.limits.region_m;
        let mut squares: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for (number, (pose, _)) in scans.iter().enumerate() {
            let square = [pose.x, pose.y].map(|coordinate| (coordinate / side_m).floor() as i64);
            squares.entry(square).or_default().push(number);
        }
        let reaches_m: Vec<f64> = self.scans.par_iter().map(|scan| self.reach_m(&scan.points)).collect();
        let region = |([column, row], fitted): ([i64; 2], Vec<usize>)| {
            let looked_at_m = fitted.iter().map(|&number| scans[number].1).fold(0.0, f64::max) + FARTHEST_MOVE_M;
            let away_m = |coordinate: f64, number: i64| {
                let low_m = number as f64 * side_m;
                (low_m - coordinate).max(coordinate - low_m - side_m).max(0.0)
            };
            let is_seen = |&number: &usize| {
                let pose = &poses[number];
                away_m(pose.x, column).hypot(away_m(pose.y, row)) < looked_at_m + reaches_m[number]
            };
            Region { seen: (0..poses.len()).filter(is_seen).collect(), fitted }
        };
        squares.into_iter().map(region).collect()
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
        let (last, matcher, never) = (truth.len() - 1, MatcherConfig::default(), StopSignal::default());
        let scans = stored(&truth);
        let mut refinement = Refinement::new(&scans, &matcher, &never);
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
        let of_key_scans = refinement.fitted(&off);
        let of_between = refinement.fitted_between(&off, &between);
        let map = refinement.map_of(&(0..scans.len()).collect::<Vec<_>>(), &off);
        let fits = refinement.kept.iter().zip(&off).map(|(scan, pose)| fitted(&map, scan, pose, &matcher));
        assert_eq!(of_key_scans, fits.collect::<Vec<_>>());
        assert_ne!(of_key_scans, off);
        let half = SurfaceScan::new(&scans[3].points.unpack(), &matcher.thinning().halved());
        assert_eq!(of_between, [fitted(&map, &half, &off[4], &matcher)]);
        assert!(Refinement::new(&[], &matcher, &never).fitted(&[]).is_empty());
    }

    #[test]
    fn how_memory_is_bounded_changes_nothing() {
        let mut truth = poses_along(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0]], 0.1);
        let (scans, matcher) = ([stored(&truth), stored(&truth)].concat(), MatcherConfig::default());
        let never = StopSignal::default();
        // A second room beyond what can be seen from the first.
        truth.extend(truth.clone().iter().map(|pose| Pose2::new(pose.x + 40.0, pose.y, pose.theta)));
        let off = moved(&truth);
        let between = [(&scans[3].points, off[4]), (&scans[5].points, off[off.len() - 4])];
        let mut all = Refinement::new(&scans, &matcher, &never);
        let limits = Limits { kept_bytes: 30_000, scans_at_once: 3, scans_of_one_map: 5, region_m: 1.5 };
        let mut few = Refinement::within(&scans, &matcher, &never, limits);
        assert!(few.kept.len() < scans.len() / 2 && all.kept.len() == scans.len());
        let fitted: Vec<Fitted> = off.iter().map(|pose| (*pose, 3.0)).collect();
        let regions = few.regions(&off, &fitted);
        assert!(regions.len() > 3 && regions.iter().all(|region| region.seen.len() < scans.len()));
        assert_eq!(few.fitted(&off), all.fitted(&off));
        assert_eq!(few.fitted_between(&off, &between), all.fitted_between(&off, &between));
    }
}
