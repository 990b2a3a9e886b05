//! Heading from a gyro: its yaw rate, less its bias, integrated over the true intervals (report eq. 16).

use crate::sensors::ImuReading;

/// Readings farther apart than this say nothing about what happened in between, seconds.
const LONGEST_GAP_S: f64 = 0.1;

/// The turn of the body since the gyro's first reading, over time.
#[derive(Debug, Clone, Default)]
pub(super) struct GyroHeading {
    stamps_s: Vec<f64>,
    heading_rad: Vec<f64>,
}

impl GyroHeading {
    /// Integrates the yaw rates (rad/s) by the trapezoidal rule; stamps must not decrease.
    pub(super) fn new(stamps_s: Vec<f64>, yaw_rates_rad_s: &[f64]) -> Self {
        let mut heading_rad = Vec::with_capacity(stamps_s.len());
        let mut sum = 0.0;
        for index in 0..stamps_s.len() {
            if index > 0 {
                let interval_s = stamps_s[index] - stamps_s[index - 1];
                sum += interval_s * (yaw_rates_rad_s[index - 1] + yaw_rates_rad_s[index]) / 2.0;
            }
            heading_rad.push(sum);
        }
        Self { stamps_s, heading_rad }
    }

    /// The readings' stamps strictly inside an interval, seconds.
    pub(super) fn stamps_within(&self, from_s: f64, to_s: f64) -> &[f64] {
        let first = self.stamps_s.partition_point(|&stamp_s| stamp_s <= from_s);
        let last = self.stamps_s.partition_point(|&stamp_s| stamp_s < to_s);
        &self.stamps_s[first..last.max(first)]
    }

    /// The turn between two times with no reading strictly in between, radians; `None` where
    /// the gyro was silent.
    pub(super) fn turn_rad(&self, from_s: f64, to_s: f64) -> Option<f64> {
        let next = self.stamps_s.partition_point(|&stamp_s| stamp_s <= from_s);
        let before = next.checked_sub(1)?;
        let interval_s = self.stamps_s.get(next)? - self.stamps_s[before];
        (interval_s <= LONGEST_GAP_S && to_s <= self.stamps_s[next])
            .then(|| (self.heading_rad[next] - self.heading_rad[before]) * (to_s - from_s) / interval_s)
    }

    /// The turn between any two times, radians; `None` where the gyro was silent for a part of it.
    pub(super) fn total_turn_rad(&self, from_s: f64, to_s: f64) -> Option<f64> {
        let mut sum = 0.0;
        let mut from_s = from_s;
        for &cut_s in self.stamps_within(from_s, to_s).iter().chain(&[to_s]) {
            sum += self.turn_rad(from_s, cut_s)?;
            from_s = cut_s;
        }
        Some(sum)
    }
}

/// The stamps (seconds) and yaw rates (rad/s) of the readings, in order of time.
pub(super) fn yaw_rates(readings: &[ImuReading]) -> (Vec<f64>, Vec<f64>) {
    let mut samples: Vec<(f64, f64)> =
        readings.iter().map(|reading| (reading.stamp_s, reading.angular_velocity_rad_s[2])).collect();
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    samples.into_iter().unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heading(stamps_s: &[f64], rate: impl Fn(f64) -> f64) -> GyroHeading {
        let rates: Vec<f64> = stamps_s.iter().map(|&stamp_s| rate(stamp_s)).collect();
        GyroHeading::new(stamps_s.to_vec(), &rates)
    }

    #[test]
    fn integrates_over_the_true_intervals() {
        let uneven = heading(&[0.0, 0.01, 0.015, 0.05, 0.1], |stamp_s| 2.0 * stamp_s);
        assert!((uneven.total_turn_rad(0.0, 0.1).unwrap() - 0.01).abs() < 1e-12);
        let half = uneven.turn_rad(0.05, 0.075).unwrap();
        assert!((half - 0.0075 / 2.0).abs() < 1e-12);
    }

    #[test]
    fn says_nothing_outside_its_span_and_in_gaps() {
        let gap = heading(&[0.0, 0.05, 0.5, 0.55], |_| 1.0);
        assert_eq!(gap.turn_rad(-0.01, 0.0), None);
        assert_eq!(gap.turn_rad(0.1, 0.2), None);
        assert_eq!(gap.turn_rad(0.55, 0.6), None);
        assert_eq!(gap.total_turn_rad(0.0, 0.55), None);
        assert!((gap.turn_rad(0.51, 0.52).unwrap() - 0.01).abs() < 1e-12);
    }

    #[test]
    fn readings_are_put_in_order_of_time() {
        let reading = |stamp_s, rate| ImuReading {
            stamp_s,
            angular_velocity_rad_s: [9.0, 9.0, rate],
            linear_acceleration_m_s2: [0.0; 3],
        };
        let sorted = yaw_rates(&[reading(2.0, 0.2), reading(1.0, 0.1)]);
        assert_eq!(sorted, (vec![1.0, 2.0], vec![0.1, 0.2]));
    }
}
