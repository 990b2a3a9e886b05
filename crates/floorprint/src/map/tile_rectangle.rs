//! A rectangle of tiles: where a scan may have drawn.

use super::cell::Cell;
use super::tile_grid::tile_of;

/// The tiles from `low` to `high`, both included; tile coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileRectangle {
    /// Least column and row.
    pub low: Cell,
    /// Largest column and row.
    pub high: Cell,
}

impl TileRectangle {
    /// The smallest rectangle that holds `first` and others.
    #[must_use]
    pub fn around(first: Cell, others: impl Iterator<Item = Cell>) -> Self {
        others.fold(Self { low: first, high: first }, Self::with)
    }

    /// The tiles of `first` and other cells, and of those up to `reach` cells away from them.
    #[must_use]
    pub fn of_cells(first: Cell, others: impl Iterator<Item = Cell>, reach: i32) -> Self {
        let Self { low, high } = Self::around(first, others);
        Self {
            low: tile_of(Cell { x: low.x.saturating_sub(reach), y: low.y.saturating_sub(reach) }),
            high: tile_of(Cell { x: high.x.saturating_add(reach), y: high.y.saturating_add(reach) }),
        }
    }

    /// Widened to hold another tile.
    #[must_use]
    pub fn with(self, tile: Cell) -> Self {
        Self {
            low: Cell { x: self.low.x.min(tile.x), y: self.low.y.min(tile.y) },
            high: Cell { x: self.high.x.max(tile.x), y: self.high.y.max(tile.y) },
        }
    }

    /// Its tiles, row by row.
    pub fn iter(&self) -> impl Iterator<Item = Cell> {
        let Self { low, high } = *self;
        (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| Cell { x, y }))
    }
}
