//! The gyro's bias, from the times at which the robot stands still.

use super::config::GyroBias;
use super::differential_drive::WheelStep;

/// A standstill shorter than this says too little, seconds.
const SHORTEST_S: f64 = 1.0;
/// The robot may still rock, or already turn by less than a tick, this long at both ends, seconds.
const MARGIN_S: f64 = 0.3;
/// A standstill counts only while the gyro is at most this many times as restless as in the
/// quietest one: wheels also stand still when the robot is lifted or pushed.
const RESTLESS: f64 = 3.0;
/// Biases that differ by more than this many standard errors show a drift.
const DRIFT_SIGNIFICANCE: f64 = 2.0;

/// The yaw rate that the gyro reports at rest, over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct BiasEstimate {
    /// Middle of each standstill (seconds) and the bias there (rad/s); none when no
    /// standstill was found, one when no drift shows.
    pub(super) knots: Vec<(f64, f64)>,
    /// Time over which the robot stood still, seconds.
    pub(super) standstill_s: f64,
}

impl BiasEstimate {
    /// The bias at a time (seconds), rad/s: linear between the standstills, constant outside.
    pub(super) fn at(&self, stamp_s: f64) -> f64 {
        let next = self.knots.partition_point(|&(knot_s, _)| knot_s <= stamp_s);
        match (next.checked_sub(1).map(|index| self.knots[index]), self.knots.get(next)) {
            (Some((from_s, from)), Some(&(to_s, to))) => from + (to - from) * (stamp_s - from_s) / (to_s - from_s),
            (Some((_, bias)), None) | (None, Some(&(_, bias))) => bias,
            (None, None) => 0.0,
        }
    }

    /// What the user should know of it.
    pub(super) fn remark(&self, mode: GyroBias) -> Option<String> {
        let degrees = |bias: f64| bias.to_degrees();
        match (self.knots.first(), self.knots.last()) {
            _ if mode == GyroBias::None => None,
            (Some((_, first)), Some((_, last))) if self.knots.len() > 1 => Some(format!(
                "the gyro's bias drifts from {:.4} to {:.4} °/s, seen over {:.1} s at rest",
                degrees(*first),
                degrees(*last),
                self.standstill_s
            )),
            (Some((_, bias)), _) => Some(format!(
                "the gyro's bias is {:.4} °/s, seen over {:.1} s at rest",
                degrees(*bias),
                self.standstill_s
            )),
            (None, _) => Some("the robot never stands still: no bias is taken off the gyro".to_owned()),
        }
    }
}

/// Estimates the bias from the yaw rates (rad/s, in order of `stamps_s`) while no wheel ticks.
pub(super) fn estimate_bias(mode: GyroBias, steps: &[WheelStep], stamps_s: &[f64], rates: &[f64]) -> BiasEstimate {
    if mode == GyroBias::None {
        return BiasEstimate::default();
    }
    let mut rests: Vec<Rest> = standstills(steps)
        .into_iter()
        .filter_map(|[from_s, to_s]| {
            let first = stamps_s.partition_point(|&stamp_s| stamp_s < from_s);
            let last = stamps_s.partition_point(|&stamp_s| stamp_s <= to_s);
            Rest::new((from_s + to_s) / 2.0, to_s - from_s, &rates[first..last])
        })
        .collect();
    let quietest = rests.iter().map(|rest| rest.deviation).fold(f64::INFINITY, f64::min);
    rests.retain(|rest| rest.deviation <= RESTLESS * quietest);
    let standstill_s = rests.iter().map(|rest| rest.duration_s).sum();
    let knots = if mode == GyroBias::StandstillWithDrift && drift_shows(&rests) {
        rests.iter().map(|rest| (rest.middle_s, rest.bias)).collect()
    } else if rests.is_empty() {
        Vec::new()
    } else {
        vec![(rests[0].middle_s, rests.iter().map(|rest| rest.bias * rest.duration_s).sum::<f64>() / standstill_s)]
    };
    BiasEstimate { knots, standstill_s }
}

/// What the gyro says during one standstill.
struct Rest {
    middle_s: f64,
    duration_s: f64,
    /// Mean rate without the highest and lowest tenth, rad/s.
    bias: f64,
    /// Half the span of the middle 68 % of the rates, rad/s.
    deviation: f64,
    /// Standard error of `bias`, rad/s.
    error: f64,
}

impl Rest {
    fn new(middle_s: f64, duration_s: f64, rates: &[f64]) -> Option<Self> {
        let count = rates.len();
        if count < 10 {
            return None;
        }
        let mut sorted = rates.to_vec();
        sorted.sort_by(f64::total_cmp);
        let tenth = count / 10;
        let kept = &sorted[tenth..count - tenth];
        let deviation = (sorted[count * 84 / 100] - sorted[count * 16 / 100]) / 2.0;
        Some(Self {
            middle_s,
            duration_s,
            bias: kept.iter().sum::<f64>() / kept.len() as f64,
            deviation,
            error: deviation / (count as f64).sqrt(),
        })
    }
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

fn is_still(step: &WheelStep) -> bool {
    step.distance_m == 0.0 && step.difference_m == 0.0
}

fn drift_shows(rests: &[Rest]) -> bool {
    rests.iter().enumerate().any(|(index, a)| {
        rests[..index].iter().any(|b| (a.bias - b.bias).abs() > DRIFT_SIGNIFICANCE * a.error.hypot(b.error))
    })
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
    fn rates(signal: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let noise = |k: u32| 0.004 * 2.0_f64.sqrt() * (f64::from(k) * 2.399).sin();
        let stamps_s: Vec<f64> = (0..6000).map(|k| f64::from(k) * 0.01).collect();
        let rates = (0..).zip(&stamps_s).map(|(k, &stamp_s)| signal(stamp_s) + noise(k)).collect();
        (stamps_s, rates)
    }

    fn driving(from_s: f64, to_s: f64, bias: f64) -> impl Fn(f64) -> f64 {
        move |stamp_s| if stamp_s > from_s && stamp_s < to_s { 0.5 * stamp_s.sin() } else { bias }
    }

    #[test]
    fn a_constant_bias_shows_no_drift() {
        let (stamps_s, rates) = rates(driving(10.0, 50.0, 0.01));
        let bias =
            estimate_bias(GyroBias::StandstillWithDrift, &steps(&[[0.0, 10.0], [50.0, 60.0]]), &stamps_s, &rates);
        assert_eq!(bias.knots.len(), 1);
        assert!((bias.at(30.0) - 0.01).abs() < 1e-4 && (bias.standstill_s - 18.8).abs() < 0.1);
    }

    #[test]
    fn a_drift_is_followed_only_where_asked_for() {
        let (stamps_s, rates) = rates(|stamp_s| 0.001 * stamp_s);
        let estimate = |mode| estimate_bias(mode, &steps(&[[0.0, 10.0], [50.0, 60.0]]), &stamps_s, &rates);
        let drifting = estimate(GyroBias::StandstillWithDrift);
        assert!((drifting.at(20.0) - 0.02).abs() < 2e-4, "{drifting:?}");
        assert!((estimate(GyroBias::Standstill).at(20.0) - 0.03).abs() < 2e-4);
        assert_eq!(estimate(GyroBias::None).at(20.0), 0.0);
    }

    #[test]
    fn a_robot_that_is_carried_with_still_wheels_is_not_at_rest() {
        let carried = |stamp_s: f64| if stamp_s > 50.0 { 0.3 * (3.0 * stamp_s).sin() } else { 0.01 };
        let (stamps_s, rates) = rates(carried);
        let bias =
            estimate_bias(GyroBias::StandstillWithDrift, &steps(&[[0.0, 10.0], [50.0, 60.0]]), &stamps_s, &rates);
        assert_eq!(bias.knots.len(), 1);
        assert!((bias.at(0.0) - 0.01).abs() < 1e-4);
    }

    #[test]
    fn without_a_standstill_there_is_no_bias() {
        let (stamps_s, rates) = rates(|_| 0.01);
        let bias = estimate_bias(GyroBias::StandstillWithDrift, &steps(&[]), &stamps_s, &rates);
        assert_eq!(bias, BiasEstimate::default());
        assert!(bias.remark(GyroBias::Standstill).is_some_and(|remark| remark.contains("never stands still")));
    }
}
