//! Heading from a gyro: its yaw rate, less its bias, integrated over the true intervals (report eq. 16).

use super::low_pass::{LowPass, settling_s};
use std::collections::VecDeque;

/// Readings farther apart than this say nothing about what happened in between, seconds.
pub(crate) const LONGEST_GAP_S: f64 = 0.1;
/// No more readings than this are kept, whatever their stamps say.
const MOST_READINGS: usize = 16_384;

/// A yaw rate at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct YawRate {
    /// When, seconds.
    pub(crate) stamp_s: f64,
    /// About the body's z axis, rad/s.
    pub(crate) rate_rad_s: f64,
}

/// The latest readings of a gyro; stamps increase.
#[derive(Debug, Default)]
pub(crate) struct Gyro {
    readings: VecDeque<YawRate>,
    /// The same, smoothed where asked for, as far as that is settled.
    smooth: VecDeque<YawRate>,
    low_pass: Option<LowPass>,
}

impl Gyro {
    /// A gyro whose rates are smoothed by a low-pass of `low_pass_hz`, where that is not 0.
    pub(crate) fn new(low_pass_hz: f64) -> Self {
        Self { low_pass: (low_pass_hz > 0.0).then(|| LowPass::new(low_pass_hz)), ..Self::default() }
    }

    /// Takes in the next reading; `false` when it is not later than the one before.
    pub(crate) fn push(&mut self, reading: YawRate) -> bool {
        if self.readings.back().is_some_and(|last| reading.stamp_s <= last.stamp_s) {
            return false;
        }
        self.readings.push_back(reading);
        match &mut self.low_pass {
            None => self.smooth.push_back(reading),
            Some(low_pass) => self.smooth.extend(low_pass.push(reading)),
        }
        for queue in [&mut self.readings, &mut self.smooth] {
            if queue.len() > MOST_READINGS {
                queue.pop_front();
            }
        }
        true
    }

    /// How long after its stamp a reading is settled, seconds.
    pub(crate) fn settling_s(&self) -> f64 {
        self.low_pass.as_ref().map_or(0.0, |low_pass| settling_s(low_pass.cutoff_hz))
    }

    /// Settles the readings that have none after them for so long that none can come: all until `known_s`, seconds.
    pub(crate) fn settle(&mut self, known_s: f64) {
        if let Some(low_pass) = &mut self.low_pass {
            self.smooth.extend(low_pass.settle(known_s));
        }
    }

    /// Forgets the readings before a time but for the last of them.
    pub(crate) fn forget_before(&mut self, stamp_s: f64) {
        for queue in [&mut self.readings, &mut self.smooth] {
            while queue.get(1).is_some_and(|reading| reading.stamp_s < stamp_s) {
                queue.pop_front();
            }
        }
    }

    /// The readings as they came, after one time and up to another (seconds).
    pub(crate) fn raw_within(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = YawRate> + '_ {
        let [first, last] = [from_s, to_s].map(|at_s| self.readings.partition_point(|reading| reading.stamp_s <= at_s));
        self.readings.range(first..last.max(first)).copied()
    }

    /// By which stamp the turn until `to_s` is known: that of the next reading, or the time from which on the gyro has
    /// been silent for too long.
    pub(crate) fn known_s(&self, to_s: f64) -> f64 {
        let next = self.smooth.partition_point(|reading| reading.stamp_s < to_s);
        let silent_s = next.checked_sub(1).map_or(to_s, |before| to_s.max(self.smooth[before].stamp_s + LONGEST_GAP_S));
        self.smooth.get(next).map_or(silent_s, |reading| reading.stamp_s.min(silent_s)) + self.settling_s()
    }

    /// Whether a reading at or after `to_s` (seconds) is settled.
    pub(crate) fn reaches(&self, to_s: f64) -> bool {
        self.smooth.back().is_some_and(|last| last.stamp_s >= to_s)
    }

    /// The stamps of the readings strictly inside an interval, seconds.
    pub(crate) fn stamps_within(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = f64> + '_ {
        let first = self.smooth.partition_point(|reading| reading.stamp_s <= from_s);
        let last = self.smooth.partition_point(|reading| reading.stamp_s < to_s);
        self.smooth.range(first..last.max(first)).map(|reading| reading.stamp_s)
    }

    /// The turn between two times with no reading strictly in between, radians, by the trapezoidal rule; `None` where
    /// the gyro was silent. `bias` gives the bias (rad/s) at a time.
    pub(crate) fn turn_rad(&self, from_s: f64, to_s: f64, bias: impl Fn(f64) -> f64) -> Option<f64> {
        let next = self.smooth.partition_point(|reading| reading.stamp_s <= from_s);
        let (before, after) = (self.smooth.get(next.checked_sub(1)?)?, self.smooth.get(next)?);
        let rate = |reading: &YawRate| reading.rate_rad_s - bias(reading.stamp_s);
        (after.stamp_s - before.stamp_s <= LONGEST_GAP_S && to_s <= after.stamp_s)
            .then(|| (rate(before) + rate(after)) / 2.0 * (to_s - from_s))
    }

    /// The turn between any two times, radians; `None` where the gyro was silent for a part of it.
    pub(crate) fn total_turn_rad(&self, from_s: f64, to_s: f64, bias: impl Fn(f64) -> f64) -> Option<f64> {
        let mut cut_s = from_s;
        let turn_rad = |to_s: f64| self.turn_rad(std::mem::replace(&mut cut_s, to_s), to_s, &bias);
        self.stamps_within(from_s, to_s).chain([to_s]).map(turn_rad).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gyro(stamps_s: &[f64], rate: impl Fn(f64) -> f64) -> Gyro {
        let mut gyro = Gyro::default();
        for &stamp_s in stamps_s {
            assert!(gyro.push(YawRate { stamp_s, rate_rad_s: rate(stamp_s) }));
        }
        gyro
    }

    #[test]
    fn integrates_over_the_true_intervals() {
        let stamps_s = [0.0, 0.01, 0.015, 0.05, 0.1];
        let uneven = gyro(&stamps_s, |stamp_s| 2.0 * stamp_s + 0.3);
        let sum: f64 = stamps_s.windows(2).filter_map(|pair| uneven.turn_rad(pair[0], pair[1], |_| 0.3)).sum();
        assert!((sum - 0.01).abs() < 1e-12);
        let half = uneven.turn_rad(0.05, 0.075, |_| 0.3).unwrap();
        assert!((half - 0.0075 / 2.0).abs() < 1e-12);
    }

    #[test]
    fn says_nothing_outside_its_span_and_in_gaps() {
        let gap = gyro(&[0.0, 0.05, 0.5, 0.55], |_| 1.0);
        let turn = |from_s, to_s| gap.turn_rad(from_s, to_s, |_| 0.0);
        assert_eq!((turn(-0.01, 0.0), turn(0.1, 0.2), turn(0.55, 0.6)), (None, None, None));
        assert!((turn(0.51, 0.52).unwrap() - 0.01).abs() < 1e-12);
        assert_eq!((gap.known_s(0.04), gap.known_s(0.2), gap.known_s(0.06)), (0.05, 0.2, 0.15000000000000002));
        assert!(gap.reaches(0.55) && !gap.reaches(0.56));
    }

    #[test]
    fn what_comes_twice_or_too_late_is_refused() {
        let mut gyro = gyro(&[0.0, 0.01], |_| 1.0);
        assert!(!gyro.push(YawRate { stamp_s: 0.01, rate_rad_s: 1.0 }));
        assert!(!gyro.push(YawRate { stamp_s: 0.005, rate_rad_s: 1.0 }));
    }
}
