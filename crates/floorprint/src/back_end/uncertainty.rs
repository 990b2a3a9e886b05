//! How uncertain a hypothesis is where older submaps lie as seen from the newest.

use super::hypothesis::Hypothesis;
use crate::geometry::Pose2;
use crate::geometry::covariance::inverse;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

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

    /// How uncertain each submap in play is in the world, whose origin is the start of the drive.
    #[must_use]
    pub fn uncertainties_in_the_world(&self) -> Vec<Uncertainty> {
        let Some(start) = self.graph.poses().first() else { return Vec::new() };
        let factor = GROWTH_PER_MISS.powi(self.misses);
        let reached = self.reached_from(0);
        let seen = |(there, pose): (&Reached, &Pose2)| {
            // A heading error that grows along the way moves its end by about a third of its variance times the
            // squared distance, however the way bends.
            let lever_m2 = start.between(pose).distance().powi(2) / 3.0;
            Uncertainty {
                sigma_m: factor * (there.variance_m2 + there.variance_rad2 * lever_m2).sqrt(),
                sigma_rad: factor * there.variance_rad2.sqrt(),
            }
        };
        reached.iter().zip(self.graph.poses()).map(seen).collect()
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
