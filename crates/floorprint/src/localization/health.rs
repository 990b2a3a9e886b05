//! How probable it is that a robot whose pose is claimed is lost: scan by scan, from what the map explains.
//!
//! A hidden Markov model of two states, tracked and lost. How much of a scan the map explains while all is well, and how
//! that varies, is learnt on the way: in a map that is years old it is less than in a new one. People who stand in front
//! say nothing either way.
//!
//! A robot that was tracked and whose scans follow from each other was not kidnapped; it can have drifted off, but not within
//! a step. What it sees then tells of the map as much as of the pose, and the same for as long as it stays: evidence against
//! the pose counts by the metre, not by the second.

use super::sensing::Explanation;

/// The log-odds of being lost.
#[derive(Debug, Clone)]
pub(super) struct Health {
    log_odds: f64,
    /// Mean and variance of the share that is explained while all is well; `None` before the first scan.
    usual: Option<[f64; 2]>,
    /// Whether scans have ceased to follow from each other since all was well.
    is_torn: bool,
}

/// Standard deviation of the share while nothing is known of it, and the least and the most that is believed of it.
const FIRST_SIGMA: f64 = 0.2;
const SIGMA_BOUNDS: [f64; 2] = [0.04, 0.3];
/// What is usual is never taken to be less than this: as much fits anywhere by chance.
const LEAST_USUAL: f64 = 0.45;
/// A quarter of a second of scans says something once: as much for being tracked, and for being lost, at most.
/// While scans follow from each other half a metre of drive says it once.
const PERIOD_S: f64 = 0.25;
const PERIOD_M: f64 = 0.5;
const MOST_TRACKED: f64 = -1.5;
const MOST_LOST: f64 = 1.5;
/// The log-odds stay within these.
const BOUNDS: [f64; 2] = [-8.0, 8.0];
/// What is usual is learnt over this drive, metres: a robot that stands still sees the same place again and again. Where
/// more is explained than usual that is learnt over this time, too, seconds.
const USUAL_M: f64 = 10.0;
const USUAL_S: f64 = 15.0;
/// The newest scan counts no more than this.
const MOST_NEWEST: f64 = 0.1;
/// Where people hide more than this share of the rays nothing can be said.
const LEAST_IN_VIEW: f64 = 0.25;
/// Log-odds at which other places are looked for, and at which all is well.
const SUSPICIOUS: f64 = -3.0;
const WELL: f64 = -6.0;

impl Health {
    /// As sure as it was found.
    pub(super) fn new(lost_probability: f64) -> Self {
        let odds = lost_probability.clamp(1e-6, 1.0 - 1e-6);
        Self { log_odds: (odds / (1.0 - odds)).ln().clamp(BOUNDS[0], BOUNDS[1]), usual: None, is_torn: true }
    }

    /// Takes in what of a scan was explained, `elapsed_s` and `moved_m` after the one before, and whether it follows from
    /// those before.
    pub(super) fn observe(&mut self, explanation: &Explanation, elapsed_s: f64, moved_m: f64, follows: bool) {
        self.is_torn |= !follows;
        let in_view = 1.0 - explanation.in_front - explanation.in_unknown;
        if in_view < LEAST_IN_VIEW {
            return;
        }
        let explained = explanation.on_map / in_view;
        let [mean, variance] = self.usual.unwrap_or([explained.max(LEAST_USUAL), FIRST_SIGMA * FIRST_SIGMA]);
        let sigma = variance.sqrt().clamp(SIGMA_BOUNDS[0], SIGMA_BOUNDS[1]);
        let below = ((mean.max(LEAST_USUAL) - explained) / sigma).max(0.0);
        // Against a share that may be anything from 0 to 1.
        let log_odds =
            (0.5 * below * below + (sigma * std::f64::consts::TAU.sqrt()).ln()).clamp(MOST_TRACKED, MOST_LOST);
        let mut share = (elapsed_s / PERIOD_S).clamp(0.0, 1.0);
        if log_odds > 0.0 && !self.is_torn {
            share = share.min(moved_m / PERIOD_M);
        }
        self.log_odds = (self.log_odds + share * log_odds).clamp(BOUNDS[0], BOUNDS[1]);
        self.is_torn &= !self.is_well();
        if self.usual.is_none() || self.log_odds < SUSPICIOUS {
            let of_drive = (moved_m / USUAL_M).clamp(0.0, MOST_NEWEST);
            let off = explained - mean;
            let newest = if off > 0.0 { of_drive.max((elapsed_s / USUAL_S).clamp(0.0, MOST_NEWEST)) } else { of_drive };
            self.usual = Some([mean + newest * off, variance + of_drive * (off * off - variance)]);
        }
    }

    /// How probable it is that the robot is lost.
    pub(super) fn lost_probability(&self) -> f64 {
        1.0 / (1.0 + (-self.log_odds).exp())
    }

    /// Whether the newest scans are worth a look at other places.
    pub(super) fn is_suspicious(&self) -> bool {
        self.usual.is_some() && self.log_odds > SUSPICIOUS
    }

    /// Whether all is well.
    pub(super) fn is_well(&self) -> bool {
        self.log_odds < WELL
    }
}
