//! One account of the drive: which places were recognised, and the pose graph that follows.
//!
//! Where a newer submap may lie in several places, or perhaps in none of them, the account
//! splits. Each part goes on with a graph and a weight of its own, as the particles of a
//! Rao-Blackwellized filter do: the discrete choice is sampled, the poses given the choice
//! are Gaussian.

use super::comparison::{Comparison, Placement};
use super::conflict::resolve_conflict;
use super::doubt::Doubt;
use super::relocation::{Break, carried_elsewhere};
use super::retirement::Attached;
use super::submap::Submap;
use super::{LoopClosureConfig, Verdict};
use crate::geometry::{Pose2, wrap_angle};
use crate::pose_graph::{BetweenFactor, Optimizer, PoseGraph, PriorFactor, RobustKernel};
use nalgebra::Matrix3;

/// A set of decisions about closures.
#[derive(Debug, Clone, Default)]
pub struct Hypothesis {
    /// Its nodes are the submaps in play.
    pub(super) graph: PoseGraph,
    /// The submap of each node, ascending.
    pub(super) in_play: Vec<usize>,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f64,
    /// The closures of submaps in play, in the order of the factors.
    pub(super) ties: Vec<Tie>,
    /// How many submaps in a row should have been recognised and were not.
    pub(super) misses: i32,
    /// Submaps that show nothing new and left the graph, ascending.
    pub(super) attached: Vec<Attached>,
    /// What became of their closures.
    pub(super) past_closures: Vec<Closure>,
    /// Where the robot may have been carried elsewhere.
    pub(super) breaks: Vec<Break>,
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
/// Submaps in a row that were not recognised count up to so many.
const MOST_MISSES: i32 = 6;
/// Placements that put a submap this near to each other agree, metres and radians.
pub(super) const AGREEMENT_M: f64 = 0.35;
pub(super) const AGREEMENT_RAD: f64 = 0.06;
/// Placements that move a submap less than this against where it was thought to be are no surprise, metres and radians.
const ROUTINE_M: f64 = 0.25;
const ROUTINE_RAD: f64 = 0.04;
/// What a fit is worth: log-likelihood per unit by which it is better than a fit by chance and than places farther on.
const EVIDENCE_PER_QUALITY: f64 = 20.0;
const CHANCE_QUALITY: f64 = 0.8;
/// The same of each further older submap that agrees: it shows much of what the first does. Up to so many count.
pub(super) const EVIDENCE_OF_WITNESS: f64 = 3.5;
pub(super) const MOST_WITNESSES: usize = 4;
/// What it is worth when another place on the same older submap fits better: the same surfaces are compared.
const EVIDENCE_PER_DEFICIT: f64 = 60.0;
/// What moves a submap against where it was thought to be must fit so much better than farther on: along a bare corridor a
/// submap fits anywhere.
const LEAST_DISTINCTNESS: f64 = 0.05;
/// Largest number of accounts that one submap can split an account into.
const MOST_CHILDREN: usize = 4;

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

/// Placements of one submap that agree where it lies.
struct Cluster {
    world_from_middle: Pose2,
    /// Numbers of comparisons and placements.
    members: Vec<(usize, usize)>,
    /// Whether one of them is worth enough to move anything.
    is_conclusive: bool,
    /// What their fits are worth, as a log-likelihood.
    support: f64,
    /// How much better other places fit, on average over the members.
    deficit: f64,
}

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
        self.past_closures.iter().copied().chain(self.ties.iter().map(|tie| self.closure_of(tie)))
    }

    /// Those found by a comparison or later ones, the last first.
    pub fn closures_since(&self, comparison: usize) -> impl Iterator<Item = Closure> {
        let recent = self.ties.iter().rev().filter(move |tie| tie.comparison >= comparison);
        recent.map(|tie| self.closure_of(tie))
    }

    pub(super) fn closure_of(&self, tie: &Tie) -> Closure {
        let Tie { factor, comparison, placement } = *tie;
        Closure { comparison, placement, is_in_force: self.is_in_force(factor) }
    }

    pub(super) fn is_in_force(&self, factor: usize) -> bool {
        self.graph.squared_error(factor) < CONFLICT
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
        let is_no_surprise = |cluster: &Cluster| is_no_surprise(&thought.between(&cluster.world_from_middle));
        let is_routine = clusters.len() == 1 && is_no_surprise(best);
        let mut children: Vec<Self> = clusters
            .iter()
            .filter(|cluster| is_no_surprise(cluster) || cluster.is_conclusive)
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
            let older_of = |(number, _): (usize, usize)| comparisons[number - first].older;
            match clusters.iter_mut().find(agrees) {
                // Places on one older submap exclude each other, however near, and the same place found from several
                // expectations is no further witness: the better fit came first.
                Some(cluster) if cluster.members.iter().any(|&other| older_of(other) == older_of(member)) => {}
                Some(cluster) => {
                    cluster.members.push(member);
                    cluster.is_conclusive |= placement.is_conclusive();
                    if cluster.members.len() <= 1 + MOST_WITNESSES {
                        cluster.support += EVIDENCE_OF_WITNESS * surplus;
                    }
                }
                None => {
                    let support = fit_evidence(surplus, 0.0);
                    let is_conclusive = placement.is_conclusive();
                    let members = vec![member];
                    clusters.push(Cluster { world_from_middle, members, is_conclusive, support, deficit: 0.0 });
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
                resolve_conflict(&mut self.graph, &mut optimizer);
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

    /// Whether the fit is worth enough to move anything.
    pub(super) fn is_conclusive(&self) -> bool {
        self.distinctness > LEAST_DISTINCTNESS
    }
}

/// Whether a placement that moves a submap by so much leaves it about where it was thought to be.
pub(super) fn is_no_surprise(shift: &Pose2) -> bool {
    shift.distance() < ROUTINE_M && wrap_angle(shift.theta).abs() < ROUTINE_RAD
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

pub(super) fn inverse(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    matrix.try_inverse().unwrap_or_else(Matrix3::identity)
}

pub(super) fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (matrix + matrix.transpose())
}
