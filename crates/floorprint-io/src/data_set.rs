//! A recorded drive: the records of its sensors with the calibration of the robot.

use crate::budget::USUAL_EXPANSION;
use crate::error::{Problem, ReadError};
use crate::format::{self, Format};
use crate::images::ImageIndex;
use crate::ros::LiveSession;
use crate::source::{FileSource, InputHash, Source, is_archive};
use crate::unpack::{STANDARD_INPUT, Unpacked};
use floorprint::odometry::OdometryError;
use floorprint::sensors::{Record, RobotConfig, Scan, StampedPose};
use floorprint::{Config, Frames};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// What the user may choose when a data set is opened.
#[derive(Debug, Clone)]
pub struct OpenOptions {
    /// Number of the drive, for folders that hold several.
    pub drive: Option<u32>,
    /// How many times its size on disk a file may take in memory, besides 256 MB that any may take: a file
    /// that unpacks to more is refused.
    pub max_expansion: f64,
    /// Who plays which role in a recording of topics; what is not chosen is found out.
    pub topics: TopicChoice,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { drive: None, max_expansion: USUAL_EXPANSION, topics: TopicChoice::default() }
    }
}

/// Which topics and frames of a recording are used.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicChoice {
    /// Topics of the scans; several LiDARs are used together.
    pub scans: Vec<String>,
    /// Topic of the odometry; a topic of transforms stands for what moves in them.
    pub odometry: Option<String>,
    /// Topic of the true poses.
    pub truth: Option<String>,
    /// The frame that is taken for the robot's body.
    pub base: Option<String>,
    /// Topic of the colour images by which the floor is painted.
    pub color: Option<String>,
    /// Topic of the depth images that tell floor from what stands on it.
    pub depth: Option<String>,
}

impl TopicChoice {
    /// The option that is set, as the command line calls it.
    fn option(&self) -> Option<&'static str> {
        [
            (!self.scans.is_empty(), "--scan"),
            (self.odometry.is_some(), "--odom"),
            (self.truth.is_some(), "--truth"),
            (self.base.is_some(), "--base"),
            (self.color.is_some(), "--color"),
            (self.depth.is_some(), "--depth"),
        ]
        .into_iter()
        .find_map(|(is_set, option)| is_set.then_some(option))
    }
}

/// What is in a recording of topics, and what is used of it.
#[derive(Debug, Clone, Default)]
pub struct BagContents {
    /// All topics, by name.
    pub topics: Vec<TopicSummary>,
    /// What is used, what is not, and why.
    pub roles: Vec<RoleChoice>,
    /// True poses, where a topic holds some.
    pub truth: Option<RecordedTruth>,
}

impl BagContents {
    /// The topics in a line, with types and numbers of messages.
    #[must_use]
    pub fn list_of_topics(&self) -> String {
        let entry = |topic: &TopicSummary| {
            let unread = match topic.undecodable {
                0 => String::new(),
                unread => format!(", {unread} of which cannot be read"),
            };
            format!("{} ({}, {}{unread})", topic.name, topic.type_name, topic.messages)
        };
        self.topics.iter().map(entry).collect::<Vec<_>>().join(", ")
    }
}

/// What is on a topic.
#[derive(Debug, Clone, Serialize)]
pub struct TopicSummary {
    /// Its name.
    pub name: String,
    /// The type of its messages.
    pub type_name: String,
    /// How they became bytes: `ros1`, `cdr` …
    pub encoding: String,
    /// How many there are.
    pub messages: usize,
    /// How many of them are not what their type says, or say it in a way that is not read.
    pub undecodable: usize,
    /// How many were recorded a second.
    pub rate_hz: f64,
    /// Frames in which their numbers are or whose poses they state.
    pub frames: Vec<String>,
}

/// A topic or frame and the role that it plays.
#[derive(Debug, Clone, Serialize)]
pub struct RoleChoice {
    /// The role, or that there is none.
    pub role: &'static str,
    /// The topic or frame.
    pub what: String,
    /// Why, in words.
    pub reason: String,
}

/// Poses that were measured independently, in a frame of their own and of any part of the robot.
#[derive(Debug, Clone)]
pub struct RecordedTruth {
    /// The topic.
    pub topic: String,
    /// The poses in the plane.
    pub poses: Vec<StampedPose>,
}

/// A recorded drive.
#[derive(Debug)]
pub struct DataSet {
    /// The format in which it was stored.
    pub format: Format,
    /// The named calibration of the robot that recorded it.
    pub robot: RobotConfig,
    /// What the sensors delivered, in the order in which it is to be processed.
    pub records: Vec<Record>,
    /// The camera's images; none when there are none.
    pub images: Option<ImageIndex>,
    /// What was found in the files but could not be used.
    pub dropped: DropCounts,
    /// Plain sentences for the user: what is missing, what was assumed.
    pub notes: Vec<String>,
    /// SHA-256 of the input. Of a single file it is what `sha256sum` prints; of a folder it is taken
    /// over the list of its files, with the hash of each archive and the size of each image.
    pub input_hash: String,
    /// What is in it and what was chosen, when it is a recording of topics.
    pub bag: Option<BagContents>,
    /// What a live session knew that recorded it: its records stand in the order in which they came.
    pub live: Option<LiveSession>,
    /// Where its files are as long as it is open, when they came out of an archive or from standard input.
    pub(crate) unpacked: Option<Unpacked>,
}

impl DataSet {
    /// The frames of the drive: with a survey of the records where the configuration asks for one; of a live session's
    /// recording as that session made them.
    ///
    /// # Errors
    /// As [`Frames::new`].
    pub fn frames(&self, config: &Config) -> Result<Frames<'_>, OdometryError> {
        let frames = Frames::new(&self.records, config)?;
        Ok(match &self.live {
            Some(live) => frames.as_received(live.corrections.clone()),
            None => frames,
        })
    }

    /// The scans, in order.
    pub fn scans(&self) -> impl Iterator<Item = &Scan> {
        self.records.iter().filter_map(|record| match record {
            Record::Scan(scan) => Some(scan),
            _ => None,
        })
    }
}

/// Opens the data set at `path`, recognised by its content: a file, a folder, a zip archive of either, or `-` for
/// standard input.
///
/// # Errors
/// When nothing lies there, when no format is recognised, when the files are damaged
/// or hold nothing that can be used, and when a drive is chosen of a single file.
pub fn open(path: &Path, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Some(unpacked) = unpack(path, options)? else { return open_here(path, options) };
    let is_input = path == Path::new(STANDARD_INPUT);
    // Through standard input may come an archive; an archive in an archive may be endless.
    let opened = if is_input { open(&unpacked.path, options) } else { open_here(&unpacked.path, options) };
    let data_set = opened.map_err(|error| unpacked.named(&error, path))?;
    let input_hash = if is_input {
        data_set.input_hash.clone()
    } else {
        InputHash::of_files(&[path]).map_err(|error| ReadError::io(path, &error))?
    };
    Ok(DataSet { input_hash, unpacked: Some(unpacked.around(data_set.unpacked)), ..data_set })
}

/// Opens a log whose bytes are at hand, gzipped or not; `name` stands for its path in messages.
///
/// # Errors
/// As [`open`]. Recordings of ROS are read where they lie, and archives unpacked there: neither can be opened so.
pub fn open_log(name: &Path, bytes: Vec<u8>, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let source = Source::File(FileSource::new(name, bytes)?);
    let format = format::recognise(&source)?;
    if format.has_topics {
        return Err(Problem::new(name, format.description).expected("a log").into());
    }
    format.read(&source, options)
}

/// What has to be put somewhere before it can be read.
fn unpack(path: &Path, options: &OpenOptions) -> Result<Option<Unpacked>, ReadError> {
    if path == Path::new(STANDARD_INPUT) {
        return Unpacked::standard_input(options).map(Some);
    }
    is_archive(path).then(|| Unpacked::archive(path, options)).transpose()
}

fn open_here(path: &Path, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let source = Source::open(path)?;
    if let Some(recording) = lone_recording_in(&source) {
        return open(&recording, options);
    }
    if let (Source::File(_), Some(drive)) = (&source, options.drive) {
        let problem = Problem::new(path, format!("a single file, in which there is no drive {drive}"));
        return Err(problem
            .expected("a folder with several drives")
            .advice("Leave the number of the drive out")
            .into());
    }
    let format = format::recognise(&source)?;
    if let Some(option) = options.topics.option().filter(|_| !format.has_topics) {
        return Err(Problem::new(path, format!("{}, which has no topics to choose from", format.description))
            .advice(format!("Leave {option} out"))
            .into());
    }
    format.read(&source, options)
}

/// The one recording that a folder holds which is none itself: what opening the folder opens.
#[must_use]
pub fn lone_recording(folder: &Path) -> Option<PathBuf> {
    // A file would be read for nothing.
    folder.is_dir().then(|| Source::open(folder).ok()).flatten().and_then(|source| lone_recording_in(&source))
}

fn lone_recording_in(source: &Source) -> Option<PathBuf> {
    match format::drives(source).as_slice() {
        [DriveEntry { path, drive: None, .. }] if path != source.path() => Some(path.clone()),
        _ => None,
    }
}

/// One of several drives in a folder.
#[derive(Debug, Clone, Serialize)]
pub struct DriveEntry {
    /// What to open.
    pub path: PathBuf,
    /// Its number, where the path holds several.
    pub drive: Option<u32>,
    /// What is there of it, in words.
    pub holds: String,
}

impl DriveEntry {
    /// How the command line names it.
    #[must_use]
    pub fn arguments(&self) -> String {
        let path = self.path.display();
        self.drive.map_or_else(|| path.to_string(), |drive| format!("{path} --drive {drive}"))
    }
}

/// The drives at `path` where there are several: those of a course folder, or the recordings and logs in any folder.
/// Empty where there is one, or none, or one is chosen.
///
/// # Errors
/// When nothing lies there or it cannot be looked at.
pub fn drives(path: &Path, options: &OpenOptions) -> Result<Vec<DriveEntry>, ReadError> {
    if options.drive.is_some() || path == Path::new(STANDARD_INPUT) || !path.is_dir() {
        return Ok(Vec::new());
    }
    let source = Source::open(path)?;
    let drives = format::drives(&source);
    Ok(if drives.len() > 1 { drives } else { Vec::new() })
}

/// Why a part of the input was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DropReason {
    /// A line that breaks off or does not hold what its kind of line holds.
    MalformedLine,
    /// A message that is not what its type says.
    Undecodable,
    /// A scan without a single ray.
    EmptyScan,
    /// A scan of another laser than the one that is used.
    OtherLaser,
    /// A reading whose time stamp runs backwards, repeats the one before or is not a number.
    StampJump,
    /// A reading with a value that is not a number or infinite.
    NotFinite,
    /// An image whose stamp is there but whose file is not.
    MissingImage,
}

impl DropReason {
    /// What it means, for people.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::MalformedLine => "lines that are cut off or garbled",
            Self::Undecodable => "messages that are not what their type says",
            Self::EmptyScan => "scans without rays",
            Self::OtherLaser => "scans of lasers that are not used",
            Self::StampJump => "readings whose time stamps jump or repeat",
            Self::NotFinite => "readings that are not finite numbers",
            Self::MissingImage => "images that are not there",
        }
    }
}

impl fmt::Display for DropReason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.description())
    }
}

/// How much was not used, by reason.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DropCounts(BTreeMap<DropReason, usize>);

impl DropCounts {
    /// Counts one more.
    pub fn add(&mut self, reason: DropReason) {
        *self.0.entry(reason).or_default() += 1;
    }

    /// How many were dropped for `reason`.
    #[must_use]
    pub fn count(&self, reason: DropReason) -> usize {
        self.0.get(&reason).copied().unwrap_or(0)
    }

    /// The reasons that occurred with their counts.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, usize)> + '_ {
        self.0.iter().map(|(&reason, &count)| (reason, count))
    }

    /// How many were dropped in all.
    #[must_use]
    pub fn total(&self) -> usize {
        self.0.values().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_is_the_same_out_of_memory_and_from_disk() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.clf");
        let log = b"FLASER 3 2.0 2.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n";
        std::fs::write(&path, log).unwrap();
        let options = OpenOptions::default();
        let [from_disk, of_memory] =
            [open(&path, &options), open_log(&path, log.to_vec(), &options)].map(Result::unwrap);
        assert_eq!(format!("{:?}", from_disk.records), format!("{:?}", of_memory.records));
        assert_eq!((from_disk.input_hash, from_disk.notes), (of_memory.input_hash, of_memory.notes));
        let refused = open_log(&path, b"#ROSBAG V2.0\n".to_vec(), &options).unwrap_err().to_string();
        assert!(refused.contains("expected a log"), "{refused}");
    }
}
