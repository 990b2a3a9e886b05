//! The map that the next scan is matched against: what the last stretch of the drive showed.

use crate::geometry::Pose2;
use crate::scan_matcher::MatcherConfig;
use crate::surface::{Horizon, SurfaceMap, SurfaceScan};
use std::collections::VecDeque;
use std::sync::Arc;

/// The path that the map remembers is at least so many times as long as the robot sees: where it sees far, as in the open,
/// what it sees now it saw for as long.
const LEAST_VIEWS: f64 = 2.0;

/// What so many of the newest scans had in view is no news.
const VIEWS: usize = 8;

/// Surfaces of the last so many metres; older places are for the back end to recognise.
#[derive(Debug, Clone)]
pub(super) struct LocalMap {
    surfaces: SurfaceMap,
    cell_m: f64,
    /// Length of the path that it remembers, between half of it and all of it, metres; unlimited where loops are not closed.
    window_m: f64,
    /// The scans that it is made of with their poses, where it is to forget older ones.
    written: VecDeque<Written>,
    /// Path since the oldest scan in it, metres.
    path_m: f64,
    /// Where the last scan was written.
    last_written: Option<Pose2>,
}

/// A scan in the map.
#[derive(Debug, Clone)]
struct Written {
    pose: Pose2,
    scan: Arc<SurfaceScan>,
    /// How far it sees, metres.
    view_m: f64,
}

impl LocalMap {
    pub(super) fn new(cell_m: f64, window_m: f64) -> Self {
        let surfaces = SurfaceMap::new(cell_m);
        Self { surfaces, cell_m, window_m, written: VecDeque::new(), path_m: 0.0, last_written: None }
    }

    pub(super) fn surfaces(&self) -> &SurfaceMap {
        &self.surfaces
    }

    /// The scan that was written last, with its pose; `None` where scans are not kept.
    pub(super) fn last(&self) -> Option<(&Pose2, &SurfaceScan)> {
        self.written.back().map(|last| (&last.pose, last.scan.as_ref()))
    }

    /// What of a scan at a pose its newest scans had in view.
    pub(super) fn had_in_view(&self, pose: &Pose2, scan: &SurfaceScan) -> SurfaceScan {
        let to_map = pose.point_transform();
        let views: Vec<Horizon> = self.written.iter().rev().take(VIEWS).map(|w| w.scan.horizon(&w.pose)).collect();
        scan.filtered(|point| {
            let point = to_map(point.map(f64::from)).map(|coordinate| coordinate as f32);
            views.iter().any(|view| view.reaches(point, 0.0))
        })
    }

    /// How many scans it is made of, where they are kept.
    pub(super) fn scans(&self) -> usize {
        self.written.len()
    }

    /// The poses of the scans that it is made of, the oldest first.
    pub(super) fn poses(&self) -> impl Iterator<Item = Pose2> {
        self.written.iter().map(|written| written.pose)
    }

    /// Whether the robot moved far enough since the last scan that was written.
    pub(super) fn is_due(&self, pose: &Pose2, matcher: &MatcherConfig) -> bool {
        self.last_written.is_none_or(|last| {
            let moved = last.between(pose);
            moved.distance() > matcher.insert_distance_m || moved.theta.abs() > matcher.insert_angle_rad
        })
    }

    /// The map that these scans make, the oldest first, of a drive that goes on.
    pub(super) fn of(cell_m: f64, window_m: f64, scans: impl Iterator<Item = (Pose2, Arc<SurfaceScan>)>) -> Self {
        let mut map = Self::new(cell_m, f64::INFINITY);
        map.window_m = window_m;
        for (pose, scan) in scans {
            map.surfaces.add_scan(&pose, &scan);
            map.path_m += map.last_written.map_or(0.0, |last| last.between(&pose).distance());
            map.last_written = Some(pose);
            map.written.push_back(Written { pose, view_m: scan.view_m(), scan });
        }
        map
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.cell_m, self.window_m);
    }

    /// Writes a scan that sees as far as `view_m`; with `carve` it clears what is no longer there. A map that has grown too
    /// long a past is made anew from the younger half of it.
    pub(super) fn write(&mut self, pose: &Pose2, scan: &Arc<SurfaceScan>, view_m: f64, carve: bool) {
        if carve {
            self.surfaces.carve(pose, scan);
        }
        self.surfaces.add_scan(pose, scan);
        self.path_m += self.last_written.map_or(0.0, |last| last.between(pose).distance());
        self.last_written = Some(*pose);
        if self.window_m.is_infinite() {
            return;
        }
        self.written.push_back(Written { pose: *pose, scan: Arc::clone(scan), view_m });
        let window_m = self.window_m.max(LEAST_VIEWS * self.mean_view_m());
        if self.path_m > window_m {
            while self.path_m > 0.5 * window_m && self.written.len() > 1 {
                let Some(oldest) = self.written.pop_front() else { break };
                self.path_m -= oldest.pose.between(&self.written[0].pose).distance();
            }
            self.surfaces = SurfaceMap::new(self.cell_m);
            for Written { pose, scan, .. } in &self.written {
                self.surfaces.add_scan(pose, scan);
            }
        }
    }

    /// How far its scans see, metres.
    fn mean_view_m(&self) -> f64 {
        self.written.iter().map(|written| written.view_m).sum::<f64>() / self.written.len().max(1) as f64
    }

    #[cfg(test)]
    pub(super) fn size(&self) -> (f64, usize, usize, usize) {
        (self.path_m, self.surfaces.tile_counts().0, self.surfaces.surfaces().count(), self.written.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use crate::surface::Thinning;

    /// The longest path that a map with a window of 10 m remembers of 60 m to and fro within walls that are `half_m` off.
    fn longest_path_m(half_m: f64) -> f64 {
        let walls = Walls::default().with_box([0.0, 0.0], [half_m, half_m]);
        let mut map = LocalMap::new(MatcherConfig::default().cell_m, 10.0);
        let remembered_m = (0..120).map(|step| {
            let pose = Pose2::new(0.5 * f64::from(step % 2), 0.0, 0.0);
            let scan = Arc::new(SurfaceScan::new(&walls.scan_from(&pose, 361), &Thinning::default()));
            map.write(&pose, &scan, scan.view_m(), false);
            map.size().0
        });
        remembered_m.fold(0.0, f64::max)
    }

    #[test]
    fn where_the_robot_sees_far_the_map_remembers_longer() {
        let [in_a_room, in_the_open] = [longest_path_m(2.0), longest_path_m(20.0)];
        assert!((9.0..=10.0).contains(&in_a_room), "{in_a_room} m");
        assert!((40.0..=56.0).contains(&in_the_open), "{in_the_open} m");
    }

    #[test]
    fn what_lies_behind_a_wall_was_not_in_view() {
        let (walls, matcher) = (Walls::default().with_box([0.0, 0.0], [2.0, 2.0]), MatcherConfig::default());
        let scan_of =
            |walls: &Walls| Arc::new(SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 361), &matcher.thinning()));
        let mut map = LocalMap::new(matcher.cell_m, 20.0);
        map.write(&Pose2::IDENTITY, &scan_of(&walls), 2.0, false);
        let [nearer, farther] =
            [1.5, 3.0].map(|half_m| scan_of(&Walls::default().with_box([0.0, 0.0], [half_m, half_m])));
        assert_eq!(map.had_in_view(&Pose2::IDENTITY, &nearer).len(), nearer.len());
        assert!(map.had_in_view(&Pose2::IDENTITY, &farther).is_empty());
    }
}
