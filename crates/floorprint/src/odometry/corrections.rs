//! What a survey of the whole drive hands to the synchroniser: plain numbers in place of what it would learn itself.

use super::config::OdometrySource;
use crate::sensors::LagConfig;
use serde::{Deserialize, Serialize};

/// Corrections of the odometry's sensors that are known beforehand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OdometryCorrections {
    /// Where the motion comes from; never `Auto`.
    pub source: OdometrySource,
    /// How long scans wait for the odometry and how late records may come, seconds; see
    /// [`OdometryConfig::delay_s`](super::OdometryConfig).
    pub delay_s: f64,
    /// The encoders' clock; `None` when their stamps are right.
    pub encoder_clock: Option<EncoderClockCorrection>,
    /// The gyro's bias over time.
    pub gyro_bias: BiasCurve,
    /// The track width at which the wheels' yaw fits the gyro's, metres; `None` when the drive does not show it.
    pub track_width_m: Option<f64>,
    /// How late the sensors' stamps are beside the LiDAR's.
    #[serde(default)]
    pub lag: LagConfig,
}

/// The clock by which the encoders count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncoderClockCorrection {
    /// Its period, seconds.
    pub period_s: f64,
    /// Stamps of the readings before which the encoders really paused, seconds, ascending: these are not late.
    pub pauses_s: Vec<f64>,
}

/// The yaw rate that a gyro reports at rest, over time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct BiasCurve {
    /// Stamps (seconds, ascending) and biases (rad/s); without any the bias is 0.
    pub knots: Vec<(f64, f64)>,
}

impl BiasCurve {
    /// The bias at a time (seconds), rad/s: linear between the knots, constant outside.
    #[must_use]
    pub fn at(&self, stamp_s: f64) -> f64 {
        let next = self.knots.partition_point(|&(knot_s, _)| knot_s <= stamp_s);
        match (next.checked_sub(1).map(|index| self.knots[index]), self.knots.get(next)) {
            (Some((from_s, from)), Some(&(to_s, to))) => from + (to - from) * (stamp_s - from_s) / (to_s - from_s),
            (Some((_, bias)), None) | (None, Some(&(_, bias))) => bias,
            (None, None) => 0.0,
        }
    }
}
