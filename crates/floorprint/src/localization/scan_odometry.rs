//! The robot's motion as its own scans tell it: each is matched to those before, beside the odometry.
//!
//! A finished map may be years old, and an odometry may be mirrored, stuck or missing; what was seen a moment ago is
//! neither. The local map forgets what lies behind, so that memory stays bounded.

use crate::config::Config;
use crate::frame::Frame;
use crate::front_end::{FilterConfig, ParticleFilter};
use crate::geometry::Pose2;
use crate::key_scan::Drift;
use crate::profiler::NoProfiler;
use crate::surface::SurfaceScan;
use std::sync::Arc;

/// Follows the robot from scan to scan.
#[derive(Debug, Clone)]
pub(super) struct ScanOdometry {
    filter: ParticleFilter,
    /// `odom_from_body` at the last scan.
    pose: Option<Pose2>,
    /// What the filter has said so far of the drift since its last key scan.
    drift: Drift,
    steps: usize,
    /// Mean squared ratio of what the odometry is off to its standard deviation.
    off: f64,
}

/// What is known of the motion from one scan to the next.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScanMotion {
    /// Seen from the pose before.
    pub(super) motion: Pose2,
    /// Whether enough of the scan lies on what was seen before.
    pub(super) is_seen: bool,
    /// Whether the odometry says something else.
    pub(super) contradicts: bool,
    /// By how much it may be off where neither scans nor odometry show it.
    pub(super) drift: Drift,
}

/// Share of a scan that lies on what was seen before where the motion is seen.
const LEAST_INLIERS: f64 = 0.5;
/// The odometry contradicts the scans at so many standard deviations in one step …
const STEP_SIGMAS: f64 = 3.0;
/// … or at this mean squared ratio over several: share of the newest, and the most that a step counts.
const MEAN_SQUARE: f64 = 2.0;
const NEWEST: f64 = 0.1;
const MOST_SQUARE: f64 = 25.0;
/// Scans show a motion where it can have drifted by no more than this share of the odometry's standard deviation.
const SHOWN: f64 = 0.25;

impl ScanOdometry {
    pub(super) fn new(config: &Config) -> Self {
        let config = Config { filter: FilterConfig::default(), ..config.clone() };
        Self { filter: ParticleFilter::new(&config), pose: None, drift: Drift::default(), steps: 0, off: 0.0 }
    }

    /// The scan of the last frame.
    pub(super) fn scan(&self) -> &Arc<SurfaceScan> {
        self.filter.surfaces()
    }

    /// Takes in a frame; `stated` is the motion as the odometry has it, with its standard deviations (metres, radians).
    pub(super) fn step(&mut self, frame: &Frame, stated: Option<(&Pose2, [f64; 2])>) -> ScanMotion {
        // An odometry that was found wrong does not lead the way where scans do not show it.
        let step = if self.off > MEAN_SQUARE && frame.motion.is_some() {
            self.filter.process(&Frame { motion: None, ..frame.clone() }, &mut NoProfiler)
        } else {
            self.filter.process(frame, &mut NoProfiler)
        };
        let drift = Drift {
            sigma_m: (step.drift.sigma_m - self.drift.sigma_m).max(0.0),
            sigma_rad: (step.drift.sigma_rad - self.drift.sigma_rad).max(0.0),
        };
        self.drift = if self.filter.take_key_scan().is_some() { Drift::default() } else { step.drift };
        self.filter.forget_poses_before(self.steps);
        self.steps += 1;
        let motion = self.pose.map_or(Pose2::IDENTITY, |before| before.between(&step.pose));
        let is_seen = self.pose.is_some() && step.inlier_share >= LEAST_INLIERS;
        self.pose = Some(step.pose);
        let mut contradicts = false;
        if let (Some((stated, [sigma_m, sigma_rad])), true) = (stated, is_seen) {
            let between = stated.between(&motion);
            let ratio = (between.distance() / sigma_m.max(1e-6)).max(between.theta.abs() / sigma_rad.max(1e-6));
            // Where scans do not show the motion nothing speaks for or against the odometry.
            if drift.sigma_m < SHOWN * sigma_m {
                self.off += NEWEST * (ratio.powi(2).min(MOST_SQUARE) - self.off);
            }
            contradicts = ratio > STEP_SIGMAS || self.off > MEAN_SQUARE;
        }
        ScanMotion { motion, is_seen, contradicts, drift }
    }
}
