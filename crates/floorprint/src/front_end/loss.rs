//! Notices that the robot is not where its scans were matched.
//!
//! Scans that contradict the map, or show other things than were to be seen, are not written. When contradictions do not cease
//! the robot is lost, and the map begins anew; where on the old map that is, is for the back end to find out. When the others do
//! not, the robot is suspected to have been carried, and the map goes on.

use super::local_map::LocalMap;
use crate::geometry::Pose2;
use crate::scan_matcher::{MatchResult, MatcherConfig, inlier_share, outliers};
use crate::surface::{SurfaceMap, SurfaceScan};
use serde::{Deserialize, Serialize};

/// A scan of which less than this share lies on the map does not fit it …
const LOST_INLIER_SHARE: f64 = 0.55;
/// … if it has at least this share of the points that a scan may have, within bounds; the robot is lost when so many scans in
/// a row do not fit.
const LEAST_POINTS_SHARE: f64 = 0.1;
const LEAST_POINTS: [usize; 2] = [12, 30];
const MISFITS_BEFORE_LOSS: usize = 3;
/// Nor does one that suddenly lies on the map by this much less.
const SUDDEN_LOSS: f64 = 0.28;
/// Among trees and crowds less fits at times, and nothing has happened: what is this many standard deviations below the mean
/// of the drive so far is not ordinary.
const EXTRAORDINARY: f64 = 2.5;
/// … of which a drive whose scans fit evenly has at least this.
const LEAST_SIGMA: f64 = 0.03;
/// Share of the newest scan in that mean.
const NEWEST: f64 = 0.05;
/// Either contradicts the map only if, of what it and the last scan in the map both had in view, more than this share lies on
/// nothing known. People and doors come to less, come little by little, or only add to what was there; and who turns sees new
/// things …
const MISSING_SHARE: f64 = 0.25;
/// … beyond so many times what ordinary scans of the drive miss: among trees and of walls that few rays hit, far from each
/// other, there is always some of it …
const ORDINARILY_MISSED: f64 = 2.0;
/// … or if the other scan looked through more than this share of what was in view, beyond half of what is ordinarily missed:
/// there it would have hit something.
const LOOKED_THROUGH_SHARE: f64 = 0.2;
const ORDINARILY_LOOKED_THROUGH: f64 = 0.5;
/// A ray that ends so far behind a surface looked through it, metres.
const BEHIND_M: f32 = 0.3;
/// So much at least of what the last scan showed must be gone.
const LEAST_GONE_SHARE: f64 = 0.1;
/// Where the last scan had its surfaces too far off to be looked through, it must have looked through so much of the new one.
const LOOKED_THROUGH_SHARE_ONE_WAY: f64 = 0.5;
/// A map of fewer scans than this says little about what is to be seen: a robot that has just begun sees new things.
const MATURE_SCANS: usize = 6;
/// A scan that fits worse than is ordinary, and not where the odometry has the robot, is suspicious by itself; but where the
/// odometry was contradicted by one of so many scans before, that is ordinary, too: wheels slip.
const CALM_SCANS: usize = 20;
/// So are several in a row, whatever the odometry says. To them a scan belongs of which this many standard deviations less lies
/// on the map than is ordinary, if of what the last scan showed so much is gone, and as much less lies on the map of what that
/// had had in view …
const SUSPICIOUS: f64 = 3.0;
/// … or if together with the last scan it looked through more than this share of what both had in view, beyond half of what is
/// ordinarily missed.
const SUSPICIOUSLY_LOOKED_THROUGH_SHARE: f64 = 0.08;
/// Of how many of its points chance decides alike: they lie on one thing, which is there or is not.
const POINTS_OF_ONE_THING: f64 = 5.0;
/// Of fewer points nothing can be told.
const LEAST_SUSPICIOUS_POINTS: usize = 12;

/// What a scan says about where the robot is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sighting {
    /// Nothing speaks against where it was matched; so many scans before it had not fitted.
    Fits { misfits_before: usize },
    /// Not enough speaks against it to contradict the map, but it or the so many before it fit worse than is ordinary for the
    /// drive, and not where the odometry has the robot, or several in a row show other things than were to be seen: that
    /// happens when the robot was carried to where much looks alike.
    Suspicious { misfits_before: usize },
    /// It contradicts the map, or shows other things.
    Misfits,
    /// Too many scans in a row contradict it: `scans` of them, this one included; `is_certain` where nothing fitted any more.
    Lost { scans: usize, is_certain: bool },
}

/// Counts scans that contradict the map.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct LossDetector {
    /// How many scans in a row did not fit the map.
    misfits: usize,
    /// Whether each of them contradicts it beyond doubt.
    is_certain: bool,
    /// … and whether each contradicts it at all, and does not only show other things.
    #[serde(default)]
    is_contradiction: bool,
    /// Whether one of them, or the newest scan, is suspicious by itself.
    #[serde(default)]
    is_suspicious: bool,
    /// How many scans there were since the last one that contradicted the odometry.
    #[serde(default)]
    calm_scans: usize,
    /// Share of the last scan that fitted which lay on the map.
    usual_inlier_share: f64,
    #[serde(default)]
    ordinary: OrdinaryShare,
}

/// Which share of a scan ordinarily lies on the map: mean and variance over the drive, to which what is extraordinary counts as
/// at the limit of what is ordinary (a Winsorised mean), so that a few scans at a place where nothing fits do not make it
/// ordinary that nothing fits.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct OrdinaryShare {
    mean: f64,
    variance: f64,
}

impl OrdinaryShare {
    fn learn(&mut self, share: f64) {
        if self.mean == 0.0 {
            self.mean = share;
            return;
        }
        let most = SUSPICIOUS * self.variance.sqrt().max(LEAST_SIGMA);
        let off = (share - self.mean).clamp(-most, most);
        self.mean += NEWEST * off;
        self.variance += NEWEST * (off * off - self.variance);
    }

    /// Whether the share is smaller than is ordinary, even if chance had decided of so many points.
    fn is_far_above(&self, share: f64, points: usize) -> bool {
        let likely = self.mean.clamp(0.1, 0.9);
        let by_chance = likely * (1.0 - likely) / (points as f64 / POINTS_OF_ONE_THING).max(1.0);
        let sigma = (self.variance.max(LEAST_SIGMA * LEAST_SIGMA) + by_chance).sqrt();
        points >= LEAST_SUSPICIOUS_POINTS && self.mean - share > SUSPICIOUS * sigma
    }
}

impl LossDetector {
    /// Hears of the next scan and how it was matched to the map, if there was one, and whether that contradicts the odometry.
    pub(super) fn observe(
        &mut self,
        scan: &SurfaceScan,
        fit: Option<&MatchResult>,
        contradicts_odometry: bool,
        map: &LocalMap,
        matcher: &MatcherConfig,
    ) -> Sighting {
        let fit = fit.filter(|_| scan.len() >= least_points(matcher) && map.scans() >= MATURE_SCANS);
        let is_contradicted = fit.map_or(Some(false), |fit| self.is_contradicted_by(scan, fit, map, matcher));
        let is_elsewhere = contradicts_odometry && self.calm_scans >= CALM_SCANS;
        self.calm_scans = if contradicts_odometry { 0 } else { self.calm_scans.saturating_add(1) };
        let is_suspicious = fit.is_some_and(|fit| is_elsewhere && self.is_extraordinary(scan, fit, map, matcher));
        self.is_suspicious |= is_suspicious;
        // What contradicts the map need not be asked for less.
        let may_show_other_things = !is_suspicious && is_contradicted != Some(true);
        let shows_other_things =
            may_show_other_things && fit.is_some_and(|fit| self.shows_other_things(scan, fit, map, matcher));
        fit.iter().for_each(|fit| self.ordinary.learn(fit.inlier_share));
        // Scans of which nothing can be told leave it at what those before said, if that was a contradiction.
        let is_misfit = is_contradicted.unwrap_or(self.misfits > 0 && self.is_contradiction);
        let Some(fit) = fit.filter(|_| is_misfit || shows_other_things) else {
            let misfits_before = std::mem::take(&mut self.misfits);
            if std::mem::take(&mut self.is_suspicious) {
                self.usual_inlier_share = 0.0;
                return Sighting::Suspicious { misfits_before };
            }
            self.usual_inlier_share = fit.map_or(0.0, |fit| fit.inlier_share);
            return Sighting::Fits { misfits_before };
        };
        let (is_first, is_certain) =
            (self.misfits == 0, is_contradicted.is_some() && fit.inlier_share < LOST_INLIER_SHARE);
        self.is_certain = is_certain && (is_first || self.is_certain);
        self.is_contradiction = is_misfit && (is_first || self.is_contradiction);
        self.misfits += 1;
        if self.misfits < MISFITS_BEFORE_LOSS {
            return Sighting::Misfits;
        }
        (self.usual_inlier_share, self.is_suspicious) = (0.0, false);
        let scans = std::mem::take(&mut self.misfits);
        if self.is_contradiction {
            Sighting::Lost { scans, is_certain: self.is_certain }
        } else {
            Sighting::Suspicious { misfits_before: scans - 1 }
        }
    }

    /// Whether less of a scan lies on the map than is ordinary for the drive, and less of what the map had had in view, too:
    /// what is new is no reason for doubt.
    fn is_extraordinary(&self, scan: &SurfaceScan, fit: &MatchResult, map: &LocalMap, matcher: &MatcherConfig) -> bool {
        let OrdinaryShare { mean, variance } = self.ordinary;
        let least = mean - EXTRAORDINARY * variance.sqrt().max(LEAST_SIGMA);
        if fit.inlier_share >= least {
            return false;
        }
        let pose = &fit.belief.pose;
        let known = map.had_in_view(pose, scan);
        known.len() >= 2 * least_points(matcher) && inlier_share(map.surfaces(), &known, pose, matcher) < least
    }

    /// Whether less of a scan lies on the map than is ordinary for the drive, and not because it shows what had not been in view,
    /// nor because something was added to what had been.
    fn shows_other_things(
        &self,
        scan: &SurfaceScan,
        fit: &MatchResult,
        map: &LocalMap,
        matcher: &MatcherConfig,
    ) -> bool {
        let MatchResult { belief, inlier_share: share, .. } = fit;
        let last = map.last().filter(|_| self.ordinary.is_far_above(*share, scan.len()));
        let Some((last_pose, last)) = last else { return false };
        let both = Overlap::of([scan, last], [&belief.pose, last_pose], map, matcher);
        // Who comes along adds to what was there, at first.
        let is_replaced = self.misfits > 0 || both.is_something_gone() || both.is_mostly_seen_through();
        if both.points() < 2 * LEAST_SUSPICIOUS_POINTS || !is_replaced {
            return false;
        }
        let ordinary = ORDINARILY_LOOKED_THROUGH * (1.0 - self.ordinary.mean);
        if both.share(both.looked_through()) > SUSPICIOUSLY_LOOKED_THROUGH_SHARE + ordinary {
            return true;
        }
        let known = map.had_in_view(&belief.pose, scan);
        self.ordinary.is_far_above(inlier_share(map.surfaces(), &known, &belief.pose, matcher), known.len())
    }

    /// The robot may be anywhere: of what went before nothing counts.
    pub(super) fn lose(&mut self) -> Sighting {
        (self.usual_inlier_share, self.is_suspicious) = (0.0, false);
        Sighting::Lost { scans: 1 + std::mem::take(&mut self.misfits), is_certain: false }
    }

    /// Whether a scan shows that the robot is not where it was matched: little of it lies on the map there, or suddenly less
    /// than before, and of what it and the last scan in the map both had in view much is missing. A robot that turns to what
    /// it has not seen yet contradicts nothing; and in a corridor much fits that is somewhere else. `None` where too little
    /// was in view of both.
    fn is_contradicted_by(
        &self,
        scan: &SurfaceScan,
        fit: &MatchResult,
        map: &LocalMap,
        matcher: &MatcherConfig,
    ) -> Option<bool> {
        let ordinary = self.ordinary.mean - EXTRAORDINARY * self.ordinary.variance.sqrt();
        let is_usual = fit.inlier_share >= LOST_INLIER_SHARE.max(self.usual_inlier_share - SUDDEN_LOSS).min(ordinary);
        let Some((last_pose, last)) = map.last().filter(|_| !is_usual) else { return Some(false) };
        let pose = &fit.belief.pose;
        let both = Overlap::of([scan, last], [pose, last_pose], map, matcher);
        if both.points() < 2 * least_points(matcher) {
            return None;
        }
        if both.there < least_points(matcher) {
            return Some(both.is_mostly_seen_through());
        }
        let ordinary = 1.0 - self.ordinary.mean;
        let is_much = both.share(both.new + both.gone) > MISSING_SHARE + ORDINARILY_MISSED * ordinary
            || both.share(both.looked_through()) > LOOKED_THROUGH_SHARE + ORDINARILY_LOOKED_THROUGH * ordinary;
        Some(is_much && both.is_something_gone())
    }
}

/// What a scan and the last one in the map show of what both had in view: numbers of points.
struct Overlap {
    /// Points of the scan that the last one had in view …
    here: usize,
    /// … of these those that lie on nothing known …
    new: usize,
    /// … and of these those that the last one looked through.
    seen_through: usize,
    /// Points of the last scan that the scan had in view …
    there: usize,
    /// … of these those that the scan does not show …
    gone: usize,
    /// … and of these those that it looked through.
    gone_through: usize,
}

impl Overlap {
    fn of(
        [scan, last]: [&SurfaceScan; 2],
        [pose, last_pose]: [&Pose2; 2],
        map: &LocalMap,
        matcher: &MatcherConfig,
    ) -> Self {
        let here = scan.in_view_of(pose, last, last_pose);
        let there = last.in_view_of(last_pose, scan, pose);
        let new = outliers(map.surfaces(), &here, pose, matcher);
        let mut of_scan = SurfaceMap::new(matcher.cell_m);
        of_scan.add_scan(pose, scan);
        let gone = outliers(&of_scan, &there, last_pose, matcher);
        Self {
            here: here.len(),
            new: new.len(),
            seen_through: new.looked_through_by(pose, last, last_pose, BEHIND_M).len(),
            there: there.len(),
            gone: gone.len(),
            gone_through: gone.looked_through_by(last_pose, scan, pose, BEHIND_M).len(),
        }
    }

    fn is_mostly_seen_through(&self) -> bool {
        self.seen_through as f64 > LOOKED_THROUGH_SHARE_ONE_WAY * self.here as f64
    }

    fn is_something_gone(&self) -> bool {
        self.gone as f64 > LEAST_GONE_SHARE * self.there as f64
    }

    fn points(&self) -> usize {
        self.here + self.there
    }

    fn looked_through(&self) -> usize {
        self.seen_through + self.gone_through
    }

    fn share(&self, points: usize) -> f64 {
        points as f64 / self.points() as f64
    }
}

/// Fewer points than this say nothing.
fn least_points(matcher: &MatcherConfig) -> usize {
    let [least, most] = LEAST_POINTS;
    ((LEAST_POINTS_SHARE * matcher.max_points as f64) as usize).clamp(least, most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::scan_matcher::PoseBelief;
    use crate::scan_matcher::synthetic::Walls;
    use crate::surface::Thinning;
    use nalgebra::Matrix3;
    use std::sync::Arc;

    /// What is seen from the middle of a room of 6 m whose western and eastern walls, 8 m apart, have moved to the east.
    fn seen(moved_m: f64) -> Arc<SurfaceScan> {
        let [west, east] = [-4.0, 4.0].map(|x_m: f64| x_m + moved_m);
        let room = Walls::default().with_loop(&[[west, -3.0], [east, -3.0], [east, 3.0], [west, 3.0]]);
        Arc::new(SurfaceScan::new(&room.scan_from(&Pose2::IDENTITY, 361), &Thinning::default()))
    }

    /// The map of that room before anything moved.
    fn map() -> LocalMap {
        let mut map = LocalMap::new(MatcherConfig::default().cell_m, 20.0);
        let scan = seen(0.0);
        (0..MATURE_SCANS).for_each(|_| map.write(&Pose2::IDENTITY, &scan, scan.view_m(), false));
        map
    }

    /// A drive of which so much of scans ordinarily lies on the map.
    fn drive(ordinary_share: f64) -> LossDetector {
        let ordinary = OrdinaryShare { mean: ordinary_share, variance: 0.0 };
        LossDetector { usual_inlier_share: 1.0, ordinary, calm_scans: CALM_SCANS, ..LossDetector::default() }
    }

    impl LossDetector {
        /// What is said of a scan from the middle of the room.
        fn hear_of(&mut self, scan: &SurfaceScan, map: &LocalMap) -> Sighting {
            self.hear_of_where(scan, map, false)
        }

        /// The same, whether or not the odometry has the robot elsewhere.
        fn hear_of_where(&mut self, scan: &SurfaceScan, map: &LocalMap, contradicts_odometry: bool) -> Sighting {
            let matcher = MatcherConfig::default();
            let fit = MatchResult {
                belief: PoseBelief { pose: Pose2::IDENTITY, information: Matrix3::identity() },
                scan_information: Matrix3::identity(),
                inlier_share: inlier_share(map.surfaces(), scan, &Pose2::IDENTITY, &matcher),
                score: -1.0,
            };
            self.observe(scan, Some(&fit), contradicts_odometry, map, &matcher)
        }
    }

    #[test]
    fn what_contradicts_the_map_is_what_is_not_ordinary_for_the_drive() {
        let (map, fits) = (map(), Sighting::Fits { misfits_before: 0 });
        let sighting = |moved_m: f64, ordinary_share| drive(ordinary_share).hear_of(&seen(moved_m), &map);
        assert_eq!(sighting(0.0, 1.0), fits);
        // Two walls are elsewhere, but so near that no ray looked through them: that happens where a third is always missing.
        assert_eq!(sighting(0.2, 1.0), Sighting::Misfits);
        assert_eq!(sighting(0.2, 0.7), fits);
        // What was looked through would have been hit, whatever is ordinary.
        assert_eq!(sighting(1.0, 1.0), Sighting::Misfits);
        assert_eq!(sighting(1.0, 0.8), Sighting::Misfits);
    }

    #[test]
    fn what_is_missing_and_not_where_the_odometry_has_it_is_suspicious() {
        let map = map();
        let sighting = |mut drive: LossDetector, moved_m, contradicts_odometry| {
            drive.hear_of_where(&seen(moved_m), &map, contradicts_odometry)
        };
        let fits = Sighting::Fits { misfits_before: 0 };
        assert_eq!(sighting(drive(0.9), 0.2, true), Sighting::Suspicious { misfits_before: 0 });
        // … where it is not ordinary, and the odometry was not contradicted just before: then more of the kind must follow.
        assert_eq!(sighting(drive(0.9), 0.2, false), Sighting::Misfits);
        assert_eq!(sighting(drive(0.7), 0.2, true), fits);
        assert_eq!(sighting(LossDetector { calm_scans: 0, ..drive(0.9) }, 0.2, true), Sighting::Misfits);
        // What was not in view before is not missing.
        let scan = Arc::new(seen(0.0).filtered(|[_, y]| y > 0.5));
        let mut half = LocalMap::new(MatcherConfig::default().cell_m, 20.0);
        (0..MATURE_SCANS).for_each(|_| half.write(&Pose2::IDENTITY, &scan, scan.view_m(), false));
        assert_eq!(drive(0.9).hear_of_where(&seen(0.0), &half, true), fits);
        // A scan that contradicts the map is suspicious once those after it fit again, unless too many do in a row.
        let mut transient = drive(1.0);
        assert_eq!(transient.hear_of_where(&seen(1.0), &map, true), Sighting::Misfits);
        let mut lost = transient;
        assert_eq!(transient.hear_of(&seen(0.0), &map), Sighting::Suspicious { misfits_before: 1 });
        assert_eq!(transient.hear_of(&seen(0.0), &map), fits);
        assert_eq!(lost.hear_of(&seen(1.0), &map), Sighting::Misfits);
        assert!(matches!(lost.hear_of(&seen(1.0), &map), Sighting::Lost { .. }));
        assert_eq!(lost.hear_of(&seen(0.0), &map), fits);
    }

    #[test]
    fn scans_that_show_other_things_are_suspicious() {
        let map = map();
        let suspicious = Sighting::Suspicious { misfits_before: 2 };
        let [as_before, moved] = [0.0, 0.2].map(seen);
        let of_three = |mut drive: LossDetector| [0, 1, 2].map(|_| drive.hear_of(&moved, &map));
        assert_eq!(of_three(drive(0.9)), [Sighting::Misfits, Sighting::Misfits, suspicious]);
        // … where that is not ordinary …
        assert_eq!(of_three(drive(0.7)), [Sighting::Fits { misfits_before: 0 }; 3]);
        // … and not if they cease.
        let mut transient = drive(0.9);
        assert_eq!(transient.hear_of(&moved, &map), Sighting::Misfits);
        assert_eq!(transient.hear_of(&as_before, &map), Sighting::Fits { misfits_before: 1 });
        assert_eq!(of_three(transient), [Sighting::Misfits, Sighting::Misfits, suspicious]);
    }

    #[test]
    fn what_looks_through_what_was_there_is_suspicious_though_most_of_it_fits() {
        // Beyond a wall that is gone there is nothing known: of what was in view all fits.
        let map = map();
        let room = [[-4.0, -3.0], [4.0, -3.0], [4.0, 3.0], [-4.0, 3.0]];
        let beyond = Walls::default().with_loop(&[room[0], [9.0, -3.0], [9.0, 3.0], room[3]]);
        let scan = SurfaceScan::new(&beyond.scan_from(&Pose2::IDENTITY, 361), &Thinning::default());
        let known = map.had_in_view(&Pose2::IDENTITY, &scan);
        let share = inlier_share(map.surfaces(), &known, &Pose2::IDENTITY, &MatcherConfig::default());
        assert!(share > 0.95, "{share}");
        let mut drive = drive(0.95);
        let heard = [0, 1, 2].map(|_| drive.hear_of(&scan, &map));
        assert_eq!(heard[..2], [Sighting::Misfits; 2]);
        assert!(matches!(heard[2], Sighting::Suspicious { .. } | Sighting::Lost { .. }), "{heard:?}");
    }

    #[test]
    fn a_few_scans_do_not_make_ordinary_what_is_not() {
        let mut ordinary = OrdinaryShare::default();
        (0..50).for_each(|k| ordinary.learn(if k % 2 == 0 { 1.0 } else { 0.96 }));
        assert!(!ordinary.is_far_above(0.9, 200) && ordinary.is_far_above(0.6, 200));
        // Of a few points chance may decide.
        assert!(!ordinary.is_far_above(0.6, 12) && !ordinary.is_far_above(0.0, 11));
        (0..3).for_each(|_| ordinary.learn(0.0));
        assert!(ordinary.is_far_above(0.6, 200), "{ordinary:?}");
        (0..200).for_each(|_| ordinary.learn(0.6));
        assert!(!ordinary.is_far_above(0.6, 200), "{ordinary:?}");
    }
}
