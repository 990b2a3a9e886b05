//! Finding the pose at which a scan fits a map.

mod config;
mod correlative;
mod gauss_newton;
mod locate;
mod surface_scan;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;

pub use config::MatcherConfig;
pub use correlative::{SearchWindow, search};
pub use gauss_newton::{MatchResult, PoseBelief, match_scan};
pub use locate::{OdometryVerdict, locate};
pub use surface_scan::SurfaceScan;
