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
use crate::pose_graph::{BetweenFactor, Optimizer, PoseGraph, PriorFactor, RobustKernel};
use nalgebra::Matrix3;
use std::collections::BTreeSet;

/// A set of decisions about closures.
#[derive(Debug, Clone, Default)]
pub struct Hypothesis {
    /// Its nodes are the submaps in play.
    pub(super) graph: PoseGraph,
    /// The submap of each node, ascending.
    in_play: Vec<usize>,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f64,
    /// The closures of submaps in play, in the order of the factors.
    pub(super) ties: Vec<Tie>,
    /// How many submaps in a row should have been recognised and were not.
    pub(super) misses: i32,
    /// Submaps that show nothing new and left the graph, ascending.
    attached: Vec<Attached>,
    /// What became of their closures.
    past_closures: Vec<Closure>,
    /// Where the robot may have been carried elsewhere.
    pub(super) breaks: Vec<Break>,
}

/// A submap that lies on an older one and was taken out of the graph.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Attached {
    submap: usize,
    /// One in play.
    older: usize,
    older_from_submap: Pose2,
    information: Matrix3<f64>,
}

/// A placement that is a factor of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tie {
    /// Number of the factor.
    pub(super) factor: usize,
    /// Number of the comparison.
    pub(super) comparison: usize,
    /// Number of its placement.
    pub(super) placement: usize,
}

/// A placement that is held for true.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closure {
    /// Number of the comparison.
    pub comparison: usize,
    /// Number of its placement.
    pub placement: usize,
    /// Whether it pulls, or is contradicted by the rest of the graph.
    pub is_in_force: bool,
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

impl Hypothesis {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

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
        self.past_closures.iter().copied().chain(self.ties.iter().map(|tie| self.closure_of(tie)))
    }

    /// Those found by a comparison or later ones, the last first.
    pub fn closures_since(&self, comparison: usize) -> impl Iterator<Item = Closure> {
        let recent = self.ties.iter().rev().filter(move |tie| tie.comparison >= comparison);
        recent.map(|tie| self.closure_of(tie))
    }

    fn closure_of(&self, tie: &Tie) -> Closure {
        let Tie { factor, comparison, placement } = *tie;
        Closure { comparison, placement, is_in_force: self.is_in_force(factor) }
    }

    fn is_in_force(&self, factor: usize) -> bool {
        self.graph.squared_error(factor) < CONFLICT
    }

    /// Takes a submap that lies on an older one out of the graph, so that the graph grows with the area that
    /// was seen and not with time: the next submap is tied to the older one instead. Leaves the graph as it is
    /// where the account does not hold the submap for recognised on one of the first `long_ago`, or where few
    /// recognised that one before.
    pub fn attach(&mut self, submap: usize, long_ago: usize) {
        let Some(node) = self.node_of(submap) else { return };
        // Where the drive was interrupted the way there is not known, or not yet.
        if self.breaks.iter().any(|at| at.submap == submap || at.submap == submap + 1) {
            return;
        }
        let factors = self.graph.between_factors();
        let closures = |is_wanted: &dyn Fn(&BetweenFactor) -> bool| {
            let wanted = self.ties.iter().map(|tie| tie.factor).filter(|&factor| is_wanted(&factors[factor]));
            let in_force = wanted.filter(|&factor| self.is_in_force(factor));
            in_force.map(|factor| &factors[factor]).collect::<Vec<_>>()
        };
        let closure = closures(&|factor| factor.to == node && self.in_play[factor.from] < long_ago)
            .into_iter()
            .filter(|closure| {
                closures(&|factor| factor.from == closure.from && factor.to < node).len() >= ENOUGH_CLOSURES
            })
            .max_by(|a, b| a.information.trace().total_cmp(&b.information.trace()));
        let link = |is_wanted: &dyn Fn(&BetweenFactor) -> bool| {
            let mut wanted = factors.iter().enumerate().rev().filter(|(_, factor)| is_wanted(factor));
            wanted.find(|&(number, _)| self.ties.iter().all(|tie| tie.factor != number)).map(|(_, link)| link)
        };
        let next = link(&|factor| factor.from == node && factor.to == node + 1);
        let (Some(closure), Some(next)) = (closure, next) else { return };
        // Along a bare corridor a closure knows less than the way there.
        let is_sure = |closure: &BetweenFactor| {
            let covariance = inverse(&closure.information);
            covariance[(0, 0)] + covariance[(1, 1)] < 2.0 * ATTACHED_SIGMA_M * ATTACHED_SIGMA_M
        };
        let Some(tie) = Some(closure).filter(|closure| is_sure(closure)).or_else(|| link(&|factor| factor.to == node))
        else {
            return;
        };
        let older_from_submap = self.graph.poses()[tie.from].between(&self.graph.poses()[node]);
        let adjoint = next.from_from_to.inverse().adjoint();
        let covariance = adjoint * inverse(&tie.information) * adjoint.transpose() + inverse(&next.information);
        let older = self.in_play[tie.from];
        let attached = Attached { submap, older, older_from_submap, information: tie.information };
        // The next submap's node takes this one's number.
        let past_it = BetweenFactor {
            from: tie.from,
            to: node,
            from_from_to: older_from_submap.compose(&next.from_from_to),
            information: symmetric(&inverse(&covariance)),
            ..next.clone()
        };
        // Nor may the way here lose its end where the submap before is not held itself.
        let is_held = |node: usize| closures(&|factor| factor.to == node).into_iter().any(is_sure);
        let before = link(&|factor| factor.to == node && factor.from + 1 == node && !is_held(factor.from));
        let way_here = before.filter(|before| before.from != tie.from).map(|before| {
            let adjoint = before.from_from_to.adjoint();
            let covariance = adjoint * (inverse(&tie.information) + inverse(&before.information)) * adjoint.transpose();
            BetweenFactor {
                from: tie.from,
                to: before.from,
                from_from_to: older_from_submap.compose(&before.from_from_to.inverse()),
                information: symmetric(&inverse(&covariance)),
                ..before.clone()
            }
        });
        let is_of_node = |tie: &&Tie| factors[tie.factor].to == node || factors[tie.factor].from == node;
        let closures: Vec<Closure> = self.ties.iter().filter(is_of_node).map(|tie| self.closure_of(tie)).collect();
        self.past_closures.extend(closures);
        self.attached.push(attached);
        self.in_play.remove(node);
        let numbers = self.graph.remove_node(node);
        self.ties.retain_mut(|tie| numbers[tie.factor].map(|number| tie.factor = number).is_some());
        for bridge in std::iter::once(past_it).chain(way_here) {
            let _ = self.graph.add_between(bridge);
        }
    }

    /// The poses of all submaps, world from submap, also of those that left the graph.
    #[must_use]
    pub fn all_poses(&self) -> Vec<Pose2> {
        let mut poses = vec![Pose2::IDENTITY; self.newest().map_or(0, |(newest, _)| newest + 1)];
        for (submap, pose) in self.in_play() {
            poses[submap] = pose;
        }
        for attached in &self.attached {
            poses[attached.submap] = poses[attached.older].compose(&attached.older_from_submap);
        }
        poses
    }

    /// The graph with all submaps as its nodes, also those that left it.
    #[must_use]
    pub fn whole_graph(&self) -> PoseGraph {
        let mut graph = PoseGraph::default();
        for pose in self.all_poses() {
            graph.add_node(pose);
        }
        for factor in self.graph.prior_factors() {
            let _ = graph.add_prior(PriorFactor { node: self.in_play[factor.node], ..factor.clone() });
        }
        for factor in self.graph.between_factors() {
            let [from, to] = [factor.from, factor.to].map(|node| self.in_play[node]);
            let _ = graph.add_between(BetweenFactor { from, to, ..factor.clone() });
        }
        for attached in &self.attached {
            let _ = graph.add_between(BetweenFactor {
                from: attached.older,
                to: attached.submap,
                from_from_to: attached.older_from_submap,
                information: attached.information,
                kernel: RobustKernel::Quadratic,
                weight: 1.0,
            });
        }
        graph
    }

    /// Solves the graph to the end.
    pub fn settle(&mut self) {
        // A graph that cannot be solved keeps its estimates: the chain alone always can.
        let _ = Optimizer::default().optimize(&mut self.graph);
    }

    /// Takes in the next submap: tied to the one before as the front end has it.
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
        if let (Some(interruption), Some((newest, _))) = (submap.starts_anew, self.newest()) {
            self.breaks.push(Break::new(newest, interruption, symmetric(&inverse(&covariance))));
            covariance += carried_elsewhere();
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

    /// How uncertain each submap in play is as seen from the newest: along the most certain way
    /// through the graph, where closures are short cuts (Dijkstra 1959).
    #[must_use]
    pub fn doubts(&self) -> Vec<Doubt> {
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
        let factor = DOUBT_FACTOR * DOUBT_PER_MISS.powi(self.misses);
        reached
            .iter()
            .map(|there| {
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
    /// `first` is the number of the first of the comparisons, `doubts` are those of the submaps in play.
    #[must_use]
    pub fn decide(
        self,
        submaps: &[Submap],
        doubts: &[Doubt],
        comparisons: &[Comparison],
        first: usize,
        config: &LoopClosureConfig,
    ) -> Vec<Self> {
        let Some((newer, pose)) = self.newest() else { return vec![self] };
        let thought = pose.compose(&submaps[newer].middle);
        let clusters = self.clusters(&submaps[newer].middle, comparisons, first, doubts);
        let Some(best) = clusters.first() else {
            return vec![self.without_recognition(&pose, comparisons, doubts)];
        };
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

    /// Placements that are within reach, grouped by where they put the newest submap, whose `middle` is given; the
    /// best first.
    fn clusters(&self, middle: &Pose2, comparisons: &[Comparison], first: usize, doubts: &[Doubt]) -> Vec<Cluster> {
        let Some((newest, pose)) = self.newest() else { return Vec::new() };
        let thought = pose.compose(middle);
        let tied = self.tied_to(newest);
        let mut placed: Vec<(&Placement, Pose2, (usize, usize))> = Vec::new();
        for (number, comparison) in comparisons.iter().enumerate() {
            // Where a robot is that was carried elsewhere is a question of its own: see `relocate`.
            let Some(node) = self.node_of(comparison.older).filter(|&node| tied[node]) else { continue };
            let (world_from_older, doubt) = (self.graph.poses()[node], doubts[node]);
            for (index, placement) in comparison.placements.iter().enumerate().filter(|(_, p)| p.fits()) {
                let world_from_middle = world_from_older.compose(&placement.older_from_newer).compose(middle);
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
        let known = self.ties.len();
        let mut optimizer = Optimizer::default();
        for &(comparison, placement) in &cluster.members {
            let compared = &comparisons[comparison - first];
            let nodes = [self.node_of(compared.older)?, self.node_of(compared.newer)?];
            let factor = closure_factor(nodes, &compared.placements[placement], config)?;
            let factor = self.graph.add_between(factor).ok()?;
            worst = worst.max(self.graph.squared_error(factor));
            self.ties.push(Tie { factor, comparison, placement });
        }
        // Half the degrees of freedom of each new closure are what it costs when all is well.
        let well = cost_before + 1.5 * cluster.members.len() as f64;
        if worst > SETTLED {
            // A graph that cannot be solved keeps its estimates: the chain alone always can.
            let _ = optimizer.optimize(&mut self.graph);
            if self.graph.cost() - well > CONFLICT_COST {
                self.resolve_conflict(&mut optimizer);
            }
        }
        if self.ties[known..].iter().all(|tie| !self.is_in_force(tie.factor)) {
            return None;
        }
        self.misses = 0;
        // The graph's cost is the negative log-likelihood of drift and closures.
        self.log_weight += cluster.evidence() - (self.graph.cost() - well).max(0.0);
        Some(self)
    }

    /// The account when the newest submap was not recognised: that counts against it where much of
    /// what the submap shows should have been there.
    fn without_recognition(mut self, pose: &Pose2, comparisons: &[Comparison], doubts: &[Doubt]) -> Self {
        let is_misfit = |comparison: &&Comparison| {
            let Some(node) = self.node_of(comparison.older) else { return false };
            let offset = comparison.expected.between(&self.graph.poses()[node].between(pose));
            let near = &comparison.placements[0];
            doubts[node].sigma_m < SURE_M
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
    fn resolve_conflict(&mut self, optimizer: &mut Optimizer) {
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
            let _ = optimizer.optimize(&mut loosened);
        }
        let mut resolved = self.graph.clone();
        resolved.poses_mut().copy_from_slice(loosened.poses());
        let _ = optimizer.optimize(&mut resolved);
        if resolved.cost() < self.graph.cost() {
            self.graph = resolved;
        }
    }

    /// Whether two accounts have come to the same picture of the drive, as far as both hold it in play.
    #[must_use]
    pub fn agrees_with(&self, other: &Self) -> bool {
        self.in_play().all(|(submap, pose)| {
            other.pose_of(submap).is_none_or(|there| {
                let offset = pose.between(&there);
                offset.distance() < SAME_ACCOUNT_M && offset.theta.abs() < SAME_ACCOUNT_RAD
            })
        })
    }
}

/// Where a submap lies on an older one is known when the standard deviation is less than this, metres.
const ATTACHED_SIGMA_M: f64 = 0.05;
/// What so many closures on a submap have said is hardly changed by more of them.
const ENOUGH_CLOSURES: usize = 3;
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

fn inverse(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    matrix.try_inverse().unwrap_or_else(Matrix3::identity)
}

fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (matrix + matrix.transpose())
}
