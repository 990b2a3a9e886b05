//! What a node is called, and what it listens to and speaks on.

use std::path::PathBuf;
use std::time::Duration;

/// Names of topics and frames; those of slam_toolbox and AMCL where they mean the same.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// The network's number (`ROS_DOMAIN_ID`).
    pub domain: u16,
    /// Namespace of the node, with a leading slash.
    pub namespace: String,
    /// The node's name.
    pub name: String,
    /// Topics of scans.
    pub scan_topics: Vec<String>,
    /// Topic of the odometry.
    pub odom_topic: String,
    /// Topic of the IMU.
    pub imu_topic: String,
    /// Topic of the map.
    pub map_topic: String,
    /// Frame of the map.
    pub map_frame: String,
    /// Frame of the odometry.
    pub odom_frame: String,
    /// By how much map→odom is stamped into the future, so that others need not wait for the next one.
    pub transform_timeout: Duration,
    /// Shortest time between two whole maps.
    pub map_update_interval: Duration,
    /// Where maps are saved that a service asks for.
    pub save_to: PathBuf,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            domain: 0,
            namespace: "/".to_owned(),
            name: "floorprint".to_owned(),
            scan_topics: vec!["/scan".to_owned()],
            odom_topic: "/odom".to_owned(),
            imu_topic: "/imu".to_owned(),
            map_topic: "/map".to_owned(),
            map_frame: "map".to_owned(),
            odom_frame: "odom".to_owned(),
            transform_timeout: Duration::from_millis(200),
            map_update_interval: Duration::from_secs(5),
            save_to: PathBuf::from("."),
        }
    }
}

impl Options {
    /// A topic's full name: relative ones lie in the namespace.
    #[must_use]
    pub fn full_name(&self, topic: &str) -> String {
        match topic.strip_prefix('/') {
            Some(_) => topic.to_owned(),
            None => format!("{}/{topic}", self.namespace.trim_end_matches('/')),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_names_lie_in_the_namespace() {
        let mut options = Options::default();
        assert_eq!([options.full_name("scan"), options.full_name("/scan")], ["/scan", "/scan"]);
        options.namespace = "/robot1".to_owned();
        assert_eq!([options.full_name("scan"), options.full_name("/tf")], ["/robot1/scan", "/tf"]);
    }
}
