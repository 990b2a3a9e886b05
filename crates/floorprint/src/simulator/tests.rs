//! Properties of whole simulated drives.

use super::camera::{color_pinhole, depth_pinhole};
use super::floor_plan::FloorPlan;
use super::{Fault, SimulatedDrive, SimulationConfig, WheelCounts, World, simulate};
use crate::Config;
use crate::Frames;
use crate::geometry::{Pose2, wrap_angle};
use crate::map::Occupancy;
use crate::sensors::{Record, RobotConfig, Scan};
use nalgebra::Vector3;

/// A quick version of the course's robot: 181 rays, ten scans a second.
fn small() -> SimulationConfig {
    let mut config = SimulationConfig::default();
    (config.lidar.beams, config.lidar.rate_hz) = (181, 10.0);
    config
}

fn drive(world: &str, config: SimulationConfig, seed: u64) -> SimulatedDrive {
    simulate(World::named(world, seed).unwrap(), config, seed).unwrap()
}

fn all_ranges(drive: &SimulatedDrive) -> Vec<u32> {
    (0..drive.scan_count()).flat_map(|scan| drive.scan(scan).ranges_m).map(f32::to_bits).collect()
}

#[test]
fn equal_seeds_give_equal_bytes_and_other_seeds_other_bytes() {
    let bytes = |seed| {
        let drive = drive("glass", small(), seed);
        let gyro: Vec<u64> = drive.imu_readings().iter().map(|r| r.angular_velocity_rad_s[2].to_bits()).collect();
        (all_ranges(&drive), drive.wheel_counts().to_vec(), gyro)
    };
    let (first, again, other) = (bytes(3), bytes(3), bytes(4));
    assert!(first == again);
    assert!(first.0 != other.0 && first.1 != other.1 && first.2 != other.2);
}

#[test]
fn records_are_in_order_and_the_stream_is_the_same() {
    let drive = drive("rooms", small(), 1);
    let records = drive.records();
    assert!(records.windows(2).all(|pair| pair[0].stamp_s() <= pair[1].stamp_s()));
    assert_eq!(records.len(), drive.scan_count() + drive.wheel_counts().len() + drive.imu_readings().len());
    for (stored, streamed) in records.iter().zip(drive.stream()) {
        assert_eq!(stored.stamp_s(), streamed.stamp_s());
        if let (Record::Scan(a), Record::Scan(b)) = (stored, &streamed) {
            assert_eq!(a.ranges_m, b.ranges_m);
        }
    }
}

/// Frames made of scans on demand are those made of records in memory.
#[test]
fn frames_on_demand_are_the_same() {
    let drive = drive("loop", small(), 2);
    let config = Config { robot: drive.config().robot.clone(), ..Config::default() };
    let records = drive.records();
    let (kept, made) = (Frames::new(&records, &config).unwrap(), Frames::of(&drive, &config).unwrap());
    assert_eq!(kept.summary(), made.summary());
    assert_eq!(kept.len(), made.len());
    for (kept, made) in kept.iter().zip(made.iter()).step_by(50) {
        assert_eq!((kept.stamp_s, kept.elapsed_s, kept.motion), (made.stamp_s, made.elapsed_s, made.motion));
        assert_eq!(kept.scan.hits, made.scan.hits);
    }
}

/// No robot drives through a wall: the smallest distance on any route leaves room for its body.
#[test]
fn every_route_keeps_clear_of_walls_and_furniture() {
    for name in World::names() {
        for seed in 0..2 {
            let mut config = small().without_noise();
            config.robot.lidar.mount.x_m = 0.0;
            (config.lidar.beams, config.lidar.rate_hz) = (91, 4.0);
            config.lidar.field_of_view_rad = std::f64::consts::TAU;
            let mut world = World::named(name, seed).unwrap();
            world.walkers.clear();
            let follows_a_route = world.commands().is_empty();
            let drive = simulate(world, config, seed).unwrap();
            let nearest_m = (0..drive.scan_count())
                .flat_map(|scan| drive.scan(scan).ranges_m)
                .fold(f32::INFINITY, |nearest, range| if range > 0.01 { nearest.min(range) } else { 0.0 });
            assert!(nearest_m > 0.35, "{name}, seed {seed}: {nearest_m} m");
            assert!(drive.duration_s() > 30.0, "{name}: {} s", drive.duration_s());
            let end = drive.truth().last().unwrap().pose;
            let last = drive.world().route().last().unwrap().position_m;
            let end = drive.start.compose(&end);
            let off_m = (end.x - last[0]).hypot(end.y - last[1]);
            assert!(off_m < 0.15 || !follows_a_route, "{name} does not arrive: {end:?}, {last:?}");
        }
    }
}

/// Offices of any size are about as long as asked for.
#[test]
fn an_office_is_as_long_as_asked_for() {
    for length_m in [500.0, 1000.0, 2000.0, 5000.0] {
        let route_m = World::office(length_m, 0).route_length_m();
        assert!((route_m / length_m - 1.0).abs() < 0.12, "{route_m} m instead of {length_m} m");
    }
    assert_eq!(World::office(700.0, 3).walls(), World::office(700.0, 3).walls());
    assert_ne!(World::office(700.0, 3).walls(), World::office(700.0, 4).walls());
}

/// The worlds that are like other people's logs have the sizes that they say.
#[test]
fn large_worlds_have_the_sizes_that_they_say() {
    let building = World::named("main_building", 1).unwrap();
    assert!((1800.0..2000.0).contains(&building.route_length_m()), "{} m", building.route_length_m());
    let [low, high] = World::named("large_hall", 1).unwrap().bounds_m();
    assert!((high[0] - low[0] - 60.0).abs() < 0.5 && (high[1] - low[1] - 40.0).abs() < 0.5);
}

/// A sparse LiDAR beside the body's middle sees the empty room from where it sits.
#[test]
fn a_sparse_lidar_off_the_middle_measures_from_where_it_is() {
    let place = Pose2::new(-0.2, 0.3, 0.5);
    let mut config = SimulationConfig::default().with_sparse_lidar().with_lidar_at(place).without_noise();
    config.motion.start_heading_error_rad = 0.0;
    let scan = empty_room(config).scan(0);
    assert_eq!(scan.ranges_m.len(), 180);
    assert!((scan.geometry.angles_rad[1] - scan.geometry.angles_rad[0] - 1.0_f64.to_radians()).abs() < 1e-9);
    let building_from_lidar = Pose2::new(3.0, 2.0, 0.0).compose(&place);
    for (&range_m, &angle_rad) in scan.ranges_m.iter().zip(&scan.geometry.angles_rad) {
        let [x, y] =
            building_from_lidar.transform_point([angle_rad.cos(), angle_rad.sin()].map(|m| m * f64::from(range_m)));
        let off_m = [x, 8.0 - x, y, 6.0 - y].into_iter().map(f64::abs).fold(f64::INFINITY, f64::min);
        assert!(off_m < 0.001, "the ray at {angle_rad} rad ends {off_m} m off the walls");
    }
}

/// Without noise, wheels and gyro together are dead reckoning without error.
#[test]
fn noise_free_odometry_leads_along_the_truth() {
    let drive = drive("corridors", small().without_noise(), 2);
    let (mut pose, mut yaw_rad, mut yaw_before_rad, mut stamp_s) = (Pose2::IDENTITY, 0.0, 0.0, f64::NAN);
    let mut truth = drive.truth().into_iter();
    let (mut farthest_m, mut largest_rad) = (0.0_f64, 0.0_f64);
    for record in drive.records() {
        match record {
            Record::Imu(imu) => {
                if stamp_s.is_finite() {
                    yaw_rad += imu.angular_velocity_rad_s[2] * (imu.stamp_s - stamp_s);
                }
                stamp_s = imu.stamp_s;
            }
            Record::Encoders(reading) => {
                let distance_m = 0.0022 * 0.5 * (reading.left_ticks + reading.right_ticks);
                pose = pose.compose(&Pose2::exp([distance_m, 0.0, yaw_rad - yaw_before_rad]));
                yaw_before_rad = yaw_rad;
            }
            Record::Scan(_) => {
                let true_pose = truth.next().unwrap().pose;
                farthest_m = farthest_m.max(true_pose.between(&pose).distance());
                largest_rad = largest_rad.max(wrap_angle(true_pose.theta - pose.theta).abs());
            }
            Record::Odometry(_) => unreachable!("no such records are simulated"),
        }
    }
    // A scan may come up to one interval after the last ticks.
    assert!(farthest_m < 0.05, "{farthest_m} m");
    assert!(largest_rad < 0.04, "{largest_rad} rad");
}

/// An empty room of 8 m by 6 m with the robot at (3, 2), looking along x.
fn empty_room(config: SimulationConfig) -> SimulatedDrive {
    let mut plan = FloorPlan::new(1, 0);
    plan.space([0.0, 8.0], [0.0, 6.0]);
    plan.drive_to(&[[3.0, 2.0], [6.0, 2.0]]);
    simulate(plan.build("empty room"), config, 1).unwrap()
}

/// The range to the walls of the empty room from a LiDAR on a body at `body`, metres.
fn range_in_empty_room_m(body: Pose2, angle_rad: f64) -> f64 {
    // The LiDAR sits 0.13323 m ahead of the body's origin.
    let [x, y] = body.transform_point([0.13323, 0.0]);
    let (sin, cos) = (body.theta + angle_rad).sin_cos();
    let to_side = |place: f64, direction: f64, size: f64| match direction {
        0.0 => f64::INFINITY,
        ahead if ahead > 0.0 => (size - place) / ahead,
        behind => -place / behind,
    };
    to_side(x, cos, 8.0).min(to_side(y, sin, 6.0))
}

#[test]
fn the_range_image_of_a_known_room_is_exact() {
    let mut config = small().without_noise();
    config.motion.start_heading_error_rad = 0.0;
    let drive = empty_room(config);
    let scan = drive.scan(0);
    for (&range_m, &angle_rad) in scan.ranges_m.iter().zip(&scan.geometry.angles_rad) {
        let exact_m = range_in_empty_room_m(Pose2::new(3.0, 2.0, 0.0), angle_rad);
        assert!((f64::from(range_m) - exact_m).abs() < 0.000_51, "{range_m} m instead of {exact_m} m");
    }
}

/// Every ray is cast from where the robot is at the ray's own time.
#[test]
fn a_sweep_is_skewed_by_the_motion_within_it() {
    let drive = empty_room(small().without_noise());
    let scan = (0..drive.scan_count()).map(|scan| drive.scan(scan)).find(|scan| scan.stamp_s > 1.3e9 + 7.0).unwrap();
    let pose_at = |stamp_s: f64| drive.start.compose(&drive.true_pose(stamp_s));
    let mut largest_skew_m = 0.0_f64;
    for (beam, &angle_rad) in scan.geometry.angles_rad.iter().enumerate() {
        let stamp_s = scan.stamp_s + (beam as f64 / 180.0 - 0.5) * 0.75 * 0.025;
        let exact_m = range_in_empty_room_m(pose_at(stamp_s), angle_rad);
        assert!((f64::from(scan.ranges_m[beam]) - exact_m).abs() < 0.000_6);
        largest_skew_m = largest_skew_m.max((exact_m - range_in_empty_room_m(pose_at(scan.stamp_s), angle_rad)).abs());
    }
    assert!(largest_skew_m > 0.004, "the robot moves: {largest_skew_m} m");
}

/// Equations 25–26, rewritten as a pinhole camera, still give the same pixels.
#[test]
fn the_colour_camera_is_the_one_of_the_report() {
    let camera = RobotConfig::ece276a().camera.unwrap();
    let (depth, color) = (depth_pinhole(&camera), color_pinhole(&camera));
    for (column, row, depth_m) in [(0.0, 0.0, 0.6), (320.0, 240.0, 1.5), (600.0, 470.0, 3.9)] {
        let dd = camera.depth_numerator_m / depth_m;
        let report = [(526.37 * column - 4.5 * 1750.46 * dd + 19276.0) / 585.051, (526.37 * row + 16662.0) / 585.051];
        let x = (column - depth.center_px[0]) / depth.focal_px * depth_m;
        let y = (row - depth.center_px[1]) / depth.focal_px * depth_m;
        let pinhole = [
            color.focal_px * (x - color.right_m) / depth_m + color.center_px[0],
            color.focal_px * y / depth_m + color.center_px[1],
        ];
        assert!((report[0] - pinhole[0]).abs() < 1e-9 && (report[1] - pinhole[1]).abs() < 1e-9);
    }
}

/// A pixel of the disparity image leads through equations 23–27 to a point of the floor, and its
/// colour pixel shows the paint at that point.
#[test]
fn a_floor_pixel_leads_back_to_the_floor_and_to_its_colour() {
    let drive = drive("rooms", small().without_noise(), 5);
    let camera = RobotConfig::ece276a().camera.unwrap();
    let (disparity, color) = (drive.disparity_image(0).unwrap(), drive.color_image(0).unwrap());
    let body_from_camera = camera.mount.body_from_sensor();
    let building_from_body = drive.trajectory.at(1.0).pose();
    let (mut pixels, mut agree) = (0, 0);
    for row in (200..480).step_by(7) {
        for column in (100..540).step_by(11) {
            let d = f64::from(disparity.values[row * 640 + column]);
            let dd = -0.00304 * d + 3.31;
            let depth_m = 1.03 / dd;
            let x = (column as f64 - camera.depth_center_column_px) / camera.depth_focal_px * depth_m;
            let y = (row as f64 - camera.depth_center_row_px) / camera.depth_focal_px * depth_m;
            let point = body_from_camera.transform_point(Vector3::new(depth_m, -x, -y));
            if point.x.hypot(point.y) > 2.0 {
                continue;
            }
            assert!(point.z.abs() < 0.01, "{} m off the floor at {row}, {column}", point.z);
            let color_column = (526.37 * column as f64 - 4.5 * 1750.46 * dd + 19276.0) / 585.051;
            let color_row = (526.37 * row as f64 + 16662.0) / 585.051;
            let shown = color.rgb[color_row.round() as usize * 640 + color_column.round() as usize];
            let place = building_from_body.transform_point([point.x, point.y]);
            let painted = drive.world.floor.painter(place, 0.1).color(place);
            let apart = shown.iter().zip(painted).map(|(&a, b)| a.abs_diff(b)).max().unwrap();
            pixels += 1;
            agree += usize::from(apart <= 3);
        }
    }
    assert!(pixels > 500, "{pixels} pixels of floor");
    // Pixels on an edge of the paint mix two colours.
    assert!(agree as f64 > 0.95 * f64::from(pixels), "{agree} of {pixels} pixels agree");
}

/// The ticks of both sides within a span, and the number of scans and lost rays in it.
fn in_span(faults: Vec<Fault>, from_s: f64, for_s: f64) -> (Vec<f64>, usize, f64) {
    let drive = drive("rooms", SimulationConfig { faults, ..small() }, 1);
    let inside = |stamp_s: f64| (from_s..from_s + for_s).contains(&(stamp_s - 1.3e9));
    let readings = drive.wheel_counts().iter().filter(|counts| inside(counts.stamp_s)).map(WheelCounts::reading);
    let ticks = readings.map(|reading| 0.5 * (reading.left_ticks + reading.right_ticks)).collect();
    let scans: Vec<Scan> =
        (0..drive.scan_count()).map(|scan| drive.scan(scan)).filter(|scan| inside(scan.stamp_s)).collect();
    let rays = scans.iter().flat_map(|scan| &scan.ranges_m);
    let lost = rays.clone().filter(|&&range_m| !(0.1..30.0).contains(&range_m)).count();
    (ticks, scans.len(), lost as f64 / rays.count().max(1) as f64)
}

#[test]
fn faults_do_what_they_say() {
    let (from_s, for_s) = (10.0, 2.0);
    let sum = |ticks: &[f64]| ticks.iter().sum::<f64>();
    let (plain, scans, lost) = in_span(Vec::new(), from_s, for_s);
    assert!(scans == 20 && lost < 0.02 && sum(&plain) > 100.0);

    let (slip, ..) = in_span(vec![Fault::WheelSlip { from_s, for_s, share: 1.0 }], from_s, for_s);
    assert!((sum(&slip) / sum(&plain) - 2.0).abs() < 0.05);
    let (stuck, ..) = in_span(vec![Fault::EncodersStuck { from_s, for_s }], from_s, for_s);
    assert!(stuck.iter().all(|&ticks| ticks == 0.0));
    let (jumps, ..) = in_span(vec![Fault::EncodersJump { from_s, for_s, jump_m: 0.5 }], from_s, for_s);
    let largest = |ticks: &[f64]| ticks.iter().fold(0.0_f64, |most, ticks| most.max(ticks.abs()));
    assert!(largest(&jumps) > 200.0 && largest(&plain) < 20.0);
    let (_, scans, _) = in_span(vec![Fault::LidarDropout { from_s, for_s }], from_s, for_s);
    assert_eq!(scans, 0);
    let (_, _, lost) = in_span(vec![Fault::RaysLost { from_s, for_s, share: 0.3 }], from_s, for_s);
    assert!((lost - 0.3).abs() < 0.03, "{lost}");

    let (whole, ..) = in_span(Vec::new(), 0.0, 100.0);
    let (unsigned, ..) = in_span(vec![Fault::EncodersSignLost { from_s: 0.0, for_s: 100.0 }], 0.0, 100.0);
    assert!(whole.iter().any(|&ticks| ticks < -5.0), "the route has a stretch in reverse");
    assert!(unsigned.iter().all(|&ticks| ticks >= 0.0));
}

#[test]
fn a_kidnapped_robot_is_elsewhere_and_its_wheels_do_not_know() {
    let kidnapping = vec![Fault::Kidnapping { at_s: 12.0, ahead_m: 3.0 }];
    let drive = drive("loop", SimulationConfig { faults: kidnapping, ..small() }, 1);
    let truth = drive.truth();
    let jumps = truth.windows(2).filter(|pair| pair[0].pose.between(&pair[1].pose).distance() > 1.0).count();
    assert_eq!(jumps, 1);
    let most = drive.wheel_counts().iter().flat_map(|counts| counts.ticks).max();
    assert!(most.unwrap() < 30);
}

#[test]
fn people_who_walk_along_are_close_by() {
    let people = vec![Fault::PeopleAlong { from_s: 8.0, for_s: 10.0, people: 5 }];
    let near = |faults: Vec<Fault>| {
        let drive = drive("pillars", SimulationConfig { faults, ..small() }, 1);
        let scan = (0..drive.scan_count()).map(|scan| drive.scan(scan)).find(|scan| scan.stamp_s > 1.3e9 + 12.0);
        scan.unwrap().ranges_m.iter().filter(|range_m| (0.3..1.5).contains(*range_m)).count()
    };
    assert!(near(people) > near(Vec::new()) + 10);
}

#[test]
fn an_unknown_world_and_an_impossible_setting_are_explained() {
    let message = World::named("room", 1).unwrap_err().to_string();
    assert!(message.contains("\"room\"") && message.contains("did you mean \"rooms\"?"), "{message}");
    let mut config = small();
    config.lidar.rate_hz = 0.0;
    let message = simulate(World::named("rooms", 1).unwrap(), config, 1).unwrap_err().to_string();
    assert!(message.contains("lidar.rate_hz = 0"), "{message}");
}

/// The free cells of the true map are those that the LiDAR sees through, its walls where rays end.
#[test]
fn the_true_map_is_what_the_lidar_measures() {
    let drive = drive("glass", small().without_noise(), 3);
    let map = drive.true_map(0.05);
    let (mut ends, mut on_walls) = (0, 0);
    for (index, truth) in drive.truth().iter().enumerate().step_by(10).take(4) {
        let scan = drive.scan(index);
        for (&range_m, angle) in scan.ranges_m.iter().zip(&scan.geometry.angles_rad) {
            let range_m = f64::from(range_m);
            let on_ray = |m: f64| truth.pose.transform_point([0.13323 + m * angle.cos(), m * angle.sin()]);
            ends += 1;
            let wall = [-0.05, 0.0, 0.05].map(|m| map.at(on_ray(range_m + m)) == Some(&Occupancy::Occupied));
            on_walls += usize::from(wall.contains(&true));
            assert_ne!(map.at(on_ray(0.5 * range_m)), Some(&Occupancy::Unknown));
        }
    }
    assert!(on_walls as f64 > 0.97 * f64::from(ends), "{on_walls} of {ends} rays end on a wall");
}
