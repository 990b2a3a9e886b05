//! Occupancy grids and the fields that scans are matched against.

mod config;

pub use config::MapConfig;
