//! How a session goes, in the form that robots tell it (`diagnostic_msgs`).

use crate::board::Situation;
use crate::engine::Step;
use floorprint_io::ros::{Diagnostics, Header, Message as _};

/// How often it is told.
pub(crate) const PERIOD: std::time::Duration = std::time::Duration::from_secs(1);

/// A LiDAR whose newest scan is so much older than the newest odometry has fallen silent, seconds.
const SILENCE_S: f64 = 2.0;

/// Tells one listener how it goes.
#[derive(Debug, Default)]
pub(crate) struct Health {
    /// Scans that were lost when it was told last.
    lost: usize,
}

impl Health {
    /// What there is to say, as a `diagnostic_msgs/DiagnosticArray` in CDR.
    pub(crate) fn tell(&mut self, situation: &Situation, step: &Step, now_s: f64) -> Vec<u8> {
        let counts = situation.counts;
        let lost_lately = counts.lost.scans.saturating_sub(std::mem::replace(&mut self.lost, counts.lost.scans));
        let (level, message) = if now_s - step.stamp_s > SILENCE_S {
            (2, "no scans come")
        } else if step.is_lost {
            (2, "lost")
        } else if lost_lately > 0 {
            (1, "scans are lost: the machine does not keep up")
        } else {
            (0, "fine")
        };
        let values = [
            ("scans", counts.steps.to_string()),
            ("scans lost", counts.lost.scans.to_string()),
            ("readings lost", counts.lost.readings.to_string()),
            ("scan on map", format!("{:.3}", step.inlier_share)),
            ("standard deviation m", format!("{:.4}", step.covariance[0][0].sqrt())),
            ("hypotheses", step.hypotheses.to_string()),
        ];
        let header = Header { stamp_s: now_s, frame: "" };
        Diagnostics { header, level, name: "floorprint: pose", message, values: &values }.to_cdr()
    }
}
