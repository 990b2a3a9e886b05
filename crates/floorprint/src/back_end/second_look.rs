//! A second look at places that turn out to lie on each other once the drive is put right.
//!
//! While the drive goes on a fit has to prove itself against every other place that the drift allows. In the end it is
//! known well where each submap lies, so that a fit right there needs far less proof: constraints that were refused for want
//! of it, or never looked for, are made up for, and walls seen on several passes become one.

use super::association::is_no_surprise;
use super::hypothesis::{Constraint, Hypothesis, closure_factor};
use super::place_match::Comparison;
use super::submap::Submap;
use super::uncertainty::Uncertainty;
use super::view_cache::ViewCache;
use super::{LoopClosureConfig, Verdict};
use crate::StopSignal;
use crate::scan_matcher::MatcherConfig;
use std::collections::BTreeSet;
use std::sync::Arc;

/// How well it is known where submaps lie: within reach of the fine matcher, so that nothing is searched.
const DOUBT: Uncertainty = Uncertainty { sigma_m: 0.1, sigma_rad: 0.03 };

/// A fit that is hardly better than places farther on says nothing about where along a corridor a submap lies.
const MIN_DISTINCTNESS: f64 = 0.1;

impl Hypothesis {
    /// Compares all submaps in play that lie close to each other and are not connected, and constraints those that fit
    /// about where they lie. The comparisons are added to `comparisons`.
    pub(super) fn look_again(
        &mut self,
        submaps: &[Arc<Submap>],
        comparisons: &mut Vec<Comparison>,
        views: &mut ViewCache,
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
        stop: &StopSignal,
    ) {
        let known = self.constraints.len();
        for nodes in self.pairs_not_connected(submaps, config) {
            if stop.is_given() {
                break;
            }
            let [older, newer] = nodes.map(|node| self.graph.poses()[node]);
            let pair = nodes.map(|node| self.in_play[node]);
            let expected = older.between(&newer);
            let mut comparison = views.compare(submaps, pair, expected, DOUBT, config, matcher);
            let placement = &mut comparison.placements[0];
            if placement.fits() && placement.distinctness < MIN_DISTINCTNESS {
                placement.verdict = Verdict::Inconclusive;
            }
            let middle = submaps[pair[1]].middle;
            let shift = expected.compose(&middle).between(&placement.older_from_newer.compose(&middle));
            if placement.fits() && is_no_surprise(&shift) {
                let factor = closure_factor(nodes, placement, config).map(|factor| self.graph.add_between(factor));
                if let Some(Ok(factor)) = factor {
                    self.constraints.push(Constraint { factor, comparison: comparisons.len(), placement: 0 });
                }
            }
            comparisons.push(comparison);
        }
        if self.constraints.len() > known {
            self.settle();
        }
    }

    /// Nodes of submaps that lie close to each other and are not connected yet: the older, the newer.
    fn pairs_not_connected(&self, submaps: &[Arc<Submap>], config: &LoopClosureConfig) -> Vec<[usize; 2]> {
        let tied: BTreeSet<[usize; 2]> = self.closures_in_force().map(|closure| [closure.from, closure.to]).collect();
        let places: Vec<_> = self
            .in_play()
            .enumerate()
            .filter(|&(_, (submap, _))| !submaps[submap].is_forgotten())
            .map(|(node, (submap, pose))| (node, pose.compose(&submaps[submap].middle)))
            .collect();
        let mut pairs = Vec::new();
        for (position, &(older, here)) in places.iter().enumerate() {
            let near = places[position + 1..].iter().filter(|(newer, there)| {
                here.between(there).distance() < config.candidate_distance_m
                    && self.in_play[older] + 1 < self.in_play[*newer]
                    && !tied.contains(&[older, *newer])
            });
            let mut near = near.map(|&(newer, _)| newer).peekable();
            if near.peek().is_some() {
                // Where a robot that was kidnapped is nobody knows.
                let is_placed = self.connected_to(self.in_play[older]);
                pairs.extend(near.filter(|&newer| is_placed[newer]).map(|newer| [older, newer]));
            }
        }
        pairs
    }
}
