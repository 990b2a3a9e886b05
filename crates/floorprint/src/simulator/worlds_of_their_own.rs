//! Named worlds that come with a robot of their own: drives that others have trouble with.

use super::config::{ImuSimulationConfig, LidarSimulationConfig, MotionConfig, PoseOdometryConfig, SimulationConfig};
use super::fault::Fault;
use super::floor_plan::FloorPlan;
use super::lidar_profile::PROFILES;
use super::random_world::campus_of_size;
use crate::geometry::Mount;
use crate::sensors::{LidarConfig, RobotConfig, StampAt};
use rand::RngExt;

/// How a robot turns or goes straight on, as reports on drift of slam_toolbox have it (2026, numbers 878 to 883): a
/// command of speed (m/s), yaw rate (rad/s) and duration (s), and where it starts, metres along the room.
const MANEUVERS: [(&str, [f64; 3], f64); 6] = [
    // 878: "sustained high-rate rotation".
    ("spin", [0.0, 1.5, 30.0], 8.0),
    // 879: "sustained, near-max-speed straight-line translation", in reverse.
    ("straight_back", [-0.3, 0.0, 36.0], 13.5),
    // 880: "moderate arc motion".
    ("arc", [0.25, 1.0, 40.0], 8.0),
    // 881: the sharper arc of 878 and 882.
    ("sharp_arc", [0.3, 1.2, 40.0], 8.0),
    // 882: "turn hard".
    ("wide_arc", [0.3, 0.6, 40.0], 8.0),
    // 883: "even when I just drove it in a straight line".
    ("straight", [0.3, 0.0, 36.0], 2.5),
];

/// How long the campus' robot pauses, seconds.
const PAUSE_S: f64 = 198.0;

/// The names of the six maneuvers.
pub(super) fn maneuvers() -> impl Iterator<Item = &'static str> {
    MANEUVERS.iter().map(|(name, ..)| *name)
}

/// A furnished room of 16 by 8 m in which a robot keeps to a command.
pub(super) fn maneuver(name: &str, seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 16);
    let room = plan.space([0.0, 16.0], [0.0, 8.0]);
    plan.niches(room);
    let command = MANEUVERS.iter().find(|(known, ..)| *known == name);
    if let Some(&(_, [speed_m_s, turn_rate_rad_s, for_s], start_x_m)) = command {
        // Furniture keeps off the stretch that is driven, which is no longer than this.
        plan.drive_to(&[[start_x_m, 4.0], [if start_x_m > 9.0 { 2.0 } else { 14.0 }, 4.0]]);
        plan.furnish(room, 14);
        plan.face_east();
        plan.command(speed_m_s, turn_rate_rad_s, for_s);
    }
    plan
}

/// A campus 450 m wide; the drive is between one and two kilometres long.
pub(super) fn campus(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 17);
    let site = campus_of_size(&mut plan, [6, 5], 84.0);
    let length_m = plan.random().random_range(1100.0..1700.0);
    let route = site.walk(plan.random(), length_m);
    plan.drive_to(&route);
    plan
}

/// The robot that drives through a named world, where it has one of its own.
pub(super) fn robot_of(name: &str) -> Option<SimulationConfig> {
    let robot = |x_m: f64, sweep_duration_s: f64| RobotConfig {
        name: "simulated".to_owned(),
        lidar: LidarConfig {
            mount: Mount { x_m, z_m: 0.3, ..Mount::default() },
            sweep_duration_s,
            stamp_at: StampAt::Middle,
        },
        ..RobotConfig::default()
    };
    let without_camera = |mut config: SimulationConfig| {
        config.camera.rate_hz = 0.0;
        config.imu = ImuSimulationConfig { is_there: false, ..ImuSimulationConfig::default() };
        config
    };
    if name == "campus" {
        let profile = PROFILES.iter().find(|profile| profile.name == "lms291")?;
        let (lidar, sweep_s) = profile.simulation(1.4);
        let at_s = 250.0;
        return Some(without_camera(SimulationConfig {
            robot: robot(0.1, sweep_s),
            motion: MotionConfig { speed_m_s: 1.4, pauses_s: vec![[at_s, PAUSE_S]], ..MotionConfig::default() },
            lidar: LidarSimulationConfig { dropout_share: 0.02, mixed_pixel_share: 0.2, ..lidar },
            pose_odometry: Some(PoseOdometryConfig { drift_rad_per_m: 0.003, ..PoseOdometryConfig::default() }),
            // A log of who records only while driving: the pause, and a little of the way to it, is not in it.
            faults: vec![Fault::LidarDropout { from_s: at_s - 1.0, for_s: PAUSE_S }],
            ..SimulationConfig::default()
        }));
    }
    // The TurtleBot 4 of the reports: 640 rays, 62 Hz, 0.164 to 12 m.
    maneuvers().any(|maneuver| maneuver == name).then(|| {
        without_camera(SimulationConfig {
            robot: robot(-0.04, 0.0),
            motion: MotionConfig { turn_rate_rad_s: 1.9, standstill_s: 2.0, ..MotionConfig::default() },
            lidar: LidarSimulationConfig {
                beams: 640,
                field_of_view_rad: std::f64::consts::TAU * 639.0 / 640.0,
                rate_hz: 62.0,
                range_min_m: 0.164,
                range_max_m: 12.0,
                near_noise_m: 0.01,
                far_noise_m: 0.01,
                ..LidarSimulationConfig::default()
            },
            pose_odometry: Some(PoseOdometryConfig { rate_hz: 62.0, ..PoseOdometryConfig::default() }),
            ..SimulationConfig::default()
        })
    })
}
