//! Messages in Foxglove's own schemas, in protobuf: what is shown live and what `run --mcap` writes.
//!
//! `messages` are the messages, `protobuf_writer` puts them into bytes, `descriptor` says to whoever decodes them what is in
//! them. Poses with a covariance have no schema among them: those are `geometry_msgs/PoseWithCovarianceStamped` of ROS 2,
//! which Foxglove draws as well.

mod descriptor;
mod messages;
mod protobuf_writer;

pub use messages::{
    CompressedImage, FrameTransform, FrameTransforms, Grid, Line, LineKind, PointCloud, PosesInFrame, SceneUpdate,
    floor_grid, map_grid,
};

use crate::ros;

/// A message in one of Foxglove's schemas.
pub trait Message {
    /// Name of its type: `foxglove.Type`.
    const TYPE: &'static str;

    /// Its bytes in protobuf.
    fn to_protobuf(&self) -> Vec<u8>;
}

/// What messages of a channel are, and how they are encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// Name of the type.
    pub name: &'static str,
    /// How messages are encoded: `protobuf` or `cdr`.
    pub message_encoding: &'static str,
    /// How the type is described: `protobuf` or `ros2msg`.
    pub encoding: &'static str,
    /// The description: a `FileDescriptorSet`, or the text of a message's definition.
    pub description: Vec<u8>,
}

impl Schema {
    /// That of a message of Foxglove's.
    #[must_use]
    pub fn of_foxglove<M: Message>() -> Self {
        let description = descriptor::file_descriptor_set(M::TYPE);
        Self { name: M::TYPE, message_encoding: "protobuf", encoding: "protobuf", description }
    }

    /// That of a message of ROS 2.
    #[must_use]
    pub fn of_ros<M: ros::Message>() -> Self {
        let description = M::SCHEMA.as_bytes().to_vec();
        Self { name: M::TYPE, message_encoding: "cdr", encoding: "ros2msg", description }
    }
}
