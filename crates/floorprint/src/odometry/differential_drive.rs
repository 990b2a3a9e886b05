//! Differential drive: distance and yaw from the ticks of two sides (report eqs. 15, 18, 19).
//!
//! The report turns ticks into a speed by a fixed rate of 40 Hz and multiplies by the
//! interval again (eqs. 14, 18, 19). Real intervals fall to 3 ms, where counts over the
//! interval would make 10 m/s; a reading's distance needs no interval at all, so it is
//! used as it is. Eq. 14's y component must read v sin θ (the report prints v sin).

use super::median;
use crate::sensors::{EncoderReading, WheelConfig};

/// What one encoder reading says about the motion up to its stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WheelStep {
    /// When the counting began, seconds.
    pub(super) from_s: f64,
    /// When it ended, seconds; not before `from_s`.
    pub(super) to_s: f64,
    /// Distance of the body's origin, metres; positive forward.
    pub(super) distance_m: f64,
    /// Right side's distance less the left side's, metres.
    pub(super) difference_m: f64,
}

impl WheelStep {
    /// Turn of the body by the wheels alone, radians.
    pub(super) fn yaw_rad(&self, track_width_m: f64) -> f64 {
        self.difference_m / track_width_m
    }
}

/// The steps of all readings; `stamps_s` are the times at which they were counted.
///
/// Times that run backwards are held, so that every tick stays in exactly one step. The
/// first reading is taken to have counted for one usual interval.
pub(super) fn wheel_steps(readings: &[EncoderReading], stamps_s: &[f64], wheels: &WheelConfig) -> Vec<WheelStep> {
    let Some(&first_s) = stamps_s.first() else { return Vec::new() };
    let mut intervals_s: Vec<f64> = stamps_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut to_s = first_s - median(&mut intervals_s).unwrap_or(0.0).max(0.0);
    let mut steps = Vec::with_capacity(readings.len());
    for (reading, &stamp_s) in readings.iter().zip(stamps_s) {
        let left_m = reading.left_ticks * wheels.left_m_per_tick;
        let right_m = reading.right_ticks * wheels.right_m_per_tick;
        let from_s = to_s;
        to_s = stamp_s.max(from_s);
        steps.push(WheelStep { from_s, to_s, distance_m: (left_m + right_m) / 2.0, difference_m: right_m - left_m });
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WHEELS: WheelConfig = WheelConfig { left_m_per_tick: 0.002, right_m_per_tick: 0.003, track_width_m: 0.5 };

    #[test]
    fn equal_wheels_go_straight_and_opposite_ones_turn_in_place() {
        let wheels = WheelConfig { right_m_per_tick: 0.002, ..WHEELS };
        let reading = |left_ticks, right_ticks| EncoderReading { stamp_s: 1.0, left_ticks, right_ticks };
        let steps = wheel_steps(&[reading(10.0, 10.0), reading(-5.0, 5.0)], &[1.0, 1.1], &wheels);
        assert_eq!((steps[0].distance_m, steps[0].yaw_rad(0.5)), (0.02, 0.0));
        assert_eq!((steps[1].distance_m, steps[1].yaw_rad(0.5)), (0.0, 0.04));
        assert!((steps[0].from_s - 0.9).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn every_tick_is_in_one_step_whatever_the_stamps(
            readings in prop::collection::vec((-1.0..9.0_f64, -50i32..50, -50i32..50), 1..60)
        ) {
            let readings: Vec<_> = readings
                .into_iter()
                .map(|(stamp_s, left, right)| EncoderReading {
                    stamp_s,
                    left_ticks: f64::from(left),
                    right_ticks: f64::from(right),
                })
                .collect();
            let stamps: Vec<_> = readings.iter().map(|reading| reading.stamp_s).collect();
            let steps = wheel_steps(&readings, &stamps, &WHEELS);
            let right: f64 = readings.iter().map(|reading| reading.right_ticks * 0.003).sum();
            let left: f64 = readings.iter().map(|reading| reading.left_ticks * 0.002).sum();
            let distance: f64 = steps.iter().map(|step| step.distance_m).sum();
            let difference: f64 = steps.iter().map(|step| step.difference_m).sum();
            prop_assert!((distance - (left + right) / 2.0).abs() < 1e-9);
            prop_assert!((difference - (right - left)).abs() < 1e-9);
            prop_assert!(steps.windows(2).all(|pair| pair[0].to_s == pair[1].from_s && pair[0].to_s <= pair[1].to_s));
        }
    }
}
