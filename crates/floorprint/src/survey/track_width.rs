//! The track width at which the wheels' yaw fits the gyro's over the whole drive.

use crate::odometry::BiasCurve;
use crate::odometry::differential_drive::WheelStep;
use crate::odometry::gyro::{Gyro, YawRate};
use crate::odometry::track_width::TrackWidthFit;

/// The effective track width, metres; `None` when the drive does not show it. Rates in order of their stamps.
pub(super) fn find(steps: &[WheelStep], rates: &[YawRate], bias: &BiasCurve) -> Option<f64> {
    let (mut fit, mut gyro, mut rates) = (TrackWidthFit::default(), Gyro::new(0.0), rates.iter());
    for step in steps {
        while !gyro.reaches(step.to_s)
            && let Some(&rate) = rates.next()
        {
            gyro.push(rate);
        }
        gyro.forget_before(step.from_s);
        fit.add(step, gyro.total_turn_rad(step.from_s, step.to_s, |stamp_s| bias.at(stamp_s)));
    }
    fit.track_width_m()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheels_are_compared_with_the_gyro_less_its_bias() {
        let steps: Vec<WheelStep> = (0..2000)
            .map(|k| f64::from(k) * 0.025)
            .map(|from_s| WheelStep {
                from_s,
                to_s: from_s + 0.025,
                distance_m: 0.01,
                difference_m: 0.73 * 0.025 * (from_s + 0.0125).sin(),
            })
            .collect();
        let rates: Vec<YawRate> = (-10..5100)
            .map(|k| f64::from(k) * 0.01)
            .map(|stamp_s| YawRate { stamp_s, rate_rad_s: stamp_s.sin() + 0.2 })
            .collect();
        let fitted_m = find(&steps, &rates, &BiasCurve { knots: vec![(0.0, 0.2)] }).unwrap();
        assert!((fitted_m - 0.73).abs() < 0.002, "{fitted_m}");
        assert_eq!(find(&steps, &[], &BiasCurve::default()), None);
    }
}
