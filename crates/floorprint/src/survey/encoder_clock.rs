//! The encoder's clock, seen from the end of the recording.
//!
//! Readings cannot be counted closer together than a period, so the latest time at which reading k can have been
//! counted is the lower envelope `min over j ≥ k of (stamp_j − (j − k) · period)`. A pause without a burst after it
//! moves nothing: from the end it is seen which stamps really paused.

use crate::odometry::encoder_clock::{ENVELOPE_SLACK, Regularity, period_s};
use crate::odometry::{EncoderClockCorrection, Finding};
use crate::sensors::EncoderReading;

/// A step of the envelope that is longer than this many periods is a pause.
const PAUSE_PERIODS: f64 = 1.5;

/// The clock that the readings show.
#[derive(Debug)]
pub(super) struct SurveyedClock {
    pub(super) correction: EncoderClockCorrection,
    /// When each reading was counted, seconds.
    pub(super) counted_s: Vec<f64>,
    /// The longest delay of a stamp, seconds.
    pub(super) longest_s: f64,
    pub(super) finding: Option<Finding>,
}

/// Finds the clock; `None` when the readings show none or are stamped when they are counted.
pub(super) fn find(readings: &[EncoderReading]) -> Option<SurveyedClock> {
    let period_s = period_s(readings)?;
    let mut regularity = Regularity::default();
    regularity.add(readings);
    if regularity.ticks_follow_intervals() {
        return None;
    }
    let mut counted_s: Vec<f64> = readings.iter().map(|reading| reading.stamp_s).collect();
    for index in (0..counted_s.len() - 1).rev() {
        counted_s[index] = counted_s[index].min(counted_s[index + 1] - (1.0 - ENVELOPE_SLACK) * period_s);
    }
    let delays_s = || readings.iter().zip(&counted_s).map(|(reading, counted_s)| reading.stamp_s - counted_s);
    let longest_s = delays_s().fold(0.0, f64::max);
    let late = delays_s().filter(|&delay_s| delay_s > period_s).count();
    let finding = (late > 0).then_some(Finding::LateEncoders { readings: late, longest_s, period_s });
    let steps = counted_s.windows(2).zip(&readings[1..]);
    let mut pauses_s: Vec<f64> = steps
        .filter(|(pair, _)| pair[1] - pair[0] > PAUSE_PERIODS * period_s)
        .map(|(_, reading)| reading.stamp_s)
        .collect();
    pauses_s.sort_by(f64::total_cmp);
    Some(SurveyedClock { correction: EncoderClockCorrection { period_s, pauses_s }, counted_s, longest_s, finding })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::encoder_clock::tests::{PERIOD_S, busy_host, drive};
    use proptest::prelude::*;

    #[test]
    fn late_stamps_are_put_back() {
        let clock = find(&drive(busy_host, |_, _| 12.0)).unwrap();
        assert!((clock.correction.period_s - PERIOD_S).abs() < 2e-5 && clock.correction.pauses_s.is_empty());
        for (index, stamp_s) in clock.counted_s.iter().enumerate() {
            assert!((stamp_s - index as f64 * PERIOD_S).abs() < 0.008, "{index}: {stamp_s}");
        }
    }

    #[test]
    fn a_counter_that_is_read_when_it_is_stamped_is_left_alone() {
        let position = |stamp_s: f64| 300.0 * stamp_s + 100.0 * stamp_s.sin();
        assert!(find(&drive(busy_host, |from_s, to_s| position(to_s) - position(from_s))).is_none());
    }

    #[test]
    fn irregular_readings_show_no_clock() {
        let readings = drive(|index| 0.02 * (index as f64 / 40.0).powi(2), |_, _| 12.0);
        assert!(find(&readings).is_none());
        assert!(find(&readings[..20]).is_none());
    }

    #[test]
    fn a_pause_without_a_burst_is_a_pause() {
        let readings = drive(|index| if index < 1000 { 0.0 } else { 5.0 }, |_, _| 12.0);
        let clock = find(&readings).unwrap();
        assert!(clock.longest_s < 1e-9);
        assert_eq!(clock.correction.pauses_s, [readings[1000].stamp_s]);
    }

    proptest! {
        #[test]
        fn stamps_increase_and_are_only_moved_back(delays in prop::collection::vec(0.0..0.08_f64, 2000)) {
            let readings = drive(|index| delays[index], |_, _| 12.0);
            if let Some(clock) = find(&readings) {
                prop_assert!(readings.iter().zip(&clock.counted_s).all(|(reading, at_s)| *at_s <= reading.stamp_s));
                prop_assert!(clock.counted_s.windows(2).all(|pair| pair[1] > pair[0]));
            }
        }
    }
}
