//! A token bucket: so much a second in the long run, and so much at once.

use std::time::Instant;

/// Lets so many requests through a second.
#[derive(Debug)]
pub(crate) struct Bucket {
    per_s: f64,
    at_once: f64,
    left: f64,
    at: Instant,
}

impl Bucket {
    /// A full one.
    pub(crate) fn new(per_s: f64, at_once: f64) -> Self {
        Self { per_s, at_once, left: at_once, at: Instant::now() }
    }

    /// Whether one more may pass.
    pub(crate) fn take(&mut self) -> bool {
        let now = Instant::now();
        let came = now.duration_since(self.at).as_secs_f64() * self.per_s;
        (self.left, self.at) = ((self.left + came).min(self.at_once), now);
        let is_enough = self.left >= 1.0;
        self.left -= if is_enough { 1.0 } else { 0.0 };
        is_enough
    }
}
