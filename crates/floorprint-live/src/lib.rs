//! Floorprint on a robot: records as they come, poses and a map at once, and a page to watch it.
//!
//! Sources put records into an [`Inbox`]; one thread takes them out and pushes them through an [`Engine`], which is the same
//! synchroniser and the same SLAM as those of recorded drives; what comes of it is shown on a [`Board`], at which any number
//! of viewers look, each at its own pace.

mod board;
mod bucket;
mod connections;
mod delays;
mod engine;
#[cfg(feature = "foxglove")]
mod foxglove;
mod frame_names;
mod guard;
#[cfg(any(feature = "foxglove", feature = "ros2"))]
mod health;
mod http;
mod inbox;
mod json_lines;
mod map_picture;
mod playback;
#[cfg(feature = "ros2")]
pub mod ros2;
mod sensor_clock;

pub use board::{Board, Counts, Line, Mode, Overlay, Picture, Situation};
pub use delays::{DelaySummary, Delays};
pub use engine::{Engine, EngineError, Step, Whereabouts, resume};
#[cfg(feature = "foxglove")]
pub use foxglove::FoxgloveServer;
pub use frame_names::FrameNames;
pub use guard::{AccessError, Token};
pub use http::{Server, ServerError};
pub use inbox::{Change, Event, Inbox, Lost, Refusal};
pub use json_lines::JsonLines;
pub use map_picture::{LEVELS, MapPicture, PICTURE_SIDE, Place};
pub use playback::play;
pub use sensor_clock::{STEP_BACK_S, SensorClock};
