//! The normal equations of a pose graph: H δ = −g with H = Σ JᵀΩJ and g = Σ JᵀΩe.

use super::graph::{PoseGraph, squared_norm};
use crate::geometry::Pose2;
use nalgebra::{Matrix3, Vector3};

/// Which blocks of a symmetric matrix are there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pattern {
    /// Number of unknowns.
    pub(super) unknowns: usize,
    /// Pairs of unknowns (larger, smaller) with a block of their own, sorted.
    pub(super) pairs: Vec<(usize, usize)>,
}

/// Which nodes are unknowns, and which of them share a factor.
///
/// Poses in the world are determined only up to a common motion as long as nothing
/// measures them there. So in each connected part of the graph that has no prior, the
/// first node is held where it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Structure {
    pub(super) pattern: Pattern,
    /// The unknown of each node; `None` for nodes that are held.
    pub(super) unknown_of: Vec<Option<usize>>,
    /// For each relative measurement between two unknowns: the place of its pair in the pattern.
    pair_of: Vec<Option<usize>>,
}

impl Structure {
    pub(super) fn of(graph: &PoseGraph) -> Self {
        let held = held_nodes(graph);
        let mut unknowns = 0;
        let unknown_of: Vec<_> = held
            .iter()
            .map(|held| {
                (!held).then(|| {
                    unknowns += 1;
                    unknowns - 1
                })
            })
            .collect();
        let pair_between = |from: usize, to: usize| {
            let (a, b): (usize, usize) = (unknown_of[from]?, unknown_of[to]?);
            Some((a.max(b), a.min(b)))
        };
        let mut pairs: Vec<_> = graph.between.iter().filter_map(|f| pair_between(f.from, f.to)).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let pair_of = graph
            .between
            .iter()
            .map(|f| pair_between(f.from, f.to).map(|pair| pairs.partition_point(|p| *p < pair)))
            .collect();
        Self { pattern: Pattern { unknowns, pairs }, unknown_of, pair_of }
    }
}

impl PoseGraph {
    /// Whether relative measurements lead from the first node to each.
    #[must_use]
    pub fn tied_to_first(&self) -> Vec<bool> {
        let mut smaller = smaller_nodes(self);
        (0..smaller.len()).map(|node| smallest(&mut smaller, node) == 0).collect()
    }
}

/// For each node a smaller one of its connected part, for the smallest itself.
fn smaller_nodes(graph: &PoseGraph) -> Vec<usize> {
    let mut smaller: Vec<usize> = (0..graph.poses.len()).collect();
    for factor in &graph.between {
        let (a, b) = (smallest(&mut smaller, factor.from), smallest(&mut smaller, factor.to));
        smaller[a.max(b)] = a.min(b);
    }
    smaller
}

/// The first node of each connected part without a prior.
fn held_nodes(graph: &PoseGraph) -> Vec<bool> {
    let mut smaller = smaller_nodes(graph);
    let mut held: Vec<_> = smaller.iter().enumerate().map(|(node, smaller)| node == *smaller).collect();
    for prior in &graph.priors {
        held[smallest(&mut smaller, prior.node)] = false;
    }
    held
}

fn smallest(smaller: &mut [usize], mut node: usize) -> usize {
    while smaller[node] != node {
        // Halving the path keeps later searches short.
        smaller[node] = smaller[smaller[node]];
        node = smaller[node];
    }
    node
}

/// A symmetric matrix of 3×3 blocks with the blocks of a [`Pattern`].
#[derive(Debug, Clone)]
pub(super) struct BlockMatrix {
    /// The block of each unknown with itself.
    pub(super) diagonal: Vec<Matrix3<f64>>,
    /// The block of each pair; rows belong to the larger unknown, columns to the smaller.
    pub(super) pairs: Vec<Matrix3<f64>>,
}

/// H and −g at the graph's current estimates.
pub(super) fn normal_equations(graph: &PoseGraph, structure: &Structure) -> (BlockMatrix, Vec<Vector3<f64>>) {
    let mut matrix = BlockMatrix {
        diagonal: vec![Matrix3::zeros(); structure.pattern.unknowns],
        pairs: vec![Matrix3::zeros(); structure.pattern.pairs.len()],
    };
    let mut right_side = vec![Vector3::zeros(); structure.pattern.unknowns];
    for (factor, pair) in graph.between.iter().zip(&structure.pair_of) {
        let linear = factor.linearize(&graph.poses);
        let robust = factor.kernel.weight(squared_norm(&linear.error, &factor.information));
        let information = factor.information * (factor.weight * robust);
        let (from, to) = (structure.unknown_of[factor.from], structure.unknown_of[factor.to]);
        let to_weighted = linear.by_to.transpose() * information;
        if let Some(to) = to {
            matrix.diagonal[to] += to_weighted * linear.by_to;
            right_side[to] -= to_weighted * linear.error;
        }
        if let Some(from) = from {
            let from_weighted = linear.by_from.transpose() * information;
            matrix.diagonal[from] += from_weighted * linear.by_from;
            right_side[from] -= from_weighted * linear.error;
        }
        if let Some(pair) = pair {
            let block = to_weighted * linear.by_from;
            matrix.pairs[*pair] += if to > from { block } else { block.transpose() };
        }
    }
    for prior in &graph.priors {
        if let Some(node) = structure.unknown_of[prior.node] {
            let error = prior.error(&graph.poses);
            let jacobian = Pose2::right_jacobian_inverse(error.into());
            let weighted = jacobian.transpose() * prior.information;
            matrix.diagonal[node] += weighted * jacobian;
            right_side[node] -= weighted * error;
        }
    }
    (matrix, right_side)
}
