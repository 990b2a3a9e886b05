//! Paints the floor: patches of many images laid into the cells of one map.
//!
//! Every cell asks the patches for its colour (inverse mapping), so there are no holes far
//! away and no pile-ups close by. The map is painted in tiles, each by itself and with
//! its patches in order, so that the result does not depend on threads.

use super::blend::Canvas;
use super::camera::plane_motion;
use super::config::TextureConfig;
use super::exposure::balancing_factors;
use super::floor_mapper::FloorMapper;
use super::floor_patch::FloorPatch;
use super::floor_plane::{FloorTilt, smoothed_tilts};
use crate::geometry::Pose2;
use crate::map::Raster;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Cells along the side of a tile.
const TILE: usize = 64;
/// Steps of depth in which the weight of a view is tabulated.
const SHARPNESS_STEPS: usize = 512;

/// Colours of the floor; `None` where no image saw it.
pub type TextureMap = Raster<Option<[u8; 3]>>;

/// A patch at its place in the world.
pub(super) struct PlacedPatch<'a> {
    patch: &'a FloorPatch,
    /// Homogeneous pixels from (x, y, 1) in the world, metres; the third is the depth, metres.
    pixel_from_world: Matrix3<f64>,
    world_from_pixel: Matrix3<f64>,
    /// Least and greatest x and y, metres in the world.
    pub bounds_m: [[f64; 2]; 2],
}

impl PlacedPatch<'_> {
    /// Calls `visit` with the place in the world (metres), the colour and the depth (metres) of each pixel that shows floor.
    pub(super) fn for_each_pixel(&self, mut visit: impl FnMut([f64; 2], [f32; 3], f32)) {
        let layout = &self.patch.layout;
        for y in 0..layout.height {
            for x in 0..layout.width {
                let [r, g, b, seen] = self.patch.pixels[y * layout.width + x];
                if seen > 0 {
                    let (column, row) = layout.image_from_patch(x, y);
                    let place = self.world_from_pixel * Vector3::new(column, row, 1.0);
                    let color = [r, g, b].map(f32::from);
                    visit([place.x / place.z, place.y / place.z], color, (1.0 / place.z) as f32);
                }
            }
        }
    }
}

impl FloorMapper {
    /// Lays the patches into a map; `world_from_body` holds the body's pose at each patch's stamp.
    ///
    /// Patches without a finite pose are left out. The result is the same for any number of threads.
    #[must_use]
    pub fn paint(&self, patches: &[FloorPatch], world_from_body: &[Pose2]) -> TextureMap {
        let tilts = smoothed_tilts(patches, &self.camera, self.config.tilt_smoothing_s);
        let placed: Vec<PlacedPatch<'_>> = patches
            .iter()
            .zip(&tilts)
            .zip(world_from_body)
            .filter(|(_, pose)| pose.is_finite())
            .map(|((patch, tilt), pose)| self.place(patch, tilt, pose))
            .collect();
        let factors =
            if self.config.exposure_compensation { balancing_factors(&placed) } else { vec![[1.0; 3]; placed.len()] };
        let sharpness = Sharpness::new(self);
        let mut map = self.empty_map(&placed);
        let (columns, rows) = (map.width / TILE, map.height / TILE);
        let tiles: Vec<Vec<Option<[u8; 3]>>> = (0..columns * rows)
            .into_par_iter()
            .map(|tile| {
                self.paint_tile(tile_corner_m(&map, tile % columns, tile / columns), &placed, &factors, &sharpness)
            })
            .collect();
        for (tile, colors) in tiles.iter().enumerate() {
            for (index, colors) in colors.chunks_exact(TILE).enumerate() {
                let start = (tile / columns * TILE + index) * map.width + tile % columns * TILE;
                map.cells[start..start + TILE].copy_from_slice(colors);
            }
        }
        cropped(&map)
    }

    fn place<'a>(&self, patch: &'a FloorPatch, tilt: &FloorTilt, pose: &Pose2) -> PlacedPatch<'a> {
        let camera = self.camera.tilted(tilt);
        let body_from_world = plane_motion(&pose.inverse());
        let [least, most] = patch.bounds_m;
        let corners = [[least[0], least[1]], [least[0], most[1]], [most[0], least[1]], [most[0], most[1]]];
        let mut bounds_m = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for corner in corners {
            for (axis, value) in pose.transform_point(corner).into_iter().enumerate() {
                bounds_m[0][axis] = bounds_m[0][axis].min(value - self.config.resolution_m);
                bounds_m[1][axis] = bounds_m[1][axis].max(value + self.config.resolution_m);
            }
        }
        let pixel_from_world = camera.color.pixel_from_floor() * body_from_world;
        let world_from_pixel = pixel_from_world.try_inverse().unwrap_or_default();
        PlacedPatch { patch, pixel_from_world, world_from_pixel, bounds_m }
    }

    /// A map of whole tiles that holds all patches; cell borders lie on multiples of the resolution.
    fn empty_map(&self, placed: &[PlacedPatch<'_>]) -> TextureMap {
        let resolution_m = self.config.resolution_m;
        let cell = |value_m: f64| (value_m / resolution_m).floor();
        let least = |axis: usize| placed.iter().map(|p| cell(p.bounds_m[0][axis])).fold(f64::INFINITY, f64::min);
        let most = |axis: usize| placed.iter().map(|p| cell(p.bounds_m[1][axis])).fold(f64::NEG_INFINITY, f64::max);
        if placed.is_empty() {
            return Raster { width: 0, height: 0, resolution_m, origin_m: [0.0; 2], cells: Vec::new() };
        }
        let [width, height] = [0, 1].map(|axis| ((most(axis) - least(axis)) as usize + 1).next_multiple_of(TILE));
        let origin_m = [least(0) * resolution_m, least(1) * resolution_m];
        Raster { width, height, resolution_m, origin_m, cells: vec![None; width * height] }
    }

    /// The colours of a tile whose upper left corner is given, row by row from the top.
    fn paint_tile(
        &self,
        [left_m, top_m]: [f64; 2],
        placed: &[PlacedPatch<'_>],
        factors: &[[f32; 3]],
        sharpness: &Sharpness,
    ) -> Vec<Option<[u8; 3]>> {
        let resolution_m = self.config.resolution_m;
        let side_m = TILE as f64 * resolution_m;
        let corner_m = [left_m, top_m - side_m];
        let overlapping = placed.iter().zip(factors).filter(|(p, _)| {
            (0..2).all(|axis| p.bounds_m[0][axis] < corner_m[axis] + side_m && p.bounds_m[1][axis] > corner_m[axis])
        });
        let mut canvas = Canvas::new(self.config.blend, TILE * TILE);
        for (p, factors) in overlapping {
            let step = p.pixel_from_world.column(0) * resolution_m;
            for row in 0..TILE {
                let x_m = left_m + 0.5 * resolution_m;
                let y_m = top_m - (row as f64 + 0.5) * resolution_m;
                let mut pixel = p.pixel_from_world * Vector3::new(x_m, y_m, 1.0);
                for column in 0..TILE {
                    let inverse = 1.0 / pixel.z;
                    if let Some(weight) = sharpness.weight(pixel.z)
                        && let Some(rgb) = p.patch.sample((pixel.x * inverse) as f32, (pixel.y * inverse) as f32)
                    {
                        canvas.add(row * TILE + column, weight, [0, 1, 2].map(|c| rgb[c] * factors[c]));
                    }
                    pixel += step;
                }
            }
        }
        canvas.colors(TILE * TILE)
    }
}

/// Weights of views by their depth, worked out once.
struct Sharpness {
    depth_max_m: f64,
    weights: Vec<f32>,
}

impl Sharpness {
    /// A pixel at depth z is z²/(f·h) long on the floor; beyond the side of a cell its weight falls.
    fn new(mapper: &FloorMapper) -> Self {
        let TextureConfig { resolution_m, sharpness, distance_max_m, .. } = mapper.config;
        let camera = &mapper.camera;
        let weights = (0..SHARPNESS_STEPS)
            .map(|step| {
                let depth_m = distance_max_m * (step as f64 + 0.5) / SHARPNESS_STEPS as f64;
                let length_m = depth_m * depth_m / (camera.color.focal_px[1] * camera.height_m());
                (1.0 + (length_m / resolution_m).powi(2)).powf(-sharpness).max(1e-30) as f32
            })
            .collect();
        Self { depth_max_m: distance_max_m, weights }
    }

    /// Nothing when the depth is not one that is painted.
    fn weight(&self, depth_m: f64) -> Option<f32> {
        let index = (depth_m / self.depth_max_m * SHARPNESS_STEPS as f64) as usize;
        if depth_m > 0.0 { self.weights.get(index).copied() } else { None }
    }
}

/// Upper left corner of a tile, metres.
fn tile_corner_m(map: &TextureMap, column: usize, row: usize) -> [f64; 2] {
    let side_m = TILE as f64 * map.resolution_m;
    let top_m = map.origin_m[1] + map.height as f64 * map.resolution_m;
    [map.origin_m[0] + column as f64 * side_m, top_m - row as f64 * side_m]
}

/// The smallest map that holds all seen cells.
fn cropped(map: &TextureMap) -> TextureMap {
    let (mut columns, mut rows) = ([map.width, 0], [map.height, 0]);
    for (index, _) in map.cells.iter().enumerate().filter(|(_, color)| color.is_some()) {
        let (row, column) = (index / map.width, index % map.width);
        columns = [columns[0].min(column), columns[1].max(column + 1)];
        rows = [rows[0].min(row), rows[1].max(row + 1)];
    }
    let (width, height) = (columns[1].saturating_sub(columns[0]), rows[1].saturating_sub(rows[0]));
    let origin_m = [
        map.origin_m[0] + columns[0] as f64 * map.resolution_m,
        map.origin_m[1] + (map.height - rows[1]) as f64 * map.resolution_m,
    ];
    let row_start = |row: usize| (rows[0] + row) * map.width + columns[0];
    let cells = (0..height).flat_map(|row| &map.cells[row_start(row)..row_start(row) + width]).copied().collect();
    Raster { width, height, resolution_m: map.resolution_m, origin_m, cells }
}
