//! Messages of ROS 2 to others: what is recorded, and what is sent to whoever speaks ROS.

mod cdr_writer;
pub(crate) mod live_messages;
mod messages;
mod recorder;
mod schemas;

pub use crate::format::{Decision, DeserializeRequest, MessageStream, pose_of, text_of, truth_of};
pub use messages::{
    Diagnostics, Header, Imu, LaserScan, MapMetaData, Message, OccupancyGrid, OccupancyGridUpdate, Odometry,
    ParticleCloud, PoseWithCovariance, SpacePose, Text, Transform, Transforms, nanoseconds, seconds_and_nanoseconds,
};
pub use recorder::{LiveSession, Recorder, active_path, lidar_frame};
