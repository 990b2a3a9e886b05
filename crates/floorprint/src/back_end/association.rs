//! Data association: which of the places where a newest submap fits it really shows.
//!
//! Placements that agree where the submap lies form a cluster. Each cluster, and the possibility that none is right,
//! continues the hypothesis.

use super::LoopClosureConfig;
use super::conflict::resolve_conflict;
use super::evidence::{EVIDENCE_OF_WITNESS, EVIDENCE_PER_DEFICIT, MISS_EVIDENCE, MOST_WITNESSES, fit_evidence};
use super::hypothesis::{AGREEMENT_M, AGREEMENT_RAD, Constraint, Hypothesis, closure_factor};
use super::place_match::{Comparison, Placement};
use super::submap::Submap;
use super::uncertainty::Uncertainty;
use crate::geometry::{Pose2, wrap_angle};
use crate::pose_graph::Optimizer;
use std::f64::consts::TAU;
use std::sync::Arc;

/// A closure that makes the graph cost this much more than it should is in conflict with something.
const CONFLICT_COST: f64 = 5.0;
/// Closures that fit better than this change nothing worth a solution of the graph, squared standard deviations.
const SETTLED: f64 = 0.5;
/// Submaps in a row that were not recognised count up to so many.
const MOST_MISSES: i32 = 6;
/// Placements that move a submap less than this against where it was thought to be are no surprise, metres and radians.
const ROUTINE_M: f64 = 0.25;
const ROUTINE_RAD: f64 = 0.04;
/// Largest number of hypotheses that one submap can split a hypothesis into.
const MOST_CHILDREN: usize = 4;
/// A hypothesis is sure where a submap lies when its uncertainty is less than this, metres …
const SURE_M: f64 = 0.3;
/// … and expects to recognise it where the older one had so much of it in view; less of it than the latter is a misfit.
const SURE_OVERLAP_SHARE: f64 = 0.6;
const MISFIT_SHARE: f64 = 0.4;

/// A submap fits in so many wrong places for each square metre and radian in which it may lie. What is recognised from far off
/// has to fit the better for it.
const FITS_BY_CHANCE: f64 = 0.005;

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
    /// In how many places the newest submap would fit by chance, as uncertain as it was where it lies.
    by_chance: f64,
}

impl Hypothesis {
    /// What may have happened, given what the comparisons of the newest submap found with places that it is connected to
    /// already.
    ///
    /// `first` is the number of the first of the comparisons, `uncertainties` are those of the submaps in play.
    #[must_use]
    pub fn decide(
        self,
        submaps: &[Arc<Submap>],
        uncertainties: &[Uncertainty],
        comparisons: &[Comparison],
        first: usize,
        config: &LoopClosureConfig,
    ) -> Vec<Self> {
        let Some((newer, pose)) = self.newest() else { return vec![self] };
        let thought = pose.compose(&submaps[newer].middle);
        let clusters = self.clusters(&submaps[newer].middle, comparisons, first, uncertainties);
        let Some(best) = clusters.first() else {
            return vec![self.without_recognition(&pose, comparisons, uncertainties)];
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
    fn clusters(
        &self,
        middle: &Pose2,
        comparisons: &[Comparison],
        first: usize,
        uncertainties: &[Uncertainty],
    ) -> Vec<Cluster> {
        let Some((newest, pose)) = self.newest() else { return Vec::new() };
        let thought = pose.compose(middle);
        let tied = self.connected_to(newest);
        let mut placed: Vec<(&Placement, Pose2, (usize, usize), Uncertainty)> = Vec::new();
        for (number, comparison) in comparisons.iter().enumerate() {
            // Where a robot is that was kidnapped is a question of its own: see `relocate`.
            let Some(node) = self.node_of(comparison.older).filter(|&node| tied[node]) else { continue };
            let (world_from_older, uncertainty) = (self.graph.poses()[node], uncertainties[node]);
            for (index, placement) in comparison.placements.iter().enumerate().filter(|(_, p)| p.fits()) {
                let world_from_middle = world_from_older.compose(&placement.older_from_newer).compose(middle);
                let shift = thought.between(&world_from_middle);
                if shift.distance() < 3.0 * uncertainty.sigma_m + ROUTINE_M
                    && wrap_angle(shift.theta).abs() < 3.0 * uncertainty.sigma_rad + 2.0 * ROUTINE_RAD
                {
                    placed.push((placement, world_from_middle, (first + number, index), uncertainty));
                }
            }
        }
        placed.sort_by(|a, b| b.0.quality().total_cmp(&a.0.quality()).then(a.2.cmp(&b.2)));
        let mut clusters: Vec<Cluster> = Vec::new();
        for (placement, world_from_middle, member, uncertainty) in placed {
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
                    let by_chance = places_by_chance(&uncertainty);
                    clusters.push(Cluster {
                        world_from_middle,
                        members,
                        is_conclusive,
                        support,
                        deficit: 0.0,
                        by_chance,
                    });
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

    /// The hypothesis in which the newest submap lies where a cluster puts it; `None` where the graph
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
        let known = self.constraints.len();
        let mut optimizer = Optimizer::default();
        for &(comparison, placement) in &cluster.members {
            let compared = &comparisons[comparison - first];
            let nodes = [self.node_of(compared.older)?, self.node_of(compared.newer)?];
            let factor = closure_factor(nodes, &compared.placements[placement], config)?;
            let factor = self.graph.add_between(factor).ok()?;
            worst = worst.max(self.graph.squared_error(factor));
            self.constraints.push(Constraint { factor, comparison, placement });
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
        if self.constraints[known..].iter().all(|constraint| !self.is_in_force(constraint.factor)) {
            return None;
        }
        self.misses = 0;
        // The graph's cost is the negative log-likelihood of drift and closures.
        self.log_weight += cluster.evidence() - (self.graph.cost() - well).max(0.0);
        Some(self)
    }

    /// The hypothesis when the newest submap was not recognised: that counts against it where much of
    /// what the submap shows should have been there.
    fn without_recognition(mut self, pose: &Pose2, comparisons: &[Comparison], uncertainties: &[Uncertainty]) -> Self {
        let is_misfit = |comparison: &&Comparison| {
            let Some(node) = self.node_of(comparison.older) else { return false };
            let offset = comparison.expected.between(&self.graph.poses()[node].between(pose));
            let near = &comparison.placements[0];
            uncertainties[node].sigma_m < SURE_M
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
}

impl Cluster {
    /// Log-likelihood ratio of what fits being right against its fitting by chance.
    fn evidence(&self) -> f64 {
        self.support - EVIDENCE_PER_DEFICIT * self.deficit - self.by_chance.ln_1p()
    }
}

/// In how many places a submap fits by chance within the region of so much uncertainty: the density of false alarms times
/// the volume of the region (Reid 1979).
fn places_by_chance(uncertainty: &Uncertainty) -> f64 {
    let area_m2 = TAU * uncertainty.sigma_m.powi(2);
    FITS_BY_CHANCE * area_m2 * (TAU.sqrt() * uncertainty.sigma_rad).min(TAU)
}

/// Whether a placement that moves a submap by so much leaves it about where it was thought to be.
pub(super) fn is_no_surprise(shift: &Pose2) -> bool {
    shift.distance() < ROUTINE_M && wrap_angle(shift.theta).abs() < ROUTINE_RAD
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_may_be_anywhere_fits_somewhere_by_chance() {
        let evidence = |sigma_m: f64, sigma_rad: f64| {
            let by_chance = places_by_chance(&Uncertainty { sigma_m, sigma_rad });
            let (support, world_from_middle) = (fit_evidence(0.2, 0.0), Pose2::IDENTITY);
            Cluster { world_from_middle, members: Vec::new(), is_conclusive: true, support, deficit: 0.0, by_chance }
                .evidence()
        };
        // The best fit there is counts in full for who knows where he is, and not at all for who knows nothing.
        assert!((evidence(0.3, 0.05) - fit_evidence(0.2, 0.0)).abs() < 0.01);
        assert!(evidence(3.0, 0.2) > 3.0 && evidence(50.0, 3.0) < 0.0);
    }
}
