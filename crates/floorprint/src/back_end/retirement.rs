//! Submaps that show nothing new leave the graph, so that it grows with the area that was seen and not with time.
//!
//! Where such a submap lies on an older one is remembered; those before and after it are connected to the older one instead.

use super::LoopClosureConfig;
use super::hypothesis::{Attached, Closure, Constraint, Hypothesis};
use super::place_graph::PlaceGraph;
use super::submap::Submap;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, symmetric};
use crate::pose_graph::{BetweenFactor, PoseGraph, PriorFactor, RobustKernel};
use nalgebra::Matrix3;
use std::sync::Arc;

/// Where a submap lies on an older one is known when the standard deviation is less than this, metres.
const ATTACHED_SIGMA_M: f64 = 0.05;
/// What so many closures on a submap have said is hardly changed by more of them.
const ENOUGH_CLOSURES: usize = 3;

/// A motion with its covariance over (x, y, θ) in the axes at its end.
#[derive(Debug, Clone, Copy)]
struct Motion {
    pose: Pose2,
    covariance: Matrix3<f64>,
}

impl Motion {
    fn of(factor: &BetweenFactor) -> Self {
        Self { pose: factor.from_from_to, covariance: inverse(&factor.information) }
    }

    /// First this motion, then another.
    fn then(&self, next: &Self) -> Self {
        let adjoint = next.pose.inverse().adjoint();
        let covariance = adjoint * self.covariance * adjoint.transpose() + next.covariance;
        Self { pose: self.pose.compose(&next.pose), covariance }
    }

    /// The way back.
    fn inverse(&self) -> Self {
        let adjoint = self.pose.adjoint();
        Self { pose: self.pose.inverse(), covariance: adjoint * self.covariance * adjoint.transpose() }
    }

    /// As a factor between two nodes, believed as far as another.
    fn factor(&self, [from, to]: [usize; 2], like: &BetweenFactor) -> BetweenFactor {
        let information = symmetric(&inverse(&self.covariance));
        BetweenFactor { from, to, from_from_to: self.pose, information, ..like.clone() }
    }
}

impl PlaceGraph {
    /// Takes a submap that was forgotten for one more pass over the one that shows what it shows. Where there are too many
    /// of those the oldest are not wanted any more: the key scans are the session's to forget, the comparisons are forgotten.
    pub(super) fn keep_newest_passes(&mut self, past: usize, config: &LoopClosureConfig) {
        let Some(home) = self.submaps[past].shown_by else { return };
        Arc::make_mut(&mut self.submaps[home]).passes.push(past);
        // Who is lost may yet turn out to have been elsewhere.
        if self.is_lost() {
            return;
        }
        while let Some(&oldest) = self.submaps[home].passes.first() {
            let is_long_ago = self.is_long_before(&self.submaps[oldest], past, config.window_m);
            if self.submaps[home].passes.len() <= config.passes_kept || !is_long_ago {
                return;
            }
            Arc::make_mut(&mut self.submaps[home]).passes.remove(0);
            if !self.hypotheses.iter().any(|hypothesis| hypothesis.breaks_at(oldest)) {
                self.outdated.push(oldest);
                self.forget_comparisons(oldest);
                self.settle(oldest);
            }
        }
    }

    /// Where all hypotheses have a submap on the same older one it is remembered once, as the heaviest one has it.
    fn settle(&mut self, submap: usize) {
        let of =
            |hypothesis: &Hypothesis| hypothesis.attached.iter().find(|attached| attached.submap == submap).copied();
        let Some(attached) = of(&self.hypotheses[0]) else { return };
        if self.hypotheses.iter().all(|hypothesis| of(hypothesis).is_some_and(|other| other.older == attached.older)) {
            self.hypotheses
                .iter_mut()
                .for_each(|hypothesis| hypothesis.attached.retain(|other| other.submap != submap));
            Arc::make_mut(&mut self.submaps[submap]).attached = Some(attached);
        }
    }

    /// Forgets what a submap was compared with when it was new, unless it may still decide something.
    fn forget_comparisons(&mut self, submap: usize) {
        let first = self.comparisons.partition_point(|comparison| comparison.newer < submap);
        let end = self.comparisons.partition_point(|comparison| comparison.newer <= submap);
        let forgotten = first..end;
        let is_needed = |hypothesis: &Hypothesis| {
            hypothesis.constraints.iter().any(|constraint| forgotten.contains(&constraint.comparison))
        };
        if self.hypotheses.iter().any(is_needed) {
            return;
        }
        let renumber = |comparison: &mut usize| {
            if *comparison >= end {
                *comparison -= end - first;
            }
        };
        for hypothesis in &mut self.hypotheses {
            hypothesis.past_closures.retain(|closure| !forgotten.contains(&closure.comparison));
            hypothesis.past_closures.iter_mut().for_each(|closure| renumber(&mut closure.comparison));
            hypothesis.constraints.iter_mut().for_each(|constraint| renumber(&mut constraint.comparison));
        }
        self.comparisons.drain(forgotten.clone());
    }
}

impl Hypothesis {
    /// Whether the drive may have been interrupted right before or after a submap.
    fn breaks_at(&self, submap: usize) -> bool {
        self.breaks.iter().any(|at| at.submap == submap || at.submap == submap + 1)
    }

    /// Takes a submap that lies on an older one out of the graph. Leaves the graph as it is where the hypothesis does not
    /// hold the submap for recognised on one of the first `long_ago`, or where few recognised that one before.
    pub fn attach(&mut self, submap: usize, long_ago: usize) {
        let Some(node) = self.node_of(submap) else { return };
        // Where the drive was interrupted the way there is not known, or not yet.
        if self.breaks_at(submap) {
            return;
        }
        let next = self.links().find(|link| link.from == node && link.to == node + 1);
        let (Some(hold), Some(next)) = (self.hold_of(node, long_ago), next) else { return };
        let older_from_submap = self.graph.poses()[hold.from].between(&self.graph.poses()[node]);
        let held = Motion { pose: older_from_submap, covariance: inverse(&hold.information) };
        // The next submap's node takes this one's number.
        let mut bridges = vec![held.then(&Motion::of(next)).factor([hold.from, node], next)];
        // Nor may the way here lose its end where the submap before is not held itself.
        let before = self.links().find(|link| link.from + 1 == node && link.to == node && link.from != hold.from);
        if let Some(before) = before.filter(|before| !self.closures_of(before.from).any(is_sure)) {
            bridges.push(held.then(&Motion::of(before).inverse()).factor([hold.from, before.from], before));
        }
        let attached =
            Attached { submap, older: self.in_play[hold.from], older_from_submap, information: hold.information };
        self.attached.push(attached);
        self.remove(node);
        for bridge in bridges {
            let _ = self.graph.add_between(bridge);
        }
    }

    /// What holds a submap where it lies: its surest closure, on one of the first `long_ago` submaps that enough others
    /// were recognised on before. Along a bare corridor a closure knows less than the way there.
    fn hold_of(&self, node: usize, long_ago: usize) -> Option<&BetweenFactor> {
        let is_recognised = |closure: &&BetweenFactor| {
            let on_the_same = self.closures_in_force().filter(|other| other.from == closure.from && other.to < node);
            on_the_same.count() >= ENOUGH_CLOSURES
        };
        let closures = self.closures_of(node).filter(|closure| self.in_play[closure.from] < long_ago);
        let surest =
            closures.filter(is_recognised).max_by(|a, b| a.information.trace().total_cmp(&b.information.trace()))?;
        if is_sure(surest) { Some(surest) } else { self.links().find(|link| link.to == node) }
    }

    /// The factors that are no closures, the last first.
    fn links(&self) -> impl Iterator<Item = &BetweenFactor> {
        let is_closure = |number: usize| self.constraints.iter().any(|constraint| constraint.factor == number);
        let factors = self.graph.between_factors().iter().enumerate().rev();
        factors.filter(move |&(number, _)| !is_closure(number)).map(|(_, link)| link)
    }

    /// The closures that pull.
    pub(super) fn closures_in_force(&self) -> impl Iterator<Item = &BetweenFactor> {
        let in_force = self.constraints.iter().filter(|constraint| self.is_in_force(constraint.factor));
        in_force.map(|constraint| &self.graph.between_factors()[constraint.factor])
    }

    /// The closures in force by which a submap was recognised on older ones.
    fn closures_of(&self, node: usize) -> impl Iterator<Item = &BetweenFactor> {
        self.closures_in_force().filter(move |closure| closure.to == node)
    }

    /// Takes a node out of the graph with all its factors.
    fn remove(&mut self, node: usize) {
        let factors = self.graph.between_factors();
        let is_of_node =
            |constraint: &&Constraint| factors[constraint.factor].to == node || factors[constraint.factor].from == node;
        let closures: Vec<Closure> =
            self.constraints.iter().filter(is_of_node).map(|constraint| self.closure_of(constraint)).collect();
        self.past_closures.extend(closures);
        self.in_play.remove(node);
        let numbers = self.graph.remove_node(node);
        self.constraints
            .retain_mut(|constraint| numbers[constraint.factor].map(|number| constraint.factor = number).is_some());
    }

    /// Where the submaps lie that left the graph, ascending.
    fn all_attached(&self, submaps: &[Arc<Submap>]) -> Vec<Attached> {
        let settled = submaps.iter().filter_map(|submap| submap.attached);
        let mut attached: Vec<Attached> = settled.chain(self.attached.iter().copied()).collect();
        attached.sort_by_key(|attached| attached.submap);
        attached
    }

    /// The poses of all submaps, world from submap, also of those that left the graph.
    #[must_use]
    pub fn all_poses(&self, submaps: &[Arc<Submap>]) -> Vec<Pose2> {
        let mut poses = vec![Pose2::IDENTITY; self.newest().map_or(0, |(newest, _)| newest + 1)];
        for (submap, pose) in self.in_play() {
            poses[submap] = pose;
        }
        for attached in self.all_attached(submaps) {
            poses[attached.submap] = poses[attached.older].compose(&attached.older_from_submap);
        }
        poses
    }

    /// The graph with all submaps as its nodes, also those that left it.
    #[must_use]
    pub fn whole_graph(&self, submaps: &[Arc<Submap>]) -> PoseGraph {
        let mut graph = PoseGraph::default();
        for pose in self.all_poses(submaps) {
            graph.add_node(pose);
        }
        for factor in self.graph.prior_factors() {
            let _ = graph.add_prior(PriorFactor { node: self.in_play[factor.node], ..factor.clone() });
        }
        for factor in self.graph.between_factors() {
            let [from, to] = [factor.from, factor.to].map(|node| self.in_play[node]);
            let _ = graph.add_between(BetweenFactor { from, to, ..factor.clone() });
        }
        for attached in self.all_attached(submaps) {
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
}

/// Whether a closure tells where along its corridor, too, a submap lies.
fn is_sure(closure: &BetweenFactor) -> bool {
    let covariance = inverse(&closure.information);
    covariance[(0, 0)] + covariance[(1, 1)] < 2.0 * ATTACHED_SIGMA_M * ATTACHED_SIGMA_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_graph::Marginals;
    use nalgebra::Vector3;

    fn motion(x: f64, y: f64, theta: f64) -> Motion {
        let covariance = Matrix3::from_diagonal(&Vector3::new(4e-4, 1e-4, 1e-6));
        Motion { pose: Pose2::new(x, y, theta), covariance }
    }

    /// A way of seven submaps, the last three of which lie on the first: the sixth was recognised for sure on the second.
    fn drive() -> Hypothesis {
        let truth = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.1], [8.0, 1.0, 0.8], [9.0, 5.0, 2.0], [1.0, 3.0, -1.0]]
            .into_iter()
            .chain([[3.5, 0.4, -0.2], [7.0, 0.8, 0.3]])
            .map(|[x, y, theta]| Pose2::new(x, y, theta));
        let mut drive = Hypothesis { in_play: (0..7).collect(), ..Hypothesis::default() };
        let poses: Vec<Pose2> = truth.collect();
        for pose in &poses {
            drive.graph.add_node(*pose);
        }
        let prior = PriorFactor { node: 0, world_from_node: poses[0], information: Matrix3::identity() * 1e8 };
        drive.graph.add_prior(prior).unwrap();
        let constraint = |drive: &mut Hypothesis, from: usize, to: usize, sigma: [f64; 3], is_closure: bool| {
            let information = Matrix3::from_diagonal(&Vector3::from(sigma.map(|sigma| 1.0 / (sigma * sigma))));
            let from_from_to = poses[from].between(&poses[to]);
            let kernel = RobustKernel::Quadratic;
            let factor = BetweenFactor { from, to, from_from_to, information, kernel, weight: 1.0 };
            let factor = drive.graph.add_between(factor).unwrap();
            if is_closure {
                drive.constraints.push(Constraint { factor, comparison: factor, placement: 0 });
            }
        };
        for from in 0..6 {
            // On the way back to the start the robot nearly loses its way.
            let sigma = if from == 3 { [1.0, 1.0, 0.3] } else { [0.03, 0.01, 0.004] };
            constraint(&mut drive, from, from + 1, sigma, false);
        }
        for to in 2..5 {
            constraint(&mut drive, 1, to, [2.0, 2.0, 0.5], true);
        }
        constraint(&mut drive, 1, 5, [0.02, 0.015, 0.003], true);
        drive
    }

    #[test]
    fn a_submap_leaves_the_graph_and_what_it_said_of_its_neighbours_stays() {
        let before = drive();
        let mut after = before.clone();
        after.attach(5, 2);
        assert_eq!(after.in_play, [0, 1, 2, 3, 4, 6]);
        assert_eq!((after.constraints.len(), after.past_closures.len()), (3, 1));
        assert!(after.graph.cost() < 1e-12, "nothing was contradicted: {}", after.graph.cost());
        let (of_all, of_rest) = (Marginals::new(&before.graph).unwrap(), Marginals::new(&after.graph).unwrap());
        for (submap, node) in [(4, 4), (6, 5)] {
            let [full, rest] = [of_all.relative_covariance(1, submap), of_rest.relative_covariance(1, node)];
            for axis in 0..3 {
                let ratio = (rest[(axis, axis)] / full[(axis, axis)]).sqrt();
                assert!((0.95..1.1).contains(&ratio), "submap {submap}, axis {axis}: {ratio}");
            }
        }
        let (whole, poses) = (after.whole_graph(&[]), after.all_poses(&[]));
        assert_eq!((whole.poses().len(), poses.len()), (7, 7));
        for (pose, truth) in poses.iter().zip(before.graph.poses()) {
            assert!(truth.between(pose).distance() < 1e-9 && truth.between(pose).theta.abs() < 1e-9);
        }
    }

    #[test]
    fn what_few_recognised_before_stays_in_the_graph() {
        let mut drive = drive();
        drive.constraints.remove(0);
        drive.attach(5, 2);
        assert_eq!(drive.in_play.len(), 7);
        // Nor may the older submap be of the same passage.
        let mut drive = self::drive();
        drive.attach(5, 1);
        assert_eq!(drive.in_play.len(), 7);
    }

    #[test]
    fn there_and_back_is_no_motion_and_doubly_uncertain() {
        let step = motion(3.0, 1.0, 0.7);
        let back = step.inverse();
        assert!((back.inverse().covariance - step.covariance).amax() < 1e-15);
        let nothing = step.then(&back);
        assert!(nothing.pose.distance() < 1e-12 && nothing.pose.theta.abs() < 1e-12);
        // Seen from the start, both steps err alike.
        assert!((nothing.covariance - 2.0 * back.covariance).amax() < 1e-15);
    }

    #[test]
    fn the_order_in_which_motions_are_put_together_does_not_matter() {
        let [a, b, c] = [motion(1.0, 0.2, 0.5), motion(-2.0, 1.0, -1.2), motion(0.3, 0.4, 2.0)];
        let (left, right) = (a.then(&b).then(&c), a.then(&b.then(&c)));
        assert!(left.pose.between(&right.pose).distance() < 1e-12);
        assert!((left.covariance - right.covariance).amax() < 1e-15);
    }
}
