//! Sensors that fall silent.

use super::Readings;
use super::readings::never_decreasing;
use crate::odometry::{Finding, median};

/// A sensor is silent when nothing comes for so many of its usual intervals, and for so long at the least, seconds.
const INTERVALS: f64 = 10.0;
const SHORTEST_S: f64 = 1.0;

/// When the sensor with these stamps, seconds, fell silent and when it spoke again. Stray stamps are left out.
#[must_use]
pub fn silences(stamps_s: &[f64]) -> Vec<[f64; 2]> {
    let times_s = never_decreasing(stamps_s);
    let known_s: Vec<f64> = times_s.into_iter().filter(|time_s| time_s.is_finite()).collect();
    let mut intervals_s: Vec<f64> = known_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(usual_s) = median(&mut intervals_s) else { return Vec::new() };
    let limit_s = (INTERVALS * usual_s).max(SHORTEST_S);
    known_s.windows(2).filter(|pair| pair[1] - pair[0] > limit_s).map(|pair| [pair[0], pair[1]]).collect()
}

/// A finding for each sensor that falls silent between its first record and its last.
pub(super) fn findings(readings: &Readings) -> Vec<Finding> {
    let finding = |sensor| {
        let silences = silences(&readings.stamps_s(sensor));
        let longest = silences.iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
        let (longest_s, from_s) = (longest[1] - longest[0], longest[0]);
        Some(Finding::Silence { sensor: sensor.0, times: silences.len(), longest_s, from_s })
    };
    readings.sensors().into_iter().filter_map(finding).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{EncoderReading, Record, Stream};

    #[test]
    fn a_stray_stamp_is_no_silence() {
        let mut stamps_s: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
        (stamps_s[0], stamps_s[20]) = (f64::NAN, 1e6);
        assert!(silences(&stamps_s).is_empty());
        stamps_s.extend([9.0, 9.1]);
        assert_eq!(silences(&stamps_s).len(), 1);
    }

    #[test]
    fn the_longest_silence_is_told() {
        let ticks = |stamp_s| Record::Encoders(EncoderReading { stamp_s, left_ticks: 1.0, right_ticks: 1.0 });
        let with_pauses = |pauses: [u32; 2]| {
            let mut time_s = 0.0;
            let records: Vec<Record> = (0..200)
                .map(|k| {
                    time_s += if k == 50 {
                        f64::from(pauses[0])
                    } else if k == 90 {
                        f64::from(pauses[1])
                    } else {
                        0.03125
                    };
                    ticks(time_s)
                })
                .collect();
            findings(&Readings::of(&records[..]))
        };
        assert_eq!(with_pauses([0, 1]), []);
        let expected = Finding::Silence { sensor: Stream::Encoders, times: 2, longest_s: 4.0, from_s: 50.0 * 0.03125 };
        assert_eq!(with_pauses([4, 2]), [expected]);
    }
}
