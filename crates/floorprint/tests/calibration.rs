//! What is calibrated from a drive is what the robot was simulated with.

#![allow(clippy::unwrap_used, reason = "a test ends where a step fails")]

mod simulation;

use floorprint::calibration::{Calibration, CalibrationError, Parameter};
use floorprint::config::{Config, Layer};
use floorprint::geometry::Pose2;
use floorprint::odometry::Finding;
use floorprint::sensors::{Record, RobotConfig, StampedPose, Stream};
use floorprint::simulator::{PoseOdometryConfig, SimulatedDrive, SimulationConfig, World, simulate};
use floorprint::{Frames, Slam};
use simulation::quick;

/// The recording of a robot, with the clocks of its sensors shifted.
fn records(simulation: SimulationConfig, encoders_s: f64, imu_s: f64, odometry_s: f64) -> Vec<Record> {
    let mut records = simulate(World::named("rooms", 1).unwrap(), simulation, 1).unwrap().records();
    for record in &mut records {
        match record {
            Record::Encoders(reading) => reading.stamp_s += encoders_s,
            Record::Imu(reading) => reading.stamp_s += imu_s,
            Record::Odometry(stamped) => stamped.stamp_s += odometry_s,
            Record::Scan(_) => {}
        }
    }
    records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
    records
}

fn calibrate(records: &[Record], robot: &RobotConfig) -> Result<Calibration, CalibrationError> {
    Calibration::of(records, &Config::resolve(&[Layer::from_robot(robot)]).unwrap())
}

fn parameter<'a>(calibration: &'a Calibration, key: &str) -> &'a Parameter {
    calibration.parameters.iter().find(|parameter| parameter.key == key).unwrap()
}

/// Checks that parameters are found within so much of the truth, and within four times what is stated.
fn check(calibration: &Calibration, expected: &[(&str, f64, f64)]) {
    for (key, truth, within) in expected {
        let parameter = parameter(calibration, key);
        let off = (parameter.found - truth).abs();
        assert!(parameter.is_told, "{parameter:?}");
        assert!(off <= *within, "{parameter:?}, true {truth}");
        assert!(off <= 4.0 * parameter.sigma, "{parameter:?} is surer than it is: true {truth}");
    }
}

/// The course's robot, sensors at other places than it believes.
fn other() -> SimulationConfig {
    let mut simulation = quick().with_lidar_at(Pose2::new(0.18, -0.03, 0.05));
    let wheels = simulation.robot.wheels.as_mut().unwrap();
    (wheels.left_m_per_tick, wheels.right_m_per_tick, wheels.track_width_m) = (0.00226, 0.00223, 0.68);
    simulation.wheels.scale_error = 0.0;
    simulation
}

#[test]
fn wheels_gyro_mount_and_clocks_are_found() {
    let calibration = calibrate(&records(other(), 0.04, -0.03, 0.0), &RobotConfig::ece276a()).unwrap();
    check(
        &calibration,
        &[
            ("robot.lidar.mount.x_m", 0.18, 0.004),
            ("robot.lidar.mount.y_m", -0.03, 0.004),
            ("robot.lidar.mount.yaw_rad", 0.05, 0.0015),
            ("robot.wheels.left_m_per_tick", 0.00226, 0.00226 * 0.002),
            ("robot.wheels.right_m_per_tick", 0.00223, 0.00223 * 0.002),
            ("robot.wheels.track_width_m", 0.68, 0.68 * 0.004),
            ("robot.scale.gyro", 1.0, 0.003),
            ("robot.lag.encoders_s", 0.04, 0.004),
            ("robot.lag.imu_s", -0.03, 0.003),
        ],
    );
}

#[test]
fn stated_odometry_is_put_right() {
    let mut simulation = other();
    simulation.pose_odometry =
        Some(PoseOdometryConfig { length_error: 0.04, turn_error: -0.06, drift_rad_per_m: 0.0, ..Default::default() });
    let calibration = calibrate(&records(simulation, 0.0, 0.0, 0.12), &RobotConfig::ece276a()).unwrap();
    check(
        &calibration,
        &[
            ("robot.lidar.mount.x_m", 0.18, 0.008),
            ("robot.lidar.mount.y_m", -0.03, 0.008),
            ("robot.lidar.mount.yaw_rad", 0.05, 0.006),
            ("robot.scale.odometry_distance", 1.0 / 1.04, 0.003),
            ("robot.scale.odometry_turn", 1.0 / 0.94, 0.003),
            ("robot.lag.odometry_s", 0.12, 0.004),
        ],
    );
}

#[test]
fn what_a_drive_cannot_tell_is_not_told() {
    // A drive up to its first turn.
    let drive = simulate(World::named("long_loop", 1).unwrap(), quick(), 1).unwrap();
    let mut records = drive.records();
    let start = drive.true_pose(records[0].stamp_s());
    let turns = |record: &Record| start.between(&drive.true_pose(record.stamp_s())).theta.abs() > 0.1;
    records.truncate(records.iter().position(turns).unwrap());
    let calibration = calibrate(&records, &RobotConfig::ece276a()).unwrap();
    for key in ["robot.lidar.mount.x_m", "robot.wheels.track_width_m", "robot.scale.gyro"] {
        assert!(!parameter(&calibration, key).is_told, "{:?}", parameter(&calibration, key));
    }
    let scans: Vec<Record> = records.into_iter().filter(|record| matches!(record, Record::Scan(_))).collect();
    let error = calibrate(&scans, &RobotConfig::ece276a()).unwrap_err();
    assert!(matches!(error, CalibrationError::NoOdometry), "{error}");
}

/// Largest distance from the truth that a drive ends with, metres, and what was found of its clocks.
fn solved_with(records: &[Record], drive: &SimulatedDrive, learn_lag: bool) -> (f64, Option<f64>, usize) {
    let mut config = Config::resolve(&[Layer::from_robot(&RobotConfig::ece276a())]).unwrap();
    config.odometry.learn_lag = learn_lag;
    let frames = Frames::new(records, &config).unwrap();
    let mut slam = Slam::new(&config);
    let mut rejected = 0;
    for frame in frames.iter() {
        rejected += usize::from(slam.process(&frame).unwrap().filter.odometry_rejected);
    }
    let found = frames.summary().findings.into_iter().find_map(|finding| match finding {
        Finding::Lag { sensor: Stream::Odometry, late_s } => Some(late_s),
        _ => None,
    });
    let off = |pose: &StampedPose| drive.true_pose(pose.stamp_s).between(&pose.pose).distance();
    (slam.finish().trajectory.iter().map(off).fold(0.0, f64::max), found, rejected)
}

#[test]
fn a_clock_that_is_off_is_put_right_on_the_way() {
    let mut simulation = quick();
    simulation.pose_odometry = Some(PoseOdometryConfig::default());
    // It looks to either side all the time, as guards do.
    (simulation.motion.look_aside_rad, simulation.motion.look_aside_period_s) = (0.6, 3.0);
    let drive = simulate(World::named("rooms", 1).unwrap(), simulation.clone(), 1).unwrap();
    assert_eq!(solved_with(&drive.records(), &drive, true).1, None, "no lag is made up");
    let early = records(simulation, 0.0, 0.0, -0.25);
    let (as_it_is_m, found, rejected_as_it_is) = solved_with(&early, &drive, false);
    assert_eq!(found, None);
    let (put_right_m, found, rejected) = solved_with(&early, &drive, true);
    assert!(found.is_some_and(|late_s| (late_s + 0.25).abs() < 0.03), "{found:?}");
    assert!(rejected * 4 < rejected_as_it_is, "{rejected} scans against {rejected_as_it_is}");
    assert!(put_right_m < 0.1 && put_right_m < as_it_is_m + 0.01, "{put_right_m} m against {as_it_is_m} m");
}
