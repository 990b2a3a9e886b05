//! The gyro's bias over the whole drive: the mean of each standstill, interpolated in between where they differ.

use crate::odometry::differential_drive::WheelStep;
use crate::odometry::gyro::YawRate;
use crate::odometry::gyro_bias::{MARGIN_S, Rest, SHORTEST_S, drift_shows, is_still, mean, quiet};
use crate::odometry::{BiasCurve, Finding, GyroBias};

/// Finds the bias as configured, from the yaw rates (in order of their stamps) while no wheel ticks.
pub(super) fn find(mode: GyroBias, steps: &[WheelStep], rates: &[YawRate]) -> (BiasCurve, Option<Finding>) {
    if mode == GyroBias::None {
        return (BiasCurve::default(), None);
    }
    let rests = standstills(steps).into_iter().filter_map(|[from_s, to_s]| {
        let first = rates.partition_point(|rate| rate.stamp_s < from_s);
        let last = rates.partition_point(|rate| rate.stamp_s <= to_s);
        Rest::new([from_s, to_s], rates[first..last].iter().map(|rate| rate.rate_rad_s).collect())
    });
    let rests = quiet(rests.collect());
    let Some(mean) = mean(&rests) else { return (BiasCurve::default(), Some(Finding::NeverAtRest)) };
    let knots: Vec<(f64, f64)> = if mode == GyroBias::StandstillWithDrift && drift_shows(&rests) {
        rests.iter().map(|rest| (rest.middle_s, rest.bias)).collect()
    } else {
        vec![(rests[0].middle_s, mean)]
    };
    let finding = Finding::GyroBias {
        first_rad_s: knots[0].1,
        last_rad_s: knots[knots.len() - 1].1,
        standstill_s: rests.iter().map(|rest| rest.duration_s).sum(),
    };
    (BiasCurve { knots }, Some(finding))
}

/// Stretches without a tick, less their margins, seconds.
fn standstills(steps: &[WheelStep]) -> Vec<[f64; 2]> {
    steps
        .chunk_by(|a, b| is_still(a) == is_still(b))
        .filter(|run| is_still(&run[0]))
        .map(|run| [run[0].from_s + MARGIN_S, run[run.len() - 1].to_s - MARGIN_S])
        .filter(|[from_s, to_s]| to_s - from_s >= SHORTEST_S)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A robot that stands still over the given stretches of a minute and drives otherwise.
    fn steps(rests: &[[f64; 2]]) -> Vec<WheelStep> {
        (0..2400)
            .map(|k| f64::from(k) * 0.025)
            .map(|from_s| {
                let rests = rests.iter().any(|rest| from_s >= rest[0] && from_s < rest[1]);
                let distance_m = if rests { 0.0 } else { 0.02 };
                WheelStep { from_s, to_s: from_s + 0.025, distance_m, difference_m: 0.0 }
            })
            .collect()
    }

    /// Rates at 100 Hz: the given signal with a repeatable noise of 0.004 rad/s.
    fn rates(signal: impl Fn(f64) -> f64) -> Vec<YawRate> {
        let noise = |k: u32| 0.004 * 2.0_f64.sqrt() * (f64::from(k) * 2.399).sin();
        (0..6000)
            .map(|k| YawRate { stamp_s: f64::from(k) * 0.01, rate_rad_s: signal(f64::from(k) * 0.01) + noise(k) })
            .collect()
    }

    fn driving(from_s: f64, to_s: f64, bias: f64) -> impl Fn(f64) -> f64 {
        move |stamp_s| if stamp_s > from_s && stamp_s < to_s { 0.5 * stamp_s.sin() } else { bias }
    }

    const BOTH_ENDS: [[f64; 2]; 2] = [[0.0, 10.0], [50.0, 60.0]];

    #[test]
    fn a_constant_bias_shows_no_drift() {
        let rates = rates(driving(10.0, 50.0, 0.01));
        let (bias, finding) = find(GyroBias::StandstillWithDrift, &steps(&BOTH_ENDS), &rates);
        assert_eq!(bias.knots.len(), 1);
        assert!((bias.at(30.0) - 0.01).abs() < 1e-4);
        assert!(matches!(finding, Some(Finding::GyroBias { standstill_s, .. }) if (standstill_s - 18.8).abs() < 0.1));
    }

    #[test]
    fn a_drift_is_followed_only_where_asked_for() {
        let rates = rates(|stamp_s| 0.001 * stamp_s);
        let estimate = |mode| find(mode, &steps(&BOTH_ENDS), &rates).0;
        assert!((estimate(GyroBias::StandstillWithDrift).at(20.0) - 0.02).abs() < 2e-4);
        assert!((estimate(GyroBias::Standstill).at(20.0) - 0.03).abs() < 2e-4);
        assert_eq!(estimate(GyroBias::None).at(20.0), 0.0);
    }

    #[test]
    fn a_robot_that_is_carried_with_still_wheels_is_not_at_rest() {
        let rates = rates(|stamp_s: f64| if stamp_s > 50.0 { 0.3 * (3.0 * stamp_s).sin() } else { 0.01 });
        let (bias, _) = find(GyroBias::StandstillWithDrift, &steps(&BOTH_ENDS), &rates);
        assert_eq!(bias.knots.len(), 1);
        assert!((bias.at(0.0) - 0.01).abs() < 1e-4);
    }

    #[test]
    fn without_a_standstill_there_is_no_bias() {
        let found = find(GyroBias::StandstillWithDrift, &steps(&[]), &rates(|_| 0.01));
        assert_eq!(found, (BiasCurve::default(), Some(Finding::NeverAtRest)));
    }
}
