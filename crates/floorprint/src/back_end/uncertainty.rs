//! How uncertain a hypothesis is where older submaps lie as seen from the newest.

use super::hypothesis::Hypothesis;
use crate::geometry::covariance::inverse;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// How uncertain the pose of one submap is as seen from another: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Of the position, metres.
    pub sigma_m: f64,
    /// Of the heading, radians.
    pub sigma_rad: f64,
}

impl Uncertainty {
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

impl Hypothesis {
    /// How uncertain each submap in play is as seen from the newest: along the most certain way
    /// through the graph, where closures are short cuts (Dijkstra 1959).
    #[must_use]
    pub fn uncertainties(&self) -> Vec<Uncertainty> {
        #[derive(Clone, Copy)]
        struct Reached {
            variance_m2: f64,
            variance_rad2: f64,
            path_m: f64,
        }
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
        if let Some(newest) = reached.last_mut() {
            *newest = Reached { variance_m2: 0.0, variance_rad2: 0.0, path_m: 0.0 };
            // Positive floats sort like their bits.
            queue.insert((0_u64, count - 1));
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
        let factor = DRIFT_FACTOR * GROWTH_PER_MISS.powi(self.misses);
        reached
            .iter()
            .map(|there| {
                let lever_m = LEVER_SHARE * there.path_m.min(LONGEST_LEVER_M);
                Uncertainty {
                    sigma_m: factor * (there.variance_m2 + there.variance_rad2 * lever_m * lever_m).sqrt(),
                    sigma_rad: factor * there.variance_rad2.sqrt(),
                }
            })
            .collect()
    }
}
