//! A graph of poses tied together by measurements (Lu & Milios 1997; Grisetti et al. 2010).

use super::RobustKernel;
use crate::geometry::Pose2;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A measured pose of one node in the frame of another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BetweenFactor {
    /// The node in whose frame was measured.
    pub from: usize,
    /// The node that was measured.
    pub to: usize,
    /// The measurement: the pose of `to` in the frame of `from`.
    pub from_from_to: Pose2,
    /// Inverse covariance of the measurement, in the tangent space (x, y, θ) of the frame of `to`;
    /// metres and radians.
    pub information: Matrix3<f64>,
    /// How a bad fit is judged.
    pub kernel: RobustKernel,
    /// Multiplies the information: 1 for a trusted factor, 0 for one that is switched off.
    /// For schemes that reweight factors from outside, as graduated non-convexity does.
    pub weight: f64,
}

/// A measured pose of a node in the world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PriorFactor {
    /// The node that was measured.
    pub node: usize,
    /// The measurement.
    pub world_from_node: Pose2,
    /// Inverse covariance of the measurement, in the tangent space (x, y, θ) of the node's frame;
    /// metres and radians.
    pub information: Matrix3<f64>,
}

/// Why a factor cannot be used, or a graph not be solved.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PoseGraphError {
    /// A factor names a node that is not there.
    #[error("a factor names node {node}, but the graph has {nodes} nodes; add the node first")]
    UnknownNode {
        /// The node named.
        node: usize,
        /// Nodes of the graph.
        nodes: usize,
    },
    /// A factor ties a node to itself.
    #[error("a factor ties node {node} to itself; it says nothing about any pose")]
    SelfLoop {
        /// The node.
        node: usize,
    },
    /// A number of a factor is not usable.
    #[error("the factor on node {node} holds {what}")]
    BadFactor {
        /// The last node that the factor names.
        node: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// The normal equations have no unique solution.
    #[error("the graph does not determine all poses: some node is tied only by factors without information")]
    Undetermined,
    /// The graph is beyond what can be indexed.
    #[error("a graph of {nodes} nodes is too large to be solved at once")]
    TooLarge {
        /// Unknown poses.
        nodes: usize,
    },
}

/// Squares and products of larger numbers might overflow.
const LARGEST: f64 = 1e30;

/// How far an information matrix may be off by rounding, as a share of its largest entry.
const ROUNDING: f64 = 1e-9;

/// Nodes with their current estimates, and the factors between them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseGraph {
    pub(super) poses: Vec<Pose2>,
    pub(super) between: Vec<BetweenFactor>,
    pub(super) priors: Vec<PriorFactor>,
}

impl PoseGraph {
    /// Adds a node with its first estimate and returns its number.
    pub fn add_node(&mut self, world_from_node: Pose2) -> usize {
        self.poses.push(world_from_node);
        self.poses.len() - 1
    }

    /// Adds a relative measurement and returns its number.
    ///
    /// # Errors
    /// When it names a node that is not there or the same node twice, or holds unusable numbers.
    pub fn add_between(&mut self, factor: BetweenFactor) -> Result<usize, PoseGraphError> {
        self.check(factor.from, &factor.from_from_to, &factor.information)?;
        self.check(factor.to, &factor.from_from_to, &factor.information)?;
        if factor.from == factor.to {
            return Err(PoseGraphError::SelfLoop { node: factor.to });
        }
        if !(factor.weight >= 0.0 && factor.weight.is_finite()) {
            return Err(PoseGraphError::BadFactor { node: factor.to, what: "a weight that is negative or not finite" });
        }
        self.between.push(factor);
        Ok(self.between.len() - 1)
    }

    /// Adds a measurement in the world and returns its number.
    ///
    /// # Errors
    /// When it names a node that is not there, or holds unusable numbers.
    pub fn add_prior(&mut self, factor: PriorFactor) -> Result<usize, PoseGraphError> {
        self.check(factor.node, &factor.world_from_node, &factor.information)?;
        self.priors.push(factor);
        Ok(self.priors.len() - 1)
    }

    /// Whether it could have been built by adding its nodes and factors: what comes from a file need not be so.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let mut built = Self { poses: self.poses.clone(), ..Self::default() };
        self.poses.iter().all(Pose2::is_finite)
            && self.between.iter().all(|factor| built.add_between(factor.clone()).is_ok())
            && self.priors.iter().all(|factor| built.add_prior(factor.clone()).is_ok())
    }

    fn check(&self, node: usize, measurement: &Pose2, information: &Matrix3<f64>) -> Result<(), PoseGraphError> {
        if node >= self.poses.len() {
            return Err(PoseGraphError::UnknownNode { node, nodes: self.poses.len() });
        }
        let Pose2 { x, y, theta } = *measurement;
        let what = if ![x, y, theta].iter().all(|value| value.abs() <= LARGEST) {
            "a measurement that is not finite or beyond 1e30"
        } else if !information.iter().all(|value| value.abs() <= LARGEST) {
            "an information matrix that is not finite or beyond 1e30"
        } else if (information - information.transpose()).amax() > ROUNDING * information.amax() {
            "an information matrix that is not symmetric"
        } else if !is_semidefinite(information) {
            "an information matrix with a negative eigenvalue"
        } else {
            return Ok(());
        };
        Err(PoseGraphError::BadFactor { node, what })
    }

    /// The current estimates, by node.
    #[must_use]
    pub fn poses(&self) -> &[Pose2] {
        &self.poses
    }

    /// The current estimates, to be changed from outside.
    pub fn poses_mut(&mut self) -> &mut [Pose2] {
        &mut self.poses
    }

    /// The relative measurements, in the order in which they were added.
    #[must_use]
    pub fn between_factors(&self) -> &[BetweenFactor] {
        &self.between
    }

    /// The measurements in the world, in the order in which they were added.
    #[must_use]
    pub fn prior_factors(&self) -> &[PriorFactor] {
        &self.priors
    }

    /// Sets the weight of a relative measurement, at least 0.
    ///
    /// # Panics
    /// When there is no such measurement.
    pub fn set_weight(&mut self, between_factor: usize, weight: f64) {
        self.between[between_factor].weight = weight;
    }

    /// Sets how certain a relative measurement is.
    ///
    /// # Panics
    /// When there is no such measurement.
    pub fn set_information(&mut self, between_factor: usize, information: Matrix3<f64>) {
        self.between[between_factor].information = information;
    }

    /// Sets how a bad fit of a relative measurement is judged.
    ///
    /// # Panics
    /// When there is no such measurement.
    pub fn set_kernel(&mut self, between_factor: usize, kernel: RobustKernel) {
        self.between[between_factor].kernel = kernel;
    }

    /// Takes a relative measurement out; the numbers of later ones drop by one.
    ///
    /// # Panics
    /// When there is no such measurement.
    pub fn remove_between(&mut self, between_factor: usize) -> BetweenFactor {
        self.between.remove(between_factor)
    }

    /// Takes a node out with all that was measured of it or from it; the numbers of later nodes drop by one. Gives the
    /// new number of each of the old relative measurements.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn remove_node(&mut self, node: usize) -> Vec<Option<usize>> {
        self.poses.remove(node);
        let mut kept = 0;
        let mut number = |factor: &BetweenFactor| {
            (factor.from != node && factor.to != node).then(|| {
                kept += 1;
                kept - 1
            })
        };
        let numbers = self.between.iter().map(&mut number).collect();
        self.between.retain(|factor| factor.from != node && factor.to != node);
        self.priors.retain(|factor| factor.node != node);
        let between = self.between.iter_mut().flat_map(|factor| [&mut factor.from, &mut factor.to]);
        for named in between.chain(self.priors.iter_mut().map(|factor| &mut factor.node)) {
            *named -= usize::from(*named > node);
        }
        numbers
    }

    /// Squared Mahalanobis error of a relative measurement at the current estimates,
    /// without its weight and kernel: what a χ² test with three degrees of freedom takes.
    ///
    /// # Panics
    /// When there is no such measurement.
    #[must_use]
    pub fn squared_error(&self, between_factor: usize) -> f64 {
        let factor = &self.between[between_factor];
        squared_norm(&factor.error(&self.poses), &factor.information)
    }

    /// Half the sum of all factors' weighted, robust squared errors.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.cost_at(&self.poses)
    }

    pub(super) fn cost_at(&self, poses: &[Pose2]) -> f64 {
        let between: f64 =
            self.between.iter().map(|f| f.weight * f.kernel.cost(squared_norm(&f.error(poses), &f.information))).sum();
        let priors: f64 = self.priors.iter().map(|f| squared_norm(&f.error(poses), &f.information)).sum();
        0.5 * (between + priors)
    }
}

/// Whether no eigenvalue of a symmetric matrix is negative, up to rounding.
fn is_semidefinite(matrix: &Matrix3<f64>) -> bool {
    let largest = matrix.amax();
    largest == 0.0 || (matrix / largest + Matrix3::identity() * ROUNDING).cholesky().is_some()
}

pub(super) fn squared_norm(error: &Vector3<f64>, information: &Matrix3<f64>) -> f64 {
    (information * error).dot(error)
}

/// A factor's error with its derivatives by right perturbations x ∘ exp(δ) of its nodes.
pub(super) struct LinearizedBetween {
    pub(super) error: Vector3<f64>,
    pub(super) by_from: Matrix3<f64>,
    pub(super) by_to: Matrix3<f64>,
}

impl BetweenFactor {
    /// log(z⁻¹ ∘ x_from⁻¹ ∘ x_to).
    pub(super) fn error(&self, poses: &[Pose2]) -> Vector3<f64> {
        let from_from_to = poses[self.from].between(&poses[self.to]);
        self.from_from_to.between(&from_from_to).log().into()
    }

    /// With e = log(z⁻¹ ∘ x): ∂e/∂δ_to = J_r⁻¹(e) and ∂e/∂δ_from = −J_r⁻¹(e) Ad(x⁻¹),
    /// where x is the estimated pose of `to` in `from` (Solà et al. 2018, eqs. 68–83).
    pub(super) fn linearize(&self, poses: &[Pose2]) -> LinearizedBetween {
        let from_from_to = poses[self.from].between(&poses[self.to]);
        let error = self.from_from_to.between(&from_from_to).log();
        let by_to = Pose2::right_jacobian_inverse(error);
        let by_from = -by_to * from_from_to.inverse().adjoint();
        LinearizedBetween { error: error.into(), by_from, by_to }
    }
}

impl PriorFactor {
    /// log(z⁻¹ ∘ x).
    pub(super) fn error(&self, poses: &[Pose2]) -> Vector3<f64> {
        self.world_from_node.between(&poses[self.node]).log().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn factor(from: usize, to: usize) -> BetweenFactor {
        BetweenFactor {
            from,
            to,
            from_from_to: Pose2::new(1.0, 0.2, 0.3),
            information: Matrix3::identity(),
            kernel: RobustKernel::Quadratic,
            weight: 1.0,
        }
    }

    #[test]
    fn unusable_factors_are_refused_with_a_reason() {
        let mut graph = PoseGraph::default();
        graph.add_node(Pose2::IDENTITY);
        graph.add_node(Pose2::IDENTITY);
        assert_eq!(graph.add_between(factor(0, 2)), Err(PoseGraphError::UnknownNode { node: 2, nodes: 2 }));
        assert_eq!(graph.add_between(factor(1, 1)), Err(PoseGraphError::SelfLoop { node: 1 }));
        let mut asymmetric = factor(0, 1);
        asymmetric.information[(0, 1)] = 0.5;
        assert!(graph.add_between(asymmetric).unwrap_err().to_string().contains("not symmetric"));
        let not_finite = BetweenFactor { from_from_to: Pose2 { x: f64::NAN, ..Pose2::IDENTITY }, ..factor(0, 1) };
        assert!(graph.add_between(not_finite).unwrap_err().to_string().contains("not finite"));
        for indefinite in
            [[[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [[1.0, 5.0, 0.0], [5.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]
        {
            let indefinite = BetweenFactor { information: indefinite.into(), ..factor(0, 1) };
            assert!(graph.add_between(indefinite).unwrap_err().to_string().contains("negative eigenvalue"));
        }
        let huge = BetweenFactor { information: Matrix3::identity() * 1e300, ..factor(0, 1) };
        assert!(graph.add_between(huge).unwrap_err().to_string().contains("1e30"));
        // Nothing is known in one direction, and rounding leaves a little less than that.
        let corridor = Matrix3::from_diagonal(&[1e6, -1e-6, 1e8].into());
        assert!(graph.clone().add_between(BetweenFactor { information: corridor, ..factor(0, 1) }).is_ok());
        let negative = BetweenFactor { weight: -1.0, ..factor(0, 1) };
        assert!(graph.add_between(negative).unwrap_err().to_string().contains("negative"));
        assert_eq!(graph.add_between(factor(0, 1)), Ok(0));
    }

    #[test]
    fn a_node_leaves_with_its_factors() {
        let mut graph = PoseGraph::default();
        let poses = [0.0, 1.0, 2.0, 3.0].map(|x| Pose2::new(x, 0.0, 0.0));
        for pose in poses {
            graph.add_node(pose);
        }
        for (from, to) in [(0, 1), (1, 2), (0, 2), (2, 3), (0, 3)] {
            graph.add_between(factor(from, to)).unwrap();
        }
        for (node, pose) in poses.iter().enumerate() {
            let information = Matrix3::identity();
            graph.add_prior(PriorFactor { node, world_from_node: *pose, information }).unwrap();
        }
        assert_eq!(graph.remove_node(1), [None, None, Some(0), Some(1), Some(2)]);
        assert_eq!(graph.poses(), [poses[0], poses[2], poses[3]]);
        let ends: Vec<_> = graph.between_factors().iter().map(|factor| (factor.from, factor.to)).collect();
        assert_eq!(ends, [(0, 1), (1, 2), (0, 2)]);
        assert!(graph.prior_factors().iter().all(|prior| graph.poses()[prior.node] == prior.world_from_node));
    }

    fn pose() -> impl Strategy<Value = Pose2> {
        (-5.0..5.0_f64, -5.0..5.0_f64, -3.1..3.1_f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_differences(from in pose(), to in pose(), error in pose()) {
            // The error's heading stays off ±π, where the logarithm jumps.
            let error = Pose2::new(error.x, error.y, error.theta * 0.9);
            let factor = BetweenFactor { from_from_to: from.between(&to).compose(&error), ..factor(0, 1) };
            let linear = factor.linearize(&[from, to]);
            prop_assert_eq!(linear.error, factor.error(&[from, to]));
            let step = 1e-5;
            for column in 0..3 {
                let moved = |pose: &Pose2, sign: f64| {
                    let mut delta = [0.0; 3];
                    delta[column] = sign * step;
                    pose.compose(&Pose2::exp(delta))
                };
                let by_from = factor.error(&[moved(&from, 1.0), to]) - factor.error(&[moved(&from, -1.0), to]);
                let by_to = factor.error(&[from, moved(&to, 1.0)]) - factor.error(&[from, moved(&to, -1.0)]);
                prop_assert!((by_from / (2.0 * step) - linear.by_from.column(column)).amax() < 1e-6);
                prop_assert!((by_to / (2.0 * step) - linear.by_to.column(column)).amax() < 1e-6);
            }
        }
    }
}
