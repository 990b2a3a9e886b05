//! The grid of GMapping (Grisetti, Stachniss & Burgard 2007): every cell counts the rays that
//! ended in it and those that visited it, and keeps the mean of the end points.

use super::cell::Cell;
use super::ray::passed_cells;
use super::tile_grid::{TILE_BITS, TILE_CELLS, TILE_SIDE, TileGrid, index_in_tile, tile_of};
use crate::frame::BodyScan;
use crate::geometry::Pose2;

/// What one cell has seen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct CellHits {
    /// Mean of the end points, metres, world.
    mean_m: [f32; 2],
    /// Rays that ended here.
    hits: u32,
    /// Rays that ended here or passed.
    visits: u32,
}

/// How far around a tile it knows which cells are full, cells: two to the cell before a ray's end, one around that.
const BORDER: i32 = 3;
/// Side of a tile and its border.
const BORDERED_SIDE: usize = (TILE_SIDE + 2 * BORDER) as usize;

#[derive(Debug, Clone)]
struct HitTile {
    /// For each row of the tile and its border the cells that count as occupied, one bit each.
    full: [u64; BORDERED_SIDE],
    cells: [CellHits; TILE_CELLS],
}

impl Default for HitTile {
    fn default() -> Self {
        Self { full: [0; BORDERED_SIDE], cells: [CellHits::default(); TILE_CELLS] }
    }
}

impl HitTile {
    /// Which of the nine cells around and including this column and row are full: one bit each, row by row.
    #[inline]
    fn full_around(&self, column: i32, row: i32) -> u32 {
        let first = (row + BORDER - 1) as usize;
        let three = |row: usize| (self.full[row] >> (column + BORDER - 1)) as u32 & 0b111;
        three(first) | three(first + 1) << 3 | three(first + 2) << 6
    }
}

/// An unbounded grid of counts and means. Copies share tiles.
#[derive(Debug, Clone)]
pub struct HitGrid {
    inverse_resolution: f64,
    full_share: f64,
    tiles: TileGrid<HitTile>,
}

/// Offsets to the column or row before, the same, and after.
const NEAR: [i32; 3] = [-1, 0, 1];

impl HitGrid {
    /// An empty grid of cells with side `cell_m` (metres), which count as full when more than
    /// `full_share` of the rays that visited them ended in them.
    #[must_use]
    pub fn new(cell_m: f64, full_share: f64) -> Self {
        Self { inverse_resolution: 1.0 / cell_m, full_share, tiles: TileGrid::default() }
    }

    /// Writes a scan taken at `world_from_body`. With `trace_rays` the cells that rays pass are
    /// visited too; else only those in which they end.
    pub fn add_scan(&mut self, world_from_body: &Pose2, scan: &BodyScan, trace_rays: bool) {
        let (sin, cos) = world_from_body.theta.sin_cos();
        let to_world = |[x, y]: [f32; 2]| {
            let (x, y) = (f64::from(x), f64::from(y));
            [world_from_body.x + cos * x - sin * y, world_from_body.y + sin * x + cos * y]
        };
        let origin = self.cell_at(world_from_body.transform_point(scan.origin_m));
        for point in scan.hits.iter().map(to_world) {
            if trace_rays {
                self.pass_along(origin, self.cell_at(point));
            }
            self.add_hit(point);
        }
        if trace_rays {
            for point in scan.free_ends.iter().map(to_world) {
                self.pass_along(origin, self.cell_at(point));
            }
        }
    }

    fn add_hit(&mut self, point_m: [f64; 2]) {
        let cell = self.cell_at(point_m);
        let Some(tile) = self.tiles.tile_mut(tile_of(cell)) else { return };
        let hits = &mut tile.cells[index_in_tile(cell)];
        hits.hits += 1;
        hits.visits += 1;
        let gain = 1.0 / hits.hits as f32;
        for (mean, value) in hits.mean_m.iter_mut().zip(point_m) {
            *mean += gain * (value as f32 - *mean);
        }
        self.update_full(cell);
    }

    /// Counts a visit of the cells from `from` up to, not including, `to`.
    fn pass_along(&mut self, from: Cell, to: Cell) {
        let mut at = tile_of(from);
        // Between two cells that the grid holds it holds them all.
        if !self.tiles.make_room(tile_of(to)) {
            return;
        }
        let Some(mut tile) = self.tiles.tile_mut(at) else { return };
        for cell in passed_cells(from, to) {
            let here = tile_of(cell);
            if here != at {
                at = here;
                // Each tile along the ray is looked up once.
                let Some(next) = self.tiles.tile_mut(at) else { return };
                tile = next;
            }
            let hits = &mut tile.cells[index_in_tile(cell)];
            hits.visits += 1;
            if hits.hits > 0 {
                self.update_full(cell);
                let Some(again) = self.tiles.tile_mut(at) else { return };
                tile = again;
            }
        }
    }

    /// Notes in all tiles that know of it whether a cell whose counts have changed is full.
    fn update_full(&mut self, cell: Cell) {
        let Some(tile) = self.tiles.tile(tile_of(cell)) else { return };
        let CellHits { hits, visits, .. } = tile.cells[index_in_tile(cell)];
        let full = f64::from(hits) > self.full_share * f64::from(visits);
        if full == self.is_full(cell) {
            return;
        }
        let first = tile_of(Cell { x: cell.x - BORDER, y: cell.y - BORDER });
        let last = tile_of(Cell { x: cell.x + BORDER, y: cell.y + BORDER });
        for y in first.y..=last.y {
            for x in first.x..=last.x {
                let (column, row) = (cell.x - (x << TILE_BITS) + BORDER, cell.y - (y << TILE_BITS) + BORDER);
                let Some(tile) = self.tiles.tile_mut(Cell { x, y }) else { continue };
                let bits = &mut tile.full[row as usize];
                *bits = *bits & !(1 << column) | u64::from(full) << column;
            }
        }
    }

    fn is_full(&self, cell: Cell) -> bool {
        let (column, row) = place_in_tile(cell);
        self.tiles.tile(tile_of(cell)).is_some_and(|tile| tile.full_around(column, row) >> 4 & 1 == 1)
    }

    #[inline]
    fn cell_at(&self, point_m: [f64; 2]) -> Cell {
        Cell::containing(point_m, self.inverse_resolution)
    }

    /// The squared distance (m²) from a ray's end to the nearest mean among its cell and the eight
    /// around it, of cells that are full and whose neighbour towards the sensor is not: the
    /// fronts of walls. `before_m` is the point on the ray
    /// that lies in that neighbour of the end's cell, at most two cells away from it.
    #[inline]
    #[must_use]
    pub fn squared_distance(&self, end_m: [f64; 2], before_m: [f64; 2]) -> Option<f32> {
        let cell = self.cell_at(end_m);
        let tile = self.tiles.tile(tile_of(cell))?;
        let (column, row) = place_in_tile(cell);
        let full = tile.full_around(column, row);
        if full == 0 {
            return None;
        }
        let before = self.cell_at(before_m);
        let (dx, dy) =
            ((before.x - cell.x).clamp(1 - BORDER, BORDER - 1), (before.y - cell.y).clamp(1 - BORDER, BORDER - 1));
        let mut fronts = full & !tile.full_around(column + dx, row + dy);
        let mut nearest = f32::INFINITY;
        while fronts != 0 {
            let place = fronts.trailing_zeros() as usize;
            fronts &= fronts - 1;
            let [x, y] = self.mean(Cell { x: cell.x + NEAR[place % 3], y: cell.y + NEAR[place / 3] });
            nearest = nearest.min((end_m[0] as f32 - x).powi(2) + (end_m[1] as f32 - y).powi(2));
        }
        nearest.is_finite().then_some(nearest)
    }

    #[inline]
    fn mean(&self, cell: Cell) -> [f32; 2] {
        self.tiles.tile(tile_of(cell)).map_or([0.0; 2], |tile| tile.cells[index_in_tile(cell)].mean_m)
    }
}

/// Column and row of a cell in its tile.
#[inline]
fn place_in_tile(cell: Cell) -> (i32, i32) {
    (cell.x & (TILE_SIDE - 1), cell.y & (TILE_SIDE - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scan_with(points: &[[f32; 2]]) -> BodyScan {
        let mut scan = BodyScan::default();
        points.iter().for_each(|[x, y]| scan.hits.push(*x, *y));
        scan
    }

    #[test]
    fn a_wall_is_found_from_the_side_it_was_seen_from() {
        let mut grid = HitGrid::new(0.1, 0.1);
        // A wall two cells thick.
        grid.add_scan(&Pose2::IDENTITY, &scan_with(&[[1.02, 0.05], [1.12, 0.05]]), false);
        let front = grid.squared_distance([1.05, 0.05], [0.91, 0.05]).unwrap();
        assert!((front - 0.0009).abs() < 1e-6);
        // Its second layer is hidden behind the first: from inside, the first is still the nearest front.
        let inside = grid.squared_distance([1.15, 0.05], [1.01, 0.05]).unwrap();
        assert!((inside - 0.0169).abs() < 1e-5);
        assert_eq!(grid.squared_distance([2.0, 0.05], [1.86, 0.05]), None);
    }

    #[test]
    fn rays_that_pass_open_a_cell_again() {
        let mut grid = HitGrid::new(0.1, 0.1);
        grid.add_scan(&Pose2::IDENTITY, &scan_with(&[[1.05, 0.05]]), true);
        assert!(grid.squared_distance([1.05, 0.05], [0.91, 0.05]).is_some());
        for _ in 0..9 {
            grid.add_scan(&Pose2::IDENTITY, &scan_with(&[[3.05, 0.05]]), true);
        }
        assert_eq!(grid.squared_distance([1.05, 0.05], [0.91, 0.05]), None);
    }

    proptest! {
        #[test]
        fn the_nearest_front_is_the_one_that_a_plain_search_finds(
            points in prop::collection::vec((-2.0..2.0_f32, -2.0..2.0_f32), 1..200),
            ends in prop::collection::vec((-2.0..2.0_f64, -2.0..2.0_f64, -3.0..3.0_f64), 1..50),
        ) {
            let mut grid = HitGrid::new(0.05, 0.1);
            let points: Vec<_> = points.into_iter().map(|(x, y)| [x, y]).collect();
            grid.add_scan(&Pose2::IDENTITY, &scan_with(&points), false);
            for (x, y, angle) in ends {
                let before = [x - 0.07 * angle.cos(), y - 0.07 * angle.sin()];
                let (cell, toward) = (grid.cell_at([x, y]), grid.cell_at(before));
                let (dx, dy) = (toward.x - cell.x, toward.y - cell.y);
                let mut nearest = f32::INFINITY;
                for (column, row) in NEAR.iter().flat_map(|row| NEAR.map(|column| (column, row))) {
                    let near = Cell { x: cell.x + column, y: cell.y + row };
                    if grid.is_full(near) && !grid.is_full(Cell { x: near.x + dx, y: near.y + dy }) {
                        let [mean_x, mean_y] = grid.mean(near);
                        nearest = nearest.min((x as f32 - mean_x).powi(2) + (y as f32 - mean_y).powi(2));
                    }
                }
                prop_assert_eq!(grid.squared_distance([x, y], before).unwrap_or(f32::INFINITY), nearest);
            }
        }

        #[test]
        fn means_lie_in_their_cells(points in prop::collection::vec((-1.0..1.0_f32, -1.0..1.0_f32), 1..200)) {
            let mut grid = HitGrid::new(0.25, 0.1);
            let points: Vec<_> = points.into_iter().map(|(x, y)| [x, y]).collect();
            grid.add_scan(&Pose2::new(50.0, -30.0, 0.4), &scan_with(&points), true);
            for (at, tile) in grid.tiles.iter() {
                for (index, hits) in tile.cells.iter().enumerate().filter(|(_, hits)| hits.hits > 0) {
                    let corner = [at.x * TILE_SIDE + index as i32 % TILE_SIDE, at.y * TILE_SIDE + index as i32 / TILE_SIDE];
                    for (mean, corner) in hits.mean_m.iter().zip(corner) {
                        let low = corner as f32 * 0.25;
                        prop_assert!((low - 1e-4..=low + 0.25 + 1e-4).contains(mean));
                    }
                    prop_assert!(hits.visits >= hits.hits);
                }
            }
        }
    }
}
