//! How the LiDAR moved, as its scans show it.

use super::CalibrationError;
use crate::config::Config;
use crate::frames::Frames;
use crate::geometry::{Pose2, wrap_angle};
use crate::sensors::Record;
use crate::slam::Slam;

/// A stretch ends once the LiDAR has moved by so much, metres, or turned by so much, radians: far beyond the scans'
/// own errors, and short enough for wheels not to have slipped much.
const STRETCH_M: f64 = 1.0;
const STRETCH_RAD: f64 = 0.7;
/// No stretch is longer than this, seconds: what a gyro's bias and standstill add would hide the rest.
const LONGEST_S: f64 = 6.0;
/// Between two scans no more time passes than this, seconds.
const LONGEST_GAP_S: f64 = 2.0;
/// Scans of which less than this share lies on the map say nothing.
const LEAST_INLIER_SHARE: f64 = 0.7;

/// The LiDAR's poses in the map at its scans.
#[derive(Debug)]
pub(super) struct ScanPath {
    /// Stamps that increase, seconds.
    stamps_s: Vec<f64>,
    /// `world_from_lidar`.
    poses: Vec<Pose2>,
    /// Headings without leaps, radians.
    headings_rad: Vec<f64>,
    /// Whether scan and map fit.
    fits: Vec<bool>,
}

/// A stretch of the drive between two scans.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    /// Stamps of the two scans, seconds.
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// `earlier_lidar_from_later_lidar`.
    pub(super) motion: Pose2,
    /// The turn, which may be more than half a turn, radians.
    pub(super) turned_rad: f64,
}

impl ScanPath {
    /// Solves a drive with one LiDAR.
    pub(super) fn of(records: &[Record], config: &Config) -> Result<Self, CalibrationError> {
        let frames = Frames::new(records, config)?;
        let mut slam = Slam::new(config);
        let mut fits = Vec::new();
        for frame in frames.iter() {
            let step = slam.process(&frame)?;
            fits.push(!step.is_lost && step.filter.inlier_share >= LEAST_INLIER_SHARE);
        }
        let result = slam.finish();
        for kidnapping in &result.kidnappings {
            if let Some(fits) = fits.get_mut(kidnapping.frame) {
                *fits = false;
            }
        }
        let mount = &config.robot.lidar.mount;
        let body_from_lidar = Pose2::new(mount.x_m, mount.y_m, mount.yaw_rad);
        let mut path = Self { stamps_s: Vec::new(), poses: Vec::new(), headings_rad: Vec::new(), fits: Vec::new() };
        for (stamped, fits) in result.trajectory.iter().zip(fits) {
            let pose = stamped.pose.compose(&body_from_lidar);
            if path.stamps_s.last().is_some_and(|last_s| stamped.stamp_s <= *last_s) {
                continue;
            }
            let heading_rad = match (path.poses.last(), path.headings_rad.last()) {
                (Some(last), Some(heading_rad)) => heading_rad + wrap_angle(pose.theta - last.theta),
                _ => pose.theta,
            };
            path.stamps_s.push(stamped.stamp_s);
            path.poses.push(pose);
            path.headings_rad.push(heading_rad);
            path.fits.push(fits);
        }
        Ok(path)
    }

    /// Heading of the LiDAR at any time within the drive, radians, without leaps.
    pub(super) fn heading_rad(&self, stamp_s: f64) -> f64 {
        let next = self.stamps_s.partition_point(|known_s| *known_s < stamp_s).clamp(1, self.stamps_s.len().max(2) - 1);
        let known = |index: usize| Some((*self.stamps_s.get(index)?, *self.headings_rad.get(index)?));
        let (Some((from_s, from_rad)), Some((to_s, to_rad))) = (known(next - 1), known(next)) else { return 0.0 };
        let share = ((stamp_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        from_rad + share * (to_rad - from_rad)
    }

    /// The drive cut into stretches one after the other, those left out where scans did not fit.
    pub(super) fn stretches(&self) -> Vec<Stretch> {
        let mut stretches = Vec::new();
        let mut start = 0;
        for end in 1..self.poses.len() {
            let broken = !self.fits[end] || self.stamps_s[end] - self.stamps_s[end - 1] > LONGEST_GAP_S;
            if broken || self.stamps_s[end] - self.stamps_s[start] > LONGEST_S {
                start = end;
                continue;
            }
            let motion = self.poses[start].between(&self.poses[end]);
            let turned_rad = self.headings_rad[end] - self.headings_rad[start];
            if motion.distance() >= STRETCH_M || turned_rad.abs() >= STRETCH_RAD {
                let [from_s, to_s] = [self.stamps_s[start], self.stamps_s[end]];
                stretches.push(Stretch { from_s, to_s, motion, turned_rad });
                start = end;
            }
        }
        stretches
    }
}
