//! Readers and writers: everything of Floorprint that touches files.

pub mod calibration;
mod data_set;
mod ece276a_writer;
mod error;
mod floor_file;
mod format;
mod g2o;
mod images;
mod lines;
mod map_file;
mod no_return;
mod npy;
mod npz;
mod npz_writer;
mod number;
mod pgm;
mod picture;
mod relations;
mod replace;
mod run_folder;
mod source;
mod stamps;
mod trajectory;

pub use data_set::{
    BagContents, DataSet, DropCounts, DropReason, OpenOptions, RecordedTruth, RoleChoice, TopicChoice, TopicSummary,
    open,
};
pub use ece276a_writer::write_ece276a;
pub use error::{Problem, ReadError, WriteError};
pub use floor_file::{read_floor, write_floor};
pub use format::Format;
pub use g2o::{G2o, read_g2o, write_g2o};
pub use images::{ImageEntry, ImageIndex};
pub use map_file::{read_map, write_map};
pub use picture::{Picture, Pixels, read_png, write_animated_png, write_png};
pub use relations::read_relations;
pub use replace::write_file;
pub use run_folder::{Contents, RunFolder};
pub use trajectory::{read_trajectory, write_trajectory};
