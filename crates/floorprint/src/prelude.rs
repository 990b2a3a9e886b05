//! The nouns that most programs need: `use floorprint::prelude::*;`.

pub use crate::config::{Config, Layer, Preset};
pub use crate::frame::Frame;
pub use crate::frames::Frames;
pub use crate::geometry::{Mount, Pose2};
pub use crate::map::{Occupancy, OccupancyGrid, Raster};
pub use crate::odometry::Synchronizer;
pub use crate::sensors::{EncoderReading, ImuReading, Record, RobotConfig, Scan, ScanGeometry, StampedPose};
pub use crate::session::Session;
pub use crate::slam::{Slam, SlamError, SlamResult, StepReport};
