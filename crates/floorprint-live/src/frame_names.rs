//! What frames are called, and where the LiDARs sit: a tree of transforms for those who draw it.

use floorprint::geometry::Mount;
use floorprint::sensors::RobotConfig;
use floorprint_io::ros::lidar_frame;

/// What the frames are called.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameNames {
    /// The map.
    pub map: String,
    /// Where the odometry began.
    pub odom: String,
    /// The robot's body.
    pub base: String,
    /// The LiDARs, and where each sits.
    pub lidars: Vec<(String, Mount)>,
}

impl FrameNames {
    /// The usual names, those of REP 105, for a robot's LiDARs.
    #[must_use]
    pub fn of(robot: &RobotConfig) -> Self {
        let lidars = std::iter::once(&robot.lidar).chain(&robot.further_lidars).enumerate();
        Self {
            map: "map".to_owned(),
            odom: "odom".to_owned(),
            base: "base_link".to_owned(),
            lidars: lidars.map(|(sensor, lidar)| (lidar_frame(sensor), lidar.mount)).collect(),
        }
    }
}
