//! One hypothesis about the drive: which places were recognised, and the pose graph that follows.
//!
//! Where a newer submap may lie in several places, or perhaps in none of them, the hypothesis
//! splits. Each part goes on with a graph and a weight of its own, as the particles of a
//! Rao-Blackwellized filter do: the discrete choice is sampled, the poses given the choice
//! are Gaussian.

use super::place_match::{Comparison, Placement};
use super::submap::Submap;
use super::{LoopClosureConfig, Verdict};
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic, symmetric};
use crate::key_scan::Interruption;
use crate::pose_graph::{BetweenFactor, Optimizer, PoseGraph, PriorFactor, RobustKernel};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// A set of decisions about closures.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Hypothesis {
    /// Its nodes are the submaps in play.
    pub(super) graph: PoseGraph,
    /// The submap of each node, ascending.
    pub(super) in_play: Vec<usize>,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f64,
    /// The closures of submaps in play, in the order of the factors.
    pub(super) constraints: Vec<Constraint>,
    /// How many submaps in a row should have been recognised and were not.
    pub(super) misses: i32,
    /// Submaps that show nothing new and left the graph, ascending.
    pub(super) attached: Vec<Attached>,
    /// What became of their closures.
    pub(super) past_closures: Vec<Closure>,
    /// Where the robot may have been kidnapped.
    pub(super) breaks: Vec<Break>,
}

/// A placement that is a factor of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Constraint {
    /// Number of the factor.
    pub(super) factor: usize,
    /// Number of the comparison.
    pub(super) comparison: usize,
    /// Number of its placement.
    pub(super) placement: usize,
}

/// A placement that is held for true.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Closure {
    /// Number of the comparison.
    pub comparison: usize,
    /// Number of its placement.
    pub placement: usize,
    /// Whether it pulls, or is contradicted by the rest of the graph.
    pub is_in_force: bool,
}

/// The robot was kidnapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kidnapping {
    /// The first frame at the new place, counted from 0.
    pub frame: usize,
    /// Where it was found again on what it had seen before, if it was.
    pub found: Option<Found>,
}

/// A robot that was kidnapped was found again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Found {
    /// The frame in the middle of the submap that decided it.
    pub frame: usize,
    /// An earlier frame at the same place.
    pub earlier: usize,
}

/// A submap before which the drive may have been interrupted.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Break {
    /// The first submap after it.
    pub submap: usize,
    pub(super) interruption: Interruption,
    /// Of the motion to that submap, if the robot was not carried: its factor claims next to nothing until that is known.
    pub(super) information: Matrix3<f64>,
    pub(super) outcome: Outcome,
}

/// What became of an interruption.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Outcome {
    /// No more than a suspicion: the graph takes the robot not to have been carried until the submaps before and after it have
    /// been compared; it is said to be lost meanwhile.
    Suspected,
    Open,
    /// The robot was not carried.
    Stayed,
    /// It was found on what it had seen before.
    Found(Found),
}

impl Break {
    /// Nothing decided yet.
    #[must_use]
    pub fn new(submap: usize, interruption: Interruption, information: Matrix3<f64>) -> Self {
        let outcome = if interruption.is_suspicion { Outcome::Suspected } else { Outcome::Open };
        Self { submap, interruption, information, outcome }
    }
}

/// A submap that lies on an older one and was taken out of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Attached {
    pub(super) submap: usize,
    /// One in play.
    pub(super) older: usize,
    pub(super) older_from_submap: Pose2,
    pub(super) information: Matrix3<f64>,
}

/// Standard deviations of the motion of a robot that was carried, metres and radians.
const KIDNAPPED_SIGMA_M: f64 = 30.0;
const KIDNAPPED_SIGMA_RAD: f64 = 3.0;

/// The chain's factors cost no more than those this many standard deviations long: the front end is
/// nearly always much better than that, and now and then much worse.
const CHAIN_SCALE: f64 = 3.0;
/// Closures that fit the graph worse than this, squared standard deviations, contradict it.
pub(super) const CONFLICT: f64 = 100.0;
/// Closures are believed up to this, squared standard deviations.
const CLOSURE_PHI: f64 = 6.0;
/// Placements that put a submap this near to each other agree, metres and radians.
pub(super) const AGREEMENT_M: f64 = 0.35;
pub(super) const AGREEMENT_RAD: f64 = 0.06;
/// Hypotheses whose submaps all lie closer than this are one, metres and radians.
const SAME_HYPOTHESIS_M: f64 = 0.15;
const SAME_HYPOTHESIS_RAD: f64 = 0.02;

impl Hypothesis {
    /// The pose graph; its nodes are the submaps in play.
    #[must_use]
    pub fn graph(&self) -> &PoseGraph {
        &self.graph
    }

    /// The submaps that the graph holds, ascending, and their poses, world from submap.
    pub fn in_play(&self) -> impl DoubleEndedIterator<Item = (usize, Pose2)> {
        self.in_play.iter().copied().zip(self.graph.poses().iter().copied())
    }

    /// The newest submap and its pose, world from submap.
    #[must_use]
    pub fn newest(&self) -> Option<(usize, Pose2)> {
        self.in_play().next_back()
    }

    /// The node of a submap in play.
    pub(super) fn node_of(&self, submap: usize) -> Option<usize> {
        self.in_play.binary_search(&submap).ok()
    }

    /// The pose of a submap in play, world from submap.
    #[must_use]
    pub fn pose_of(&self, submap: usize) -> Option<Pose2> {
        self.node_of(submap).map(|node| self.graph.poses()[node])
    }

    /// The placements that it holds for true.
    pub fn closures(&self) -> impl Iterator<Item = Closure> {
        self.past_closures.iter().copied().chain(self.constraints.iter().map(|constraint| self.closure_of(constraint)))
    }

    /// Those found by a comparison or later ones, the last first.
    pub fn closures_since(&self, comparison: usize) -> impl Iterator<Item = Closure> {
        let recent = self.constraints.iter().rev().filter(move |constraint| constraint.comparison >= comparison);
        recent.map(|constraint| self.closure_of(constraint))
    }

    pub(super) fn closure_of(&self, constraint: &Constraint) -> Closure {
        let Constraint { factor, comparison, placement } = *constraint;
        Closure { comparison, placement, is_in_force: self.is_in_force(factor) }
    }

    pub(super) fn is_in_force(&self, factor: usize) -> bool {
        self.graph.squared_error(factor) < CONFLICT
    }

    /// Bytes that it holds.
    pub(super) fn held_bytes(&self) -> usize {
        let graph = size_of_val(self.graph.poses()) + size_of_val(self.graph.between_factors());
        let numbers = size_of_val(&self.in_play[..]) + size_of_val(&self.constraints[..]);
        graph + numbers + size_of_val(&self.attached[..]) + size_of_val(&self.past_closures[..])
    }

    /// Whether it has a say in where a submap lies.
    pub(super) fn holds(&self, submap: usize) -> bool {
        self.node_of(submap).is_some() || self.attached.iter().any(|attached| attached.submap == submap)
    }

    /// Whether all numbers name what is there, of so many submaps, of which so many are its own; else what does not.
    pub(super) fn validate(&self, [submaps, left]: [usize; 2], comparisons: &[Comparison]) -> Result<(), &'static str> {
        let holds = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(what) };
        let factors = self.graph.between_factors().len();
        let nodes = &self.in_play;
        holds(self.graph.is_valid() && self.log_weight.is_finite(), "a pose graph names nodes that are not there")?;
        holds(nodes.len() == self.graph.poses().len(), "a pose graph has other nodes than the hypothesis")?;
        holds(nodes.is_sorted_by(|a, b| a < b), "the submaps of a hypothesis are out of order")?;
        // The newest submap is always in play.
        holds(nodes.last().map_or(0, |newest| newest + 1) == submaps, "a hypothesis lacks submaps")?;
        let is_placement = |comparison: usize, placement: usize| {
            comparisons.get(comparison).is_some_and(|comparison| placement < comparison.placements.len())
        };
        let are_constraints = self
            .constraints
            .iter()
            .all(|constraint| constraint.factor < factors && is_placement(constraint.comparison, constraint.placement));
        let are_closures = self.past_closures.iter().all(|closure| is_placement(closure.comparison, closure.placement));
        holds(are_constraints && are_closures, "a constraint names a comparison that is not there")?;
        let are_attached = self.attached.iter().all(|attached| {
            attached.submap < submaps && attached.older < attached.submap && self.pose_of(attached.submap).is_none()
        });
        let all_there = nodes.len() + self.attached.len() == left;
        holds(are_attached && all_there, "a retired submap is attached to what is not there")?;
        holds(self.breaks.iter().all(|at| at.submap < submaps), "an interruption names a submap that is not there")
    }

    /// Solves the graph to the end.
    pub fn settle(&mut self) {
        // A graph that cannot be solved keeps its estimates: the chain alone always can.
        let _ = Optimizer::default().optimize(&mut self.graph);
    }

    /// Takes in the next submap: connected to the one before as the front end has it.
    pub fn extend(&mut self, submap: &Submap, config: &LoopClosureConfig) {
        self.in_play.push(self.newest().map_or(0, |(newest, _)| newest + 1));
        let Some(link) = &submap.link else {
            self.graph.add_node(submap.front_end_from_submap);
            let world_from_node = submap.front_end_from_submap;
            let _ =
                self.graph.add_prior(PriorFactor { node: 0, world_from_node, information: Matrix3::identity() * 1e8 });
            return;
        };
        let before = self.graph.poses().len() - 1;
        let to = self.graph.add_node(self.graph.poses()[before].compose(&link.previous_from_submap));
        let path_m = link.path_m.max(0.1);
        let variance_m2 = config.drift_sigma_m.powi(2) * path_m;
        let variance_rad2 = config.drift_sigma_rad.powi(2) * path_m;
        let mut covariance =
            Matrix3::from_diagonal(&[variance_m2, variance_m2, variance_rad2].into()) + symmetric(&link.covariance);
        if let (Some(interruption), Some((newest, _))) = (submap.interruption, self.newest()) {
            let new = Break::new(newest, interruption, symmetric(&inverse(&covariance)));
            if new.outcome == Outcome::Open {
                covariance += kidnapped_covariance();
            }
            self.breaks.push(new);
        }
        let _ = self.graph.add_between(BetweenFactor {
            from: before,
            to,
            from_from_to: link.previous_from_submap,
            information: symmetric(&inverse(&covariance)),
            kernel: RobustKernel::GemanMcClure { scale: CHAIN_SCALE },
            weight: 1.0,
        });
    }

    /// Whether two hypotheses have come to the same picture of the drive, as far as both hold it in play.
    #[must_use]
    pub fn agrees_with(&self, other: &Self) -> bool {
        self.in_play().all(|(submap, pose)| {
            other.pose_of(submap).is_none_or(|there| {
                let offset = pose.between(&there);
                offset.distance() < SAME_HYPOTHESIS_M && offset.theta.abs() < SAME_HYPOTHESIS_RAD
            })
        })
    }
}

/// A placement as a factor between two nodes: the older, the newer.
pub(super) fn closure_factor(
    [from, to]: [usize; 2],
    placement: &Placement,
    config: &LoopClosureConfig,
) -> Option<BetweenFactor> {
    debug_assert_eq!(placement.verdict, Verdict::Accepted);
    let floor = Matrix3::from_diagonal(
        &[config.closure_sigma_m.powi(2), config.closure_sigma_m.powi(2), config.closure_sigma_rad.powi(2)].into(),
    );
    let information = (floor + placement.covariance).try_inverse()?;
    Some(BetweenFactor {
        from,
        to,
        from_from_to: placement.older_from_newer,
        information: symmetric(&information),
        kernel: RobustKernel::DynamicCovarianceScaling { phi: CLOSURE_PHI },
        weight: 1.0,
    })
}

/// Covariance of the motion of a robot that was carried, nobody knows where to.
pub(super) fn kidnapped_covariance() -> Matrix3<f64> {
    isotropic(KIDNAPPED_SIGMA_M, KIDNAPPED_SIGMA_RAD)
}
