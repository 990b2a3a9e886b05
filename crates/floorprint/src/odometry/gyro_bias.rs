//! The gyro's bias, from the times at which the robot stands still, learnt on the way.
//!
//! A standstill counts as soon as it has lasted long enough, also while it goes on.

use super::config::GyroBias;
use super::corrections::BiasCurve;
use super::differential_drive::WheelStep;
use super::finding::Finding;
use super::gyro::{Gyro, YawRate};
use std::collections::VecDeque;

/// A standstill shorter than this says too little, seconds.
pub(crate) const SHORTEST_S: f64 = 1.0;
/// The robot may still rock, or already turn by less than a tick, this long at both ends, seconds.
pub(crate) const MARGIN_S: f64 = 0.3;
/// A standstill counts only while the gyro is at most this many times as restless as in the
/// quietest one: wheels also stand still when the robot is lifted or pushed.
const RESTLESS: f64 = 3.0;
/// Biases that differ by more than this many standard errors show a drift.
const DRIFT_SIGNIFICANCE: f64 = 2.0;
/// While a standstill goes on, it is looked at again after so long, seconds.
const EVERY_S: f64 = 0.25;
/// Of a standstill this many of the latest readings count: half a minute at 100 Hz.
const MOST_READINGS: usize = 3000;
/// The latest standstills are kept, this many.
const MOST_RESTS: usize = 64;

/// What the gyro says during one standstill.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rest {
    /// Middle of the standstill, seconds.
    pub(crate) middle_s: f64,
    /// How long it lasted, seconds.
    pub(crate) duration_s: f64,
    /// Mean rate without the highest and lowest tenth, rad/s.
    pub(crate) bias: f64,
    /// Half the span of the middle 68 % of the rates, rad/s.
    deviation: f64,
    /// Standard error of `bias`, rad/s.
    error: f64,
}

impl Rest {
    /// Sums up a standstill between two times (seconds); `None` where there is too little to sum up.
    pub(crate) fn new([from_s, to_s]: [f64; 2], mut rates: Vec<f64>) -> Option<Self> {
        let count = rates.len();
        if count < 10 || to_s - from_s < SHORTEST_S {
            return None;
        }
        rates.sort_by(f64::total_cmp);
        let tenth = count / 10;
        let kept = &rates[tenth..count - tenth];
        let deviation = (rates[count * 84 / 100] - rates[count * 16 / 100]) / 2.0;
        Some(Self {
            middle_s: f64::midpoint(from_s, to_s),
            duration_s: to_s - from_s,
            bias: kept.iter().sum::<f64>() / kept.len() as f64,
            deviation,
            error: deviation / (count as f64).sqrt(),
        })
    }
}

/// The standstills that count: those in which the robot was not carried.
pub(crate) fn quiet(mut rests: Vec<Rest>) -> Vec<Rest> {
    let quietest = rests.iter().map(|rest| rest.deviation).fold(f64::INFINITY, f64::min);
    rests.retain(|rest| rest.deviation <= RESTLESS * quietest);
    rests
}

/// Whether biases differ from standstill to standstill by more than their errors.
pub(crate) fn drift_shows(rests: &[Rest]) -> bool {
    rests.iter().enumerate().any(|(index, a)| {
        rests[..index].iter().any(|b| (a.bias - b.bias).abs() > DRIFT_SIGNIFICANCE * a.error.hypot(b.error))
    })
}

/// The mean bias, each standstill by its duration, rad/s; `None` of none.
pub(crate) fn mean(rests: &[Rest]) -> Option<f64> {
    let standstill_s: f64 = rests.iter().map(|rest| rest.duration_s).sum();
    (standstill_s > 0.0).then(|| rests.iter().map(|rest| rest.bias * rest.duration_s).sum::<f64>() / standstill_s)
}

/// Whether no wheel ticked.
pub(crate) fn is_still(step: &WheelStep) -> bool {
    step.distance_m == 0.0 && step.difference_m == 0.0
}

/// The bias as it is known now.
#[derive(Debug)]
pub(super) enum BiasTracker {
    /// Known beforehand.
    Given(BiasCurve),
    /// Learnt from standstills.
    Learnt(Box<Learnt>),
}

#[derive(Debug)]
pub(super) struct Learnt {
    mode: GyroBias,
    bias: f64,
    /// Whether the bias follows the standstills.
    drifts: bool,
    /// The latest standstills.
    rests: VecDeque<Rest>,
    /// The bias of the first one, rad/s.
    first: Option<f64>,
    /// Time at rest, without the standstill that goes on, seconds.
    standstill_s: f64,
    still: Option<Standstill>,
}

/// A standstill that goes on.
#[derive(Debug)]
struct Standstill {
    from_s: f64,
    looked_at_s: f64,
    rates: VecDeque<YawRate>,
}

impl Standstill {
    /// What it amounts to, the last bit left out.
    fn rest(&self, to_s: f64) -> Option<Rest> {
        let (from_s, to_s) = (self.from_s + MARGIN_S, to_s - MARGIN_S);
        let count = self.rates.partition_point(|rate| rate.stamp_s <= to_s);
        Rest::new([from_s, to_s], self.rates.range(..count).map(|rate| rate.rate_rad_s).collect())
    }
}

impl BiasTracker {
    /// A bias that is learnt as configured.
    pub(super) fn learning(mode: GyroBias) -> Self {
        let (rests, first, still) = (VecDeque::new(), None, None);
        Self::Learnt(Box::new(Learnt { mode, bias: 0.0, drifts: false, rests, first, standstill_s: 0.0, still }))
    }

    /// The bias at a time (seconds), rad/s.
    pub(super) fn at(&self, stamp_s: f64) -> f64 {
        match self {
            Self::Given(curve) => curve.at(stamp_s),
            Self::Learnt(learnt) => learnt.bias,
        }
    }

    /// Takes in what wheels and gyro said during a step.
    pub(super) fn learn(&mut self, step: &WheelStep, gyro: &Gyro) {
        if let Self::Learnt(learnt) = self
            && learnt.mode != GyroBias::None
        {
            learnt.step(step, gyro);
        }
    }

    /// What the user should know of it.
    pub(super) fn finding(&self) -> Option<Finding> {
        let Self::Learnt(learnt) = self else { return None };
        let ongoing = learnt.still.as_ref().and_then(|still| still.rest(still.looked_at_s));
        let standstill_s = learnt.standstill_s + ongoing.map_or(0.0, |rest| rest.duration_s);
        match learnt.first {
            _ if learnt.mode == GyroBias::None => None,
            Some(first) => Some(Finding::GyroBias {
                first_rad_s: if learnt.drifts { first } else { learnt.bias },
                last_rad_s: learnt.bias,
                standstill_s,
            }),
            None => Some(Finding::NeverAtRest),
        }
    }
}

impl Learnt {
    fn step(&mut self, step: &WheelStep, gyro: &Gyro) {
        if !is_still(step) {
            if let Some(rest) = self.still.take().and_then(|still| still.rest(step.from_s)) {
                self.rests.push_back(rest);
                self.standstill_s += rest.duration_s;
                if self.rests.len() > MOST_RESTS {
                    self.rests.pop_front();
                }
                self.update(None);
            }
            return;
        }
        let still = self.still.get_or_insert_with(|| Standstill {
            from_s: step.from_s,
            looked_at_s: step.from_s,
            rates: VecDeque::new(),
        });
        let begins_s = still.from_s + MARGIN_S;
        still.rates.extend(gyro.raw_within(step.from_s, step.to_s).filter(|rate| rate.stamp_s >= begins_s));
        while still.rates.len() > MOST_READINGS {
            still.rates.pop_front();
        }
        if step.to_s - still.looked_at_s >= EVERY_S {
            still.looked_at_s = step.to_s;
            let ongoing = still.rest(step.to_s);
            self.update(ongoing);
        }
    }

    /// The bias by all standstills, one that goes on included.
    fn update(&mut self, ongoing: Option<Rest>) {
        let rests = quiet(self.rests.iter().copied().chain(ongoing).collect());
        let Some(last) = rests.last() else { return };
        self.first.get_or_insert(last.bias);
        self.drifts = self.mode == GyroBias::StandstillWithDrift && drift_shows(&rests);
        self.bias = if self.drifts { last.bias } else { mean(&rests).unwrap_or(last.bias) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Learns over a minute in which the robot stands still over the given stretches; the rates at 100 Hz are the given
    /// signal with a repeatable noise of 0.004 rad/s. Gives the tracker and the bias after every second.
    fn learn(mode: GyroBias, rests: &[[f64; 2]], signal: impl Fn(f64) -> f64) -> (BiasTracker, Vec<f64>) {
        let noise = |k: u32| 0.004 * 2.0_f64.sqrt() * (f64::from(k) * 2.399).sin();
        let mut gyro = Gyro::new(0.0);
        let (mut tracker, mut biases) = (BiasTracker::learning(mode), Vec::new());
        let mut k = 0;
        for step in 0..2400 {
            let from_s = f64::from(step) * 0.025;
            let to_s = from_s + 0.025;
            while f64::from(k) * 0.01 <= to_s {
                let stamp_s = f64::from(k) * 0.01;
                gyro.push(YawRate { stamp_s, rate_rad_s: signal(stamp_s) + noise(k) });
                k += 1;
            }
            let still = rests.iter().any(|rest| from_s >= rest[0] && from_s < rest[1]);
            let distance_m = if still { 0.0 } else { 0.02 };
            tracker.learn(&WheelStep { from_s, to_s, distance_m, difference_m: 0.0 }, &gyro);
            if step % 40 == 39 {
                biases.push(tracker.at(to_s));
            }
        }
        (tracker, biases)
    }

    fn driving(from_s: f64, to_s: f64, bias: f64) -> impl Fn(f64) -> f64 {
        move |stamp_s| if stamp_s > from_s && stamp_s < to_s { 0.5 * stamp_s.sin() } else { bias }
    }

    #[test]
    fn the_first_standstill_counts_as_soon_as_it_is_there() {
        let (tracker, biases) =
            learn(GyroBias::StandstillWithDrift, &[[0.0, 10.0], [50.0, 60.0]], driving(10.0, 50.0, 0.01));
        assert_eq!(biases[0], 0.0);
        assert!(biases[1..].iter().all(|bias| (bias - 0.01).abs() < 5e-4), "{biases:?}");
        let Some(Finding::GyroBias { first_rad_s, last_rad_s, standstill_s }) = tracker.finding() else {
            panic!("{:?}", tracker.finding())
        };
        assert!(
            first_rad_s == last_rad_s && (standstill_s - 18.8).abs() < 0.5,
            "{first_rad_s} {last_rad_s} {standstill_s}"
        );
    }

    #[test]
    fn a_drift_is_followed_only_where_asked_for() {
        let rests = [[0.0, 10.0], [50.0, 60.0]];
        let last = |mode| learn(mode, &rests, |stamp_s| 0.001 * stamp_s).1[59];
        assert!((last(GyroBias::StandstillWithDrift) - 0.055).abs() < 1e-3);
        assert!((last(GyroBias::Standstill) - 0.03).abs() < 1e-3);
        assert_eq!(last(GyroBias::None), 0.0);
    }

    #[test]
    fn a_robot_that_is_carried_with_still_wheels_is_not_at_rest() {
        let carried = |stamp_s: f64| if stamp_s > 50.0 { 0.3 * (3.0 * stamp_s).sin() } else { 0.01 };
        let (_, biases) = learn(GyroBias::StandstillWithDrift, &[[0.0, 10.0], [50.0, 60.0]], carried);
        assert!((biases[59] - 0.01).abs() < 1e-4, "{biases:?}");
    }

    #[test]
    fn without_a_standstill_there_is_no_bias() {
        let (tracker, biases) = learn(GyroBias::StandstillWithDrift, &[], |_| 0.01);
        assert!(biases.iter().all(|&bias| bias == 0.0));
        assert_eq!(tracker.finding(), Some(Finding::NeverAtRest));
    }
}
