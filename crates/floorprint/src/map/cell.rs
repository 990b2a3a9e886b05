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
        Self { x: floor(point_m[0] * inverse_resolution), y: floor(point_m[1] * inverse_resolution) }
    }

    /// The middle of the cell, metres, given the cells' side (m).
    #[must_use]
    pub fn center_m(self, resolution_m: f64) -> [f64; 2] {
        [(f64::from(self.x) + 0.5) * resolution_m, (f64::from(self.y) + 0.5) * resolution_m]
    }
}

/// The largest whole number that is not above `value`. Without SSE 4.1, which x86-64 does not
/// promise, `f64::floor` is a function call; this look-up is in the innermost loops. What does not
/// fit an `i32` ends up at one of its limits, no number at 0.
#[inline]
fn floor(value: f64) -> i32 {
    let truncated = value as i32;
    truncated.wrapping_sub(i32::from(f64::from(truncated) > value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_cell_holds_its_points(x in -1e4..1e4_f64, y in -1e4..1e4_f64) {
            let cell = Cell::containing([x, y], 20.0);
            prop_assert_eq!(cell, Cell { x: (x * 20.0).floor() as i32, y: (y * 20.0).floor() as i32 });
            let [center_x, center_y] = cell.center_m(0.05);
            prop_assert!((center_x - x).abs() <= 0.025 + 1e-9 && (center_y - y).abs() <= 0.025 + 1e-9);
        }
    }
}
