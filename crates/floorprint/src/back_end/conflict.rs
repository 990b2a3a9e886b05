//! Closures that cannot all be true.

use super::hypothesis::CONFLICT;
use crate::pose_graph::{Optimizer, PoseGraph, RobustKernel};

/// Steps from trusting all factors to doubting those that do not fit.
const GRADUATION_STAGES: i32 = 8;

/// Solves a graph in which some factors must be wrong, closures or links of the chain, without
/// knowing which: graduated non-convexity (Yang et al. 2020). At first all factors pull, then
/// those that the others contradict lose their say. Factors keep their kernels afterwards.
pub(super) fn resolve_conflict(graph: &mut PoseGraph, optimizer: &mut Optimizer) {
    let count = graph.between_factors().len();
    let mut loosened = graph.clone();
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
    let mut resolved = graph.clone();
    resolved.poses_mut().copy_from_slice(loosened.poses());
    let _ = optimizer.optimize(&mut resolved);
    if resolved.cost() < graph.cost() {
        *graph = resolved;
    }
}
