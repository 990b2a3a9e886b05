//! What submaps look like with their neighbours around them, kept for those that were needed lately.

use super::place_match::{Comparison, Placement};
use super::submap::Submap;
use super::uncertainty::Uncertainty;
use super::{Look, LoopClosureConfig};
use crate::geometry::Pose2;
use crate::scan_matcher::{
    MatcherConfig, PlaceQuery, PlaceSearch, PoseBelief, SearchWindow, inlier_share, match_scan, outliers,
};
use crate::surface::{SurfaceMap, SurfaceScan};
use nalgebra::Matrix3;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// What submaps look like, kept for those that were needed lately.
#[derive(Debug, Default)]
pub struct ViewCache {
    views: BTreeMap<usize, View>,
    /// What submaps look like by themselves, with when that was used last.
    looks: BTreeMap<usize, (Arc<Look>, u64)>,
    clock: u64,
}

#[derive(Debug)]
pub(super) struct View {
    /// Surfaces of the submap and its neighbours, in its frame.
    pub(super) map: SurfaceMap,
    /// Those submaps, itself first, with their poses in its frame.
    parts: Vec<ViewPart>,
    /// The same for searching; made when it is first needed.
    search: Option<PlaceSearch>,
    used: u64,
    /// Whether the submap was the newest, so that its next neighbour is missing.
    is_of_newest: bool,
}

#[derive(Debug)]
struct ViewPart {
    submap: usize,
    view_from_part: Pose2,
    look: Arc<Look>,
}

/// So many views are kept; others are quickly made again.
const VIEWS_KEPT: usize = 24;
/// So many looks are kept unpacked, beside those of the views.
const LOOKS_KEPT: usize = 16;
/// The region that is searched reaches this many standard deviations far …
const WINDOW_SIGMAS: f64 = 2.5;
/// … and at least and at most so far: metres, radians.
const WINDOW_M: [f64; 2] = [0.4, 8.0];
const WINDOW_RAD: [f64; 2] = [0.1, PI];
/// Where the uncertainty is smaller than this the fine matcher needs no search, metres and radians.
const WITHIN_REACH_M: f64 = 0.1;
const WITHIN_REACH_RAD: f64 = 0.03;
/// Places of the search that are fitted finely.
const PLACES: usize = 8;
/// Places that score this much less than the best are not looked at.
const PLACE_MARGIN: f64 = 0.12;
/// Places that score less are none.
const PLACE_MIN_SCORE: f64 = 0.4;
/// Bound on the work of one search.
const MAX_BLOCKS: usize = 200_000;
/// Two fits closer than this are the same, metres and radians.
const SAME_FIT_M: f64 = 0.15;
const SAME_FIT_RAD: f64 = 0.05;
/// Less than this share in view of each other says nothing of whether two submaps look alike.
const LEAST_IN_COMMON: f64 = 0.1;

impl ViewCache {
    /// What a submap looks like.
    fn look(&mut self, index: usize, submaps: &[Arc<Submap>]) -> Arc<Look> {
        if submaps[index].is_forgotten() {
            return Arc::default();
        }
        self.clock += 1;
        if let Some((look, used)) = self.looks.get_mut(&index) {
            *used = self.clock;
            return Arc::clone(look);
        }
        if self.looks.len() >= LOOKS_KEPT {
            let oldest = self.looks.iter().min_by_key(|(_, (_, used))| *used).map(|(&index, _)| index);
            oldest.and_then(|oldest| self.looks.remove(&oldest));
        }
        let look = Arc::new(submaps[index].look());
        self.looks.insert(index, (Arc::clone(&look), self.clock));
        look
    }

    /// Makes the view of a submap with its neighbours.
    fn learn(&mut self, index: usize, submaps: &[Arc<Submap>], cell_m: f64) {
        self.clock += 1;
        self.views.retain(|&submap, view| !view.is_of_newest || submap + 1 == submaps.len());
        if let Some(view) = self.views.get_mut(&index) {
            view.used = self.clock;
            return;
        }
        if self.views.len() >= VIEWS_KEPT {
            let oldest = self.views.iter().min_by_key(|(_, view)| view.used).map(|(&index, _)| index);
            oldest.and_then(|oldest| self.views.remove(&oldest));
        }
        let mut parts = vec![(index, Pose2::IDENTITY)];
        // Where the robot was carried nobody knows how the neighbour lies.
        let motion_to = |submap: &Arc<Submap>| {
            submap.link.filter(|_| submap.interruption.is_none()).map(|link| link.previous_from_submap)
        };
        if let (Some(motion), Some(before)) = (motion_to(&submaps[index]), index.checked_sub(1)) {
            parts.push((before, motion.inverse()));
        }
        if let Some(motion) = submaps.get(index + 1).and_then(motion_to) {
            parts.push((index + 1, motion));
        }
        // What a neighbour had in view counts no more once it is forgotten what it saw there.
        parts.retain(|(part, _)| *part == index || !submaps[*part].is_forgotten());
        let mut view = self.view_of(&parts, submaps, cell_m);
        (view.used, view.is_of_newest) = (self.clock, index + 1 == submaps.len());
        self.views.insert(index, view);
    }

    /// The view of some submaps, given how they lie in its frame.
    fn view_of(&mut self, parts: &[(usize, Pose2)], submaps: &[Arc<Submap>], cell_m: f64) -> View {
        let mut map = SurfaceMap::new(cell_m);
        let part = |&(submap, view_from_part): &(usize, Pose2)| {
            let look = self.look(submap, submaps);
            map.add_scan(&view_from_part, &look.surfaces);
            ViewPart { submap, view_from_part, look }
        };
        let parts = parts.iter().map(part).collect();
        View { map, parts, search: None, used: 0, is_of_newest: false }
    }

    /// Looks for the newer submap on the older one around where it is expected.
    pub fn compare(
        &mut self,
        submaps: &[Arc<Submap>],
        [older, newer]: [usize; 2],
        expected: Pose2,
        uncertainty: Uncertainty,
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
    ) -> Comparison {
        self.learn(newer, submaps, matcher.cell_m);
        self.learn(older, submaps, matcher.cell_m);
        let looks = [older, newer].map(|index| self.look(index, submaps));
        let probes = looks.each_ref().map(|look| &look.probe);
        let mut placements = match self.views.get_mut(&older) {
            Some(view) => {
                let middles = [older, newer].map(|index| submaps[index].middle);
                view.places(middles, probes[1], &expected, &uncertainty, matcher)
            }
            None => Vec::new(),
        };
        if let (Some(old), Some(new)) = (self.views.get(&older), self.views.get(&newer)) {
            for placement in &mut placements {
                placement.verify([old, new], probes, submaps, config, matcher);
            }
        }
        placements.sort_by(|a, b| b.fits().cmp(&a.fits()).then(b.quality().total_cmp(&a.quality())));
        Comparison { older, newer, expected, uncertainty, placements, discontinuity: None }
    }

    /// Of what a submap and one or two before it had in view of each other, the share that looks the same, where the newer one
    /// lies as `older_from_newer` says on the older one, and that as its link says on the one before it; `None` where they have
    /// little of it in common.
    pub fn likeness(
        &mut self,
        submaps: &[Arc<Submap>],
        [older, newer]: [usize; 2],
        older_from_newer: &Pose2,
        matcher: &MatcherConfig,
    ) -> Option<f64> {
        let mut before = vec![(older, Pose2::IDENTITY)];
        let link = submaps[older].link.filter(|_| submaps[older].interruption.is_none());
        before.extend(
            older.checked_sub(1).zip(link).map(|(earlier, link)| (earlier, link.previous_from_submap.inverse())),
        );
        before.retain(|&(submap, _)| !submaps[submap].is_forgotten());
        let views = [before, vec![(newer, Pose2::IDENTITY)]].map(|parts| self.view_of(&parts, submaps, matcher.cell_m));
        let probes = [older, newer].map(|index| self.look(index, submaps));
        let (overlap_share, share) = views[0].agreement(&probes[1].probe, older_from_newer, submaps, matcher);
        let (overlap_share_back, share_back) =
            views[1].agreement(&probes[0].probe, &older_from_newer.inverse(), submaps, matcher);
        (overlap_share.min(overlap_share_back) > LEAST_IN_COMMON).then_some(0.5 * (share + share_back))
    }

    /// Share of the newer submap's points that lie on none of the older ones, where `places` say: older submap, older
    /// from newer.
    pub fn new_share(
        &mut self,
        submaps: &[Arc<Submap>],
        newer: usize,
        places: &[(usize, Pose2)],
        matcher: &MatcherConfig,
    ) -> f64 {
        let look = self.look(newer, submaps);
        let probe = &look.probe;
        let mut rest = probe.clone();
        for (older, older_from_newer) in places {
            self.learn(*older, submaps, matcher.cell_m);
            if let Some(view) = self.views.get(older) {
                rest = outliers(&view.map, &rest, older_from_newer, matcher);
            }
        }
        rest.len() as f64 / probe.len().max(1) as f64
    }
}

impl View {
    /// Where the newer submap's probe lies on this view, not checked yet. `older` and `newer` are the submaps' middles.
    fn places(
        &mut self,
        [older, newer]: [Pose2; 2],
        probe: &SurfaceScan,
        expected: &Pose2,
        uncertainty: &Uncertainty,
        matcher: &MatcherConfig,
    ) -> Vec<Placement> {
        let information = Matrix3::from_diagonal(
            &[uncertainty.sigma_m.powi(-2), uncertainty.sigma_m.powi(-2), uncertainty.sigma_rad.powi(-2)].into(),
        );
        let near = match_scan(&self.map, probe, &PoseBelief { pose: *expected, information }, matcher);
        let mut fits = vec![near];
        if uncertainty.sigma_m > WITHIN_REACH_M || uncertainty.sigma_rad > WITHIN_REACH_RAD {
            // The search turns the submap about its middle, not about its first pose.
            let centred = probe.seen_from(&newer);
            let query = PlaceQuery {
                window: SearchWindow {
                    distance_m: (WINDOW_SIGMAS * uncertainty.sigma_m).clamp(WINDOW_M[0], WINDOW_M[1]),
                    angle_rad: (WINDOW_SIGMAS * uncertainty.sigma_rad).clamp(WINDOW_RAD[0], WINDOW_RAD[1]),
                },
                likely: Some(near.belief.pose.compose(&newer)),
                min_score: PLACE_MIN_SCORE,
                margin: PLACE_MARGIN,
                most: PLACES,
                max_blocks: MAX_BLOCKS,
            };
            let map = &self.map;
            let search = self.search.get_or_insert_with(|| {
                PlaceSearch::new(&SurfaceScan::from_surfaces([older.x, older.y], map.surfaces()))
            });
            for place in search.find(&centred, &expected.compose(&newer), &query).unwrap_or_default() {
                let start = place.pose.compose(&newer.inverse());
                let found =
                    match_scan(&self.map, probe, &PoseBelief { pose: start, information: Matrix3::zeros() }, matcher);
                if fits.iter().all(|fit| !is_same(&fit.belief.pose, &found.belief.pose)) {
                    fits.push(found);
                }
            }
        }
        fits.iter().map(|fit| Placement::of(fit, matcher)).collect()
    }

    /// What share of a probe at a pose lies in view, and what share of that on the map.
    pub(super) fn agreement(
        &self,
        probe: &SurfaceScan,
        pose: &Pose2,
        submaps: &[Arc<Submap>],
        matcher: &MatcherConfig,
    ) -> (f64, f64) {
        // What a submap had in view counts no more once it is forgotten what it saw there.
        let remembered = self.parts.iter().filter(|part| !submaps[part.submap].is_forgotten());
        let parts: Vec<_> = remembered
            .map(|part| (&part.look, part.view_from_part.inverse().compose(pose).point_transform()))
            .collect();
        let in_view = probe.filtered(|point| {
            let point = point.map(f64::from);
            parts.iter().any(|(part, from_probe)| part.had_in_view(from_probe(point).map(|v| v as f32)))
        });
        let overlap_share = in_view.len() as f64 / probe.len().max(1) as f64;
        (overlap_share, inlier_share(&self.map, &in_view, pose, matcher))
    }
}

fn is_same(a: &Pose2, b: &Pose2) -> bool {
    let offset = a.between(b);
    offset.distance() < SAME_FIT_M && offset.theta.abs() < SAME_FIT_RAD
}
