//! Options of the pose graph's optimiser.

/// When the optimiser stops, and how carefully it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct OptimizerConfig {
    /// Most steps that are taken.
    pub max_iterations: usize,
    /// Done when a step lowers the cost by less than this share of it.
    pub relative_decrease: f64,
    /// Levenberg–Marquardt's damping of the first step, relative to the diagonal of the
    /// normal matrix; 0 makes it a Gauss–Newton step.
    pub initial_damping: f64,
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        Self { max_iterations: 50, relative_decrease: 1e-6, initial_damping: 1e-6 }
    }
}
