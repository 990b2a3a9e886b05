//! The occupancy grid of key scans at poses that change: only what changed is drawn again.
//!
//! A cell's log-odds are bounded, so that the order of the scans matters and a scan cannot be taken back. What can be
//! done is to forget whole tiles and to draw on them, in the old order, all scans that reach them: the grid is then to
//! the bit the one that is drawn from nothing.

use crate::compact_scan::CompactScan;
use crate::frame::BodyScan;
use crate::geometry::Pose2;
use crate::map::{Cell, MapConfig, OccupancyGrid, TileRectangle};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// A scan is drawn again when its points moved by more than this share of a cell.
const MOVED_CELLS: f64 = 0.25;

/// A scan that is to be drawn: number of its frame, points, pose (world from body).
pub type RenderedScan<'a> = (usize, &'a CompactScan, Pose2);

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
    frame: usize,
    pose: Pose2,
    reach_m: f64,
    tiles: TileRectangle,
}

impl Drawn {
    fn of(frame: usize, scan: &BodyScan, pose: &Pose2, grid: &OccupancyGrid) -> Self {
        Self { frame, pose: *pose, reach_m: scan.reach_m(), tiles: grid.tiles_around(pose, scan) }
    }
}

impl Renderer {
    /// Nothing drawn yet.
    #[must_use]
    pub fn new(config: &MapConfig) -> Self {
        Self { config: config.clone(), grid: OccupancyGrid::new(config), drawn: Vec::new() }
    }

    /// The grid of `scans`: number of the frame, ascending, points, pose (world from body). Of those that were drawn
    /// before the ones that moved by less than a quarter of a cell stay where they were; new ones come after them.
    pub fn draw(&mut self, scans: &[RenderedScan<'_>]) -> &OccupancyGrid {
        let stale = self.follow(scans);
        if !stale.is_empty() {
            self.draw_again(&stale, scans);
        }
        if self.drawn.is_empty() && rayon::current_num_threads() > 1 {
            self.draw_all(scans);
        }
        for (frame, scan, pose) in scans.iter().skip(self.drawn.len()) {
            let scan = scan.unpack();
            self.grid.draw_scan(pose, &scan);
            self.drawn.push(Drawn::of(*frame, &scan, pose, &self.grid));
        }
        &self.grid
    }

    /// Forgets scans that are there no more, and moves those that moved; gives the tiles that are to be drawn anew. Where
    /// that would be most of the work everything is forgotten.
    fn follow(&mut self, scans: &[RenderedScan<'_>]) -> BTreeSet<Cell> {
        let mut stale = BTreeSet::new();
        let mut rest = scans.iter().peekable();
        let mut kept = Vec::with_capacity(self.drawn.len());
        let (before, mut changed) = (self.drawn.len(), 0);
        for mut drawn in std::mem::take(&mut self.drawn) {
            let Some((_, scan, pose)) = rest.next_if(|(frame, ..)| *frame == drawn.frame) else {
                stale.extend(drawn.tiles.iter());
                changed += 1;
                continue;
            };
            let step = drawn.pose.between(pose);
            if step.distance() + step.theta.abs() * drawn.reach_m > MOVED_CELLS * self.config.resolution_m {
                stale.extend(drawn.tiles.iter());
                drawn = Drawn::of(drawn.frame, &scan.unpack(), pose, &self.grid);
                stale.extend(drawn.tiles.iter());
                changed += 1;
            }
            kept.push(drawn);
        }
        let is_in_order = kept.iter().zip(scans).all(|(drawn, (frame, ..))| drawn.frame == *frame);
        if 2 * changed > before || !is_in_order {
            self.grid = OccupancyGrid::new(&self.config);
            return BTreeSet::new();
        }
        self.drawn = kept;
        stale
    }

    /// Draws scans on the empty grid on several cores.
    fn draw_all(&mut self, scans: &[RenderedScan<'_>]) {
        let grid = &self.grid;
        let drawn = |(frame, scan, pose): &RenderedScan<'_>| Drawn::of(*frame, &scan.unpack(), pose, grid);
        self.drawn = scans.par_iter().map(drawn).collect();
        let scans: Vec<_> = scans.iter().map(|&(_, scan, pose)| (scan, pose)).collect();
        let reached: Vec<_> = self.drawn.iter().map(|drawn| drawn.tiles).collect();
        self.grid.draw_scans(&scans, &reached);
    }

    /// What was drawn last.
    #[must_use]
    pub fn into_grid(self) -> OccupancyGrid {
        self.grid
    }

    /// Draws on tiles, which are forgotten first, all scans that reach them.
    fn draw_again(&mut self, stale: &BTreeSet<Cell>, scans: &[RenderedScan<'_>]) {
        self.grid.forget(stale);
        for (drawn, (_, scan, _)) in self.drawn.iter().zip(scans) {
            if drawn.tiles.iter().any(|tile| stale.contains(&tile)) {
                self.grid.draw_scan_within(&drawn.pose, &scan.unpack(), stale);
            }
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
        let scans: Vec<RenderedScan<'_>> =
            scans.iter().zip(&poses).enumerate().map(|(frame, (scan, pose))| (frame, scan, *pose)).collect();
        let drawn = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut renderer = Renderer::new(&MapConfig::default());
                renderer.draw(&scans).seen_cells().collect::<Vec<_>>()
            })
        };
        let one = drawn(1);
        assert!(one.len() > 1000);
        assert_eq!(one, drawn(2));
        assert_eq!(one, drawn(7));
    }

    #[test]
    fn what_moved_and_what_is_gone_is_drawn_as_from_nothing() {
        let mut poses = poses_along(&[[-1.5, -1.0], [1.5, -1.0], [1.5, 1.0]], 0.1);
        let scans: Vec<_> = poses.iter().map(|pose| CompactScan::new(&Walls::room().scan_from(pose, 361))).collect();
        let rendered = |poses: &[Pose2], frames: &[usize]| -> Vec<(usize, usize, Pose2)> {
            frames.iter().map(|&frame| (frame, frame, poses[frame])).collect()
        };
        let draw = |renderer: &mut Renderer, of: Vec<(usize, usize, Pose2)>| {
            let of: Vec<RenderedScan<'_>> = of.iter().map(|&(frame, scan, pose)| (frame, &scans[scan], pose)).collect();
            renderer.draw(&of).seen_cells().collect::<Vec<_>>()
        };
        let all: Vec<usize> = (0..scans.len()).collect();
        let mut renderer = Renderer::new(&MapConfig::default());
        let first = draw(&mut renderer, rendered(&poses, &all[..30]));
        // Some are gone, one moved, others came.
        let kept: Vec<usize> = all.iter().copied().filter(|frame| !(5..9).contains(frame) && *frame != 29).collect();
        poses[12] = poses[12].compose(&Pose2::new(0.1, 0.2, 0.3));
        let followed = draw(&mut renderer, rendered(&poses, &kept));
        let anew = draw(&mut Renderer::new(&MapConfig::default()), rendered(&poses, &kept));
        assert_eq!(followed, anew);
        assert_ne!(followed, first);
        // One that comes back in the middle has all drawn anew.
        assert_eq!(
            draw(&mut renderer, rendered(&poses, &all)),
            draw(&mut Renderer::new(&MapConfig::default()), rendered(&poses, &all))
        );
    }
}
