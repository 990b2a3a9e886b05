//! A simulated RGB-D camera: disparity and colour images of the floor, the walls and people.
//!
//! Inverts the report's equations 23–27: a depth of z metres is the disparity
//! `(numerator / z − offset) / scale`, and equations 25–26 describe a pinhole colour
//! camera that sits a little to the side of the depth camera (see [`color_pinhole`]).

use super::drive::SimulatedDrive;
use super::floor_raster::PIXEL_M;
use super::walker::leg_range_m;
use crate::random::{Stage, generator};
use crate::sensors::{CameraConfig, ColorImage, DepthImage};
use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// Columns of both images.
pub(super) const WIDTH: usize = 640;
/// Rows of both images.
pub(super) const HEIGHT: usize = 480;
/// What the driver writes where it sees no depth.
const NO_DISPARITY: u16 = 2047;
/// Directions around the camera into which the outline of the world is cast: five to a pixel.
const BEARINGS: usize = 16_384;
/// Farther than this nothing is seen, metres.
const SIGHT_M: f64 = 100.0;
/// Walls end in a dark skirting board of this height, metres.
const SKIRTING_M: f64 = 0.1;
const SKIRTING_COLOR: [u8; 3] = [40, 40, 44];
const TROUSERS_COLOR: [u8; 3] = [45, 55, 90];
/// The points of the floor that one pixel averages: one to this length of its strip, metres…
const SAMPLE_M: f64 = 2.0 * PIXEL_M;
/// … and no more than these.
const MOST_SAMPLES: f64 = 6.0;

/// One of the two eyes: where each pixel looks, in the body's frame.
#[derive(Debug, Clone)]
pub(super) struct Eye {
    position_m: Vector3<f64>,
    pixels: Vec<Pixel>,
    /// The first and last bearing that any pixel looks along.
    bearings: [usize; 2],
}

#[derive(Debug, Clone, Copy)]
struct Pixel {
    /// Direction per metre of depth along the optical axis.
    direction: [f32; 3],
    /// Horizontal part of `direction`.
    level: f32,
    bearing: u16,
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pinhole {
    pub(super) focal_px: f64,
    pub(super) center_px: [f64; 2],
    /// How far right of the depth camera it sits, metres along the optical x axis.
    pub(super) right_m: f64,
}

/// The depth camera.
pub(super) fn depth_pinhole(camera: &CameraConfig) -> Pinhole {
    let center_px = [camera.depth_center_column_px, camera.depth_center_row_px];
    Pinhole { focal_px: camera.depth_focal_px, center_px, right_m: 0.0 }
}

/// The colour camera that equations 25–26 amount to.
///
/// With u = f X/z + c and dd = n/z, column = (F u + B dd + C)/D is
/// `F f/D · (X + B n/(F f))/z + (F c + C)/D`: a pinhole at X = −B n/(F f).
pub(super) fn color_pinhole(camera: &CameraConfig) -> Pinhole {
    let depth = depth_pinhole(camera);
    let (focal, divisor) = (camera.color_focal, camera.color_divisor);
    Pinhole {
        focal_px: focal * depth.focal_px / divisor,
        center_px: [
            (focal * depth.center_px[0] + camera.color_column_offset) / divisor,
            (focal * depth.center_px[1] + camera.color_row_offset) / divisor,
        ],
        right_m: -camera.color_baseline * camera.depth_numerator_m / (focal * depth.focal_px),
    }
}

impl Eye {
    pub(super) fn new(camera: &CameraConfig, pinhole: Pinhole) -> Self {
        let body_from_camera = camera.mount.body_from_sensor();
        // Optical axes: x right, y down, z ahead.
        let camera_from_optical = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let rotation = body_from_camera.rotation * camera_from_optical;
        let mut bearings = [BEARINGS, 0];
        let pixels = (0..WIDTH * HEIGHT).map(|index| {
            let place = [(index % WIDTH) as f64, (index / WIDTH) as f64];
            let [x, y] = std::array::from_fn(|axis| (place[axis] - pinhole.center_px[axis]) / pinhole.focal_px);
            let direction = rotation * Vector3::new(x, y, 1.0);
            let turn = direction.y.atan2(direction.x) / TAU + 0.5;
            let bearing = ((turn * BEARINGS as f64) as usize).min(BEARINGS - 1);
            bearings = [bearings[0].min(bearing), bearings[1].max(bearing)];
            Pixel {
                direction: [direction.x as f32, direction.y as f32, direction.z as f32],
                level: direction.x.hypot(direction.y) as f32,
                bearing: bearing as u16,
            }
        });
        let pixels = pixels.collect();
        let aside = rotation * Vector3::new(pinhole.right_m, 0.0, 0.0);
        Self { position_m: body_from_camera.translation_m + aside, pixels, bearings }
    }
}

/// What stands in a direction.
#[derive(Debug, Clone, Copy)]
struct Sight {
    /// Horizontal distance, metres.
    range_m: f32,
    color: [u8; 3],
}

/// What a pixel shows.
enum Seen {
    /// The floor, at this depth in metres.
    Floor(f32),
    /// Something upright, at this depth in metres.
    Upright(f32, [u8; 3]),
}

/// What an eye sees at one moment.
struct View<'a> {
    eye: &'a Eye,
    /// The eye's place and direction in the building.
    position_m: [f64; 2],
    sin_cos: (f64, f64),
    sights: Vec<Sight>,
}

impl<'a> View<'a> {
    fn new(drive: &SimulatedDrive, eye: &'a Eye, time_s: f64) -> Self {
        let body = drive.trajectory.at(time_s).pose();
        let position_m = body.transform_point([eye.position_m.x, eye.position_m.y]);
        let legs_m = drive.world.legs_m(time_s, &body, &drive.config.faults);
        let look = |bearing: usize| {
            let angle = ((bearing as f64 + 0.5) / BEARINGS as f64 - 0.5) * TAU + body.theta;
            let direction = [angle.cos(), angle.sin()];
            let wall = drive.caster.cast(position_m, direction, SIGHT_M, |_| true);
            let mut sight = wall.map_or(Sight { range_m: SIGHT_M as f32, color: [128; 3] }, |hit| Sight {
                range_m: hit.range_m as f32,
                color: drive.world.walls[hit.wall].color,
            });
            for leg_m in legs_m.iter().filter_map(|&leg| leg_range_m(leg, position_m, direction)) {
                if leg_m < f64::from(sight.range_m) {
                    sight = Sight { range_m: leg_m as f32, color: TROUSERS_COLOR };
                }
            }
            sight
        };
        let sights = (eye.bearings[0]..=eye.bearings[1]).map(look).collect();
        Self { eye, position_m, sin_cos: body.theta.sin_cos(), sights }
    }

    fn see(&self, pixel: &Pixel) -> Seen {
        let floor_m = -(self.eye.position_m.z as f32) / pixel.direction[2];
        let sight = &self.sights[pixel.bearing as usize - self.eye.bearings[0]];
        let upright_m = sight.range_m / pixel.level;
        if pixel.direction[2] < 0.0 && floor_m < upright_m {
            return Seen::Floor(floor_m);
        }
        let height_m = self.eye.position_m.z + f64::from(upright_m * pixel.direction[2]);
        Seen::Upright(upright_m, if height_m < SKIRTING_M { SKIRTING_COLOR } else { sight.color })
    }

    /// The building's point at a depth along a pixel's ray, metres.
    fn point_m(&self, pixel: &Pixel, depth_m: f64) -> [f64; 2] {
        let (sin, cos) = self.sin_cos;
        let [x, y] = [f64::from(pixel.direction[0]) * depth_m, f64::from(pixel.direction[1]) * depth_m];
        [self.position_m[0] + cos * x - sin * y, self.position_m[1] + sin * x + cos * y]
    }
}

impl SimulatedDrive {
    /// Stamps of the disparity images, seconds.
    #[must_use]
    pub fn disparity_stamps_s(&self) -> Vec<f64> {
        self.disparity_times_s.iter().map(|time_s| self.config.start_stamp_s + time_s).collect()
    }

    /// Stamps of the colour images, seconds. Some images are missing: pair them by time.
    #[must_use]
    pub fn color_stamps_s(&self) -> Vec<f64> {
        self.color_times_s.iter().map(|time_s| self.config.start_stamp_s + time_s).collect()
    }

    /// The disparity image of a number, rendered on the spot; `None` without a camera or beyond the last.
    #[must_use]
    pub fn disparity_image(&self, index: usize) -> Option<DepthImage> {
        let camera = self.config.robot.camera.as_ref()?;
        let time_s = *self.disparity_times_s.get(index)?;
        let eye = self.depth_eye.get_or_init(|| Eye::new(camera, depth_pinhole(camera)));
        let view = View::new(self, eye, time_s);
        let noise = Noise::new(self.seed, index, self.config.camera.disparity_noise);
        let disparity = eye.pixels.iter().enumerate().map(|(index, pixel)| {
            let (Seen::Floor(depth_m) | Seen::Upright(depth_m, _)) = view.see(pixel);
            let depth_m = f64::from(depth_m);
            if !(camera.depth_min_m..=camera.depth_max_m).contains(&depth_m) {
                return NO_DISPARITY;
            }
            let exact = (camera.depth_numerator_m / depth_m - camera.disparity_offset) / camera.disparity_scale;
            ((exact + noise.at(index) + 0.5) as u16).min(NO_DISPARITY)
        });
        let disparity = disparity.collect();
        Some(DepthImage {
            stamp_s: self.config.start_stamp_s + time_s,
            width: WIDTH,
            height: HEIGHT,
            values: disparity,
        })
    }

    /// The colour image of a number, rendered on the spot; `None` without a camera or beyond the last.
    #[must_use]
    pub fn color_image(&self, index: usize) -> Option<ColorImage> {
        let camera = self.config.robot.camera.as_ref()?;
        let time_s = *self.color_times_s.get(index)?;
        let pinhole = color_pinhole(camera);
        let eye = self.color_eye.get_or_init(|| Eye::new(camera, pinhole));
        let view = View::new(self, eye, time_s);
        let config = &self.config.camera;
        let random = &mut generator(self.seed, Stage::Sensors, index as u64, super::SENSOR_COLOR);
        let exposure: f64 = (config.exposure_variation * random.sample::<f64, _>(StandardNormal)).exp();
        let rgb = eye.pixels.iter().enumerate().map(|(index, pixel)| {
            let light = exposure * vignette(index, config.vignetting);
            let noise = config.color_noise * random.sample::<f64, _>(StandardNormal);
            let color = match view.see(pixel) {
                Seen::Floor(depth_m) => self.floor_color(&view, pixel, f64::from(depth_m), pinhole.focal_px),
                Seen::Upright(_, color) => color.map(f64::from),
            };
            color.map(|channel| (channel * light + noise + 0.5) as u8)
        });
        let rgb = rgb.collect();
        Some(ColorImage { stamp_s: self.config.start_stamp_s + time_s, width: WIDTH, height: HEIGHT, rgb })
    }

    /// The mean colour of what a pixel covers of the floor. Seen at a flat angle that is a
    /// long strip along the ray: one row of pixels later the ray meets the floor that much farther on.
    fn floor_color(&self, view: &View, pixel: &Pixel, depth_m: f64, focal_px: f64) -> [f64; 3] {
        let strip_m = depth_m / (focal_px * f64::from(-pixel.direction[2]));
        let samples = (strip_m * f64::from(pixel.level) / SAMPLE_M).clamp(1.0, MOST_SAMPLES) as usize;
        let mut sum = [0.0; 3];
        for sample in 0..samples {
            let offset_m = ((sample as f64 + 0.5) / samples as f64 - 0.5) * strip_m;
            let color = self.floor_raster.color(&self.world.floor, view.point_m(pixel, depth_m + offset_m));
            for (sum, channel) in sum.iter_mut().zip(color) {
                *sum += f64::from(channel);
            }
        }
        sum.map(|sum| sum / samples as f64)
    }
}

/// How much light reaches a pixel when the corners are darker by a share.
fn vignette(index: usize, share: f64) -> f64 {
    let x = (index % WIDTH) as f64 / (0.5 * WIDTH as f64) - 1.0;
    let y = (index / WIDTH) as f64 / (0.5 * HEIGHT as f64) - 1.0;
    1.0 - share * 0.5 * (x * x + y * y)
}

/// Noise that neighbouring pixels share, as in a Kinect's disparity.
struct Noise {
    white: Vec<f64>,
}

impl Noise {
    fn new(seed: u64, image: usize, deviation: f64) -> Self {
        let random = &mut generator(seed, Stage::Sensors, image as u64, super::SENSOR_DISPARITY);
        let mut draw = || 0.5 * deviation * random.sample::<f64, _>(StandardNormal);
        let count = if deviation > 0.0 { WIDTH * HEIGHT + WIDTH + 1 } else { 0 };
        Self { white: (0..count).map(|_| draw()).collect() }
    }

    /// The mean of a pixel's and three neighbours' draws, scaled to the wanted deviation.
    fn at(&self, index: usize) -> f64 {
        match self.white.get(index..) {
            Some(rest) if rest.len() > WIDTH + 1 => rest[0] + rest[1] + rest[WIDTH] + rest[WIDTH + 1],
            _ => 0.0,
        }
    }
}
