//! The formats of data sets: one file each, recognised by content.

mod carmen;
mod ece276a;
mod encoder_log;
mod ros;

use crate::data_set::{DataSet, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::source::Source;

pub use ros::{Decision, MessageStream, pose_of};
pub(crate) use ros::{RecordedImages, begins_like_recording};

/// All formats, in the order in which they are tried.
const FORMATS: [Format; 4] = [ros::FORMAT, ece276a::FORMAT, carmen::FORMAT, encoder_log::FORMAT];

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

/// The format in which `source` is stored.
pub(crate) fn recognise(source: &Source) -> Result<&'static Format, ReadError> {
    FORMATS.iter().find(|format| (format.recognises)(source)).ok_or_else(|| {
        let known: Vec<&str> = FORMATS.iter().map(|format| format.description).collect();
        let problem = match source {
            Source::File(file) => file.unknown(),
            Source::Folder(folder) => Problem::new(&folder.path, "its content is of no known format"),
        };
        let says_more = !problem.expected.is_empty();
        if says_more { problem.into() } else { problem.expected(format!("one of: {}", known.join("; "))).into() }
    })
}
