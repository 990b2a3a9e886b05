//! The calibration of the course's robot (ECE276A, and the simulator's default).

use super::{CameraConfig, LidarConfig, RobotConfig, StampAt, WheelConfig};
use crate::geometry::Mount;

impl RobotConfig {
    /// The skid-steered robot of the course ECE276A: a Hokuyo UTM-30LX, four wheels with
    /// encoders and a Kinect.
    ///
    /// The LiDAR is 0.298 m ahead of the rear axle on the drawing, which is 0.133 m ahead of
    /// the centre between the axles. The heights are above the floor: the axles are 0.127 m high.
    #[must_use]
    pub fn ece276a() -> Self {
        Self {
            name: "ece276a".to_owned(),
            lidar: LidarConfig {
                mount: Mount { x_m: 0.13323, z_m: 0.64135, ..Mount::default() },
                // A turn takes 25 ms, of which the field of view is three quarters.
                sweep_duration_s: 0.01875,
                stamp_at: StampAt::Middle,
            },
            wheels: Some(WheelConfig { left_m_per_tick: 0.0022, right_m_per_tick: 0.0022, track_width_m: 0.75 }),
            camera: Some(CameraConfig {
                mount: Mount { x_m: 0.18, y_m: 0.005, z_m: 0.487, roll_rad: 0.0, pitch_rad: 0.36, yaw_rad: 0.021 },
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
}
