//! Submaps: pieces of a drive short enough to be right in themselves (Hess et al. 2016).

use super::Look;
use super::hypothesis::Attached;
use crate::geometry::Pose2;
use crate::geometry::covariance::in_frame_of;
use crate::key_scan::{Drift, Interruption, KeyScan};
use crate::storage::{Part, Shelf};
use crate::surface::SurfaceScan;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What consecutive key scans saw, in the frame of the first of them.
#[derive(Debug, Clone, Serialize, Deserialize)]
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
    /// What constraints it to the submap before; `None` for the first.
    pub link: Option<Link>,
    /// Where the robot may have been carried here from elsewhere.
    pub interruption: Option<Interruption>,
    /// Whether it shows nothing that older ones do not; later ones are then compared with those.
    pub is_known: bool,
    /// The older submap that shows what this one shows, where that is known.
    #[serde(default)]
    pub shown_by: Option<usize>,
    /// Of the submaps that show only what this one shows those whose key scans are kept, the oldest first.
    #[serde(default)]
    pub passes: Vec<usize>,
    /// Where it lies, once all hypotheses have it on the same older submap and its key scans are forgotten.
    #[serde(default)]
    pub(super) attached: Option<Attached>,
    /// Whether what it looks like was forgotten since.
    pub is_forgotten: bool,
    /// What it looks like, packed; `None` where that was forgotten, or it never showed anything.
    #[serde(skip)]
    pub(super) look: Option<Part>,
}

/// The motion from the start of one submap to the start of the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// The newer submap's pose in the older's frame.
    pub previous_from_submap: Pose2,
    /// What the matches on the way leave in uncertainty, over (x, y, θ) in the axes of the newer submap.
    pub covariance: Matrix3<f64>,
    /// By how much the motion may be off beyond that.
    #[serde(default)]
    pub drift: Drift,
    /// What of that comes after the last key scan of the older submap.
    #[serde(default)]
    pub drift_after: Drift,
    /// Length of the path, metres.
    pub path_m: f64,
}

/// Cuts a drive into submaps as it goes on.
#[derive(Debug, Clone, Serialize, Deserialize)]
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
    /// Sum of the drift since then.
    #[serde(default)]
    drift: Drift,
}

impl SubmapBuilder {
    /// Submaps of `length_m` of path, with surfaces kept in cells of `cell_m`; metres.
    #[must_use]
    pub fn new(length_m: f64, cell_m: f64) -> Self {
        Self {
            length_m,
            cell_m,
            open: Vec::new(),
            start_m: 0.0,
            path_m: 0.0,
            link: None,
            covariance: Matrix3::zeros(),
            drift: Drift::default(),
        }
    }

    /// Takes the next key scan; gives the submap that ends before it.
    ///
    /// `poses_since(frame)` are the front end's poses from that frame on, as they are now: which
    /// particle is the best may have changed since the key scans were taken.
    pub fn add(&mut self, mut key_scan: KeyScan, poses_since: impl FnOnce(usize) -> Vec<Pose2>) -> Option<Submap> {
        let step_m = self.open.last().map_or(0.0, |last| last.pose.between(&key_scan.pose).distance());
        self.path_m += step_m;
        self.covariance += key_scan.covariance;
        self.drift.add(&key_scan.drift);
        // A suspicion soon after another or a loss is none of its own: what has been seen since is too little to decide it by.
        if self.interruption().is_some() {
            key_scan.interruption = key_scan.interruption.filter(|at| !at.is_suspicion);
        }
        let ends = key_scan.interruption.is_some() || self.path_m - self.start_m > self.length_m;
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
            drift: std::mem::take(&mut self.drift),
            drift_after: next.drift,
            covariance: in_frame_of(&std::mem::take(&mut self.covariance), &next.pose),
            path_m: (self.path_m - self.start_m).max(start_m - self.start_m),
        });
        self.start_m = self.path_m;
        self.open.push(next);
        Some(submap)
    }

    /// The frame with which the submap in the making begins; `None` before the first key scan.
    #[must_use]
    pub fn first_frame(&self) -> Option<usize> {
        self.open.first().map(|first| first.frame)
    }

    /// What led to the first key scan of the submap in the making, if there is one and it is not the first of the drive.
    pub(super) fn link(&self) -> Option<&Link> {
        self.link.as_ref().filter(|_| !self.open.is_empty())
    }

    /// Covariance of the motion since the first key scan of the submap in the making.
    pub(super) fn covariance(&self) -> &Matrix3<f64> {
        &self.covariance
    }

    /// By how much that motion may be off beyond it.
    pub(super) fn drift(&self) -> &Drift {
        &self.drift
    }

    /// Side of the cells in which surfaces are kept, metres.
    pub(super) fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// The key scans of the submap in the making.
    pub(super) fn open_mut(&mut self) -> &mut [KeyScan] {
        &mut self.open
    }

    /// Whether its numbers can be those of a drive of so many frames.
    pub(super) fn is_valid(&self, frames: usize) -> bool {
        let is_length = |length_m: f64| length_m > 0.0 && length_m.is_finite();
        is_length(self.length_m)
            && is_length(self.cell_m)
            && self.open.iter().all(|scan| scan.frame < frames && scan.pose.is_finite())
            && self.open.is_sorted_by(|a, b| a.frame < b.frame)
    }

    /// Where the robot may have been kidnapped right before the submap in the making.
    #[must_use]
    pub fn interruption(&self) -> Option<Interruption> {
        self.open.first().and_then(|first| first.interruption)
    }

    /// The last submap, if any key scan is left.
    #[must_use]
    pub fn finish(&mut self) -> Option<Submap> {
        self.close()
    }

    /// Makes a submap of the open key scans.
    fn close(&mut self) -> Option<Submap> {
        let key_scans = std::mem::take(&mut self.open);
        let first = key_scans.first()?;
        let half_way = &key_scans[key_scans.len() / 2];
        let middle = first.pose.between(&half_way.pose);
        let mut submap = Submap {
            first: first.frame,
            middle_frame: half_way.frame,
            front_end_from_submap: first.pose,
            middle,
            path_m: self.start_m,
            link: self.link,
            interruption: first.interruption,
            is_known: false,
            shown_by: None,
            passes: Vec::new(),
            attached: None,
            is_forgotten: false,
            look: None,
        };
        let scans: Vec<(Pose2, &SurfaceScan)> =
            key_scans.iter().map(|scan| (first.pose.between(&scan.pose), scan.scan.as_ref())).collect();
        submap.show(&scans, self.cell_m);
        Some(submap)
    }
}

impl Submap {
    /// Learns what it looks like: what each of its key scans shows, from its pose in the submap's frame. Surfaces are
    /// kept in cells of `cell_m`, metres.
    pub fn show(&mut self, key_scans: &[(Pose2, &SurfaceScan)], cell_m: f64) {
        let look = Look::of(key_scans, [self.middle.x, self.middle.y], cell_m);
        self.look = (!look.surfaces.is_empty()).then(|| Part::new(look.pack()));
    }

    /// Forgets what it looks like.
    pub fn forget(&mut self) {
        self.is_forgotten = true;
        self.look = None;
    }

    /// Whether it was forgotten, or never showed anything.
    #[must_use]
    pub fn is_forgotten(&self) -> bool {
        self.look.is_none()
    }

    /// What it looks like; nothing where that was forgotten.
    #[must_use]
    pub fn look(&self) -> Look {
        self.look.as_ref().and_then(|look| Look::unpack(&look.bytes())).unwrap_or_default()
    }

    /// Lays what it looks like on a shelf.
    pub(crate) fn lay_on(&self, shelf: &Arc<Shelf>) {
        self.look.iter().for_each(|look| look.lay_on(shelf));
    }

    /// Bytes that it holds, beside itself.
    pub(super) fn held_bytes(&self) -> usize {
        self.look.as_ref().map_or(0, Part::held_bytes)
    }
}
