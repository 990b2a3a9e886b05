//! One account of the drive: which places were recognised, and the pose graph that follows.
//!
//! Where a newer submap may lie in several places, or perhaps in none of them, the account
//! splits. Each part goes on with a graph and a weight of its own, as the particles of a
//! Rao-Blackwellized filter do: the discrete choice is sampled, the poses given the choice
//! are Gaussian.

use super::comparison::{Comparison, Doubt, Placement};
use super::relocation::{Break, carried_elsewhere};
use super::submap::Submap;
use super::{LoopClosureConfig, Verdict};
use crate::geometry::{Pose2, wrap_angle};
use crate::pose_graph::{BetweenFactor, Optimizer, OptimizerConfig, PoseGraph, PriorFactor, RobustKernel};
use nalgebra::Matrix3;
use std::collections::BTreeSet;

/// A set of decisions about closures.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    pub(super) graph: PoseGraph,
    pub(super) optimizer: Optimizer,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f64,
    pub(super) closures: Vec<Closure>,
    /// How many submaps in a row should have been recognised and were not.
    pub(super) misses: i32,
    /// Submaps that show nothing new and left the graph.
    attached: Vec<Attached>,
    /// Where the robot may have been carried elsewhere.
    pub(super) breaks: Vec<Break>,
}

/// A submap that lies on an older one and was taken out of the graph.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Attached {
    node: usize,
    older: usize,
    older_from_node: Pose2,
    information: Matrix3<f64>,
}

/// A placement that became a factor of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closure {
    /// Number of the factor in the graph; `None` once the submap left it.
    pub(super) factor: Option<usize>,
    /// Number of the comparison.
    pub comparison: usize,
    /// Number of its placement.
    pub placement: usize,
}

/// The chain's factors cost no more than those this many standard deviations long: the front end is
/// nearly always much better than that, and now and then much worse.
const CHAIN_SCALE: f64 = 3.0;
/// A closure that makes the graph cost this much more than it should is in conflict with something.
const CONFLICT_COST: f64 = 5.0;
/// Closures that fit the graph worse than this, squared standard deviations, contradict it.
pub(super) const CONFLICT: f64 = 100.0;
/// Closures are believed up to this, squared standard deviations.
const CLOSURE_PHI: f64 = 6.0;
/// Closures that fit better than this change nothing worth a solution of the graph, squared standard deviations.
const SETTLED: f64 = 0.5;
/// The graph's drift times this is how far off a submap is looked for.
const DOUBT_FACTOR: f64 = 2.0;
/// After each submap that was not recognised where it should have been, the doubt grows by this factor.
const DOUBT_PER_MISS: f64 = 1.5;
const MOST_MISSES: i32 = 6;
/// A heading error acts over about this share of the way …
const LEVER_SHARE: f64 = 0.3;
/// … and buildings fold long ways up: over no more than this, metres.
const LONGEST_LEVER_M: f64 = 60.0;
/// Placements that put a submap this near to each other agree, metres and radians.
pub(super) const AGREEMENT_M: f64 = 0.35;
pub(super) const AGREEMENT_RAD: f64 = 0.06;
/// Placements that move a submap less than this against where it was thought to be are no surprise, metres and radians.
const ROUTINE_M: f64 = 0.25;
const ROUTINE_RAD: f64 = 0.04;
/// What a fit is worth: log-likelihood per unit by which it is better than a fit by chance and than places farther on.
const EVIDENCE_PER_QUALITY: f64 = 20.0;
const CHANCE_QUALITY: f64 = 0.8;
/// What it is worth when another place on the same older submap fits better: the same surfaces are compared.
const EVIDENCE_PER_DEFICIT: f64 = 60.0;
/// The same of each further older submap that agrees: it shows much of what the first does. Up to so many count.
pub(super) const EVIDENCE_OF_WITNESS: f64 = 3.5;
pub(super) const MOST_WITNESSES: usize = 4;
/// Largest number of accounts that one submap can split an account into.
const MOST_CHILDREN: usize = 4;

/// Placements of one submap that agree where it lies.
struct Cluster {
    world_from_middle: Pose2,
    /// Numbers of comparisons and placements.
    members: Vec<(usize, usize)>,
    /// What their fits are worth, as a log-likelihood.
    support: f64,
    /// How much better other places fit, on average over the members.
    deficit: f64,
}

impl Default for Hypothesis {
    fn default() -> Self {
        Self::new()
    }
}

impl Hypothesis {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            graph: PoseGraph::default(),
            optimizer: Optimizer::new(OptimizerConfig::default()),
            log_weight: 0.0,
            closures: Vec::new(),
            misses: 0,
            attached: Vec::new(),
            breaks: Vec::new(),
        }
    }

    /// The pose graph; its nodes are the submaps.
    #[must_use]
    pub fn graph(&self) -> &PoseGraph {
        &self.graph
    }

    /// The submaps' poses, world from submap; of those that left the graph as they were then.
    #[must_use]
    pub fn poses(&self) -> &[Pose2] {
        self.graph.poses()
    }

    /// The placements that it holds for true.
    #[must_use]
    pub fn closures(&self) -> &[Closure] {
        &self.closures
    }

    /// Whether a submap left the graph, as it lies on an older one.
    pub(super) fn is_attached(&self, node: usize) -> bool {
        self.attached.iter().any(|attached| attached.node == node)
    }

    /// Whether a closure still pulls, or is contradicted by the rest of the graph.
    #[must_use]
    pub fn is_in_force(&self, closure: &Closure) -> bool {
        closure.factor.is_none_or(|factor| self.graph.squared_error(factor) < CONFLICT)
    }

    /// Takes a submap that lies on an older one out of the graph, so that the graph grows with the area that
    /// was seen and not with time: the next submap is tied to the older one instead. Leaves the graph as it is
    /// where the account does not hold the submap for recognised on one of the first `long_ago`.
    pub fn attach(&mut self, node: usize, long_ago: usize) {
        let factors = self.graph.between_factors();
        // Along a bare corridor a closure knows less than the way there.
        let is_certain = |information: &Matrix3<f64>| {
            let covariance = information.try_inverse().unwrap_or_else(Matrix3::identity);
            covariance[(0, 0)] + covariance[(1, 1)] < 2.0 * ATTACHED_SIGMA_M * ATTACHED_SIGMA_M
        };
        let closures = self.closures.iter().rev().take(RECENT_CLOSURES).filter(|closure| self.is_in_force(closure));
        let of_node = closures
            .filter_map(|closure| closure.factor)
            .filter(|&factor| factors[factor].to == node && factors[factor].from < long_ago)
            .filter(|&factor| is_certain(&factors[factor].information));
        // Where the way leads along one that was driven before, its links say nothing new; where it leads from one
        // old place to another they do.
        let leads_along = |older: usize, neighbour: usize| {
            let recent = factors.iter().rev().take_while(|factor| factor.to + RECENT_CLOSURES > node);
            recent
                .filter(|factor| factor.to == neighbour && factor.from < long_ago)
                .any(|factor| factor.from.abs_diff(older) <= ALONG && is_certain(&factor.information))
        };
        let was_attached_along = |older: usize, neighbour: usize| {
            let recent = self.attached.iter().rev().take(2);
            recent.clone().any(|attached| attached.node == neighbour && attached.older.abs_diff(older) <= ALONG)
        };
        let along = of_node.filter(|&factor| {
            let older = factors[factor].from;
            leads_along(older, node + 1)
                && node
                    .checked_sub(1)
                    .is_some_and(|before| was_attached_along(older, before) || leads_along(older, before))
        });
        let best = along
            .max_by(|&a, &b| factors[a].information.trace().total_cmp(&factors[b].information.trace()).then(b.cmp(&a)));
        let next = factors.iter().rposition(|factor| factor.from == node && factor.to == node + 1);
        let (Some(best), Some(next)) = (best, next) else { return };
        // Where the drive was interrupted the way there is not known, or not yet.
        if self.breaks.iter().any(|interrupted| interrupted.submap == node || interrupted.submap == node + 1) {
            return;
        }
        let (closure, chain) = (factors[best].clone(), factors[next].clone());
        let inverse = |information: &Matrix3<f64>| information.try_inverse().unwrap_or_else(Matrix3::identity);
        let covariance = inverse(&closure.information);
        let older_from_node = self.poses()[closure.from].between(&self.poses()[node]);
        let adjoint = chain.from_from_to.inverse().adjoint();
        let covariance = adjoint * covariance * adjoint.transpose() + inverse(&chain.information);
        let numbers = self.graph.retain_between(|_, factor| factor.from != node && factor.to != node);
        for closure in &mut self.closures {
            closure.factor = closure.factor.and_then(|factor| numbers[factor]);
        }
        let _ = self.graph.add_between(BetweenFactor {
            from: closure.from,
            to: node + 1,
            from_from_to: older_from_node.compose(&chain.from_from_to),
            information: symmetric(&inverse(&covariance)),
            ..chain
        });
        self.attached.push(Attached { node, older: closure.from, older_from_node, information: closure.information });
    }

    /// The submaps' poses, also of those that left the graph.
    #[must_use]
    pub fn all_poses(&self) -> Vec<Pose2> {
        let mut poses = self.poses().to_vec();
        for attached in &self.attached {
            poses[attached.node] = poses[attached.older].compose(&attached.older_from_node);
        }
        poses
    }

    /// Takes in the next submap: tied to the one before as the front end has it.
    pub fn extend(&mut self, submap: &Submap, config: &LoopClosureConfig) {
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
        if let Some(interruption) = submap.starts_anew {
            self.breaks.push(Break::new(to, interruption, information_of(&covariance)));
            covariance += carried_elsewhere();
        }
        let _ = self.graph.add_between(BetweenFactor {
            from: before,
            to,
            from_from_to: link.previous_from_submap,
            information: information_of(&covariance),
            kernel: RobustKernel::GemanMcClure { scale: CHAIN_SCALE },
            weight: 1.0,
        });
    }

    /// How uncertain each submap up to `newer` is as seen from `newer`: along the most certain way
    /// through the graph, where closures are short cuts (Dijkstra 1959).
    #[must_use]
    pub fn doubts_from(&self, newer: usize) -> Vec<Doubt> {
        #[derive(Clone, Copy)]
        struct Reached {
            variance_m2: f64,
            variance_rad2: f64,
            path_m: f64,
        }
        let mut neighbours = vec![Vec::new(); newer + 1];
        for factor in self.graph.between_factors().iter().filter(|f| f.from <= newer && f.to <= newer) {
            let covariance = factor.information.try_inverse().unwrap_or_else(Matrix3::identity);
            let link = Reached {
                variance_m2: 0.5 * (covariance[(0, 0)] + covariance[(1, 1)]),
                variance_rad2: covariance[(2, 2)],
                path_m: factor.from_from_to.distance(),
            };
            neighbours[factor.from].push((factor.to, link));
            neighbours[factor.to].push((factor.from, link));
        }
        let unknown = Reached { variance_m2: f64::INFINITY, variance_rad2: f64::INFINITY, path_m: 0.0 };
        let mut reached = vec![unknown; newer + 1];
        reached[newer] = Reached { variance_m2: 0.0, variance_rad2: 0.0, path_m: 0.0 };
        // Positive floats sort like their bits.
        let mut queue = BTreeSet::from([(0_u64, newer)]);
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
        let factor = DOUBT_FACTOR * DOUBT_PER_MISS.powi(self.misses);
        reached
            .iter()
            .map(|there| {
                // Who left the graph cannot be reached; it is not looked for either.
                if there.variance_m2.is_infinite() {
                    return Doubt { sigma_m: f64::INFINITY, sigma_rad: f64::INFINITY };
                }
                let lever_m = LEVER_SHARE * there.path_m.min(LONGEST_LEVER_M);
                Doubt {
                    sigma_m: factor * (there.variance_m2 + there.variance_rad2 * lever_m * lever_m).sqrt(),
                    sigma_rad: factor * there.variance_rad2.sqrt(),
                }
            })
            .collect()
    }

    /// What may have happened, given what the comparisons of the newest submap found with places that it is tied to
    /// already.
    ///
    /// `first` is the number of the first of the comparisons.
    #[must_use]
    pub fn decide(
        self,
        submaps: &[Submap],
        newer: usize,
        comparisons: &[Comparison],
        first: usize,
        config: &LoopClosureConfig,
    ) -> Vec<Self> {
        let doubts = self.doubts_from(newer);
        let clusters = self.clusters(submaps, newer, comparisons, first, &doubts);
        let Some(best) = clusters.first() else {
            return vec![self.without_recognition(newer, comparisons, &doubts)];
        };
        let thought = self.poses()[newer].compose(&submaps[newer].middle);
        let shift = thought.between(&best.world_from_middle);
        let is_routine = clusters.len() == 1 && shift.distance() < ROUTINE_M && shift.theta.abs() < ROUTINE_RAD;
        let mut children: Vec<Self> = clusters
            .iter()
            .take(MOST_CHILDREN - 1)
            .filter_map(|cluster| self.clone().with(cluster, comparisons, first, config))
            .collect();
        if !is_routine || children.is_empty() {
            children.push(self);
        }
        children
    }

    /// Placements that are within reach, grouped by where they put the newer submap; the best first.
    fn clusters(
        &self,
        submaps: &[Submap],
        newer: usize,
        comparisons: &[Comparison],
        first: usize,
        doubts: &[Doubt],
    ) -> Vec<Cluster> {
        let thought = self.poses()[newer].compose(&submaps[newer].middle);
        let tied = self.tied_to(newer, newer);
        let mut placed: Vec<(&Placement, Pose2, (usize, usize))> = Vec::new();
        for (number, comparison) in comparisons.iter().enumerate() {
            let doubt = doubts[comparison.older];
            // Where a robot is that was carried elsewhere is a question of its own: see `relocate`.
            if !tied[comparison.older] {
                continue;
            }
            for (index, placement) in comparison.placements.iter().enumerate().filter(|(_, p)| p.fits()) {
                let world_from_middle =
                    self.poses()[comparison.older].compose(&placement.older_from_newer).compose(&submaps[newer].middle);
                let shift = thought.between(&world_from_middle);
                if shift.distance() < 3.0 * doubt.sigma_m + ROUTINE_M
                    && wrap_angle(shift.theta).abs() < 3.0 * doubt.sigma_rad + 2.0 * ROUTINE_RAD
                {
                    placed.push((placement, world_from_middle, (first + number, index)));
                }
            }
        }
        placed.sort_by(|a, b| b.0.quality().total_cmp(&a.0.quality()).then(a.2.cmp(&b.2)));
        let mut clusters: Vec<Cluster> = Vec::new();
        for (placement, world_from_middle, member) in placed {
            let agrees = |cluster: &&mut Cluster| {
                let offset = cluster.world_from_middle.between(&world_from_middle);
                offset.distance() < AGREEMENT_M && offset.theta.abs() < AGREEMENT_RAD
            };
            let surplus = placement.surplus();
            match clusters.iter_mut().find(agrees) {
                // Places found by one comparison exclude each other, however near: the better fit came first.
                Some(cluster) if cluster.members.iter().any(|&(other, _)| other == member.0) => {}
                Some(cluster) => {
                    cluster.members.push(member);
                    if cluster.members.len() <= 1 + MOST_WITNESSES {
                        cluster.support += EVIDENCE_OF_WITNESS * surplus;
                    }
                }
                None => {
                    let support = EVIDENCE_PER_QUALITY * surplus;
                    clusters.push(Cluster { world_from_middle, members: vec![member], support, deficit: 0.0 });
                }
            }
        }
        // Where another place on the same older submap fits better, that speaks against this one.
        let best_on = |older: usize| {
            let of_older = comparisons.iter().filter(|comparison| comparison.older == older);
            of_older.map(|comparison| comparison.placements[0].quality()).fold(0.0, f64::max)
        };
        for cluster in &mut clusters {
            let deficits = cluster.members.iter().map(|&(comparison, placement)| {
                let compared = &comparisons[comparison - first];
                best_on(compared.older) - compared.placements[placement].quality()
            });
            cluster.deficit = deficits.sum::<f64>() / cluster.members.len() as f64;
        }
        clusters.sort_by(|a, b| b.evidence().total_cmp(&a.evidence()));
        clusters
    }

    /// The account in which the newest submap lies where a cluster puts it; `None` where the graph
    /// rules that out.
    fn with(
        mut self,
        cluster: &Cluster,
        comparisons: &[Comparison],
        first: usize,
        config: &LoopClosureConfig,
    ) -> Option<Self> {
        let cost_before = self.graph.cost();
        let mut worst: f64 = 0.0;
        let known = self.closures.len();
        for &(comparison, placement) in &cluster.members {
            let compared = &comparisons[comparison - first];
            let factor = closure_factor(compared, &compared.placements[placement], config)?;
            let factor = self.graph.add_between(factor).ok()?;
            worst = worst.max(self.graph.squared_error(factor));
            self.closures.push(Closure { factor: Some(factor), comparison, placement });
        }
        // Half the degrees of freedom of each new closure are what it costs when all is well.
        let well = cost_before + 1.5 * cluster.members.len() as f64;
        if worst > SETTLED {
            // A graph that cannot be solved keeps its estimates: the chain alone always can.
            let _ = self.optimizer.optimize(&mut self.graph);
            if self.graph.cost() - well > CONFLICT_COST {
                self.resolve_conflict();
            }
        }
        if self.closures[known..].iter().all(|closure| !self.is_in_force(closure)) {
            return None;
        }
        self.misses = 0;
        // The graph's cost is the negative log-likelihood of drift and closures.
        self.log_weight += cluster.evidence() - (self.graph.cost() - well).max(0.0);
        Some(self)
    }

    /// The account when the newest submap was not recognised: that counts against it where much of
    /// what the submap shows should have been there.
    fn without_recognition(mut self, newer: usize, comparisons: &[Comparison], doubts: &[Doubt]) -> Self {
        let is_misfit = |comparison: &&Comparison| {
            let offset = comparison.expected.between(&self.poses()[comparison.older].between(&self.poses()[newer]));
            let near = &comparison.placements[0];
            doubts[comparison.older].sigma_m < SURE_M
                && offset.distance() < SURE_M
                && near.overlap_shares[0] > SURE_OVERLAP_SHARE
                && near.inlier_shares[0] < MISFIT_SHARE
        };
        let misfits = comparisons.iter().filter(is_misfit).count();
        if misfits > 0 {
            self.misses = (self.misses + 1).min(MOST_MISSES);
            self.log_weight -= MISS_EVIDENCE;
        }
        self
    }

    /// Solves a graph in which some factors must be wrong, closures or links of the chain, without
    /// knowing which: graduated non-convexity (Yang et al. 2020). At first all factors pull, then
    /// those that the others contradict lose their say. Factors keep their kernels afterwards.
    fn resolve_conflict(&mut self) {
        let count = self.graph.between_factors().len();
        let mut loosened = self.graph.clone();
        for factor in 0..count {
            loosened.set_kernel(factor, RobustKernel::Quadratic);
        }
        for stage in 0..GRADUATION_STAGES {
            let scale = (CONFLICT * 4.0_f64.powi(GRADUATION_STAGES - 1 - stage)).sqrt();
            let kernel = RobustKernel::GemanMcClure { scale };
            for factor in 0..count {
                let weight = if stage == 0 { 1.0 } else { kernel.weight(loosened.squared_error(factor)) };
                loosened.set_weight(factor, weight.max(1e-6));
            }
            let _ = self.optimizer.optimize(&mut loosened);
        }
        let mut resolved = self.graph.clone();
        resolved.poses_mut().copy_from_slice(loosened.poses());
        let _ = self.optimizer.optimize(&mut resolved);
        if resolved.cost() < self.graph.cost() {
            self.graph = resolved;
        }
    }

    /// Solves the graph to the end and brings back the submaps that left it.
    pub fn settle(&mut self) {
        let _ = self.optimizer.optimize(&mut self.graph);
        let poses = self.all_poses();
        self.graph.poses_mut().copy_from_slice(&poses);
        for attached in std::mem::take(&mut self.attached) {
            let _ = self.graph.add_between(BetweenFactor {
                from: attached.older,
                to: attached.node,
                from_from_to: attached.older_from_node,
                information: attached.information,
                kernel: RobustKernel::Quadratic,
                weight: 1.0,
            });
        }
    }

    /// Whether two accounts have come to the same picture of the drive.
    #[must_use]
    pub fn agrees_with(&self, other: &Self) -> bool {
        self.poses().iter().zip(other.poses()).all(|(a, b)| {
            let offset = a.between(b);
            offset.distance() < SAME_ACCOUNT_M && offset.theta.abs() < SAME_ACCOUNT_RAD
        })
    }
}

/// Older submaps this near to each other, in numbers, lie along one way.
const ALONG: usize = 2;
/// Submaps leave the graph only where they lie on an older one with at most this standard deviation, metres.
const ATTACHED_SIGMA_M: f64 = 0.05;
/// A submap's closures are among the newest so many.
const RECENT_CLOSURES: usize = 100;
/// Steps from trusting all factors to doubting those that do not fit.
const GRADUATION_STAGES: i32 = 8;
/// An account is sure where a submap lies when it doubts it by less than this, metres …
const SURE_M: f64 = 0.3;
/// … and expects to recognise it where the older one had so much of it in view; less of it than the latter is a misfit.
const SURE_OVERLAP_SHARE: f64 = 0.6;
const MISFIT_SHARE: f64 = 0.4;
/// What it counts not to be recognised.
const MISS_EVIDENCE: f64 = 2.0;
/// Accounts whose submaps all lie closer than this are one, metres and radians.
const SAME_ACCOUNT_M: f64 = 0.15;
const SAME_ACCOUNT_RAD: f64 = 0.02;

impl Cluster {
    /// Log-likelihood ratio of what fits being right against its fitting by chance.
    fn evidence(&self) -> f64 {
        self.support - EVIDENCE_PER_DEFICIT * self.deficit
    }
}

impl Placement {
    /// By how much it fits better than a wrong place would.
    pub(super) fn surplus(&self) -> f64 {
        (self.quality() - CHANCE_QUALITY).min(self.distinctness).max(0.0)
    }
}

/// What a fit is worth that is so much better than a wrong one would be, and so much worse than another on the same
/// older submap; log-likelihood.
pub(super) fn fit_evidence(surplus: f64, deficit: f64) -> f64 {
    EVIDENCE_PER_QUALITY * surplus - EVIDENCE_PER_DEFICIT * deficit
}

/// A placement as a factor of a graph.
pub(super) fn closure_factor(
    comparison: &Comparison,
    placement: &Placement,
    config: &LoopClosureConfig,
) -> Option<BetweenFactor> {
    debug_assert_eq!(placement.verdict, Verdict::Accepted);
    let floor = Matrix3::from_diagonal(
        &[config.closure_sigma_m.powi(2), config.closure_sigma_m.powi(2), config.closure_sigma_rad.powi(2)].into(),
    );
    let information = (floor + placement.covariance).try_inverse()?;
    Some(BetweenFactor {
        from: comparison.older,
        to: comparison.newer,
        from_from_to: placement.older_from_newer,
        information: symmetric(&information),
        kernel: RobustKernel::DynamicCovarianceScaling { phi: CLOSURE_PHI },
        weight: 1.0,
    })
}

/// The information of a covariance.
fn information_of(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    symmetric(&covariance.try_inverse().unwrap_or_else(Matrix3::identity))
}

fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (matrix + matrix.transpose())
}
