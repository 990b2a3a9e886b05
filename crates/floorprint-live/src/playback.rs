//! Plays a recording into the inbox, as fast as the sensors were or at any other rate.

use crate::inbox::Inbox;
use floorprint::sensors::Record;
use std::borrow::Cow;
use std::time::{Duration, Instant};

/// Longest pause of a recording that is waited for, seconds: clocks that were set make longer ones.
const LONGEST_PAUSE_S: f64 = 10.0;

/// Offers records at `rate` times the speed of their stamps, and loses old scans where the engine does not keep up; at the
/// rate 0 as fast as they are taken, and loses none. Returns when all were given or nobody takes them any more.
pub fn play<'a>(records: impl Iterator<Item = Cow<'a, Record>>, rate: f64, inbox: &Inbox, is_over: impl Fn() -> bool) {
    let mut latest_s: Option<f64> = None;
    let mut due = Instant::now();
    for record in records {
        if is_over() {
            return;
        }
        if rate <= 0.0 {
            if !inbox.send(record.into_owned()) {
                return;
            }
            continue;
        }
        let stamp_s = record.stamp_s();
        if stamp_s.is_finite() {
            let step_s = latest_s.map_or(0.0, |latest_s| stamp_s - latest_s).clamp(0.0, LONGEST_PAUSE_S);
            latest_s = Some(latest_s.map_or(stamp_s, |latest_s| latest_s.max(stamp_s)));
            due += Duration::from_secs_f64(step_s / rate);
        }
        while let Some(wait) = due.checked_duration_since(Instant::now()).filter(|wait| !wait.is_zero()) {
            if is_over() {
                return;
            }
            std::thread::sleep(wait.min(Duration::from_millis(100)));
        }
        inbox.offer(record.into_owned());
    }
}
