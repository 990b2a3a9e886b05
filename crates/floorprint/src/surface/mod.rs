//! Surfaces: what scans show, kept finely enough to be matched against.

mod horizon;
mod near_cells;
pub(crate) mod packing;
mod proximity_field;
mod surface_map;
mod surface_scan;

pub use horizon::Horizon;
pub use proximity_field::ProximityField;
pub use surface_map::{Surface, SurfaceFinder, SurfaceMap, proximity_of};
pub use surface_scan::{SurfaceScan, Thinning};
