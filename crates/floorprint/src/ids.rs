//! What frames, submaps, constraints and sensors are called: numbers that cannot be taken for one another.

use serde::{Deserialize, Serialize};

/// Which sensor of its kind a record comes from, from 0: LiDAR 0 is `robot.lidar`, LiDAR k is `robot.further_lidars[k − 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct SensorId(pub u8);
