//! A second look at places that turn out to lie on each other once the drive is put right.
//!
//! While the drive goes on a fit has to prove itself against every other place that the drift allows. In the end it is
//! known well where each submap lies, so that a fit right there needs far less proof: ties that were refused for want
//! of it, or never looked for, are made up for, and walls seen on several passes become one.

use super::LoopClosureConfig;
use super::comparison::{Atlas, Comparison};
use super::doubt::Doubt;
use super::hypothesis::{Hypothesis, ROUTINE_M, ROUTINE_RAD, Tie, closure_factor};
use super::submap::Submap;
use crate::geometry::wrap_angle;
use crate::scan_matcher::MatcherConfig;
use std::collections::BTreeSet;

/// How well it is known where submaps lie: within reach of the fine matcher, so that nothing is searched.
const DOUBT: Doubt = Doubt { sigma_m: 0.1, sigma_rad: 0.03 };
/// A fit that is hardly better than places farther on says nothing about where along a corridor a submap lies.
const MIN_DISTINCTNESS: f64 = 0.1;

impl Hypothesis {
    /// Compares all submaps in play that lie close to each other and are not tied together, and ties those that fit
    /// about where they lie. The comparisons are added to `comparisons`.
    pub(super) fn look_again(
        &mut self,
        submaps: &[Submap],
        comparisons: &mut Vec<Comparison>,
        atlas: &mut Atlas,
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
    ) {
        let known = self.ties.len();
        for pair in self.pairs_not_tied(submaps, comparisons, config) {
            let [Some(older), Some(newer)] = pair.map(|submap| self.node_of(submap)) else { continue };
            let nodes = [older, newer];
            let expected = self.graph.poses()[older].between(&self.graph.poses()[newer]);
            let comparison = atlas.compare(submaps, pair, expected, DOUBT, config, matcher);
            let middle = submaps[pair[1]].middle;
            let placement = &comparison.placements[0];
            let shift = expected.compose(&middle).between(&placement.older_from_newer.compose(&middle));
            if placement.fits()
                && placement.distinctness > MIN_DISTINCTNESS
                && shift.distance() < ROUTINE_M
                && wrap_angle(shift.theta).abs() < ROUTINE_RAD
            {
                let factor = closure_factor(nodes, placement, config).map(|factor| self.graph.add_between(factor));
                if let Some(Ok(factor)) = factor {
                    self.ties.push(Tie { factor, comparison: comparisons.len(), placement: 0 });
                }
            }
            comparisons.push(comparison);
        }
        if self.ties.len() > known {
            self.settle();
        }
    }

    /// Submaps in play that lie close to each other and are not tied together yet: the older, the newer.
    fn pairs_not_tied(
        &self,
        submaps: &[Submap],
        comparisons: &[Comparison],
        config: &LoopClosureConfig,
    ) -> Vec<[usize; 2]> {
        let in_force = self.closures().filter(|closure| closure.is_in_force);
        let tied: BTreeSet<[usize; 2]> = in_force
            .map(|closure| &comparisons[closure.comparison])
            .map(|comparison| [comparison.older, comparison.newer])
            .collect();
        let places: Vec<_> = self
            .in_play()
            .filter(|&(submap, _)| !submaps[submap].is_forgotten())
            .map(|(submap, pose)| (submap, pose.compose(&submaps[submap].middle)))
            .collect();
        let mut pairs = Vec::new();
        for (position, &(older, here)) in places.iter().enumerate() {
            let near = places[position + 1..].iter().filter(|(newer, there)| {
                here.between(there).distance() < config.candidate_distance_m
                    && older + 1 < *newer
                    && !tied.contains(&[older, *newer])
            });
            let near: Vec<usize> = near.map(|&(newer, _)| newer).collect();
            if near.is_empty() {
                continue;
            }
            // Where a robot that was carried elsewhere is nobody knows.
            let is_placed = self.tied_to(older);
            let placed = near.into_iter().filter(|&newer| self.node_of(newer).is_some_and(|node| is_placed[node]));
            pairs.extend(placed.map(|newer| [older, newer]));
        }
        pairs
    }
}
