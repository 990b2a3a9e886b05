//! The track width at which the wheels' yaw fits the gyro's.
//!
//! A skid-steered robot turns less than its mechanical track says. The difference of the
//! two sides is regressed on the gyro's turn over windows of a second: the gyro is the far
//! more precise of the two, so the regression is all but unbiased, and the windows average
//! over quantised ticks and small delays between the sensors.

use super::differential_drive::WheelStep;
use super::gyro_heading::GyroHeading;

/// Length of a window, seconds.
const WINDOW_S: f64 = 1.0;
/// The robot must turn by this much in all for the fit to mean anything, radians.
const LEAST_TURN_RAD: f64 = 3.0;

/// The effective track width, metres; `None` when the drive does not show it.
pub(super) fn effective_track_width_m(steps: &[WheelStep], gyro: &GyroHeading) -> Option<f64> {
    let (mut covariance, mut variance, mut turned_rad) = (0.0, 0.0, 0.0);
    let mut window = steps;
    while let Some(first) = window.first() {
        let length = window.partition_point(|step| step.to_s <= first.from_s + WINDOW_S).max(1);
        let (steps, rest) = window.split_at(length);
        window = rest;
        let Some(turn_rad) = gyro.total_turn_rad(first.from_s, steps[length - 1].to_s) else { continue };
        let difference_m: f64 = steps.iter().map(|step| step.difference_m).sum();
        covariance += difference_m * turn_rad;
        variance += turn_rad * turn_rad;
        turned_rad += turn_rad.abs();
    }
    let track_width_m = covariance / variance;
    (turned_rad >= LEAST_TURN_RAD && track_width_m > 0.0).then_some(track_width_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(difference_m: impl Fn(f64) -> f64) -> Vec<WheelStep> {
        (0..1000)
            .map(|k| f64::from(k) * 0.025)
            .map(|from_s| WheelStep {
                from_s,
                to_s: from_s + 0.025,
                distance_m: 0.01,
                difference_m: difference_m(from_s),
            })
            .collect()
    }

    fn gyro(rate: impl Fn(f64) -> f64) -> GyroHeading {
        let stamps: Vec<f64> = (-10..2600).map(|k| f64::from(k) * 0.01).collect();
        let rates: Vec<f64> = stamps.iter().map(|&stamp_s| rate(stamp_s)).collect();
        GyroHeading::new(stamps, &rates)
    }

    #[test]
    fn finds_the_width_that_joins_wheels_and_gyro() {
        let fitted = effective_track_width_m(&steps(|t| 0.73 * 0.025 * t.sin()), &gyro(f64::sin));
        assert!((fitted.unwrap() - 0.73).abs() < 0.02, "{fitted:?}");
    }

    #[test]
    fn a_drive_without_turns_shows_nothing() {
        assert_eq!(effective_track_width_m(&steps(|_| 0.001), &gyro(|_| 0.01)), None);
        assert_eq!(effective_track_width_m(&steps(f64::sin), &GyroHeading::default()), None);
    }
}
