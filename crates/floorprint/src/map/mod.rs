//! Occupancy grids and the fields that scans are matched against.

mod config;
mod raster;

pub use config::MapConfig;
pub use raster::{Occupancy, Raster};
