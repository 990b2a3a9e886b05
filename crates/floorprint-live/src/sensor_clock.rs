//! What time it is by the sensors, whose clocks may be set.

use floorprint::sensors::Record;

/// Stamps of a sensor that go back by more are a clock that was set, not a message that was late, seconds.
pub const STEP_BACK_S: f64 = 1.0;

/// The newest stamp of each kind of sensor.
#[derive(Debug, Clone, Copy, Default)]
pub struct SensorClock([Option<f64>; 4]);

impl SensorClock {
    /// A record came. Tells by how much its clock was set back, seconds, if it was.
    pub fn see(&mut self, record: &Record) -> Option<f64> {
        let stamp_s = record.stamp_s();
        if !stamp_s.is_finite() {
            return None;
        }
        let newest_s = match record {
            Record::Scan(_) => &mut self.0[0],
            Record::Encoders(_) => &mut self.0[1],
            Record::Imu(_) => &mut self.0[2],
            Record::Odometry(_) => &mut self.0[3],
        };
        let back_s = newest_s.map_or(0.0, |newest_s| newest_s - stamp_s);
        let was_set = back_s > STEP_BACK_S;
        if was_set || back_s <= 0.0 {
            *newest_s = Some(stamp_s);
        }
        was_set.then_some(back_s)
    }

    /// The time, seconds; `None` before anything came.
    #[must_use]
    pub fn now_s(&self) -> Option<f64> {
        self.0.iter().flatten().copied().reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::geometry::Pose2;
    use floorprint::sensors::{EncoderReading, StampedPose};

    #[test]
    fn it_goes_on_through_late_messages_and_follows_a_clock_that_is_set() {
        let mut clock = SensorClock::default();
        assert_eq!(clock.now_s(), None);
        let mut odometry =
            |stamp_s| (clock.see(&Record::Odometry(StampedPose { stamp_s, pose: Pose2::IDENTITY })), clock.now_s());
        assert_eq!(odometry(5000.0), (None, Some(5000.0)));
        assert_eq!(odometry(4999.5), (None, Some(5000.0)));
        assert_eq!(odometry(f64::NAN), (None, Some(5000.0)));
        assert_eq!(odometry(1400.0), (Some(3600.0), Some(1400.0)));
        assert_eq!(odometry(1400.1), (None, Some(1400.1)));
        // Another sensor has a clock of its own, and is set when it speaks.
        let mut encoders = |stamp_s| {
            let reading = EncoderReading { stamp_s, left_ticks: 0.0, right_ticks: 0.0 };
            (clock.see(&Record::Encoders(reading)), clock.now_s())
        };
        assert_eq!(encoders(1500.0), (None, Some(1500.0)));
        assert_eq!(encoders(1300.0), (Some(200.0), Some(1400.1)));
    }
}
