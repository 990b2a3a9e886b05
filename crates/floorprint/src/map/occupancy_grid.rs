//! The occupancy grid: independent cells in log-odds (report §III.A.2, eqs. 6–7).

use super::cell::Cell;
use super::raster::{Occupancy, Raster};
use super::ray::TiledRay;
use super::tile_grid::{TILE_CELLS, TILE_SIDE, TileGrid, cell_in_tile, index_in_tile, tile_of};
use super::{MapConfig, OpenTiles, TileRectangle};
use crate::compact_scan::CompactScan;
use crate::frame::BodyScan;
use crate::geometry::Pose2;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

/// A raster of this many cells is drawn however few of them were seen: 200 m × 200 m in cells of 5 cm.
const LARGEST_RASTER_CELLS: usize = 1 << 24;

/// A larger one has at most so many cells for each that was seen.
const EMPTY_CELLS_PER_SEEN: usize = 64;

/// Log-odds are kept as 16-bit numbers in steps of 1/256.
const STEPS_PER_UNIT: f64 = 256.0;

/// Log-odds of the cells of one tile, row by row.
#[derive(Debug, Clone)]
struct OccupancyTile([i16; TILE_CELLS]);

impl Default for OccupancyTile {
    fn default() -> Self {
        Self([0; TILE_CELLS])
    }
}

/// A cell that a scan turned from free or unknown to occupied, or back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flip {
    /// The cell.
    pub cell: Cell,
    /// Whether it is occupied now.
    pub occupied: bool,
}

/// An unbounded grid of log-odds; positive is occupied, zero is unknown. Copies share tiles.
#[derive(Debug, Clone)]
pub struct OccupancyGrid {
    resolution_m: f64,
    hit: i16,
    pass: i16,
    limit: i16,
    grazing_clearance_m: f32,
    tiles: TileGrid<OccupancyTile>,
}

impl OccupancyGrid {
    /// An empty grid.
    #[must_use]
    pub fn new(config: &MapConfig) -> Self {
        let fixed_point = |log_odds: f64| (log_odds * STEPS_PER_UNIT).round().clamp(0.0, 32_000.0) as i16;
        Self {
            resolution_m: config.resolution_m,
            hit: fixed_point(config.hit_log_odds),
            pass: fixed_point(config.pass_log_odds),
            limit: fixed_point(config.limit_log_odds),
            grazing_clearance_m: (config.grazing_clearance_cells * config.resolution_m) as f32,
            tiles: TileGrid::default(),
        }
    }

    /// A grid of the same kind on which nothing is drawn.
    #[must_use]
    pub fn emptied(&self) -> Self {
        Self { tiles: TileGrid::default(), ..*self }
    }

    /// Side of a cell, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The cell that holds a point of the world, metres.
    #[must_use]
    pub fn cell_at(&self, point_m: [f64; 2]) -> Cell {
        Cell::containing(point_m, 1.0 / self.resolution_m)
    }

    /// Log-odds of a cell; 0 where nothing was ever seen.
    #[must_use]
    pub fn log_odds(&self, cell: Cell) -> f64 {
        f64::from(self.raw(cell)) / STEPS_PER_UNIT
    }

    /// Whether a cell is more likely occupied than free.
    #[inline]
    #[must_use]
    pub fn is_occupied(&self, cell: Cell) -> bool {
        self.raw(cell) > 0
    }

    #[inline]
    fn raw(&self, cell: Cell) -> i16 {
        self.tiles.tile(tile_of(cell)).map_or(0, |tile| tile.0[index_in_tile(cell)])
    }

    /// Writes a scan taken at `world_from_body`: the cells that its rays pass become freer,
    /// the cells in which they end more occupied. Every cell that changes sides is
    /// appended to `flips`, in the order of the changes.
    pub fn add_scan(&mut self, world_from_body: &Pose2, scan: &BodyScan, flips: &mut Vec<Flip>) {
        self.draw(world_from_body, scan, |_| true, &mut |flip| flips.push(flip));
    }

    /// Writes a scan taken at `world_from_body`.
    pub fn draw_scan(&mut self, world_from_body: &Pose2, scan: &BodyScan) {
        self.draw(world_from_body, scan, |_| true, &mut |_| {});
    }

    /// Writes of a scan what lies on some tiles.
    pub fn draw_scan_within(&mut self, world_from_body: &Pose2, scan: &BodyScan, tiles: &BTreeSet<Cell>) {
        self.draw(world_from_body, scan, |tile| tiles.contains(&tile), &mut |_| {});
    }

    /// Tiles that a scan may touch.
    #[must_use]
    pub fn tiles_around(&self, world_from_body: &Pose2, scan: &BodyScan) -> TileRectangle {
        let (to_world, inverse_resolution) = (world_from_body.point_transform(), 1.0 / self.resolution_m);
        let cell_at = |point_m: [f64; 2]| Cell::containing(to_world(point_m), inverse_resolution);
        let points = scan.hits.iter().chain(scan.free_ends.iter());
        TileRectangle::of_cells(cell_at(scan.origin_m), points.map(|point| cell_at(point.map(f64::from))), 0)
    }

    /// Forgets what is known of some tiles.
    pub fn forget(&mut self, tiles: &BTreeSet<Cell>) {
        tiles.iter().for_each(|&tile| self.tiles.remove(tile));
    }

    /// Writes of a scan what lies on tiles that are wanted, and hands every cell that changes sides to `flipped`.
    fn draw(
        &mut self,
        world_from_body: &Pose2,
        scan: &BodyScan,
        is_wanted: impl Fn(Cell) -> bool,
        flipped: &mut impl FnMut(Flip),
    ) {
        let inverse_resolution = 1.0 / self.resolution_m;
        let to_world = world_from_body.point_transform();
        let cell_of = |point_m: [f32; 2]| Cell::containing(to_world(point_m.map(f64::from)), inverse_resolution);
        let origin = Cell::containing(to_world(scan.origin_m), inverse_resolution);
        let mut rays = Vec::with_capacity(scan.hits.len() + scan.free_ends.len());
        if self.grazing_clearance_m > 0.0 {
            let passed_to = short_of_grazed_surfaces(scan, self.grazing_clearance_m);
            rays.extend(
                scan.hits
                    .iter()
                    .zip(passed_to)
                    .map(|(end, passed_to)| Ray { passed_to: Some(cell_of(passed_to)), end: Some(cell_of(end)) }),
            );
        } else {
            let ends = scan.hits.iter().map(|end| Some(cell_of(end)));
            rays.extend(ends.map(|end| Ray { passed_to: end, end }));
        }
        rays.extend(scan.free_ends.iter().map(|point| Ray { passed_to: Some(cell_of(point)), end: None }));
        let Some(mut tiles) = open_tiles(&mut self.tiles, origin, &mut rays) else { return };
        let (hit, pass, limit) = (i32::from(self.hit), i32::from(self.pass), i32::from(self.limit));
        for Ray { passed_to, end } in rays {
            // The cells from the origin up to, not including, the end.
            let mut ray = TiledRay::new(origin, passed_to.unwrap_or(origin));
            while let Some(next) = ray.next_cell() {
                let at = tile_of(next);
                if !is_wanted(at) {
                    ray.skip_tile();
                    continue;
                }
                // Each tile along the ray is looked up once.
                let Some(tile) = tiles.tile_mut(at) else { break };
                ray.pass_tile(|index| {
                    let value = &mut tile.0[index];
                    let before = *value;
                    *value = (i32::from(before) - pass).max(-limit) as i16;
                    if before > 0 && *value <= 0 {
                        flipped(Flip { cell: cell_in_tile(at, index), occupied: false });
                    }
                });
            }
            let Some(cell) = end.filter(|&end| is_wanted(tile_of(end))) else { continue };
            let Some(tile) = tiles.tile_mut(tile_of(cell)) else { continue };
            let value = &mut tile.0[index_in_tile(cell)];
            let before = *value;
            *value = (i32::from(before) + hit).clamp(-limit, limit) as i16;
            if before <= 0 && *value > 0 {
                flipped(Flip { cell, occupied: true });
            }
        }
    }

    /// Draws scans at their poses in place of what was drawn, on several cores where there are. Each draws all scans on a band of
    /// the grid of its own: the result is to the bit the same.
    pub(crate) fn draw_scans(&mut self, scans: &[(&CompactScan, Pose2)], reached: &[TileRectangle]) {
        let bands = bands(reached, rayon::current_num_threads());
        let draw_band = |band: &Range<i32>| {
            let mut grid = self.emptied();
            for ((scan, pose), reached) in scans.iter().zip(reached) {
                if band.start <= reached.high.y && reached.low.y < band.end {
                    grid.draw(pose, &scan.unpack(), |tile| band.contains(&tile.y), &mut |_| {});
                }
            }
            grid.tiles
        };
        let drawn: Vec<TileGrid<OccupancyTile>> = bands.par_iter().map(draw_band).collect();
        self.tiles = TileGrid::default();
        drawn.into_iter().for_each(|tiles| self.tiles.adopt(tiles));
    }

    /// The grid as a picture: the smallest rectangle that holds everything seen. A cell is
    /// occupied or free as its log-odds lean. `None` when nothing was seen.
    ///
    /// Where what was seen lies so far apart that the rectangle would be nearly empty and very large, 2×2,
    /// 4×4 … cells are drawn as one, occupied if one of them is: see the raster's resolution.
    #[must_use]
    pub fn to_raster(&self) -> Option<Raster<Occupancy>> {
        let mut low = Cell { x: i32::MAX, y: i32::MAX };
        let mut high = Cell { x: i32::MIN, y: i32::MIN };
        let mut widen = |cell: Cell| {
            low = Cell { x: low.x.min(cell.x), y: low.y.min(cell.y) };
            high = Cell { x: high.x.max(cell.x), y: high.y.max(cell.y) };
        };
        for (at, tile) in self.tiles.iter() {
            for (row, values) in tile.0.chunks_exact(TILE_SIDE as usize).enumerate() {
                let seen = |value: &i16| *value != 0;
                let ends = values.iter().position(seen).zip(values.iter().rposition(seen));
                for column in ends.iter().flat_map(|&(first, last)| [first, last]) {
                    widen(cell_in_tile(at, row * TILE_SIDE as usize + column));
                }
            }
        }
        if low.x > high.x {
            return None;
        }
        let most_cells = LARGEST_RASTER_CELLS.max(self.seen_cells().count() * EMPTY_CELLS_PER_SEEN);
        let side = |low: i32, high: i32, merged: i64| ((i64::from(high) - i64::from(low)) / merged + 1) as usize;
        let mut merged = 1;
        while side(low.x, high.x, merged).saturating_mul(side(low.y, high.y, merged)) > most_cells {
            merged *= 2;
        }
        let (width, height) = (side(low.x, high.x, merged), side(low.y, high.y, merged));
        let mut cells = vec![Occupancy::Unknown; width * height];
        for (at, tile) in self.tiles.iter() {
            for (index, &value) in tile.0.iter().enumerate().filter(|(_, value)| **value != 0) {
                let cell = cell_in_tile(at, index);
                let index = (height - side(low.y, cell.y, merged)) * width + side(low.x, cell.x, merged) - 1;
                if value > 0 {
                    cells[index] = Occupancy::Occupied;
                } else if cells[index] == Occupancy::Unknown {
                    cells[index] = Occupancy::Free;
                }
            }
        }
        let origin_m = [f64::from(low.x) * self.resolution_m, f64::from(low.y) * self.resolution_m];
        Some(Raster { width, height, resolution_m: self.resolution_m * merged as f64, origin_m, cells })
    }

    /// How likely the cells of [`to_raster`](Self::to_raster) are occupied, `None` where nothing was seen.
    #[must_use]
    pub fn to_probabilities(&self) -> Option<Raster<Option<f64>>> {
        let raster = self.to_raster()?;
        let merged = (raster.resolution_m / self.resolution_m).round() as i32;
        let odds = |center: [f64; 2]| {
            let corner =
                self.cell_at(center.map(|coordinate| coordinate - 0.5 * (raster.resolution_m - self.resolution_m)));
            let cells = (0..merged).flat_map(|up| (0..merged).map(move |right| (right, up)));
            let seen = cells.map(|(right, up)| self.raw(Cell { x: corner.x + right, y: corner.y + up }));
            seen.filter(|&raw| raw != 0).max().map(|raw| f64::from(raw) / STEPS_PER_UNIT)
        };
        Some(raster.map(|_, center| odds(center).map(|log_odds| 1.0 / (1.0 + (-log_odds).exp()))))
    }

    /// Tiles of [`TILE_SIDE`] × [`TILE_SIDE`] cells that were written since `earlier`, a copy of this grid as it was, by the
    /// tiles' coordinates (those of their cells, divided by the side): where a picture of it has to be drawn anew. Costs a
    /// look at each tile.
    #[must_use]
    pub fn tiles_changed_since(&self, earlier: &Self) -> Vec<Cell> {
        let cells =
            |grid: &Self, at: Cell| grid.tiles.tile(at).map(|tile| tile.0.map(i16::signum)).unwrap_or([0; TILE_CELLS]);
        let mut changed = self.tiles.replaced_since(&earlier.tiles);
        changed.retain(|&at| cells(self, at) != cells(earlier, at));
        changed
    }

    /// What is known of the cells of a tile, row by row from the least y; `None` where nothing was ever seen.
    #[must_use]
    pub fn tile(&self, at: Cell) -> Option<[Occupancy; TILE_CELLS]> {
        let occupancy = |value: i16| match value.signum() {
            0 => Occupancy::Unknown,
            1 => Occupancy::Occupied,
            _ => Occupancy::Free,
        };
        self.tiles.tile(at).map(|tile| tile.0.map(occupancy))
    }

    /// Every cell that was seen, with its log-odds.
    pub fn seen_cells(&self) -> impl Iterator<Item = (Cell, f64)> {
        self.tiles.iter().flat_map(|(at, tile)| {
            let seen = tile.0.iter().enumerate().filter(|(_, value)| **value != 0);
            seen.map(move |(index, value)| (cell_in_tile(at, index), f64::from(*value) / STEPS_PER_UNIT))
        })
    }
}

/// A ray of a scan: the cell up to which it passes cells, and the one in which it ends on something.
struct Ray {
    passed_to: Option<Cell>,
    end: Option<Cell>,
}

/// Opens the tiles that rays from `origin` touch, and takes from the rays what lies beyond what the grid can span.
/// `None` where nothing is left.
fn open_tiles<'a>(
    tiles: &'a mut TileGrid<OccupancyTile>,
    origin: Cell,
    rays: &mut [Ray],
) -> Option<OpenTiles<'a, OccupancyTile>> {
    // Mostly the grid holds them all already.
    let ends = rays.iter().flat_map(|ray| [ray.passed_to, ray.end]).flatten();
    let all = TileRectangle::of_cells(origin, ends, 0);
    if tiles.holds(&all) {
        return tiles.open(all);
    }
    let mut touched: Option<TileRectangle> = None;
    let mut touch = |cell: Cell| {
        let at = tile_of(cell);
        let has_room = tiles.make_room(at);
        if has_room {
            touched = Some(touched.map_or(TileRectangle { low: at, high: at }, |touched| touched.with(at)));
        }
        has_room
    };
    for ray in rays {
        // Between two cells that the grid holds it holds them all.
        ray.passed_to = ray.passed_to.filter(|&passed_to| touch(origin) && touch(passed_to));
        ray.end = ray.end.filter(|&end| touch(end));
    }
    tiles.open(touched?)
}

/// Bands of rows of tiles, about as many as asked for, on which about equally much is to be drawn.
fn bands(reached: &[TileRectangle], count: usize) -> Vec<Range<i32>> {
    let Some(first) = reached.first() else { return Vec::new() };
    let all = reached.iter().fold(*first, |all, scan| all.with(scan.low).with(scan.high));
    let can_be_split = TileGrid::<OccupancyTile>::can_hold(&all);
    let mut scans_in_row = vec![0; if can_be_split { (all.high.y - all.low.y + 1) as usize } else { 0 }];
    for scan in reached.iter().filter(|_| can_be_split) {
        scans_in_row[(scan.low.y - all.low.y) as usize..=(scan.high.y - all.low.y) as usize]
            .iter_mut()
            .for_each(|scans| *scans += 1);
    }
    let share = scans_in_row.iter().sum::<usize>().div_ceil(count.max(1));
    let (mut bands, mut begin, mut drawn) = (Vec::new(), i32::MIN, 0);
    for (row, scans) in scans_in_row.into_iter().enumerate() {
        drawn += scans;
        if drawn >= share * (bands.len() + 1) && bands.len() + 1 < count {
            let end = all.low.y + row as i32 + 1;
            bands.push(begin..end);
            begin = end;
        }
    }
    bands.push(begin..i32::MAX);
    bands
}

/// Of each ray that hits something the last point (metres, body's frame) that is farther than `clearance_m` from the surface it
/// ends on, or its end where it meets the surface squarely.
///
/// A ray that grazes a wall runs through the wall's own cells before it ends in one of them;
/// taken as passed they would eat the wall away.
fn short_of_grazed_surfaces(scan: &BodyScan, clearance_m: f32) -> Vec<[f32; 2]> {
    let (xs, ys) = (&scan.hits.x_m, &scan.hits.y_m);
    let origin = scan.origin_m.map(|coordinate| coordinate as f32);
    let nothing = ([0.0; 2], f32::INFINITY);
    let to_next = xs.windows(2).zip(ys.windows(2)).map(|(x, y)| {
        let step = [x[1] - x[0], y[1] - y[0]];
        (step, length(step))
    });
    let mut from_last = nothing;
    (xs.iter().zip(ys).zip(to_next.chain([nothing])))
        .map(|((&x, &y), to_next)| {
            let ray = [x - origin[0], y - origin[1]];
            let range = length(ray);
            // The surface runs towards the nearer neighbour in the scan, if that is on the same surface.
            let (along, distance) = if from_last.1 <= to_next.1 { from_last } else { to_next };
            from_last = to_next;
            if !(distance > 0.0 && distance < SAME_SURFACE_SHARE * range) {
                return [x, y];
            }
            let sine = (ray[0] * along[1] - ray[1] * along[0]).abs() / (range * distance).max(f32::MIN_POSITIVE);
            // What a square hit leaves out (nothing) and a grazing one (much), at most half the ray.
            let left_out = (clearance_m * (1.0 / sine.max(1e-3) - 1.0)).min(0.5 * range);
            let share = 1.0 - left_out / range.max(f32::MIN_POSITIVE);
            [origin[0] + share * ray[0], origin[1] + share * ray[1]]
        })
        .collect()
}

fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Neighbouring ends of rays farther apart than this share of the range lie on different surfaces.
const SAME_SURFACE_SHARE: f32 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scan_with(points: &[[f32; 2]]) -> BodyScan {
        let mut scan = BodyScan::default();
        for point in points {
            scan.hits.push(point[0], point[1]);
        }
        scan
    }

    #[test]
    fn a_ray_frees_its_cells_and_occupies_its_end() {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        let mut flips = Vec::new();
        grid.add_scan(&Pose2::new(0.025, 0.025, 0.0), &scan_with(&[[1.0, 0.0]]), &mut flips);
        let log_gamma = 9.0_f64.ln();
        assert!((grid.log_odds(Cell { x: 20, y: 0 }) - 4.0 * log_gamma).abs() < 0.01);
        assert!((grid.log_odds(Cell { x: 10, y: 0 }) + log_gamma).abs() < 0.01);
        assert_eq!(grid.log_odds(Cell { x: 21, y: 0 }), 0.0);
        assert_eq!(flips, [Flip { cell: Cell { x: 20, y: 0 }, occupied: true }]);
    }

    #[test]
    fn tiles_that_changed_are_told() {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        let empty = grid.clone();
        grid.draw_scan(&Pose2::new(0.025, 0.025, 0.0), &scan_with(&[[1.0, 0.0], [3.0, 0.0]]));
        let changed = grid.tiles_changed_since(&empty);
        assert_eq!(changed, (0..2).map(|x| Cell { x, y: 0 }).collect::<Vec<_>>());
        assert_eq!(grid.tile(changed[0]).unwrap()[20], Occupancy::Occupied);
        assert!(grid.tile(Cell { x: 0, y: 1 }).is_none());
        // Once more the same: log-odds grow, but what is free and occupied stays.
        let before = grid.clone();
        grid.draw_scan(&Pose2::new(0.025, 0.025, 0.0), &scan_with(&[[1.0, 0.0], [3.0, 0.0]]));
        assert!(grid.tiles_changed_since(&before).len() < 2);
        assert_eq!(empty.tiles_changed_since(&grid), changed);
    }

    #[test]
    fn copies_never_alias() {
        let mut first = OccupancyGrid::new(&MapConfig::default());
        let mut flips = Vec::new();
        first.add_scan(&Pose2::IDENTITY, &scan_with(&[[1.0, 0.5]]), &mut flips);
        let before: Vec<_> = first.seen_cells().collect();
        let mut second = first.clone();
        second.add_scan(&Pose2::new(0.5, 0.0, 1.0), &scan_with(&[[2.0, 0.5]]), &mut flips);
        assert_eq!(first.seen_cells().collect::<Vec<_>>(), before);
        assert_ne!(second.seen_cells().collect::<Vec<_>>(), before);
    }

    #[test]
    fn a_picture_of_the_grid_is_upright() {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        grid.add_scan(&Pose2::new(0.025, 0.025, 0.0), &scan_with(&[[0.5, 1.0]]), &mut Vec::new());
        let raster = grid.to_raster().unwrap();
        assert_eq!((raster.width, raster.height, raster.origin_m), (11, 21, [0.0, 0.0]));
        // The hit is the upper right cell, the robot the lower left one.
        assert_eq!(raster.cells[10], Occupancy::Occupied);
        assert_eq!(raster.cells[20 * 11], Occupancy::Free);
        assert_eq!(raster.cells[0], Occupancy::Unknown);
        assert!(OccupancyGrid::new(&MapConfig::default()).to_raster().is_none());
    }

    #[test]
    fn what_lies_far_apart_is_drawn_in_larger_cells() {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        let ends = [Cell { x: -3, y: 7 }, Cell { x: 30_000, y: -20_000 }];
        for &end in &ends {
            grid.tiles.tile_mut(tile_of(end)).unwrap().0[index_in_tile(end)] = 300;
        }
        let raster = grid.to_raster().unwrap();
        assert!(raster.cells.len() <= LARGEST_RASTER_CELLS, "{}×{}", raster.width, raster.height);
        let resolution_m = MapConfig::default().resolution_m;
        for end in ends {
            let center_m = [end.x, end.y].map(|cell| (f64::from(cell) + 0.5) * resolution_m);
            assert_eq!(raster.at(center_m), Some(&Occupancy::Occupied));
        }
        assert_eq!(raster.cells.iter().filter(|&&cell| cell != Occupancy::Unknown).count(), 2);
    }

    proptest! {
        #[test]
        fn log_odds_stay_within_their_limits_and_flips_tell_every_change_of_side(
            scans in prop::collection::vec((-3.0..3.0_f64, -3.0..3.0_f64, -3.0..3.0_f64, -4.0..4.0_f32, -4.0..4.0_f32), 1..60)
        ) {
            let config = MapConfig { limit_log_odds: 12.0, ..MapConfig::default() };
            let mut grid = OccupancyGrid::new(&config);
            let mut occupied = std::collections::BTreeSet::new();
            for (x, y, theta, hit_x, hit_y) in scans {
                let mut flips = Vec::new();
                grid.add_scan(&Pose2::new(x, y, theta), &scan_with(&[[hit_x, hit_y]]), &mut flips);
                for flip in flips {
                    if flip.occupied { prop_assert!(occupied.insert(flip.cell)); } else { prop_assert!(occupied.remove(&flip.cell)); }
                }
            }
            for (cell, log_odds) in grid.seen_cells() {
                prop_assert!(log_odds.abs() <= 12.0 + 1e-9);
                prop_assert_eq!(log_odds > 0.0, occupied.contains(&cell));
            }
        }
    }
}
