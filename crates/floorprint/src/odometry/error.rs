//! Why no frames can be made.

use thiserror::Error;

/// Why no frames can be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OdometryError {
    /// There is nothing to localise with.
    #[error("the data set holds no usable LiDAR scan ({found} in all)")]
    NoScans {
        /// Scans in the data set.
        found: usize,
    },
    /// The odometry that was asked for cannot be had from these data.
    #[error(
        "odometry.source = \"{wanted}\" needs {missing}, but the data set holds none: choose another source or \"auto\""
    )]
    SourceMissing {
        /// The value of `odometry.source`.
        wanted: &'static str,
        /// What is not there.
        missing: &'static str,
    },
    /// Encoder counts without a calibration.
    #[error(
        "the data set holds encoder counts, but robot.wheels is not set: give left_m_per_tick, right_m_per_tick and track_width_m, or choose another odometry.source"
    )]
    NoWheelCalibration,
    /// A setting that cannot work.
    #[error("{key} = {found}: expected {expected}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: f64,
        /// What it has to be.
        expected: &'static str,
    },
}
