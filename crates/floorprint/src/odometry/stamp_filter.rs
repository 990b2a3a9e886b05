//! Stray stamps: a leap in time counts only once the sensor's next record confirms it.
//!
//! One garbled stamp must neither push the clock ahead, after which everything that follows would be late, nor be
//! told from a pause of the sensor before its next record is there. A record whose stamp leaps away from its sensor's
//! and from all others' is therefore held until then; the order of a sensor's records never changes.

/// Stamps of one sensor farther apart than this are held until the next one confirms them, seconds. It is longer than
/// the interval of any usual sensor, and holding one costs no more than the wait for its successor.
pub(crate) const LEAP_S: f64 = 2.0;

/// The records of one sensor, the latest of them held back while its stamp is in question.
#[derive(Debug)]
pub(super) struct StampFilter<T> {
    newest_s: Option<f64>,
    held: Option<(f64, T)>,
}

/// A record and whether its stamp is to be believed.
pub(super) type Judged<T> = (T, bool);

impl<T> Default for StampFilter<T> {
    fn default() -> Self {
        Self { newest_s: None, held: None }
    }
}

impl<T> StampFilter<T> {
    /// Takes in the sensor's next record while it is `clock_s` (seconds) by all sensors; gives those that are judged
    /// now, in order.
    pub(super) fn push(&mut self, stamp_s: f64, record: T, clock_s: f64) -> [Option<Judged<T>>; 2] {
        let before = self.held.take().map(|(held_s, held)| {
            let confirmed = confirms(self.newest_s, held_s, stamp_s);
            if confirmed {
                self.count(held_s);
            }
            (held, confirmed)
        });
        let newest_s = self.newest_s.unwrap_or(f64::NEG_INFINITY);
        if [newest_s, clock_s].iter().any(|reached_s| (stamp_s - reached_s).abs() <= LEAP_S) {
            self.count(stamp_s);
            return [before, Some((record, true))];
        }
        self.held = Some((stamp_s, record));
        [before, None]
    }

    /// What is still held when no more comes: nothing speaks against its stamp.
    pub(super) fn finish(&mut self) -> Option<T> {
        self.held.take().map(|(_, held)| held)
    }

    fn count(&mut self, stamp_s: f64) {
        self.newest_s = Some(self.newest_s.map_or(stamp_s, |newest_s| newest_s.max(stamp_s)));
    }
}

/// Whether a stamp that leapt is confirmed by the next: they lie together, or time goes on at the same pace.
pub(crate) fn confirms(newest_s: Option<f64>, leapt_s: f64, next_s: f64) -> bool {
    let step_s = next_s - leapt_s;
    step_s.abs() <= LEAP_S || (step_s > 0.0 && newest_s.is_none_or(|newest_s| step_s <= 2.0 * (leapt_s - newest_s)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(stamps_s: &[f64]) -> Vec<(f64, bool)> {
        let mut filter = StampFilter::default();
        let mut judged: Vec<(f64, bool)> =
            stamps_s.iter().flat_map(|&stamp_s| filter.push(stamp_s, stamp_s, f64::NEG_INFINITY)).flatten().collect();
        judged.extend(filter.finish().map(|stamp_s| (stamp_s, true)));
        judged
    }

    #[test]
    fn a_stray_stamp_is_told_from_a_pause() {
        let believed: Vec<bool> = judged(&[1.0, 1.1, 1e9, 1.2, -5.0, 1.3, 40.0, 40.1]).iter().map(|j| j.1).collect();
        assert_eq!(believed, [true, true, false, true, false, true, true, true]);
    }

    #[test]
    fn slow_sensors_and_single_records_pass() {
        assert!(judged(&[0.0, 20.0, 40.0, 55.0]).iter().all(|judged| judged.1));
        assert_eq!(judged(&[7.0]), [(7.0, true)]);
    }

    #[test]
    fn what_the_other_sensors_confirm_is_not_held() {
        let mut filter = StampFilter::default();
        assert_eq!(filter.push(1.0, 'a', 0.9), [None, Some(('a', true))]);
        assert_eq!(filter.push(50.0, 'b', 49.0), [None, Some(('b', true))]);
        assert_eq!(filter.push(90.0, 'c', 50.0), [None, None]);
    }

    #[test]
    fn the_order_stays() {
        let stamps_s = [1.0, 50.0, 0.9, 1.2, 30.0, 31.0];
        assert_eq!(judged(&stamps_s).iter().map(|judged| judged.0).collect::<Vec<_>>(), stamps_s);
    }
}
