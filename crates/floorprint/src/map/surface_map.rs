//! The map that scans are matched against: small oriented surfaces, and for every cell
//! near one the way to the nearest.
//!
//! Each cell in which rays end keeps the mean of the end points and of their normals, so
//! that a wall is known far more finely than the cells (the sub-cell means are those of
//! GMapping, Grisetti et al. 2007; the nearest-obstacle field is that of Lau et al. 2013,
//! here cut off at a fixed reach). Matching is one look-up per point.

use super::cell::Cell;
use super::ray::passed_cells;
use super::tile_grid::{TILE_CELLS, TileGrid, index_in_tile, tile_of};
use crate::geometry::Pose2;
use crate::scan_matcher::SurfaceScan;

/// How far, in cells, a cell knows its nearest surface.
const REACH_CELLS: i32 = 7;
/// End points beyond this number no longer slow down how a surface's mean follows new ones.
const MEMORY_HITS: f32 = 60.0;
/// A ray contradicts a surface when it ends at least this far behind it, metres.
const CONTRADICTION_DEPTH_M: f32 = 0.20;
/// A surface is given up when it was contradicted this many times for each time it was hit.
const CONTRADICTIONS_PER_HIT: f32 = 0.75;

/// A piece of surface in one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Mean of the end points, metres, world.
    pub mean_m: [f32; 2],
    /// Mean of the unit normals that point to where the surface was seen from. Its length
    /// says how flat the surface is: 1 a wall, 0 no direction at all.
    pub normal: [f32; 2],
    /// How often the surface was hit (up to a limit).
    hits: f32,
    /// How often a ray went through it.
    contradictions: f32,
    /// Index of its cell within the tile.
    cell: u16,
}

/// Marks a cell that no surface is near to.
const NONE: [i8; 2] = [i8::MIN, i8::MIN];

#[derive(Debug, Clone)]
struct SurfaceTile {
    /// For each cell the offset, in cells, to the cell of the nearest surface.
    nearest: [[i8; 2]; TILE_CELLS],
    /// For each cell one more than the index of its surface; 0 is none.
    slot: [u16; TILE_CELLS],
    surfaces: Vec<Surface>,
}

impl Default for SurfaceTile {
    fn default() -> Self {
        Self { nearest: [NONE; TILE_CELLS], slot: [0; TILE_CELLS], surfaces: Vec::new() }
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
        let cell = Cell::containing(point_m, self.inverse_resolution);
        let tile = self.tiles.tile(tile_of(cell))?;
        let offset = tile.nearest[index_in_tile(cell)];
        if offset == NONE {
            return None;
        }
        let target = Cell { x: cell.x + i32::from(offset[0]), y: cell.y + i32::from(offset[1]) };
        self.surface(target)
    }

    #[inline]
    fn surface(&self, cell: Cell) -> Option<&Surface> {
        let tile = self.tiles.tile(tile_of(cell))?;
        tile.surfaces.get(usize::from(tile.slot[index_in_tile(cell)]).wrapping_sub(1))
    }

    /// Writes a scan taken at `world_from_body`: surfaces that its rays went through lose
    /// trust, its end points found or sharpen surfaces.
    pub fn add_scan(&mut self, world_from_body: &Pose2, scan: &SurfaceScan) {
        let (sin, cos) = world_from_body.theta.sin_cos();
        let rotate = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let origin = world_from_body.transform_point(scan.origin_m);
        let world_points: Vec<([f64; 2], [f32; 2])> = scan
            .iter()
            .map(|(point, normal)| {
                let [x, y] = rotate(point.map(f64::from));
                let [nx, ny] = rotate(normal.map(f64::from));
                ([x + world_from_body.x, y + world_from_body.y], [nx as f32, ny as f32])
            })
            .collect();
        for &(point, _) in &world_points {
            self.contradict_along(origin, point);
        }
        for &(point, normal) in &world_points {
            self.add_hit(point, normal);
        }
    }

    /// Surfaces between `origin` and `end` that the ray went through lose trust.
    fn contradict_along(&mut self, origin: [f64; 2], end: [f64; 2]) {
        let from = Cell::containing(origin, self.inverse_resolution);
        let to = Cell::containing(end, self.inverse_resolution);
        let mut at = tile_of(from);
        let mut tile = self.tiles.tile(at);
        let mut contradicted: Vec<Cell> = Vec::new();
        for cell in passed_cells(from, to) {
            let here = tile_of(cell);
            if here != at {
                at = here;
                tile = self.tiles.tile(at);
            }
            let Some(tile) = tile else { continue };
            let slot = tile.slot[index_in_tile(cell)];
            if slot != 0 && goes_through(&tile.surfaces[usize::from(slot) - 1], origin, end) {
                contradicted.push(cell);
            }
        }
        for cell in contradicted {
            let tile = self.tiles.tile_mut(tile_of(cell));
            let slot = tile.slot[index_in_tile(cell)];
            let surface = &mut tile.surfaces[usize::from(slot) - 1];
            surface.contradictions += 1.0;
            if surface.contradictions > CONTRADICTIONS_PER_HIT * surface.hits {
                self.remove(cell);
            }
        }
    }

    fn add_hit(&mut self, point_m: [f64; 2], normal: [f32; 2]) {
        let cell = Cell::containing(point_m, self.inverse_resolution);
        let index = index_in_tile(cell);
        let point = [point_m[0] as f32, point_m[1] as f32];
        let tile = self.tiles.tile_mut(tile_of(cell));
        let slot = tile.slot[index];
        if slot != 0 {
            let surface = &mut tile.surfaces[usize::from(slot) - 1];
            surface.hits = (surface.hits + 1.0).min(MEMORY_HITS);
            surface.contradictions = (surface.contradictions - 0.25).max(0.0);
            let gain = 1.0 / surface.hits;
            for axis in 0..2 {
                surface.mean_m[axis] += gain * (point[axis] - surface.mean_m[axis]);
                surface.normal[axis] += gain * (normal[axis] - surface.normal[axis]);
            }
        } else {
            tile.surfaces.push(Surface { mean_m: point, normal, hits: 1.0, contradictions: 0.0, cell: index as u16 });
            tile.slot[index] = tile.surfaces.len() as u16;
            self.announce(cell);
        }
    }

    /// Tells the cells around `cell` that it holds a surface.
    fn announce(&mut self, cell: Cell) {
        for dy in -REACH_CELLS..=REACH_CELLS {
            for dx in -REACH_CELLS..=REACH_CELLS {
                let square = dx * dx + dy * dy;
                if square > REACH_CELLS * REACH_CELLS {
                    continue;
                }
                let near = Cell { x: cell.x + dx, y: cell.y + dy };
                let index = index_in_tile(near);
                let at = tile_of(near);
                let known = self.tiles.tile(at).map_or(NONE, |tile| tile.nearest[index]);
                if known == NONE || square_length(known) > square {
                    self.tiles.tile_mut(at).nearest[index] = [-dx as i8, -dy as i8];
                }
            }
        }
    }

    /// Takes away the surface of `cell` and points the cells around it to their next nearest.
    fn remove(&mut self, cell: Cell) {
        let tile = self.tiles.tile_mut(tile_of(cell));
        let slot = std::mem::take(&mut tile.slot[index_in_tile(cell)]);
        tile.surfaces.swap_remove(usize::from(slot) - 1);
        if let Some(moved) = tile.surfaces.get(usize::from(slot) - 1) {
            tile.slot[usize::from(moved.cell)] = slot;
        }
        for dy in -REACH_CELLS..=REACH_CELLS {
            for dx in -REACH_CELLS..=REACH_CELLS {
                let near = Cell { x: cell.x + dx, y: cell.y + dy };
                let index = index_in_tile(near);
                let at = tile_of(near);
                if self.tiles.tile(at).is_some_and(|tile| tile.nearest[index] == [-dx as i8, -dy as i8]) {
                    self.tiles.tile_mut(at).nearest[index] = NONE;
                }
            }
        }
        for dy in -2 * REACH_CELLS..=2 * REACH_CELLS {
            for dx in -2 * REACH_CELLS..=2 * REACH_CELLS {
                let near = Cell { x: cell.x + dx, y: cell.y + dy };
                if self.surface(near).is_some() {
                    self.announce(near);
                }
            }
        }
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

fn square_length(offset: [i8; 2]) -> i32 {
    i32::from(offset[0]).pow(2) + i32::from(offset[1]).pow(2)
}

/// Whether a ray that ended at `end` cannot have done so had the surface been there.
///
/// A ray that grazes a wall passes many of its cells without going through it: what counts
/// is how far behind the surface's own plane the ray ended.
fn goes_through(surface: &Surface, origin: [f64; 2], end: [f64; 2]) -> bool {
    let behind = [end[0] as f32 - surface.mean_m[0], end[1] as f32 - surface.mean_m[1]];
    let [nx, ny] = surface.normal;
    let flatness = nx.hypot(ny);
    if flatness > 0.3 {
        -(nx * behind[0] + ny * behind[1]) > CONTRADICTION_DEPTH_M * flatness
    } else {
        let ray = [(end[0] - origin[0]) as f32, (end[1] - origin[1]) as f32];
        let length = ray[0].hypot(ray[1]).max(1e-6);
        (ray[0] * behind[0] + ray[1] * behind[1]) / length > CONTRADICTION_DEPTH_M
    }
}
