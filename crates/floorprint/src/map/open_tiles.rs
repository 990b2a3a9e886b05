//! The tiles of a rectangle, at hand for many writes.

use super::cell::Cell;
use super::tile_rectangle::TileRectangle;
use std::sync::Arc;

/// Tiles that are being written. That no copy of the grid shares a tile is seen to once, when it is first asked for:
/// asking takes two atomic operations, which for each cell of each ray would be most of the work.
#[derive(Debug)]
pub struct OpenTiles<'a, T> {
    rectangle: TileRectangle,
    columns: i32,
    tiles: Vec<OpenTile<'a, T>>,
}

#[derive(Debug)]
enum OpenTile<'a, T> {
    /// Not asked for yet.
    Shut(&'a mut Option<Arc<T>>),
    /// This grid's own.
    Open(&'a mut T),
    /// On the way from the one to the other.
    Opening,
}

impl<'a, T> OpenTiles<'a, T> {
    /// `rows` are those of the rectangle.
    pub(super) fn new(rectangle: TileRectangle, rows: impl Iterator<Item = &'a mut [Option<Arc<T>>]>) -> Self {
        let columns = rectangle.high.x - rectangle.low.x + 1;
        let count = columns * (rectangle.high.y - rectangle.low.y + 1);
        let mut tiles = Vec::with_capacity(count as usize);
        rows.for_each(|row| tiles.extend(row.iter_mut().map(OpenTile::Shut)));
        Self { rectangle, columns, tiles }
    }
}

impl<T: Clone + Default> OpenTiles<'_, T> {
    /// The tile at these tile coordinates: made if it is new, copied if it is shared. `None` outside the rectangle.
    #[inline]
    pub fn tile_mut(&mut self, at: Cell) -> Option<&mut T> {
        let TileRectangle { low, high } = self.rectangle;
        if at.x < low.x || at.x > high.x || at.y < low.y || at.y > high.y {
            return None;
        }
        let tile = self.tiles.get_mut(((at.y - low.y) * self.columns + (at.x - low.x)) as usize)?;
        if let OpenTile::Shut(_) = tile {
            tile.open();
        }
        match tile {
            OpenTile::Open(tile) => Some(tile),
            OpenTile::Shut(_) | OpenTile::Opening => None,
        }
    }
}

impl<T: Clone + Default> OpenTile<'_, T> {
    #[cold]
    fn open(&mut self) {
        *self = match std::mem::replace(self, Self::Opening) {
            Self::Shut(tile) => Self::Open(Arc::make_mut(tile.get_or_insert_with(Arc::default))),
            opened => opened,
        };
    }
}
