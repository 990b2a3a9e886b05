//! A first-order low-pass over readings at uneven times, run forwards and backwards so that nothing lags.
//!
//! The way back begins one period of the cut-off after the reading; what lies beyond would change it by 0.2 %.

use super::gyro::YawRate;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// How long after its stamp a reading's smoothed value is settled, seconds.
pub(crate) fn settling_s(cutoff_hz: f64) -> f64 {
    1.0 / cutoff_hz
}

/// The filter, fed reading by reading. Each of its two passes halves the power at the cut-off.
#[derive(Debug)]
pub(crate) struct LowPass {
    /// Cut-off frequency, Hz.
    pub(crate) cutoff_hz: f64,
    /// Readings that are not settled yet, after the way forwards.
    open: VecDeque<YawRate>,
    last: Option<YawRate>,
}

impl LowPass {
    /// Nothing seen yet.
    pub(crate) fn new(cutoff_hz: f64) -> Self {
        Self { cutoff_hz, open: VecDeque::new(), last: None }
    }

    /// Takes in a reading; gives those that are settled now.
    pub(crate) fn push(&mut self, mut reading: YawRate) -> Vec<YawRate> {
        let settled = self.settle(reading.stamp_s);
        if let Some(last) = self.last {
            reading.rate_rad_s += self.kept(last.stamp_s, reading.stamp_s) * (last.rate_rad_s - reading.rate_rad_s);
        }
        self.last = Some(reading);
        self.open.push_back(reading);
        settled
    }

    /// The readings that are settled when no other comes before `known_s`, seconds.
    pub(crate) fn settle(&mut self, known_s: f64) -> Vec<YawRate> {
        let mut settled = Vec::new();
        while let Some(&first) = self.open.front()
            && first.stamp_s + settling_s(self.cutoff_hz) < known_s
        {
            let until_s = first.stamp_s + settling_s(self.cutoff_hz);
            let count = self.open.partition_point(|reading| reading.stamp_s <= until_s);
            let back = self.open.range(..count).rev().copied().reduce(|after, mut reading| {
                reading.rate_rad_s +=
                    self.kept(reading.stamp_s, after.stamp_s) * (after.rate_rad_s - reading.rate_rad_s);
                reading
            });
            settled.extend(back);
            self.open.pop_front();
        }
        settled
    }

    fn kept(&self, from_s: f64, to_s: f64) -> f64 {
        (-TAU * self.cutoff_hz * (to_s - from_s)).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothed(signal: impl Fn(f64) -> f64, stamps_s: impl Iterator<Item = f64>, cutoff_hz: f64) -> Vec<YawRate> {
        let mut low_pass = LowPass::new(cutoff_hz);
        let mut smoothed = Vec::new();
        for stamp_s in stamps_s {
            smoothed.extend(low_pass.push(YawRate { stamp_s, rate_rad_s: signal(stamp_s) }));
        }
        smoothed.extend(low_pass.settle(f64::INFINITY));
        smoothed
    }

    fn amplitude_after(frequency_hz: f64, cutoff_hz: f64) -> f64 {
        let stamps_s = (0..4000).map(|k| f64::from(k) * 0.005);
        let values = smoothed(|stamp_s| (TAU * frequency_hz * stamp_s).sin(), stamps_s, cutoff_hz);
        values[1000..3000].iter().map(|reading| reading.rate_rad_s).fold(0.0, f64::max)
    }

    #[test]
    fn slow_signals_pass_and_fast_ones_do_not() {
        assert!(amplitude_after(0.1, 5.0) > 0.99);
        assert!((amplitude_after(5.0, 5.0) - 0.5).abs() < 0.05);
        assert!(amplitude_after(50.0, 5.0) < 0.05);
    }

    #[test]
    fn a_symmetric_pulse_stays_where_it_is_and_no_reading_is_lost() {
        let stamps_s = (0..201).map(|k| f64::from(k) * 0.01);
        let values = smoothed(|stamp_s| f64::from((stamp_s - 1.0).abs() < 0.105), stamps_s, 3.0);
        assert_eq!(values.len(), 201);
        let weight: f64 = values.iter().map(|reading| reading.rate_rad_s).sum();
        let centre = values.iter().map(|reading| reading.rate_rad_s * reading.stamp_s).sum::<f64>() / weight;
        assert!((centre - 1.0).abs() < 2e-3, "{centre}");
    }
}
