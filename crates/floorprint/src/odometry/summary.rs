//! What synchronisation did to the data: for the report and for the user's eyes.

use super::config::OdometrySource;
use serde::Serialize;

/// Counts, dropped data and remarks of [`Frames`](super::Frames).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SynchronisationSummary {
    /// Where the motion came from; never `Auto`.
    pub source: OdometrySource,
    /// Scans in the data set.
    pub scans: usize,
    /// Frames made of them.
    pub frames: usize,
    /// Data that were not used.
    pub dropped: Dropped,
    /// Remarks in plain sentences.
    pub notes: Vec<String>,
}

/// Data that were not used, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Dropped {
    /// Scans whose stamp is not a finite number.
    pub scans_without_stamp: usize,
    /// Scans whose number of ranges differs from the number of rays.
    pub scans_of_wrong_length: usize,
    /// Scans in which no ray says anything.
    pub scans_without_valid_ray: usize,
    /// Scans that repeat the one before them, stamp and ranges.
    pub scans_repeated: usize,
    /// Encoder readings with a number that is not finite.
    pub encoder_readings: usize,
    /// IMU readings with a number that is not finite.
    pub imu_readings: usize,
    /// Odometry poses with a number that is not finite.
    pub odometry_poses: usize,
}

impl Dropped {
    /// All dropped data.
    #[must_use]
    pub fn total(&self) -> usize {
        self.scans_without_stamp
            + self.scans_of_wrong_length
            + self.scans_without_valid_ray
            + self.scans_repeated
            + self.encoder_readings
            + self.imu_readings
            + self.odometry_poses
    }
}
