//! The encoder's own clock: when ticks were counted whose readings were stamped late.
//!
//! A microcontroller that counts over a fixed period sends its readings to a host that stamps them on arrival. A busy
//! host stamps late, for seconds on end, and then catches up in a burst: the intervals say 60 ms and 3 ms while each
//! reading still holds one period of ticks. A stamp can only be late, and where no reading is lost, reading k was
//! counted (k − j) periods after reading j; so it cannot have been counted later than
//! `min over j ≤ k of (stamp_j + (k − j) · period)`. That needs nothing from the future.
//!
//! Where readings were really lost or the encoders paused, stamps stay late without ever catching up: then time goes on.
//!
//! Other robots read a running counter and stamp it at that moment: the ticks then follow the intervals, and the
//! stamps are right. The data tell the two kinds apart.

use super::corrections::EncoderClockCorrection;
use super::finding::Finding;
use super::median;
use crate::sensors::EncoderReading;
use std::collections::VecDeque;

/// Fewer readings than this show no clock.
pub(crate) const FEWEST_READINGS: usize = 100;
/// The period is measured over this many readings, so that late stamps hardly matter.
const LAG: usize = 200;
/// The clock is regular when the middle half of the measured periods spreads by less than this share.
const REGULAR_SPREAD: f64 = 0.02;
/// By which share the envelope's period is off the measured one, to the safe side: an error of the measurement must
/// not add up from burst to burst.
pub(crate) const ENVELOPE_SLACK: f64 = 0.001;
/// On the way the period is measured again over this many of the last readings, every so many.
const MEMORY: usize = 1000;
const EVERY: usize = 100;
/// No host is busy for longer than this between two readings: the encoders paused, seconds.
pub(crate) const LONGEST_DELAY_S: f64 = 1.0;
/// Stamps that have not caught up for this long will not: readings were lost, seconds.
const CATCHES_UP_WITHIN_S: f64 = 10.0;

/// Puts readings back on the encoder's clock, one by one.
#[derive(Debug)]
pub(crate) struct EncoderClock {
    knowledge: Knowledge,
    counted_s: Option<f64>,
    /// Since which stamp all readings have been late, and by how much at the least, seconds.
    behind: Option<(f64, f64)>,
    late: usize,
    longest_s: f64,
}

/// What is known of the clock.
#[derive(Debug)]
enum Knowledge {
    /// Stamps are right.
    StampsAreRight,
    /// Given beforehand.
    Given(EncoderClockCorrection),
    /// Learnt from the readings.
    Learnt { recent: VecDeque<EncoderReading>, unseen: usize, regularity: Regularity, period_s: Option<f64> },
}

impl EncoderClock {
    /// A clock as it was given; without one stamps are right.
    pub(crate) fn given(clock: Option<EncoderClockCorrection>) -> Self {
        Self::knowing(clock.map_or(Knowledge::StampsAreRight, Knowledge::Given))
    }

    /// A clock that is learnt from the readings.
    pub(super) fn learning() -> Self {
        let recent = VecDeque::with_capacity(MEMORY + 1);
        Self::knowing(Knowledge::Learnt { recent, unseen: 0, regularity: Regularity::default(), period_s: None })
    }

    fn knowing(knowledge: Knowledge) -> Self {
        Self { knowledge, counted_s: None, behind: None, late: 0, longest_s: 0.0 }
    }

    /// When the sensor's next reading was counted, seconds: never after its stamp.
    pub(crate) fn counted_s(&mut self, reading: &EncoderReading) -> f64 {
        self.learn(reading);
        let stamp_s = reading.stamp_s;
        let (Some(period_s), Some(before_s)) = (self.period_s(), self.counted_s) else {
            self.counted_s = Some(stamp_s);
            return stamp_s;
        };
        let due_s = before_s + (1.0 + ENVELOPE_SLACK) * period_s;
        let delay_s = stamp_s - due_s;
        let paused = match &self.knowledge {
            Knowledge::Given(clock) => clock.pauses_s.binary_search_by(|at_s| at_s.total_cmp(&stamp_s)).is_ok(),
            _ => delay_s > LONGEST_DELAY_S,
        };
        let counted_s = if paused || delay_s <= 0.0 {
            self.behind = None;
            stamp_s
        } else {
            let (since_s, least_s) = self.behind.unwrap_or((stamp_s, delay_s));
            let least_s = least_s.min(delay_s);
            self.behind = Some((since_s, least_s));
            if delay_s > period_s {
                self.late += 1;
                self.longest_s = self.longest_s.max(delay_s);
            }
            if least_s > period_s && stamp_s - since_s > CATCHES_UP_WITHIN_S {
                self.behind = None;
                due_s + least_s
            } else {
                due_s
            }
        };
        self.counted_s = Some(counted_s);
        counted_s
    }

    /// The clock's period, seconds; `None` while stamps are taken as they are.
    pub(super) fn period_s(&self) -> Option<f64> {
        match &self.knowledge {
            Knowledge::StampsAreRight => None,
            Knowledge::Given(clock) => Some(clock.period_s),
            Knowledge::Learnt { period_s, .. } => *period_s,
        }
    }

    /// What the user should know of late stamps.
    pub(super) fn finding(&self) -> Option<Finding> {
        let period_s = self.period_s().filter(|_| self.late > 0)?;
        Some(Finding::LateEncoders { readings: self.late, longest_s: self.longest_s, period_s })
    }

    fn learn(&mut self, reading: &EncoderReading) {
        let Knowledge::Learnt { recent, unseen, regularity, period_s: known_s } = &mut self.knowledge else { return };
        recent.push_back(*reading);
        if recent.len() > MEMORY {
            recent.pop_front();
        }
        *unseen += 1;
        if *unseen < EVERY {
            return;
        }
        let recent = recent.make_contiguous();
        // Five neighbours and the reading before them reach over the edge.
        regularity.add(&recent[recent.len().saturating_sub(*unseen + 5)..]);
        *unseen = 0;
        *known_s = period_s(recent).filter(|_| !regularity.ticks_follow_intervals());
    }
}

/// The clock's period, seconds; `None` when the readings do not come regularly or are too few.
pub(crate) fn period_s(readings: &[EncoderReading]) -> Option<f64> {
    if readings.len() < FEWEST_READINGS {
        return None;
    }
    let lag = LAG.min(readings.len() / 4);
    let mut periods: Vec<f64> =
        readings.iter().zip(&readings[lag..]).map(|(a, b)| (b.stamp_s - a.stamp_s) / lag as f64).collect();
    periods.sort_by(f64::total_cmp);
    let (quarter, three_quarters) = (periods[periods.len() / 4], periods[periods.len() * 3 / 4]);
    let period_s = median(&mut periods)?;
    (period_s > 0.0 && three_quarters - quarter < REGULAR_SPREAD * period_s).then_some(period_s)
}

/// Whether longer intervals hold more ticks: whether the speed runs more smoothly through
/// four neighbours when every reading counts for its own interval than when each counts
/// for one period.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Regularity {
    by_interval: f64,
    by_period: f64,
}

impl Regularity {
    /// Adds the evidence of readings that follow one another.
    pub(crate) fn add(&mut self, readings: &[EncoderReading]) {
        let neighbours = [0, 1, 3, 4];
        for (around, &before) in readings.get(1..).unwrap_or_default().windows(5).zip(readings) {
            let ticks = |index: usize| around[index].left_ticks + around[index].right_ticks;
            let interval_s = |index: usize| {
                let previous = if index == 0 { &before } else { &around[index - 1] };
                around[index].stamp_s - previous.stamp_s
            };
            let ticks_around: f64 = neighbours.iter().map(|&index| ticks(index)).sum();
            let time_around_s: f64 = neighbours.iter().map(|&index| interval_s(index)).sum();
            if time_around_s > 0.0 {
                self.by_interval += (ticks(2) - ticks_around / time_around_s * interval_s(2)).powi(2);
                self.by_period += (ticks(2) - ticks_around / 4.0).powi(2);
            }
        }
    }

    /// What the evidence says.
    pub(crate) fn ticks_follow_intervals(self) -> bool {
        self.by_interval < self.by_period
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) const PERIOD_S: f64 = 0.025;

    /// A drive of changing speed (ticks per second); `delay_s` says how late a reading is stamped.
    pub(crate) fn drive(delay_s: impl Fn(usize) -> f64, ticks: impl Fn(f64, f64) -> f64) -> Vec<EncoderReading> {
        let mut before_s = -PERIOD_S;
        let stamp = |index: usize| index as f64 * PERIOD_S + delay_s(index);
        (0..2000)
            .map(|index| {
                let stamp_s = stamp(index);
                let ticks = ticks(before_s, stamp_s);
                before_s = stamp_s;
                EncoderReading { stamp_s, left_ticks: ticks, right_ticks: ticks }
            })
            .collect()
    }

    /// The host is busy for 30 readings, stamps them late, and catches up at 3 ms a reading.
    pub(crate) fn busy_host(index: usize) -> f64 {
        let late = (index % 300) as f64;
        let hiccup: f64 = if late < 30.0 { late * 0.012 } else { 0.36 - (late - 30.0) * 0.022 };
        hiccup.max(0.0) + 0.001 * (index % 7) as f64
    }

    fn counted(readings: &[EncoderReading]) -> (EncoderClock, Vec<f64>) {
        let mut clock = EncoderClock::learning();
        let counted = readings.iter().map(|reading| clock.counted_s(reading)).collect();
        (clock, counted)
    }

    #[test]
    fn late_stamps_are_put_back() {
        let readings = drive(busy_host, |_, _| 12.0);
        let (clock, counted) = counted(&readings);
        assert!((clock.period_s().unwrap() - PERIOD_S).abs() < 2e-4, "{:?}", clock.period_s());
        for (index, stamp_s) in counted.iter().enumerate().skip(250) {
            assert!((stamp_s - index as f64 * PERIOD_S).abs() < 0.008, "{index}: {stamp_s}");
        }
        assert!(matches!(clock.finding(), Some(Finding::LateEncoders { longest_s, .. }) if longest_s > 0.3));
    }

    #[test]
    fn a_counter_that_is_read_when_it_is_stamped_is_left_alone() {
        let position = |stamp_s: f64| 300.0 * stamp_s + 100.0 * stamp_s.sin();
        let readings = drive(busy_host, |from_s, to_s| position(to_s) - position(from_s));
        let (clock, counted) = counted(&readings);
        assert_eq!((clock.period_s(), clock.finding()), (None, None));
        assert!(readings.iter().zip(counted).all(|(reading, counted_s)| reading.stamp_s == counted_s));
    }

    #[test]
    fn a_pause_is_a_pause_at_once_or_once_nothing_catches_up() {
        for (pause_s, settled) in [(5.0, 1000), (0.6, 1420)] {
            let readings = drive(|index| if index < 1000 { 0.0 } else { pause_s }, |_, _| 12.0);
            let (_, counted) = counted(&readings);
            for (reading, counted_s) in readings.iter().zip(counted).skip(settled) {
                assert!((reading.stamp_s - counted_s).abs() < 0.02, "{counted_s} for {}", reading.stamp_s);
            }
        }
    }

    #[test]
    fn a_pause_that_is_known_beforehand_moves_nothing() {
        let readings = drive(|index| if index < 1000 { 0.0 } else { 0.6 }, |_, _| 12.0);
        let known = EncoderClockCorrection { period_s: PERIOD_S, pauses_s: vec![readings[1000].stamp_s] };
        let mut clock = EncoderClock::given(Some(known));
        assert!(readings.iter().all(|reading| (clock.counted_s(reading) - reading.stamp_s).abs() < 1e-9));
    }

    proptest! {
        #[test]
        fn stamps_are_only_moved_back(delays in prop::collection::vec(0.0..0.08_f64, 2000)) {
            let readings = drive(|index| delays[index], |_, _| 12.0);
            let (_, counted) = counted(&readings);
            prop_assert!(readings.iter().zip(&counted).all(|(reading, counted_s)| *counted_s <= reading.stamp_s));
        }
    }
}
