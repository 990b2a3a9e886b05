//! Recognises places that a drive passes more than once and puts the drive right.
//!
//! The drive is cut into submaps. Each new one is compared with older ones that may show the
//! same place; what fits splits or confirms the accounts of the drive (see [`Hypothesis`]).
//! Work is done in small bounded pieces, one for each scan, so that it keeps up with a live
//! robot; what is left is done at the end.

use super::comparison::{Atlas, Comparison};
use super::doubt::Doubt;
use super::hypothesis::Hypothesis;
use super::submap::{Submap, SubmapBuilder};
use super::{Anchor, ClosureLoad, ClosureReport, KeyScan, Kidnapping, LoopClosureConfig, Verdict};
use crate::geometry::{Pose2, wrap_angle};
use crate::pose_graph::PoseGraph;
use crate::scan_matcher::MatcherConfig;
use std::collections::VecDeque;

/// Closes loops while the drive goes on.
#[derive(Debug)]
pub struct LoopCloser {
    config: LoopClosureConfig,
    matcher: MatcherConfig,
    builder: SubmapBuilder,
    submaps: Vec<Submap>,
    atlas: Atlas,
    /// Accounts of the drive, the heaviest first.
    hypotheses: Vec<Hypothesis>,
    comparisons: Vec<Comparison>,
    /// How many submaps were taken in.
    taken: usize,
    /// What is being done about the newest of them.
    job: Option<Job>,
}

/// The comparisons of one submap.
#[derive(Debug)]
struct Job {
    newer: usize,
    /// Number of its first comparison.
    first: usize,
    /// What each account doubts of the submaps it has in play.
    doubts: Vec<Vec<Doubt>>,
    /// Comparisons to be made: older submap, where the newer is expected on it, how surely.
    due: VecDeque<(usize, Pose2, Doubt)>,
}

/// An older submap that may show the same place as the newest.
struct Candidate {
    older: usize,
    world_from_older: Pose2,
    doubt: Doubt,
}

/// The drive put right.
#[derive(Debug, Clone)]
pub struct ClosedLoops {
    /// The frame with which each submap begins, and its pose.
    pub anchors: Vec<Anchor>,
    /// Every comparison, and what became of it.
    pub closures: Vec<ClosureReport>,
    /// Where the robot was carried elsewhere.
    pub kidnappings: Vec<Kidnapping>,
    /// The likeliest account's graph; its nodes are the submaps.
    pub graph: PoseGraph,
}

/// Accounts that are this much less likely than the best are given up, in log-likelihood.
const GIVEN_UP: f64 = 12.0;
/// Where a submap is expected within these of another account's expectation one comparison serves both, metres and radians.
const SAME_EXPECTATION_M: f64 = 0.2;
const SAME_EXPECTATION_RAD: f64 = 0.04;
/// A robot that was carried elsewhere is looked for on so many submaps.
const MOST_WHEN_LOST: usize = 60;
/// A submap is known when less than this share of it lies on no older one.
const NEW_SHARE: f64 = 0.3;
/// The newest submaps are kept even when they are known.
const KEPT_SUBMAPS: usize = 3;
/// Doubt widens the circle of candidates by at most this, metres.
const WIDEST_DOUBT_M: f64 = 8.0;

/// Those of which none lies next to an earlier one along the drive: a submap is looked for with its neighbours around
/// it, so that every other one will do.
fn apart(candidates: impl Iterator<Item = Candidate>) -> Vec<Candidate> {
    let mut chosen: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        if chosen.iter().all(|other| other.older.abs_diff(candidate.older) > 1) {
            chosen.push(candidate);
        }
    }
    chosen
}

impl LoopCloser {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: &LoopClosureConfig, matcher: &MatcherConfig) -> Self {
        Self {
            config: config.clone(),
            matcher: matcher.clone(),
            builder: SubmapBuilder::new(config.submap_length_m, matcher.cell_m),
            submaps: Vec::new(),
            atlas: Atlas::default(),
            hypotheses: vec![Hypothesis::default()],
            comparisons: Vec::new(),
            taken: 0,
            job: None,
        }
    }

    /// Takes in a scan that went into the front end's map. `poses_since(frame)` are the front
    /// end's poses from that frame on.
    pub fn add(&mut self, key_scan: KeyScan, poses_since: impl FnOnce(usize) -> Vec<Pose2>) {
        self.submaps.extend(self.builder.add(key_scan, poses_since));
    }

    /// Does one piece of the work; tells whether there was any.
    pub fn work(&mut self) -> bool {
        let Some(mut job) = self.job.take().or_else(|| self.next_job()) else { return false };
        let Some((older, expected, doubt)) = job.due.pop_front() else {
            self.decide(&job);
            return true;
        };
        let pair = [older, job.newer];
        let comparison = self.atlas.compare(&self.submaps, pair, expected, doubt, &self.config, &self.matcher);
        self.comparisons.push(comparison);
        self.job = Some(job);
        true
    }

    /// Takes the next submap into all accounts and finds what it is to be compared with.
    fn next_job(&mut self) -> Option<Job> {
        let newer = self.taken;
        let submap = self.submaps.get(newer)?;
        self.taken += 1;
        let mut due: VecDeque<(usize, Pose2, Doubt)> = VecDeque::new();
        for hypothesis in &mut self.hypotheses {
            hypothesis.extend(submap, &self.config);
        }
        let doubts: Vec<_> = self.hypotheses.iter().map(Hypothesis::doubts).collect();
        for (hypothesis, doubts) in self.hypotheses.iter().zip(&doubts) {
            let Some((_, pose)) = hypothesis.newest() else { continue };
            for Candidate { older, world_from_older, doubt } in self.candidates(hypothesis, doubts) {
                // Who is lost is looked for in the middle of each old submap.
                let expected = if doubt.is_lost() {
                    self.submaps[older].middle.compose(&submap.middle.inverse())
                } else {
                    world_from_older.between(&pose)
                };
                let is_covered = due.iter().any(|(other, there, _)| {
                    let offset = there.between(&expected);
                    *other == older
                        && offset.distance() < SAME_EXPECTATION_M
                        && wrap_angle(offset.theta).abs() < SAME_EXPECTATION_RAD
                });
                if !is_covered {
                    due.push_back((older, expected, doubt));
                }
            }
        }
        // Perhaps the robot was not carried at all.
        if let (Some(_), Some(link), Some(before)) = (submap.starts_anew, &submap.link, newer.checked_sub(1)) {
            let sigma = |axis: usize| link.covariance[(axis, axis)].sqrt();
            let doubt = Doubt { sigma_m: sigma(0).max(sigma(1)), sigma_rad: sigma(2) };
            due.push_front((before, link.previous_from_submap, doubt));
        }
        Some(Job { newer, first: self.comparisons.len(), doubts, due })
    }

    /// The older submaps that may show the same place as the newest: those near where it lies, nearest first, then
    /// those that it is not tied to, if the robot was carried elsewhere.
    fn candidates(&self, hypothesis: &Hypothesis, doubts: &[Doubt]) -> Vec<Candidate> {
        let Some((newest, pose)) = hypothesis.newest() else { return Vec::new() };
        let here = pose.compose(&self.submaps[newest].middle);
        let older = hypothesis.in_play().zip(doubts).filter(|&((older, _), _)| !self.submaps[older].is_known);
        let older = older.map(|((older, world_from_older), &doubt)| Candidate { older, world_from_older, doubt });
        let (mut elsewhere, tied): (Vec<_>, Vec<_>) = older.partition(|candidate| candidate.doubt.is_lost());
        let distance_m = |candidate: &Candidate| {
            let there = candidate.world_from_older.compose(&self.submaps[candidate.older].middle);
            here.between(&there).distance()
        };
        let reach_m = |doubt: &Doubt| self.config.candidate_distance_m + doubt.sigma_m.min(WIDEST_DOUBT_M);
        let near = tied.into_iter().filter(|candidate| candidate.older + 1 < newest);
        let mut near: Vec<_> = near
            .map(|candidate| (distance_m(&candidate), candidate))
            .filter(|(distance_m, candidate)| *distance_m < reach_m(&candidate.doubt))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.older.cmp(&b.1.older)));
        let mut chosen = apart(near.into_iter().map(|(_, candidate)| candidate));
        chosen.truncate(self.config.candidates);
        elsewhere.reverse();
        let mut elsewhere = apart(elsewhere.into_iter());
        // Of a large map each submap is looked for on another part.
        if elsewhere.len() > MOST_WHEN_LOST {
            let from = newest * MOST_WHEN_LOST % elsewhere.len();
            elsewhere.rotate_left(from);
            elsewhere.truncate(MOST_WHEN_LOST);
        }
        chosen.extend(elsewhere);
        chosen
    }

    /// Lets every account draw its conclusions from the comparisons of a submap.
    fn decide(&mut self, job: &Job) {
        let comparisons = &self.comparisons[job.first..];
        let mut hypotheses = std::mem::take(&mut self.hypotheses);
        if !comparisons.is_empty() {
            let with_doubts = hypotheses.into_iter().zip(&job.doubts);
            let decided = with_doubts.flat_map(|(hypothesis, doubts)| {
                hypothesis.decide(&self.submaps, doubts, comparisons, job.first, &self.config)
            });
            hypotheses = decided.collect();
        }
        for hypothesis in &mut hypotheses {
            hypothesis.relocate(&self.submaps, &self.comparisons, false, &self.config);
        }
        hypotheses.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let heaviest = hypotheses[0].log_weight;
        for mut hypothesis in hypotheses {
            let is_wanted = hypothesis.log_weight > heaviest - GIVEN_UP
                && self.hypotheses.len() < self.config.hypotheses
                && !self.hypotheses.iter().any(|heavier| heavier.agrees_with(&hypothesis));
            if is_wanted || self.hypotheses.is_empty() {
                hypothesis.log_weight -= heaviest;
                self.hypotheses.push(hypothesis);
            }
        }
        self.note_if_known(job);
    }

    /// A submap nearly all of which lies on an older one need not be kept: memory grows with the area that was
    /// seen, not with time. Its neighbours are compared yet, so that it is forgotten a little later.
    fn note_if_known(&mut self, job: &Job) {
        let places = self.hypotheses[0].closures_since(job.first).filter_map(|closure| {
            let comparison = &self.comparisons[closure.comparison];
            let is_old = self.is_long_before(&self.submaps[comparison.older], job.newer);
            let placement = &comparison.placements[closure.placement];
            (is_old && closure.is_in_force).then_some((comparison.older, placement.older_from_newer))
        });
        let places: Vec<(usize, Pose2)> = places.collect();
        let new_share = self.atlas.new_share(&self.submaps, job.newer, &places, &self.matcher);
        self.submaps[job.newer].is_known = new_share < NEW_SHARE;
        if let Some(past) = job.newer.checked_sub(KEPT_SUBMAPS).filter(|&past| self.submaps[past].is_known) {
            self.submaps[past].forget();
            let long_ago = self.submaps[..past].partition_point(|older| self.is_long_before(older, past));
            for hypothesis in &mut self.hypotheses {
                hypothesis.attach(past, long_ago);
            }
        }
    }

    /// Whether an older submap was made so long before a newer one that it is no part of the same passage.
    fn is_long_before(&self, older: &Submap, newer: usize) -> bool {
        self.submaps[newer].path_m - older.path_m > 2.0 * self.config.window_m
    }

    /// How the heaviest account moves what the front end says: world from the front end's world.
    #[must_use]
    pub fn correction(&self) -> Pose2 {
        self.hypotheses[0].newest().map_or(Pose2::IDENTITY, |(newest, pose)| {
            pose.compose(&self.submaps[newest].front_end_from_submap.inverse())
        })
    }

    /// The drive as the heaviest account has it now.
    #[must_use]
    pub fn anchors(&self) -> Vec<Anchor> {
        let poses = self.hypotheses[0].all_poses();
        let anchor = |(index, (submap, &pose)): (usize, (&Submap, &Pose2))| Anchor {
            frame: submap.first,
            pose,
            starts_anew: submap.starts_anew.filter(|_| self.hypotheses[0].is_interrupted(index)).map(|at| at.frame),
        };
        self.submaps.iter().zip(&poses).enumerate().map(anchor).collect()
    }

    /// Whether the robot was carried elsewhere and has not been found again yet.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        let is_coming = self.submaps[self.taken..].iter().any(|submap| submap.starts_anew.is_some());
        is_coming || self.builder.starts_anew() || self.hypotheses[0].is_lost()
    }

    /// What is worked with now.
    #[must_use]
    pub fn load(&self) -> ClosureLoad {
        let remembered = self.submaps.iter().filter(|submap| !submap.is_forgotten());
        let largest =
            |size: fn(&PoseGraph) -> usize| self.hypotheses.iter().map(|h| size(h.graph())).max().unwrap_or(0);
        ClosureLoad {
            submaps: remembered.count(),
            nodes: largest(|graph| graph.poses().len()),
            factors: largest(|graph| graph.between_factors().len()),
        }
    }

    /// How many accounts of the drive are held for possible.
    #[must_use]
    pub fn hypotheses(&self) -> usize {
        self.hypotheses.len()
    }

    /// Does what is left of the work.
    #[must_use]
    pub fn finish(mut self) -> ClosedLoops {
        self.submaps.extend(self.builder.clone().finish());
        while self.work() {}
        self.hypotheses[0].relocate(&self.submaps, &self.comparisons, true, &self.config);
        self.hypotheses[0].settle();
        let (comparisons, atlas) = (&mut self.comparisons, &mut self.atlas);
        self.hypotheses[0].look_again(&self.submaps, comparisons, atlas, &self.config, &self.matcher);
        ClosedLoops {
            anchors: self.anchors(),
            closures: self.reports(),
            kidnappings: self.hypotheses[0].kidnappings(&self.submaps, &self.comparisons),
            graph: self.hypotheses[0].whole_graph(),
        }
    }

    /// What became of every comparison, as the heaviest account has it.
    #[must_use]
    pub fn reports(&self) -> Vec<ClosureReport> {
        let best = &self.hypotheses[0];
        let mut verdicts: Vec<(usize, Verdict)> = self
            .comparisons
            .iter()
            .map(|comparison| match &comparison.placements[0] {
                best if !best.fits() => (0, best.verdict),
                best if best.is_conclusive() => (0, Verdict::Elsewhere),
                _ => (0, Verdict::Inconclusive),
            })
            .collect();
        for closure in best.closures() {
            let verdict = if closure.is_in_force { Verdict::Accepted } else { Verdict::Contradicted };
            verdicts[closure.comparison] = (closure.placement, verdict);
        }
        self.comparisons
            .iter()
            .zip(verdicts)
            .map(|(comparison, (placement, verdict))| {
                let placement = &comparison.placements[placement];
                let [older, newer] = [comparison.older, comparison.newer].map(|index| &self.submaps[index]);
                let correction = comparison
                    .expected
                    .compose(&newer.middle)
                    .between(&placement.older_from_newer.compose(&newer.middle));
                ClosureReport {
                    older: comparison.older,
                    newer: comparison.newer,
                    frames: [older.middle_frame, newer.middle_frame],
                    doubt_m: comparison.doubt.sigma_m,
                    correction_m: correction.distance(),
                    correction_rad: correction.theta,
                    inlier_shares: placement.inlier_shares,
                    overlap_shares: placement.overlap_shares,
                    distinctness: placement.distinctness,
                    sigma_m: placement.sigma_m(),
                    placements: comparison.placements.iter().filter(|placement| placement.fits()).count(),
                    middle_from_middle: older
                        .middle
                        .inverse()
                        .compose(&placement.older_from_newer)
                        .compose(&newer.middle),
                    verdict,
                }
            })
            .collect()
    }
}
