//! Properties of whole simulated drives.

use super::{SimulatedDrive, SimulationConfig, World, simulate};
use crate::geometry::{Pose2, wrap_angle};
use crate::sensors::Record;

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
            let drive = simulate(world, config, seed).unwrap();
            let nearest_m = (0..drive.scan_count())
                .flat_map(|scan| drive.scan(scan).ranges_m)
                .fold(f32::INFINITY, |nearest, range| if range > 0.01 { nearest.min(range) } else { 0.0 });
            assert!(nearest_m > 0.35, "{name}, seed {seed}: {nearest_m} m");
            assert!(drive.duration_s() > 30.0, "{name}: {} s", drive.duration_s());
            let end = drive.truth().last().unwrap().pose;
            let last = drive.world().route().last().unwrap().position_m;
            let end = drive.start.compose(&end);
            assert!((end.x - last[0]).hypot(end.y - last[1]) < 0.15, "{name} does not arrive: {end:?}, {last:?}");
        }
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
