//! How fast scans usually follow each other: those of a drive, or of one LiDAR.

use serde::{Deserialize, Serialize};

/// The usual time from one scan to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Pace {
    /// Seconds; 0 as long as nothing is known.
    usual_s: f64,
}

/// Share of the newest interval in the usual one.
const NEWEST: f64 = 0.1;
/// Scans are missing when so many of the usual intervals have passed.
const GAP_STEPS: f64 = 4.0;

impl Pace {
    /// The usual time from one scan to the next, seconds; 0 as long as nothing is known.
    pub(crate) fn usual_s(&self) -> f64 {
        self.usual_s
    }

    /// For how many scans of the usual pace the time since the last one would do; learns from it. It is 0 where the
    /// stamps say that no time has passed.
    pub(crate) fn steps(&mut self, elapsed_s: f64) -> f64 {
        if elapsed_s <= 0.0 {
            return 0.0;
        }
        if self.usual_s == 0.0 {
            self.usual_s = elapsed_s;
        }
        let steps = elapsed_s / self.usual_s;
        // A gap says nothing about the pace, unless it is the pace.
        self.usual_s += NEWEST * (steps.min(GAP_STEPS) * self.usual_s - self.usual_s);
        steps
    }
}

/// Whether scans are missing from a time in which so many would have come.
pub(crate) fn is_gap(steps: f64) -> bool {
    steps > GAP_STEPS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_told_from_a_slow_pace() {
        let mut pace = Pace::default();
        assert!((0..50).all(|_| !is_gap(pace.steps(0.1))));
        let after = pace.steps(5.0);
        assert!(is_gap(after) && after > 40.0, "{after}");
        let slow = (0..60).map(|_| pace.steps(2.0)).last().unwrap();
        assert!(!is_gap(slow), "{slow}");
        assert_eq!([0.0, -1.0].map(|elapsed_s| pace.steps(elapsed_s)), [0.0; 2]);
    }
}
