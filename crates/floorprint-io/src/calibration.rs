//! The named calibrations of the robots whose data sets are read.

use floorprint::sensors::RobotConfig;

/// A robot of which nothing is known but its log: the LiDAR sits at the body's origin and
/// looks ahead unless the log says otherwise, and there are no wheels.
pub(crate) fn carmen() -> RobotConfig {
    RobotConfig { name: "carmen".to_owned(), ..RobotConfig::default() }
}
