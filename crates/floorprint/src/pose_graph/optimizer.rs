//! Levenberg–Marquardt on SE(2): the poses that fit a graph's factors best
//! (Kümmerle et al. 2011, "g2o"; damping by the diagonal after Marquardt 1963).

use super::block_cholesky::SymbolicCholesky;
use super::linear_system::{BlockMatrix, Structure, normal_equations};
use super::{OptimizerConfig, PoseGraph, PoseGraphError};
use crate::geometry::Pose2;
use nalgebra::Vector3;
use serde::Serialize;

/// Damping beyond which a step has become too small to help.
const MAX_DAMPING: f64 = 1e8;

/// Solves pose graphs; keeps what depends on their structure alone, so that solving a
/// graph again with other estimates, measurements or weights is cheaper.
#[derive(Debug, Clone, Default)]
pub struct Optimizer {
    config: OptimizerConfig,
    structure: Option<(Structure, SymbolicCholesky)>,
}

/// How an optimisation went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OptimizationReport {
    /// Steps taken.
    pub iterations: usize,
    /// Cost before the first step: half the sum of the robust squared errors.
    pub initial_cost: f64,
    /// Cost after the last step; never larger.
    pub final_cost: f64,
    /// Whether it ended because there was nothing left to gain.
    pub converged: bool,
}

impl Optimizer {
    /// An optimiser with the given options.
    #[must_use]
    pub fn new(config: OptimizerConfig) -> Self {
        Self { config, structure: None }
    }

    /// Moves the graph's poses to where its factors fit best, from where they are.
    ///
    /// # Errors
    /// [`PoseGraphError::Undetermined`] when factors do not determine all poses: the poses
    /// stay as they were when the last step was taken.
    pub fn optimize(&mut self, graph: &mut PoseGraph) -> Result<OptimizationReport, PoseGraphError> {
        let found = Structure::of(graph);
        let (structure, symbolic) = match self.structure.take() {
            Some(kept) if kept.0 == found => self.structure.insert(kept),
            _ => {
                let symbolic = SymbolicCholesky::new(&found.pattern)?;
                self.structure.insert((found, symbolic))
            }
        };
        let initial_cost = graph.cost();
        let mut report = OptimizationReport { iterations: 0, initial_cost, final_cost: initial_cost, converged: false };
        let mut damping = self.config.initial_damping;
        while report.iterations < self.config.max_iterations && !report.converged {
            let (matrix, right_side) = normal_equations(graph, structure);
            let equations = (&matrix, right_side.as_slice());
            let Some(step) = accepted_step(graph, report.final_cost, structure, symbolic, equations, &mut damping)?
            else {
                report.converged = true;
                break;
            };
            graph.poses = step.poses;
            report.iterations += 1;
            report.converged = report.final_cost - step.cost <= self.config.relative_decrease * report.final_cost;
            report.final_cost = step.cost;
        }
        Ok(report)
    }
}

struct Step {
    poses: Vec<Pose2>,
    cost: f64,
}

/// The first step that does not raise the `cost`, with more and more damping; `None` when
/// there is none. Leaves the damping that the next step should try.
fn accepted_step(
    graph: &PoseGraph,
    cost: f64,
    structure: &Structure,
    symbolic: &SymbolicCholesky,
    (matrix, right_side): (&BlockMatrix, &[Vector3<f64>]),
    damping: &mut f64,
) -> Result<Option<Step>, PoseGraphError> {
    let mut is_determined = false;
    while *damping <= MAX_DAMPING {
        let mut damped = matrix.clone();
        for block in &mut damped.diagonal {
            for i in 0..3 {
                block[(i, i)] *= 1.0 + *damping;
            }
        }
        if let Some(factor) = symbolic.factorize(&damped) {
            is_determined = true;
            let poses = moved(graph, structure, &symbolic.solve(&factor, right_side));
            let step = Step { cost: graph.cost_at(&poses), poses };
            if step.cost <= cost {
                *damping *= 0.1;
                return Ok(Some(step));
            }
        }
        *damping = (*damping * 10.0).max(1e-6);
    }
    if is_determined { Ok(None) } else { Err(PoseGraphError::Undetermined) }
}

fn moved(graph: &PoseGraph, structure: &Structure, step: &[Vector3<f64>]) -> Vec<Pose2> {
    let poses = graph.poses.iter().zip(&structure.unknown_of);
    poses
        .map(|(pose, unknown)| unknown.map_or(*pose, |unknown| pose.compose(&Pose2::exp(step[unknown].into()))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::{BetweenFactor, PriorFactor, RobustKernel};
    use super::*;
    use crate::random::{Stage, generator};
    use nalgebra::Matrix3;
    use rand::RngExt;
    use rand_distr::{Distribution, Normal};
    use std::collections::BTreeMap;
    use std::f64::consts::FRAC_PI_2;

    fn between(from: usize, to: usize, from_from_to: Pose2, sigma: [f64; 3]) -> BetweenFactor {
        let information = Matrix3::from_diagonal(&Vector3::from(sigma.map(|s| 1.0 / (s * s))));
        BetweenFactor { from, to, from_from_to, information, kernel: RobustKernel::Quadratic, weight: 1.0 }
    }

    const SIGMA: [f64; 3] = [0.02, 0.02, 0.005];

    /// A drive along the streets of a grid, with noisy odometry and a noisy measurement
    /// of the earlier visits of a crossing. Returns the truth as well.
    fn manhattan(steps: usize, side: i64, seed: u64) -> (PoseGraph, Vec<Pose2>) {
        let mut random = generator(seed, Stage::World, 0, 0);
        let mut noisy = |pose: Pose2| {
            let mut draw = |sigma| Normal::new(0.0, sigma).unwrap().sample(&mut random);
            pose.compose(&Pose2::exp([draw(SIGMA[0]), draw(SIGMA[1]), draw(SIGMA[2])]))
        };
        let mut turns = generator(seed, Stage::World, 1, 0);
        let mut truth = vec![Pose2::IDENTITY];
        let mut graph = PoseGraph::default();
        graph.add_node(Pose2::IDENTITY);
        let mut visits: BTreeMap<(i64, i64), usize> = BTreeMap::new();
        for node in 1..steps {
            let last = truth[node - 1];
            let is_inside = |pose: &Pose2| pose.x.abs().max(pose.y.abs()) < side as f64 / 2.0;
            let step = loop {
                let turn = f64::from(turns.random_range(-2..=2_i32) / 2) * FRAC_PI_2;
                let step = Pose2::new(1.0, 0.0, 0.0).compose(&Pose2::new(0.0, 0.0, turn));
                if is_inside(&last.compose(&step).compose(&Pose2::new(1.0, 0.0, 0.0))) {
                    break step;
                }
            };
            let pose = last.compose(&step);
            truth.push(pose);
            let measured = noisy(step);
            graph.add_node(graph.poses[node - 1].compose(&measured));
            graph.add_between(between(node - 1, node, measured, SIGMA)).unwrap();
            let crossing = (pose.x.round() as i64, pose.y.round() as i64);
            if let Some(earlier) = visits.insert(crossing, node) {
                let measured = noisy(truth[earlier].between(&pose));
                graph.add_between(between(earlier, node, measured, SIGMA)).unwrap();
            }
        }
        (graph, truth)
    }

    fn rmse_m(graph: &PoseGraph, truth: &[Pose2]) -> f64 {
        let squares: f64 = graph.poses.iter().zip(truth).map(|(p, t)| t.between(p).distance().powi(2)).sum();
        (squares / truth.len() as f64).sqrt()
    }

    #[test]
    fn a_square_that_does_not_close_shares_its_error() {
        let mut graph = PoseGraph::default();
        let side = Pose2::new(1.0, 0.0, FRAC_PI_2);
        let long_side = Pose2::new(1.04, 0.0, FRAC_PI_2);
        for measured in [Pose2::IDENTITY, side, side, side] {
            graph.add_node(graph.poses.last().map_or(Pose2::IDENTITY, |last| last.compose(&measured)));
        }
        // Headings are all but certain, so that the problem is linear with a solution in closed form.
        for (from, to, measured) in [(0, 1, long_side), (1, 2, side), (2, 3, side), (3, 0, side)] {
            graph.add_between(between(from, to, measured, [0.1, 0.1, 1e-6])).unwrap();
        }
        let report = Optimizer::default().optimize(&mut graph).unwrap();
        assert!(report.converged && report.final_cost < report.initial_cost);
        let expected = [[0.0, 0.0], [1.03, 0.0], [1.02, 1.0], [0.01, 1.0]];
        for (pose, [x, y]) in graph.poses.iter().zip(expected) {
            assert!((pose.x - x).abs() < 1e-6 && (pose.y - y).abs() < 1e-6, "{pose:?}");
        }
        // Each of the four measurements takes 0.01 m, a tenth of its standard deviation.
        assert!((report.final_cost - 0.02).abs() < 1e-6);
    }

    #[test]
    fn only_a_prior_moves_the_first_pose_of_a_part() {
        let step = Pose2::new(1.0, 0.0, 0.5);
        let mut graph = PoseGraph::default();
        for start in [Pose2::IDENTITY, Pose2::new(5.0, 5.0, 1.0)] {
            let first = graph.add_node(start);
            graph.add_node(Pose2::new(3.0, 3.0, 3.0));
            graph.add_between(between(first, first + 1, step, SIGMA)).unwrap();
        }
        let mut held = graph.clone();
        Optimizer::default().optimize(&mut held).unwrap();
        assert_eq!((held.poses[0], held.poses[2]), (graph.poses[0], graph.poses[2]));
        assert!(held.cost() < 1e-12);

        let world_from_node = Pose2::new(-1.0, 2.0, -0.3);
        graph.add_prior(PriorFactor { node: 1, world_from_node, information: Matrix3::identity() }).unwrap();
        Optimizer::default().optimize(&mut graph).unwrap();
        assert!(world_from_node.between(&graph.poses[1]).distance() < 1e-6);
        assert!(world_from_node.compose(&step.inverse()).between(&graph.poses[0]).distance() < 1e-6);
        assert_eq!(graph.poses[2], held.poses[2]);
    }

    #[test]
    fn a_manhattan_world_is_straightened_and_its_cost_is_that_of_the_noise() {
        let (mut graph, truth) = manhattan(1500, 20, 1);
        let before = rmse_m(&graph, &truth);
        let report = Optimizer::default().optimize(&mut graph).unwrap();
        let after = rmse_m(&graph, &truth);
        assert!(report.converged && before > 1.0 && after < 0.1, "{report:?}, {before} m, {after} m");
        // 2 · cost is χ² distributed; its degrees of freedom are measurements minus unknowns.
        let freedom = 3.0 * (graph.between.len() as f64 - (graph.poses.len() - 1) as f64);
        let excess = (2.0 * report.final_cost - freedom) / (2.0 * freedom).sqrt();
        assert!(excess.abs() < 4.0, "{excess} standard deviations");
    }

    #[test]
    fn robust_kernels_reject_wrong_closures() {
        for kernel in [
            RobustKernel::Cauchy { scale: 1.0 },
            RobustKernel::GemanMcClure { scale: 3.0 },
            RobustKernel::DynamicCovarianceScaling { phi: 5.0 },
        ] {
            let (mut graph, truth) = manhattan(400, 12, 2);
            Optimizer::default().optimize(&mut graph).unwrap();
            let clean = rmse_m(&graph, &truth);
            for i in 0..8 {
                let wrong = Pose2::new(0.4 * f64::from(i), 1.0, 0.3);
                let factor = between(40 * i as usize, 399 - 20 * i as usize, wrong, SIGMA);
                graph.add_between(factor).unwrap();
            }
            let mut misled = graph.clone();
            Optimizer::default().optimize(&mut misled).unwrap();
            let closures = graph.between.iter_mut().filter(|f| f.to.abs_diff(f.from) > 1);
            closures.for_each(|f| f.kernel = kernel);
            Optimizer::default().optimize(&mut graph).unwrap();
            let robust = rmse_m(&graph, &truth);
            assert!(rmse_m(&misled, &truth) > 1.0 && robust < clean + 0.05, "{kernel:?}: {clean} m, {robust} m");
        }
    }

    #[test]
    fn a_switched_off_factor_says_nothing() {
        let (mut graph, _) = manhattan(300, 12, 3);
        Optimizer::default().optimize(&mut graph).unwrap();
        let mut with_wrong = graph.clone();
        let wrong = with_wrong.add_between(between(10, 250, Pose2::new(9.0, 9.0, 1.0), SIGMA)).unwrap();
        with_wrong.set_weight(wrong, 0.0);
        Optimizer::default().optimize(&mut with_wrong).unwrap();
        assert!(rmse_m(&with_wrong, &graph.poses) < 1e-4);
    }

    #[test]
    fn solving_again_with_a_kept_structure_gives_the_same_bytes() {
        let (graph, _) = manhattan(500, 12, 4);
        let mut optimizer = Optimizer::default();
        let mut first = graph.clone();
        optimizer.optimize(&mut first).unwrap();
        let (mut other, _) = manhattan(100, 12, 5);
        optimizer.optimize(&mut other).unwrap();
        let mut second = graph.clone();
        optimizer.optimize(&mut second).unwrap();
        let mut third = graph.clone();
        optimizer.optimize(&mut third).unwrap();
        assert!(first == second && second == third);
    }

    #[test]
    fn a_node_without_information_is_an_error() {
        let mut graph = PoseGraph::default();
        graph.add_node(Pose2::IDENTITY);
        graph.add_node(Pose2::IDENTITY);
        let nothing = BetweenFactor { information: Matrix3::zeros(), ..between(0, 1, Pose2::IDENTITY, SIGMA) };
        graph.add_between(nothing).unwrap();
        assert_eq!(Optimizer::default().optimize(&mut graph), Err(PoseGraphError::Undetermined));
        assert_eq!(Optimizer::default().optimize(&mut PoseGraph::default()).map(|r| r.converged), Ok(true));
    }
}
