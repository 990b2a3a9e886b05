//! The map that scans are matched against: small oriented surfaces, and the way from every
//! cell near one to the nearest.
//!
//! Each cell in which rays end keeps the mean of the end points and of their normals, so
//! that a wall is known far more finely than the cells (the sub-cell means are those of
//! GMapping, Grisetti et al. 2007). Matching is one look-up per point.

use super::horizon::Horizon;
use super::near_cells::{NEAREST_OF_NINE, NearCells, REACH_CELLS};
use super::surface_scan::SurfaceScan;
use crate::geometry::Pose2;
use crate::map::tile_grid::{TILE_BITS, TILE_CELLS, TILE_SIDE, TileGrid, cell_in_tile, index_in_tile, tile_of};
use crate::map::{Cell, OpenTiles, TileRectangle};

/// End points beyond this number no longer slow down how a surface's mean follows new ones.
const MEMORY_HITS: f32 = 60.0;
/// Surfaces farther away than this are not contradicted, metres.
const CARVE_REACH_M: f64 = 15.0;
/// A ray contradicts a surface when it ends at least this far behind it, metres.
const CONTRADICTION_DEPTH_M: f32 = 0.20;
/// A surface is given up when it was contradicted this many times for each time it was hit.
/// Fewer than one: not every scan that is written is also used for carving.
const CONTRADICTIONS_PER_HIT: f32 = 0.3;

/// A piece of surface in one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Mean of the end points, metres, world.
    pub mean_m: [f32; 2],
    /// Unit normal that points to where the surface was seen from.
    pub normal: [f32; 2],
    /// How flat the surface is: 1 a wall, 0 without any direction.
    pub flatness: f32,
    /// How often the surface was hit (up to a limit).
    hits: f32,
    /// How often a ray went through it.
    contradictions: f32,
    /// Index of its cell within the tile.
    cell: u16,
}

#[derive(Debug, Clone)]
struct SurfaceTile {
    /// Which cells hold a surface, here and as far around as cells of this tile can reach.
    occupied: NearCells,
    /// For each cell one more than the index of its surface; 0 is none.
    slot: [u16; TILE_CELLS],
    surfaces: Vec<Surface>,
}

impl Default for SurfaceTile {
    fn default() -> Self {
        Self { occupied: NearCells::default(), slot: [0; TILE_CELLS], surfaces: Vec::new() }
    }
}

impl SurfaceTile {
    #[inline]
    fn surface(&self, index: usize) -> Option<&Surface> {
        self.surfaces.get(usize::from(self.slot[index]).wrapping_sub(1))
    }
}

/// Finds the surfaces nearest to cells, one after the other: mostly they lie in the tile of the one before.
#[derive(Debug)]
pub struct SurfaceFinder<'a> {
    tiles: &'a TileGrid<SurfaceTile>,
    /// The tile that was looked up last.
    at: Cell,
    tile: Option<&'a SurfaceTile>,
}

impl<'a> SurfaceFinder<'a> {
    /// The surface nearest to a cell, if one is within reach.
    #[inline]
    #[must_use]
    pub fn nearest_to_cell(&mut self, cell: Cell) -> Option<&'a Surface> {
        let at = tile_of(cell);
        if at != self.at {
            (self.at, self.tile) = (at, self.tiles.tile(at));
        }
        let tile = self.tile?;
        let offset = match tile.occupied.around(cell.x, cell.y) {
            0 => tile.occupied.farther(cell.x, cell.y)?,
            around => NEAREST_OF_NINE[around].map(i32::from),
        };
        let target = Cell { x: cell.x + offset[0], y: cell.y + offset[1] };
        let (column, row) = ((cell.x & (TILE_SIDE - 1)) + offset[0], (cell.y & (TILE_SIDE - 1)) + offset[1]);
        // Mostly the same tile.
        let tile = if (column | row) & !(TILE_SIDE - 1) == 0 { tile } else { self.tiles.tile(tile_of(target))? };
        tile.surface(index_in_tile(target))
    }
}

/// An unbounded map of surfaces. Copies share tiles.
#[derive(Debug, Clone)]
pub struct SurfaceMap {
    resolution_m: f64,
    inverse_resolution: f64,
    tiles: TileGrid<SurfaceTile>,
}

impl SurfaceMap {
    /// An empty map with cells of this side, metres.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        Self { resolution_m, inverse_resolution: 1.0 / resolution_m, tiles: TileGrid::default() }
    }

    /// How far a point may be from a surface to find it, metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        f64::from(REACH_CELLS) * self.resolution_m
    }

    /// Whether nothing was written yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tiles.iter().next().is_none()
    }

    /// The surface nearest to a point of the world (metres), if one is within reach.
    #[inline]
    #[must_use]
    pub fn nearest(&self, point_m: [f64; 2]) -> Option<&Surface> {
        self.nearest_to_cell(Cell::containing(point_m, self.inverse_resolution))
    }

    /// The surface nearest to a cell, if one is within reach.
    #[inline]
    #[must_use]
    pub fn nearest_to_cell(&self, cell: Cell) -> Option<&Surface> {
        self.finder().nearest_to_cell(cell)
    }

    /// For many look-ups in a row.
    #[inline]
    #[must_use]
    pub fn finder(&self) -> SurfaceFinder<'_> {
        SurfaceFinder { tiles: &self.tiles, at: Cell { x: i32::MAX, y: i32::MAX }, tile: None }
    }

    #[cfg(test)]
    fn surface(&self, cell: Cell) -> Option<&Surface> {
        self.tiles.tile(tile_of(cell))?.surface(index_in_tile(cell))
    }

    /// The inverse of the cells' side, 1/m.
    #[must_use]
    pub fn inverse_resolution(&self) -> f64 {
        self.inverse_resolution
    }

    /// Writes a scan taken at `world_from_body`: its end points found or sharpen surfaces.
    pub fn add_scan(&mut self, world_from_body: &Pose2, scan: &SurfaceScan) {
        let hits: Vec<Hit> = in_world(world_from_body, scan)
            .map(|(point, normal)| Hit {
                cell: Cell::containing(point, self.inverse_resolution),
                point: point.map(|coordinate| coordinate as f32),
                normal,
            })
            .collect();
        self.add_hits(&hits);
    }

    fn add_hits(&mut self, hits: &[Hit]) {
        let Some(first) = hits.first() else { return };
        let rectangle = TileRectangle::of_cells(first.cell, hits.iter().map(|hit| hit.cell), REACH_CELLS);
        match self.tiles.open(rectangle) {
            Some(mut tiles) => hits.iter().for_each(|hit| add_hit(&mut tiles, hit)),
            // What lies beyond reason is left out.
            None if hits.len() > 1 => hits.iter().for_each(|hit| self.add_hits(std::slice::from_ref(hit))),
            None => {}
        }
    }

    /// Takes away what a scan taken at `world_from_body` saw through: people who have walked on,
    /// doors that were opened.
    pub fn carve(&mut self, world_from_body: &Pose2, scan: &SurfaceScan) {
        let origin = world_from_body.transform_point(scan.origin_m);
        self.contradict(&Horizon::new(origin, in_world(world_from_body, scan).map(|(point, _)| point)));
    }

    /// Surfaces that the scan saw through lose trust.
    fn contradict(&mut self, horizon: &Horizon) {
        let reach = CARVE_REACH_M.min(horizon.farthest_m());
        let corner = |sign: f64| {
            let point = horizon.origin_m().map(|v| v + sign * reach);
            tile_of(Cell::containing(point, self.inverse_resolution))
        };
        let (low, high) = (corner(-1.0), corner(1.0));
        let mut contradicted = Vec::new();
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let at = Cell { x, y };
                let Some(tile) = self.tiles.tile(at) else { continue };
                for surface in &tile.surfaces {
                    if sees_through(horizon, surface) {
                        contradicted.push((at, surface.cell));
                    }
                }
            }
        }
        for (at, index) in contradicted {
            let Some(tile) = self.tiles.tile_mut(at) else { continue };
            let slot = tile.slot[usize::from(index)];
            let surface = &mut tile.surfaces[usize::from(slot) - 1];
            surface.contradictions += 1.0;
            if surface.contradictions > CONTRADICTIONS_PER_HIT * surface.hits {
                self.remove(cell_in_tile(at, usize::from(index)));
            }
        }
    }

    #[cfg(test)]
    fn add_hit(&mut self, point_m: [f64; 2], normal: [f32; 2]) {
        let cell = Cell::containing(point_m, self.inverse_resolution);
        self.add_hits(&[Hit { cell, point: point_m.map(|coordinate| coordinate as f32), normal }]);
    }

    /// Takes away the surface of `cell`.
    fn remove(&mut self, cell: Cell) {
        let Some(tile) = self.tiles.tile_mut(tile_of(cell)) else { return };
        let slot = std::mem::take(&mut tile.slot[index_in_tile(cell)]);
        tile.surfaces.swap_remove(usize::from(slot) - 1);
        if let Some(moved) = tile.surfaces.get(usize::from(slot) - 1) {
            tile.slot[usize::from(moved.cell)] = slot;
        }
        let [low, high] = around(cell).map(tile_of);
        if let Some(mut tiles) = self.tiles.open(TileRectangle { low, high }) {
            announce(&mut tiles, cell, false);
        }
    }

    /// How near the nearest surface is: 1 in its cell, 0 beyond reach.
    #[must_use]
    pub fn proximity(&self, point_m: [f64; 2]) -> f32 {
        let cell = Cell::containing(point_m, self.inverse_resolution);
        let tile = self.tiles.tile(tile_of(cell));
        tile.and_then(|tile| tile.occupied.nearest(cell.x, cell.y)).map_or(0.0, proximity_of)
    }

    /// The cells that hold a surface, tile by tile.
    pub fn occupied_cells(&self) -> impl Iterator<Item = Cell> {
        self.tiles
            .iter()
            .flat_map(|(at, tile)| tile.surfaces.iter().map(move |surface| cell_in_tile(at, usize::from(surface.cell))))
    }

    /// All surfaces, tile by tile.
    pub fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        self.tiles.iter().flat_map(|(_, tile)| tile.surfaces.iter())
    }

    /// Number of tiles, and how many of them no copy of the map shares.
    #[must_use]
    pub fn tile_counts(&self) -> (usize, usize) {
        self.tiles.tile_counts()
    }
}

/// The end of a ray, in the world.
struct Hit {
    cell: Cell,
    /// Metres.
    point: [f32; 2],
    normal: [f32; 2],
}

fn add_hit(tiles: &mut OpenTiles<'_, SurfaceTile>, hit: &Hit) {
    let &Hit { cell, point, normal } = hit;
    let index = index_in_tile(cell);
    let Some(tile) = tiles.tile_mut(tile_of(cell)) else { return };
    let slot = tile.slot[index];
    if slot != 0 {
        let surface = &mut tile.surfaces[usize::from(slot) - 1];
        surface.hits = (surface.hits + 1.0).min(MEMORY_HITS);
        surface.contradictions = (surface.contradictions - 0.25).max(0.0);
        let gain = 1.0 / surface.hits;
        let mut mean_normal = surface.normal.map(|n| n * surface.flatness);
        for axis in 0..2 {
            surface.mean_m[axis] += gain * (point[axis] - surface.mean_m[axis]);
            mean_normal[axis] += gain * (normal[axis] - mean_normal[axis]);
        }
        (surface.normal, surface.flatness) = direction_and_length(mean_normal);
    } else {
        let (normal, flatness) = direction_and_length(normal);
        let cell = index as u16;
        tile.surfaces.push(Surface { mean_m: point, normal, flatness, hits: 1.0, contradictions: 0.0, cell });
        tile.slot[index] = tile.surfaces.len() as u16;
        announce(tiles, hit.cell, true);
    }
}

/// Tells the tiles within reach of `cell` whether it holds a surface.
fn announce(tiles: &mut OpenTiles<'_, SurfaceTile>, cell: Cell, holds: bool) {
    let [low, high] = around(cell).map(tile_of);
    for y in low.y..=high.y {
        for x in low.x..=high.x {
            if let Some(tile) = tiles.tile_mut(Cell { x, y }) {
                tile.occupied.set(cell.x - (x << TILE_BITS), cell.y - (y << TILE_BITS), holds);
            }
        }
    }
}

/// The corners of what lies within reach of a cell.
fn around(cell: Cell) -> [Cell; 2] {
    [-REACH_CELLS, REACH_CELLS].map(|reach| Cell { x: cell.x.saturating_add(reach), y: cell.y.saturating_add(reach) })
}

/// Whether a scan cannot have seen as far as it did had the surface been there.
///
/// A ray that grazes a wall passes close to much of it without going through it: what
/// counts is how far behind the surface's own plane the ray ended.
fn sees_through(horizon: &Horizon, surface: &Surface) -> bool {
    let ([dx, dy], range_m) = horizon.towards(surface.mean_m);
    let square = dx * dx + dy * dy;
    if square > (CARVE_REACH_M * CARVE_REACH_M) as f32 || square < 1e-4 {
        return false;
    }
    let distance = square.sqrt();
    let beyond = range_m - distance;
    if beyond <= CONTRADICTION_DEPTH_M {
        return false;
    }
    let [nx, ny] = surface.normal;
    // Cosine between the ray and the plane's normal.
    let slant = if surface.flatness > 0.3 { -(nx * dx + ny * dy) / distance } else { 1.0 };
    beyond * slant > CONTRADICTION_DEPTH_M
}

/// A scan's points (metres) and normals in the world.
fn in_world(world_from_body: &Pose2, scan: &SurfaceScan) -> impl Iterator<Item = ([f64; 2], [f32; 2])> {
    let (sin, cos) = world_from_body.theta.sin_cos();
    let to_world = world_from_body.point_transform();
    scan.iter().map(move |(point, normal)| {
        let [nx, ny] = normal.map(f64::from);
        (to_world(point.map(f64::from)), [(cos * nx - sin * ny) as f32, (sin * nx + cos * ny) as f32])
    })
}

/// A vector's direction and its length; any direction for a vector that has none.
fn direction_and_length([x, y]: [f32; 2]) -> ([f32; 2], f32) {
    let length = (x * x + y * y).sqrt();
    if length < 1e-6 { ([1.0, 0.0], 0.0) } else { ([x / length, y / length], length) }
}

/// How near a surface is that lies so many columns and rows away: 1 in the same cell, 0 beyond reach.
///
/// 1 − d²/reach²: smooth, and peaked enough to tell a fit from a near miss.
#[must_use]
pub fn proximity_of([columns, rows]: [i32; 2]) -> f32 {
    (1.0 - (columns * columns + rows * rows) as f32 / (REACH_CELLS * REACH_CELLS + 1) as f32).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use crate::surface::Thinning;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    const CELL_M: f64 = 0.05;

    fn center(x: i32, y: i32) -> [f64; 2] {
        Cell { x, y }.center_m(CELL_M)
    }

    /// Squared distance, in cells, from a cell to the nearest of `cells`.
    fn nearest_by_search(cells: &BTreeSet<(i32, i32)>, x: i32, y: i32) -> i32 {
        cells.iter().map(|&(cx, cy)| (cx - x).pow(2) + (cy - y).pow(2)).min().unwrap_or(i32::MAX)
    }

    fn nearest_in_map(map: &SurfaceMap, x: i32, y: i32) -> Option<(i32, i32)> {
        let surface = map.nearest(center(x, y))?;
        let cell = Cell::containing(surface.mean_m.map(f64::from), 1.0 / CELL_M);
        Some((cell.x, cell.y))
    }

    fn cell() -> impl Strategy<Value = (i32, i32)> {
        // Around a corner of four tiles.
        (-12..12_i32, -12..12_i32)
    }

    fn scan_of(walls: &Walls) -> SurfaceScan {
        SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 720), &Thinning::default())
    }

    proptest! {
        #[test]
        fn the_nearest_surface_is_the_one_a_search_finds(
            added in prop::collection::btree_set(cell(), 1..40), removed in prop::collection::vec(prop::num::u16::ANY, 0..30)
        ) {
            let mut map = SurfaceMap::new(CELL_M);
            for &(x, y) in &added {
                map.add_hit(center(x, y), [1.0, 0.0]);
            }
            let reach = REACH_CELLS * REACH_CELLS;
            for (x, y) in (-22..22).flat_map(|x| (-22..22).map(move |y| (x, y))) {
                let truth = nearest_by_search(&added, x, y);
                match nearest_in_map(&map, x, y) {
                    Some((cx, cy)) => prop_assert_eq!((cx - x).pow(2) + (cy - y).pow(2), truth),
                    None => prop_assert!(truth > reach),
                }
            }
            let mut left = added.clone();
            for pick in removed {
                let Some(&(x, y)) = left.iter().nth(usize::from(pick) % left.len().max(1)) else { break };
                left.remove(&(x, y));
                map.remove(Cell { x, y });
            }
            prop_assert_eq!(map.surfaces().count(), left.len());
            for (x, y) in (-22..22).flat_map(|x| (-22..22).map(move |y| (x, y))) {
                let truth = nearest_by_search(&left, x, y);
                match nearest_in_map(&map, x, y) {
                    Some((cx, cy)) => {
                        prop_assert!(left.contains(&(cx, cy)), "a removed surface is still known");
                        prop_assert_eq!((cx - x).pow(2) + (cy - y).pow(2), truth);
                    }
                    None => prop_assert!(truth > reach),
                }
            }
        }

        #[test]
        fn copies_go_their_own_ways(
            before in prop::collection::vec(cell(), 1..20), after in prop::collection::vec(cell(), 1..20)
        ) {
            let mut map = SurfaceMap::new(CELL_M);
            before.iter().for_each(|&(x, y)| map.add_hit(center(x, y), [1.0, 0.0]));
            let surfaces: Vec<Surface> = map.surfaces().copied().collect();
            let mut copy = map.clone();
            after.iter().for_each(|&(x, y)| copy.add_hit(center(x, y), [0.0, 1.0]));
            let cell = Cell::containing(surfaces[0].mean_m.map(f64::from), 1.0 / CELL_M);
            copy.remove(cell);
            prop_assert_eq!(map.surfaces().copied().collect::<Vec<_>>(), surfaces);
            prop_assert!(copy.surface(cell).is_none() && map.surface(cell).is_some());
        }
    }

    #[test]
    fn a_surface_is_the_mean_of_its_hits() {
        let mut map = SurfaceMap::new(CELL_M);
        for k in 0..10 {
            map.add_hit([0.02 + 0.001 * f64::from(k), 0.01], [0.0, 1.0]);
        }
        let surface = map.nearest([0.1, 0.01]).unwrap();
        assert!((surface.mean_m[0] - 0.0245).abs() < 1e-6 && surface.normal == [0.0, 1.0] && surface.flatness > 0.999);
        assert!(map.nearest([0.5, 0.01]).is_none());
        assert!(map.proximity([0.02, 0.01]) > 0.99 && map.proximity([0.5, 0.01]) == 0.0);
    }

    /// Someone stands in the room, and walks on.
    #[test]
    fn who_walked_on_is_forgotten_and_walls_stay() {
        let room = Walls::room();
        let crowded = scan_of(&room.clone().with_box([1.5, 0.3], [0.15, 0.25]));
        let empty = scan_of(&room);
        let mut map = SurfaceMap::new(CELL_M);
        map.add_scan(&Pose2::IDENTITY, &crowded);
        assert!(map.nearest([1.35, 0.3]).is_some());
        for _ in 0..3 {
            map.carve(&Pose2::IDENTITY, &empty);
            map.add_scan(&Pose2::IDENTITY, &empty);
        }
        assert!(map.nearest([1.35, 0.3]).is_none(), "the person is still in the map");
        for ([x, y], _) in empty.iter() {
            assert!(map.surface(Cell::containing([f64::from(x), f64::from(y)], 1.0 / CELL_M)).is_some());
        }
    }

    /// Rays along a wall pass close to all of it; none goes through it, however often it is looked at.
    #[test]
    fn a_grazed_wall_stays() {
        let walls = Walls::default().with_box([0.0, 0.0], [14.0, 0.5]);
        let mut map = SurfaceMap::new(CELL_M);
        let poses = [-4.0, 0.0, 4.0].map(|x| Pose2::new(x, 0.2, 0.0));
        let scans = poses.map(|pose| SurfaceScan::new(&walls.scan_from(&pose, 1080), &Thinning::default()));
        poses.iter().zip(&scans).for_each(|(pose, scan)| map.add_scan(pose, scan));
        let before = map.surfaces().count();
        for _ in 0..20 {
            poses.iter().zip(&scans).for_each(|(pose, scan)| map.carve(pose, scan));
        }
        // Far off, where few rays end, the direction of the wall is not known well enough.
        assert!(map.surfaces().count() > before * 97 / 100, "{} of {before} are left", map.surfaces().count());
    }

    #[test]
    fn surfaces_of_another_map_are_seen_at_its_pose() {
        let scan = scan_of(&Walls::room());
        let mut other = SurfaceMap::new(CELL_M);
        other.add_scan(&Pose2::IDENTITY, &scan);
        let pose = Pose2::new(3.0, -2.0, 1.1);
        let (mut direct, mut indirect) = (SurfaceMap::new(CELL_M), SurfaceMap::new(CELL_M));
        direct.add_scan(&pose, &scan);
        indirect.add_scan(&pose, &SurfaceScan::from_surfaces([0.0, 0.0], other.surfaces()));
        for surface in indirect.surfaces().filter(|surface| surface.flatness > 0.99) {
            let found = direct.nearest(surface.mean_m.map(f64::from)).unwrap();
            let [dx, dy] = [surface.mean_m[0] - found.mean_m[0], surface.mean_m[1] - found.mean_m[1]];
            if found.flatness > 0.99 {
                assert!((found.normal[0] * dx + found.normal[1] * dy).abs() < 0.005);
                assert!(found.normal[0] * surface.normal[0] + found.normal[1] * surface.normal[1] > 0.98);
            }
        }
    }

    #[test]
    fn points_that_are_far_beyond_reason_are_left_out() {
        let mut map = SurfaceMap::new(CELL_M);
        map.add_hit([0.0, 0.0], [1.0, 0.0]);
        for far in [1e6, -1e6, 1e12, f64::INFINITY, f64::NEG_INFINITY] {
            map.add_hit([far, far], [1.0, 0.0]);
            assert!(map.nearest([far, far]).is_none());
        }
        assert_eq!(map.surfaces().count(), 1);
        map.carve(&Pose2::IDENTITY, &SurfaceScan::default());
        assert_eq!(map.surfaces().count(), 1);
    }
}
