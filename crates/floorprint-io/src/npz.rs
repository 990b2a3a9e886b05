//! Archives of NumPy arrays (`.npz`), stored or deflated.
//!
//! An archive that was cut off has lost its directory, which stands at its end; what comes before the cut
//! is found by the headers before each array (PKWARE, "APPNOTE.TXT", section 4.3.7).

use crate::budget::Budget;
use crate::error::{Problem, ReadError};
use crate::npy::{Array, NpyError, Number};
use flate2::bufread::DeflateDecoder;
use std::borrow::Cow;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;
use zip::result::ZipError;

/// An archive whose arrays are decoded when they are asked for.
pub(crate) struct Npz<'a> {
    path: PathBuf,
    content: Content<'a>,
    budget: Budget,
}

/// Where the arrays are.
enum Content<'a> {
    Whole(ZipArchive<Cursor<&'a [u8]>>),
    CutOff(Vec<Entry<'a>>),
}

/// An array of an archive that was cut off.
struct Entry<'a> {
    /// Name of the file in the archive.
    name: String,
    is_deflated: bool,
    /// What is left of it.
    bytes: &'a [u8],
}

impl<'a> Entry<'a> {
    fn reader(&self) -> Box<dyn Read + 'a> {
        if self.is_deflated { Box::new(DeflateDecoder::new(self.bytes)) } else { Box::new(self.bytes) }
    }
}

impl<'a> Npz<'a> {
    /// The archive in `bytes`, which came from `path`; see [`OpenOptions`](crate::OpenOptions) for `max_expansion`.
    pub(crate) fn new(path: &Path, bytes: &'a [u8], max_expansion: f64) -> Result<Self, ReadError> {
        let content = match ZipArchive::new(Cursor::new(bytes)) {
            Ok(archive) => Content::Whole(archive),
            Err(error) => {
                let entries = entries_before_cut(bytes);
                if entries.is_empty() {
                    return Err(Problem::new(path, error.to_string())
                        .expected("a NumPy archive (.npz)")
                        .advice("The file may have been cut off: fetch it again, or save it again with numpy.savez")
                        .into());
                }
                Content::CutOff(entries)
            }
        };
        Ok(Self { path: path.to_path_buf(), content, budget: Budget::new(bytes.len(), max_expansion) })
    }

    /// Where the archive lies.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the archive was cut off: the numbers that are missing from its last array are then not numbers.
    pub(crate) fn is_cut_off(&self) -> bool {
        matches!(self.content, Content::CutOff(_))
    }

    /// Takes memory for what is made of the numbers.
    pub(crate) fn take<T>(&mut self, values: usize) -> Result<(), ReadError> {
        self.budget.take::<T>(values).ok_or_else(|| self.budget.exceeded(&self.path).into())
    }

    /// The array called `name`, if there is one.
    pub(crate) fn optional<T: Number>(&mut self, name: &str) -> Result<Option<Array<T>>, ReadError> {
        let file = format!("{name}.npy");
        let read = match &mut self.content {
            Content::Whole(archive) => match archive.by_name(&file) {
                Ok(entry) => Array::read(entry, &mut self.budget, false),
                Err(ZipError::FileNotFound) => return Ok(None),
                Err(error) => {
                    return Err(
                        problem(&self.path, name, error.to_string(), "a NumPy array, stored or deflated").into()
                    );
                }
            },
            Content::CutOff(entries) => match entries.iter().find(|entry| entry.name == file) {
                Some(entry) => Array::read(entry.reader(), &mut self.budget, true),
                None => return Ok(None),
            },
        };
        match read {
            Ok(array) => Ok(Some(array)),
            Err(NpyError::TooLarge) => Err(self.budget.exceeded(&self.path).at(format!("array {name}")).into()),
            Err(NpyError::Other { found, expected }) => Err(problem(&self.path, name, found, expected).into()),
        }
    }

    /// The array called `name`.
    pub(crate) fn array<T: Number>(&mut self, name: &str) -> Result<Array<T>, ReadError> {
        if let Some(array) = self.optional(name)? {
            return Ok(array);
        }
        let (files, cut): (Vec<String>, _) = match &self.content {
            Content::Whole(archive) => (archive.file_names().flatten().map(Cow::into_owned).collect(), ""),
            Content::CutOff(entries) => {
                (entries.iter().map(|entry| entry.name.clone()).collect(), "it was cut off; before the cut ")
            }
        };
        let present: Vec<&str> = files.iter().map(|file| file.trim_end_matches(".npy")).collect();
        let found = if present.is_empty() { "no array at all".to_owned() } else { present.join(", ") };
        Err(Problem::new(&self.path, format!("{cut}it holds {found}"))
            .expected(format!("an array called {name}"))
            .into())
    }

    /// The array called `name`, which holds a single number.
    pub(crate) fn scalar(&mut self, name: &str) -> Result<f64, ReadError> {
        let array = self.array::<f64>(name)?;
        let found = format!("an array of shape {:?}", array.shape);
        array.scalar().ok_or_else(|| problem(&self.path, name, found, "a single number").into())
    }

    /// The array called `name`, which holds one number per reading.
    pub(crate) fn vector(&mut self, name: &str) -> Result<Vec<f64>, ReadError> {
        let array = self.array::<f64>(name)?;
        let found = format!("an array of shape {:?}", array.shape);
        array.into_vector().ok_or_else(|| problem(&self.path, name, found, "one number per reading").into())
    }

    /// The columns of the matrix called `name`, one per stamp; `rows` is their length where it is fixed.
    pub(crate) fn columns<T: Number>(
        &mut self,
        name: &str,
        rows: Option<usize>,
        stamps: usize,
    ) -> Result<Vec<Vec<T>>, ReadError> {
        let array = self.array::<T>(name)?;
        let found = format!("an array of shape {:?}", array.shape);
        let fits = array.shape.len() == 2 && array.shape[1] == stamps && rows.is_none_or(|rows| array.shape[0] == rows);
        let columns = if fits { array.into_columns() } else { None };
        columns.ok_or_else(|| {
            let rows = rows.map_or_else(|| "rays".to_owned(), |rows| rows.to_string());
            problem(
                &self.path,
                name,
                found,
                &format!("({rows}, {stamps}), a column for each of the {stamps} time stamps"),
            )
            .into()
        })
    }
}

/// A problem with one array of an archive.
pub(crate) fn problem(path: &Path, name: &str, found: impl Into<String>, expected: &str) -> Problem {
    Problem::new(path, found).at(format!("array {name}")).expected(expected)
}

/// The arrays of an archive without a directory, the last one perhaps not whole.
fn entries_before_cut(bytes: &[u8]) -> Vec<Entry<'_>> {
    let mut entries = Vec::new();
    let mut rest = bytes;
    while let Some((entry, behind)) = entry_before_cut(rest).unwrap_or(None) {
        entries.push(entry);
        rest = behind;
    }
    entries
}

/// The array whose header begins `bytes`, and what follows it; `None` where none begins.
fn entry_before_cut(bytes: &[u8]) -> io::Result<Option<(Entry<'_>, &[u8])>> {
    /// That sizes stand behind the data, so that they are not known.
    const SIZES_FOLLOW: u16 = 1 << 3;
    const STORED: u16 = 0;
    const DEFLATED: u16 = 8;
    let mut rest = bytes;
    let mut signature = [0; 4];
    rest.read_exact(&mut signature)?;
    if signature != *b"PK\x03\x04" {
        return Ok(None);
    }
    let short = |rest: &mut &[u8]| -> io::Result<u16> {
        let mut bytes = [0; 2];
        rest.read_exact(&mut bytes)?;
        Ok(u16::from_le_bytes(bytes))
    };
    let long = |rest: &mut &[u8]| -> io::Result<u32> {
        let mut bytes = [0; 4];
        rest.read_exact(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    };
    let _version = short(&mut rest)?;
    let (flags, method) = (short(&mut rest)?, short(&mut rest)?);
    let (_time_and_date, _checksum) = (long(&mut rest)?, long(&mut rest)?);
    let (packed, _unpacked) = (long(&mut rest)?, long(&mut rest)?);
    let (name_length, extra_length) = (usize::from(short(&mut rest)?), usize::from(short(&mut rest)?));
    let cut = || io::Error::from(io::ErrorKind::UnexpectedEof);
    let (name, behind) = rest.split_at_checked(name_length).ok_or_else(cut)?;
    let (extra, data) = behind.split_at_checked(extra_length).ok_or_else(cut)?;
    if flags & SIZES_FOLLOW != 0 || !matches!(method, STORED | DEFLATED) {
        return Ok(None);
    }
    // Beyond 32 bits the sizes stand in an extra field: its number 1, its length, unpacked, packed.
    let packed = match (packed, extra) {
        (u32::MAX, [1, 0, _, _, sizes @ ..]) if sizes.len() >= 16 => {
            let (_, packed) = sizes.split_at(8);
            packed.first_chunk().map_or(usize::MAX, |packed| u64::from_le_bytes(*packed) as usize)
        }
        _ => packed as usize,
    };
    let (data, behind) = data.split_at(packed.min(data.len()));
    let name = String::from_utf8_lossy(name).into_owned();
    Ok(Some((Entry { name, is_deflated: method == DEFLATED, bytes: data }, behind)))
}
