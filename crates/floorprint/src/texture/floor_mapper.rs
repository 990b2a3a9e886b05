//! From a depth and a colour image to the floor they show (report eqs. 23–29).
//!
//! The floor is a plane, so it relates the pixels of both cameras and the floor by
//! homographies, at each camera's own time. The disparities decide which pixels show floor
//! and which show something that stands on it; the colours are then taken from the image
//! itself and not from scattered depth pixels.

use super::camera::{RgbdCamera, plane_motion};
use super::camera_error::CameraError;
use super::config::TextureConfig;
use super::distortion::{ideal_color, ideal_depth};
use super::floor_patch::{FloorPatch, RowLayout};
use super::floor_plane::{DisparityPlane, fit_floor};
use crate::geometry::Pose2;
use crate::sensors::{ColorImage, DepthImage};
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A depth and a colour image that belong together.
#[derive(Debug, Clone, Copy)]
pub struct RgbdFrame<'a> {
    /// The depth image.
    pub depth: &'a DepthImage,
    /// The colour image.
    pub color: &'a ColorImage,
    /// How the body moved between the two stamps: the body at the colour image's time in the
    /// frame of the body at the depth image's time.
    pub depth_body_from_color_body: Pose2,
}

/// Why a frame adds nothing to the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SkipReason {
    /// An image has no pixels, or not as many as its size says.
    BrokenImage,
    /// The motion between the two stamps is not known.
    UnknownMotion,
    /// No depth is a measurement within the limits of distance.
    NoDepth,
    /// No floor is in view.
    NoFloor,
}

/// Turns frames into floor patches and patches into a floor map.
#[derive(Debug, Clone)]
pub struct FloorMapper {
    pub(super) config: TextureConfig,
    pub(super) camera: RgbdCamera,
    seed: u64,
}

impl FloorMapper {
    /// A mapper for a calibrated camera: the Kinect of the course, or any other. `seed` keys the random samples of the plane fit.
    ///
    /// # Errors
    /// When the calibration cannot be that of a camera above the floor.
    pub fn new(config: &TextureConfig, camera: impl Into<RgbdCamera>, seed: u64) -> Result<Self, CameraError> {
        let camera = camera.into().up_to(config.distance_max_m);
        camera.validate()?;
        Ok(Self { config: config.clone(), camera, seed })
    }

    /// The floor that a frame shows.
    ///
    /// # Errors
    /// The reason why it shows none.
    pub fn patch(&self, frame: &RgbdFrame<'_>) -> Result<FloorPatch, SkipReason> {
        let RgbdFrame { depth, color, depth_body_from_color_body } = frame;
        if !is_whole(depth.width, depth.height, depth.values.len())
            || !is_whole(color.width, color.height, color.rgb.len())
        {
            return Err(SkipReason::BrokenImage);
        }
        if !depth_body_from_color_body.is_finite() {
            return Err(SkipReason::UnknownMotion);
        }
        let depth = &*ideal_depth(depth, &self.camera.depth);
        let fit = fit_floor(depth, &self.camera, &self.config, self.seed);
        let tilt = fit.as_ref().and_then(|(plane, _)| plane.tilt(&self.camera));
        let camera = self.camera.tilted(&tilt.unwrap_or_default());
        let blocks = DepthBlocks::classify(depth, &camera, self.config.plane_tolerance_m);
        if !blocks.any_depth {
            return Err(SkipReason::NoDepth);
        }
        let color = &*ideal_color(color, &self.camera.color);
        let floor_from_color = camera.color.pixel_from_floor().try_inverse().ok_or(SkipReason::NoFloor)?;
        let layout = self.layout(&camera, &floor_from_color, color).ok_or(SkipReason::NoFloor)?;
        let mut pixels = shrink(color, &layout);
        let hidden = blocks.shadow(&camera, depth_body_from_color_body, &layout);
        let depth_from_floor = camera.depth.pixel_from_floor() * plane_motion(depth_body_from_color_body);
        let bounds_m = self.mark_floor(&mut pixels, &layout, &floor_from_color, &depth_from_floor, &blocks, &hidden);
        if bounds_m[0][0] > bounds_m[1][0] {
            return Err(SkipReason::NoFloor);
        }
        Ok(FloorPatch {
            stamp_s: color.stamp_s,
            tilt,
            evidence: fit.map(|(_, evidence)| evidence),
            pixels,
            layout,
            bounds_m,
        })
    }

    /// Sets the last byte of the pixels that show floor; gives the bounds of that floor.
    fn mark_floor(
        &self,
        pixels: &mut [[u8; 4]],
        layout: &RowLayout,
        floor_from_color: &Matrix3<f64>,
        depth_from_floor: &Matrix3<f64>,
        blocks: &DepthBlocks,
        hidden: &[bool],
    ) -> [[f64; 2]; 2] {
        let mut bounds_m = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let nearest_inverse = 1.0 / self.config.distance_max_m;
        for y in 0..layout.height {
            for x in 0..layout.width {
                let (column, row) = layout.image_from_patch(x, y);
                // The third coordinate is the inverse of the depth along the optical axis.
                let floor = floor_from_color * Vector3::new(column, row, 1.0);
                if floor.z < nearest_inverse || hidden[y * layout.width + x] {
                    continue;
                }
                let depth_pixel = depth_from_floor * floor;
                if !blocks.shows_floor(depth_pixel.x / depth_pixel.z, depth_pixel.y / depth_pixel.z)
                    || !self.camera.color.shows(column, row)
                {
                    continue;
                }
                pixels[y * layout.width + x][3] = u8::MAX;
                for (axis, value) in [floor.x / floor.z, floor.y / floor.z].into_iter().enumerate() {
                    bounds_m[0][axis] = bounds_m[0][axis].min(value);
                    bounds_m[1][axis] = bounds_m[1][axis].max(value);
                }
            }
        }
        bounds_m
    }

    /// Which rows and columns to join so that pixels are about half as wide as the map's cells
    /// where the image is finer than that; nothing when no row shows near floor.
    fn layout(&self, camera: &RgbdCamera, floor_from_color: &Matrix3<f64>, color: &ColorImage) -> Option<RowLayout> {
        let fine_m = self.config.resolution_m / 2.0;
        let nearest_inverse = 1.0 / self.config.distance_max_m;
        let columns = [0.0, (color.width - 1) as f64 / 2.0, (color.width - 1) as f64];
        let floor_at = |column: f64, row: f64| floor_from_color * Vector3::new(column, row, 1.0);
        let in_reach = |row: usize| columns.iter().any(|&column| floor_at(column, row as f64).z >= nearest_inverse);
        let first = (0..color.height).find(|&row| in_reach(row))?;
        let end = (0..color.height).rev().find(|&row| in_reach(row))? + 1;
        let length_m = |row: usize| {
            let [near, far] = [-0.5, 0.5].map(|side| floor_at(columns[1], row as f64 + side));
            (near.x / near.z - far.x / far.z).hypot(near.y / near.z - far.y / far.z)
        };
        let mut row_starts = vec![first];
        let mut row = first;
        while row < end {
            let joined = (fine_m / length_m(row)).floor().clamp(1.0, 64.0) as usize;
            row = (row + joined).min(end);
            row_starts.push(row);
        }
        // A pixel is as wide as it is long where its length is `fine_m`: at depth √(fine·f·h).
        let columns_per_pixel =
            (fine_m * camera.color.focal_px[0] / camera.height_m()).sqrt().floor().max(1.0) as usize;
        (row_starts.len() > 2 && color.width >= 2 * columns_per_pixel)
            .then(|| RowLayout::new(color.width, columns_per_pixel, row_starts))
    }
}

/// Whether an image has pixels, as many as its size says.
fn is_whole(width: usize, height: usize, pixels: usize) -> bool {
    pixels > 0 && width.checked_mul(height) == Some(pixels)
}

/// The mean colours of the layout's pixels; the last byte is 0.
fn shrink(color: &ColorImage, layout: &RowLayout) -> Vec<[u8; 4]> {
    let step = layout.columns_per_pixel;
    let mut pixels = Vec::with_capacity(layout.width * layout.height);
    let mut sums = vec![0_u16; color.width * 3];
    for rows in layout.row_starts.windows(2) {
        sums.fill(0);
        for row in color.rgb[rows[0] * color.width..rows[1] * color.width].chunks_exact(color.width) {
            for (sum, &value) in sums.iter_mut().zip(row.as_flattened()) {
                *sum += u16::from(value);
            }
        }
        let count = ((rows[1] - rows[0]) * step) as u32;
        for block in sums.chunks_exact(step * 3).take(layout.width) {
            let mut total = [count / 2; 3];
            for pixel in block.chunks_exact(3) {
                for (total, &value) in total.iter_mut().zip(pixel) {
                    *total += u32::from(value);
                }
            }
            let [r, g, b] = total.map(|total| (total / count) as u8);
            pixels.push([r, g, b, 0]);
        }
    }
    pixels
}

/// The depth image in blocks of 2×2 pixels: what shows floor, and what stands on it.
struct DepthBlocks {
    width: usize,
    height: usize,
    /// Bits `FLOOR` and `OBSTACLE`, spread to the neighbouring blocks.
    classes: Vec<u8>,
    /// Column, row and dd of one pixel of each block that shows an obstacle.
    obstacles: Vec<Vector3<f64>>,
    any_depth: bool,
}

const FLOOR: u8 = 1;
const OBSTACLE: u8 = 2;
/// Disparities of the floor scatter by about this many units of their noise beyond its own unevenness.
const DISPARITY_NOISE: f64 = 1.5;

impl DepthBlocks {
    fn classify(image: &DepthImage, camera: &RgbdCamera, plane_tolerance_m: f64) -> Self {
        let plane = DisparityPlane::of_floor(camera);
        let relative_tolerance = plane_tolerance_m / camera.height_m();
        let noise = DISPARITY_NOISE * camera.dd_noise;
        let (width, height) = (image.width / 2, image.height / 2);
        let mut classes = vec![0_u8; width * height];
        let mut obstacles = Vec::new();
        let mut any_depth = false;
        for (index, class) in classes.iter_mut().enumerate() {
            let (left, top) = (index % width * 2, index / width * 2);
            let mut obstacle_dd = None;
            for (column, row) in [(left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)] {
                let Some(dd) = camera.disparity_term(image.values[row * image.width + column]) else { continue };
                any_depth = true;
                let expected = plane.at(column as f64, row as f64);
                let tolerance = noise + relative_tolerance * expected.abs();
                if (dd - expected).abs() <= tolerance {
                    *class |= FLOOR;
                } else if dd > expected {
                    *class |= OBSTACLE;
                    obstacle_dd = Some(dd);
                }
            }
            if let Some(dd) = obstacle_dd {
                obstacles.push(Vector3::new(left as f64 + 0.5, top as f64 + 0.5, dd));
            }
        }
        spread(&mut classes, width, height);
        Self { width, height, classes, obstacles, any_depth }
    }

    /// Whether the depth camera sees floor, and nothing else close by, at a pixel.
    fn shows_floor(&self, column: f64, row: f64) -> bool {
        let (x, y) = ((column + 0.5) / 2.0, (row + 0.5) / 2.0);
        x >= 0.0
            && y >= 0.0
            && x < self.width as f64
            && y < self.height as f64
            && self.classes[y as usize * self.width + x as usize] == FLOOR
    }

    /// The patch's pixels in which the colour camera sees an obstacle, or which are next to one.
    fn shadow(&self, camera: &RgbdCamera, depth_body_from_color_body: &Pose2, layout: &RowLayout) -> Vec<bool> {
        let mut hidden = vec![0_u8; layout.width * layout.height];
        let color_from_depth = depth_body_from_color_body.inverse();
        let (sin, cos) = color_from_depth.theta.sin_cos();
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let shift = Vector3::new(color_from_depth.x, color_from_depth.y, 0.0);
        let (linear, offset) = camera.color.pixel_from_body();
        let depth = &camera.depth;
        for obstacle in &self.obstacles {
            let depth_m = camera.depth_numerator_m / obstacle.z;
            let optical = Vector3::new(
                (obstacle.x - depth.center_px[0]) / depth.focal_px[0] * depth_m,
                (obstacle.y - depth.center_px[1]) / depth.focal_px[1] * depth_m,
                depth_m,
            );
            let body = turn * depth.body_from_optical.transform_point(optical) + shift;
            let pixel = linear * body + offset;
            if pixel.z > 0.0
                && let Some((x, y)) = layout.pixel_of(pixel.x / pixel.z, pixel.y / pixel.z)
            {
                hidden[y * layout.width + x] = OBSTACLE;
            }
        }
        spread(&mut hidden, layout.width, layout.height);
        hidden.into_iter().map(|class| class != 0).collect()
    }
}

/// Gives every cell the bits of its eight neighbours, too.
fn spread(classes: &mut [u8], width: usize, height: usize) {
    for row in classes.chunks_exact_mut(width) {
        let mut left = 0;
        for x in 0..width {
            let here = row[x];
            let right = if x + 1 < width { row[x + 1] } else { 0 };
            row[x] |= left | right;
            left = here;
        }
    }
    let mut above = vec![0_u8; width];
    for y in 0..height {
        let (upper, lower) = classes.split_at_mut((y + 1) * width);
        let row = &mut upper[y * width..];
        for x in 0..width {
            let here = row[x];
            row[x] |= above[x] | lower.get(x).copied().unwrap_or(0);
            above[x] = here;
        }
    }
}
