//! Pose graphs: poses tied together by relative measurements, and their best estimate.

mod block_cholesky;
mod config;
mod graph;
mod linear_system;
mod marginals;
mod optimizer;
mod robust_kernel;

pub use config::OptimizerConfig;
pub use graph::{BetweenFactor, PoseGraph, PoseGraphError, PriorFactor};
pub use marginals::Marginals;
pub use optimizer::{OptimizationReport, Optimizer};
pub use robust_kernel::RobustKernel;
