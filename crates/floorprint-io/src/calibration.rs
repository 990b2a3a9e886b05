//! The named calibrations of the robots whose data sets are read.
//!
//! They are starting points: every value can be overridden in the configuration.

use floorprint::geometry::Mount;
use floorprint::sensors::{CameraConfig, LidarConfig, RobotConfig, StampAt, WheelConfig};
use std::f64::consts::TAU;

/// The skid-steered robot of the course ECE276A (sets 20 to 23).
///
/// * LiDAR UTM-30LX, 0.51435 m above the axles and 0.29833 m ahead of the rear one, which
///   is 0.13323 m ahead of the centre between the axles; 40 turns a second, 270° of each
///   swept in 0.75 · 25 ms, stamped in the middle.
/// * Wheels of 0.254 m diameter with 360 counts a turn: 0.0022 m a tick. The track width is
///   the one that skid steering makes effective, not the mechanical one.
/// * Kinect 0.18 m ahead of the centre and 0.36 m above the axles (0.127 m), pitched down by
///   0.36 rad; disparity and colour as in the report's eqs. 23–28, with column and row put
///   right: the disparity shifts the *column* of the colour pixel.
#[must_use]
pub fn ece276a() -> RobotConfig {
    const AXLE_HEIGHT_M: f64 = 0.127;
    RobotConfig {
        name: "ece276a".to_owned(),
        lidar: LidarConfig {
            mount: Mount { x_m: 0.13323, z_m: 0.51435 + AXLE_HEIGHT_M, ..Mount::default() },
            sweep_duration_s: 0.75 * 0.025,
            stamp_at: StampAt::Middle,
        },
        wheels: Some(WheelConfig { left_m_per_tick: 0.0022, right_m_per_tick: 0.0022, track_width_m: 0.75 }),
        camera: Some(CameraConfig {
            mount: Mount {
                x_m: 0.18,
                y_m: 0.005,
                z_m: 0.36 + AXLE_HEIGHT_M,
                roll_rad: 0.0,
                pitch_rad: 0.36,
                yaw_rad: 0.021,
            },
            depth_focal_px: 585.051_082_11,
            depth_center_column_px: 315.838_001_93,
            depth_center_row_px: 242.941_407_13,
            disparity_scale: -0.00304,
            disparity_offset: 3.31,
            depth_numerator_m: 1.03,
            color_focal: 526.37,
            color_baseline: -4.5 * 1750.46,
            color_column_offset: 19276.0,
            color_row_offset: 16662.0,
            color_divisor: 585.051,
            depth_min_m: 0.5,
            depth_max_m: 4.0,
        }),
    }
}

/// [`ece276a`] with the LiDAR where the report puts it (eq. 10): 0.150915 m ahead of the centre.
#[must_use]
pub fn ece276a_report() -> RobotConfig {
    let mut robot = ece276a();
    robot.name = "ece276a_report".to_owned();
    robot.lidar.mount.x_m = 0.150_915;
    robot
}

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
        camera: None,
    }
}

/// A robot of which nothing is known but its log: the LiDAR sits at the body's origin and
/// looks ahead unless the log says otherwise, and there are no wheels.
#[must_use]
pub fn carmen() -> RobotConfig {
    RobotConfig { name: "carmen".to_owned(), ..RobotConfig::default() }
}
