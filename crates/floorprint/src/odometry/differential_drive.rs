//! Differential drive: distance and yaw from the ticks of two sides (report eqs. 15, 18, 19).
//!
//! The report turns ticks into a speed by a fixed rate of 40 Hz and multiplies by the
//! interval again (eqs. 14, 18, 19). Real intervals fall to 3 ms, where counts over the
//! interval would make 10 m/s; a reading's distance needs no interval at all, so it is
//! used as it is. Eq. 14's y component must read v sin θ (the report prints v sin).

use crate::sensors::{EncoderReading, WheelConfig};

/// What one encoder reading says about the motion up to its stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WheelStep {
    /// When the counting began, seconds.
    pub(crate) from_s: f64,
    /// When it ended, seconds; not before `from_s`.
    pub(crate) to_s: f64,
    /// Distance of the body's origin, metres; positive forward.
    pub(crate) distance_m: f64,
    /// Right side's distance less the left side's, metres.
    pub(crate) difference_m: f64,
}

impl WheelStep {
    /// The step of one reading that began to count at `from_s` and was counted at `counted_s` (seconds); a time that
    /// runs backwards is held, so that every tick stays in exactly one step.
    pub(crate) fn new(reading: &EncoderReading, from_s: f64, counted_s: f64, wheels: &WheelConfig) -> Self {
        let left_m = reading.left_ticks * wheels.left_m_per_tick;
        let right_m = reading.right_ticks * wheels.right_m_per_tick;
        Self {
            from_s,
            to_s: counted_s.max(from_s),
            distance_m: (left_m + right_m) / 2.0,
            difference_m: right_m - left_m,
        }
    }

    /// Turn of the body by the wheels alone, radians.
    pub(crate) fn yaw_rad(&self, track_width_m: f64) -> f64 {
        self.difference_m / track_width_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHEELS: WheelConfig = WheelConfig { left_m_per_tick: 0.002, right_m_per_tick: 0.002, track_width_m: 0.5 };

    #[test]
    fn equal_wheels_go_straight_and_opposite_ones_turn_in_place() {
        let reading = |left_ticks, right_ticks| EncoderReading { stamp_s: 1.0, left_ticks, right_ticks };
        let ahead = WheelStep::new(&reading(10.0, 10.0), 0.9, 1.0, &WHEELS);
        assert_eq!((ahead.distance_m, ahead.yaw_rad(0.5)), (0.02, 0.0));
        let around = WheelStep::new(&reading(-5.0, 5.0), 1.0, 0.8, &WHEELS);
        assert_eq!((around.distance_m, around.yaw_rad(0.5), around.to_s), (0.0, 0.04, 1.0));
    }
}
