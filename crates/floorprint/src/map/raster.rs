//! Rectangles of square cells with a place in the world, laid out as pictures are.
//!
//! The convention is that of ROS's `map_server`: rows run from the top, which is the
//! largest y, downwards; the origin is the lower left corner of the lower left cell.

/// A picture of the plane: one value for each cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// x and y of the lower left corner of the lower left cell, metres.
    pub origin_m: [f64; 2],
    /// The cells' values, row by row from the top left.
    pub cells: Vec<T>,
}

/// What a map says of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Occupancy {
    /// Nothing is known.
    #[default]
    Unknown,
    /// Nothing is there.
    Free,
    /// Something is there.
    Occupied,
}

impl<T> Raster<T> {
    /// The same rectangle with `value(index, x and y of the cell's centre in metres)` in each cell.
    pub fn map<U>(&self, mut value: impl FnMut(usize, [f64; 2]) -> U) -> Raster<U> {
        Raster {
            width: self.width,
            height: self.height,
            resolution_m: self.resolution_m,
            origin_m: self.origin_m,
            cells: (0..self.cells.len()).map(|index| value(index, self.center_m(index))).collect(),
        }
    }

    /// Index of the cell at a row (from the top) and a column; `None` outside the rectangle.
    #[must_use]
    pub fn index(&self, row: i64, column: i64) -> Option<usize> {
        let (row, column) = (usize::try_from(row).ok()?, usize::try_from(column).ok()?);
        (row < self.height && column < self.width).then(|| row * self.width + column)
    }

    /// Row and column of a cell.
    #[must_use]
    pub fn row_and_column(&self, index: usize) -> (i64, i64) {
        ((index / self.width) as i64, (index % self.width) as i64)
    }

    /// Row and column of the cell that holds a point of the world (metres); they may lie outside the rectangle.
    #[must_use]
    pub fn row_and_column_at(&self, [x_m, y_m]: [f64; 2]) -> (i64, i64) {
        let column = ((x_m - self.origin_m[0]) / self.resolution_m).floor() as i64;
        let from_below = ((y_m - self.origin_m[1]) / self.resolution_m).floor() as i64;
        (self.height as i64 - 1 - from_below, column)
    }

    /// The value at a point of the world (metres); `None` outside the rectangle.
    #[must_use]
    pub fn at(&self, point_m: [f64; 2]) -> Option<&T> {
        let (row, column) = self.row_and_column_at(point_m);
        self.index(row, column).map(|index| &self.cells[index])
    }

    /// Centre of a cell in the world, metres.
    #[must_use]
    pub fn center_m(&self, index: usize) -> [f64; 2] {
        let (row, column) = self.row_and_column(index);
        [
            self.origin_m[0] + (column as f64 + 0.5) * self.resolution_m,
            self.origin_m[1] + ((self.height as i64 - row) as f64 - 0.5) * self.resolution_m,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_first_cell_is_at_the_top_left() {
        let raster = Raster { width: 2, height: 3, resolution_m: 0.5, origin_m: [1.0, -1.0], cells: vec![0; 6] };
        assert_eq!(raster.center_m(0), [1.25, 0.25]);
        assert_eq!(raster.center_m(5), [1.75, -0.75]);
        assert_eq!(raster.at([0.9, 0.0]), None);
        assert_eq!(raster.at([1.1, 0.6]), None);
    }

    proptest! {
        #[test]
        fn a_cell_holds_its_own_centre(width in 1..9_usize, height in 1..9_usize, x in -9.0..9.0_f64, y in -9.0..9.0_f64) {
            let raster = Raster { width, height, resolution_m: 0.05, origin_m: [x, y], cells: (0..width * height).collect() };
            for index in 0..raster.cells.len() {
                prop_assert_eq!(raster.at(raster.center_m(index)), Some(&index));
            }
        }
    }
}
