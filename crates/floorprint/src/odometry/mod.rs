//! From encoders, gyro and raw scans to frames.
//!
//! [`DeadReckoning`] is made once, over the whole drive, as a function of time; [`Frames`]
//! reads it at the scans' stamps, and [`Trajectory`] carries estimated poses along it to any
//! other time, such as an image's.

mod config;
mod dead_reckoning;
mod deskew;
mod differential_drive;
mod encoder_clock;
mod gyro_bias;
mod gyro_heading;
mod low_pass;
mod readings;
mod scan_projection;
mod summary;
mod synchronizer;
mod track_width;
mod trajectory;
mod wheel_odometry;

pub use config::{GyroBias, NoReturn, OdometryConfig, OdometrySource, ScanConfig};
pub use dead_reckoning::DeadReckoning;
pub use summary::{Dropped, SynchronisationSummary};
pub use synchronizer::{Frames, OdometryError};
pub use trajectory::Trajectory;

/// The middle value (the upper one of two), found by reordering; `None` of nothing.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
