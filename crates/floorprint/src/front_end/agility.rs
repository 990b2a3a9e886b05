//! What the robot cannot have done: how fast it has been seen to move.
//!
//! A scan that fits nowhere near is searched for around the robot, and much looks alike. A robot that nobody carries is not
//! somewhere else a moment later.

use crate::geometry::Pose2;
use serde::{Deserialize, Serialize};

/// The fastest motion that scans and odometry agreed on.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Agility {
    fastest_m_s: f64,
    fastest_rad_s: f64,
}

/// The fastest was not the fastest possible: a robot may be so many times as fast …
const FASTER: f64 = 2.0;
/// … and by so much, also one that has only crept so far; metres and radians a second.
const FASTER_M_S: f64 = 1.0;
const FASTER_RAD_S: f64 = 1.0;
/// Scans are matched, and stamped, with errors: metres and radians.
const SLACK_M: f64 = 0.1;
const SLACK_RAD: f64 = 0.1;

impl Agility {
    /// Learns from a motion that took so long, seconds.
    pub(super) fn learn(&mut self, motion: &Pose2, elapsed_s: f64) {
        if elapsed_s > 0.0 {
            self.fastest_m_s = self.fastest_m_s.max(motion.distance() / elapsed_s);
            self.fastest_rad_s = self.fastest_rad_s.max(motion.theta.abs() / elapsed_s);
        }
    }

    /// Whether the robot may have moved so in so long a time, seconds. Of a time that did not pass nothing is known.
    pub(super) fn allows(&self, motion: &Pose2, elapsed_s: f64) -> bool {
        elapsed_s <= 0.0
            || motion.distance() <= SLACK_M + (FASTER * self.fastest_m_s + FASTER_M_S) * elapsed_s
                && motion.theta.abs() <= SLACK_RAD + (FASTER * self.fastest_rad_s + FASTER_RAD_S) * elapsed_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_drives_does_not_leap_and_who_is_fast_may_be_faster() {
        let mut agility = Agility::default();
        let leaps = [Pose2::new(0.9, 0.0, 0.0), Pose2::new(0.0, 0.0, 1.5)];
        assert!(leaps.iter().all(|leap| !agility.allows(leap, 0.1) && agility.allows(leap, 2.0)));
        assert!(leaps.iter().all(|leap| agility.allows(leap, 0.0)), "stamps that stand still tell nothing");
        agility.learn(&Pose2::new(0.4, 0.0, 0.7), 0.1);
        agility.learn(&Pose2::new(9.0, 0.0, 3.0), 0.0);
        assert!(leaps.iter().all(|leap| agility.allows(leap, 0.1)));
        assert!(!agility.allows(&Pose2::new(2.0, 0.0, 0.0), 0.1));
    }
}
