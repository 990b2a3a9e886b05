//! Who of several publishers of one topic is listened to.

use std::time::{Duration, Instant};

/// A publisher that says nothing for so long has gone, and another one may take its place.
const SILENCE: Duration = Duration::from_secs(2);

/// The first publisher, until it falls silent. Two at a time cannot be told apart by what they say: odometry of both would
/// jump to and fro, and scans of both seem to come from one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolePublisher<P> {
    heard: Option<(P, Instant)>,
}

impl<P: Copy + PartialEq> SolePublisher<P> {
    /// Nobody was heard yet.
    pub(super) fn new() -> Self {
        Self { heard: None }
    }

    /// Whether what a publisher says now is to be listened to.
    pub(super) fn admits(&mut self, publisher: P, now: Instant) -> bool {
        let is_other = |(first, at): (P, Instant)| first != publisher && now.saturating_duration_since(at) < SILENCE;
        if self.heard.is_some_and(is_other) {
            return false;
        }
        self.heard = Some((publisher, now));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_one_counts_until_it_is_silent() {
        let mut sole = SolePublisher::new();
        let start = Instant::now();
        let mut admits = |publisher, after_ms| sole.admits(publisher, start + Duration::from_millis(after_ms));
        assert!(admits('a', 0) && !admits('b', 10) && admits('a', 1000) && !admits('b', 2900));
        // A driver that was started anew has another number.
        assert!(admits('b', 3100) && !admits('a', 3200) && admits('b', 4000));
    }
}
