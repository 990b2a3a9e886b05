//! Recognises places that a drive passes more than once and puts the drive right.
//!
//! The drive is cut into submaps. Each new one is compared with older ones that may show the
//! same place; what fits splits or confirms the hypotheses about the drive (see [`Hypothesis`]).
//! Work is done in small bounded pieces, one for each scan, so that it keeps up with a live
//! robot; what is left is done at the end.

use super::LoopClosureConfig;
use super::continuity::discontinuity;
use super::hypothesis::Hypothesis;
use super::place_graph::{Job, PlaceGraph};
use super::uncertainty::Uncertainty;
use super::view_cache::ViewCache;
use crate::StopSignal;
use crate::geometry::{Pose2, wrap_angle};
use crate::scan_matcher::MatcherConfig;
use std::collections::VecDeque;
use std::sync::Arc;

/// Closes loops while the drive goes on.
#[derive(Debug)]
pub struct BackEnd {
    config: LoopClosureConfig,
    matcher: MatcherConfig,
    views: ViewCache,
}

/// An older submap that may show the same place as the newest.
struct Candidate {
    older: usize,
    world_from_older: Pose2,
    uncertainty: Uncertainty,
}

/// Hypotheses that are this much less likely than the best are given up, in log-likelihood.
const GIVEN_UP: f64 = 12.0;
/// Where a submap is expected within these of another hypothesis's expectation one comparison serves both, metres and radians.
const SAME_EXPECTATION_M: f64 = 0.2;
const SAME_EXPECTATION_RAD: f64 = 0.04;
/// A robot that was kidnapped is looked for on so many submaps.
const MOST_WHEN_LOST: usize = 60;
/// … and on so many at least, however many submaps are waiting.
const LEAST_WHEN_LOST: usize = 4;
/// A submap is known when less than this share of it lies on no older one.
const NEW_SHARE: f64 = 0.3;
/// The newest submaps are kept even when they are known.
const KEPT_SUBMAPS: usize = 3;
/// Uncertainty widens the circle of candidates by at most this, metres.
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

impl BackEnd {
    /// Nothing done yet.
    #[must_use]
    pub fn new(config: &LoopClosureConfig, matcher: &MatcherConfig) -> Self {
        Self { config: config.clone(), matcher: matcher.clone(), views: ViewCache::default() }
    }

    /// Does one piece of the work; tells whether there was any.
    pub fn work(&mut self, places: &mut PlaceGraph) -> bool {
        let Some(mut job) = places.job.take().or_else(|| self.next_job(places)) else { return false };
        let Some((older, expected, uncertainty)) = job.due.pop_front() else {
            self.decide(&job, places);
            return true;
        };
        let pair = [older, job.newer];
        let Self { views, config, matcher, .. } = self;
        let mut comparison = views.compare(&places.submaps, pair, expected, uncertainty, config, matcher);
        // What lies across an interruption is compared first.
        if places.comparisons.len() == job.first
            && older + 1 == job.newer
            && places.submaps[job.newer].interruption.is_some()
        {
            let previous_from_submap = comparison.placements[0].older_from_newer;
            comparison.discontinuity = discontinuity(job.newer, &previous_from_submap, &places.submaps, views, matcher);
        }
        places.comparisons.push(comparison);
        places.job = Some(job);
        true
    }

    /// Takes the next submap into all hypotheses and finds what it is to be compared with.
    fn next_job(&mut self, places: &mut PlaceGraph) -> Option<Job> {
        let newer = places.taken;
        let submap = places.submaps.get(newer)?;
        places.taken += 1;
        let mut due: VecDeque<(usize, Pose2, Uncertainty)> = VecDeque::new();
        for hypothesis in &mut places.hypotheses {
            hypothesis.extend(submap, &self.config);
        }
        let uncertainties: Vec<_> = places.hypotheses.iter().map(Hypothesis::uncertainties).collect();
        for (hypothesis, uncertainties) in places.hypotheses.iter().zip(&uncertainties) {
            let Some((_, pose)) = hypothesis.newest() else { continue };
            for Candidate { older, world_from_older, uncertainty } in self.candidates(places, hypothesis, uncertainties)
            {
                // Who is lost is looked for in the middle of each old submap.
                let expected = if uncertainty.is_lost() {
                    places.submaps[older].middle.compose(&submap.middle.inverse())
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
                    due.push_back((older, expected, uncertainty));
                }
            }
        }
        // Perhaps the robot was not carried at all.
        if let (Some(_), Some(link), Some(before)) = (submap.interruption, &submap.link, newer.checked_sub(1)) {
            let sigma = |axis: usize| link.covariance[(axis, axis)].sqrt();
            let uncertainty = Uncertainty { sigma_m: sigma(0).max(sigma(1)), sigma_rad: sigma(2) };
            due.push_front((before, link.previous_from_submap, uncertainty));
        }
        places.learn_uncertainty();
        Some(Job { newer, first: places.comparisons.len(), uncertainties, due })
    }

    /// The older submaps that may show the same place as the newest: those near where it lies, nearest first, then
    /// those that it is not connected to, if the robot was kidnapped.
    fn candidates(
        &self,
        places: &PlaceGraph,
        hypothesis: &Hypothesis,
        uncertainties: &[Uncertainty],
    ) -> Vec<Candidate> {
        let Some((newest, pose)) = hypothesis.newest() else { return Vec::new() };
        let here = pose.compose(&places.submaps[newest].middle);
        let older = hypothesis.in_play().zip(uncertainties).filter(|&((older, _), _)| !places.submaps[older].is_known);
        let older =
            older.map(|((older, world_from_older), &uncertainty)| Candidate { older, world_from_older, uncertainty });
        let (mut elsewhere, tied): (Vec<_>, Vec<_>) = older.partition(|candidate| candidate.uncertainty.is_lost());
        let distance_m = |candidate: &Candidate| {
            let there = candidate.world_from_older.compose(&places.submaps[candidate.older].middle);
            here.between(&there).distance()
        };
        let reach_m =
            |uncertainty: &Uncertainty| self.config.candidate_distance_m + uncertainty.sigma_m.min(WIDEST_DOUBT_M);
        let near = tied.into_iter().filter(|candidate| candidate.older + 1 < newest);
        let mut near: Vec<_> = near
            .map(|candidate| (distance_m(&candidate), candidate))
            .filter(|(distance_m, candidate)| *distance_m < reach_m(&candidate.uncertainty))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.older.cmp(&b.1.older)));
        let mut chosen = apart(near.into_iter().map(|(_, candidate)| candidate));
        chosen.truncate(self.config.candidates);
        elsewhere.reverse();
        let mut elsewhere = apart(elsewhere.into_iter());
        // Of a large map each submap is looked for on another part; on less of it, if others are waiting.
        let waiting = places.submaps.len() - places.taken;
        let most = (MOST_WHEN_LOST / (1 + waiting)).max(LEAST_WHEN_LOST);
        if elsewhere.len() > most {
            let from = newest * most % elsewhere.len();
            elsewhere.rotate_left(from);
            elsewhere.truncate(most);
        }
        chosen.extend(elsewhere);
        chosen
    }

    /// Lets every hypothesis draw its conclusions from the comparisons of a submap.
    fn decide(&mut self, job: &Job, places: &mut PlaceGraph) {
        let comparisons = &places.comparisons[job.first..];
        let mut hypotheses = std::mem::take(&mut places.hypotheses);
        if !comparisons.is_empty() {
            let with_doubts = hypotheses.into_iter().zip(&job.uncertainties);
            let decided = with_doubts.flat_map(|(hypothesis, uncertainties)| {
                hypothesis.decide(&places.submaps, uncertainties, comparisons, job.first, &self.config)
            });
            hypotheses = decided.collect();
        }
        for hypothesis in &mut hypotheses {
            hypothesis.relocate(&places.submaps, &places.comparisons, false, &self.config);
        }
        hypotheses.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let heaviest = hypotheses[0].log_weight;
        for mut hypothesis in hypotheses {
            let is_wanted = hypothesis.log_weight > heaviest - GIVEN_UP
                && places.hypotheses.len() < self.config.hypotheses
                && !places.hypotheses.iter().any(|heavier| heavier.agrees_with(&hypothesis));
            if is_wanted || places.hypotheses.is_empty() {
                hypothesis.log_weight -= heaviest;
                places.hypotheses.push(hypothesis);
            }
        }
        self.note_if_known(job, places);
        places.learn_uncertainty();
    }

    /// A submap nearly all of which lies on an older one need not be kept: memory grows with the area that was
    /// seen, not with time. Its neighbours are compared yet, so that it is forgotten a little later.
    fn note_if_known(&mut self, job: &Job, places: &mut PlaceGraph) {
        let known = places.hypotheses[0].closures_since(job.first).filter_map(|closure| {
            let comparison = &places.comparisons[closure.comparison];
            let is_old = places.is_long_before(&places.submaps[comparison.older], job.newer, self.config.window_m);
            let placement = &comparison.placements[closure.placement];
            (is_old && closure.is_in_force).then_some((comparison.older, placement.older_from_newer))
        });
        let known: Vec<(usize, Pose2)> = known.collect();
        let new_share = self.views.new_share(&places.submaps, job.newer, &known, &self.matcher);
        let middle = places.submaps[job.newer].middle;
        let away_m = |(older, older_from_newer): &(usize, Pose2)| {
            places.submaps[*older].middle.between(&older_from_newer.compose(&middle)).distance()
        };
        let nearest = known.iter().min_by(|a, b| away_m(a).total_cmp(&away_m(b))).map(|(older, _)| *older);
        let is_known = new_share < NEW_SHARE;
        let newer = Arc::make_mut(&mut places.submaps[job.newer]);
        (newer.is_known, newer.shown_by) = (is_known, nearest.filter(|_| is_known));
        if let Some(past) = job.newer.checked_sub(KEPT_SUBMAPS).filter(|&past| places.submaps[past].is_known) {
            Arc::make_mut(&mut places.submaps[past]).forget();
            let long_ago = places.submaps[..past]
                .partition_point(|older| places.is_long_before(older, past, self.config.window_m));
            for hypothesis in &mut places.hypotheses {
                hypothesis.attach(past, long_ago);
            }
            places.keep_newest_passes(past, &self.config);
        }
    }

    /// Does what is left of the work: the drive ends here. Less of it where the signal is given.
    pub fn finish(mut self, places: &mut PlaceGraph, stop: &StopSignal) {
        let last = places.builder.finish();
        places.submaps.extend(last.map(Arc::new));
        while !stop.is_given() && self.work(places) {}
        if stop.is_given() {
            return;
        }
        let PlaceGraph { submaps, hypotheses, comparisons, .. } = places;
        let best = &mut hypotheses[0];
        best.relocate(submaps, comparisons, true, &self.config);
        best.settle();
        best.look_again(submaps, comparisons, &mut self.views, &self.config, &self.matcher, stop);
        places.learn_uncertainty();
    }
}
