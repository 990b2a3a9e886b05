//! Poses, angles and sensor mounts.

mod angle;
pub(crate) mod covariance;
mod polygon;
mod pose2;
mod pose3;

pub use angle::wrap_angle;
pub use polygon::{Polygon, PolygonError};
pub use pose2::Pose2;
pub use pose3::{Mount, Pose3};
