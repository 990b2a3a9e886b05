//! Readers and writers: everything of Floorprint that touches files.

pub mod calibration;
mod data_set;
mod error;
mod format;
mod images;
mod lines;
mod npy;
mod npz;
mod number;
mod picture;
mod relations;
mod replace;
mod source;
mod stamps;
mod trajectory;

pub use data_set::{DataSet, DropCounts, DropReason, OpenOptions, open};
pub use error::{Problem, ReadError, WriteError};
pub use format::Format;
pub use images::{ImageEntry, ImageIndex};
pub use picture::{Picture, Pixels, read_png, write_animated_png, write_png};
pub use relations::read_relations;
pub use trajectory::{read_trajectory, write_trajectory};
