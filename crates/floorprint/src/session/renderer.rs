//! The occupancy grid of key scans at poses that change: only what changed is drawn again.
//!
//! A cell's log-odds are bounded, so that the order of the scans matters and a scan cannot be taken back. What can be
//! done is to forget whole tiles and to draw on them, in the old order, all scans that reach them: the grid is then to
//! the bit the one that is drawn from nothing.

use crate::compact_scan::CompactScan;
use crate::frame::BodyScan;
use crate::geometry::Pose2;
use crate::map::{MapConfig, OccupancyGrid, TileRectangle};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// A scan is drawn again when its points moved by more than this share of a cell.
const MOVED_CELLS: f64 = 0.25;

/// An occupancy grid that follows its scans.
#[derive(Debug, Clone)]
pub struct Renderer {
    config: MapConfig,
    grid: OccupancyGrid,
    drawn: Vec<Drawn>,
}

/// Where a scan was drawn, and the tiles that it may have touched.
#[derive(Debug, Clone)]
struct Drawn {
    pose: Pose2,
    reach_m: f64,
    tiles: TileRectangle,
}

impl Drawn {
    fn of(scan: &BodyScan, pose: &Pose2, grid: &OccupancyGrid) -> Self {
        Self { pose: *pose, reach_m: scan.reach_m(), tiles: grid.tiles_around(pose, scan) }
    }
}

impl Renderer {
    /// Nothing drawn yet.
    #[must_use]
    pub fn new(config: &MapConfig) -> Self {
        Self { config: config.clone(), grid: OccupancyGrid::new(config), drawn: Vec::new() }
    }

    /// The grid of `scans` at `poses` (world from body), one for each; scans that were drawn before are the same
    /// ones, in the same order. Those that moved by less than a quarter of a cell stay where they were.
    pub fn draw(&mut self, scans: &[&CompactScan], poses: &[Pose2]) -> &OccupancyGrid {
        let moved = |(drawn, pose): (&Drawn, &Pose2)| {
            let step = drawn.pose.between(pose);
            step.distance() + step.theta.abs() * drawn.reach_m > MOVED_CELLS * self.config.resolution_m
        };
        let moved: Vec<usize> =
            (0..self.drawn.len().min(poses.len())).filter(|&scan| moved((&self.drawn[scan], &poses[scan]))).collect();
        if 2 * moved.len() > self.drawn.len() || self.drawn.len() > scans.len() {
            (self.grid, self.drawn) = (OccupancyGrid::new(&self.config), Vec::new());
        } else if !moved.is_empty() {
            self.draw_again(&moved, scans, poses);
        }
        if self.drawn.is_empty() && rayon::current_num_threads() > 1 {
            self.draw_all(scans, poses);
        }
        for (scan, pose) in scans.iter().zip(poses).skip(self.drawn.len()) {
            let scan = scan.unpack();
            self.grid.draw_scan(pose, &scan);
            self.drawn.push(Drawn::of(&scan, pose, &self.grid));
        }
        &self.grid
    }

    /// Draws scans on the empty grid on several cores.
    fn draw_all(&mut self, scans: &[&CompactScan], poses: &[Pose2]) {
        let grid = &self.grid;
        self.drawn = scans.par_iter().zip(poses).map(|(scan, pose)| Drawn::of(&scan.unpack(), pose, grid)).collect();
        let scans: Vec<_> = scans.iter().copied().zip(poses.iter().copied()).collect();
        let reached: Vec<_> = self.drawn.iter().map(|drawn| drawn.tiles).collect();
        self.grid.draw_scans(&scans, &reached);
    }

    /// What was drawn last.
    #[must_use]
    pub fn into_grid(self) -> OccupancyGrid {
        self.grid
    }

    /// Forgets the tiles that scans touched or touch, and draws on those all scans that reach them.
    fn draw_again(&mut self, moved: &[usize], scans: &[&CompactScan], poses: &[Pose2]) {
        let mut stale = BTreeSet::new();
        for &index in moved {
            stale.extend(self.drawn[index].tiles.iter());
            let scan = scans[index].unpack();
            let drawn = &mut self.drawn[index];
            (drawn.pose, drawn.tiles) = (poses[index], self.grid.tiles_around(&poses[index], &scan));
            stale.extend(drawn.tiles.iter());
        }
        self.grid.forget(&stale);
        for (drawn, scan) in
            self.drawn.iter().zip(scans).filter(|(drawn, _)| drawn.tiles.iter().any(|tile| stale.contains(&tile)))
        {
            self.grid.draw_scan_within(&drawn.pose, &scan.unpack(), &stale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::{Walls, poses_along};

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let poses = poses_along(&[[-1.5, -1.0], [1.5, -1.0], [1.5, 1.0]], 0.1);
        let scans: Vec<_> = poses.iter().map(|pose| CompactScan::new(&Walls::room().scan_from(pose, 361))).collect();
        let scans: Vec<&CompactScan> = scans.iter().collect();
        let drawn = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut renderer = Renderer::new(&MapConfig::default());
                renderer.draw(&scans, &poses).seen_cells().collect::<Vec<_>>()
            })
        };
        let one = drawn(1);
        assert!(one.len() > 1000);
        assert_eq!(one, drawn(2));
        assert_eq!(one, drawn(7));
    }
}
