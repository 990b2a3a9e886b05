//! Which cells of a tile and around it hold something, and the nearest of these to a cell.
//!
//! One bit for each cell. Writing costs one bit where a field of distances (Lau et al. 2013) costs
//! a disc of cells; finding the nearest costs a few rows of bits, mostly three: scans that are
//! matched lie within a cell of what they match.

use crate::map::tile_grid::TILE_SIDE;

/// How far, in cells, the nearest is looked for.
pub const REACH_CELLS: i32 = 7;
/// Side of a tile and the cells within reach around it.
const SIDE: usize = (TILE_SIDE + 2 * REACH_CELLS) as usize;
/// Side of what is within reach of a cell.
const WINDOW: usize = (2 * REACH_CELLS + 1) as usize;
/// The bits of a row of the window.
const WINDOW_BITS: u64 = (1 << WINDOW) - 1;

/// The cells of a tile and around it that hold something.
///
/// Columns and rows count from the tile's first cell, from −[`REACH_CELLS`] on.
#[derive(Debug, Clone)]
pub struct NearCells {
    rows: [u64; SIDE],
}

impl Default for NearCells {
    fn default() -> Self {
        Self { rows: [0; SIDE] }
    }
}

impl NearCells {
    /// Notes whether a cell, of the tile or within reach of it, holds something.
    #[inline]
    pub fn set(&mut self, column: i32, row: i32, holds: bool) {
        let bit = 1 << (column + REACH_CELLS);
        let bits = &mut self.rows[(row + REACH_CELLS) as usize];
        *bits = if holds { *bits | bit } else { *bits & !bit };
    }

    /// Columns and rows to the nearest cell that holds something from a cell of the tile, if one is within reach.
    #[inline]
    #[must_use]
    pub fn nearest(&self, column: i32, row: i32) -> Option<[i32; 2]> {
        match self.around(column, row) {
            0 => self.farther(column, row),
            around => Some(NEAREST_OF_NINE[around].map(i32::from)),
        }
    }

    /// Which of the nine cells around and including this one hold something: a bit each, row by row.
    #[inline]
    #[must_use]
    pub fn around(&self, column: i32, row: i32) -> usize {
        let (column, row) = (column & (TILE_SIDE - 1), row & (TILE_SIDE - 1));
        let Some(rows) = self.rows[(row + REACH_CELLS - 1) as usize..].first_chunk::<3>() else { return 0 };
        let three = |row: usize| (rows[row] >> (column + REACH_CELLS - 1)) as usize & 0b111;
        three(0) | three(1) << 3 | three(2) << 6
    }

    /// Columns and rows to the nearest cell that holds something where none of the nine around a cell does.
    #[inline(never)] // One look-up in fifty comes here.
    #[must_use]
    pub fn farther(&self, column: i32, row: i32) -> Option<[i32; 2]> {
        let (column, row) = (column & (TILE_SIDE - 1), row & (TILE_SIDE - 1));
        let window = self.rows[row as usize..].first_chunk::<WINDOW>()?;
        let anything = window.iter().fold(0, |all, bits| all | bits);
        if (anything >> column) & WINDOW_BITS == 0 {
            return None;
        }
        nearest_in_window(window, column)
    }
}

/// The nearest set bit to the middle of a window whose first column is `column`, of those within reach.
fn nearest_in_window(window: &[u64; WINDOW], column: i32) -> Option<[i32; 2]> {
    let mut nearest = None;
    let mut nearest_square = REACH_CELLS * REACH_CELLS + 1;
    for distance in 0..=REACH_CELLS {
        if distance * distance >= nearest_square {
            break;
        }
        for down in [-distance, distance] {
            let bits = (window[(REACH_CELLS + down) as usize] >> column) & WINDOW_BITS;
            if bits == 0 {
                continue;
            }
            // The middle column is the highest bit of the lower byte, and the lowest of what is above it.
            let left = (bits as u8).leading_zeros() as i32;
            let right = (bits >> REACH_CELLS).trailing_zeros() as i32;
            let across = if left < right { -left } else { right };
            let square = across * across + down * down;
            if square < nearest_square {
                (nearest, nearest_square) = (Some([across, down]), square);
            }
        }
    }
    nearest
}

/// For each pattern of the nine cells around and including one (a bit each, row by row) the offset to the nearest.
pub static NEAREST_OF_NINE: [[i8; 2]; 512] = {
    let by_distance: [[i8; 2]; 9] = [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];
    let mut table = [[0; 2]; 512];
    let mut pattern = 1;
    while pattern < table.len() {
        let mut next = 0;
        loop {
            let [column, row] = by_distance[next];
            if (pattern >> (3 * (row + 1) + column + 1)) & 1 == 1 {
                table[pattern] = by_distance[next];
                break;
            }
            next += 1;
        }
        pattern += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_is_the_one_a_search_finds(
            set in prop::collection::btree_set((-7..39_i32, -7..39_i32), 0..30),
            cleared in prop::collection::vec((-7..39_i32, -7..39_i32), 0..30),
        ) {
            let mut cells = NearCells::default();
            set.iter().for_each(|&(column, row)| cells.set(column, row, true));
            cleared.iter().for_each(|&(column, row)| cells.set(column, row, false));
            for (column, row) in (0..TILE_SIDE).flat_map(|column| (0..TILE_SIDE).map(move |row| (column, row))) {
                let square = |(x, y): (i32, i32)| (x - column).pow(2) + (y - row).pow(2);
                let truth = set.iter().filter(|cell| !cleared.contains(cell)).map(|&cell| square(cell)).min();
                let truth = truth.filter(|&square| square <= REACH_CELLS * REACH_CELLS);
                let found = cells.nearest(column, row);
                prop_assert_eq!(found.map(|[x, y]| x * x + y * y), truth);
                prop_assert!(found.is_none_or(|[x, y]| set.contains(&(column + x, row + y))));
            }
        }
    }
}
