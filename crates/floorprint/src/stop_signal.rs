//! Asks long work to end early.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks long work to end early, from any thread. What was computed until then counts.
///
/// Clones are the same signal.
#[derive(Debug, Clone, Default)]
pub struct StopSignal(Arc<AtomicBool>);

impl StopSignal {
    /// Gives the signal; tells whether it had been given before.
    pub fn give(&self) -> bool {
        self.0.swap(true, Ordering::Relaxed)
    }

    /// Whether it was given.
    #[must_use]
    pub fn is_given(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
