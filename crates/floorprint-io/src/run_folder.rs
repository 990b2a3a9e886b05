//! The folder of a run's results or of a simulation, which appears whole or not at all.

use crate::error::{Problem, WriteError};
use crate::replace::sibling;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The files by which a folder is known to hold the results of a run, or a simulation.
const MARKS: [&str; 2] = ["report.json", "simulation.json"];

/// A folder that is filled beside its final place and moved there when it is complete.
///
/// Dropped without [`finish`](Self::finish), it leaves nothing behind, and what stood at the final
/// place is untouched.
#[derive(Debug)]
pub struct RunFolder {
    target: PathBuf,
    unfinished: PathBuf,
}

impl RunFolder {
    /// Makes the folder that is to become `target`.
    ///
    /// # Errors
    /// When `target` exists, unless it is an empty folder or `replace` is set and it holds an
    /// earlier run; and when the folder cannot be made.
    pub fn create(target: &Path, replace: bool) -> Result<Self, WriteError> {
        if let Some(problem) = obstacle(target, replace).map_err(|error| WriteError::io(target, &error))? {
            return Err(problem.into());
        }
        let parent = target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|error| WriteError::io(parent, &error))?;
        let unfinished = sibling(target, "unfinished");
        // Left by a process of the same number that was killed.
        let _ = fs::remove_dir_all(&unfinished);
        fs::create_dir(&unfinished).map_err(|error| WriteError::io(&unfinished, &error))?;
        Ok(Self { target: target.to_path_buf(), unfinished })
    }

    /// Where to write the results for now.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.unfinished
    }

    /// Moves the results into place, and an earlier run out of the way only when they are complete.
    ///
    /// # Errors
    /// When they cannot be moved; the earlier run is then put back.
    pub fn finish(self) -> Result<(), WriteError> {
        let error = |error: io::Error| WriteError::io(&self.target, &error);
        if !self.target.exists() {
            return fs::rename(&self.unfinished, &self.target).map_err(error);
        }
        let earlier = sibling(&self.target, "replaced");
        fs::rename(&self.target, &earlier).map_err(error)?;
        if let Err(failure) = fs::rename(&self.unfinished, &self.target) {
            let _ = fs::rename(&earlier, &self.target);
            return Err(error(failure));
        }
        fs::remove_dir_all(&earlier).map_err(error)
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        // After a success it is no longer there.
        let _ = fs::remove_dir_all(&self.unfinished);
    }
}

/// What stands in the way at `target`, if anything does.
fn obstacle(target: &Path, replace: bool) -> io::Result<Option<Problem>> {
    let problem = |found: &str, advice: &str| Some(Problem::new(target, found).advice(advice));
    if target.file_name().is_none() {
        return Ok(problem("no folder of its own", "Name a new folder for the results"));
    }
    if !target.exists() {
        return Ok(None);
    }
    if !target.is_dir() {
        return Ok(problem("a file stands there", "Choose another folder"));
    }
    if fs::read_dir(target)?.next().is_none() {
        return Ok(None);
    }
    Ok(match (MARKS.iter().any(|mark| target.join(mark).is_file()), replace) {
        (true, true) => None,
        (true, false) => problem("it holds an earlier run", "Choose another folder, or replace it with --force"),
        // Nothing but results is ever deleted.
        (false, _) => problem("it holds files that are no results of a run", "Choose another folder"),
    })
}
