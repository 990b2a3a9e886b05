//! Submaps: pieces of a drive short enough to be right in themselves (Hess et al. 2016).

use super::{Interruption, KeyScan};
use crate::geometry::Pose2;
use crate::map::{Horizon, SurfaceMap};
use crate::scan_matcher::SurfaceScan;
use nalgebra::Matrix3;
use std::sync::Arc;

/// Points by which a submap is fitted.
const PROBE_POINTS: usize = 400;

/// What consecutive key scans saw, in the frame of the first of them.
#[derive(Debug, Clone)]
pub struct Submap {
    /// Which frame the first key scan was, counted from 0.
    pub first: usize,
    /// Which frame the key scan half way was.
    pub middle_frame: usize,
    /// Pose of the first key scan as the front end had it: front end's world from submap.
    pub front_end_from_submap: Pose2,
    /// Pose of the key scan half way, in the submap's frame.
    pub middle: Pose2,
    /// Path from the start of the drive to the start of the submap, metres.
    pub path_m: f64,
    /// What ties it to the submap before; `None` for the first.
    pub link: Option<Link>,
    /// Where the robot may have been carried here from elsewhere.
    pub starts_anew: Option<Interruption>,
    /// All surfaces, as if seen from the middle; in the submap's frame.
    pub surfaces: Arc<SurfaceScan>,
    /// A choice of them by which the submap is looked for and fitted.
    pub probe: SurfaceScan,
    /// Whether it shows nothing that older ones do not; later ones are then compared with those.
    pub is_known: bool,
    /// What the first, the middle and the last key scan had in view, in the submap's frame.
    pub horizons: Vec<Horizon>,
}

/// The motion from the start of one submap to the start of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// The newer submap's pose in the older's frame.
    pub previous_from_submap: Pose2,
    /// What the matches on the way leave in doubt, over (x, y, θ) in the axes of the newer submap.
    pub covariance: Matrix3<f64>,
    /// Length of the path, metres.
    pub path_m: f64,
}

/// Cuts a drive into submaps as it goes on.
#[derive(Debug, Clone)]
pub struct SubmapBuilder {
    length_m: f64,
    cell_m: f64,
    /// Key scans of the submap in the making.
    open: Vec<KeyScan>,
    /// Path from the start of the drive to the first and to the last of them, metres.
    start_m: f64,
    path_m: f64,
    /// What led to the first of them.
    link: Option<Link>,
    /// Sum of the covariances since the first of them.
    covariance: Matrix3<f64>,
}

impl SubmapBuilder {
    /// Submaps of `length_m` of path, with surfaces kept in cells of `cell_m`; metres.
    #[must_use]
    pub fn new(length_m: f64, cell_m: f64) -> Self {
        Self { length_m, cell_m, open: Vec::new(), start_m: 0.0, path_m: 0.0, link: None, covariance: Matrix3::zeros() }
    }

    /// Takes the next key scan; gives the submap that ends before it.
    ///
    /// `poses_since(frame)` are the front end's poses from that frame on, as they are now: which
    /// particle is the best may have changed since the key scans were taken.
    pub fn add(&mut self, key_scan: KeyScan, poses_since: impl FnOnce(usize) -> Vec<Pose2>) -> Option<Submap> {
        let step_m = self.open.last().map_or(0.0, |last| last.pose.between(&key_scan.pose).distance());
        self.path_m += step_m;
        self.covariance += key_scan.covariance;
        let ends = key_scan.starts_anew.is_some() || self.path_m - self.start_m > self.length_m;
        if self.open.is_empty() || !ends {
            self.open.push(key_scan);
            return None;
        }
        self.open.push(key_scan);
        let first = self.open[0].frame;
        let poses = poses_since(first);
        for scan in &mut self.open {
            scan.pose = poses.get(scan.frame - first).copied().unwrap_or(scan.pose);
        }
        let next = self.open.pop()?;
        let start_m = self.path_m - step_m;
        let submap = self.close()?;
        self.link = Some(Link {
            previous_from_submap: submap.front_end_from_submap.between(&next.pose),
            covariance: in_frame_of(&std::mem::take(&mut self.covariance), &next.pose),
            path_m: (self.path_m - self.start_m).max(start_m - self.start_m),
        });
        self.start_m = self.path_m;
        self.open.push(next);
        Some(submap)
    }

    /// Whether the robot may have been carried elsewhere right before the submap in the making.
    #[must_use]
    pub fn starts_anew(&self) -> bool {
        self.open.first().is_some_and(|first| first.starts_anew.is_some())
    }

    /// The last submap, if any key scan is left.
    #[must_use]
    pub fn finish(mut self) -> Option<Submap> {
        self.close()
    }

    /// Makes a submap of the open key scans.
    fn close(&mut self) -> Option<Submap> {
        let key_scans = std::mem::take(&mut self.open);
        let first = key_scans.first()?;
        let half_way = &key_scans[key_scans.len() / 2];
        let middle = first.pose.between(&half_way.pose);
        let mut map = SurfaceMap::new(self.cell_m);
        for scan in &key_scans {
            map.add_scan(&first.pose.between(&scan.pose), &scan.scan);
        }
        let surfaces = SurfaceScan::from_surfaces([middle.x, middle.y], map.surfaces());
        Some(Submap {
            first: first.frame,
            middle_frame: half_way.frame,
            front_end_from_submap: first.pose,
            middle,
            path_m: self.start_m,
            link: self.link,
            starts_anew: first.starts_anew,
            probe: surfaces.balanced(PROBE_POINTS),
            is_known: false,
            surfaces: Arc::new(surfaces),
            horizons: [first, half_way, &key_scans[key_scans.len() - 1]]
                .map(|scan| scan.horizon_from(&first.pose))
                .into(),
        })
    }
}

impl Submap {
    /// Forgets what it looks like.
    pub fn forget(&mut self) {
        self.surfaces = Arc::default();
        self.probe = SurfaceScan::default();
        self.horizons = Vec::new();
    }

    /// Whether it was forgotten, or never showed anything.
    #[must_use]
    pub fn is_forgotten(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// Whether a point of the submap's frame (metres) was in view.
    #[must_use]
    pub fn had_in_view(&self, point_m: [f32; 2]) -> bool {
        self.horizons.iter().any(|horizon| horizon.reaches(point_m, VIEW_TOLERANCE_M))
    }
}

impl KeyScan {
    /// What it had in view, in the frame of a pose.
    fn horizon_from(&self, pose: &Pose2) -> Horizon {
        self.scan.horizon(&pose.between(&self.pose))
    }
}

/// A surface on which rays end is in view although they end a little before it, metres.
const VIEW_TOLERANCE_M: f32 = 0.2;

/// A covariance over (x, y, θ) in the world's axes, turned into the axes of a pose.
pub(super) fn in_frame_of(covariance: &Matrix3<f64>, pose: &Pose2) -> Matrix3<f64> {
    let (sin, cos) = pose.theta.sin_cos();
    let turn = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
    turn * covariance * turn.transpose()
}
