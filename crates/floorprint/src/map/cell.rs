//! Cells of an unbounded square grid.

/// A cell: cell (0, 0) spans from the world's origin to one resolution in x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Column; grows with the world's x.
    pub x: i32,
    /// Row; grows with the world's y.
    pub y: i32,
}

impl Cell {
    /// The cell that holds a point (metres), given the inverse of the cells' side (1/m).
    #[must_use]
    pub fn containing(point_m: [f64; 2], inverse_resolution: f64) -> Self {
        Self {
            x: (point_m[0] * inverse_resolution).floor() as i32,
            y: (point_m[1] * inverse_resolution).floor() as i32,
        }
    }

    /// The middle of the cell, metres, given the cells' side (m).
    #[must_use]
    pub fn center_m(self, resolution_m: f64) -> [f64; 2] {
        [(f64::from(self.x) + 0.5) * resolution_m, (f64::from(self.y) + 0.5) * resolution_m]
    }
}
