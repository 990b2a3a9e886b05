//! An unbounded grid of square tiles that copies share until one of them writes.
//!
//! A copy of the grid costs one reference count per tile (Eliazar & Parr 2003 share
//! maps between particles for the same reason; tiles make it simple).

use super::cell::Cell;
use std::sync::Arc;

/// Base-2 logarithm of the tiles' side in cells.
pub const TILE_BITS: u32 = 5;
/// Side of a tile, cells.
pub const TILE_SIDE: i32 = 1 << TILE_BITS;
/// Number of cells of a tile.
pub const TILE_CELLS: usize = 1 << (2 * TILE_BITS);

/// Tiles of type `T`, each covering [`TILE_SIDE`] × [`TILE_SIDE`] cells.
#[derive(Debug, Clone)]
pub struct TileGrid<T> {
    /// Tile coordinates of the first entry of `tiles`.
    first: Cell,
    /// Columns and rows of `tiles`.
    columns: i32,
    rows: i32,
    tiles: Vec<Option<Arc<T>>>,
}

impl<T> Default for TileGrid<T> {
    fn default() -> Self {
        Self { first: Cell { x: 0, y: 0 }, columns: 0, rows: 0, tiles: Vec::new() }
    }
}

/// Coordinates of the tile that holds a cell.
#[inline]
#[must_use]
pub fn tile_of(cell: Cell) -> Cell {
    Cell { x: cell.x >> TILE_BITS, y: cell.y >> TILE_BITS }
}

/// Index of a cell within its tile.
#[inline]
#[must_use]
pub fn index_in_tile(cell: Cell) -> usize {
    let mask = TILE_SIDE - 1;
    (((cell.y & mask) << TILE_BITS) | (cell.x & mask)) as usize
}

impl<T> TileGrid<T> {
    /// The tile at these tile coordinates, if it was ever written.
    #[inline]
    #[must_use]
    pub fn tile(&self, at: Cell) -> Option<&T> {
        let column = at.x.wrapping_sub(self.first.x);
        let row = at.y.wrapping_sub(self.first.y);
        if (column as u32) < (self.columns as u32) && (row as u32) < (self.rows as u32) {
            self.tiles[(row * self.columns + column) as usize].as_deref()
        } else {
            None
        }
    }

    /// All tiles that exist with their tile coordinates, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (Cell, &T)> {
        self.tiles.iter().enumerate().filter_map(|(index, tile)| {
            let (column, row) = (index as i32 % self.columns, index as i32 / self.columns);
            tile.as_deref().map(|tile| (Cell { x: self.first.x + column, y: self.first.y + row }, tile))
        })
    }

    /// Number of tiles that exist, and how many of them no copy shares.
    #[must_use]
    pub fn tile_counts(&self) -> (usize, usize) {
        let present = self.tiles.iter().flatten();
        let own = present.clone().filter(|tile| Arc::strong_count(tile) == 1).count();
        (present.count(), own)
    }

    /// Makes the directory hold the tile coordinates `at`, with room to spare on the side it grew to.
    fn grow_to(&mut self, at: Cell) {
        let spare = 4 + self.columns.max(self.rows) / 4;
        let (mut low, mut high) = if self.tiles.is_empty() {
            (at, at)
        } else {
            (self.first, Cell { x: self.first.x + self.columns - 1, y: self.first.y + self.rows - 1 })
        };
        if at.x < low.x || self.tiles.is_empty() {
            low.x = at.x - spare;
        }
        if at.y < low.y || self.tiles.is_empty() {
            low.y = at.y - spare;
        }
        if at.x > high.x || self.tiles.is_empty() {
            high.x = at.x + spare;
        }
        if at.y > high.y || self.tiles.is_empty() {
            high.y = at.y + spare;
        }
        let (columns, rows) = (high.x - low.x + 1, high.y - low.y + 1);
        let mut tiles = Vec::new();
        tiles.resize_with(columns as usize * rows as usize, || None);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let moved = (self.first.y + row - low.y) * columns + (self.first.x + column - low.x);
                tiles[moved as usize] = self.tiles[(row * self.columns + column) as usize].take();
            }
        }
        *self = Self { first: low, columns, rows, tiles };
    }
}

impl<T: Clone + Default> TileGrid<T> {
    /// The tile at these tile coordinates, for writing: made if it is new, copied if it is shared.
    pub fn tile_mut(&mut self, at: Cell) -> &mut T {
        let inside = |grid: &Self| {
            (at.x.wrapping_sub(grid.first.x) as u32) < (grid.columns as u32)
                && (at.y.wrapping_sub(grid.first.y) as u32) < (grid.rows as u32)
        };
        if !inside(self) {
            self.grow_to(at);
        }
        let index = (at.y - self.first.y) * self.columns + (at.x - self.first.x);
        Arc::make_mut(self.tiles[index as usize].get_or_insert_with(|| Arc::new(T::default())))
    }
}
