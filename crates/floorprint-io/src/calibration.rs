//! The calibrations of the robots whose logs are read; see also [`RobotConfig::ece276a`].
//!
//! They are starting points: every value can be overridden in the configuration.

use floorprint::geometry::Mount;
use floorprint::sensors::{LidarConfig, RobotConfig, StampAt, WheelConfig};
use std::f64::consts::TAU;

/// The École des Mines' robot: two wheels of 77 mm radius with 2000 counts a turn, 165 mm from
/// the middle of the axle; a Hokuyo URG-04LX 145 mm ahead of the axle, ten turns a second.
///
/// The body's origin is the middle of the axle. The height of the LiDAR is not stated, and
/// which moment of the sweep a stamp names is not stated either: the middle is assumed.
#[must_use]
pub fn encoder_log() -> RobotConfig {
    const TURN_S: f64 = 0.1;
    const WHEEL_M_PER_TICK: f64 = TAU * 0.077 / 2000.0;
    RobotConfig {
        name: "encoder_log".to_owned(),
        lidar: LidarConfig {
            mount: Mount { x_m: 0.145, ..Mount::default() },
            sweep_duration_s: TURN_S * 681.0 / 1024.0,
            stamp_at: StampAt::Middle,
        },
        wheels: Some(WheelConfig {
            left_m_per_tick: WHEEL_M_PER_TICK,
            right_m_per_tick: WHEEL_M_PER_TICK,
            track_width_m: 2.0 * 0.165,
        }),
        ..RobotConfig::default()
    }
}

/// A robot of which nothing is known but its log: the LiDAR sits at the body's origin and
/// looks ahead unless the log says otherwise, and there are no wheels.
#[must_use]
pub fn carmen() -> RobotConfig {
    RobotConfig { name: "carmen".to_owned(), ..RobotConfig::default() }
}
