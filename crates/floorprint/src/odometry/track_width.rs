//! The track width at which the wheels' yaw fits the gyro's, learnt on the way.
//!
//! A skid-steered robot turns less than its mechanical track says. The difference of the
//! two sides is regressed on the gyro's turn over windows of a second: the gyro is the far
//! more precise of the two, so the regression is all but unbiased, and the windows average
//! over quantised ticks and small delays between the sensors.

use super::differential_drive::WheelStep;

/// Length of a window, seconds.
const WINDOW_S: f64 = 1.0;
/// The robot must turn by this much in all for the fit to mean anything, radians.
const LEAST_TURN_RAD: f64 = 3.0;

/// The regression as far as it has come.
#[derive(Debug, Clone, Default)]
pub(crate) struct TrackWidthFit {
    covariance: f64,
    variance: f64,
    turned_rad: f64,
    window: Option<Window>,
}

#[derive(Debug, Clone, Copy)]
struct Window {
    from_s: f64,
    difference_m: f64,
    /// The gyro's turn, radians; `None` once the gyro was silent.
    turn_rad: Option<f64>,
}

impl TrackWidthFit {
    /// Takes in a step with the gyro's turn (radians) during it, `None` where the gyro was silent.
    pub(crate) fn add(&mut self, step: &WheelStep, turn_rad: Option<f64>) {
        if self.window.is_some_and(|window| step.to_s > window.from_s + WINDOW_S) {
            self.close();
        }
        let empty = Window { from_s: step.from_s, difference_m: 0.0, turn_rad: Some(0.0) };
        let window = self.window.get_or_insert(empty);
        window.difference_m += step.difference_m;
        window.turn_rad = window.turn_rad.zip(turn_rad).map(|(sum, turn_rad)| sum + turn_rad);
    }

    /// The effective track width, metres; `None` as long as the drive does not show it.
    pub(crate) fn track_width_m(&self) -> Option<f64> {
        let track_width_m = self.covariance / self.variance;
        (self.turned_rad >= LEAST_TURN_RAD && track_width_m > 0.0).then_some(track_width_m)
    }

    fn close(&mut self) {
        let Some(Window { difference_m, turn_rad: Some(turn_rad), .. }) = self.window.take() else { return };
        self.covariance += difference_m * turn_rad;
        self.variance += turn_rad * turn_rad;
        self.turned_rad += turn_rad.abs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(difference_m: impl Fn(f64) -> f64, turn_rad: impl Fn(f64) -> Option<f64>) -> Option<f64> {
        let mut fit = TrackWidthFit::default();
        for k in 0..1000 {
            let from_s = f64::from(k) * 0.025;
            let step = WheelStep { from_s, to_s: from_s + 0.025, distance_m: 0.01, difference_m: difference_m(from_s) };
            fit.add(&step, turn_rad(from_s));
        }
        fit.track_width_m()
    }

    #[test]
    fn finds_the_width_that_joins_wheels_and_gyro() {
        let fitted = fitted(|t| 0.73 * 0.025 * t.sin(), |t| (t % 7.0 > 0.5).then_some(0.025 * t.sin()));
        assert!((fitted.unwrap() - 0.73).abs() < 0.02, "{fitted:?}");
    }

    #[test]
    fn a_drive_without_turns_shows_nothing() {
        assert_eq!(fitted(|_| 0.001, |_| Some(0.00025)), None);
        assert_eq!(fitted(f64::sin, |_| None), None);
    }
}
