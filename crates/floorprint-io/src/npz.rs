//! Archives of NumPy arrays (`.npz`), stored or deflated.

use crate::error::{Problem, ReadError};
use crate::npy::{Array, Number};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use zip::ZipArchive;
use zip::result::ZipError;

/// An archive whose arrays are decoded when they are asked for.
pub(crate) struct Npz<'a> {
    path: PathBuf,
    archive: ZipArchive<Cursor<&'a [u8]>>,
}

impl<'a> Npz<'a> {
    /// The archive in `bytes`, which came from `path`.
    pub(crate) fn new(path: &Path, bytes: &'a [u8]) -> Result<Self, ReadError> {
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| {
            Problem::new(path, error.to_string())
                .expected("a NumPy archive (.npz)")
                .advice("The file may have been cut off: fetch it again, or save it again with numpy.savez")
        })?;
        Ok(Self { path: path.to_path_buf(), archive })
    }

    /// Where the archive lies.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The array called `name`, if there is one.
    pub(crate) fn optional<T: Number>(&mut self, name: &str) -> Result<Option<Array<T>>, ReadError> {
        let entry = match self.archive.by_name(&format!("{name}.npy")) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => return Ok(None),
            Err(error) => {
                return Err(problem(&self.path, name, error.to_string(), "a NumPy array, stored or deflated").into());
            }
        };
        match Array::read(entry) {
            Ok(array) => Ok(Some(array)),
            Err(error) => Err(problem(&self.path, name, error.found, error.expected).into()),
        }
    }

    /// The array called `name`.
    pub(crate) fn array<T: Number>(&mut self, name: &str) -> Result<Array<T>, ReadError> {
        match self.optional(name)? {
            Some(array) => Ok(array),
            None => {
                let present: Vec<String> =
                    self.archive.file_names().flatten().map(|file| file.trim_end_matches(".npy").to_owned()).collect();
                let found = if present.is_empty() { "no array at all".to_owned() } else { present.join(", ") };
                Err(Problem::new(&self.path, format!("it holds {found}"))
                    .expected(format!("an array called {name}"))
                    .into())
            }
        }
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
