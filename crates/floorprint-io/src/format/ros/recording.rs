//! A recording as it lies on disk: one file or several, each in its container, packed or not.

use super::input::{ZSTD_MAGIC, ZstdFrames};
use super::{Encoding, MessageSource, RawMessage};
use super::{bag1, mcap, rosbag2};
use crate::error::{Problem, ReadError};
use crate::source::{FileSource, FolderSource, InputHash, Source};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Endings of the files in which rosbag2 keeps messages.
const STORAGE_ENDINGS: [&str; 4] = [".db3", ".mcap", ".db3.zstd", ".mcap.zstd"];

/// How the containers begin.
const MAGICS: [&[u8]; 3] = [bag1::MAGIC, mcap::MAGIC, rosbag2::MAGIC];

/// Whether a file begins like a container, or like one that is packed: nothing else that is read is packed so.
pub(crate) fn begins_like_recording(head: &[u8]) -> bool {
    MAGICS.iter().any(|magic| head.starts_with(magic)) || head.starts_with(&ZSTD_MAGIC)
}

/// Whether a file or folder is a recording.
pub(super) fn recognises(source: &Source) -> bool {
    match source {
        Source::File(file) => begins_like_recording(file.head()),
        Source::Folder(folder) => !storage_files(folder).is_empty(),
    }
}

/// The files of a rosbag2 folder in the order in which they were recorded: `NAME_0`, `NAME_1` … `NAME_10`.
///
/// A folder is one recording when it has a `metadata.yaml`, or when its files are one recording's by their names and no
/// bags of ROS 1 lie beside them.
fn storage_files(folder: &FolderSource) -> Vec<PathBuf> {
    let stem = |name: &str| {
        let ending = STORAGE_ENDINGS.iter().rev().find(|ending| name.ends_with(**ending))?;
        let stem = name.strip_suffix(ending)?;
        let number = stem.rsplit_once('_').and_then(|(name, number)| Some((name, number.parse::<u32>().ok()?)));
        let (recording, number) = number.unwrap_or((stem, 0));
        Some((recording.to_owned(), number))
    };
    let mut files: Vec<(String, u32, &String)> = folder
        .names
        .iter()
        .filter_map(|name| stem(name).map(|(recording, number)| (recording, number, name)))
        .collect();
    files.sort();
    let recordings: BTreeSet<&String> = files.iter().map(|(recording, ..)| recording).collect();
    let is_collection = recordings.len() > 1 || folder.names.iter().any(|name| name.ends_with(".bag"));
    if is_collection && !folder.names.contains("metadata.yaml") {
        return Vec::new();
    }
    files.into_iter().map(|(.., name)| folder.path.join(name)).collect()
}

/// A recording that can be read as often as is needed.
pub(super) struct Recording<'a> {
    parts: Vec<Part<'a>>,
    is_folder: bool,
}

/// What holds the messages of a file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Container {
    Bag,
    Mcap,
    Database,
}

impl Container {
    /// By a file's first bytes. What begins like none of them is searched for the records of MCAP.
    fn of(head: &[u8]) -> Self {
        if head.starts_with(bag1::MAGIC) {
            Self::Bag
        } else if head.starts_with(rosbag2::MAGIC) {
            Self::Database
        } else {
            Self::Mcap
        }
    }
}

/// One file of a recording.
enum Part<'a> {
    /// Bytes in memory.
    Memory(&'a FileSource),
    /// A file that is read from front to back.
    Stream { path: PathBuf, is_packed: bool, container: Container },
    /// A database, which has to lie on disk unpacked.
    Database { path: PathBuf, unpacked: Option<NamedTempFile> },
}

impl<'a> Recording<'a> {
    /// Looks up the files of a recording.
    pub(super) fn open(source: &'a Source) -> Result<Self, ReadError> {
        let parts = match source {
            Source::File(file) if !file.is_on_disk() => vec![Part::Memory(file)],
            Source::File(file) => vec![Part::open(&file.path)?],
            Source::Folder(folder) => {
                storage_files(folder).iter().map(|path| Part::open(path)).collect::<Result<_, _>>()?
            }
        };
        Ok(Self { parts, is_folder: matches!(source, Source::Folder(_)) })
    }

    /// What kind of recording it is, in a few words.
    pub(super) fn description(&self) -> &'static str {
        let container = self.parts.first().map(Part::container);
        let is_mixed = self.parts.iter().any(|part| Some(part.container()) != container);
        match (container, self.is_folder) {
            (None, _) => super::FORMAT.description,
            (Some(Container::Bag), _) => "a ROS 1 bag",
            (Some(Container::Mcap), false) => "an MCAP file",
            (Some(Container::Database), false) => "a rosbag2 database (SQLite)",
            (Some(_), true) if is_mixed => "a rosbag2 folder",
            (Some(Container::Mcap), true) => "a rosbag2 folder (MCAP)",
            (Some(Container::Database), true) => "a rosbag2 folder (SQLite)",
        }
    }

    /// SHA-256 of the files.
    pub(super) fn hash(&self) -> io::Result<String> {
        if let [Part::Memory(file)] = &self.parts[..] {
            return Ok(file.hash());
        }
        let paths: Vec<&Path> = self.parts.iter().map(Part::path).collect();
        InputHash::of_files(&paths)
    }

    /// All messages from the first on.
    pub(super) fn messages(&self) -> Messages<'_> {
        Messages { parts: self.parts.iter(), current: None, unpacked: None, unpackable: 0, damage: Vec::new() }
    }
}

impl Part<'_> {
    fn open(path: &Path) -> Result<Self, ReadError> {
        let refused = |error: io::Error| ReadError::io(path, &error);
        let begins = |reader: &mut dyn Read| -> io::Result<Vec<u8>> {
            let mut head = Vec::new();
            reader.take(rosbag2::MAGIC.len() as u64).read_to_end(&mut head)?;
            Ok(head)
        };
        let mut head = File::open(path).and_then(|mut file| begins(&mut file)).map_err(refused)?;
        let is_packed = head.starts_with(&ZSTD_MAGIC);
        if is_packed {
            // Unpacking gives nothing before a whole window is read. What fails is told when messages are read.
            let file = File::open(path).map_err(refused)?;
            head = begins(&mut ZstdFrames::new(BufReader::new(file))).unwrap_or_default();
        }
        let container = Container::of(&head);
        if container != Container::Database {
            return Ok(Self::Stream { path: path.to_path_buf(), is_packed, container });
        }
        let unpacked = is_packed.then(|| unpack(path)).transpose().map_err(|error| {
            Problem::new(path, format!("it cannot be unpacked ({error})")).expected("a whole file packed by zstd")
        })?;
        Ok(Self::Database { path: path.to_path_buf(), unpacked })
    }

    fn path(&self) -> &Path {
        match self {
            Self::Memory(file) => &file.path,
            Self::Stream { path, .. } | Self::Database { path, .. } => path,
        }
    }

    fn container(&self) -> Container {
        match self {
            Self::Memory(file) => Container::of(file.head()),
            Self::Stream { container, .. } => *container,
            Self::Database { .. } => Container::Database,
        }
    }

    fn messages(&self) -> io::Result<Box<dyn MessageSource + '_>> {
        let reader: Box<dyn Read + '_> = match self {
            Self::Memory(file) => file.content(),
            Self::Stream { path, is_packed: false, .. } => Box::new(File::open(path)?),
            Self::Stream { path, is_packed: true, .. } => Box::new(ZstdFrames::new(BufReader::new(File::open(path)?))),
            Self::Database { path, unpacked } => {
                let path = unpacked.as_ref().map_or(path.as_path(), NamedTempFile::path);
                return Ok(Box::new(rosbag2::Rosbag2::new(path)));
            }
        };
        Ok(match self.container() {
            Container::Bag => Box::new(bag1::Bag1::new(reader)),
            Container::Mcap | Container::Database => Box::new(mcap::Mcap::new(reader)),
        })
    }
}

/// Unpacks a file beside others that the system throws away.
fn unpack(path: &Path) -> io::Result<NamedTempFile> {
    let mut unpacked = NamedTempFile::new()?;
    io::copy(&mut ZstdFrames::new(BufReader::new(File::open(path)?)), &mut unpacked)?;
    Ok(unpacked)
}

/// The messages of all files, one after the other; those that rosbag2 packed one by one are unpacked.
pub(super) struct Messages<'a> {
    parts: std::slice::Iter<'a, Part<'a>>,
    current: Option<(&'a Path, Box<dyn MessageSource + 'a>)>,
    /// The current message's bytes where it was packed.
    unpacked: Option<Vec<u8>>,
    /// Messages that cannot be unpacked.
    unpackable: usize,
    /// Of the files before the current one.
    damage: Vec<String>,
}

impl Messages<'_> {
    /// Packed messages are told by their beginning: no message in CDR begins so, and the announcement in
    /// `metadata.yaml` may be missing.
    fn unpack_message(&mut self) -> bool {
        let message = self.current.as_ref().and_then(|(_, source)| source.message());
        let packed = message
            .filter(|message| message.channel.encoding == Encoding::Cdr && message.bytes.starts_with(&ZSTD_MAGIC));
        let Some(packed) = packed else {
            self.unpacked = None;
            return true;
        };
        let mut bytes = self.unpacked.take().unwrap_or_default();
        bytes.clear();
        let is_whole = ZstdFrames::new(packed.bytes).read_to_end(&mut bytes).is_ok();
        self.unpacked = Some(bytes);
        self.unpackable += usize::from(!is_whole);
        is_whole
    }

    fn note_damage(&mut self) {
        let Some((path, source)) = &self.current else { return };
        if let Some(damage) = source.damage() {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            self.damage.push(format!("{name}: {damage}"));
        }
    }
}

impl MessageSource for Messages<'_> {
    fn advance(&mut self) -> bool {
        loop {
            if let Some((_, source)) = &mut self.current
                && source.advance()
            {
                if self.unpack_message() {
                    return true;
                }
                continue;
            }
            self.note_damage();
            self.current = None;
            let Some(part) = self.parts.next() else { return false };
            match part.messages() {
                Ok(source) => self.current = Some((part.path(), source)),
                Err(error) => self.damage.push(format!("{}: {error}", part.path().display())),
            }
        }
    }

    fn message(&self) -> Option<RawMessage<'_>> {
        let message = self.current.as_ref()?.1.message()?;
        Some(match &self.unpacked {
            Some(bytes) => RawMessage { bytes, ..message },
            None => message,
        })
    }

    fn damage(&self) -> Option<String> {
        let mut damage = self.damage.clone();
        if self.unpackable > 0 {
            damage.push(format!("messages that cannot be unpacked: {}", self.unpackable));
        }
        (!damage.is_empty()).then(|| damage.join("; "))
    }
}
