//! A simulated drive with an RGB-D camera as messages of ROS, its images in every encoding.
#![allow(dead_code, reason = "not every test needs every part")]

use crate::bag_writers::{Message, Rays, camera_info, compressed_image, image, odometry, placed, scan};
use floorprint::geometry::{Pose2, Pose3};
use floorprint::sensors::CameraConfig;
use floorprint::simulator::{SimulatedDrive, SimulationConfig, World, simulate};
use floorprint_io::{Picture, Pixels, png_bytes};

pub const SIZE_PX: [u32; 2] = [640, 480];
/// The frame of the body lies so high above the floor, metres.
const BASE_HEIGHT_M: f64 = 0.1;
/// Optical axes (z ahead, x right, y down) in those of a mount (x ahead, y left, z up), as x, y, z, w.
const OPTICAL: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

/// A drive of which the first seconds are used; its camera sees the floor every half second.
pub fn drive() -> SimulatedDrive {
    let mut config = SimulationConfig::default();
    (config.lidar.beams, config.lidar.rate_hz) = (271, 10.0);
    config.motion.standstill_s = 1.0;
    simulate(World::named("rooms", 7).unwrap(), config, 7).unwrap()
}

/// How images become messages.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Packing {
    /// `rgb8` and `16UC1`.
    Raw,
    /// `bgra8` and `32FC1` in metres.
    Metres,
    /// JPEG and `compressedDepth`.
    Compressed,
    /// `rgb8`, seen through a lens, and `16UC1`.
    Lens,
}

/// k1, k2, p1, p2 and k3 of the lens.
pub const LENS: [f64; 5] = [-0.18, 0.04, 0.001, -0.002, 0.0];

/// Focal lengths, principal point and place to the right of the depth camera.
pub fn color_camera(camera: &CameraConfig) -> ([f64; 4], f64) {
    let scale = camera.color_focal / camera.color_divisor;
    let focal = scale * camera.depth_focal_px;
    let column = scale * camera.depth_center_column_px + camera.color_column_offset / camera.color_divisor;
    let row = scale * camera.depth_center_row_px + camera.color_row_offset / camera.color_divisor;
    let right_m = -camera.color_baseline * camera.depth_numerator_m / (camera.color_focal * camera.depth_focal_px);
    ([focal, focal, column, row], right_m)
}

/// A stamp in nanoseconds.
pub fn nanoseconds(stamp_s: f64) -> u64 {
    (stamp_s * 1e9).round() as u64
}

/// The first seconds of a drive with perfect odometry; `lens` is what `CameraInfo` states.
pub fn messages(drive: &SimulatedDrive, seconds: f64, packing: Packing, lens: &[f64]) -> Vec<Message> {
    let robot = &drive.config().robot;
    let camera = robot.camera.as_ref().unwrap();
    let start_s = drive.config().start_stamp_s;
    let within = |stamp_s: &f64| *stamp_s < start_s + seconds;
    let start_ns = nanoseconds(start_s);
    let on_base = |[x, y, z]: [f64; 3]| [x, y, z - BASE_HEIGHT_M];
    let level = [0.0, 0.0, 0.0, 1.0];
    let (lidar, mount) = (&robot.lidar.mount, &camera.mount);
    let (color, right_m) = color_camera(camera);
    let turn = quaternion(&mount.body_from_sensor().compose(&Pose3::from_quaternion([0.0; 3], OPTICAL)));
    let mut all = vec![
        placed("/tf_static", start_ns, "base_footprint", "base_link", [0.0, 0.0, BASE_HEIGHT_M], level),
        placed("/tf_static", start_ns, "base_link", "laser", on_base([lidar.x_m, lidar.y_m, lidar.z_m]), level),
        placed("/tf_static", start_ns, "base_link", "depth_optical", on_base([mount.x_m, mount.y_m, mount.z_m]), turn),
        placed("/tf_static", start_ns, "depth_optical", "color_optical", [right_m, 0.0, 0.0], level),
    ];
    for step in 0..(seconds * 20.0) as u64 {
        let stamp_ns = start_ns + step * 50_000_000;
        let Pose2 { x, y, theta } = drive.true_pose(stamp_ns as f64 * 1e-9);
        all.push(odometry("/odom", stamp_ns, "base_link", [x, y, theta]));
    }
    let geometry = drive.scan_geometry();
    let (first, rays) = (geometry.angles_rad[0], geometry.angles_rad.len());
    let rays = Rays {
        angle_min_rad: first as f32,
        angle_increment_rad: ((geometry.angles_rad[rays - 1] - first) / (rays - 1) as f64) as f32,
        time_increment_s: 0.0,
        scan_time_s: 0.0,
        range_min_m: geometry.range_min_m,
        range_max_m: geometry.range_max_m,
    };
    let scans = (0..drive.scan_count()).map(|index| drive.scan(index)).take_while(|scan| within(&scan.stamp_s));
    all.extend(scans.map(|taken| scan("/scan", nanoseconds(taken.stamp_s), "laser", &rays, &taken.ranges_m)));

    let depth =
        [camera.depth_focal_px, camera.depth_focal_px, camera.depth_center_column_px, camera.depth_center_row_px];
    for (index, stamp_s) in drive.disparity_stamps_s().into_iter().enumerate().filter(|(_, stamp_s)| within(stamp_s)) {
        let stamp_ns = nanoseconds(stamp_s);
        let values = millimetres(camera, &drive.disparity_image(index).unwrap().values);
        all.push(depth_image(stamp_ns, &values, packing));
        all.push(camera_info("/camera/depth/camera_info", stamp_ns, "depth_optical", SIZE_PX, depth, &[0.0; 5]));
    }
    for (index, stamp_s) in drive.color_stamps_s().into_iter().enumerate().filter(|(_, stamp_s)| within(stamp_s)) {
        let stamp_ns = nanoseconds(stamp_s);
        let rgb = drive.color_image(index).unwrap().rgb;
        let rgb = if packing == Packing::Lens { through_lens(&rgb, color) } else { rgb };
        all.push(color_image(stamp_ns, &rgb, packing));
        all.push(camera_info("/camera/color/camera_info", stamp_ns, "color_optical", SIZE_PX, color, lens));
    }
    all.sort_by_key(|message| message.log_ns);
    all
}

/// Depths of the Kinect's disparities, 0 where it measured nothing.
fn millimetres(camera: &CameraConfig, disparities: &[u16]) -> Vec<u16> {
    let depth_mm = |&disparity: &u16| {
        let dd = camera.disparity_scale * f64::from(disparity) + camera.disparity_offset;
        if disparity == 2047 || dd <= 0.0 { 0 } else { (1000.0 * camera.depth_numerator_m / dd).round() as u16 }
    };
    disparities.iter().map(depth_mm).collect()
}

fn depth_image(stamp_ns: u64, values: &[u16], packing: Packing) -> Message {
    let topic = "/camera/depth/image_raw";
    match packing {
        Packing::Raw | Packing::Lens => {
            let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            image(topic, stamp_ns, "depth_optical", SIZE_PX, "16UC1", &data)
        }
        Packing::Metres => {
            let metres = |value: &u16| if *value == 0 { f32::NAN } else { f32::from(*value) / 1000.0 };
            let data: Vec<u8> = values.iter().flat_map(|value| metres(value).to_le_bytes()).collect();
            image(topic, stamp_ns, "depth_optical", SIZE_PX, "32FC1", &data)
        }
        Packing::Compressed => {
            let picture = Picture { width: 640, height: 480, pixels: Pixels::Gray16(values.to_vec()) };
            let data = [vec![0; 12], png_bytes(&picture).unwrap()].concat();
            let topic = format!("{topic}/compressedDepth");
            compressed_image(&topic, stamp_ns, "depth_optical", "16UC1; compressedDepth png", &data)
        }
    }
}

fn color_image(stamp_ns: u64, rgb: &[[u8; 3]], packing: Packing) -> Message {
    let topic = "/camera/color/image_raw";
    match packing {
        Packing::Raw | Packing::Lens => image(topic, stamp_ns, "color_optical", SIZE_PX, "rgb8", rgb.as_flattened()),
        Packing::Metres => {
            let data: Vec<u8> = rgb.iter().flat_map(|&[r, g, b]| [b, g, r, 255]).collect();
            image(topic, stamp_ns, "color_optical", SIZE_PX, "bgra8", &data)
        }
        Packing::Compressed => {
            let mut data = Vec::new();
            let encoder = jpeg_encoder::Encoder::new(&mut data, 92);
            encoder.encode(rgb.as_flattened(), 640, 480, jpeg_encoder::ColorType::Rgb).unwrap();
            let topic = format!("{topic}/compressed");
            compressed_image(&topic, stamp_ns, "color_optical", "rgb8; jpeg compressed bgr8", &data)
        }
    }
}

/// What the lens makes of an ideal image: each of its pixels shows the ray that it bends there.
fn through_lens(rgb: &[[u8; 3]], [fx, fy, cx, cy]: [f64; 4]) -> Vec<[u8; 3]> {
    let [k1, k2, p1, p2, k3] = LENS;
    let bent = |[x, y]: [f64; 2]| {
        let r2 = x * x + y * y;
        let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    };
    let seen = |index: usize| {
        let wanted = [((index % 640) as f64 - cx) / fx, ((index / 640) as f64 - cy) / fy];
        let mut ray = wanted;
        for _ in 0..12 {
            let [x, y] = bent(ray);
            ray = [ray[0] + wanted[0] - x, ray[1] + wanted[1] - y];
        }
        let (column, row) = ((fx * ray[0] + cx).round(), (fy * ray[1] + cy).round());
        let is_inside = (0.0..640.0).contains(&column) && (0.0..480.0).contains(&row);
        if is_inside { rgb[row as usize * 640 + column as usize] } else { [0; 3] }
    };
    (0..rgb.len()).map(seen).collect()
}

/// The turn of a pose as x, y, z, w.
fn quaternion(pose: &Pose3) -> [f64; 4] {
    let r = &pose.rotation;
    let w = (1.0 + r[(0, 0)] + r[(1, 1)] + r[(2, 2)]).max(0.0).sqrt() / 2.0;
    let part = |a: (usize, usize), b: (usize, usize)| (r[a] - r[b]) / (4.0 * w);
    [part((2, 1), (1, 2)), part((0, 2), (2, 0)), part((1, 0), (0, 1)), w]
}
