//! Readers and writers: everything of Floorprint that touches files.

mod annotations;
mod budget;
pub mod calibration;
mod data_set;
mod ece276a_writer;
mod error;
mod exchange;
mod file_lock;
mod floor_file;
mod format;
pub mod foxglove;
mod g2o;
mod geotiff;
mod images;
mod lines;
mod map_file;
mod mcap_writer;
mod npy;
mod npz;
mod npz_writer;
mod number;
mod pgm;
mod picture;
mod regular_file;
mod relations;
mod replace;
pub mod ros;
mod run_folder;
mod scratch_file;
mod scratch_folder;
mod session_file;
mod source;
mod stamps;
mod trajectory;
mod unpack;

pub use annotations::{AnnotationError, Annotations, NamedPlace};
pub use budget::USUAL_EXPANSION;
pub use data_set::{
    BagContents, DataSet, DriveEntry, DropCounts, DropReason, OpenOptions, RecordedTruth, RoleChoice, TopicChoice,
    TopicSummary, drives, lone_recording, open, open_log,
};
pub use ece276a_writer::write_ece276a;
pub use error::{Problem, ReadError, WriteError};
pub use file_lock::FileLock;
pub use floor_file::{floor_picture, read_floor, write_floor};
pub use format::Format;
pub use g2o::{G2o, read_g2o, write_g2o};
pub use geotiff::{write_floor_geotiff, write_map_geotiff};
pub use images::{ImageEntry, ImageIndex, LoadedPair};
pub use map_file::{map_bytes, parse_map, read_map, write_map, write_raw_map, write_scaled_map};
pub use mcap_writer::{McapWriter, write_mcap};
pub use picture::{Picture, Pixels, png_bytes, read_png, write_animated_png, write_png};
pub use regular_file::read_text;
pub use relations::read_relations;
pub use replace::{copy_file, write_file, write_files};
pub use run_folder::{Contents, RESULTS_OF_RUN, RunFolder, free_beside};
pub use scratch_file::ScratchFile;
pub use scratch_folder::remove_unpacked;
pub use session_file::{ANNOTATIONS, Layers, SessionFile};
pub use trajectory::{read_trajectory, write_kitti, write_trajectory};
