//! Finding the pose at which a scan fits a map.

mod branch_and_bound;
mod config;
mod correlative;
mod gauss_newton;
mod locate;
mod pooled_grid;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;

pub use branch_and_bound::{Place, PlaceQuery, PlaceSearch};
pub use config::MatcherConfig;
pub use correlative::{SearchWindow, search};
pub use gauss_newton::{
    MatchResult, OUTLIER_LOG_LIKELIHOOD, PoseBelief, inlier_share, match_scan, outliers, without_hearsay,
};
pub use locate::{Expectation, Location, OdometryVerdict, locate};
pub(crate) use locate::{POINTS_TO_SEARCH, follow};

pub(crate) use pooled_grid::Grid;
