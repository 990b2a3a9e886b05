//! How uncertain a hypothesis is where older submaps lie as seen from the newest.

use super::hypothesis::Hypothesis;
use super::submap::Submap;
use crate::geometry::covariance::{inverse, isotropic};
use crate::key_scan::Drift;
use crate::pose_graph::{BetweenFactor, Marginals, PoseGraph, RobustKernel};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// How uncertain the pose of one submap is as seen from another: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Of the position, metres.
    pub sigma_m: f64,
    /// Of the heading, radians.
    pub sigma_rad: f64,
}

impl Uncertainty {
    /// Together with another one that is independent of it.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self { sigma_m: self.sigma_m.hypot(other.sigma_m), sigma_rad: self.sigma_rad.hypot(other.sigma_rad) }
    }

    /// The same after a motion that may have drifted.
    #[must_use]
    pub fn after(&self, drift: &Drift) -> Self {
        Self { sigma_m: self.sigma_m + drift.sigma_m, sigma_rad: self.sigma_rad + drift.sigma_rad }
    }

    /// That of a covariance over (x, y, θ), m² and rad²: of the position in its least certain direction.
    #[must_use]
    pub fn of(covariance: &Matrix3<f64>) -> Self {
        let half_trace = 0.5 * (covariance[(0, 0)] + covariance[(1, 1)]);
        let determinant = covariance[(0, 0)] * covariance[(1, 1)] - covariance[(0, 1)] * covariance[(1, 0)];
        let root = (half_trace * half_trace - determinant).max(0.0).sqrt();
        Self { sigma_m: (half_trace + root).max(0.0).sqrt(), sigma_rad: covariance[(2, 2)].max(0.0).sqrt() }
    }

    /// Whether nothing is known but that the robot is somewhere on the map.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.sigma_m > LOST_M
    }
}

/// Who uncertainties a position by more than this has no idea, metres.
const LOST_M: f64 = 20.0;

/// The graph's drift times this is how far off a submap is looked for.
const DRIFT_FACTOR: f64 = 2.0;
/// After each submap that was not recognised where it should have been, the uncertainty grows by this factor.
const GROWTH_PER_MISS: f64 = 1.5;
/// A heading error acts over about this share of the way …
const LEVER_SHARE: f64 = 0.3;
/// … and buildings fold long ways up: over no more than this, metres.
const LONGEST_LEVER_M: f64 = 60.0;

/// Submaps that are no farther apart than this in the drive lie on one stretch: what ties them hardly tells its drift.
const SAME_STRETCH: usize = 5;
/// A drift goes the same way over so many submaps to each side, as long as the floor and the walls stay alike.
const DRIFT_LASTS: usize = 10;
/// A measurement that the graph had to bend by more than this, squared standard deviations, is as uncertain as that.
const BENT: f64 = 9.0;

/// No measurement is stated to know less than this, so that the others are not lost in the rounding beside it.
const FARTHEST_M: f64 = 1e4;
const FARTHEST_RAD: f64 = 1e2;

/// What is said of a place to which no way leads, metres and radians: numbers that a file can hold.
const NOWHERE: f64 = 1e6;

/// What leads from one node of the graph to another along the most certain way.
#[derive(Clone, Copy)]
struct Reached {
    variance_m2: f64,
    variance_rad2: f64,
    path_m: f64,
}

impl Hypothesis {
    /// How uncertain each submap in play is as seen from the newest.
    #[must_use]
    pub fn uncertainties(&self) -> Vec<Uncertainty> {
        let factor = DRIFT_FACTOR * GROWTH_PER_MISS.powi(self.misses);
        let seen = |there: &Reached| {
            let lever_m = LEVER_SHARE * there.path_m.min(LONGEST_LEVER_M);
            Uncertainty {
                sigma_m: factor * (there.variance_m2 + there.variance_rad2 * lever_m * lever_m).sqrt(),
                sigma_rad: factor * there.variance_rad2.sqrt(),
            }
        };
        let newest = self.in_play.len().checked_sub(1);
        newest.map_or(Vec::new(), |newest| self.reached_from(newest).iter().map(seen).collect())
    }

    /// How uncertain each submap in play is in the world, whose origin is the start of the drive: what all measurements
    /// together leave of it. What is in conflict with the rest is none, and a measurement that the graph had to bend is as
    /// uncertain as it was bent.
    #[must_use]
    pub fn uncertainties_in_the_world(&self, submaps: &[Arc<Submap>]) -> Vec<Uncertainty> {
        let stated = self.as_stated(submaps);
        let is_tied = stated.tied_to_first();
        let covariances = Marginals::new(&stated).map_or(Vec::new(), |marginals| marginals.covariances());
        let factor = GROWTH_PER_MISS.powi(self.misses);
        let of_node = |(node, is_tied): (usize, bool)| {
            let nowhere = Uncertainty { sigma_m: NOWHERE, sigma_rad: NOWHERE };
            covariances.get(node).filter(|_| is_tied).map_or(nowhere, |covariance| {
                let Uncertainty { sigma_m, sigma_rad } = Uncertainty::of(covariance);
                Uncertainty { sigma_m: factor * sigma_m, sigma_rad: factor * sigma_rad }
            })
        };
        is_tied.into_iter().enumerate().map(of_node).collect()
    }

    /// The graph with every measurement as uncertain as is stated of it.
    fn as_stated(&self, submaps: &[Arc<Submap>]) -> PoseGraph {
        let poses = self.graph.poses();
        let drifts = self.drifts(submaps);
        let at_least = inverse(&isotropic(FARTHEST_M, FARTHEST_RAD));
        let mut stated = PoseGraph::default();
        poses.iter().for_each(|pose| {
            stated.add_node(*pose);
        });
        for (number, factor) in self.graph.between_factors().iter().enumerate() {
            let is_chain = matches!(factor.kernel, RobustKernel::GemanMcClure { .. });
            if !is_chain && !self.is_in_force(number) {
                continue;
            }
            let from_from_to = poses[factor.from].between(&poses[factor.to]);
            let mut covariance = inverse(&factor.information);
            if self.graph.squared_error(number) > BENT {
                let bend = factor.from_from_to.between(&from_from_to).to_vector();
                covariance += bend * bend.transpose();
            }
            if is_chain {
                covariance += drifts[factor.to];
            }
            let information = inverse(&covariance) + at_least;
            let kernel = RobustKernel::Quadratic;
            // What the graph would not take says nothing.
            let _ = stated.add_between(BetweenFactor { from_from_to, information, kernel, weight: 1.0, ..*factor });
        }
        stated
    }

    /// The covariance by which each submap's way from the one before may have drifted.
    fn drifts(&self, submaps: &[Arc<Submap>]) -> Vec<Matrix3<f64>> {
        let drift = |submap: &usize| submaps.get(*submap).and_then(|submap| submap.link).map(|link| link.drift);
        let drifts = self.in_play.iter().map(|submap| drift(submap).unwrap_or_default());
        covariances_of(&drifts.zip(self.are_tied()).collect::<Vec<_>>())
    }

    /// Whether the newest submap in play is tied to what was seen long before it.
    #[must_use]
    pub(super) fn newest_is_tied(&self) -> bool {
        self.are_tied().last().copied().unwrap_or(false)
    }

    /// Whether each submap in play is tied to what was seen long before or after it by a closure in force.
    fn are_tied(&self) -> Vec<bool> {
        let mut are_tied = vec![false; self.in_play.len()];
        for (number, factor) in self.graph.between_factors().iter().enumerate() {
            let is_closure = !matches!(factor.kernel, RobustKernel::GemanMcClure { .. });
            if is_closure && self.is_in_force(number) && factor.from.abs_diff(factor.to) > SAME_STRETCH {
                are_tied[factor.from] = true;
                are_tied[factor.to] = true;
            }
        }
        are_tied
    }

    /// The most certain way from a node to each other one, where closures are short cuts (Dijkstra 1959).
    fn reached_from(&self, node: usize) -> Vec<Reached> {
        let count = self.in_play.len();
        let mut neighbours = vec![Vec::new(); count];
        for factor in self.graph.between_factors() {
            let covariance = inverse(&factor.information);
            let link = Reached {
                variance_m2: 0.5 * (covariance[(0, 0)] + covariance[(1, 1)]),
                variance_rad2: covariance[(2, 2)],
                path_m: factor.from_from_to.distance(),
            };
            neighbours[factor.from].push((factor.to, link));
            neighbours[factor.to].push((factor.from, link));
        }
        let unknown = Reached { variance_m2: f64::INFINITY, variance_rad2: f64::INFINITY, path_m: 0.0 };
        let mut reached = vec![unknown; count];
        let mut queue = BTreeSet::new();
        if let Some(here) = reached.get_mut(node) {
            *here = Reached { variance_m2: 0.0, variance_rad2: 0.0, path_m: 0.0 };
            // Positive floats sort like their bits.
            queue.insert((0_u64, node));
        }
        while let Some((_, here)) = queue.pop_first() {
            for &(next, link) in &neighbours[here] {
                let there = Reached {
                    variance_m2: reached[here].variance_m2 + link.variance_m2,
                    variance_rad2: reached[here].variance_rad2 + link.variance_rad2,
                    path_m: reached[here].path_m + link.path_m,
                };
                if there.variance_m2 < reached[next].variance_m2 {
                    reached[next] = there;
                    queue.insert((there.variance_m2.to_bits(), next));
                }
            }
        }
        reached
    }
}

/// Drifts of one stretch between closures add up as they are, variances do not: each takes its share of the variance of the
/// stretch around it. Each drift comes with whether a closure ties the place to which it leads.
fn covariances_of(links: &[(Drift, bool)]) -> Vec<Matrix3<f64>> {
    let of_stretch = |stretch: &[(Drift, bool)]| -> Vec<Matrix3<f64>> {
        let of_link = |(number, (own, _)): (usize, &(Drift, bool))| {
            let around = number.saturating_sub(DRIFT_LASTS)..stretch.len().min(number + DRIFT_LASTS + 1);
            let mut all = Drift::default();
            stretch[around].iter().for_each(|(drift, _)| all.add(drift));
            isotropic((own.sigma_m * all.sigma_m).sqrt(), (own.sigma_rad * all.sigma_rad).sqrt())
        };
        stretch.iter().enumerate().map(of_link).collect()
    };
    links.chunk_by(|(_, is_tied), _| !is_tied).flat_map(of_stretch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;

    /// Submaps along a line: where each lies, and how uncertain the way there from the one before is.
    fn chain(submaps: impl Iterator<Item = (f64, [f64; 2])>) -> Hypothesis {
        let mut hypothesis = Hypothesis::default();
        for (number, (x_m, [sigma_m, sigma_rad])) in submaps.enumerate() {
            let pose = Pose2::new(x_m, 0.0, 0.0);
            hypothesis.in_play.push(number);
            let to = hypothesis.graph.add_node(pose);
            let Some(from) = to.checked_sub(1) else { continue };
            let factor = BetweenFactor {
                from,
                to,
                from_from_to: hypothesis.graph.poses()[from].between(&pose),
                information: inverse(&isotropic(sigma_m, sigma_rad)),
                kernel: RobustKernel::GemanMcClure { scale: 3.0 },
                weight: 1.0,
            };
            hypothesis.graph.add_between(factor).unwrap();
        }
        hypothesis
    }

    /// 500 submaps of which each is known to millimetres, but for one of which nothing is.
    #[test]
    fn where_nothing_is_known_of_one_step_all_before_it_stays_known() {
        let sigmas = |number: usize| if number == 250 { [1e6, 1e3] } else { [5e-3, 1e-4] };
        let stated = chain((0..500).map(|number| (number as f64, sigmas(number)))).uncertainties_in_the_world(&[]);
        assert!(stated[249].sigma_m < 0.5 && stated[249].sigma_rad < 0.01, "{:?}", stated[249]);
        assert!(stated[250].is_lost() && stated[499].is_lost(), "{:?} {:?}", stated[250], stated[499]);
    }

    /// A robot goes 20 m straight on and back again, and knows its heading to 0.1 rad less after every 10 m.
    #[test]
    fn who_comes_back_to_where_he_began_does_not_know_it_any_better() {
        let mut hypothesis = chain([0.0, 10.0, 20.0, 10.0, 0.0].into_iter().map(|x_m| (x_m, [1e-4, 0.1])));
        let stated = hypothesis.uncertainties_in_the_world(&[]);
        // Each error turns all that comes after it: 0.1 rad times 10, 20, 10 and 0 m.
        for (node, expected_m) in [(1, 0.0), (2, 1.0), (3, 1.0), (4, 6.0_f64.sqrt())] {
            assert!((stated[node].sigma_m - expected_m).abs() < 1e-2, "{node}: {stated:?}");
        }
        assert!((stated[4].sigma_rad - 0.2).abs() < 1e-6);
        // A closure is a short cut.
        let closure = BetweenFactor {
            from: 0,
            to: 4,
            from_from_to: Pose2::IDENTITY,
            information: inverse(&isotropic(0.05, 0.01)),
            kernel: RobustKernel::DynamicCovarianceScaling { phi: 6.0 },
            weight: 1.0,
        };
        hypothesis.graph.add_between(closure).unwrap();
        let stated = hypothesis.uncertainties_in_the_world(&[]);
        assert!((stated[4].sigma_m - 0.05).abs() < 1e-3 && (stated[4].sigma_rad - 0.01).abs() < 1e-3, "{stated:?}");
        // It says of the way out and back as well how far they were turned.
        assert!(stated[2].sigma_m < 0.9 && stated[3].sigma_m < 0.55, "{stated:?}");
        // To where nothing leads, nothing is known.
        hypothesis.in_play.push(5);
        hypothesis.graph.add_node(Pose2::IDENTITY);
        assert!(hypothesis.uncertainties_in_the_world(&[])[5].is_lost());
    }

    #[test]
    fn drifts_between_closures_add_up_as_they_are() {
        let link = |sigma_m, sigma_rad, is_tied| (Drift { sigma_m, sigma_rad }, is_tied);
        let links = [link(0.3, 0.01, false), link(0.0, 0.0, false), link(0.1, 0.0, true), link(0.2, 0.02, false)];
        let covariances = covariances_of(&links);
        let sum = |of: std::ops::Range<usize>| covariances[of].iter().sum::<Matrix3<f64>>();
        assert!((sum(0..3) - isotropic(0.4, 0.01)).amax() < 1e-12 && (sum(3..4) - isotropic(0.2, 0.02)).amax() < 1e-12);
        // Nothing goes the same way for ever: 6 m if it did, 0.8 m if each drift had a sign of its own.
        let long: Matrix3<f64> = covariances_of(&[link(0.1, 0.0, false); 60]).iter().sum();
        assert!((2.5..4.0).contains(&long[(0, 0)].sqrt()), "{long}");
    }

    #[test]
    fn what_ties_neighbours_does_not_end_a_stretch() {
        let mut hypothesis = chain((0..10).map(|number| (f64::from(number), [0.1, 0.1])));
        for (from, to) in [(3, 5), (0, 9)] {
            let poses = hypothesis.graph.poses();
            let factor = BetweenFactor {
                from,
                to,
                from_from_to: poses[from].between(&poses[to]),
                information: inverse(&isotropic(0.05, 0.01)),
                kernel: RobustKernel::DynamicCovarianceScaling { phi: 6.0 },
                weight: 1.0,
            };
            hypothesis.graph.add_between(factor).unwrap();
        }
        let tied: Vec<usize> = hypothesis
            .are_tied()
            .iter()
            .enumerate()
            .filter(|(_, is_tied)| **is_tied)
            .map(|(number, _)| number)
            .collect();
        assert_eq!(tied, [0, 9]);
    }
}
