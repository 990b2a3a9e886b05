//! The one stream that every reader yields.

use super::{EncoderReading, ImuReading, Scan};
use crate::geometry::Pose2;
use crate::ids::SensorId;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;

/// A sensor's message, in the order in which it is to be processed.
///
/// Images are not part of the stream: they are read when the floor is painted.
#[derive(Debug, Clone)]
pub enum Record {
    /// A turn of the LiDAR.
    Scan(Scan),
    /// Ticks of the wheels.
    Encoders(EncoderReading),
    /// A reading of the IMU.
    Imu(ImuReading),
    /// A pose that the robot's own odometry states.
    Odometry(StampedPose),
}

impl Record {
    /// Time of the record, seconds.
    #[must_use]
    pub fn stamp_s(&self) -> f64 {
        match self {
            Self::Scan(scan) => scan.stamp_s,
            Self::Encoders(reading) => reading.stamp_s,
            Self::Imu(reading) => reading.stamp_s,
            Self::Odometry(stamped) => stamped.stamp_s,
        }
    }

    /// The kind of sensor that it comes from, and which of its kind.
    #[must_use]
    pub fn sensor(&self) -> (Stream, SensorId) {
        match self {
            Self::Scan(scan) => (Stream::Scans, scan.sensor),
            Self::Encoders(_) => (Stream::Encoders, SensorId::default()),
            Self::Imu(_) => (Stream::Imu, SensorId::default()),
            Self::Odometry(_) => (Stream::Odometry, SensorId::default()),
        }
    }
}

/// A kind of sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stream {
    /// LiDARs.
    Scans,
    /// Wheel encoders.
    Encoders,
    /// Inertial units.
    Imu,
    /// The robot's own odometry.
    Odometry,
}

impl fmt::Display for Stream {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Scans => "LiDAR",
            Self::Encoders => "encoders",
            Self::Imu => "IMU",
            Self::Odometry => "odometry",
        })
    }
}

/// The records of a drive in the order in which they are to be processed, kept in memory or made when
/// they are asked for. A record is the same however often it is asked for.
pub trait Records: std::fmt::Debug {
    /// Number of records.
    fn count(&self) -> usize;

    /// The record at a position from 0 to [`count`](Self::count).
    fn record(&self, position: usize) -> Option<Cow<'_, Record>>;
}

impl Records for [Record] {
    fn count(&self) -> usize {
        self.len()
    }

    fn record(&self, position: usize) -> Option<Cow<'_, Record>> {
        self.get(position).map(Cow::Borrowed)
    }
}

/// A pose at a time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StampedPose {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The pose; whose and in which frame is said where it is used.
    pub pose: Pose2,
}
