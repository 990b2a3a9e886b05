//! Sensors that fall silent.

use super::Readings;
use crate::odometry::{Finding, median};

/// A sensor is silent when nothing comes for so many of its usual intervals, and for so long at the least, seconds.
const INTERVALS: f64 = 10.0;
const SHORTEST_S: f64 = 1.0;

/// A finding for each sensor that falls silent between its first record and its last.
pub(super) fn silences(readings: &Readings) -> Vec<Finding> {
    let silence = |sensor| {
        let times_s: Vec<f64> = readings.times_s(sensor).into_iter().map(|(_, time_s)| time_s).collect();
        let mut intervals_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let limit_s = (INTERVALS * median(&mut intervals_s)?).max(SHORTEST_S);
        let pauses = || times_s.windows(2).filter(|pair| pair[1] - pair[0] > limit_s);
        let longest = pauses().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
        let (longest_s, from_s) = (longest[1] - longest[0], longest[0]);
        Some(Finding::Silence { sensor: sensor.0, times: pauses().count(), longest_s, from_s })
    };
    readings.sensors().into_iter().filter_map(silence).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{EncoderReading, Record, Stream};

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
            silences(&Readings::of(&records[..]))
        };
        assert_eq!(with_pauses([0, 1]), []);
        let expected = Finding::Silence { sensor: Stream::Encoders, times: 2, longest_s: 4.0, from_s: 50.0 * 0.03125 };
        assert_eq!(with_pauses([4, 2]), [expected]);
    }
}
