//! Submaps: pieces of a drive short enough to be right in themselves.

use super::KeyScan;
use crate::geometry::Pose2;
use crate::map::SurfaceMap;
use crate::scan_matcher::SurfaceScan;
use std::ops::Range;

/// Consecutive key scans, in the frame of the first of them.
#[derive(Debug, Clone)]
pub struct Submap {
    /// Which key scans.
    pub key_scans: Range<usize>,
    /// Pose of the first key scan as the front end had it: front end's world from submap.
    pub front_end_from_submap: Pose2,
    /// Pose of the key scan half way, in the submap's frame.
    pub middle: Pose2,
    /// Path from the start of the drive to the start of the submap, metres.
    pub path_m: f64,
}

impl Submap {
    /// Cuts a drive into submaps of `length_m` of path.
    #[must_use]
    pub fn cut(key_scans: &[KeyScan], length_m: f64) -> Vec<Self> {
        let mut submaps = Vec::new();
        let (mut first, mut path_m, mut start_m) = (0, 0.0, 0.0);
        for (index, scan) in key_scans.iter().enumerate() {
            let next_m = key_scans
                .get(index + 1)
                .map_or(f64::INFINITY, |next| path_m + scan.pose.between(&next.pose).distance());
            if next_m - start_m > length_m {
                submaps.push(Self::new(key_scans, first..index + 1, start_m));
                (first, start_m) = (index + 1, next_m);
            }
            path_m = next_m;
        }
        submaps
    }

    fn new(key_scans: &[KeyScan], range: Range<usize>, path_m: f64) -> Self {
        let front_end_from_submap = key_scans[range.start].pose;
        let mut submap = Self { key_scans: range, front_end_from_submap, middle: Pose2::IDENTITY, path_m };
        submap.middle = front_end_from_submap.between(&key_scans[submap.middle_key_scan()].pose);
        submap
    }

    /// The key scan half-way through the submap.
    #[must_use]
    pub fn middle_key_scan(&self) -> usize {
        self.key_scans.start + self.key_scans.len() / 2
    }

    /// All that the submap's key scans saw, as if it were one scan taken from its middle; in its frame.
    #[must_use]
    pub fn as_one_scan(&self, key_scans: &[KeyScan], cell_m: f64) -> SurfaceScan {
        let mut map = SurfaceMap::new(cell_m);
        for scan in &key_scans[self.key_scans.clone()] {
            map.add_scan(&self.front_end_from_submap.between(&scan.pose), &scan.scan);
        }
        SurfaceScan::from_surfaces([self.middle.x, self.middle.y], map.surfaces())
    }
}
