//! The encoder's own clock: when ticks were counted whose readings were stamped late.
//!
//! A microcontroller that counts over a fixed period sends its readings to a host that
//! stamps them on arrival. A busy host stamps late and then catches up in a burst: the
//! intervals say 60 ms and 3 ms while each reading still holds one period of ticks. A
//! stamp can only be late, and readings cannot be counted closer together than a period,
//! so the latest time at which reading k can have been counted is the lower envelope
//! `min over j ≥ k of (stamp_j − (j − k) · period)`. A pause without a burst after it moves nothing.
//!
//! Other robots read a running counter and stamp it at that moment: the ticks then follow
//! the intervals, and the stamps are right. The data tell the two kinds apart.

use super::median;
use crate::sensors::EncoderReading;

/// Fewer readings than this show no clock.
const FEWEST_READINGS: usize = 100;
/// The period is measured over this many readings, so that late stamps hardly matter.
const LAG: usize = 200;
/// The clock is regular when the middle half of the measured periods spreads by less than this share.
const REGULAR_SPREAD: f64 = 0.02;
/// The envelope's period is this share of the measured one: an error of the measurement
/// must not add up from burst to burst.
const ENVELOPE_SHARE: f64 = 0.999;

/// Readings put back on the encoder's clock.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EncoderClock {
    /// When each reading's counting ended, seconds; increasing, and never after its stamp.
    pub(super) stamps_s: Vec<f64>,
    /// The clock's period, seconds.
    pub(super) period_s: f64,
}

impl EncoderClock {
    /// The clock that the readings show; `None` when they show none.
    pub(super) fn find(readings: &[EncoderReading]) -> Option<Self> {
        if readings.len() < FEWEST_READINGS {
            return None;
        }
        let period_s = period_s(readings)?;
        if ticks_follow_intervals(readings) {
            return None;
        }
        let mut stamps_s: Vec<f64> = readings.iter().map(|reading| reading.stamp_s).collect();
        for index in (0..stamps_s.len() - 1).rev() {
            stamps_s[index] = stamps_s[index].min(stamps_s[index + 1] - ENVELOPE_SHARE * period_s);
        }
        Some(Self { stamps_s, period_s })
    }

    /// By how much each stamp was late, seconds.
    pub(super) fn delays_s<'a>(&'a self, readings: &'a [EncoderReading]) -> impl Iterator<Item = f64> + 'a {
        readings.iter().zip(&self.stamps_s).map(|(reading, stamp_s)| reading.stamp_s - stamp_s)
    }
}

/// The clock's period, seconds; `None` when the readings do not come regularly.
fn period_s(readings: &[EncoderReading]) -> Option<f64> {
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
fn ticks_follow_intervals(readings: &[EncoderReading]) -> bool {
    let (mut by_interval, mut by_period) = (0.0, 0.0);
    let neighbours = [0, 1, 3, 4];
    for (around, &before) in readings[1..].windows(5).zip(readings) {
        let ticks = |index: usize| around[index].left_ticks + around[index].right_ticks;
        let interval_s = |index: usize| {
            let previous = if index == 0 { &before } else { &around[index - 1] };
            around[index].stamp_s - previous.stamp_s
        };
        let ticks_around: f64 = neighbours.iter().map(|&index| ticks(index)).sum();
        let time_around_s: f64 = neighbours.iter().map(|&index| interval_s(index)).sum();
        if time_around_s > 0.0 {
            by_interval += (ticks(2) - ticks_around / time_around_s * interval_s(2)).powi(2);
            by_period += (ticks(2) - ticks_around / 4.0).powi(2);
        }
    }
    by_interval < by_period
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD_S: f64 = 0.025;

    /// A drive of changing speed (ticks per second); `delay_s` says how late a reading is stamped.
    fn drive(delay_s: impl Fn(usize) -> f64, ticks: impl Fn(f64, f64) -> f64) -> Vec<EncoderReading> {
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
    fn busy_host(index: usize) -> f64 {
        let late = (index % 300) as f64;
        let hiccup: f64 = if late < 30.0 { late * 0.012 } else { 0.36 - (late - 30.0) * 0.022 };
        hiccup.max(0.0) + 0.001 * (index % 7) as f64
    }

    #[test]
    fn late_stamps_are_put_back() {
        let readings = drive(busy_host, |_, _| 12.0);
        let clock = EncoderClock::find(&readings).unwrap();
        assert!((clock.period_s - PERIOD_S).abs() < 2e-5, "{}", clock.period_s);
        for (index, stamp_s) in clock.stamps_s.iter().enumerate() {
            assert!((stamp_s - index as f64 * PERIOD_S).abs() < 0.008, "{index}: {stamp_s}");
        }
    }

    #[test]
    fn a_counter_that_is_read_when_it_is_stamped_is_left_alone() {
        let position = |stamp_s: f64| 300.0 * stamp_s + 100.0 * stamp_s.sin();
        let readings = drive(busy_host, |from_s, to_s| position(to_s) - position(from_s));
        assert!(EncoderClock::find(&readings).is_none());
    }

    #[test]
    fn irregular_readings_show_no_clock() {
        let readings = drive(|index| 0.02 * (index as f64 / 40.0).powi(2), |_, _| 12.0);
        assert!(EncoderClock::find(&readings).is_none());
        assert!(EncoderClock::find(&readings[..20]).is_none());
    }

    #[test]
    fn a_pause_without_a_burst_moves_nothing() {
        let readings = drive(|index| if index < 1000 { 0.0 } else { 5.0 }, |_, _| 12.0);
        let clock = EncoderClock::find(&readings).unwrap();
        assert!(clock.delays_s(&readings).all(|delay_s| delay_s.abs() < 1e-9));
    }

    proptest! {
        #[test]
        fn stamps_increase_and_are_only_moved_back(delays in prop::collection::vec(0.0..0.08_f64, 2000)) {
            let readings = drive(|index| delays[index], |_, _| 12.0);
            if let Some(clock) = EncoderClock::find(&readings) {
                prop_assert!(clock.delays_s(&readings).all(|delay_s| delay_s >= 0.0));
                prop_assert!(clock.stamps_s.windows(2).all(|pair| pair[1] > pair[0]));
            }
        }
    }
}
