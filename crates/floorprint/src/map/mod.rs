//! Occupancy grids and the fields that scans are matched against.

mod cell;
mod config;
mod hit_grid;
mod horizon;
mod near_cells;
mod occupancy_grid;
mod proximity_field;
mod raster;
mod ray;
mod surface_map;
mod tile_grid;

pub use cell::Cell;
pub use config::MapConfig;
pub use hit_grid::HitGrid;
pub use horizon::Horizon;
pub use occupancy_grid::{Flip, OccupancyGrid};
pub use proximity_field::ProximityField;
pub use raster::{Occupancy, Raster};
pub use ray::passed_cells;
pub use surface_map::{Surface, SurfaceMap, proximity_of};
