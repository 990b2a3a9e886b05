//! How uncertain the poses of an optimised graph are: blocks of the inverse of the
//! normal matrix (Kaess & Dellaert 2009, "Covariance recovery from a square root information matrix").

use super::block_cholesky::{CholeskyFactor, SymbolicCholesky};
use super::linear_system::{Structure, normal_equations};
use super::{PoseGraph, PoseGraphError};
use nalgebra::{Matrix3, Vector3};

/// Covariances of poses at a graph's current estimates.
///
/// Covariances are in the tangent space (x, y, θ) of the pose's own frame, metres and radians.
#[derive(Debug, Clone)]
pub struct Marginals<'a> {
    graph: &'a PoseGraph,
    structure: Structure,
    symbolic: SymbolicCholesky,
    factor: CholeskyFactor,
}

impl<'a> Marginals<'a> {
    /// Factorises the normal matrix at the graph's current estimates.
    ///
    /// # Errors
    /// [`PoseGraphError::Undetermined`] when factors do not determine all poses.
    pub fn new(graph: &'a PoseGraph) -> Result<Self, PoseGraphError> {
        let structure = Structure::of(graph);
        let symbolic = SymbolicCholesky::new(&structure.pattern)?;
        let (matrix, _) = normal_equations(graph, &structure);
        let factor = symbolic.factorize(&matrix).ok_or(PoseGraphError::Undetermined)?;
        Ok(Self { graph, structure, symbolic, factor })
    }

    /// Covariance of a node's pose in the world; zero for a node that is held.
    ///
    /// # Panics
    /// When there is no such node.
    #[must_use]
    pub fn covariance(&self, node: usize) -> Matrix3<f64> {
        self.block(&self.columns(node), node)
    }

    /// Covariance of each node's pose in the world, as [`covariance`](Self::covariance) has it, in the time of the factorisation.
    #[must_use]
    pub fn covariances(&self) -> Vec<Matrix3<f64>> {
        let blocks = self.symbolic.inverse_diagonal(&self.factor);
        let of_node = |unknown: &Option<usize>| unknown.map_or(Matrix3::zeros(), |unknown| blocks[unknown]);
        self.structure.unknown_of.iter().map(of_node).collect()
    }

    /// Covariance of the pose of `to` seen from `from`: how far a measurement between
    /// the two may be from what the graph says.
    ///
    /// # Panics
    /// When there is no such node.
    #[must_use]
    pub fn relative_covariance(&self, from: usize, to: usize) -> Matrix3<f64> {
        let (by_from, by_to) = (self.columns(from), self.columns(to));
        let cross = self.block(&by_from, to);
        // With x = x_from⁻¹ ∘ x_to: δ_x = δ_to − Ad(x⁻¹) δ_from.
        let from_from_to = self.graph.poses[from].between(&self.graph.poses[to]);
        let adjoint = from_from_to.inverse().adjoint();
        let crossed = cross * adjoint.transpose();
        self.block(&by_to, to) + adjoint * self.block(&by_from, from) * adjoint.transpose()
            - crossed
            - crossed.transpose()
    }

    /// The three columns of the inverse that belong to a node; `None` when it is held.
    fn columns(&self, node: usize) -> Option<[Vec<Vector3<f64>>; 3]> {
        let unknown = self.structure.unknown_of[node]?;
        Some([Vector3::x(), Vector3::y(), Vector3::z()].map(|unit| {
            let mut right_side = vec![Vector3::zeros(); self.structure.pattern.unknowns];
            right_side[unknown] = unit;
            self.symbolic.solve(&self.factor, &right_side)
        }))
    }

    /// The rows of such columns that belong to `node`.
    fn block(&self, columns: &Option<[Vec<Vector3<f64>>; 3]>, node: usize) -> Matrix3<f64> {
        match (columns, self.structure.unknown_of[node]) {
            (Some([x, y, theta]), Some(row)) => Matrix3::from_columns(&[x[row], y[row], theta[row]]),
            _ => Matrix3::zeros(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BetweenFactor, Optimizer, RobustKernel};
    use super::*;
    use crate::geometry::Pose2;

    fn chain(closed: bool) -> PoseGraph {
        let step = Pose2::new(1.0, 0.1, 0.6);
        let mut graph = PoseGraph::default();
        let mut pose = Pose2::new(3.0, -2.0, 1.0);
        for _ in 0..10 {
            graph.add_node(pose);
            pose = pose.compose(&step);
        }
        for node in 1..10 {
            graph.add_between(factor(node - 1, node, step)).unwrap();
        }
        if closed {
            let measured = graph.poses[9].between(&graph.poses[0]);
            graph.add_between(factor(9, 0, measured)).unwrap();
        }
        graph
    }

    fn factor(from: usize, to: usize, from_from_to: Pose2) -> BetweenFactor {
        let information = Matrix3::new(400.0, 30.0, 0.0, 30.0, 900.0, 5.0, 0.0, 5.0, 2500.0);
        BetweenFactor { from, to, from_from_to, information, kernel: RobustKernel::Quadratic, weight: 1.0 }
    }

    #[test]
    fn along_a_chain_covariance_is_that_of_the_measurements_compounded() {
        let graph = chain(false);
        let marginals = Marginals::new(&graph).unwrap();
        assert_eq!(marginals.covariance(0), Matrix3::zeros());
        let one = graph.between[0].information.try_inverse().unwrap();
        let mut compounded = Matrix3::zeros();
        for node in 1..10 {
            let adjoint = graph.between[node - 1].from_from_to.inverse().adjoint();
            compounded = adjoint * compounded * adjoint.transpose() + one;
            assert!((marginals.covariance(node) - compounded).amax() < 1e-12);
            assert!((marginals.relative_covariance(node - 1, node) - one).amax() < 1e-12);
            assert!((marginals.relative_covariance(0, node) - compounded).amax() < 1e-12);
        }
    }

    #[test]
    fn the_relative_covariance_does_not_depend_on_which_node_is_held() {
        let graph = chain(true);
        let mut reversed = PoseGraph { poses: graph.poses.iter().rev().copied().collect(), ..PoseGraph::default() };
        for f in graph.between_factors() {
            reversed.add_between(BetweenFactor { from: 9 - f.from, to: 9 - f.to, ..f.clone() }).unwrap();
        }
        let (marginals, of_reversed) = (Marginals::new(&graph).unwrap(), Marginals::new(&reversed).unwrap());
        for (from, to) in [(0, 9), (3, 7), (8, 2)] {
            let difference =
                marginals.relative_covariance(from, to) - of_reversed.relative_covariance(9 - from, 9 - to);
            assert!(difference.amax() < 1e-12, "{difference}");
        }
    }

    #[test]
    fn a_closure_makes_every_pose_more_certain() {
        let (open, mut closed) = (chain(false), chain(true));
        Optimizer::default().optimize(&mut closed).unwrap();
        let (open, closed) = (Marginals::new(&open).unwrap(), Marginals::new(&closed).unwrap());
        for node in 1..10 {
            assert!(closed.covariance(node).trace() < open.covariance(node).trace());
        }
        for marginals in [&open, &closed] {
            for (node, covariance) in marginals.covariances().iter().enumerate() {
                assert!((covariance - marginals.covariance(node)).amax() < 1e-12, "{node}: {covariance}");
            }
        }
    }
}
