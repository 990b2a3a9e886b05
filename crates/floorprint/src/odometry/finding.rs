//! What was noticed in the data, as values; their sentences are made here alone.

use crate::sensors::Stream;
use serde::Serialize;
use std::fmt;

/// Something that the user should know of the data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "finding", rename_all = "snake_case")]
pub enum Finding {
    /// Nothing measured the motion.
    NoOdometry,
    /// The stated odometry is the same all the time.
    StandingOdometry,
    /// There is no gyro.
    NoImu,
    /// The gyro was silent while the wheels turned.
    ImuSilent {
        /// For how long in all, seconds.
        for_s: f64,
    },
    /// The gyro's bias, from standstills.
    GyroBias {
        /// At the first standstill, rad/s.
        first_rad_s: f64,
        /// At the last one, rad/s; the same where no drift shows.
        last_rad_s: f64,
        /// Time at rest in all, seconds.
        standstill_s: f64,
    },
    /// There was no standstill to take the gyro's bias from.
    NeverAtRest,
    /// The track width at which the wheels' yaw fits the gyro's.
    TrackWidth {
        /// As fitted, metres.
        fitted_m: f64,
        /// As calibrated, metres.
        stated_m: f64,
    },
    /// Encoder readings that a busy host stamped late.
    LateEncoders {
        /// How many were late by more than the clock's period.
        readings: usize,
        /// The longest delay, seconds.
        longest_s: f64,
        /// The encoder's period, seconds.
        period_s: f64,
    },
    /// A sensor's clock differs from the LiDAR's.
    Lag {
        /// Which one.
        sensor: Stream,
        /// By how much its stamps are late, seconds; negative when they are early.
        late_s: f64,
    },
    /// A sensor was silent.
    Silence {
        /// Which one.
        sensor: Stream,
        /// How often.
        times: usize,
        /// For how long at the most, seconds.
        longest_s: f64,
        /// When the longest silence began, seconds.
        from_s: f64,
    },
    /// Rays of a LiDAR that look too steeply up or down.
    SteepRays {
        /// How many.
        steep: usize,
        /// Of how many in a scan.
        rays: usize,
    },
    /// Rays that are said to have been taken over a longer time than a LiDAR has for a scan.
    LongSweep {
        /// How long the sweep is said to take, or to be off its stamp, seconds.
        sweep_s: f64,
        /// How long it is from one scan to the next, seconds.
        interval_s: f64,
    },
    /// Steps of the odometry that no robot can make.
    Jumps {
        /// How many.
        count: usize,
        /// The largest, metres.
        largest_m: f64,
    },
    /// Scans at whose time the odometry said nothing.
    OutsideOdometry {
        /// How many.
        scans: usize,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoOdometry => write!(formatter, "no odometry: the motion is predicted from scan matching alone"),
            Self::StandingOdometry => write!(
                formatter,
                "the stated odometry never moves: it is not used (odometry.source = \"log\" uses it all the same)"
            ),
            Self::NoImu => write!(formatter, "no IMU: yaw from the wheels"),
            Self::ImuSilent { for_s } => {
                write!(formatter, "the IMU is silent for {for_s:.2} s of motion: yaw from the wheels there")
            }
            Self::GyroBias { first_rad_s, last_rad_s, standstill_s } if first_rad_s == last_rad_s => write!(
                formatter,
                "the gyro's bias is {:.4} °/s, seen over {standstill_s:.1} s at rest",
                first_rad_s.to_degrees()
            ),
            Self::GyroBias { first_rad_s, last_rad_s, standstill_s } => write!(
                formatter,
                "the gyro's bias drifts from {:.4} to {:.4} °/s, seen over {standstill_s:.1} s at rest",
                first_rad_s.to_degrees(),
                last_rad_s.to_degrees()
            ),
            Self::NeverAtRest => write!(formatter, "the robot never stands still: no bias is taken off the gyro"),
            Self::TrackWidth { fitted_m, stated_m } => write!(
                formatter,
                "the wheels' yaw fits the gyro best with a track width of {fitted_m:.3} m (robot.wheels.track_width_m is {stated_m:.3})"
            ),
            Self::LateEncoders { readings, longest_s, period_s } => write!(
                formatter,
                "{readings} encoder readings were stamped late, by up to {:.0} ms: put back on the encoder's clock of {:.2} ms",
                1e3 * longest_s,
                1e3 * period_s
            ),
            Self::Lag { sensor, late_s } => write!(
                formatter,
                "the stamps of the {sensor} are {:.0} ms {} beside the LiDAR's: put right",
                1e3 * late_s.abs(),
                if late_s > 0.0 { "late" } else { "early" }
            ),
            Self::Silence { sensor, times: 1, longest_s, from_s } => {
                write!(formatter, "the {sensor} says nothing for {longest_s:.1} s from {from_s:.3} s on")
            }
            Self::Silence { sensor, times, longest_s, from_s } => write!(
                formatter,
                "the {sensor} says nothing {times} times, for {longest_s:.1} s at the most, from {from_s:.3} s on"
            ),
            Self::SteepRays { steep, rays } => {
                write!(formatter, "rays of a scan that are too steep to see walls and are not used: {steep} of {rays}")
            }
            Self::LongSweep { sweep_s, interval_s } => write!(
                formatter,
                "the rays of a scan are said to be taken over {sweep_s:.3} s, but scans come every {interval_s:.3} s: these times are not \
                 used; check the driver's time_increment or robot.lidar.sweep_duration_s"
            ),
            Self::Jumps { count, largest_m } => write!(
                formatter,
                "jumps of the odometry faster than any robot, which were not believed: {count}; the largest {largest_m:.0} m"
            ),
            Self::OutsideOdometry { scans } => {
                write!(formatter, "scans outside the odometry's span, whose motion is unknown: {scans}")
            }
        }
    }
}
