//! The grids that branch and bound looks up: small values, and pyramids of their largest.

use rayon::prelude::*;

/// Grids of fewer cells are pooled by one thread: handing the rows out would take longer.
const FEW_CELLS: usize = 1 << 16;

/// A grid of small values; 0 outside.
#[derive(Debug, Clone, Default)]
pub(crate) struct Grid {
    pub(crate) columns: i32,
    pub(crate) rows: i32,
    pub(crate) cells: Vec<u8>,
}

impl Grid {
    /// Zeros.
    pub(crate) fn new(columns: i32, rows: i32) -> Self {
        Self { columns, rows, cells: vec![0; (columns * rows) as usize] }
    }

    /// The value of a cell; 0 outside.
    #[inline]
    pub(crate) fn at(&self, x: i32, y: i32) -> u8 {
        if (x as u32) < self.columns as u32 && (y as u32) < self.rows as u32 {
            self.cells[(y * self.columns + x) as usize]
        } else {
            0
        }
    }

    /// Lets a cell hold at least a value; nothing outside.
    pub(crate) fn raise(&mut self, x: i32, y: i32, value: u8) {
        if (x as u32) < self.columns as u32 && (y as u32) < self.rows as u32 {
            let cell = &mut self.cells[(y * self.columns + x) as usize];
            *cell = value.max(*cell);
        }
    }

    /// A grid whose every cell holds the largest of the `span` × `span` cells that begin `stride` times as far.
    pub(crate) fn pooled(&self, stride: i32, span: i32) -> Self {
        let mut result = Self::new(self.columns.div_euclid(stride) + 1, self.rows.div_euclid(stride) + 1);
        result.fill(|x, y| {
            let (x, y) = (x * stride, y * stride);
            let mut largest = 0;
            for dy in 0..span {
                for dx in 0..span {
                    largest = largest.max(self.at(x + dx, y + dy));
                }
            }
            largest
        });
        result
    }

    /// A grid whose every cell holds the largest of itself and of those `step` farther right, above, and both.
    pub(crate) fn widened(&self, step: i32) -> Self {
        let mut result = Self::new(self.columns, self.rows);
        result.fill(|x, y| {
            let above = self.at(x, y + step).max(self.at(x + step, y + step));
            self.at(x, y).max(self.at(x + step, y)).max(above)
        });
        result
    }

    fn fill(&mut self, value: impl Fn(i32, i32) -> u8 + Sync) {
        let fill_row = |(y, cells): (usize, &mut [u8])| {
            for (x, cell) in cells.iter_mut().enumerate() {
                *cell = value(x as i32, y as i32);
            }
        };
        let columns = self.columns.max(1) as usize;
        if self.cells.len() < FEW_CELLS {
            self.cells.chunks_mut(columns).enumerate().for_each(fill_row);
        } else {
            self.cells.par_chunks_mut(columns).enumerate().for_each(fill_row);
        }
    }
}
