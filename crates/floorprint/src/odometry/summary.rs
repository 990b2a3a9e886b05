//! What synchronisation did to the data: for the report and for the user's eyes.

use super::config::OdometrySource;
use super::finding::Finding;
use serde::Serialize;

/// Counts, dropped data and findings of a [`Synchronizer`](super::Synchronizer).
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SynchronisationSummary {
    /// Where the motion came from; `Auto` as long as that is open.
    pub source: OdometrySource,
    /// Scans seen.
    pub scans: usize,
    /// Frames made of them.
    pub frames: usize,
    /// Data that were not used.
    pub dropped: Dropped,
    /// What the user should know.
    pub findings: Vec<Finding>,
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
    /// Scans that came twice: stamp and ranges are those of one just before.
    pub scans_repeated: usize,
    /// Scans of one LiDAR that came after later ones of another had been used.
    pub scans_too_late: usize,
    /// Encoder readings with a number that is not finite.
    pub encoder_readings: usize,
    /// IMU readings with a number that is not finite.
    pub imu_readings: usize,
    /// Odometry poses with a number that is not finite.
    pub odometry_poses: usize,
    /// Readings of encoders, IMU and odometry that came twice.
    pub readings_repeated: usize,
    /// Readings of IMU and odometry that came after a later one.
    pub readings_too_late: usize,
    /// Readings whose stamp leaps away from those around it.
    pub readings_of_stray_stamp: usize,
}

impl Dropped {
    /// The counts with their reasons, for people.
    #[must_use]
    pub fn by_reason(&self) -> [(&'static str, usize); 11] {
        [
            ("scans whose stamp is not a number", self.scans_without_stamp),
            ("scans with another number of ranges than rays", self.scans_of_wrong_length),
            ("scans in which no ray says anything", self.scans_without_valid_ray),
            ("scans that repeat the one before them", self.scans_repeated),
            ("scans that came after later ones of another LiDAR", self.scans_too_late),
            ("encoder readings that are not finite", self.encoder_readings),
            ("IMU readings that are not finite", self.imu_readings),
            ("odometry poses that are not finite", self.odometry_poses),
            ("readings that came twice", self.readings_repeated),
            ("readings that came after later ones", self.readings_too_late),
            ("readings with a stray time stamp", self.readings_of_stray_stamp),
        ]
    }

    /// All dropped data.
    #[must_use]
    pub fn total(&self) -> usize {
        self.by_reason().iter().map(|(_, count)| count).sum()
    }

    /// Of them what came twice, of which nothing is lost.
    #[must_use]
    pub fn repeated(&self) -> usize {
        self.scans_repeated + self.readings_repeated
    }
}
