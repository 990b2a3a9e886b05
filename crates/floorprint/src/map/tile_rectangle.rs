//! A rectangle of tiles: where a scan may have drawn.

use super::cell::Cell;

/// The tiles from `low` to `high`, both included; tile coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileRectangle {
    /// Least column and row.
    pub low: Cell,
    /// Largest column and row.
    pub high: Cell,
}

impl TileRectangle {
    /// The smallest rectangle that holds `tiles` and `first`.
    #[must_use]
    pub fn around(first: Cell, tiles: impl Iterator<Item = Cell>) -> Self {
        tiles.fold(Self { low: first, high: first }, Self::with)
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
