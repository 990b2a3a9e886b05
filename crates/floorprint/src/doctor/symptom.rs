//! Symptoms as values; their sentences are made here alone.

use crate::sensors::Stream;
use serde::Serialize;
use std::fmt;

/// How much a symptom matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Worth knowing; the map does not suffer.
    Note,
    /// The map may suffer.
    Warning,
    /// The map will be wrong.
    Error,
    /// There will be no map.
    Fatal,
}

/// Something that seems wrong with a recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "symptom", rename_all = "snake_case")]
pub enum Symptom {
    /// Ranges are no metres.
    RangeUnits {
        /// The middle one of all ranges, as it stands.
        median: f64,
        /// How many of what they seem to be make a metre; 0 where that is not clear.
        per_metre: f64,
    },
    /// Angles of rays are no radians.
    AngleUnits {
        /// From the first ray to the last, as it stands.
        span: f64,
    },
    /// The rays span more than a full turn.
    MoreThanATurn {
        /// From the first ray to the last, degrees.
        span_deg: f64,
    },
    /// Nearly nothing comes back to the LiDAR.
    FewReturns {
        /// Share of rays that hit something.
        share: f64,
    },
    /// Scans have different numbers of rays.
    RayCounts {
        /// How many scans differ from most.
        scans: usize,
        /// Of how many.
        of: usize,
        /// The number of rays of most scans.
        usual: usize,
    },
    /// The LiDAR repeats its scans to the last digit.
    FrozenScans {
        /// How many.
        scans: usize,
        /// Of how many.
        of: usize,
    },
    /// Messages that came twice.
    Doubled {
        /// Of which sensor.
        sensor: Stream,
        /// How many.
        messages: usize,
    },
    /// Stamps are no seconds.
    StampUnits {
        /// From scan to scan in the middle, as it stands.
        interval: f64,
        /// How many of what they seem to be make a second.
        per_second: f64,
    },
    /// Two sensors' clocks have nothing to do with each other.
    ClocksApart {
        /// Which sensor.
        sensor: Stream,
        /// How much later than the scans its first message is, seconds.
        later_s: f64,
    },
    /// A clock was set back.
    ClockSetBack {
        /// Which sensor's.
        sensor: Stream,
        /// How often.
        times: usize,
        /// By how much at the most, seconds.
        by_s: f64,
    },
    /// The gyro's numbers are no rad/s.
    GyroUnits {
        /// The largest yaw rate, as it stands.
        largest: f64,
    },
    /// The gyro turns about another axis than the robot.
    GyroAxis {
        /// 0 for x, 1 for y.
        axis: usize,
    },
    /// Odometry and scans turn opposite ways.
    YawReversed {
        /// How well they agree once one of them is reversed, 0 to 1.
        correlation: f64,
    },
    /// The odometry's yaw is no radians.
    YawUnits {
        /// What the odometry states over what the scans show.
        ratio: f64,
    },
    /// The odometry turns too far or not far enough.
    YawScale {
        /// What the odometry states over what the scans show.
        ratio: f64,
    },
    /// The odometry's distances are too long or too short.
    DistanceScale {
        /// What the odometry states over what the scans show.
        ratio: f64,
    },
    /// The odometry says forwards where the robot drives backwards.
    ReverseSignLost {
        /// How often.
        times: usize,
    },
    /// Odometry and scans are not of the same moment.
    Late {
        /// How much later the odometry tells a motion than the scans show it, seconds; negative where it leads.
        odometry_by_s: f64,
    },
    /// The LiDAR looks elsewhere than it is said to.
    MountYaw {
        /// By how much it is turned from where it is said to look, counter-clockwise, radians.
        off_rad: f64,
    },
}

impl Symptom {
    /// How much it matters.
    #[must_use]
    pub fn severity(&self) -> Severity {
        match *self {
            Self::RangeUnits { .. } | Self::AngleUnits { .. } => Severity::Fatal,
            Self::FewReturns { share } if share < 0.002 => Severity::Fatal,
            Self::ClocksApart { .. } | Self::GyroUnits { .. } | Self::GyroAxis { .. } => Severity::Error,
            Self::StampUnits { per_second, .. } if per_second > 1e3 => Severity::Error,
            Self::YawReversed { .. } | Self::YawUnits { .. } => Severity::Error,
            Self::DistanceScale { ratio } if !(0.5..2.0).contains(&ratio) => Severity::Error,
            Self::MountYaw { off_rad } if off_rad.abs() > 0.35 => Severity::Error,
            Self::RayCounts { .. } | Self::Doubled { .. } => Severity::Note,
            _ => Severity::Warning,
        }
    }

    /// What it does to the map.
    #[must_use]
    pub fn effect(&self) -> &'static str {
        match self {
            Self::RangeUnits { .. } | Self::AngleUnits { .. } => "No scan fits another: there is no map",
            Self::MoreThanATurn { .. } => "The rays beyond a full turn draw walls twice",
            Self::FewReturns { .. } => "Where nothing is seen the odometry alone decides",
            Self::RayCounts { .. } => "None: each scan is taken as it says",
            Self::FrozenScans { .. } => "The robot seems to stand still while the odometry moves",
            Self::Doubled { .. } => "None: they are left out",
            Self::StampUnits { .. } => {
                "Every scan counts as taken after a long gap, in which the robot may have gone anywhere"
            }
            Self::ClocksApart { .. } => "No motion is known for any scan",
            Self::ClockSetBack { .. } => "What lies before and after it in the file overlaps in time",
            Self::GyroUnits { .. } | Self::YawUnits { .. } | Self::GyroAxis { .. } => "Each turn is predicted wrong",
            Self::YawReversed { .. } => "Each turn is predicted the wrong way round",
            Self::YawScale { .. } | Self::DistanceScale { .. } => {
                "Where the scans do not decide, along bare corridors, the map is stretched"
            }
            Self::ReverseSignLost { .. } => "Whenever the robot backs up, its pose is predicted the wrong way",
            Self::Late { .. } => "In turns the prediction lags behind the scans",
            Self::MountYaw { .. } => "Motion is predicted sideways, and sweeps are undone wrongly",
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn remedy(&self) -> String {
        match *self {
            Self::RangeUnits { per_metre, .. } if per_metre > 0.0 => {
                format!("Divide the ranges (and their limits) by {per_metre} where they are recorded")
            }
            Self::RangeUnits { .. } => "Record ranges in metres".to_owned(),
            Self::AngleUnits { .. } => "Record angle_min, angle_max and angle_increment in radians".to_owned(),
            Self::MoreThanATurn { .. } => "Correct angle_min, angle_max or angle_increment".to_owned(),
            Self::FewReturns { .. } => {
                "Look at the LiDAR's window, its range limits and scan.range_min_m, scan.range_max_m".to_owned()
            }
            Self::RayCounts { .. } | Self::Doubled { .. } => "Nothing need be done".to_owned(),
            Self::FrozenScans { .. } => "Look at the LiDAR's driver: it repeats old data".to_owned(),
            Self::StampUnits { per_second, .. } => {
                format!("Divide the stamps by {per_second} where they are recorded")
            }
            Self::ClocksApart { later_s, .. } => {
                format!("Take {later_s:.3} s off that sensor's stamps, or synchronise the computers' clocks")
            }
            Self::ClockSetBack { .. } => "Cut the recording there, or run the clock without steps".to_owned(),
            Self::GyroUnits { .. } => "Record angular velocities in rad/s".to_owned(),
            Self::GyroAxis { axis } => {
                format!("Turn the IMU's axes into the robot's: z up; yaw is on its {} axis", ["x", "y"][axis.min(1)])
            }
            Self::YawReversed { .. } => "Either the LiDAR is mounted upside down or its rays run clockwise (turn its \
                                         mount: robot.lidar.mount.roll_rad = 3.14159), or the odometry's or gyro's yaw has \
                                         the wrong sign"
                .to_owned(),
            Self::YawUnits { .. } => "Record the odometry's yaw in radians".to_owned(),
            Self::YawScale { ratio } => {
                format!(
                    "Multiply robot.wheels.track_width_m by {ratio:.3}, or set robot.scale.gyro or \
                     robot.scale.odometry_turn to {:.3}; `floorprint calibrate` tells more",
                    1.0 / ratio
                )
            }
            Self::DistanceScale { ratio } => {
                format!(
                    "Divide robot.wheels.left_m_per_tick and right_m_per_tick by {ratio:.3}, or set \
                     robot.scale.odometry_distance to {:.3}; `floorprint calibrate` tells more",
                    1.0 / ratio
                )
            }
            Self::ReverseSignLost { .. } => "Give the odometry the sign of the wheels' direction".to_owned(),
            Self::Late { odometry_by_s } => {
                format!(
                    "Set robot.lag.odometry_s (robot.lag.encoders_s, robot.lag.imu_s where wheels and gyro are used) to \
                     {odometry_by_s:.3}; `floorprint calibrate` tells more"
                )
            }
            Self::MountYaw { off_rad } => {
                format!("Add {off_rad:.4} to robot.lidar.mount.yaw_rad; `floorprint calibrate` tells more")
            },
        }
    }
}

/// The evidence, in one sentence.
impl fmt::Display for Symptom {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::RangeUnits { median, per_metre } => {
                let median = if median < 1e6 { format!("{median:.0}") } else { format!("{median:.0e}") };
                write!(formatter, "half of the ranges are beyond {median}, which cannot be metres")?;
                match per_metre {
                    1000.0 => write!(formatter, " (millimetres, it seems)"),
                    100.0 => write!(formatter, " (centimetres, it seems)"),
                    _ => Ok(()),
                }
            }
            Self::AngleUnits { span } => {
                write!(formatter, "the rays span {span:.0} from the first to the last, which is degrees, not radians")
            }
            Self::MoreThanATurn { span_deg } => {
                write!(formatter, "the rays span {span_deg:.1}°, more than a full turn")
            }
            Self::FewReturns { share } => write!(formatter, "only {:.2} % of the rays hit anything", 100.0 * share),
            Self::RayCounts { scans, of, usual } => {
                write!(formatter, "{scans} of {of} scans have another number of rays than {usual}")
            }
            Self::FrozenScans { scans, of } => {
                write!(formatter, "{scans} of {of} scans repeat the one before to the last digit, with a new stamp")
            }
            Self::Doubled { sensor, messages } => {
                write!(formatter, "messages of the {sensor} that came twice: {messages}")
            }
            Self::StampUnits { interval, per_second } => {
                let unit = match per_second {
                    1e9 => "nanoseconds",
                    1e6 => "microseconds",
                    _ => "milliseconds",
                };
                write!(
                    formatter,
                    "half of the scans are {interval:.0} s or more apart; their stamps are {unit}, it seems"
                )
            }
            Self::ClocksApart { sensor, later_s } => {
                write!(formatter, "the {sensor} and the scans share no time: it begins {later_s:.1} s after them")
            }
            Self::ClockSetBack { sensor, times, by_s } => {
                write!(formatter, "the clock of the {sensor} was set back {times} times, by {by_s:.1} s at the most")
            }
            Self::GyroUnits { largest } => {
                write!(formatter, "the gyro states {largest:.0} rad/s, which no robot survives (degrees, it seems)")
            }
            Self::GyroAxis { axis } => write!(
                formatter,
                "the gyro's z axis is still while the robot turns; its {} axis turns",
                ["x", "y"][axis.min(1)]
            ),
            Self::YawReversed { correlation } => write!(
                formatter,
                "the odometry turns left where the scans turn right (correlation {:.2})",
                -correlation
            ),
            Self::YawUnits { ratio } => {
                write!(formatter, "the odometry turns {ratio:.0} times as far as the scans: degrees, it seems")
            }
            Self::YawScale { ratio } => {
                write!(formatter, "the odometry turns {ratio:.2} times as far as the scans show")
            }
            Self::DistanceScale { ratio } => {
                write!(formatter, "the odometry drives {ratio:.2} times as far as the scans show")
            }
            Self::ReverseSignLost { times } => write!(
                formatter,
                "the odometry goes forwards where the scans show the robot backing up, at all {times} moments looked at"
            ),
            Self::Late { odometry_by_s } if odometry_by_s < 0.0 => {
                write!(formatter, "the odometry leads the scans by {:.0} ms", -1e3 * odometry_by_s)
            }
            Self::Late { odometry_by_s } => {
                write!(formatter, "the odometry lags the scans by {:.0} ms", 1e3 * odometry_by_s)
            }
            Self::MountYaw { off_rad } => write!(
                formatter,
                "driving straight on, the scans move {:.1}° to the side: the LiDAR is turned by that",
                off_rad.to_degrees()
            ),
        }
    }
}
