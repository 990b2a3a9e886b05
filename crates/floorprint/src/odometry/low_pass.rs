//! A first-order low-pass over samples at uneven times, run forwards and backwards so that nothing lags.

use std::f64::consts::TAU;

/// Smooths `values` in place; `stamps_s` must not decrease. Each pass halves the power at `cutoff_hz`.
pub(super) fn low_pass(values: &mut [f64], stamps_s: &[f64], cutoff_hz: f64) {
    for index in 1..values.len() {
        let kept = (-TAU * cutoff_hz * (stamps_s[index] - stamps_s[index - 1])).exp();
        values[index] += kept * (values[index - 1] - values[index]);
    }
    for index in (1..values.len()).rev() {
        let kept = (-TAU * cutoff_hz * (stamps_s[index] - stamps_s[index - 1])).exp();
        values[index - 1] += kept * (values[index] - values[index - 1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn amplitude_after(frequency_hz: f64, cutoff_hz: f64) -> f64 {
        let stamps: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.005).collect();
        let mut values: Vec<f64> = stamps.iter().map(|stamp_s| (TAU * frequency_hz * stamp_s).sin()).collect();
        low_pass(&mut values, &stamps, cutoff_hz);
        values[1000..3000].iter().copied().fold(0.0, f64::max)
    }

    #[test]
    fn slow_signals_pass_and_fast_ones_do_not() {
        assert!(amplitude_after(0.1, 5.0) > 0.99);
        assert!((amplitude_after(5.0, 5.0) - 0.5).abs() < 0.05);
        assert!(amplitude_after(50.0, 5.0) < 0.05);
    }

    #[test]
    fn a_symmetric_pulse_stays_where_it_is() {
        let stamps: Vec<f64> = (0..201).map(|k| f64::from(k) * 0.01).collect();
        let mut values: Vec<f64> = stamps.iter().map(|stamp_s| f64::from((stamp_s - 1.0).abs() < 0.105)).collect();
        low_pass(&mut values, &stamps, 3.0);
        let centre = values.iter().zip(&stamps).map(|(v, t)| v * t).sum::<f64>() / values.iter().sum::<f64>();
        assert!((centre - 1.0).abs() < 1e-6, "{centre}");
    }
}
