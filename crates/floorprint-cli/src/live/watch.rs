//! Watches what comes in, and tells where a sensor or a clock misbehaves.

use crate::terminal::Terminal;
use floorprint::sensors::Record;
use floorprint_live::STEP_BACK_S;
use std::time::{Duration, Instant};

/// A LiDAR that says nothing for so long has fallen silent.
const SILENCE: Duration = Duration::from_secs(2);
/// Stamps that go on by so much more than time does, seconds.
const STEP_ON_S: f64 = 10.0;
/// So many steps are told.
const MOST_STEPS: usize = 10;

/// Who tells.
pub(super) struct Watch<'a> {
    terminal: &'a Terminal,
    scanned: Option<Instant>,
    is_silent: bool,
    /// The newest record's stamp (seconds) of each kind of sensor, whose clocks may differ, and when it came.
    newest: [Option<(f64, Instant)>; 4],
    steps_told: usize,
}

impl<'a> Watch<'a> {
    pub(super) fn new(terminal: &'a Terminal) -> Self {
        Self { terminal, scanned: None, is_silent: false, newest: [None; 4], steps_told: 0 }
    }

    /// How long may be waited before there may be something to tell.
    pub(super) fn patience(&self) -> Duration {
        SILENCE
    }

    /// A record came.
    pub(super) fn see(&mut self, record: &Record, came: Instant) {
        self.see_stamp(record, came);
        if matches!(record, Record::Scan(_)) {
            if let Some(scanned) = self.scanned.filter(|_| self.is_silent) {
                let silence_s = came.duration_since(scanned).as_secs_f64();
                self.terminal.say(&format!("scans come again, after {silence_s:.1} s"));
            }
            (self.scanned, self.is_silent) = (Some(came), false);
        }
        self.look();
    }

    /// Tells where stamps are not those of time that goes on.
    fn see_stamp(&mut self, record: &Record, came: Instant) {
        let stamp_s = record.stamp_s();
        let newest = match record {
            Record::Scan(_) => &mut self.newest[0],
            Record::Encoders(_) => &mut self.newest[1],
            Record::Imu(_) => &mut self.newest[2],
            Record::Odometry(_) => &mut self.newest[3],
        };
        let earlier = newest.replace((stamp_s, came));
        let Some((earlier_s, then)) = earlier.filter(|_| self.steps_told < MOST_STEPS) else { return };
        let step_s = stamp_s - earlier_s;
        if step_s < -STEP_BACK_S {
            self.steps_told += 1;
            self.terminal.warn(&format!(
                "stamps go back by {:.1} s: a clock was set; until they have caught up the robot is followed by its scans \
                 alone",
                -step_s
            ));
        } else if step_s - came.duration_since(then).as_secs_f64() > STEP_ON_S {
            self.steps_told += 1;
            self.terminal.note(&format!("stamps go on by {step_s:.1} s at once: a pause, or a clock that was set"));
        }
    }

    /// Tells once when no scan comes any more.
    pub(super) fn look(&mut self) {
        if !self.is_silent && self.scanned.is_some_and(|scanned| scanned.elapsed() > SILENCE) {
            self.is_silent = true;
            self.terminal.warn("no scan comes any more: the session waits for the LiDAR");
        }
    }
}
