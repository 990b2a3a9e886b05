//! Finding a robot that was kidnapped on what it had seen before.
//!
//! What it sees from then on is a drive of its own, whose place is open. Its submaps are looked for on all older ones;
//! each sighting proposes a place for the whole drive since. It is placed once several submaps agree, more than should be
//! seen there and are not, and no other place explains nearly as much: until then it is better nowhere than in a wrong place.

use super::LoopClosureConfig;
use super::Verdict;
use super::evidence::{EVIDENCE_OF_WITNESS, MISS_EVIDENCE, MOST_WITNESSES, fit_evidence};
use super::hypothesis::{
    AGREEMENT_M, AGREEMENT_RAD, Break, CONFLICT, Constraint, Found, Hypothesis, Kidnapping, Outcome, closure_factor,
    kidnapped_covariance,
};
use super::place_match::Comparison;
use super::submap::Submap;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, symmetric};
use crate::pose_graph::Optimizer;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// How much has to speak for a place before the drive is put there: log-likelihood, about what two submaps say that
/// fit well …
const LEAST_EVIDENCE: f64 = 6.0;
/// … or one, at the end of the drive: nothing better is to come.
const LEAST_EVIDENCE_AT_THE_END: f64 = 2.5;
/// It has to be so much more than for any other place …
const MARGIN: f64 = 3.0;
/// … of which none may have more than this share of it: where much looks alike, places not seen before do, too.
const RIVAL_SHARE: f64 = 0.4;
/// The newest so many submaps are asked.
const SUBMAPS_ASKED: usize = 20;
/// The drive since may bend by so much per metre.
const BEND: f64 = 0.02;
/// Where it is not certain that the robot was carried, that it was not is as likely as all other places together:
/// log-likelihood, metres and radians.
const PRIOR_OF_STAYING: f64 = 4.0;
const STAYING_M: f64 = 1.0;
const STAYING_RAD: f64 = 0.2;
/// What the submaps before and after have in view is ordinarily less alike than on average by up to so many standard deviations;
/// by more than so many it is another place. In between the robot may have stayed.
const ORDINARY: f64 = 1.5;
const EXTRAORDINARY: f64 = 3.0;
/// Where nothing is known to be ordinary it was carried, if less than this of it looks the same.
const STAYING_QUALITY: f64 = 0.85;
/// It was not, if after so many submaps nothing speaks for another place.
const SUBMAPS_UNTIL_STAYING: usize = 4;
/// A submap should be seen on an older one where their middles would lie so near, in submaps' lengths.
const PASSED_LENGTHS: f64 = 0.5;

/// A submap that was looked for on a place that it is not connected to.
struct Attempt {
    newer: usize,
    /// Where its middle lies as yet.
    middle: Pose2,
    /// Where the older one's middle lies.
    older_middle: Pose2,
}

impl Attempt {
    /// Whether it should have been seen there, if a sighting put the drive in its place: it passes there the same way.
    fn would_show(&self, sighting: &Sighting, config: &LoopClosureConfig) -> bool {
        let offset = self.older_middle.between(&sighting.shift.compose(&self.middle));
        offset.distance() < PASSED_LENGTHS * config.submap_length_m && offset.theta.abs() < FRAC_PI_2
    }
}

/// A submap seen on a place that it is not connected to.
struct Sighting {
    newer: usize,
    older: usize,
    /// How it moves the drive since the interruption.
    shift: Pose2,
    /// Where the submap's middle lies as yet.
    middle: Pose2,
    /// By how much it fits better than a wrong place would, and what that is worth: log-likelihood.
    surplus: f64,
    evidence: f64,
    /// Numbers of the comparison and the placement.
    member: (usize, usize),
}

impl Sighting {
    /// Whether it leaves the drive about where it was thought to be.
    fn is_where_it_was(&self) -> bool {
        let offset = self.middle.between(&self.shift.compose(&self.middle));
        offset.distance() < STAYING_M && offset.theta.abs() < STAYING_RAD
    }

    /// Whether both put the drive in the same place.
    fn agrees_with(&self, other: &Self) -> bool {
        let [a, b] = [self, other].map(|sighting| sighting.shift.compose(&self.middle));
        let offset = a.between(&b);
        let bend = BEND * self.middle.between(&other.middle).distance();
        offset.distance() < AGREEMENT_M + bend && offset.theta.abs() < AGREEMENT_RAD + 0.1 * bend
    }

    /// What all submaps together say for a place: of each the best sighting, and those on other submaps as witnesses.
    fn evidence_for_place(&self, sightings: &[Self]) -> f64 {
        let mut by_submap: BTreeMap<usize, BTreeMap<usize, &Self>> = BTreeMap::new();
        for sighting in sightings.iter().filter(|sighting| sighting.agrees_with(self)) {
            let best = by_submap.entry(sighting.newer).or_default().entry(sighting.older).or_insert(sighting);
            if sighting.evidence > best.evidence {
                *best = sighting;
            }
        }
        let evidence_of = |on_submaps: BTreeMap<usize, &Self>| {
            let mut sightings: Vec<&Self> = on_submaps.into_values().collect();
            sightings.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
            let witnesses: f64 = sightings.iter().skip(1).take(MOST_WITNESSES).map(|witness| witness.surplus).sum();
            match sightings.first() {
                Some(best) if best.evidence > 0.0 => best.evidence + EVIDENCE_OF_WITNESS * witnesses,
                _ => 0.0,
            }
        };
        by_submap.into_values().map(evidence_of).sum()
    }

    /// How many submaps should have been seen where it puts the drive, and were not.
    fn misses(&self, attempts: &[Attempt], sightings: &[Self], config: &LoopClosureConfig) -> usize {
        let expected: BTreeSet<usize> =
            attempts.iter().filter(|attempt| attempt.would_show(self, config)).map(|attempt| attempt.newer).collect();
        let agreeing = sightings.iter().filter(|sighting| sighting.agrees_with(self));
        let seen: BTreeSet<usize> = agreeing.map(|sighting| sighting.newer).collect();
        expected.difference(&seen).count()
    }
}

impl Hypothesis {
    /// Whether the robot was carried between a submap and the one before.
    #[must_use]
    pub fn is_interrupted(&self, submap: usize) -> bool {
        self.breaks.iter().any(|at| at.submap == submap && self.is_kidnapping(at))
    }

    fn is_kidnapping(&self, at: &Break) -> bool {
        match at.outcome {
            Outcome::Open => at.interruption.is_certain,
            Outcome::Found(_) => true,
            // What came later may say otherwise.
            Outcome::Suspected | Outcome::Stayed => {
                self.link_to(at.submap).is_some_and(|link| self.graph.squared_error(link) > CONFLICT)
            }
        }
    }

    /// Number of the factor that constraints the first submap after an interruption to the one before.
    fn link_to(&self, submap: usize) -> Option<usize> {
        let node = self.node_of(submap)?;
        self.graph.between_factors().iter().position(|factor| factor.from + 1 == node && factor.to == node)
    }

    /// Which nodes a submap is connected to, other than by a motion on which the robot may have been kidnapped.
    pub(super) fn connected_to(&self, submap: usize) -> Vec<bool> {
        let interrupted = self.breaks.iter().filter(|at| at.is_interrupted());
        let contradicted =
            self.constraints.iter().map(|constraint| constraint.factor).filter(|&factor| !self.is_in_force(factor));
        let broken: Vec<usize> = interrupted.filter_map(|at| self.link_to(at.submap)).chain(contradicted).collect();
        let count = self.graph.poses().len();
        let mut neighbours = vec![Vec::new(); count];
        for (number, factor) in self.graph.between_factors().iter().enumerate() {
            if !broken.contains(&number) {
                neighbours[factor.from].push(factor.to);
                neighbours[factor.to].push(factor.from);
            }
        }
        let mut tied = vec![false; count];
        let mut due: Vec<usize> = self.node_of(submap).into_iter().collect();
        while let Some(here) = due.pop() {
            if !std::mem::replace(&mut tied[here], true) {
                due.extend(neighbours[here].iter().filter(|&&next| !tied[next]));
            }
        }
        tied
    }

    /// Where the robot was kidnapped.
    #[must_use]
    pub fn kidnappings(&self, submaps: &[Arc<Submap>], comparisons: &[Comparison]) -> Vec<Kidnapping> {
        let found = |at: &Break| match at.outcome {
            Outcome::Open => None,
            Outcome::Found(found) => Some(found),
            Outcome::Suspected | Outcome::Stayed => {
                let in_force = self.closures().filter(|closure| closure.is_in_force);
                let across = in_force
                    .map(|closure| &comparisons[closure.comparison])
                    .filter(|comparison| comparison.older < at.submap && comparison.newer >= at.submap)
                    .min_by_key(|comparison| comparison.newer)?;
                Some(Found { frame: submaps[across.newer].middle_frame, earlier: submaps[across.older].middle_frame })
            }
        };
        let kidnapping = |at: &Break| Kidnapping { frame: at.interruption.frame, found: found(at) };
        self.breaks.iter().filter(|at| self.is_kidnapping(at)).map(kidnapping).collect()
    }

    /// Whether the robot may have been kidnapped and it is not known where to.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        let newest = self.newest().filter(|_| self.open_breaks().next().is_some());
        newest.is_some_and(|(newest, _)| !self.connected_to(newest)[0])
    }

    /// Whether the robot is suspected to have been kidnapped, and what the submaps before and after say is not known yet.
    pub(super) fn is_suspected(&self) -> bool {
        self.breaks.iter().any(|at| at.outcome == Outcome::Suspected)
    }

    /// Looks for a robot that may have been kidnapped, given the comparisons of the drive up to the newest submap.
    pub fn relocate(
        &mut self,
        submaps: &[Arc<Submap>],
        comparisons: &[Comparison],
        is_end: bool,
        config: &LoopClosureConfig,
    ) {
        let Some((newest, _)) = self.newest() else { return };
        self.judge_breaks(comparisons);
        if self.open_breaks().next().is_none() {
            return;
        }
        let tied = self.connected_to(newest);
        let (attempts, sightings) = self.attempts(submaps, newest, comparisons, &tied);
        let is_certain = self.open_breaks().all(|at| at.interruption.is_certain);
        let least = if is_end && is_certain { LEAST_EVIDENCE_AT_THE_END } else { LEAST_EVIDENCE };
        let evidence = |sighting: &Sighting| {
            let prior = if !is_certain && sighting.is_where_it_was() { PRIOR_OF_STAYING } else { 0.0 };
            let evidence = sighting.evidence_for_place(&sightings) + prior;
            // Where too little speaks for a place it need not be asked what speaks against it.
            let misses = if evidence > least { sighting.misses(&attempts, &sightings, config) } else { 0 };
            evidence - MISS_EVIDENCE * misses as f64
        };
        let mut places: Vec<&Sighting> = Vec::new();
        for sighting in &sightings {
            if !places.iter().any(|place| sighting.agrees_with(place)) {
                places.push(sighting);
            }
        }
        let places: Vec<(&Sighting, f64)> = places.into_iter().map(|place| (place, evidence(place))).collect();
        if let Some(&(best, most)) = places.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
            let rivals = places.iter().filter(|(place, _)| !place.agrees_with(best));
            let rival = rivals.map(|(_, evidence)| *evidence).fold(0.0, f64::max);
            if most > least && most - rival > MARGIN && rival < RIVAL_SHARE * most {
                self.place(best, &sightings, &tied, comparisons, config);
                self.note_what_is_bridged(best, submaps);
            }
        }
        for at in 0..self.breaks.len() {
            let Break { submap, interruption, outcome, .. } = self.breaks[at];
            let is_late = is_end || newest >= submap + SUBMAPS_UNTIL_STAYING;
            if outcome == Outcome::Open && !interruption.is_certain && is_late {
                self.stay(at);
            }
        }
    }

    fn open_breaks(&self) -> impl Iterator<Item = &Break> {
        self.breaks.iter().filter(|at| at.outcome == Outcome::Open)
    }

    /// Where the newest submaps were looked for, and seen, on places that they are not connected to.
    fn attempts(
        &self,
        submaps: &[Arc<Submap>],
        newest: usize,
        comparisons: &[Comparison],
        tied: &[bool],
    ) -> (Vec<Attempt>, Vec<Sighting>) {
        let (mut attempts, mut sightings) = (Vec::new(), Vec::new());
        let recent = comparisons.iter().enumerate().rev().take_while(|(_, c)| c.newer + SUBMAPS_ASKED > newest);
        for (number, comparison) in recent {
            let (newer, older) = (comparison.newer, comparison.older);
            let (Some(older_node), Some(node)) = (self.node_of(older), self.node_of(newer)) else { continue };
            if !tied[node] || tied[older_node] {
                continue;
            }
            let [older_pose, pose] = [older_node, node].map(|node| self.graph.poses()[node]);
            let middle = pose.compose(&submaps[newer].middle);
            attempts.push(Attempt { newer, middle, older_middle: older_pose.compose(&submaps[older].middle) });
            let best = comparison.placements[0].quality();
            let fits = comparison.placements.iter().enumerate().filter(|(_, placement)| placement.fits());
            sightings.extend(fits.map(|(index, placement)| Sighting {
                newer,
                older,
                shift: older_pose.compose(&placement.older_from_newer).compose(&pose.inverse()),
                middle,
                surplus: placement.surplus(),
                evidence: fit_evidence(placement.surplus(), best - placement.quality()).max(0.0),
                member: (number, index),
            }));
        }
        (attempts, sightings)
    }

    /// Puts the drive where a sighting says, with all sightings that agree.
    fn place(
        &mut self,
        best: &Sighting,
        sightings: &[Sighting],
        tied: &[bool],
        comparisons: &[Comparison],
        config: &LoopClosureConfig,
    ) {
        // The start of the drive stays where it is.
        let (moved, shift) =
            if tied[0] { (self.connected_to(best.older), best.shift.inverse()) } else { (tied.to_vec(), best.shift) };
        let poses = self.graph.poses_mut().iter_mut().zip(&moved);
        poses.filter(|(_, is_moved)| **is_moved).for_each(|(pose, _)| *pose = shift.compose(pose));
        for sighting in sightings.iter().filter(|sighting| sighting.agrees_with(best)) {
            let (comparison, placement) = sighting.member;
            let compared = &comparisons[comparison];
            let nodes = self.node_of(compared.older).zip(self.node_of(compared.newer));
            let factor = nodes
                .and_then(|(older, newer)| closure_factor([older, newer], &compared.placements[placement], config));
            if let Some(factor) = factor.and_then(|factor| self.graph.add_between(factor).ok()) {
                self.constraints.push(Constraint { factor, comparison, placement });
            }
        }
        // A graph that cannot be solved keeps its estimates.
        let _ = Optimizer::default().optimize(&mut self.graph);
        self.misses = 0;
    }

    /// Notes which interruptions the placing of the drive has bridged.
    fn note_what_is_bridged(&mut self, best: &Sighting, submaps: &[Arc<Submap>]) {
        let [newest, older] = [self.newest().map_or(0, |(newest, _)| newest), best.older];
        let found = Found { frame: submaps[newest].middle_frame, earlier: submaps[older].middle_frame };
        for at in 0..self.breaks.len() {
            let Break { submap, interruption, outcome, .. } = self.breaks[at];
            let before = self.node_of(submap).unwrap_or(0);
            if outcome == Outcome::Open && self.connected_to(submap)[..before].contains(&true) {
                if best.is_where_it_was() && !interruption.is_certain {
                    self.stay(at);
                } else {
                    self.breaks[at].outcome = Outcome::Found(found);
                }
            }
        }
    }

    /// Hears what the submaps right before and after each interruption say that is not decided yet.
    fn judge_breaks(&mut self, comparisons: &[Comparison]) {
        for at in 0..self.breaks.len() {
            let undecided = &mut self.breaks[at];
            match (undecided.outcome, undecided.across(comparisons)) {
                (Outcome::Open, Some(across)) if !undecided.interruption.is_suspicion => {
                    let is_elsewhere = is_elsewhere(across);
                    undecided.interruption.is_certain = is_elsewhere.unwrap_or(undecided.interruption.is_certain);
                }
                (Outcome::Suspected, Some(across)) if discontinuity(across) > ORDINARY => {
                    undecided.interruption.is_certain = discontinuity(across) > EXTRAORDINARY;
                    self.carry(at);
                }
                (Outcome::Suspected, _) => undecided.outcome = Outcome::Stayed,
                (Outcome::Open | Outcome::Stayed | Outcome::Found(_), _) => {}
            }
        }
    }

    /// The robot that was suspected to have been carried may have been: what the front end says of its motion counts no more.
    fn carry(&mut self, at: usize) {
        let carried = &mut self.breaks[at];
        carried.outcome = Outcome::Open;
        let Break { submap, information, .. } = *carried;
        let covariance = inverse(&information) + kidnapped_covariance();
        if let Some(link) = self.link_to(submap) {
            self.graph.set_information(link, symmetric(&inverse(&covariance)));
        }
    }

    /// The robot was not carried: what the front end says of its motion counts.
    fn stay(&mut self, at: usize) {
        self.breaks[at].outcome = Outcome::Stayed;
        if let Some(link) = self.link_to(self.breaks[at].submap) {
            self.graph.set_information(link, self.breaks[at].information);
        }
    }
}

impl Break {
    /// Whether the motion to its submap counts for nothing.
    fn is_interrupted(&self) -> bool {
        matches!(self.outcome, Outcome::Open | Outcome::Found(_))
    }

    /// The comparison of the submaps right before and after it, where there is one.
    fn across<'a>(&self, comparisons: &'a [Comparison]) -> Option<&'a Comparison> {
        comparisons.iter().find(|c| c.newer == self.submap && c.older + 1 == self.submap)
    }
}

/// Whether what the submaps right before and after an interruption have in view is alike by itself, whatever is ordinary.
fn looks_the_same(across: &Comparison) -> bool {
    across.placements[0].quality() >= STAYING_QUALITY
}

/// By how many standard deviations they look less alike than is ordinary: by infinitely many or by none where nothing is known
/// to be.
fn discontinuity(across: &Comparison) -> f64 {
    across.discontinuity.unwrap_or(if looks_the_same(across) { 0.0 } else { f64::INFINITY })
}

/// Whether they certainly show different places; `None` where they do not tell.
fn is_elsewhere(across: &Comparison) -> Option<bool> {
    let placement = &across.placements[0];
    let is_extraordinary = across.discontinuity.map(|sigmas| sigmas > EXTRAORDINARY);
    if placement.verdict == Verdict::TooLittleInCommon {
        return is_extraordinary;
    }
    // What does not look the same is not the same place; what does may be.
    Some(!(placement.fits() && looks_the_same(across)) || is_extraordinary == Some(true))
}
