//! Raw readings of a robot of your own, pushed one by one as they come in: `cargo run --release --example 2_your_own_robot`.
//!
//! The robot here is made up: it drives a circle in a room of 8 m × 6 m.

#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use floorprint::prelude::*;
use std::error::Error;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

fn main() -> Result<(), Box<dyn Error>> {
    let error_m = your_own_robot()?;
    println!("{:.1} cm off after two rounds", 100.0 * error_m);
    Ok(())
}

/// How far the last pose is from where the robot really is, metres.
pub fn your_own_robot() -> Result<f64, Box<dyn Error>> {
    // Where the LiDAR sits on the robot: 10 cm ahead of the point whose odometry is told, 30 cm above the floor.
    let mut robot = RobotConfig::default();
    (robot.lidar.mount.x_m, robot.lidar.mount.z_m) = (0.1, 0.3);
    let config = Config::resolve(&[Layer::from_robot(&robot)])?;

    // The rays of its scans, counter-clockwise.
    let geometry = Arc::new(ScanGeometry {
        angles_rad: (0..360).map(|ray| TAU * f64::from(ray) / 360.0 - PI).collect(),
        time_offsets_s: vec![0.0; 360],
        range_min_m: 0.05,
        range_max_m: 12.0,
        below_minimum_is_no_return: false,
    });

    let mut synchronizer = Synchronizer::new(&config, None)?;
    let mut slam = Slam::new(&config);
    let mut newest = None;
    for tick in 0..1200 {
        // 50 Hz of odometry that reads 1 % long, 10 Hz of scans.
        let stamp_s = f64::from(tick) * 0.02;
        let stated = StampedPose { stamp_s, pose: pose_at(1.01 * stamp_s) };
        let mut frames = synchronizer.push(Record::Odometry(stated))?;
        if tick % 5 == 0 {
            let ranges_m = geometry.angles_rad.iter().map(|angle| range(&pose_at(stamp_s), *angle)).collect();
            let geometry = Arc::clone(&geometry);
            let scan = Scan { sensor: Default::default(), stamp_s, ranges_m, geometry, odometry: None };
            frames.extend(synchronizer.push(Record::Scan(scan))?);
        }
        // A scan comes out once the odometry has passed it, with the motion that leads to it.
        for frame in frames {
            newest = Some(slam.process(&frame)?);
        }
    }
    // At any time: where the robot is, how sure that is, and the map.
    let step = newest.ok_or("no frame came out")?;
    let map = slam.map().to_raster().ok_or("nothing was seen")?;
    println!("at {:?}, {:?}; map of {}×{} cells", step.pose, step.uncertainty, map.width, map.height);
    let truth = pose_at(0.0).between(&pose_at(step.stamp_s));
    Ok(truth.between(&step.pose).distance())
}

/// Where the robot really is: on a circle of 2 m radius, once around in twelve seconds.
fn pose_at(stamp_s: f64) -> Pose2 {
    let angle = TAU * stamp_s / 12.0;
    Pose2::new(2.0 * angle.sin(), -2.0 * angle.cos(), angle)
}

/// What a ray of the LiDAR measures, metres: the nearest of four walls.
fn range(body: &Pose2, angle: f64) -> f32 {
    let [x, y] = body.transform_point([0.1, 0.0]);
    let (sin, cos) = (body.theta + angle).sin_cos();
    let to_wall = |position: f64, direction: f64, half: f64| (half.copysign(direction) - position) / direction;
    to_wall(x, cos, 4.0).min(to_wall(y, sin, 3.0)) as f32
}
