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

    /// A grid of half as many columns and rows, whose every cell holds the largest of four.
    pub(crate) fn halved(&self) -> Self {
        let mut result = Self::new(self.columns / 2 + 1, self.rows / 2 + 1);
        result.fill(|y, cells| {
            for row in [self.row(2 * y), self.row(2 * y + 1)] {
                let (pairs, last) = row.as_chunks();
                for (cell, [left, right]) in cells.iter_mut().zip(pairs) {
                    *cell = (*cell).max(*left).max(*right);
                }
                raise_all(&mut cells[pairs.len()..], last);
            }
        });
        result
    }

    /// A grid whose every cell holds the largest of itself and of those `step` farther right, above, and both.
    pub(crate) fn widened(&self, step: usize) -> Self {
        let mut result = Self::new(self.columns, self.rows);
        result.fill(|y, cells| {
            for row in [self.row(y), self.row(y + step)] {
                raise_all(cells, row);
                raise_all(cells, row.get(step..).unwrap_or_default());
            }
        });
        result
    }

    /// The cells of a row; none outside.
    fn row(&self, y: usize) -> &[u8] {
        let columns = self.columns as usize;
        self.cells.get(y * columns..(y + 1) * columns).unwrap_or_default()
    }

    /// Hands out each row, given its number, to be filled.
    fn fill(&mut self, row: impl Fn(usize, &mut [u8]) + Sync) {
        let columns = self.columns.max(1) as usize;
        if self.cells.len() < FEW_CELLS {
            self.cells.chunks_mut(columns).enumerate().for_each(|(y, cells)| row(y, cells));
        } else {
            self.cells.par_chunks_mut(columns).enumerate().for_each(|(y, cells)| row(y, cells));
        }
    }
}

/// Lets each cell hold at least the value beside it.
fn raise_all(cells: &mut [u8], values: &[u8]) {
    for (cell, value) in cells.iter_mut().zip(values) {
        *cell = (*cell).max(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cells_hold_the_largest_of_those_they_stand_for(
            (columns, rows) in (1..9_i32, 1..9_i32), values in prop::collection::vec(any::<u8>(), 64), step in 1..5_i32,
        ) {
            let mut grid = Grid::new(columns, rows);
            let of = |x: i32, y: i32| values[(8 * y + x) as usize];
            (0..columns).for_each(|x| (0..rows).for_each(|y| grid.raise(x, y, of(x, y))));
            let (halved, widened) = (grid.halved(), grid.widened(step as usize));
            let largest = |x: i32, y: i32, step: i32| {
                [[0, 0], [step, 0], [0, step], [step, step]].iter().map(|[dx, dy]| grid.at(x + dx, y + dy)).max().unwrap()
            };
            for (x, y) in (0..columns).flat_map(|x| (0..rows).map(move |y| (x, y))) {
                prop_assert_eq!(grid.at(x, y), of(x, y));
                prop_assert_eq!(halved.at(x, y), largest(2 * x, 2 * y, 1));
                prop_assert_eq!(widened.at(x, y), largest(x, y, step));
            }
        }
    }
}
