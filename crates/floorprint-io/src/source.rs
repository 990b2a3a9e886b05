//! The input as it lies on disk: a file's bytes or a folder's listing.

use crate::budget::Budget;
use crate::data_set::OpenOptions;
use crate::error::{Problem, ReadError};
use crate::format::begins_like_recording;
use crate::regular_file::read_regular;
use flate2::bufread::GzDecoder;
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader, Read};
use std::path::{Path, PathBuf};

/// Bytes of a file's beginning by which formats are recognised.
const HEAD_BYTES: u64 = 1 << 16;

/// How gzip data begin.
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// The beginning of the file at `path` where that is one of a recording, which is read where it lies.
fn beginning_of_recording(path: &Path) -> Result<Option<Vec<u8>>, ReadError> {
    let refused = |error: io::Error| ReadError::io(path, &error);
    let mut head = Vec::new();
    File::open(path).map_err(refused)?.take(HEAD_BYTES).read_to_end(&mut head).map_err(refused)?;
    Ok(begins_like_recording(&head).then_some(head))
}

/// How archives begin that hold something.
const ZIP_MAGIC: &[u8] = b"PK\x03\x04";

/// Whether there is a zip archive at `path`, also one that is a single NumPy archive.
pub(crate) fn is_archive(path: &Path) -> bool {
    let mut head = Vec::new();
    // What cannot be read is told where it is opened; who waits for a pipe waits for ever.
    let read = path.is_file().then(|| File::open(path).and_then(|file| file.take(4).read_to_end(&mut head)));
    matches!(read, Some(Ok(_))) && head == ZIP_MAGIC
}

/// What a path leads to.
pub(crate) enum Source {
    /// A file.
    File(FileSource),
    /// A folder.
    Folder(FolderSource),
}

/// A file with its bytes.
pub(crate) struct FileSource {
    /// Where it lies.
    pub(crate) path: PathBuf,
    /// All its bytes, as they are on disk; none of a recording that is too large to be held: it is read there.
    bytes: Option<Vec<u8>>,
    /// The first bytes of its content, unpacked.
    head: Vec<u8>,
    /// Why there are no more of them, where that is not the file's end.
    head_error: Option<String>,
}

/// A folder with what lies in it.
pub(crate) struct FolderSource {
    /// Where it lies.
    pub(crate) path: PathBuf,
    /// Names of its entries.
    pub(crate) names: BTreeSet<String>,
}

impl Source {
    /// Looks up `path`.
    pub(crate) fn open(path: &Path) -> Result<Self, ReadError> {
        let metadata = fs::metadata(path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => missing(path).into(),
            _ => ReadError::io(path, &error),
        })?;
        if metadata.is_dir() {
            let names = folder_names(path).map_err(|error| ReadError::io(path, &error))?;
            return Ok(Self::Folder(FolderSource { path: path.to_path_buf(), names }));
        }
        if !metadata.is_file() {
            return Err(Problem::new(path, "neither a file nor a folder").expected("a recorded data set").into());
        }
        if let Some(head) = beginning_of_recording(path)? {
            return Ok(Self::File(FileSource { path: path.to_path_buf(), bytes: None, head, head_error: None }));
        }
        let bytes = read_regular(path)?;
        Ok(Self::File(FileSource::new(path, bytes)?))
    }

    /// Where it lies.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::File(file) => &file.path,
            Self::Folder(folder) => &folder.path,
        }
    }
}

impl FileSource {
    /// A file with the given bytes.
    pub(crate) fn new(path: &Path, bytes: Vec<u8>) -> Result<Self, ReadError> {
        let mut file = Self { path: path.to_path_buf(), bytes: Some(bytes), head: Vec::new(), head_error: None };
        let mut head = Vec::new();
        // A damaged file may end early; what its beginning is can be told nevertheless.
        let read = file.content().take(HEAD_BYTES).read_to_end(&mut head);
        if let Ok(0) = read {
            return Err(Problem::new(path, "the file is empty").expected("a recorded data set").into());
        }
        file.head_error = read.err().map(|error| error.to_string());
        file.head = head;
        Ok(file)
    }

    /// The content, unpacked if it is gzipped (also in several members).
    pub(crate) fn content(&self) -> Box<dyn Read + '_> {
        let bytes = self.bytes();
        if self.is_gzip() { Box::new(Gunzip(GzDecoder::new(bytes))) } else { Box::new(bytes) }
    }

    /// The first bytes of its content.
    pub(crate) fn head(&self) -> &[u8] {
        &self.head
    }

    /// Whether it is not held in memory.
    pub(crate) fn is_on_disk(&self) -> bool {
        self.bytes.is_none()
    }

    fn bytes(&self) -> &[u8] {
        self.bytes.as_deref().unwrap_or_default()
    }

    /// The lines by which a text format is recognised: those that end within the file's beginning.
    pub(crate) fn head_lines(&self) -> impl Iterator<Item = &[u8]> {
        self.head.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii)
    }

    /// SHA-256 of the bytes on disk, as `sha256sum` prints it.
    pub(crate) fn hash(&self) -> String {
        hexadecimal(&Sha256::digest(self.bytes()))
    }

    /// The memory that its data may take.
    pub(crate) fn budget(&self, options: &OpenOptions) -> Budget {
        Budget::new(self.bytes().len(), options.max_expansion)
    }

    /// What the user is told where the content breaks off or cannot be unpacked behind a line.
    pub(crate) fn cut_off_note(&self, line: usize, error: &io::Error) -> String {
        format!("the file was cut off or damaged ({error}): only its first {line} lines are used")
    }

    /// What is wrong with a file whose beginning tells nothing.
    pub(crate) fn unknown(&self) -> Problem {
        match &self.head_error {
            Some(error) => {
                let bytes = self.head.len();
                Problem::new(&self.path, format!("gzip data that end after {bytes} bytes of content ({error})"))
                    .expected("enough of them to tell the format")
                    .advice("The file was cut off or damaged: fetch it again")
            }
            None => Problem::new(&self.path, "its content is of no known format"),
        }
    }

    fn is_gzip(&self) -> bool {
        self.bytes().starts_with(&GZIP_MAGIC)
    }
}

/// Unpacks gzip data of one or several members; like `gunzip`, it ignores what follows the last.
struct Gunzip<'a>(GzDecoder<&'a [u8]>);

impl Read for Gunzip<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let count = self.0.read(buffer)?;
            let rest = *self.0.get_ref();
            if count > 0 || buffer.is_empty() || !rest.starts_with(&GZIP_MAGIC) {
                return Ok(count);
            }
            self.0 = GzDecoder::new(rest);
        }
    }
}

/// A truth file is not longer than this, unpacked: 10 million poses.
const LONGEST_TEXT_BYTES: u64 = 1 << 30;

/// The content of a file that is text, gzipped or not.
pub(crate) fn read_unpacked(path: &Path) -> Result<Vec<u8>, ReadError> {
    let bytes = read_regular(path)?;
    if !bytes.starts_with(&GZIP_MAGIC) {
        return Ok(bytes);
    }
    let mut text = Vec::new();
    let read = Gunzip(GzDecoder::new(&bytes)).take(LONGEST_TEXT_BYTES + 1).read_to_end(&mut text);
    if let Err(error) = read {
        return Err(Problem::new(path, format!("gzip data that cannot be unpacked ({error})"))
            .advice("The file was cut off or damaged: fetch it again")
            .into());
    }
    if text.len() as u64 > LONGEST_TEXT_BYTES {
        return Err(Problem::new(path, "gzip data of more than 1 GiB").expected("a text file that is shorter").into());
    }
    Ok(text)
}

/// The hash of an input of several files: SHA-256 over a list of them, which is what `sha256sum`
/// prints for the files that are read whole, and name and size for the images.
#[derive(Default)]
pub(crate) struct InputHash(Sha256);

impl InputHash {
    /// Adds a file with its content.
    pub(crate) fn add_content(&mut self, path: &Path, bytes: &[u8]) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        self.0.update(format!("{}  {name}\n", hexadecimal(&Sha256::digest(bytes))));
    }

    /// The hash of files that are read whole: of one file what `sha256sum` prints for it.
    pub(crate) fn of_files(paths: &[&Path]) -> io::Result<String> {
        let mut list = Self::default();
        for path in paths {
            let mut file = Sha256::new();
            let mut reader = BufReader::with_capacity(1 << 20, File::open(path)?);
            loop {
                let bytes = reader.fill_buf()?;
                let count = bytes.len();
                if count == 0 {
                    break;
                }
                file.update(bytes);
                reader.consume(count);
            }
            let digest = hexadecimal(&file.finalize());
            if paths.len() == 1 {
                return Ok(digest);
            }
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            list.0.update(format!("{digest}  {name}\n"));
        }
        Ok(list.finish())
    }

    /// Adds a file with its size only.
    pub(crate) fn add_size(&mut self, path: &Path) -> io::Result<()> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        self.0.update(format!("{}  {name}\n", fs::metadata(path)?.len()));
        Ok(())
    }

    /// The hash in hexadecimal digits.
    pub(crate) fn finish(self) -> String {
        hexadecimal(&self.0.finalize())
    }
}

/// Bytes as hexadecimal digits.
fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Names of a folder's entries; names that are no text are left out.
pub(crate) fn folder_names(path: &Path) -> io::Result<BTreeSet<String>> {
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(path)? {
        names.extend(entry?.file_name().into_string());
    }
    Ok(names)
}

/// The problem with a path that leads nowhere, with the names most like it.
fn missing(path: &Path) -> Problem {
    let problem = Problem::new(path, "there is no such file or folder");
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let Ok(names) = folder_names(folder) else {
        return problem.advice(format!("The folder {} does not exist either", folder.display()));
    };
    let wanted = path.file_name().unwrap_or_default().to_string_lossy();
    let mut similar: Vec<(f64, String)> = names
        .into_iter()
        .map(|name| (strsim::jaro_winkler(&wanted, &name), name))
        .filter(|(likeness, _)| *likeness > 0.8)
        .collect();
    similar.sort_by(|a, b| b.0.total_cmp(&a.0));
    match similar.first() {
        Some((_, name)) => problem.advice(format!("Did you mean {}?", folder.join(name).display())),
        None => problem,
    }
}
