//! Recordings of ROS and of what speaks like it: ROS 1 bags, rosbag2's folders and databases, MCAP files.
//!
//! `bag1`, `rosbag2` and `mcap` are the containers; all give one stream of raw messages, which `recording` puts
//! together from several files. `cursor` and `messages` take the messages apart, `foxglove` those in
//! Foxglove's schemas. A recording is read twice: `survey`
//! finds out what is there and how frames hang together (`transforms`), `roles` chooses what is used, and `record_maker`
//! makes records of it, while `camera`, `image` and `images` do the same for images, which a third pass reads when
//! the floor is painted; `stream` does the same with messages that come in live. `live` reads recordings of live sessions, which say all of that themselves.

mod bag;
mod bag1;
mod camera;
mod cursor;
mod foxglove;
mod image;
mod images;
mod input;
mod live;
mod mcap;
mod messages;
mod record_maker;
mod recording;
mod requests;
mod roles;
mod rosbag2;
mod slice;
mod stream;
mod survey;
mod transforms;
mod wheels;

use super::Format;

pub(crate) use images::RecordedImages;
pub(crate) use recording::begins_like_recording;
pub use requests::{DeserializeRequest, text_of, truth_of};
pub use stream::{Decision, MessageStream, pose_of};

pub(super) const FORMAT: Format = Format {
    name: "ros",
    description: "a ROS 1 bag, a rosbag2 folder, an MCAP file or a .db3 database",
    scans: "LaserScan, MultiEchoLaserScan or PointCloud2 messages",
    has_topics: true,
    recognises: recording::recognises,
    read: bag::read,
};

/// A stream of messages of one kind from one source.
#[derive(Clone)]
struct Channel {
    topic: String,
    type_name: String,
    encoding: Encoding,
}

/// How a message's fields became bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Encoding {
    Ros1,
    Cdr,
    Protobuf,
    Json,
    Other(String),
}

impl Encoding {
    /// By the name that MCAP and rosbag2 give it.
    fn named(name: &str) -> Self {
        match name {
            "ros1" => Self::Ros1,
            "cdr" => Self::Cdr,
            "protobuf" => Self::Protobuf,
            "json" => Self::Json,
            other => Self::Other(other.to_owned()),
        }
    }

    fn name(&self) -> &str {
        match self {
            Self::Ros1 => "ros1",
            Self::Cdr => "cdr",
            Self::Protobuf => "protobuf",
            Self::Json => "json",
            Self::Other(name) => name,
        }
    }
}

/// A message as it was recorded.
struct RawMessage<'a> {
    channel: &'a Channel,
    /// When it was recorded, seconds.
    log_time_s: f64,
    bytes: &'a [u8],
}

/// Messages in the order in which they were recorded.
trait MessageSource {
    /// Goes on to the next message; false when there is none.
    fn advance(&mut self) -> bool;

    /// The message to which [`advance`](Self::advance) led.
    fn message(&self) -> Option<RawMessage<'_>>;

    /// What was found damaged so far, in a sentence.
    fn damage(&self) -> Option<String>;
}
