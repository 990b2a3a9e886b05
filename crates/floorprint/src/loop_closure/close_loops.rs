//! Finds the places that a drive passes more than once and ties them together.
//!
//! The drive is cut into submaps (Hess et al. 2016). Each is compared with the older ones that
//! may lie near it, within the region that the drift since then allows; what fits both ways
//! becomes a factor of the pose graph, with the certainty that the surfaces give: along a bare
//! corridor none.

use super::submap::Submap;
use super::{KeyScan, LoopClosureConfig};
use crate::geometry::{Pose2, wrap_angle};
use crate::map::SurfaceMap;
use crate::pose_graph::{
    BetweenFactor, Optimizer, OptimizerConfig, PoseGraph, PoseGraphError, PriorFactor, RobustKernel,
};
use crate::scan_matcher::{MatchResult, MatcherConfig, PoseBelief, SearchWindow, SurfaceScan, match_scan, search};
use nalgebra::Matrix3;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A comparison of two submaps, for the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClosureReport {
    /// The older submap.
    pub older: usize,
    /// The newer submap.
    pub newer: usize,
    /// Which frames lie in the middle of the two, counted from 0.
    pub frames: [usize; 2],
    /// Standard deviation of where the newer one was thought to lie, seen from the older, metres.
    pub doubt_m: f64,
    /// How far the newer one was moved against where it was thought to be, metres.
    pub correction_m: f64,
    /// The same in heading, radians.
    pub correction_rad: f64,
    /// Share of the newer one's surfaces that lie on the older one's, and the other way round.
    pub inlier_shares: [f64; 2],
    /// Whether it became a factor of the graph.
    pub verdict: Verdict,
}

/// What became of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Tied together.
    Accepted,
    /// Too little of the newer submap fits the older.
    DoesNotFit,
    /// The older submap does not fit the newer.
    DoesNotFitBack,
}

/// The drive put right.
#[derive(Debug, Clone)]
pub struct ClosedLoops {
    /// The submaps.
    pub submaps: Vec<Submap>,
    /// World from submap, after the optimisation.
    pub world_from_submap: Vec<Pose2>,
    /// Every comparison.
    pub closures: Vec<ClosureReport>,
}

/// Ties together what belongs together.
#[must_use]
pub fn close_loops(key_scans: &[KeyScan], config: &LoopClosureConfig, matcher: &MatcherConfig) -> ClosedLoops {
    let submaps = Submap::cut(key_scans, config.submap_length_m);
    let mut search = Search {
        key_scans,
        config,
        matcher,
        submaps: &submaps,
        scans: vec![None; submaps.len()],
        contexts: BTreeMap::new(),
    };
    let mut graph = chain(&submaps, key_scans, config);
    let mut optimizer = Optimizer::new(OptimizerConfig::default());
    let mut closures = Vec::new();
    for newer in 0..submaps.len() {
        let mut tied = Vec::new();
        let doubts = doubts_from(&graph, newer);
        for older in search.candidates(newer, graph.poses(), &doubts) {
            let (report, factor) = search.compare(older, newer, graph.poses(), &doubts[older]);
            closures.push(report);
            tied.extend(factor.and_then(|factor| graph.add_between(factor).ok()));
        }
        if tied.is_empty() {
            continue;
        }
        // A graph that cannot be solved keeps its estimates: the chain alone always can.
        if tied.iter().any(|&factor| graph.squared_error(factor) > CONFLICT) {
            let _ = resolve_conflict(&mut graph, &mut optimizer);
        } else {
            let _ = optimizer.optimize(&mut graph);
        }
    }
    let world_from_submap = graph.poses().to_vec();
    ClosedLoops { submaps, world_from_submap, closures }
}

/// The graph of the front end alone: each submap tied to the one before.
fn chain(submaps: &[Submap], key_scans: &[KeyScan], config: &LoopClosureConfig) -> PoseGraph {
    let mut graph = PoseGraph::default();
    for (index, submap) in submaps.iter().enumerate() {
        graph.add_node(submap.front_end_from_submap);
        if index == 0 {
            let prior = PriorFactor {
                node: 0,
                world_from_node: submap.front_end_from_submap,
                information: Matrix3::identity() * 1e8,
            };
            let _ = graph.add_prior(prior);
            continue;
        }
        let before = &submaps[index - 1];
        let path_m = (submap.path_m - before.path_m).max(0.1);
        let variance_m2 = config.drift_sigma_m.powi(2) * path_m;
        let variance_rad2 = config.drift_sigma_rad.powi(2) * path_m;
        // Where a scan alone could not tell (a bare corridor) the doubt of the match itself is larger.
        let worst = key_scans[before.key_scans.start..=submap.key_scans.start].iter().map(|scan| scan.covariance).fold(
            Matrix3::zeros(),
            |worst, covariance| if covariance.trace() > worst.trace() { covariance } else { worst },
        );
        let floor = Matrix3::from_diagonal(&[variance_m2, variance_m2, variance_rad2].into());
        let covariance = floor + in_frame_of(&worst, &submap.front_end_from_submap);
        let factor = BetweenFactor {
            from: index - 1,
            to: index,
            from_from_to: before.front_end_from_submap.between(&submap.front_end_from_submap),
            information: covariance.try_inverse().unwrap_or_else(Matrix3::identity),
            kernel: RobustKernel::Quadratic,
            weight: 1.0,
        };
        let _ = graph.add_between(factor);
    }
    graph
}

/// A closure that fits the graph worse than this, squared standard deviations, contradicts it.
const CONFLICT: f64 = 25.0;

/// Solves a graph in which some factors must be wrong, closures or links of the chain, without
/// knowing which: graduated non-convexity (Yang et al. 2020). At first all factors pull, then
/// those that the others contradict lose their say. Closures keep their kernel afterwards.
fn resolve_conflict(graph: &mut PoseGraph, optimizer: &mut Optimizer) -> Result<(), PoseGraphError> {
    let before = graph.clone();
    for stage in 0..GRADUATION_STAGES {
        let loosened = 4.0_f64.powi(GRADUATION_STAGES - 1 - stage);
        let weights: Vec<f64> = (0..graph.between_factors().len())
            .map(|factor| {
                let kernel = RobustKernel::GemanMcClure { scale: (CONFLICT * loosened).sqrt() };
                if stage == 0 { 1.0 } else { kernel.weight(graph.squared_error(factor)) }
            })
            .collect();
        for (factor, weight) in weights.into_iter().enumerate() {
            graph.set_weight(factor, weight.max(1e-6));
        }
        optimizer.optimize(graph)?;
    }
    for factor in 0..graph.between_factors().len() {
        graph.set_weight(factor, before.between_factors()[factor].weight);
    }
    optimizer.optimize(graph)?;
    Ok(())
}

/// Steps from trusting all factors to doubting those that do not fit.
const GRADUATION_STAGES: i32 = 8;

/// How uncertain the pose of one submap is as seen from another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Doubt {
    variance_m2: f64,
    variance_rad2: f64,
    /// Links on the way: a heading error early on moves the end sideways.
    path_m: f64,
}

impl Doubt {
    /// Standard deviations of position (metres) and heading (radians).
    fn sigmas(&self) -> (f64, f64) {
        let sideways_m2 = self.variance_rad2 * (LEVER_SHARE * self.path_m.min(LONGEST_LEVER_M)).powi(2);
        ((self.variance_m2 + sideways_m2).sqrt(), self.variance_rad2.sqrt())
    }
}

/// A heading error acts over about this share of the way …
const LEVER_SHARE: f64 = 0.3;
/// … and buildings fold long ways up: over no more than this, metres.
const LONGEST_LEVER_M: f64 = 60.0;

/// How uncertain each submap up to `newer` is as seen from `newer`: along the most certain way
/// through the graph, where closures are short cuts (Dijkstra 1959).
fn doubts_from(graph: &PoseGraph, newer: usize) -> Vec<Doubt> {
    let mut neighbours = vec![Vec::new(); newer + 1];
    for factor in graph.between_factors().iter().filter(|factor| factor.from <= newer && factor.to <= newer) {
        let covariance = factor.information.try_inverse().unwrap_or_else(Matrix3::identity);
        let link = Doubt {
            variance_m2: 0.5 * (covariance[(0, 0)] + covariance[(1, 1)]),
            variance_rad2: covariance[(2, 2)],
            path_m: factor.from_from_to.distance(),
        };
        neighbours[factor.from].push((factor.to, link));
        neighbours[factor.to].push((factor.from, link));
    }
    let unknown = Doubt { variance_m2: f64::INFINITY, variance_rad2: f64::INFINITY, path_m: 0.0 };
    let mut doubts = vec![unknown; newer + 1];
    doubts[newer] = Doubt { variance_m2: 0.0, variance_rad2: 0.0, path_m: 0.0 };
    // Positive floats sort like their bits.
    let mut queue = BTreeSet::from([(0_u64, newer)]);
    while let Some((_, here)) = queue.pop_first() {
        for &(next, link) in &neighbours[here] {
            let reached = Doubt {
                variance_m2: doubts[here].variance_m2 + link.variance_m2,
                variance_rad2: doubts[here].variance_rad2 + link.variance_rad2,
                path_m: doubts[here].path_m + link.path_m,
            };
            if reached.variance_m2 < doubts[next].variance_m2 {
                doubts[next] = reached;
                queue.insert((reached.variance_m2.to_bits(), next));
            }
        }
    }
    doubts
}

/// A covariance over (x, y, θ) in the world's axes, turned into the axes of a pose.
fn in_frame_of(covariance: &Matrix3<f64>, pose: &Pose2) -> Matrix3<f64> {
    let (sin, cos) = pose.theta.sin_cos();
    let turn = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
    turn * covariance * turn.transpose()
}

struct Search<'a> {
    key_scans: &'a [KeyScan],
    config: &'a LoopClosureConfig,
    matcher: &'a MatcherConfig,
    submaps: &'a [Submap],
    /// What each submap saw, for those that were needed yet.
    scans: Vec<Option<SurfaceScan>>,
    /// Maps of submaps with their neighbours, for those needed lately.
    contexts: BTreeMap<usize, SurfaceMap>,
}

/// So many maps are kept at most; they are quickly made again.
const CONTEXTS_KEPT: usize = 100;

impl Search<'_> {
    /// The older submaps that may show the same place, nearest first.
    fn candidates(&self, newer: usize, poses: &[Pose2], doubts: &[Doubt]) -> Vec<usize> {
        let place = |index: usize| poses[index].compose(&self.submaps[index].middle);
        let here = place(newer);
        let mut near: Vec<(f64, usize)> = (0..newer.saturating_sub(1))
            .filter_map(|older| {
                let distance_m = here.between(&place(older)).distance();
                let doubt_m = 2.0 * doubts[older].sigmas().0;
                (distance_m < self.config.candidate_distance_m + doubt_m.min(6.0)).then_some((distance_m, older))
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        for (_, older) in near {
            if chosen.len() < self.config.candidates && chosen.iter().all(|other| other.abs_diff(older) > 1) {
                chosen.push(older);
            }
        }
        chosen
    }

    /// What a submap saw.
    fn scan(&mut self, index: usize) -> SurfaceScan {
        let (submap, key_scans, cell_m) = (&self.submaps[index], self.key_scans, self.matcher.cell_m);
        self.scans[index].get_or_insert_with(|| submap.as_one_scan(key_scans, cell_m)).clone()
    }

    /// Makes the map of a submap with its neighbours known.
    fn learn(&mut self, index: usize) {
        if self.contexts.contains_key(&index) {
            return;
        }
        let here = self.submaps[index].front_end_from_submap;
        let mut context = SurfaceMap::new(self.matcher.cell_m);
        for neighbour in index.saturating_sub(1)..(index + 2).min(self.submaps.len()) {
            let there = self.submaps[neighbour].front_end_from_submap;
            context.add_scan(&here.between(&there), &self.scan(neighbour));
        }
        if self.contexts.len() >= CONTEXTS_KEPT {
            self.contexts.clear();
        }
        self.contexts.insert(index, context);
    }

    /// Fits the newer submap to the older, and the older to the newer.
    fn compare(
        &mut self,
        older: usize,
        newer: usize,
        poses: &[Pose2],
        doubt: &Doubt,
    ) -> (ClosureReport, Option<BetweenFactor>) {
        self.learn(older);
        self.learn(newer);
        let (new_scan, old_scan) = (self.scan(newer), self.scan(older));
        let (sigma_m, sigma_rad) = doubt.sigmas();
        let expected = poses[older].between(&poses[newer]);
        let mut report = ClosureReport {
            older,
            newer,
            frames: [older, newer].map(|index| self.key_scans[self.submaps[index].middle_key_scan()].position),
            doubt_m: sigma_m,
            correction_m: 0.0,
            correction_rad: 0.0,
            inlier_shares: [0.0; 2],
            verdict: Verdict::DoesNotFit,
        };
        let (Some(old_context), Some(new_context)) = (self.contexts.get(&older), self.contexts.get(&newer)) else {
            return (report, None);
        };
        let doubt = Matrix3::from_diagonal(&[sigma_m.powi(-2), sigma_m.powi(-2), sigma_rad.powi(-2)].into());
        let found =
            self.fit(old_context, &new_scan, &expected, &doubt, (sigma_m, sigma_rad), &self.submaps[newer].middle);
        let correction = expected.between(&found.belief.pose);
        report.correction_m = correction.distance();
        report.correction_rad = wrap_angle(correction.theta);
        report.inlier_shares[0] = found.inlier_share;
        if found.inlier_share < self.config.min_inlier_share {
            return (report, None);
        }
        let back = match_scan(
            new_context,
            &old_scan,
            &PoseBelief { pose: found.belief.pose.inverse(), information: Matrix3::zeros() },
            self.matcher,
        );
        report.inlier_shares[1] = back.inlier_share;
        let disagreement = found.belief.pose.compose(&back.belief.pose);
        if back.inlier_share < self.config.min_inlier_share
            || disagreement.distance() > 0.2
            || disagreement.theta.abs() > 0.05
        {
            report.verdict = Verdict::DoesNotFitBack;
            return (report, None);
        }
        report.verdict = Verdict::Accepted;
        let floor = Matrix3::from_diagonal(
            &[
                self.config.closure_sigma_m.powi(2),
                self.config.closure_sigma_m.powi(2),
                self.config.closure_sigma_rad.powi(2),
            ]
            .into(),
        );
        let weak = Matrix3::identity() * 1e-3;
        let covariance = (found.scan_information + weak).try_inverse().unwrap_or_else(Matrix3::identity);
        let covariance = floor + in_frame_of(&covariance, &found.belief.pose);
        let factor = covariance.try_inverse().map(|information| BetweenFactor {
            from: older,
            to: newer,
            from_from_to: found.belief.pose,
            information,
            kernel: RobustKernel::DynamicCovarianceScaling { phi: 9.0 },
            weight: 1.0,
        });
        (report, factor)
    }

    /// The best fit of a submap's surfaces to another's map within the doubt about where it lies.
    fn fit(
        &self,
        map: &SurfaceMap,
        scan: &SurfaceScan,
        expected: &Pose2,
        doubt: &Matrix3<f64>,
        (sigma_m, sigma_rad): (f64, f64),
        middle: &Pose2,
    ) -> MatchResult {
        let mut best = match_scan(map, scan, &PoseBelief { pose: *expected, information: *doubt }, self.matcher);
        // Where the doubt is within the matcher's own reach there is nothing to search for.
        if best.inlier_share < 0.85 && (sigma_m > 0.1 || sigma_rad > 0.03) {
            // The search turns the submap about its middle, not about its first pose.
            let centred = scan.seen_from(middle);
            let window = SearchWindow {
                distance_m: (2.5 * sigma_m).clamp(0.4, 6.0),
                angle_rad: (2.5 * sigma_rad).clamp(0.1, 0.6),
            };
            for pose in search(map, &centred, &expected.compose(middle), window, 4) {
                let start = pose.compose(&middle.inverse());
                let found = match_scan(map, scan, &PoseBelief { pose: start, information: *doubt * 0.0 }, self.matcher);
                if found.inlier_share > best.inlier_share + 0.02 {
                    best = found;
                }
            }
        }
        best
    }
}
