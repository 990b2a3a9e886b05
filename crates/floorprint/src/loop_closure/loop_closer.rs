//! Recognises places that a drive passes more than once and puts the drive right.
//!
//! The drive is cut into submaps. Each new one is compared with older ones that may show the
//! same place; what fits splits or confirms the accounts of the drive (see [`Hypothesis`]).
//! Work is done in small bounded pieces, one for each scan, so that it keeps up with a live
//! robot; what is left is done at the end.

use super::comparison::{Atlas, Comparison, Doubt};
use super::hypothesis::Hypothesis;
use super::submap::{Submap, SubmapBuilder};
use super::{Anchor, ClosureReport, KeyScan, Kidnapping, LoopClosureConfig, Verdict};
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
    /// Comparisons to be made: older submap, where the newer is expected on it, how surely.
    due: VecDeque<(usize, Pose2, Doubt)>,
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
/// A submap is known when so much of it was in view of an older one, and so much of that lies on it.
const KNOWN_OVERLAP_SHARE: f64 = 0.75;
const KNOWN_INLIER_SHARE: f64 = 0.8;
/// The newest submaps are kept even when they are known.
const KEPT_SUBMAPS: usize = 3;
/// Doubt widens the circle of candidates by at most this, metres.
const WIDEST_DOUBT_M: f64 = 8.0;

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
            hypotheses: vec![Hypothesis::new()],
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
        for hypothesis in &self.hypotheses {
            let (poses, doubts) = (hypothesis.poses(), hypothesis.doubts_from(newer));
            for older in self.candidates(newer, poses, &doubts) {
                // Who is lost is looked for in the middle of each old submap.
                let expected = if doubts[older].is_lost() {
                    self.submaps[older].middle.compose(&submap.middle.inverse())
                } else {
                    poses[older].between(&poses[newer])
                };
                let is_covered = due.iter().any(|(other, there, _)| {
                    let offset = there.between(&expected);
                    *other == older
                        && offset.distance() < SAME_EXPECTATION_M
                        && wrap_angle(offset.theta).abs() < SAME_EXPECTATION_RAD
                });
                if !is_covered {
                    due.push_back((older, expected, doubts[older]));
                }
            }
        }
        // Perhaps the robot was not carried at all.
        if let (Some(_), Some(link), Some(before)) = (submap.starts_anew, &submap.link, newer.checked_sub(1)) {
            let sigma = |axis: usize| link.covariance[(axis, axis)].sqrt();
            let doubt = Doubt { sigma_m: sigma(0).max(sigma(1)), sigma_rad: sigma(2) };
            due.push_front((before, link.previous_from_submap, doubt));
        }
        Some(Job { newer, first: self.comparisons.len(), due })
    }

    /// The older submaps that may show the same place: those near where the newer one lies, nearest first, then those
    /// that it is not tied to, if the robot was carried elsewhere.
    fn candidates(&self, newer: usize, poses: &[Pose2], doubts: &[Doubt]) -> Vec<usize> {
        let place = |index: usize| poses[index].compose(&self.submaps[index].middle);
        let here = place(newer);
        let older = || (0..newer).filter(|&older| !self.submaps[older].is_known);
        let mut near: Vec<(f64, usize)> = older()
            .filter(|&older| older + 1 < newer && !doubts[older].is_lost())
            .filter_map(|older| {
                let distance_m = here.between(&place(older)).distance();
                let reach_m = self.config.candidate_distance_m + doubts[older].sigma_m.min(WIDEST_DOUBT_M);
                (distance_m < reach_m).then_some((distance_m, older))
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // A submap is looked for with its neighbours around it: every other one will do.
        let apart = |chosen: &[usize], older: usize| chosen.iter().all(|other| other.abs_diff(older) > 1);
        let mut chosen: Vec<usize> = Vec::new();
        for (_, older) in near {
            if chosen.len() < self.config.candidates && apart(&chosen, older) {
                chosen.push(older);
            }
        }
        let mut elsewhere: Vec<usize> = Vec::new();
        for older in older().filter(|&older| doubts[older].is_lost()).rev() {
            if apart(&elsewhere, older) {
                elsewhere.push(older);
            }
        }
        // Of a large map each submap is looked for on another part.
        if elsewhere.len() > MOST_WHEN_LOST {
            let from = newer * MOST_WHEN_LOST % elsewhere.len();
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
            let decide =
                |account: Hypothesis| account.decide(&self.submaps, job.newer, comparisons, job.first, &self.config);
            hypotheses = hypotheses.into_iter().flat_map(decide).collect();
        }
        for hypothesis in &mut hypotheses {
            hypothesis.relocate(&self.submaps, job.newer, &self.comparisons, false, &self.config);
        }
        hypotheses.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let least = hypotheses[0].log_weight - GIVEN_UP;
        for hypothesis in hypotheses {
            let is_wanted = hypothesis.log_weight > least
                && self.hypotheses.len() < self.config.hypotheses
                && !self.hypotheses.iter().any(|heavier| heavier.agrees_with(&hypothesis));
            if is_wanted || self.hypotheses.is_empty() {
                self.hypotheses.push(hypothesis);
            }
        }
        self.note_if_known(job);
        let heaviest = self.hypotheses[0].log_weight;
        for hypothesis in &mut self.hypotheses {
            hypothesis.log_weight -= heaviest;
        }
    }

    /// A submap nearly all of which lies on an older one need not be kept: memory grows with the area that was
    /// seen, not with time. Its neighbours are compared yet, so that it is forgotten a little later.
    fn note_if_known(&mut self, job: &Job) {
        let is_covered = |closure: &&super::Closure| {
            let comparison = &self.comparisons[closure.comparison];
            let placement = &comparison.placements[closure.placement];
            self.is_long_ago(comparison.older, job.newer)
                && placement.overlap_shares[0] > KNOWN_OVERLAP_SHARE
                && placement.inlier_shares[0] > KNOWN_INLIER_SHARE
        };
        let closures = self.hypotheses[0].closures().iter().rev();
        let of_this = closures.take_while(|closure| closure.comparison >= job.first);
        self.submaps[job.newer].is_known = of_this.filter(is_covered).count() > 0;
        if let Some(past) = job.newer.checked_sub(KEPT_SUBMAPS).filter(|&past| self.submaps[past].is_known) {
            self.submaps[past].forget();
            let long_ago = (0..past).take_while(|&older| self.is_long_ago(older, past)).count();
            for hypothesis in &mut self.hypotheses {
                hypothesis.attach(past, long_ago);
            }
        }
    }

    /// Whether an older submap was made so long before a newer one that it is no part of the same passage.
    fn is_long_ago(&self, older: usize, newer: usize) -> bool {
        self.submaps[newer].path_m - self.submaps[older].path_m > 2.0 * self.config.window_m
    }

    /// How the heaviest account moves what the front end says: world from the front end's world.
    #[must_use]
    pub fn correction(&self) -> Pose2 {
        let poses = self.hypotheses[0].poses();
        poses.last().map_or(Pose2::IDENTITY, |pose| {
            pose.compose(&self.submaps[poses.len() - 1].front_end_from_submap.inverse())
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
        if let Some(newest) = self.taken.checked_sub(1) {
            self.hypotheses[0].relocate(&self.submaps, newest, &self.comparisons, true, &self.config);
        }
        self.hypotheses[0].settle();
        ClosedLoops {
            anchors: self.anchors(),
            closures: self.reports(),
            kidnappings: self.hypotheses[0].kidnappings(&self.submaps, &self.comparisons),
            graph: self.hypotheses[0].graph().clone(),
        }
    }

    /// What became of every comparison, as the heaviest account has it.
    #[must_use]
    pub fn reports(&self) -> Vec<ClosureReport> {
        let best = &self.hypotheses[0];
        let mut verdicts: Vec<(usize, Verdict)> = self
            .comparisons
            .iter()
            .map(|comparison| match comparison.placements[0].verdict {
                Verdict::Accepted => (0, Verdict::Elsewhere),
                verdict => (0, verdict),
            })
            .collect();
        for closure in best.closures() {
            let verdict = if best.is_in_force(closure) { Verdict::Accepted } else { Verdict::Contradicted };
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
