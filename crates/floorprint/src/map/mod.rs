//! Occupancy grids drawn by scans.

mod cell;
mod config;
mod difference;
mod hit_grid;
mod occupancy_grid;
mod open_tiles;
mod raster;
mod ray;
pub(crate) mod tile_grid;
mod tile_rectangle;

pub use cell::Cell;
pub use config::MapConfig;
pub use difference::{Change, ChangedPatch, difference};
pub use hit_grid::HitGrid;
pub use occupancy_grid::{Flip, OccupancyGrid};
pub(crate) use open_tiles::OpenTiles;
pub use raster::{Occupancy, Raster};
pub use ray::passed_cells;
pub use tile_grid::{TILE_CELLS, TILE_SIDE};
pub use tile_rectangle::TileRectangle;
