//! Robots drawn at random: their base, their wheels, their LiDAR and where it sits.

use super::config::{MotionConfig, PoseOdometryConfig, SimulationConfig};
use super::lidar_profile::LidarProfile;
use crate::geometry::Mount;
use crate::sensors::{LidarConfig, RobotConfig, StampAt, WheelConfig};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

/// A robot in the words of a table.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RobotName {
    pub(super) base: &'static str,
    pub(super) lidar: &'static str,
}

/// A base by what it drives with and what it tells of its motion.
const BASES: [&str; 6] =
    ["wheels_and_gyro", "wheels_only", "differential_pose", "skid_steered", "omnidirectional", "no_odometry"];

/// Rays of all scans together are no more than this a second: what a drive costs to simulate is bounded.
const MOST_RAYS_PER_S: f64 = 22_000.0;

/// Draws a robot for indoors or outdoors. Its motion is left to be filled in but for what its base can do.
pub(super) fn random_robot(random: &mut Pcg64Mcg, outdoors: bool) -> (SimulationConfig, RobotName) {
    let mut config = SimulationConfig::default();
    config.camera.rate_hz = 0.0;
    let lidar = random_lidar(random, &mut config, outdoors);
    let base = BASES[[0, 0, 1, 2, 2, 3, 3, 4, 4, 5][random.random_range(0..10)]];
    // Good wheels, ordinary ones, and bad ones.
    let badness = [0.3, 1.0, 1.0, 4.0][random.random_range(0..4)];
    let mut about = |value: f64| badness * value * random.random_range(-1.0..1.0);
    config.motion = MotionConfig {
        speed_m_s: 0.0,
        acceleration_m_s2: 0.6,
        turn_rate_rad_s: 1.2,
        turn_acceleration_rad_s2: 2.5,
        standstill_s: 2.0,
        ..MotionConfig::default()
    };
    let wheels = WheelConfig { left_m_per_tick: 0.001, right_m_per_tick: 0.001, track_width_m: 0.5 };
    config.wheels.scale_error = 0.004 * badness;
    config.wheels.slip_noise = 0.03 * badness;
    config.imu.gyro_bias_rad_s = 0.004 * badness;
    let pose = PoseOdometryConfig {
        rate_hz: 20.0,
        length_error: about(0.015),
        turn_error: about(0.03),
        drift_rad_per_m: about(0.006),
        slip_noise: 0.05 * badness,
    };
    match base {
        "wheels_only" => config.imu.is_there = false,
        "skid_steered" => {
            config.wheels.track_error = 0.2 + about(0.1);
            config.wheels.slip_noise = 0.06 * badness;
            // Half of them have a gyro.
            if random.random_bool(0.5) {
                config.pose_odometry = Some(PoseOdometryConfig {
                    turn_error: pose.turn_error * 3.0,
                    slip_noise: 2.0 * pose.slip_noise,
                    ..pose
                });
            }
        }
        "differential_pose" => config.pose_odometry = Some(pose),
        "omnidirectional" => {
            config.motion.look_aside_rad = random.random_range(0.3..1.2);
            config.motion.look_aside_period_s = random.random_range(12.0..30.0);
            config.pose_odometry = Some(PoseOdometryConfig { slip_noise: 1.5 * pose.slip_noise, ..pose });
        }
        "no_odometry" => config.imu.is_there = false,
        _ => {}
    }
    let has_wheels = config.pose_odometry.is_none() && base != "no_odometry";
    config.robot.wheels = has_wheels.then_some(wheels);
    config.robot.camera = None;
    (config, RobotName { base, lidar })
}

/// Draws the LiDAR and its mount, and gives its name.
fn random_lidar(random: &mut Pcg64Mcg, config: &mut SimulationConfig, outdoors: bool) -> &'static str {
    let fitting: Vec<&LidarProfile> =
        LidarProfile::all().iter().filter(|profile| !outdoors || profile.range_max_m > 20.0).collect();
    let profile = fitting[random.random_range(0..fitting.len())];
    let rate_hz = profile.rates_hz[random.random_range(0..profile.rates_hz.len())];
    let (mut lidar, sweep_s) = profile.simulation(rate_hz);
    // Some are thinned by whoever records them, and some see through a gap in the robot's body.
    if random.random_bool(0.12) {
        lidar.rate_hz = lidar.rate_hz.min(random.random_range(1.0..4.0));
    }
    let mut seen = 1.0;
    if random.random_bool(0.15) {
        let view_rad = random.random_range(60.0_f64..180.0).to_radians().min(lidar.field_of_view_rad);
        seen = view_rad / lidar.field_of_view_rad;
        lidar.beams = ((lidar.beams as f64 * seen) as usize).max(30);
        lidar.field_of_view_rad = view_rad;
    }
    let too_many = lidar.beams as f64 * lidar.rate_hz / MOST_RAYS_PER_S;
    if too_many > 1.0 {
        lidar.rate_hz /= too_many;
    }
    lidar.range_bias_m = profile.bias_m * random.random_range(-0.7..0.7);
    lidar.dropout_share = [0.003, 0.003, 0.02, 0.1][random.random_range(0..4)];
    if random.random_bool(0.4) {
        lidar.weak_return_noise = random.random_range(0.5..3.0);
    }
    if random.random_bool(0.4) {
        lidar.mixed_pixel_share = random.random_range(0.1..0.6);
    }
    let sunny = if outdoors { 0.5 } else { 0.15 };
    if random.random_bool(sunny) {
        lidar.sunlight_share = if profile.is_blinded_by_sunlight { 1.0 } else { random.random_range(0.2..0.8) };
    }
    if random.random_bool(0.15) {
        lidar.stamp_delay_s = random.random_range(-0.05..0.05);
    }
    config.lidar = lidar;
    let is_upside_down = random.random_bool(0.15);
    let yaw_rad = if random.random_bool(0.25) { random.random_range(-PI..PI) } else { 0.0 };
    config.robot = RobotConfig {
        name: "simulated".to_owned(),
        lidar: LidarConfig {
            mount: Mount {
                x_m: random.random_range(-0.25..0.25),
                y_m: random.random_range(-0.15..0.15),
                z_m: 0.4,
                roll_rad: if is_upside_down { PI } else { 0.0 },
                pitch_rad: 0.0,
                yaw_rad,
            },
            sweep_duration_s: (seen * sweep_s).min(1.0 / config.lidar.rate_hz),
            stamp_at: [StampAt::Start, StampAt::Middle, StampAt::End][random.random_range(0..3)],
        },
        ..RobotConfig::default()
    };
    profile.name
}
