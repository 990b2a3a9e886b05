//! A grid, without fixed bounds, of square tiles that copies share until one of them writes.
//!
//! A copy of the grid costs one reference count per tile (Eliazar & Parr 2003 share
//! maps between particles for the same reason; tiles make it simple).

use super::cell::Cell;
use super::open_tiles::OpenTiles;
use super::tile_rectangle::TileRectangle;
use std::sync::Arc;

/// Base-2 logarithm of the tiles' side in cells.
pub const TILE_BITS: u32 = 5;
/// Side of a tile, cells.
pub const TILE_SIDE: i32 = 1 << TILE_BITS;
/// Number of cells of a tile.
pub const TILE_CELLS: usize = 1 << (2 * TILE_BITS);
/// Largest number of tiles that the rectangle around all tiles may hold: more than a square
/// kilometre of 5 cm cells. One stray point must not cost all memory.
const LARGEST_DIRECTORY: i64 = 1 << 20;
/// Tile coordinates stay within ± this, so that no sum of cells overflows.
const FARTHEST_TILE: i32 = 1 << 24;

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

/// The cell with this index within a tile, given the tile's coordinates.
#[inline]
#[must_use]
pub fn cell_in_tile(tile: Cell, index: usize) -> Cell {
    Cell { x: (tile.x << TILE_BITS) + index as i32 % TILE_SIDE, y: (tile.y << TILE_BITS) + index as i32 / TILE_SIDE }
}

impl<T> TileGrid<T> {
    /// The tile at these tile coordinates, if it was ever written.
    #[inline]
    #[must_use]
    pub fn tile(&self, at: Cell) -> Option<&T> {
        self.tiles[self.index_of(at)?].as_deref()
    }

    /// All tiles that exist with their tile coordinates, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (Cell, &T)> {
        self.tiles.iter().enumerate().filter_map(|(index, tile)| {
            let (column, row) = (index as i32 % self.columns, index as i32 / self.columns);
            tile.as_deref().map(|tile| (Cell { x: self.first.x + column, y: self.first.y + row }, tile))
        })
    }

    /// Tile coordinates of the tiles that are not those of `earlier`, which was copied from this grid before: written,
    /// new, or gone since.
    pub fn replaced_since(&self, earlier: &Self) -> Vec<Cell> {
        let is_other = |at: Cell, tile: &T| earlier.tile(at).is_none_or(|old| !std::ptr::eq(old, tile));
        let replaced = self.iter().filter(|(at, tile)| is_other(*at, tile)).map(|(at, _)| at);
        replaced.chain(earlier.iter().map(|(at, _)| at).filter(|&at| self.tile(at).is_none())).collect()
    }

    /// Number of tiles that exist, and how many of them no copy shares.
    #[must_use]
    pub fn tile_counts(&self) -> (usize, usize) {
        let present = self.tiles.iter().flatten();
        let own = present.clone().filter(|tile| Arc::strong_count(tile) == 1).count();
        (present.count(), own)
    }

    #[inline]
    fn index_of(&self, at: Cell) -> Option<usize> {
        let column = at.x.wrapping_sub(self.first.x);
        let row = at.y.wrapping_sub(self.first.y);
        ((column as u32) < (self.columns as u32) && (row as u32) < (self.rows as u32))
            .then(|| (row * self.columns + column) as usize)
    }

    /// Whether the directory holds all tiles of a rectangle as it is.
    #[must_use]
    pub fn holds(&self, rectangle: &TileRectangle) -> bool {
        self.index_of(rectangle.low).is_some() && self.index_of(rectangle.high).is_some()
    }

    /// Whether any order of writing to these tiles is sure to be within what the grid can span.
    #[must_use]
    pub fn can_hold(rectangle: &TileRectangle) -> bool {
        let TileRectangle { low, high } = rectangle;
        let longer = (i64::from(high.x) - i64::from(low.x)).max(i64::from(high.y) - i64::from(low.y)) + 1;
        // With all that `grow_to` spares.
        let side = 2 * longer + 16;
        let farthest = [low.x, low.y, high.x, high.y].map(i32::saturating_abs).into_iter().fold(0, i32::max);
        side * side <= LARGEST_DIRECTORY && farthest <= FARTHEST_TILE
    }

    /// Takes over all tiles of another grid, in place of its own.
    pub fn adopt(&mut self, mut other: Self) {
        if self.tiles.is_empty() {
            *self = other;
            return;
        }
        for index in 0..other.tiles.len() {
            let Some(tile) = other.tiles[index].take() else { continue };
            let (column, row) = (index as i32 % other.columns, index as i32 / other.columns);
            let at = Cell { x: other.first.x + column, y: other.first.y + row };
            if self.make_room(at)
                && let Some(own) = self.index_of(at)
            {
                self.tiles[own] = Some(tile);
            }
        }
    }

    /// The tiles of a rectangle, for many writes; `None` where that is beyond what the grid can span (see
    /// [`make_room`](Self::make_room)).
    #[must_use]
    pub fn open(&mut self, rectangle: TileRectangle) -> Option<OpenTiles<'_, T>> {
        let TileRectangle { low, high } = rectangle;
        if !self.make_room(low) || !self.make_room(high) {
            return None;
        }
        let columns = (low.x - self.first.x) as usize..=(high.x - self.first.x) as usize;
        let rows = self.tiles.chunks_exact_mut(self.columns as usize).skip((low.y - self.first.y) as usize);
        let rows = rows.take((high.y - low.y + 1) as usize);
        Some(OpenTiles::new(rectangle, rows.map(|row| &mut row[columns.clone()])))
    }

    /// Forgets the tile at these tile coordinates.
    pub fn remove(&mut self, at: Cell) {
        if let Some(index) = self.index_of(at) {
            self.tiles[index] = None;
        }
    }

    /// Makes the directory hold the tile coordinates `at`; tells whether it does. It does not
    /// where the rectangle around all tiles would grow beyond reason.
    #[inline]
    pub fn make_room(&mut self, at: Cell) -> bool {
        self.index_of(at).is_some() || self.grow_to(at)
    }

    /// Grows the directory, with room to spare on the side it grows to.
    fn grow_to(&mut self, at: Cell) -> bool {
        if at.x.saturating_abs() > FARTHEST_TILE || at.y.saturating_abs() > FARTHEST_TILE {
            return false;
        }
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
        if i64::from(columns) * i64::from(rows) > LARGEST_DIRECTORY {
            return false;
        }
        let mut tiles = Vec::new();
        tiles.resize_with(columns as usize * rows as usize, || None);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let moved = (self.first.y + row - low.y) * columns + (self.first.x + column - low.x);
                tiles[moved as usize] = self.tiles[(row * self.columns + column) as usize].take();
            }
        }
        *self = Self { first: low, columns, rows, tiles };
        true
    }
}

impl<T: Clone + Default> TileGrid<T> {
    /// The tile at these tile coordinates, for writing: made if it is new, copied if it is shared.
    /// `None` beyond what the grid can span (see [`make_room`](Self::make_room)).
    #[inline]
    pub fn tile_mut(&mut self, at: Cell) -> Option<&mut T> {
        if !self.make_room(at) {
            return None;
        }
        let index = self.index_of(at)?;
        Some(Arc::make_mut(self.tiles[index].get_or_insert_with(|| Arc::new(T::default()))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn tile() -> impl Strategy<Value = (i32, i32)> {
        (-60..60_i32, -60..60_i32)
    }

    fn contents(grid: &TileGrid<u32>) -> BTreeMap<(i32, i32), u32> {
        grid.iter().map(|(at, tile)| ((at.y, at.x), *tile)).collect()
    }

    proptest! {
        #[test]
        fn the_grid_holds_what_was_written_and_copies_do_not_see_later_writes(
            before in prop::collection::vec((tile(), 1..9_u32), 0..30),
            after in prop::collection::vec((tile(), 1..9_u32), 0..30),
        ) {
            let (mut grid, mut model) = (TileGrid::default(), BTreeMap::new());
            let write = |grid: &mut TileGrid<u32>, model: &mut BTreeMap<(i32, i32), u32>, writes: &[((i32, i32), u32)]| {
                for &((x, y), value) in writes {
                    *grid.tile_mut(Cell { x, y }).unwrap() += value;
                    *model.entry((y, x)).or_default() += value;
                }
            };
            write(&mut grid, &mut model, &before);
            let (mut copy, mut copied) = (grid.clone(), model.clone());
            prop_assert_eq!(copy.tile_counts(), (copied.len(), 0));
            write(&mut copy, &mut copied, &after);
            prop_assert_eq!(contents(&grid), model.clone());
            prop_assert_eq!(contents(&copy), copied);
            prop_assert!(grid.iter().map(|(at, _)| (at.y, at.x)).is_sorted());
            for (x, y) in before.iter().chain(&after).map(|(at, _)| *at) {
                prop_assert_eq!(grid.tile(Cell { x, y }), model.get(&(y, x)));
            }
        }

        #[test]
        fn open_tiles_are_written_like_any_other(
            before in prop::collection::vec((tile(), 1..9_u32), 0..30),
            after in prop::collection::vec(((-9..9_i32, -9..9_i32), 1..9_u32), 1..30),
        ) {
            let mut one_by_one = TileGrid::default();
            before.iter().for_each(|&((x, y), value)| *one_by_one.tile_mut(Cell { x, y }).unwrap() += value);
            let copied = contents(&one_by_one);
            let mut at_once = one_by_one.clone();
            let mut cells = after.iter().map(|&((x, y), _)| Cell { x, y });
            let rectangle = TileRectangle::around(cells.next().unwrap(), cells);
            let mut open = at_once.open(rectangle).unwrap();
            let beside = Cell { x: rectangle.high.x + 1, y: rectangle.low.y };
            prop_assert!(open.tile_mut(beside).is_none());
            after.iter().for_each(|&((x, y), value)| *open.tile_mut(Cell { x, y }).unwrap() += value);
            prop_assert_eq!(contents(&one_by_one), copied);
            after.iter().for_each(|&((x, y), value)| *one_by_one.tile_mut(Cell { x, y }).unwrap() += value);
            prop_assert_eq!(contents(&one_by_one), contents(&at_once));
            let mut adopted = TileGrid::default();
            *adopted.tile_mut(Cell { x: 70, y: 0 }).unwrap() = 5;
            adopted.adopt(at_once);
            prop_assert_eq!(adopted.tile(Cell { x: 70, y: 0 }), Some(&5));
            prop_assert_eq!(contents(&adopted).len(), contents(&one_by_one).len() + 1);
        }

        /// What is sure to be held is held in whatever order it comes.
        #[test]
        fn what_can_be_held_is_held(tiles in prop::collection::vec((-300..300_i32, -300..300_i32), 1..40)) {
            let cells: Vec<_> = tiles.iter().map(|&(x, y)| Cell { x, y }).collect();
            let mut grid = TileGrid::<u8>::default();
            if TileGrid::<u8>::can_hold(&TileRectangle::around(cells[0], cells.iter().copied())) {
                prop_assert!(cells.iter().all(|&cell| grid.tile_mut(cell).is_some()));
            }
        }

        #[test]
        fn every_cell_has_a_place_of_its_own_in_its_tile(x in -1000..1000_i32, y in -1000..1000_i32) {
            let (at, index) = (tile_of(Cell { x, y }), index_in_tile(Cell { x, y }) as i32);
            prop_assert_eq!((at.x * TILE_SIDE + index % TILE_SIDE, at.y * TILE_SIDE + index / TILE_SIDE), (x, y));
        }
    }

    #[test]
    fn a_stray_tile_far_away_is_refused_and_costs_nothing() {
        let mut grid = TileGrid::<u32>::default();
        *grid.tile_mut(Cell { x: 3, y: -2 }).unwrap() = 7;
        let directory = grid.tiles.len();
        let far = [1 << 20, i32::MAX >> TILE_BITS, i32::MIN >> TILE_BITS, i32::MAX, i32::MIN];
        for at in far.map(|x| Cell { x, y: 1 << 20 }).into_iter().chain(far.map(|y| Cell { x: 0, y })) {
            assert!(grid.tile_mut(at).is_none() && grid.tile(at).is_none());
        }
        assert_eq!(grid.tiles.len(), directory);
        assert_eq!(grid.tile(Cell { x: 3, y: -2 }), Some(&7));
        assert!(TileGrid::<u32>::default().tile_mut(Cell { x: i32::MIN, y: 0 }).is_none());
    }
}
