//! What went wrong with a file: where, what was found, what was expected, what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A file or folder cannot be used as input.
#[derive(Debug, Error)]
#[error("cannot read {0}")]
pub struct ReadError(Box<Problem>);

/// A result cannot be written; nothing half-written is left behind.
#[derive(Debug, Error)]
#[error("cannot write {0}")]
pub struct WriteError(Box<Problem>);

/// The parts of an error's message, so that a program can set them out in its own way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The file or folder.
    pub file: PathBuf,
    /// Where in the file: a line, an array, a byte; empty when the whole file is meant.
    pub place: String,
    /// What was found.
    pub found: String,
    /// What was expected instead; empty when that is plain.
    pub expected: String,
    /// What to do about it.
    pub advice: String,
}

impl Problem {
    /// A problem with a whole file.
    pub(crate) fn new(file: &Path, found: impl Into<String>) -> Self {
        Self {
            file: file.to_path_buf(),
            place: String::new(),
            found: found.into(),
            expected: String::new(),
            advice: String::new(),
        }
    }

    /// Says where in the file.
    pub(crate) fn at(mut self, place: impl Into<String>) -> Self {
        self.place = place.into();
        self
    }

    /// Says what was expected.
    pub(crate) fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = expected.into();
        self
    }

    /// Says what to do.
    pub(crate) fn advice(mut self, advice: impl Into<String>) -> Self {
        self.advice = advice.into();
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.file.display())?;
        if !self.place.is_empty() {
            write!(formatter, ", {}", self.place)?;
        }
        write!(formatter, ": {}", self.found)?;
        if !self.expected.is_empty() {
            write!(formatter, "; expected {}", self.expected)?;
        }
        if !self.advice.is_empty() {
            write!(formatter, ". {}", self.advice)?;
        }
        Ok(())
    }
}

/// A line of a file for a message, between quotes and not too long.
pub(crate) fn quoted(line: &[u8]) -> String {
    const LONGEST: usize = 80;
    let (shown, rest) = line.split_at(line.len().min(LONGEST));
    format!("\"{}{}\"", shown.escape_ascii(), if rest.is_empty() { "" } else { "…" })
}

impl ReadError {
    /// The parts of the message.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        &self.0
    }

    /// The operating system's refusal to read `file`.
    pub(crate) fn io(file: &Path, error: &io::Error) -> Self {
        Problem::new(file, error.to_string()).into()
    }
}

impl WriteError {
    /// The parts of the message.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        &self.0
    }

    /// The operating system's refusal to write `file`.
    pub(crate) fn io(file: &Path, error: &io::Error) -> Self {
        let advice = match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                "Free some space there, or choose a folder on another disk"
            }
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
                "Choose a folder that you may write to"
            }
            io::ErrorKind::NotFound => "Make the folder that is to hold it first",
            io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => {
                "A file stands where a folder is needed: choose another place"
            }
            _ => "",
        };
        Problem::new(file, error.to_string()).advice(advice).into()
    }
}

impl From<Problem> for ReadError {
    fn from(problem: Problem) -> Self {
        Self(Box::new(problem))
    }
}

impl From<Problem> for WriteError {
    fn from(problem: Problem) -> Self {
        Self(Box::new(problem))
    }
}
