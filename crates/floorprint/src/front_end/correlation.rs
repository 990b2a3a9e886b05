//! The report's observation model: how many of a scan's points fall on occupied cells (eqs. 20–21).

use crate::frame::Points;
use crate::geometry::Pose2;
use crate::map::{Cell, Flip, OccupancyGrid};

/// The occupied cells of a grid as one dense picture, kept up to date by the grid's flips.
///
/// Counting is the filter's innermost loop: N particles × 1081 points × 40 scans a second. A
/// byte per cell in one array, with a margin that makes bounds checks needless, is several
/// times faster than asking the grid's tiles.
#[derive(Debug, Clone)]
pub struct OccupiedCells {
    resolution_m: f64,
    /// Cell of the picture's first byte.
    first: Cell,
    columns: usize,
    rows: usize,
    occupied: Vec<u8>,
}

impl OccupiedCells {
    /// No cell is occupied.
    #[must_use]
    pub fn new(grid: &OccupancyGrid) -> Self {
        Self { resolution_m: grid.resolution_m(), first: Cell { x: 0, y: 0 }, columns: 0, rows: 0, occupied: vec![] }
    }

    /// Takes over the changes of the grid.
    pub fn apply(&mut self, flips: &[Flip]) {
        for flip in flips {
            self.cover(flip.cell, flip.cell);
            let index = self.index(flip.cell);
            self.occupied[index] = u8::from(flip.occupied);
        }
    }

    /// Makes the picture hold all cells from `low` to `high`.
    fn cover(&mut self, low: Cell, high: Cell) {
        let (columns, rows) = (self.columns as i32, self.rows as i32);
        let inside = |cell: Cell| {
            let (x, y) = (cell.x - self.first.x, cell.y - self.first.y);
            x >= 0 && y >= 0 && x < columns && y < rows
        };
        if inside(low) && inside(high) {
            return;
        }
        let spare = 64;
        let (mut first, mut last) =
            (Cell { x: low.x - spare, y: low.y - spare }, Cell { x: high.x + spare, y: high.y + spare });
        if columns > 0 {
            first = Cell { x: first.x.min(self.first.x), y: first.y.min(self.first.y) };
            last = Cell { x: last.x.max(self.first.x + columns - 1), y: last.y.max(self.first.y + rows - 1) };
        }
        let mut grown = Self {
            resolution_m: self.resolution_m,
            first,
            columns: (last.x - first.x + 1) as usize,
            rows: (last.y - first.y + 1) as usize,
            occupied: vec![],
        };
        grown.occupied = vec![0; grown.columns * grown.rows];
        for row in 0..self.rows {
            let from = row * self.columns;
            let to = grown.index(Cell { x: self.first.x, y: self.first.y + row as i32 });
            grown.occupied[to..to + self.columns].copy_from_slice(&self.occupied[from..from + self.columns]);
        }
        *self = grown;
    }

    fn index(&self, cell: Cell) -> usize {
        (cell.y - self.first.y) as usize * self.columns + (cell.x - self.first.x) as usize
    }

    /// Makes room for scans of these points from any of the poses; call before [`count`](Self::count).
    pub fn make_room(&mut self, poses: impl Iterator<Item = Pose2>, points: &Points) {
        let reach_m = points.iter().map(|[x, y]| x.hypot(y)).fold(0.0, f32::max);
        let reach = (f64::from(reach_m) / self.resolution_m) as i32 + 2;
        for pose in poses {
            let cell = Cell::containing([pose.x, pose.y], 1.0 / self.resolution_m);
            self.cover(Cell { x: cell.x - reach, y: cell.y - reach }, Cell { x: cell.x + reach, y: cell.y + reach });
        }
    }

    /// corr(y, m): how many of the points, seen from `world_from_body`, lie in occupied cells.
    ///
    /// `indices` is scratch space. There must be room for the points (see [`make_room`](Self::make_room)).
    #[must_use]
    pub fn count(&self, world_from_body: &Pose2, points: &Points, indices: &mut Vec<u32>) -> u32 {
        let scale = 1.0 / self.resolution_m;
        let (sin, cos) = world_from_body.theta.sin_cos();
        let (sin, cos) = ((sin * scale) as f32, (cos * scale) as f32);
        // Relative to the picture's corner all coordinates are positive, so that truncation is floor.
        let x0 = (world_from_body.x * scale - f64::from(self.first.x)) as f32;
        let y0 = (world_from_body.y * scale - f64::from(self.first.y)) as f32;
        let columns = self.columns as u32;
        // Two plain loops: the first is arithmetic on whole vectors, the second nothing but look-ups.
        indices.resize(points.len(), 0);
        for ((index, &x), &y) in indices.iter_mut().zip(&points.x_m).zip(&points.y_m) {
            let column = floor_of_positive(x0 + cos * x - sin * y);
            let row = floor_of_positive(y0 + sin * x + cos * y);
            *index = row.wrapping_mul(columns).wrapping_add(column);
        }
        indices.iter().map(|&index| u32::from(self.occupied.get(index as usize).copied().unwrap_or(0))).sum()
    }
}

/// Floor of a number from 0 to 2²²: adding 2²³ leaves whole numbers in the mantissa. Unlike a cast,
/// which must care for NaN and overflow, this is one instruction for a whole vector.
#[inline]
fn floor_of_positive(value: f32) -> u32 {
    const TWO_TO_23: f32 = 8_388_608.0;
    (value - 0.5 + TWO_TO_23).to_bits() & 0x007f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::BodyScan;
    use crate::map::MapConfig;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_what_the_grid_says(
            hits in prop::collection::vec((-9.0..9.0_f32, -9.0..9.0_f32), 1..40),
            x in -5.0..5.0_f64, y in -5.0..5.0_f64, theta in -3.0..3.0_f64
        ) {
            let mut scan = BodyScan::default();
            hits.iter().for_each(|&(x, y)| scan.hits.push(x, y));
            let mut grid = OccupancyGrid::new(&MapConfig::default());
            let mut cells = OccupiedCells::new(&grid);
            for pose in [Pose2::new(0.3, 0.1, 0.2), Pose2::new(x, y, theta)] {
                let mut flips = Vec::new();
                grid.add_scan(&pose, &scan, &mut flips);
                cells.apply(&flips);
            }
            let pose = Pose2::new(x, y, theta);
            cells.make_room([pose].into_iter(), &scan.hits);
            let counted = cells.count(&pose, &scan.hits, &mut Vec::new());
            let asked = scan.hits.iter()
                .filter(|p| grid.is_occupied(grid.cell_at(pose.transform_point(p.map(f64::from)))))
                .count() as u32;
            // 32-bit coordinates may put a point on a cell's border into the next cell.
            prop_assert!(counted.abs_diff(asked) <= 1);
        }
    }
}
