//! The calibration of the course's robot (ECE276A, and the simulator's default).

use super::{CameraConfig, LidarConfig, RobotConfig, StampAt, WheelConfig};
use crate::geometry::Mount;

impl RobotConfig {
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
    pub fn ece276a() -> Self {
        const AXLE_HEIGHT_M: f64 = 0.127;
        Self {
            name: "ece276a".to_owned(),
            lidar: LidarConfig {
                mount: Mount { x_m: 0.13323, z_m: 0.51435 + AXLE_HEIGHT_M, ..Mount::default() },
                sweep_duration_s: 0.01875,
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
            ..Self::default()
        }
    }
}
