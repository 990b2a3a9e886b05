//! The map as square pictures at several scales, of which only those change whose cells do.

use floorprint::map::{Cell, Occupancy, OccupancyGrid, Raster, TILE_SIDE};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Side of a picture, pixels; at the finest level a pixel is a cell.
pub const PICTURE_SIDE: usize = 256;
/// Levels; at each a pixel is 2×2 of the level before.
pub const LEVELS: u8 = 6;
/// Tiles of the grid in a picture's side.
const TILES: i32 = PICTURE_SIDE as i32 / TILE_SIDE;

/// Column and row of a picture of the finest level; rows count with the world's y.
pub type Place = (i32, i32);

/// A map, and when each part of it changed. Copies share the cells.
#[derive(Debug, Clone, Default)]
pub struct MapPicture {
    cells: Cells,
    /// Pictures of the finest level that show something, and the revision at which each changed last.
    pub changed: BTreeMap<Place, u64>,
}

#[derive(Debug, Clone, Default)]
enum Cells {
    #[default]
    Nothing,
    Grid(OccupancyGrid),
    Raster(Arc<Raster<Occupancy>>),
}

impl MapPicture {
    /// A map that does not change any more.
    #[must_use]
    pub fn of_raster(raster: Raster<Occupancy>, revision: u64) -> Self {
        let side = PICTURE_SIDE;
        let (columns, rows) = (raster.width.div_ceil(side) as i32, raster.height.div_ceil(side) as i32);
        let all = (0..columns).flat_map(|column| (0..rows).map(move |row| ((column, row), revision)));
        Self { changed: all.collect(), cells: Cells::Raster(Arc::new(raster)) }
    }

    /// Another map in its place, which does not change any more.
    #[must_use]
    pub fn replaced_by(&self, raster: Raster<Occupancy>, revision: u64) -> Self {
        let mut new = Self::of_raster(raster, revision);
        // Nothing is to be seen any more where only the old one was.
        new.changed.extend(self.changed.keys().map(|&place| (place, revision)));
        new
    }

    /// The same map as it is now in `grid`.
    #[must_use]
    pub fn followed_by(&self, grid: &OccupancyGrid, revision: u64) -> Self {
        let nothing;
        let earlier = match &self.cells {
            Cells::Grid(earlier) => earlier,
            Cells::Nothing | Cells::Raster(_) => {
                nothing = grid.emptied();
                &nothing
            }
        };
        let mut changed = self.changed.clone();
        for tile in grid.tiles_changed_since(earlier) {
            changed.insert((tile.x.div_euclid(TILES), tile.y.div_euclid(TILES)), revision);
        }
        Self { cells: Cells::Grid(grid.clone()), changed }
    }

    /// Side of a cell, metres; 0 as long as there is no map.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        match &self.cells {
            Cells::Nothing => 0.0,
            Cells::Grid(grid) => grid.resolution_m(),
            Cells::Raster(raster) => raster.resolution_m,
        }
    }

    /// Lower left corner of the cell (0, 0), metres.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 2] {
        match &self.cells {
            Cells::Nothing | Cells::Grid(_) => [0.0; 2],
            Cells::Raster(raster) => raster.origin_m,
        }
    }

    /// The whole map; `None` where nothing was seen.
    #[must_use]
    pub fn to_raster(&self) -> Option<Raster<Occupancy>> {
        match &self.cells {
            Cells::Nothing => None,
            Cells::Grid(grid) => grid.to_raster(),
            Cells::Raster(raster) => Some(Raster::clone(raster)),
        }
    }

    /// The whole map in the smallest pixels of which there are at most so many, of those that levels have; `None` where
    /// nothing was seen. It may reach beyond what was seen.
    #[must_use]
    pub fn coarse_raster(&self, most_pixels: usize) -> Option<Raster<Occupancy>> {
        let columns = self.changed.keys().map(|place| place.0);
        let rows = self.changed.keys().map(|place| place.1);
        let first = [columns.clone().min()?, rows.clone().min()?];
        let last = [columns.max()?, rows.max()?];
        let size = |level: u8| {
            let places = |axis: usize| ((last[axis] >> level) - (first[axis] >> level) + 1) as usize * PICTURE_SIDE;
            [places(0), places(1)]
        };
        let level = (0..LEVELS - 1).find(|&level| size(level)[0] * size(level)[1] <= most_pixels).unwrap_or(LEVELS - 1);
        let [width, height] = size(level);
        let mut cells = vec![Occupancy::Unknown; width * height];
        let places: BTreeSet<Place> = self.changed.keys().map(|place| (place.0 >> level, place.1 >> level)).collect();
        for (column, row) in places {
            let Some(pixels) = self.picture(level, (column, row)) else { continue };
            let start = [(column - (first[0] >> level)) as usize, ((last[1] >> level) - row) as usize];
            for (line, pixels) in pixels.chunks_exact(PICTURE_SIDE).enumerate() {
                let at = (start[1] * PICTURE_SIDE + line) * width + start[0] * PICTURE_SIDE;
                cells[at..at + PICTURE_SIDE].copy_from_slice(pixels);
            }
        }
        let resolution_m = self.resolution_m() * f64::from(1_u32 << level);
        let corner = |axis: usize| f64::from((first[axis] >> level) * PICTURE_SIDE as i32) * resolution_m;
        let origin_m = [0, 1].map(|axis| self.origin_m()[axis] + corner(axis));
        Some(Raster { width, height, resolution_m, origin_m, cells })
    }

    /// When the picture at a place of a level changed last; `None` where it shows nothing.
    #[must_use]
    pub fn changed_at(&self, level: u8, (column, row): Place) -> Option<u64> {
        let side = 1_i32 << level.min(LEVELS - 1);
        let rows = row.checked_mul(side)?..row.checked_add(1)?.checked_mul(side)?;
        (column.checked_mul(side)?..column.checked_add(1)?.checked_mul(side)?)
            .flat_map(|column| {
                self.changed.range((column, rows.start)..(column, rows.end)).map(|(_, revision)| *revision)
            })
            .max()
    }

    /// The picture at a place of a level, row by row from the top; `None` where nothing was seen. Where several cells
    /// share a pixel, one that is occupied shows.
    #[must_use]
    pub fn picture(&self, level: u8, place: Place) -> Option<Vec<Occupancy>> {
        self.changed_at(level, place)?;
        let scale = 1_usize << level.min(LEVELS - 1);
        let mut pixels = vec![Occupancy::Unknown; PICTURE_SIDE * PICTURE_SIDE];
        // Row 0 of the pixels is the top, the largest y.
        let mut put = |column: usize, up: usize, cell: Occupancy| {
            let pixel = &mut pixels[(PICTURE_SIDE - 1 - up / scale) * PICTURE_SIDE + column / scale];
            if cell == Occupancy::Occupied || *pixel == Occupancy::Unknown {
                *pixel = cell;
            }
        };
        let side = PICTURE_SIDE * scale;
        match &self.cells {
            Cells::Nothing => return None,
            Cells::Grid(grid) => {
                let tiles = TILES * scale as i32;
                let tile_side = TILE_SIDE as usize;
                for (right, up) in (0..tiles).flat_map(|up| (0..tiles).map(move |right| (right, up))) {
                    let at = Cell { x: place.0 * tiles + right, y: place.1 * tiles + up };
                    let Some(tile) = grid.tile(at) else { continue };
                    for (index, &cell) in tile.iter().enumerate().filter(|(_, cell)| **cell != Occupancy::Unknown) {
                        let (column, row) = (index % tile_side, index / tile_side);
                        put(right as usize * tile_side + column, up as usize * tile_side + row, cell);
                    }
                }
            }
            Cells::Raster(raster) => {
                let first = [place.0, place.1].map(|at| i64::from(at) * side as i64);
                for (column, up) in (0..side).flat_map(|up| (0..side).map(move |column| (column, up))) {
                    let row = raster.height as i64 - 1 - (first[1] + up as i64);
                    if let Some(index) = raster.index(row, first[0] + column as i64) {
                        put(column, up, raster.cells[index]);
                    }
                }
            }
        }
        Some(pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::BodyScan;
    use floorprint::geometry::Pose2;
    use floorprint::map::MapConfig;

    fn grid_with(points: &[[f32; 2]]) -> OccupancyGrid {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        let mut scan = BodyScan::default();
        points.iter().for_each(|[x, y]| scan.hits.push(*x, *y));
        grid.draw_scan(&Pose2::new(0.025, 0.025, 0.0), &scan);
        grid
    }

    #[test]
    fn only_what_changed_is_new() {
        let mut grid = grid_with(&[[3.0, 0.0]]);
        let first = MapPicture::default().followed_by(&grid, 1);
        assert_eq!(first.changed, BTreeMap::from([((0, 0), 1)]));
        let mut scan = BodyScan::default();
        scan.hits.push(2.0, 0.0);
        grid.draw_scan(&Pose2::new(20.0, 20.0, 0.0), &scan);
        let second = first.followed_by(&grid, 2);
        assert_eq!(second.changed, BTreeMap::from([((0, 0), 1), ((1, 1), 2)]));
        assert_eq!([second.changed_at(0, (0, 0)), second.changed_at(1, (0, 0))], [Some(1), Some(2)]);
        assert_eq!([second.changed_at(0, (5, 0)), second.changed_at(0, (i32::MAX, 0))], [None, None]);
    }

    #[test]
    fn large_maps_come_in_larger_pixels() {
        let picture = MapPicture::default().followed_by(&grid_with(&[[3.0, 0.0], [-7.0, 20.0]]), 1);
        let exact = picture.to_raster().unwrap();
        for (most, resolution_m) in [(usize::MAX, 0.05), (3 * PICTURE_SIDE * PICTURE_SIDE, 0.1), (1, 1.6)] {
            let raster = picture.coarse_raster(most).unwrap();
            assert!((raster.resolution_m - resolution_m).abs() < 1e-12, "{} m", raster.resolution_m);
            for index in (0..exact.cells.len()).filter(|&index| exact.cells[index] == Occupancy::Occupied) {
                let (row, column) = raster.row_and_column_at(exact.center_m(index));
                let cell = raster.index(row, column).map(|index| raster.cells[index]);
                assert_eq!(cell, Some(Occupancy::Occupied), "at {:?}", exact.center_m(index));
            }
        }
    }

    #[test]
    fn pictures_of_all_levels_show_the_walls() {
        let picture = MapPicture::default().followed_by(&grid_with(&[[3.0, 0.0], [0.0, 2.0]]), 1);
        for level in 0..LEVELS {
            let pixels = picture.picture(level, (0, 0)).unwrap();
            let at =
                |cell: [usize; 2]| pixels[(PICTURE_SIDE - 1 - (cell[1] >> level)) * PICTURE_SIDE + (cell[0] >> level)];
            assert_eq!([at([60, 0]), at([0, 40])], [Occupancy::Occupied; 2], "level {level}");
        }
        // The same from a raster, whose cells begin at its corner.
        let raster = picture.to_raster().unwrap();
        let of_raster = MapPicture::of_raster(raster, 1);
        assert_eq!(of_raster.picture(0, (0, 0)), picture.picture(0, (0, 0)));
        assert!(picture.picture(0, (-1, 0)).is_none());
    }
}
