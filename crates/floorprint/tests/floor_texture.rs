//! The floor's colours from disparity and colour images of a known floor.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use floorprint::geometry::{Mount, Pose2};
use floorprint::sensors::{CameraConfig, ColorImage, DepthImage};
use floorprint::texture::{
    Blend, FloorMapper, FloorPatch, RgbdFrame, SkipReason, TextureConfig, TextureMap, TextureSummary,
};
use nalgebra::Vector3;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const OBSTACLE_RGB: [u8; 3] = [250, 0, 250];
/// How far the body drives between a disparity image and its colour image.
const PAIR_MOTION: Pose2 = Pose2 { x: 0.04, y: 0.0, theta: 0.03 };
/// Five images taken with the same exposure.
const EVEN: [f64; 5] = [1.0; 5];

/// A Kinect of half the resolution.
fn camera() -> CameraConfig {
    CameraConfig {
        mount: Mount { x_m: 0.18, y_m: 0.005, z_m: 0.487, roll_rad: 0.0, pitch_rad: 0.36, yaw_rad: 0.021 },
        depth_focal_px: 292.5,
        depth_center_column_px: 157.9,
        depth_center_row_px: 121.5,
        disparity_scale: -0.00304,
        disparity_offset: 3.31,
        depth_numerator_m: 1.03,
        color_focal: 263.2,
        color_baseline: -4.5 * 875.2,
        color_column_offset: 4819.0,
        color_row_offset: 4165.5,
        color_divisor: 292.5,
        depth_min_m: 0.5,
        depth_max_m: 4.0,
    }
}

/// A box on the floor: least and greatest corner, metres in the world.
type Obstacle = [[f64; 3]; 2];

/// Tiles of half a metre, each with its own colour, under soft waves.
fn floor_rgb(x_m: f64, y_m: f64) -> [u8; 3] {
    let tile = ((x_m / 0.5).floor() * 7.0 + (y_m / 0.5).floor() * 13.0).rem_euclid(5.0);
    let wave = 20.0 * (3.0 * x_m).sin() * (4.0 * y_m).cos();
    [90.0 + 22.0 * tile + wave, 170.0 - 20.0 * tile - wave, 110.0 + wave].map(|value| value as u8)
}

/// Depth along the optical axis and colour of what a ray (world, unit depth) meets.
fn cast(origin: Vector3<f64>, ray: Vector3<f64>, obstacles: &[Obstacle]) -> Option<(f64, [u8; 3])> {
    let floor_m = -origin.z / ray.z;
    let mut nearest = (floor_m > 0.0).then(|| {
        let point = origin + ray * floor_m;
        (floor_m, floor_rgb(point.x, point.y))
    });
    for [least, most] in obstacles {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let [a, b] = [least[axis], most[axis]].map(|side| (side - origin[axis]) / ray[axis]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        if enter < leave && nearest.is_none_or(|(depth_m, _)| enter < depth_m) {
            nearest = Some((enter, OBSTACLE_RGB));
        }
    }
    nearest
}

/// What a pixel's ray meets for a pinhole whose optical centre is shifted to the right.
fn look(
    mount: &Mount,
    pose: &Pose2,
    [focal, center_column, center_row, shift_m]: [f64; 4],
    [column, row]: [f64; 2],
    obstacles: &[Obstacle],
) -> Option<(f64, [u8; 3])> {
    let body_from_camera = mount.body_from_sensor();
    // The mount's axes: x ahead, y left, z up.
    let in_camera = Vector3::new(1.0, (center_column - column) / focal, (center_row - row) / focal);
    let in_body = body_from_camera.rotation * in_camera;
    let origin = body_from_camera.transform_point(Vector3::new(0.0, -shift_m, 0.0));
    let turned = Pose2 { x: 0.0, y: 0.0, theta: pose.theta }.transform_point([in_body.x, in_body.y]);
    let [x, y] = pose.transform_point([origin.x, origin.y]);
    cast(Vector3::new(x, y, origin.z), Vector3::new(turned[0], turned[1], in_body.z), obstacles)
}

struct Shot {
    depth: DepthImage,
    color: ColorImage,
    /// The body's pose at the colour image's time.
    pose: Pose2,
}

/// Renders both images with the camera at `mount`, the disparity image first.
fn shoot(mount: &Mount, pose: Pose2, stamp_s: f64, gain: f64, obstacles: &[Obstacle]) -> Shot {
    let c = camera();
    let depth = [c.depth_focal_px, c.depth_center_column_px, c.depth_center_row_px, 0.0];
    let scale = c.color_focal / c.color_divisor;
    let color = [
        scale * c.depth_focal_px,
        scale * c.depth_center_column_px + c.color_column_offset / c.color_divisor,
        scale * c.depth_center_row_px + c.color_row_offset / c.color_divisor,
        -c.color_baseline * c.depth_numerator_m / (c.color_focal * c.depth_focal_px),
    ];
    let before = pose.compose(&PAIR_MOTION.inverse());
    let pixels = || (0..WIDTH * HEIGHT).map(|index| [(index % WIDTH) as f64, (index / WIDTH) as f64]);
    let disparity = pixels()
        .map(|pixel| match look(mount, &before, depth, pixel, obstacles) {
            Some((depth_m, _)) if (0.5..=4.0).contains(&depth_m) => {
                ((c.depth_numerator_m / depth_m - c.disparity_offset) / c.disparity_scale).round() as u16
            }
            _ => 2047,
        })
        .collect();
    let rgb = pixels()
        .map(|pixel| {
            let rgb = look(mount, &pose, color, pixel, obstacles).map_or([40; 3], |(_, rgb)| rgb);
            rgb.map(|value| (f64::from(value) * gain).round().min(255.0) as u8)
        })
        .collect();
    Shot {
        depth: DepthImage { stamp_s: stamp_s - 0.03, width: WIDTH, height: HEIGHT, values: disparity },
        color: ColorImage { stamp_s, width: WIDTH, height: HEIGHT, rgb },
        pose,
    }
}

/// A drive in a gentle bend.
fn drive(mount: &Mount, gains: [f64; 5], obstacles: &[Obstacle]) -> Vec<Shot> {
    gains
        .into_iter()
        .enumerate()
        .map(|(i, gain)| {
            let t = i as f64;
            shoot(mount, Pose2::new(0.5 * t, 0.04 * t * t, 0.16 * t), 10.0 + t, gain, obstacles)
        })
        .collect()
}

fn mapper(config: &TextureConfig) -> FloorMapper {
    FloorMapper::new(config, &camera(), 1).unwrap()
}

fn patch(mapper: &FloorMapper, shot: &Shot) -> Result<FloorPatch, SkipReason> {
    mapper.patch(&RgbdFrame { depth: &shot.depth, color: &shot.color, depth_body_from_color_body: PAIR_MOTION })
}

fn painted(config: &TextureConfig, shots: &[Shot]) -> TextureMap {
    let mapper = mapper(config);
    let patches: Vec<FloorPatch> = shots.iter().map(|shot| patch(&mapper, shot).unwrap()).collect();
    mapper.paint(&patches, &shots.iter().map(|shot| shot.pose).collect::<Vec<_>>())
}

fn mean_error(map: &TextureMap) -> f64 {
    let errors: Vec<f64> = map
        .cells
        .iter()
        .enumerate()
        .filter_map(|(index, color)| {
            let [x, y] = map.center_m(index);
            let truth = floor_rgb(x, y);
            (*color).map(|color| (0..3).map(|c| f64::from(color[c].abs_diff(truth[c]))).sum::<f64>() / 3.0)
        })
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

fn area_m2(map: &TextureMap) -> f64 {
    map.cells.iter().flatten().count() as f64 * map.resolution_m.powi(2)
}

#[test]
fn the_floors_colours_come_back_in_every_blend_and_resolution() {
    let shots = drive(&camera().mount, EVEN, &[]);
    for blend in [Blend::Mean, Blend::Median, Blend::Newest] {
        for resolution_m in [0.01, 0.02, 0.05] {
            let map = painted(&TextureConfig { blend, resolution_m, ..TextureConfig::default() }, &shots);
            let (error, area) = (mean_error(&map), area_m2(&map));
            assert!(error < 4.0, "{blend:?} at {resolution_m} m: {error:.2} of 255");
            assert!(area > 12.0, "{blend:?} at {resolution_m} m: {area:.1} m²");
        }
    }
}

#[test]
fn a_camera_that_is_mounted_askew_is_found_out() {
    let stated = camera().mount;
    let true_mount = Mount {
        pitch_rad: stated.pitch_rad + 1.5_f64.to_radians(),
        roll_rad: 1.0_f64.to_radians(),
        z_m: stated.z_m + 0.015,
        ..stated
    };
    let shots = drive(&true_mount, EVEN, &[]);
    let tilt = patch(&mapper(&TextureConfig::default()), &shots[0]).unwrap().tilt.unwrap();
    assert!((tilt.pitch_rad.to_degrees() - 1.5).abs() < 0.1, "{tilt:?}");
    // A roll about the optical axis is partly a yaw, which the floor cannot show.
    assert!((tilt.roll_rad.to_degrees() - stated.pitch_rad.cos()).abs() < 0.1, "{tilt:?}");
    assert!((tilt.height_m - 0.015).abs() < 0.003, "{tilt:?}");
    let error = mean_error(&painted(&TextureConfig::default(), &shots));
    assert!(error < 5.0, "{error:.2} of 255");
    let as_stated = TextureConfig { tilt_max_rad: 0.0, plane_tolerance_m: 0.2, ..TextureConfig::default() };
    let uncorrected = mean_error(&painted(&as_stated, &shots));
    assert!(uncorrected > 2.0 * error, "{uncorrected:.2} of 255 without the correction, {error:.2} with it");
}

#[test]
fn changes_of_exposure_are_balanced_without_shifting_the_whole() {
    let shots = drive(&camera().mount, [1.0, 0.85, 1.15, 0.9, 1.1], &[]);
    let balanced = mean_error(&painted(&TextureConfig::default(), &shots));
    let raw = mean_error(&painted(&TextureConfig { exposure_compensation: false, ..TextureConfig::default() }, &shots));
    assert!(balanced < 5.0, "{balanced:.2} of 255");
    assert!(raw > 2.0 * balanced, "{raw:.2} of 255 as exposed, {balanced:.2} balanced");
}

#[test]
fn what_stands_on_the_floor_is_not_painted() {
    let obstacles = [[[1.2, -0.5, 0.0], [1.5, -0.2, 0.4]], [[-1.0, 0.9, 0.0], [6.0, 1.0, 2.0]]];
    let map = painted(&TextureConfig::default(), &drive(&camera().mount, EVEN, &obstacles));
    let foreign = map.cells.iter().flatten().filter(|[r, g, b]| *r > 170 && *g < 75 && *b > 150).count();
    assert!(foreign * 500 < map.cells.iter().flatten().count(), "{foreign} cells bear an obstacle's colour");
    for (index, _) in map.cells.iter().enumerate().filter(|(_, color)| color.is_some()) {
        let point = map.center_m(index);
        let within =
            |axis: usize, [least, most]: &Obstacle| point[axis] > least[axis] + 0.03 && point[axis] < most[axis] - 0.03;
        let inside = obstacles.iter().any(|obstacle| within(0, obstacle) && within(1, obstacle));
        assert!(!inside, "floor at {point:.2?}, inside an obstacle");
    }
    assert!(area_m2(&map) > 4.0);
}

#[test]
fn a_corrected_trajectory_repaints_the_floor() {
    let shots = drive(&camera().mount, EVEN, &[]);
    let mapper = mapper(&TextureConfig::default());
    let patches: Vec<FloorPatch> = shots.iter().map(|shot| patch(&mapper, shot).unwrap()).collect();
    let corrected: Vec<Pose2> = shots.iter().map(|shot| shot.pose).collect();
    let drifted: Vec<Pose2> = corrected.iter().map(|pose| Pose2::new(pose.x * 1.1, pose.y, pose.theta + 0.1)).collect();
    let before = mean_error(&mapper.paint(&patches, &drifted));
    let after = mapper.paint(&patches, &corrected);
    assert!(before > 3.0 * mean_error(&after), "{before:.2} of 255 on the drifted trajectory");
    assert_eq!(after, painted(&TextureConfig::default(), &shots));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let shots = drive(&camera().mount, [1.0, 0.9, 1.1, 1.0, 1.05], &[]);
    for blend in [Blend::Mean, Blend::Median, Blend::Newest] {
        let config = TextureConfig { blend, ..TextureConfig::default() };
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| painted(&config, &shots))
        };
        let one = with(1);
        assert!(one == with(2) && one == with(8), "{blend:?}");
    }
}

#[test]
fn images_that_show_no_floor_are_skipped_with_a_reason() {
    let mapper = mapper(&TextureConfig::default());
    let good = || shoot(&camera().mount, Pose2::IDENTITY, 0.0, 1.0, &[]);
    let reason = |change: &dyn Fn(&mut Shot)| {
        let mut shot = good();
        change(&mut shot);
        patch(&mapper, &shot).map(|_| ()).unwrap_err()
    };
    assert_eq!(reason(&|shot| shot.depth.values.fill(2047)), SkipReason::NoDepth);
    // Beyond 1088 the disparity term of eq. 23 is not positive: such a depth means nothing.
    assert_eq!(reason(&|shot| shot.depth.values.fill(1089)), SkipReason::NoDepth);
    assert_eq!(reason(&|shot| shot.depth.values.fill(u16::MAX)), SkipReason::NoDepth);
    assert_eq!(reason(&|shot| shot.depth.values.fill(500)), SkipReason::NoFloor);
    assert_eq!(reason(&|shot| shot.depth.values.truncate(7)), SkipReason::BrokenImage);
    assert_eq!(reason(&|shot| shot.color.rgb.clear()), SkipReason::BrokenImage);
    let shot = good();
    let motion = Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 };
    let frame = RgbdFrame { depth: &shot.depth, color: &shot.color, depth_body_from_color_body: motion };
    assert_eq!(mapper.patch(&frame).map(|_| ()).unwrap_err(), SkipReason::UnknownMotion);
}

#[test]
fn no_patches_or_no_poses_make_an_empty_map() {
    let mapper = mapper(&TextureConfig::default());
    assert!(mapper.paint(&[], &[]).cells.is_empty());
    let shot = shoot(&camera().mount, Pose2::IDENTITY, 0.0, 1.0, &[]);
    let lost = Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 };
    assert!(mapper.paint(&[patch(&mapper, &shot).unwrap()], &[lost]).cells.is_empty());
}

#[test]
fn a_camera_below_the_floor_is_an_error_that_says_so() {
    let mut camera = camera();
    camera.mount.z_m = -0.2;
    let error = FloorMapper::new(&TextureConfig::default(), &camera, 1).unwrap_err().to_string();
    assert!(error.contains("-0.2 m above the floor") && error.contains("robot.camera"), "{error}");
}

#[test]
fn the_summary_tells_what_became_of_the_images() {
    let mapper = mapper(&TextureConfig::default());
    let shot = shoot(&camera().mount, Pose2::IDENTITY, 0.0, 1.0, &[]);
    let patches = [patch(&mapper, &shot).unwrap()];
    let map = mapper.paint(&patches, &[shot.pose]);
    let skipped = [SkipReason::NoDepth, SkipReason::NoFloor, SkipReason::NoDepth];
    let summary = TextureSummary::new(&patches, &skipped, &map);
    assert_eq!(summary.images_used, 1);
    assert_eq!(
        summary.images_skipped.into_iter().collect::<Vec<_>>(),
        [(SkipReason::NoDepth, 2), (SkipReason::NoFloor, 1)]
    );
    assert!(summary.pitch_error_rad.unwrap().abs() < 0.002);
    assert!((summary.coverage_m2 - area_m2(&map)).abs() < 1e-9 && summary.coverage_m2 > 5.0);
}
