//! How uncertain a hypothesis is where older submaps lie as seen from the newest.

use super::hypothesis::Hypothesis;
use super::submap::Submap;
use crate::geometry::Pose2;
use crate::geometry::covariance::{in_frame_of, inverse};
use crate::key_scan::Drift;
use crate::pose_graph::RobustKernel;
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

/// A measurement that the graph had to bend by more than this, squared standard deviations, is as uncertain as that.
const BENT: f64 = 9.0;

/// What is said of a place to which no way leads, metres and radians: numbers that a file can hold.
const NOWHERE: f64 = 1e6;

/// A measurement between two nodes.
#[derive(Clone, Copy)]
struct Step {
    /// Its covariance, in the world's axes, of the pose of the node that it leads to.
    at_end: Matrix3<f64>,
    /// Whether it is gone the other way round.
    is_back: bool,
    drift: Drift,
}

/// How uncertain a node is in the world.
#[derive(Clone, Copy, Default)]
struct InTheWorld {
    /// Over (x, y, θ).
    covariance: Matrix3<f64>,
    /// What does not average out.
    drift: Drift,
    /// What only grows along a way: by it ways are compared.
    cost: f64,
}

impl InTheWorld {
    /// The same one step farther.
    fn moved(&self, here: &Pose2, there: &Pose2, step: &Step) -> Self {
        let (dx, dy) = (there.x - here.x, there.y - here.y);
        let turn = Matrix3::new(1.0, 0.0, -dy, 0.0, 1.0, dx, 0.0, 0.0, 1.0);
        let covariance = if step.is_back {
            turn * (self.covariance + step.at_end) * turn.transpose()
        } else {
            turn * self.covariance * turn.transpose() + step.at_end
        };
        let mut drift = self.drift;
        drift.sigma_m += drift.sigma_rad * dx.hypot(dy);
        drift.add(&step.drift);
        // A heading error counts as what it does a metre on.
        let of_step = Uncertainty::of(&step.at_end).after(&step.drift);
        Self { covariance, drift, cost: self.cost + of_step.sigma_m.powi(2) + of_step.sigma_rad.powi(2) }
    }
}

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

    /// How uncertain each submap in play is in the world, whose origin is the start of the drive: what adds up along the
    /// most certain way there. A heading error moves all that comes after it, so that a way that leads back to where it
    /// began is no more certain for that. What is in conflict with the rest is no way, and a measurement that the graph had
    /// to bend is as uncertain as it was bent.
    #[must_use]
    pub fn uncertainties_in_the_world(&self, submaps: &[Arc<Submap>]) -> Vec<Uncertainty> {
        let poses = self.graph.poses();
        let count = poses.len();
        let mut neighbours: Vec<Vec<(usize, Step)>> = vec![Vec::new(); count];
        for (number, factor) in self.graph.between_factors().iter().enumerate() {
            let is_chain = matches!(factor.kernel, RobustKernel::GemanMcClure { .. });
            if !is_chain && !self.is_in_force(number) {
                continue;
            }
            let mut covariance = inverse(&factor.information);
            if self.graph.squared_error(number) > BENT {
                let bend = factor.from_from_to.between(&poses[factor.from].between(&poses[factor.to])).to_vector();
                covariance += bend * bend.transpose();
            }
            let link = submaps.get(self.in_play[factor.to]).and_then(|submap| submap.link).filter(|_| is_chain);
            let drift = link.map_or(Drift::default(), |link| link.drift);
            let step = Step { at_end: in_world_of(&covariance, &poses[factor.to]), is_back: false, drift };
            neighbours[factor.from].push((factor.to, step));
            neighbours[factor.to].push((factor.from, Step { is_back: true, ..step }));
        }
        let mut known: Vec<Option<InTheWorld>> = vec![None; count];
        let mut queue = BTreeSet::new();
        let mut reached: Vec<Option<InTheWorld>> = vec![None; count];
        if count > 0 {
            reached[0] = Some(InTheWorld::default());
            queue.insert((0_u64, 0));
        }
        while let Some((_, here)) = queue.pop_first() {
            if known[here].is_some() {
                continue;
            }
            known[here] = reached[here];
            let Some(so_far) = known[here] else { continue };
            for (next, step) in neighbours[here].iter().filter(|(next, _)| known[*next].is_none()) {
                let there = so_far.moved(&poses[here], &poses[*next], step);
                if reached[*next].is_none_or(|other| there.cost < other.cost) {
                    reached[*next] = Some(there);
                    // Positive floats sort like their bits.
                    queue.insert((there.cost.to_bits(), *next));
                }
            }
        }
        let factor = GROWTH_PER_MISS.powi(self.misses);
        let seen = |there: Option<InTheWorld>| {
            let lost = Uncertainty { sigma_m: NOWHERE, sigma_rad: NOWHERE };
            there.map_or(lost, |there| {
                let Uncertainty { sigma_m, sigma_rad } = Uncertainty::of(&there.covariance).after(&there.drift);
                Uncertainty { sigma_m: factor * sigma_m, sigma_rad: factor * sigma_rad }
            })
        };
        known.into_iter().map(seen).collect()
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

/// A covariance over (x, y, θ) in the axes of a pose, in the world's.
fn in_world_of(covariance: &Matrix3<f64>, pose: &Pose2) -> Matrix3<f64> {
    in_frame_of(covariance, &Pose2::new(0.0, 0.0, -pose.theta))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::covariance::isotropic;
    use crate::pose_graph::BetweenFactor;

    /// A robot goes 20 m straight on and back again, and knows its heading to 0.1 rad less after every 10 m.
    #[test]
    fn who_comes_back_to_where_he_began_does_not_know_it_any_better() {
        let mut hypothesis = Hypothesis::default();
        for (number, x) in [0.0, 10.0, 20.0, 10.0, 0.0].into_iter().enumerate() {
            let pose = Pose2::new(x, 0.0, 0.0);
            hypothesis.in_play.push(number);
            let to = hypothesis.graph.add_node(pose);
            let Some(from) = to.checked_sub(1) else { continue };
            let factor = BetweenFactor {
                from,
                to,
                from_from_to: hypothesis.graph.poses()[from].between(&pose),
                information: inverse(&isotropic(1e-4, 0.1)),
                kernel: RobustKernel::GemanMcClure { scale: 3.0 },
                weight: 1.0,
            };
            hypothesis.graph.add_between(factor).unwrap();
        }
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
        assert!((stated[4].sigma_m - 0.05).abs() < 1e-6 && (stated[4].sigma_rad - 0.01).abs() < 1e-6, "{stated:?}");
    }
}
