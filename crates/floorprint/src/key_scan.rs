//! The contract between front end and session: a scan that was written into the front end's map.

use crate::compact_scan::CompactScan;
use crate::geometry::Pose2;
use crate::surface::SurfaceScan;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A scan that was written into the front end's map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct KeyScan {
    /// Which of the frames it was, counted from 0.
    pub frame: usize,
    /// Pose of the body in the front end's frame: `odom_from_body`.
    pub pose: Pose2,
    /// Covariance of the motion since the key scan before over (x, y, θ) in the axes of the front end's frame,
    /// given the map that the scans on the way were matched to.
    pub covariance: Matrix3<f64>,
    /// By how much that motion may be off beyond its covariance.
    #[serde(default)]
    pub drift: Drift,
    /// Its surfaces, in the body's frame.
    #[serde(skip)]
    pub scan: Arc<SurfaceScan>,
    /// All its points, packed.
    #[serde(skip)]
    pub points: CompactScan,
    /// Set where scans had ceased to fit, so that the front end's map begins with this one.
    pub interruption: Option<Interruption>,
}

/// An error that does not average out from step to step: a robot whose scans do not tell how far it came goes by wheels
/// that may slip, or by how it went on before. Standard deviations that add up as they are, not by their squares.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Drift {
    /// Of the position, metres.
    pub sigma_m: f64,
    /// Of the heading, radians.
    pub sigma_rad: f64,
}

impl Drift {
    /// Adds what comes after it.
    pub fn add(&mut self, next: &Self) {
        self.sigma_m += next.sigma_m;
        self.sigma_rad += next.sigma_rad;
    }
}

/// A break in the drive: scans suddenly show something else. The robot was kidnapped, or much moved around it, or
/// a new drive begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Interruption {
    /// The first frame that did not fit the map before.
    pub frame: usize,
    /// Whether nothing fitted any more. Else the robot may be where it was thought to be.
    pub is_certain: bool,
    /// Whether it is no more than a suspicion: one scan or a few fitted badly, and the front end goes on with its map.
    #[serde(default)]
    pub is_suspicion: bool,
}
