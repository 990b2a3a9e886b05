//! The cells that a ray passes (Bresenham 1965).

use super::cell::Cell;

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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
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
