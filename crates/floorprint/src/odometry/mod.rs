//! From encoders, gyro and raw scans to frames.
//!
//! [`Synchronizer`] takes records one by one and gives frames, with dead reckoning as it is known then; it keeps a
//! window of it as a function of time. [`Trajectory`] carries estimated poses along dead reckoning to any other time,
//! such as an image's. What a look at a whole recording adds is [`OdometryCorrections`].

mod config;
mod corrections;
mod dead_reckoning;
pub(crate) mod deskew;
pub(crate) mod differential_drive;
pub(crate) mod encoder_clock;
mod error;
mod finding;
pub(crate) mod gyro;
pub(crate) mod gyro_bias;
mod low_pass;
mod range_noise;
pub(crate) mod scan_projection;
mod scan_queue;
mod stamp_filter;
mod stated_odometry;
mod summary;
mod synchronizer;
pub(crate) mod track_width;
mod trajectory;
mod wheel_odometry;

pub use config::{GyroBias, NoReturn, OdometryConfig, OdometrySource, ScanConfig};
pub use corrections::{BiasCurve, EncoderClockCorrection, OdometryCorrections};
pub use dead_reckoning::DeadReckoning;
pub use error::OdometryError;
pub use finding::Finding;
pub use summary::{Dropped, SynchronisationSummary};
pub use synchronizer::Synchronizer;
pub use trajectory::Trajectory;

pub(crate) use scan_queue::is_complete;
pub(crate) use stamp_filter::{LEAP_S, confirms};
pub(crate) use synchronizer::validate;

/// The middle value (the upper one of two), found by reordering; `None` of nothing.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
