//! Readers and writers: everything of Floorprint that touches files.

mod calibration;
mod data_set;
mod error;
mod format;
mod lines;
mod number;
mod relations;
mod source;
mod trajectory;

pub use data_set::{DataSet, DropCounts, DropReason, OpenOptions, open};
pub use error::{Problem, ReadError, WriteError};
pub use format::Format;
pub use relations::read_relations;
pub use trajectory::{read_trajectory, write_trajectory};
