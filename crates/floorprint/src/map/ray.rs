//! The cells that a ray passes (Bresenham 1965).

use super::cell::Cell;
use super::tile_grid::{TILE_CELLS, TILE_SIDE, index_in_tile};

/// The cells of the 8-connected line from `from` up to, but not including, `to`.
///
/// A ray within one cell passes none.
#[inline]
pub fn passed_cells(from: Cell, to: Cell) -> impl Iterator<Item = Cell> {
    let dx = (to.x - from.x).abs();
    let dy = -(to.y - from.y).abs();
    let step_x = if from.x < to.x { 1 } else { -1 };
    let step_y = if from.y < to.y { 1 } else { -1 };
    let mut error = dx + dy;
    let mut next = from;
    (0..dx.max(-dy)).map(move |_| {
        let cell = next;
        let doubled = 2 * error;
        if doubled >= dy {
            error += dy;
            next.x += step_x;
        }
        if doubled <= dx {
            error += dx;
            next.y += step_y;
        }
        cell
    })
}

/// The same line, tile by tile: within a tile it costs a few additions a cell.
#[derive(Debug, Clone)]
pub struct TiledRay {
    /// The next cell, and how many are left.
    next: Cell,
    left: i32,
    /// Whether it runs along columns rather than rows: then each cell lies in another row.
    is_steep: bool,
    /// Directions of the ray.
    step_x: i32,
    step_y: i32,
    /// How far the other coordinate moves with each cell, and what of that has not moved it yet, in 2⁻³¹ cells.
    slope: u32,
    fraction: u32,
}

/// One cell.
const WHOLE: u32 = 1 << 31;

impl TiledRay {
    /// The line from `from` up to, but not including, `to`.
    #[must_use]
    pub fn new(from: Cell, to: Cell) -> Self {
        let (dx, dy) = (to.x.abs_diff(from.x), to.y.abs_diff(from.y));
        let (longer, shorter) = (dx.max(dy), dx.min(dy));
        // Rounded up, so that what lies half-way moves on, as Bresenham's does.
        let slope = (u64::from(shorter) * u64::from(WHOLE)).div_ceil(u64::from(longer).max(1));
        Self {
            next: from,
            left: i32::try_from(longer).unwrap_or(i32::MAX),
            is_steep: dy > dx,
            step_x: (to.x - from.x).signum(),
            step_y: (to.y - from.y).signum(),
            slope: slope as u32,
            fraction: WHOLE / 2,
        }
    }

    /// The next cell; `None` at the end.
    #[must_use]
    pub fn next_cell(&self) -> Option<Cell> {
        (self.left > 0).then_some(self.next)
    }

    /// Passes the cells up to where the ray leaves the tile that it is in, given by their index in the tile.
    #[inline]
    pub fn pass_tile(&mut self, mut pass: impl FnMut(usize)) {
        let (stride_x, stride_y) = (self.step_x, self.step_y * TILE_SIDE);
        let (along, across) = if self.is_steep { (stride_y, stride_x) } else { (stride_x, stride_y) };
        let (mut index, mut fraction) = (index_in_tile(self.next) as i32, self.fraction);
        let cells = self.cells_in_tile();
        for _ in 0..cells {
            pass(index as usize & (TILE_CELLS - 1));
            fraction += self.slope;
            // All ones where the other coordinate moves, too.
            let moved = (fraction as i32) >> 31;
            fraction &= WHOLE - 1;
            index += along + (moved & across);
        }
        self.advance(cells);
    }

    /// Goes on to where the ray leaves the tile that it is in.
    #[inline]
    pub fn skip_tile(&mut self) {
        self.advance(self.cells_in_tile());
    }

    /// Goes on by so many cells.
    #[inline]
    fn advance(&mut self, cells: u32) {
        let fraction = u64::from(self.fraction) + u64::from(cells) * u64::from(self.slope);
        self.fraction = (fraction % u64::from(WHOLE)) as u32;
        let (along, across) = (cells as i32, (fraction / u64::from(WHOLE)) as i32);
        self.left -= along;
        let (columns, rows) = if self.is_steep { (across, along) } else { (along, across) };
        self.next = Cell { x: self.next.x + columns * self.step_x, y: self.next.y + rows * self.step_y };
    }

    /// How many cells it passes in the tile that it is in.
    #[inline]
    fn cells_in_tile(&self) -> u32 {
        let room =
            |at: i32, step: i32| if step < 0 { (at & (TILE_SIDE - 1)) + 1 } else { TILE_SIDE - (at & (TILE_SIDE - 1)) };
        let (room_x, room_y) = (room(self.next.x, self.step_x), room(self.next.y, self.step_y));
        let (room_along, room_across) = if self.is_steep { (room_y, room_x) } else { (room_x, room_y) };
        let most = self.left.min(room_along) as u32;
        let left_across = room_across as u64 * u64::from(WHOLE) - u64::from(self.fraction);
        // Mostly it leaves the tile at its far end, and no division is needed to see that.
        if u64::from(most) * u64::from(self.slope) <= left_across {
            return most;
        }
        left_across.div_ceil(u64::from(self.slope)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::super::tile_grid::{cell_in_tile, tile_of};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tile_by_tile_it_is_the_same_line(
            ax in -90..90_i32, ay in -90..90_i32, bx in -900..900_i32, by in -900..900_i32
        ) {
            let (from, to) = (Cell { x: ax, y: ay }, Cell { x: bx, y: by });
            let mut ray = TiledRay::new(from, to);
            let mut cells = Vec::new();
            while let Some(next) = ray.next_cell() {
                let at = tile_of(next);
                ray.pass_tile(|index| cells.push(cell_in_tile(at, index)));
            }
            prop_assert_eq!(cells, passed_cells(from, to).collect::<Vec<_>>());
            // Tiles that are skipped change nothing in the others.
            let (mut ray, mut skipping, mut every_other) = (TiledRay::new(from, to), TiledRay::new(from, to), false);
            while let Some(next) = ray.next_cell() {
                prop_assert_eq!(skipping.next_cell(), Some(next));
                ray.pass_tile(|_| {});
                if every_other { skipping.pass_tile(|_| {}) } else { skipping.skip_tile() }
                every_other = !every_other;
            }
            prop_assert_eq!(skipping.next_cell(), None);
        }

        #[test]
        fn a_ray_is_a_connected_line_that_stops_before_its_end(
            ax in -60..60_i32, ay in -60..60_i32, bx in -60..60_i32, by in -60..60_i32
        ) {
            let (from, to) = (Cell { x: ax, y: ay }, Cell { x: bx, y: by });
            let cells: Vec<_> = passed_cells(from, to).collect();
            prop_assert_eq!(cells.len() as i32, (bx - ax).abs().max((by - ay).abs()));
            let mut path = cells.clone();
            path.push(to);
            prop_assert_eq!(path[0], from);
            for pair in path.windows(2) {
                let (dx, dy) = ((pair[1].x - pair[0].x).abs(), (pair[1].y - pair[0].y).abs());
                prop_assert!(dx.max(dy) == 1);
            }
            // No cell is farther than half a cell from the true line.
            let length = f64::from((bx - ax).pow(2) + (by - ay).pow(2)).sqrt().max(1.0);
            for cell in cells {
                let cross = f64::from((bx - ax) * (cell.y - ay) - (by - ay) * (cell.x - ax));
                prop_assert!((cross / length).abs() <= 0.5 + 1e-9);
            }
        }
    }
}
