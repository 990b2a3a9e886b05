//! Finding the pose at which a scan fits a map.

mod config;
mod gauss_newton;
mod surface_scan;

pub use config::MatcherConfig;
pub use gauss_newton::{MatchResult, PoseBelief, match_scan};
pub use surface_scan::SurfaceScan;
