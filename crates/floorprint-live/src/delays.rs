//! How long scans take from their coming in to their pose.

use serde::Serialize;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Scans that are waited for at most: more cannot wait in the inbox and the synchroniser.
const MOST_WAITING: usize = 256;
/// Bounds of the histogram grow by this factor: its percentiles are exact to 10 %.
const STEP: f64 = 1.1;
/// The first bound, seconds; the last is beyond a minute.
const FIRST_S: f64 = 1e-5;
const BOUNDS: usize = 170;

/// Measures delays, in memory that does not grow.
#[derive(Debug, Clone)]
pub struct Delays {
    waiting: VecDeque<(f64, Instant)>,
    histogram: [u64; BOUNDS],
    count: u64,
    longest: Duration,
    newest: Duration,
}

/// What delays amount to, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct DelaySummary {
    /// Half of the scans took less.
    pub median_ms: f64,
    /// 99 of 100 took less.
    pub p99_ms: f64,
    /// None took longer.
    pub longest_ms: f64,
    /// The newest scan's.
    pub newest_ms: f64,
}

impl Default for Delays {
    fn default() -> Self {
        Self {
            waiting: VecDeque::new(),
            histogram: [0; BOUNDS],
            count: 0,
            longest: Duration::ZERO,
            newest: Duration::ZERO,
        }
    }
}

impl Delays {
    /// A scan of this stamp (seconds) came in.
    pub fn begin(&mut self, stamp_s: f64, at: Instant) {
        if self.waiting.len() == MOST_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back((stamp_s, at));
    }

    /// Its pose is known.
    pub fn end(&mut self, stamp_s: f64) {
        let Some(place) = self.waiting.iter().position(|(waiting_s, _)| *waiting_s == stamp_s) else { return };
        let Some((_, at)) = self.waiting.remove(place) else { return };
        self.newest = at.elapsed();
        self.longest = self.longest.max(self.newest);
        let bound = (self.newest.as_secs_f64().max(FIRST_S) / FIRST_S).ln() / STEP.ln();
        self.histogram[(bound.ceil() as usize).min(BOUNDS - 1)] += 1;
        self.count += 1;
    }

    /// What they amount to.
    #[must_use]
    pub fn summary(&self) -> DelaySummary {
        let percentile_ms = |share: f64| {
            let wanted = (share * self.count as f64).ceil() as u64;
            let mut seen = 0;
            let reaches = |count: &u64| {
                seen += count;
                seen >= wanted
            };
            let bound = self.histogram.iter().position(reaches).unwrap_or(0);
            1e3 * FIRST_S * STEP.powi(bound as i32)
        };
        let in_ms = |duration: Duration| 1e3 * duration.as_secs_f64();
        if self.count == 0 {
            return DelaySummary::default();
        }
        DelaySummary {
            median_ms: percentile_ms(0.5),
            p99_ms: percentile_ms(0.99),
            longest_ms: in_ms(self.longest),
            newest_ms: in_ms(self.newest),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_near_what_was_measured() {
        let mut delays = Delays::default();
        assert_eq!(delays.summary(), DelaySummary::default());
        let now = Instant::now();
        for scan in 0..200_u32 {
            let ago = Duration::from_millis(if scan < 190 { 2000 } else { 8000 });
            delays.begin(f64::from(scan), now.checked_sub(ago).unwrap_or(now));
            delays.end(f64::from(scan));
        }
        delays.end(1e9);
        let DelaySummary { median_ms, p99_ms, longest_ms, .. } = delays.summary();
        assert!((1900.0..2400.0).contains(&median_ms), "{median_ms}");
        assert!((7600.0..9600.0).contains(&p99_ms), "{p99_ms}");
        assert!(longest_ms >= 8000.0);
        assert!(delays.waiting.is_empty());
    }
}
