//! Whether two submaps show the same place, and how they then lie to each other.
//!
//! Within the region that the drift allows the newer submap is searched for on the older one by
//! branch and bound; what is found is fitted finely and checked both ways: of all that each shows
//! of the region that the other had in view, most must be there. Several places apart from each
//! other may pass: which of them is right is not decided here.

use super::doubt::Doubt;
use super::submap::{Submap, in_frame_of};
use super::{LoopClosureConfig, Verdict};
use crate::geometry::{Pose2, wrap_angle};
use crate::map::SurfaceMap;
use crate::scan_matcher::{
    MatchResult, MatcherConfig, PlaceQuery, PlaceSearch, PoseBelief, SearchWindow, SurfaceScan, inlier_share,
    match_scan, outliers, without_hearsay,
};
use nalgebra::{Matrix3, Vector2};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A newer submap compared with an older one.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// The older submap.
    pub older: usize,
    /// The newer submap.
    pub newer: usize,
    /// Where the newer one was thought to lie: older from newer.
    pub expected: Pose2,
    /// How sure that was.
    pub doubt: Doubt,
    /// Where it may lie, the best fit first; at least one.
    pub placements: Vec<Placement>,
}

/// Where a newer submap may lie on an older one.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// Older from newer.
    pub older_from_newer: Pose2,
    /// Covariance of that in the axes of the newer one, m² and rad².
    pub covariance: Matrix3<f64>,
    /// Share of the newer one's surfaces that the older one had in view, and the other way round.
    pub overlap_shares: [f64; 2],
    /// Share of those that lie on surfaces of the other.
    pub inlier_shares: [f64; 2],
    /// How much more of the newer one fits here than at any place a little farther on: along a bare corridor every
    /// place fits, so that a fit says nothing about where along it the robot is.
    pub distinctness: f64,
    /// What is wrong with it; [`Verdict::Accepted`] where nothing is.
    pub verdict: Verdict,
}

impl Placement {
    /// How much fits, both ways, from 0 to 1.
    #[must_use]
    pub fn quality(&self) -> f64 {
        0.5 * (self.inlier_shares[0] + self.inlier_shares[1])
    }

    /// Standard deviation of the position in the direction in which it is the least certain, metres.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.least_certain().0.sqrt()
    }

    /// The direction in which the position is the least certain, in the axes of the newer one, with the variance, m².
    fn least_certain(&self) -> (f64, Vector2<f64>) {
        let eigen = self.covariance.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
        let largest = eigen.eigenvalues.imax();
        (eigen.eigenvalues[largest], eigen.eigenvectors.column(largest).into_owned())
    }

    /// Whether it passed all tests.
    #[must_use]
    pub fn fits(&self) -> bool {
        self.verdict == Verdict::Accepted
    }
}

/// What submaps look like, kept for those that were needed lately.
#[derive(Debug, Default)]
pub struct Atlas {
    views: BTreeMap<usize, View>,
    clock: u64,
}

#[derive(Debug)]
struct View {
    /// Surfaces of the submap and its neighbours, in its frame.
    map: SurfaceMap,
    /// Those submaps, with their poses in its frame.
    parts: Vec<(usize, Pose2)>,
    /// The same for searching; made when it is first needed.
    search: Option<PlaceSearch>,
    used: u64,
}

/// So many views are kept; others are quickly made again.
const VIEWS_KEPT: usize = 24;
/// The region that is searched reaches this many standard deviations far …
const WINDOW_SIGMAS: f64 = 2.5;
/// … and at least and at most so far: metres, radians.
const WINDOW_M: [f64; 2] = [0.4, 8.0];
const WINDOW_RAD: [f64; 2] = [0.1, PI];
/// Where the doubt is smaller than this the fine matcher needs no search, metres and radians.
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
/// The two ways round must agree to this, metres and radians.
const AGREEMENT_M: f64 = 0.2;
const AGREEMENT_RAD: f64 = 0.05;
/// Places of which each had less than this share of the other's surfaces in view have too little in common to judge.
const MIN_OVERLAP_SHARE: f64 = 0.25;
/// So far from a place are those from which it must differ to mean anything, metres.
const FARTHER_ON_M: [f64; 6] = [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];

impl Atlas {
    /// Makes the view of a submap with its neighbours.
    fn learn(&mut self, index: usize, submaps: &[Submap], cell_m: f64) {
        self.clock += 1;
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
        let motion_to = |submap: &Submap| {
            submap.link.filter(|_| submap.starts_anew.is_none()).map(|link| link.previous_from_submap)
        };
        if let (Some(motion), Some(before)) = (motion_to(&submaps[index]), index.checked_sub(1)) {
            parts.push((before, motion.inverse()));
        }
        if let Some(motion) = submaps.get(index + 1).and_then(motion_to) {
            parts.push((index + 1, motion));
        }
        // What a neighbour had in view counts no more once it is forgotten what it saw there.
        parts.retain(|(part, _)| *part == index || !submaps[*part].surfaces.is_empty());
        let mut map = SurfaceMap::new(cell_m);
        for (part, pose) in &parts {
            map.add_scan(pose, &submaps[*part].surfaces);
        }
        self.views.insert(index, View { map, parts, search: None, used: self.clock });
    }

    /// Looks for the newer submap on the older one around where it is expected.
    pub fn compare(
        &mut self,
        submaps: &[Submap],
        [older, newer]: [usize; 2],
        expected: Pose2,
        doubt: Doubt,
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
    ) -> Comparison {
        // The newest submap's view lacks its next neighbour: it must not be kept as it is.
        self.learn(newer, submaps, matcher.cell_m);
        self.learn(older, submaps, matcher.cell_m);
        let mut placements = match self.views.get_mut(&older) {
            Some(view) => view.places(&submaps[older], &submaps[newer], &expected, &doubt, matcher),
            None => Vec::new(),
        };
        if let (Some(old), Some(new)) = (self.views.get(&older), self.views.get(&newer)) {
            let probes = [&submaps[older].probe, &submaps[newer].probe];
            for placement in &mut placements {
                placement.verify([old, new], probes, submaps, config, matcher);
            }
        }
        if newer + 1 == submaps.len() {
            self.views.remove(&newer);
        }
        placements.sort_by(|a, b| b.fits().cmp(&a.fits()).then(b.quality().total_cmp(&a.quality())));
        Comparison { older, newer, expected, doubt, placements }
    }

    /// Share of the newer submap's points that lie on none of the older ones, where `places` say: older submap, older
    /// from newer.
    pub fn new_share(
        &mut self,
        submaps: &[Submap],
        newer: usize,
        places: &[(usize, Pose2)],
        matcher: &MatcherConfig,
    ) -> f64 {
        let probe = &submaps[newer].probe;
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
    /// Where the newer submap's surfaces lie on this view, not checked yet.
    fn places(
        &mut self,
        older: &Submap,
        newer: &Submap,
        expected: &Pose2,
        doubt: &Doubt,
        matcher: &MatcherConfig,
    ) -> Vec<Placement> {
        let information =
            Matrix3::from_diagonal(&[doubt.sigma_m.powi(-2), doubt.sigma_m.powi(-2), doubt.sigma_rad.powi(-2)].into());
        let near = match_scan(&self.map, &newer.probe, &PoseBelief { pose: *expected, information }, matcher);
        let mut fits = vec![near];
        if doubt.sigma_m > WITHIN_REACH_M || doubt.sigma_rad > WITHIN_REACH_RAD {
            // The search turns the submap about its middle, not about its first pose.
            let centred = newer.probe.seen_from(&newer.middle);
            let query = PlaceQuery {
                window: SearchWindow {
                    distance_m: (WINDOW_SIGMAS * doubt.sigma_m).clamp(WINDOW_M[0], WINDOW_M[1]),
                    angle_rad: (WINDOW_SIGMAS * doubt.sigma_rad).clamp(WINDOW_RAD[0], WINDOW_RAD[1]),
                },
                min_score: PLACE_MIN_SCORE,
                margin: PLACE_MARGIN,
                most: PLACES,
                max_blocks: MAX_BLOCKS,
            };
            let map = &self.map;
            let search = self.search.get_or_insert_with(|| {
                PlaceSearch::new(&SurfaceScan::from_surfaces([older.middle.x, older.middle.y], map.surfaces()))
            });
            for place in search.find(&centred, &expected.compose(&newer.middle), &query).unwrap_or_default() {
                let start = place.pose.compose(&newer.middle.inverse());
                let found = match_scan(
                    &self.map,
                    &newer.probe,
                    &PoseBelief { pose: start, information: Matrix3::zeros() },
                    matcher,
                );
                if fits.iter().all(|fit| !is_same(&fit.belief.pose, &found.belief.pose)) {
                    fits.push(found);
                }
            }
        }
        fits.iter().map(|fit| Placement::of(fit, matcher)).collect()
    }

    /// What share of a probe at a pose lies in view, and what share of that on the map.
    fn agreement(&self, probe: &SurfaceScan, pose: &Pose2, submaps: &[Submap], matcher: &MatcherConfig) -> (f64, f64) {
        let to_parts: Vec<(&Submap, Pose2)> = self
            .parts
            .iter()
            .map(|(part, view_from_part)| (&submaps[*part], view_from_part.inverse().compose(pose)))
            .collect();
        let in_view = probe.filtered(|point| {
            to_parts.iter().any(|(part, part_from_probe)| {
                part.had_in_view(part_from_probe.transform_point(point.map(f64::from)).map(|v| v as f32))
            })
        });
        let overlap_share = in_view.len() as f64 / probe.len().max(1) as f64;
        (overlap_share, inlier_share(&self.map, &in_view, pose, matcher))
    }
}

impl Placement {
    fn of(fit: &MatchResult, matcher: &MatcherConfig) -> Self {
        let weak = Matrix3::identity() * 1e-3;
        // A second time: the errors of all closures along a corridor point the same way, so that none may say much.
        let scale = without_hearsay(&fit.scan_information, matcher);
        let covariance = (scale * fit.scan_information * scale + weak).try_inverse().unwrap_or_else(Matrix3::identity);
        Self {
            older_from_newer: fit.belief.pose,
            covariance: in_frame_of(&covariance, &fit.belief.pose),
            overlap_shares: [0.0; 2],
            inlier_shares: [0.0; 2],
            distinctness: 0.0,
            verdict: Verdict::DoesNotFit,
        }
    }

    /// Puts the placement to its tests. `views` and `probes`: the older's, the newer's.
    fn verify(
        &mut self,
        views: [&View; 2],
        probes: [&SurfaceScan; 2],
        submaps: &[Submap],
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
    ) {
        let newer_from_older = self.older_from_newer.inverse();
        (self.overlap_shares[0], self.inlier_shares[0]) =
            views[0].agreement(probes[1], &self.older_from_newer, submaps, matcher);
        self.verdict = if self.overlap_shares[0] < MIN_OVERLAP_SHARE {
            Verdict::TooLittleInCommon
        } else if self.inlier_shares[0] < config.min_inlier_share {
            Verdict::DoesNotFit
        } else {
            let belief = PoseBelief { pose: newer_from_older, information: Matrix3::zeros() };
            let back = match_scan(&views[1].map, probes[0], &belief, matcher).belief.pose;
            (self.overlap_shares[1], self.inlier_shares[1]) = views[1].agreement(probes[0], &back, submaps, matcher);
            let disagreement = self.older_from_newer.compose(&back);
            if self.overlap_shares[1] < MIN_OVERLAP_SHARE {
                Verdict::TooLittleInCommon
            } else if self.inlier_shares[1] < config.min_inlier_share
                || disagreement.distance() > AGREEMENT_M
                || wrap_angle(disagreement.theta).abs() > AGREEMENT_RAD
            {
                Verdict::DoesNotFitBack
            } else {
                self.distinctness =
                    self.inlier_shares[0] - self.share_farther_on(views[0], probes[1], submaps, matcher);
                Verdict::Accepted
            }
        };
    }

    /// What share of the newer one's surfaces lies on the older one's when it is moved on in the direction in which
    /// the fit is the least certain, at the best of several distances.
    fn share_farther_on(&self, older: &View, newer: &SurfaceScan, submaps: &[Submap], matcher: &MatcherConfig) -> f64 {
        let (_, direction) = self.least_certain();
        let shares = FARTHER_ON_M.map(|distance_m| {
            let moved = Pose2::new(distance_m * direction[0], distance_m * direction[1], 0.0);
            older.agreement(newer, &self.older_from_newer.compose(&moved), submaps, matcher).1
        });
        shares.into_iter().fold(0.0, f64::max)
    }
}

fn is_same(a: &Pose2, b: &Pose2) -> bool {
    let offset = a.between(b);
    offset.distance() < SAME_FIT_M && offset.theta.abs() < SAME_FIT_RAD
}
