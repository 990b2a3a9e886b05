//! From encoders, gyro and raw scans to frames.

mod config;
mod dead_reckoning;
mod deskew;
mod differential_drive;
mod gyro_bias;
mod gyro_heading;
mod readings;
mod scan_projection;
mod summary;
mod synchronizer;
mod trajectory;
mod wheel_odometry;

pub use config::{GyroBias, NoReturn, OdometryConfig, OdometrySource, ScanConfig};
pub use dead_reckoning::DeadReckoning;
pub use summary::{Dropped, SynchronisationSummary};
pub use synchronizer::{Frames, OdometryError};
pub use trajectory::Trajectory;
