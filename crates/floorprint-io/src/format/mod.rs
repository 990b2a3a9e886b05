//! The formats of data sets: one file each, recognised by content.

mod carmen;
mod ece276a;
mod encoder_log;
mod ros;
mod text;

use crate::data_set::{DataSet, DriveEntry, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::source::{FolderSource, Source, folder_names};

pub use ros::{Decision, DeserializeRequest, MessageStream, pose_of, text_of, truth_of};
pub(crate) use ros::{RecordedImages, begins_like_recording};

/// All formats, in the order in which they are tried.
const FORMATS: [Format; 5] = [ros::FORMAT, ece276a::FORMAT, carmen::FORMAT, text::FORMAT, encoder_log::FORMAT];

/// Endings of the names of logs and recordings, packed or not.
const ENDINGS: [&str; 8] = [".bag", ".mcap", ".db3", ".clf", ".log", ".dat", ".csv", ".zip"];

/// A way in which data sets are stored.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Its short name.
    pub name: &'static str,
    /// What it is, in a few words.
    pub description: &'static str,
    /// Where its scans are.
    pub scans: &'static str,
    /// Whether it has topics to choose from.
    pub(crate) has_topics: bool,
    recognises: fn(&Source) -> bool,
    read: fn(&Source, &OpenOptions) -> Result<DataSet, ReadError>,
}

impl Format {
    /// Reads a data set of this format.
    pub(crate) fn read(&self, source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
        (self.read)(source, options)
    }
}

/// The drives in a folder: those of the course's layout; else the logs and recordings in a folder that is none itself.
pub(crate) fn drives(source: &Source) -> Vec<DriveEntry> {
    let Source::Folder(folder) = source else { return Vec::new() };
    let of_course = ece276a::drive_entries(folder);
    if !of_course.is_empty() || FORMATS.iter().any(|format| (format.recognises)(source)) {
        return of_course;
    }
    let recording = |name: &String| {
        let path = folder.path.join(name);
        let lower = name.to_ascii_lowercase();
        let lower = [".gz", ".zstd"].iter().find_map(|packed| lower.strip_suffix(packed)).unwrap_or(&lower);
        let is_folder = path.is_dir()
            && folder_names(&path).is_ok_and(|names| {
                let below = Source::Folder(FolderSource { path: path.clone(), names });
                FORMATS.iter().any(|format| (format.recognises)(&below))
            });
        let is_file = path.is_file() && ENDINGS.iter().any(|ending| lower.ends_with(ending));
        let bytes = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
        let holds = if is_folder { "a folder".to_owned() } else { format!("{:.1} MB", bytes as f64 / 1e6) };
        (is_folder || is_file).then_some(DriveEntry { path, drive: None, holds })
    };
    folder.names.iter().filter_map(recording).collect()
}

/// The format in which `source` is stored.
pub(crate) fn recognise(source: &Source) -> Result<&'static Format, ReadError> {
    FORMATS.iter().find(|format| (format.recognises)(source)).ok_or_else(|| {
        let known: Vec<&str> = FORMATS.iter().map(|format| format.description).collect();
        let problem = match source {
            Source::File(file) => file.unknown(),
            Source::Folder(folder) => match drives(source).as_slice() {
                [] if folder.names.is_empty() => Problem::new(&folder.path, "the folder is empty"),
                [] => Problem::new(&folder.path, "its content is of no known format"),
                [first, ..] => {
                    let found = "a folder of recordings, not a recording";
                    let advice = format!("Name one of them, as {}; `floorprint info` lists them", first.arguments());
                    Problem::new(&folder.path, found).expected("a single one").advice(advice)
                }
            },
        };
        let says_more = !problem.expected.is_empty();
        if says_more { problem.into() } else { problem.expected(format!("one of: {}", known.join("; "))).into() }
    })
}
