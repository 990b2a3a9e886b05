//! `[odometry]` and `[scan]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[odometry]`: how dead reckoning is made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OdometryConfig {
    /// Where the motion between scans comes from.
    pub source: OdometrySource,
    /// How the gyro's bias is found.
    pub gyro_bias: GyroBias,
    /// Cut-off of a low-pass on the yaw rate, Hz; 0 switches it off.
    #[schemars(range(min = 0.0))]
    pub gyro_low_pass_hz: f64,
    /// Whether encoder stamps that are late are moved back to when the ticks must have been counted.
    pub repair_encoder_stamps: bool,
    /// How long a scan waits for the odometry to pass it, and how late records may come, in the data's own time, seconds.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub delay_s: f64,
    /// Whether a recorded drive is looked through beforehand for the gyro's bias, the encoders' clock and the track
    /// width; without it they are learnt on the way, as on a live robot.
    pub survey: bool,
    /// Whether the survey also learns how late the odometry's stamps are beside the LiDAR's, where `robot.lag` does not
    /// say.
    pub learn_lag: bool,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        Self {
            source: OdometrySource::Auto,
            gyro_bias: GyroBias::StandstillWithDrift,
            gyro_low_pass_hz: 0.0,
            repair_encoder_stamps: true,
            delay_s: 0.3,
            survey: true,
            learn_lag: true,
        }
    }
}

/// Where the motion between scans comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OdometrySource {
    /// The best that the data hold: the log's own poses, if they ever move, else wheels and gyro, else wheels, else scan
    /// matching.
    #[default]
    Auto,
    /// Distance and yaw from the wheels.
    Wheels,
    /// Distance from the wheels, yaw from the gyro (report eqs. 14–19).
    WheelsAndGyro,
    /// The poses that the log itself states.
    Log,
    /// None: the scan matcher predicts from the last motion.
    ScanMatching,
}

/// How the gyro's bias is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GyroBias {
    /// No bias is taken off.
    None,
    /// One bias: the mean over all standstill.
    Standstill,
    /// The mean of each standstill, interpolated in between where the data show a drift.
    #[default]
    StandstillWithDrift,
}

/// `[scan]`: from raw scans to points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScanConfig {
    /// Returns nearer than this are not used, metres.
    #[schemars(range(min = 0.0))]
    pub range_min_m: f64,
    /// Returns farther than this are not used, metres.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1000.0))]
    pub range_max_m: f64,
    /// What a ray without a return means.
    pub no_return: NoReturn,
    /// Up to where a ray without a return clears the map when `no_return = "clear"`, metres.
    #[schemars(range(min = 0.0))]
    pub no_return_clear_m: f64,
    /// Whether points are moved to where they would have been seen at the scan's stamp: by odometry, and where there is none
    /// by how the scans before show that the robot moves (not in the filters `shared_map` and `grisetti2007`).
    pub deskew: bool,
    /// Use one frame in this many.
    #[schemars(range(min = 1))]
    pub every: usize,
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self {
            range_min_m: 0.1,
            range_max_m: 60.0,
            no_return: NoReturn::Ignore,
            no_return_clear_m: 5.0,
            deskew: true,
            every: 1,
        }
    }
}

/// What a ray without a return means for the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoReturn {
    /// Nothing.
    #[default]
    Ignore,
    /// The ray is free up to `no_return_clear_m`.
    Clear,
}
