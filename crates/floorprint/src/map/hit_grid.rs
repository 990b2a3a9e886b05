//! The grid of GMapping (Grisetti, Stachniss & Burgard 2007): every cell counts the rays that
//! ended in it and those that visited it, and keeps the mean of the end points.

use super::cell::Cell;
use super::ray::passed_cells;
use super::tile_grid::{TILE_CELLS, TILE_SIDE, TileGrid, index_in_tile, tile_of};
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

#[derive(Debug, Clone)]
struct HitTile {
    /// For each row the cells that count as occupied, one bit each.
    full: [u32; TILE_SIDE as usize],
    cells: [CellHits; TILE_CELLS],
}

impl Default for HitTile {
    fn default() -> Self {
        Self { full: [0; TILE_SIDE as usize], cells: [CellHits::default(); TILE_CELLS] }
    }
}

impl HitTile {
    /// Notes whether a cell whose counts have changed is full.
    fn update_full(&mut self, index: usize, full_share: f64) {
        let (row, bit) = (index / TILE_SIDE as usize, 1 << (index % TILE_SIDE as usize));
        let CellHits { hits, visits, .. } = self.cells[index];
        if f64::from(hits) > full_share * f64::from(visits) {
            self.full[row] |= bit;
        } else {
            self.full[row] &= !bit;
        }
    }
}

/// An unbounded grid of counts and means. Copies share tiles.
#[derive(Debug, Clone)]
pub struct HitGrid {
    inverse_resolution: f64,
    full_share: f64,
    tiles: TileGrid<HitTile>,
}

/// The columns and rows next to a cell and its own.
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
        let tile = self.tiles.tile_mut(tile_of(cell));
        let hits = &mut tile.cells[index_in_tile(cell)];
        hits.hits += 1;
        hits.visits += 1;
        let gain = 1.0 / hits.hits as f32;
        for (mean, value) in hits.mean_m.iter_mut().zip(point_m) {
            *mean += gain * (value as f32 - *mean);
        }
        tile.update_full(index_in_tile(cell), self.full_share);
    }

    /// Counts a visit of the cells from `from` up to, not including, `to`.
    fn pass_along(&mut self, from: Cell, to: Cell) {
        let mut at = tile_of(from);
        let mut tile = self.tiles.tile_mut(at);
        for cell in passed_cells(from, to) {
            let here = tile_of(cell);
            if here != at {
                at = here;
                // Each tile along the ray is looked up once.
                tile = self.tiles.tile_mut(at);
            }
            let index = index_in_tile(cell);
            tile.cells[index].visits += 1;
            if tile.cells[index].hits > 0 {
                tile.update_full(index, self.full_share);
            }
        }
    }

    #[inline]
    fn cell_at(&self, point_m: [f64; 2]) -> Cell {
        Cell::containing(point_m, self.inverse_resolution)
    }

    /// The squared distance (m²) from a ray's end to the nearest mean among its cell and the eight
    /// around it, of cells that are full and whose neighbour towards the sensor is not: the
    /// fronts of walls. `before_m` is the point on the ray that lies in that neighbour of the end's cell.
    #[inline]
    #[must_use]
    pub fn squared_distance(&self, end_m: [f64; 2], before_m: [f64; 2]) -> Option<f32> {
        let cell = self.cell_at(end_m);
        let full = self.full_around(cell);
        if full == 0 {
            return None;
        }
        let mut fronts = full & !self.full_around(self.cell_at(before_m));
        let mut nearest: Option<f32> = None;
        while fronts != 0 {
            let place = fronts.trailing_zeros() as usize;
            fronts &= fronts - 1;
            let [x, y] = self.mean(Cell { x: cell.x + NEAR[place % 3], y: cell.y + NEAR[place / 3] });
            let square = (end_m[0] as f32 - x).powi(2) + (end_m[1] as f32 - y).powi(2);
            nearest = Some(nearest.map_or(square, |nearest| nearest.min(square)));
        }
        nearest
    }

    #[inline]
    fn mean(&self, cell: Cell) -> [f32; 2] {
        self.tiles.tile(tile_of(cell)).map_or([0.0; 2], |tile| tile.cells[index_in_tile(cell)].mean_m)
    }

    /// Which of the nine cells around and including this one are full: one bit each, row by row.
    #[inline]
    fn full_around(&self, cell: Cell) -> u32 {
        let (column, row) = (cell.x & (TILE_SIDE - 1), cell.y & (TILE_SIDE - 1));
        let inner = 1..TILE_SIDE - 1;
        if inner.contains(&column) && inner.contains(&row) {
            let Some(tile) = self.tiles.tile(tile_of(cell)) else { return 0 };
            let three = |row: i32| (tile.full[row as usize] >> (column - 1)) & 0b111;
            return three(row - 1) | three(row) << 3 | three(row + 1) << 6;
        }
        let mut full = 0;
        for (place, (dy, dx)) in NEAR.iter().flat_map(|dy| NEAR.map(|dx| (dy, dx))).enumerate() {
            let near = Cell { x: cell.x + dx, y: cell.y + dy };
            full |= u32::from(self.is_full(near)) << place;
        }
        full
    }

    #[inline]
    fn is_full(&self, cell: Cell) -> bool {
        let (column, row) = (cell.x & (TILE_SIDE - 1), cell.y & (TILE_SIDE - 1));
        self.tiles.tile(tile_of(cell)).is_some_and(|tile| tile.full[row as usize] >> column & 1 == 1)
    }
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
