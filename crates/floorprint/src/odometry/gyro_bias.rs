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
