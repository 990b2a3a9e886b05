//! How near the surfaces of a map are, cell by cell, laid out for a search over shifts.
//!
//! A search shifts a scan by whole numbers of a stride and adds up, for each shift, how near its
//! points come to surfaces. Here the values of cells a stride apart lie side by side, so that one
//! point's share of a whole row of shifts is one run of bytes.

use super::near_cells::REACH_CELLS;
use super::surface_map::{SurfaceMap, proximity_of};
use crate::map::Cell;

/// Values that are written at a time: as many bytes as a vector register holds.
const LANES: usize = 16;
/// Rows of cells that a surface is near to.
const STAMP_ROWS: usize = (2 * REACH_CELLS + 1) as usize;

/// Proximity of each cell, 0 (out of reach) to 255 (a surface lies in the cell).
#[derive(Debug, Clone)]
pub struct ProximityField {
    /// Cells from one shift to the next.
    stride: i32,
    /// The first cell.
    low: Cell,
    /// For each of stride × stride interleaved grids its columns and rows.
    columns: usize,
    rows: usize,
    /// The grids, one after the other.
    levels: Vec<u8>,
}

impl ProximityField {
    /// The field of a map for shifts by multiples of `stride` cells, up to `shifts` of them in a row or column, that lead to
    /// no cell before or beyond these: what the map shows elsewhere costs neither time nor memory.
    #[must_use]
    pub fn new(map: &SurfaceMap, stride: i32, shifts: usize, [first, last]: [Cell; 2]) -> Self {
        let is_near = |cell: &Cell| {
            cell.x >= first.x.saturating_sub(REACH_CELLS)
                && cell.x <= last.x.saturating_add(REACH_CELLS)
                && cell.y >= first.y.saturating_sub(REACH_CELLS)
                && cell.y <= last.y.saturating_add(REACH_CELLS)
        };
        let (mut low, mut high) = (Cell { x: i32::MAX, y: i32::MAX }, Cell { x: i32::MIN, y: i32::MIN });
        for cell in map.occupied_cells().filter(is_near) {
            low = Cell { x: low.x.min(cell.x), y: low.y.min(cell.y) };
            high = Cell { x: high.x.max(cell.x), y: high.y.max(cell.y) };
        }
        if low.x > high.x {
            return Self { stride, low: Cell { x: 0, y: 0 }, columns: 0, rows: 0, levels: Vec::new() };
        }
        // So wide a rim that every run of shifts that meets a surface lies within, whole vectors included.
        let rim = REACH_CELLS + stride * (shifts.next_multiple_of(LANES) as i32);
        low = Cell { x: low.x - rim, y: low.y - rim };
        let columns = ((high.x + rim - low.x) / stride + 1) as usize + LANES;
        let rows = ((high.y + rim - low.y) / stride + 1) as usize;
        let grids = (stride * stride) as usize;
        let mut field = Self { stride, low, columns, rows, levels: vec![0; grids * columns * rows] };
        let stamps = stamps(stride);
        for cell in map.occupied_cells().filter(is_near) {
            field.stamp(cell, &stamps);
        }
        field
    }

    /// Raises the cells around `cell` to their proximity to it.
    fn stamp(&mut self, cell: Cell, stamps: &[[[u8; LANES]; STAMP_ROWS]]) {
        let corner = Cell { x: cell.x - REACH_CELLS, y: cell.y - REACH_CELLS };
        for row in 0..STAMP_ROWS {
            for (offset, stamp) in stamps.iter().enumerate() {
                let first = Cell { x: corner.x + offset as i32, y: corner.y + row as i32 };
                let Some(start) = self.position(first) else { continue };
                let Some(levels) = self.levels.get_mut(start..).and_then(|rest| rest.first_chunk_mut::<LANES>()) else {
                    continue;
                };
                let near = &stamp[row];
                *levels = std::array::from_fn(|lane| levels[lane].max(near[lane]));
            }
        }
    }

    /// Where a cell's value is in its grid; that of the cell a stride further right follows.
    #[inline]
    fn position(&self, cell: Cell) -> Option<usize> {
        let (x, y) = (cell.x.checked_sub(self.low.x)?, cell.y.checked_sub(self.low.y)?);
        if x < 0 || y < 0 {
            return None;
        }
        let (column, row) = ((x / self.stride) as usize, (y / self.stride) as usize);
        let grid = (y % self.stride * self.stride + x % self.stride) as usize;
        (column < self.columns && row < self.rows).then_some((grid * self.rows + row) * self.columns + column)
    }

    /// Adds to `scores` how near the point in `cell` comes to a surface under each shift.
    ///
    /// `scores` holds the shifts row by row, each row padded to `row_length`, a multiple of 16; the
    /// first shift is none, the others go right and up by strides.
    #[inline]
    pub fn add_shifted(&self, cell: Cell, rows: usize, row_length: usize, scores: &mut [u16]) {
        // Whoever begins beyond the rim meets no surface under any shift.
        let Some(start) = self.position(cell) else { return };
        let first_row = (cell.y - self.low.y) / self.stride;
        let rows = rows.min(self.rows - first_row as usize);
        for (row, scores) in scores.chunks_exact_mut(row_length).take(rows).enumerate() {
            let begin = start + row * self.columns;
            let Some(levels) = self.levels.get(begin..begin + row_length) else { return };
            let (levels, _) = levels.as_chunks::<LANES>();
            let (scores, _) = scores.as_chunks_mut::<LANES>();
            for (scores, levels) in scores.iter_mut().zip(levels) {
                for (score, &level) in scores.iter_mut().zip(levels) {
                    *score += u16::from(level);
                }
            }
        }
    }
}

/// For each offset below the stride and each row around a surface the levels of the cells a stride apart.
fn stamps(stride: i32) -> Vec<[[u8; LANES]; STAMP_ROWS]> {
    (0..stride)
        .map(|offset| {
            let mut stamp = [[0; LANES]; STAMP_ROWS];
            for (row, levels) in stamp.iter_mut().enumerate() {
                for (step, level) in levels.iter_mut().enumerate() {
                    let columns = offset + stride * step as i32 - REACH_CELLS;
                    *level = (255.0 * proximity_of([columns, row as i32 - REACH_CELLS])) as u8;
                }
            }
            stamp
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::scan_matcher::synthetic::Walls;
    use crate::surface::{SurfaceScan, Thinning};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn every_shift_scores_what_the_map_says(
            x in -120..120_i32, y in -120..120_i32, stride in 1..5_i32, shifts in 1..40_usize
        ) {
            let cell_m = 0.05;
            let mut map = SurfaceMap::new(cell_m);
            let scan = SurfaceScan::new(&Walls::room().scan_from(&Pose2::IDENTITY, 360), &Thinning::default());
            map.add_scan(&Pose2::IDENTITY, &scan);
            let reached = stride * (shifts as i32 - 1);
            let field =
                ProximityField::new(&map, stride, shifts, [Cell { x, y }, Cell { x: x + reached, y: y + reached }]);
            let row_length = shifts.next_multiple_of(LANES);
            let mut scores = vec![0; shifts * row_length];
            field.add_shifted(Cell { x, y }, shifts, row_length, &mut scores);
            for (row, column) in (0..shifts).flat_map(|row| (0..shifts).map(move |column| (row, column))) {
                let shifted = Cell { x: x + stride * column as i32, y: y + stride * row as i32 };
                let truth = 255.0 * map.proximity(shifted.center_m(cell_m));
                let found = f32::from(scores[row * row_length + column]);
                prop_assert!((truth - found).abs() <= 1.0, "{truth} and {found} at shift {column}, {row}");
            }
        }
    }

    #[test]
    fn what_lies_out_of_reach_makes_no_field_larger() {
        let scan = SurfaceScan::new(&Walls::room().scan_from(&Pose2::IDENTITY, 360), &Thinning::default());
        let levels = |far_m: f64| {
            let mut map = SurfaceMap::new(0.05);
            map.add_scan(&Pose2::IDENTITY, &scan);
            map.add_scan(&Pose2::new(far_m, far_m, 0.0), &scan);
            ProximityField::new(&map, 2, 13, [Cell { x: -100, y: -100 }, Cell { x: 100, y: 100 }]).levels.len()
        };
        assert_eq!(levels(500.0), levels(0.0));
    }

    #[test]
    fn a_map_of_nothing_is_near_to_nothing() {
        let field = ProximityField::new(&SurfaceMap::new(0.05), 2, 13, [Cell { x: 0, y: 0 }; 2]);
        let mut scores = [0; 13 * 16];
        field.add_shifted(Cell { x: 0, y: 0 }, 13, 16, &mut scores);
        assert!(scores.iter().all(|&score| score == 0));
    }
}
