//! From encoders, gyro and raw scans to frames.

mod config;

pub use config::{GyroBias, NoReturn, OdometryConfig, OdometrySource, ScanConfig};
