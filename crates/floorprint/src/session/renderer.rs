//! The occupancy grid of key scans at poses that change: only what changed is drawn again.
//!
//! A cell's log-odds are bounded, so that the order of the scans matters and a scan cannot be taken back. What can be
//! done is to forget whole tiles and to draw on them, in the old order, all scans that reach them: the grid is then to
//! the bit the one that is drawn from nothing.

use crate::compact_scan::CompactScan;
use crate::geometry::Pose2;
use crate::map::{MapConfig, OccupancyGrid, TileRectangle};
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
        for (scan, pose) in scans.iter().zip(poses).skip(self.drawn.len()) {
            let scan = scan.unpack();
            self.grid.draw_scan(pose, &scan);
            let (reach_m, tiles) = (scan.reach_m(), self.grid.tiles_around(pose, &scan));
            self.drawn.push(Drawn { pose: *pose, reach_m, tiles });
        }
        &self.grid
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
