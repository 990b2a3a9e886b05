//! The places in a whole map at which points may have been seen, best first, found in slices.
//!
//! Branch and bound over a pyramid of grids (Olson 2015; Hess et al. 2016), best first: at any moment the best block that
//! is still open bounds the score of everything that was not proposed yet.

use super::localization_map::LocalizationMap;
use crate::geometry::{Pose2, wrap_angle};
use crate::map::Occupancy;
use crate::scan_matcher::Grid;
use rayon::prelude::*;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

/// Side of a cell of the finest grid, metres, unless the map's own cells are larger: also the step of the search.
const CELL_M: f64 = 0.1;
/// Cells of the longer side at most: offsets are counted in two bytes.
const MOST_CELLS: f64 = 30_000.0;
/// Base-2 logarithm of the side, in cells, of the largest block of offsets.
const TOP_LEVEL: u8 = 5;
/// Up to this level bounds are exact.
const EXACT_LEVELS: u8 = 3;
/// Value of a cell that holds a surface, and of those next to one.
const ON_SURFACE: u8 = 4;
const NEAR_SURFACE: u8 = 3;
const AT_CORNER: u8 = 2;
/// Bounds of the step in heading, radians.
const STEP_RAD: [f64; 2] = [0.01, 0.05];
/// The step in heading moves a point that is farther away than three quarters of the others by a cell.
const FAR_QUANTILE: f64 = 0.75;
/// Places nearer to each other than this count as one, metres and radians.
const SAME_PLACE_M: f64 = 0.5;
const SAME_PLACE_RAD: f64 = 0.2;
/// The robot may stand so far outside what the map knows to be free, metres.
const OUTSIDE_M: f64 = 0.2;

/// A place where points may have been seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Proposal {
    /// In the grid's frame.
    pub(super) pose: Pose2,
    /// Mean value of the points, from 0 to 1.
    pub(super) score: f64,
}

/// What is searched in: grids of which each holds the largest values of the one below.
#[derive(Debug, Clone)]
pub(super) struct SearchPyramid {
    cell_m: f64,
    levels: Vec<Grid>,
    /// For each level the blocks in which the robot can be.
    free: Vec<Grid>,
}

impl SearchPyramid {
    /// The pyramid of a map.
    pub(super) fn new(map: &LocalizationMap) -> Self {
        let [columns, rows] = map.size();
        let longest_m = columns.max(rows) as f64 * map.resolution_m();
        let cell_m = CELL_M.max(map.resolution_m()).max(longest_m / MOST_CELLS);
        let per_cell = map.resolution_m() / cell_m;
        let cell = |at: usize| ((at as f64 + 0.5) * per_cell) as i32;
        // Blocks of offsets that begin before the first surface may reach it.
        let rim = 1 << TOP_LEVEL;
        let size = [columns, rows].map(|count| cell(count) + 2);
        let mut finest = Grid::new(size[0] + rim, size[1] + rim);
        let mut free = Grid::new(size[0], size[1]);
        let outside = (OUTSIDE_M / cell_m).ceil() as i32;
        for (index, occupancy) in map.cells().iter().enumerate() {
            let (x, y) = (cell(index % columns), cell(index / columns));
            match occupancy {
                Occupancy::Occupied => {
                    for (dx, dy) in [(-1, -1), (1, -1), (-1, 1), (1, 1)] {
                        finest.raise(x + rim + dx, y + rim + dy, AT_CORNER);
                    }
                    for (dx, dy) in [(0, -1), (-1, 0), (1, 0), (0, 1)] {
                        finest.raise(x + rim + dx, y + rim + dy, NEAR_SURFACE);
                    }
                    finest.raise(x + rim, y + rim, ON_SURFACE);
                }
                Occupancy::Free => {
                    for dy in -outside..=outside {
                        for dx in -outside..=outside {
                            free.raise(x + dx, y + dy, 1);
                        }
                    }
                }
                Occupancy::Unknown => {}
            }
        }
        let mut levels = vec![finest.clone()];
        let mut free_levels = vec![free.clone()];
        // Pooled without overlap each level follows from the one before; a block of offsets straddles two cells a side.
        // Small blocks, of which there are many, have exact bounds: there each cell stands for the block that begins at it.
        for level in 1..=TOP_LEVEL {
            let begins_anywhere = levels[usize::from(level) - 1].widened(1 << (level - 1));
            finest = finest.halved();
            levels.push(if level <= EXACT_LEVELS { begins_anywhere } else { finest.widened(1) });
            free = free.halved();
            free_levels.push(free.clone());
        }
        Self { cell_m, levels, free: free_levels }
    }
}

/// A block of offsets at one heading. Ordered by its bound, then finer ones first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Block {
    bound: u16,
    fineness: u8,
    heading: u16,
    y: i16,
    x: i16,
}

impl Block {
    fn level(&self) -> u8 {
        TOP_LEVEL - self.fineness
    }
}

/// A search that goes on from slice to slice.
#[derive(Debug, Clone)]
pub(super) struct GlobalSearch {
    /// For each heading the points' cells.
    rotated: Vec<Vec<[i16; 2]>>,
    step_rad: f64,
    full_score: f64,
    open: BinaryHeap<Block>,
    found: Vec<Proposal>,
    /// Places that score less than the best by more than this are not proposed.
    margin: f64,
    most: usize,
    blocks_left: usize,
}

impl GlobalSearch {
    /// A search for points (metres, in the body's frame). At most `most` places are proposed, those that score no more
    /// than `margin` less than the best, and no more than `max_blocks` are looked at.
    pub(super) fn new(
        pyramid: &SearchPyramid,
        points: &[[f32; 2]],
        margin: f64,
        most: usize,
        max_blocks: usize,
    ) -> Self {
        let mut distances_m: Vec<f64> = points.iter().map(|[x, y]| f64::from(x.hypot(*y))).collect();
        distances_m.sort_by(f64::total_cmp);
        let far_m = distances_m.get((FAR_QUANTILE * distances_m.len() as f64) as usize).copied().unwrap_or(1.0);
        let step_rad = (pyramid.cell_m / far_m.max(0.1)).clamp(STEP_RAD[0], STEP_RAD[1]);
        let headings = (TAU / step_rad).ceil() as usize;
        let step_rad = TAU / headings as f64;
        let rotated: Vec<Vec<[i16; 2]>> = (0..headings)
            .into_par_iter()
            .map(|heading| {
                let (sin, cos) = (heading as f64 * step_rad).sin_cos();
                let cell = |v: f64| (v / pyramid.cell_m + 0.5).floor() as i16;
                let turn = |[x, y]: &[f32; 2]| {
                    let (x, y) = (f64::from(*x), f64::from(*y));
                    [cell(cos * x - sin * y), cell(sin * x + cos * y)]
                };
                points.iter().map(turn).collect()
            })
            .collect();
        let side = 1 << TOP_LEVEL;
        let free = &pyramid.free[usize::from(TOP_LEVEL)];
        let roots: Vec<[i16; 2]> = (0..free.rows)
            .flat_map(|y| (0..free.columns).map(move |x| (x, y)))
            .filter(|&(x, y)| free.at(x, y) > 0)
            .map(|(x, y)| [(x * side) as i16, (y * side) as i16])
            .collect();
        let blocks: Vec<Block> = rotated
            .par_iter()
            .enumerate()
            .flat_map_iter(|(heading, cells)| {
                roots.iter().map(move |&[x, y]| Block {
                    bound: bound(pyramid, cells, TOP_LEVEL, x, y),
                    fineness: 0,
                    heading: heading as u16,
                    y,
                    x,
                })
            })
            .collect();
        Self {
            full_score: f64::from(ON_SURFACE) * points.len().max(1) as f64,
            open: blocks.into(),
            rotated,
            step_rad,
            found: Vec::new(),
            margin,
            most,
            blocks_left: max_blocks,
        }
    }

    /// Goes on for up to `blocks`; whether the search is over then.
    pub(super) fn work(&mut self, pyramid: &SearchPyramid, blocks: usize) -> bool {
        for _ in 0..blocks {
            let Some(block) = self.open.peek().copied() else { return true };
            let best = self.found.first().map_or(0.0, |best| best.score);
            let least = (best - self.margin) * self.full_score;
            let is_over = f64::from(block.bound) < least;
            if is_over || self.found.len() >= self.most || self.blocks_left == 0 {
                return true;
            }
            self.open.pop();
            if !self.is_new(pyramid, &block) {
                continue;
            }
            self.blocks_left -= 1;
            let Some(level) = block.level().checked_sub(1) else {
                let score = f64::from(block.bound) / self.full_score;
                self.found.push(Proposal { pose: self.pose_of(pyramid, &block), score });
                continue;
            };
            let half = 1_i16 << level;
            let free = &pyramid.free[usize::from(level)];
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                let (x, y) = (block.x + dx, block.y + dy);
                if free.at(i32::from(x) >> level, i32::from(y) >> level) > 0 {
                    let bound = bound(pyramid, &self.rotated[usize::from(block.heading)], level, x, y);
                    if f64::from(bound) < least {
                        continue;
                    }
                    self.open.push(Block { bound, fineness: TOP_LEVEL - level, heading: block.heading, y, x });
                }
            }
        }
        false
    }

    /// The places that were found, best first.
    pub(super) fn found(&self) -> &[Proposal] {
        &self.found
    }

    /// No place that was not proposed scores more than this.
    pub(super) fn open_bound(&self) -> f64 {
        self.open.peek().map_or(0.0, |block| f64::from(block.bound) / self.full_score)
    }

    fn pose_of(&self, pyramid: &SearchPyramid, block: &Block) -> Pose2 {
        let [x, y] = [block.x, block.y].map(|cells| (f64::from(cells) + 0.5) * pyramid.cell_m);
        Pose2::new(x, y, f64::from(block.heading) * self.step_rad)
    }

    /// Whether a block holds more than the neighbourhood of a place that was found.
    fn is_new(&self, pyramid: &SearchPyramid, block: &Block) -> bool {
        let last = (1 << block.level()) - 1;
        let corners = [[0, 0], [last, 0], [0, last], [last, last]]
            .map(|[x, y]| self.pose_of(pyramid, &Block { x: block.x + x, y: block.y + y, ..*block }));
        self.found.iter().all(|place| {
            wrap_angle(corners[0].theta - place.pose.theta).abs() > SAME_PLACE_RAD
                || corners.iter().any(|corner| (corner.x - place.pose.x).hypot(corner.y - place.pose.y) > SAME_PLACE_M)
        })
    }
}

/// What no offset of a block scores more than.
#[inline]
fn bound(pyramid: &SearchPyramid, cells: &[[i16; 2]], level: u8, x: i16, y: i16) -> u16 {
    let grid = &pyramid.levels[usize::from(level)];
    let rim = 1 << TOP_LEVEL;
    let (x, y) = (i32::from(x) + rim, i32::from(y) + rim);
    let shift = if level <= EXACT_LEVELS { 0 } else { level };
    cells
        .iter()
        .map(|&[cell_x, cell_y]| u16::from(grid.at((x + i32::from(cell_x)) >> shift, (y + i32::from(cell_y)) >> shift)))
        .sum()
}
