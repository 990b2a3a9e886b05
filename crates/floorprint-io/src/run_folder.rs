//! The folder of a run's results or of a simulation, which appears whole or not at all.

use crate::error::{Problem, WriteError};
use crate::replace::{behind_links, sibling, sibling_prefix};
use serde_json::Value;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// What a folder holds when it is complete; one kind never takes the place of the other.
#[derive(Debug, Clone, Copy)]
pub enum Contents {
    /// The results of a run.
    Run,
    /// A simulated drive with its truth.
    Simulation,
}

impl Contents {
    /// The file by which such a folder is known; JSON with a `version`.
    fn mark(self) -> &'static str {
        match self {
            Self::Run => "report.json",
            Self::Simulation => "simulation.json",
        }
    }

    /// All other files that may be in it; `#` stands for a number.
    fn files(self) -> &'static [&'static str] {
        match self {
            Self::Run => &[
                "report.html",
                "trajectory.tum",
                "odometry.tum",
                "graph.g2o",
                "map.pgm",
                "map.yaml",
                "map.png",
                "texture.png",
                "texture.json",
                "images.tum",
                "config.toml",
                "session.gpkg",
                "snapshots/#.png",
                "snapshots/animation.png",
            ],
            Self::Simulation => &[
                "Encoders#.npz",
                "Hokuyo#.npz",
                "Imu#.npz",
                "Kinect#.npz",
                "dataRGBD/RGB#/rgb#_#.png",
                "dataRGBD/Disparity#/disparity#_#.png",
                "truth.tum",
                "truth_map.pgm",
                "truth_map.yaml",
                "truth_texture.json",
                "truth_texture.png",
            ],
        }
    }

    /// Whether `folder` is such a folder.
    fn are_in(self, folder: &Path) -> bool {
        let mark = fs::read(folder.join(self.mark())).unwrap_or_default();
        serde_json::from_slice::<Value>(&mark).is_ok_and(|mark| mark.get("version").is_some())
    }

    /// Whether a file of this name, relative to the folder, is one of them.
    fn include(self, name: &str) -> bool {
        let mut pattern = String::with_capacity(name.len());
        for character in name.chars() {
            if !character.is_ascii_digit() {
                pattern.push(character);
            } else if !pattern.ends_with('#') {
                pattern.push('#');
            }
        }
        name == self.mark() || self.files().contains(&name) || self.files().contains(&&*pattern)
    }
}

/// A folder that is filled beside its final place and moved there when it is complete.
///
/// Dropped without [`finish`](Self::finish), it leaves nothing behind, and what stood at the final
/// place is untouched.
#[derive(Debug)]
pub struct RunFolder {
    target: PathBuf,
    unfinished: PathBuf,
    /// Folders that were made to hold it, the innermost first.
    parents_made: Vec<PathBuf>,
    /// Held as long as this process lives: by it others know that the folder is not abandoned.
    lock: Option<File>,
}

impl RunFolder {
    /// Makes the folder that is to become `target`; what `target` links to, where it is a link.
    ///
    /// What processes that were killed left of earlier attempts is removed.
    ///
    /// # Errors
    /// When `target` exists, unless it is an empty folder, or `replace` is set and it holds earlier
    /// contents of the same kind and nothing else; and when the folder cannot be made.
    pub fn create(target: &Path, contents: Contents, replace: bool) -> Result<Self, WriteError> {
        if let Some(problem) = obstacle(target, contents, replace).map_err(|error| WriteError::io(target, &error))? {
            return Err(problem.into());
        }
        let target = behind_links(target);
        let parent = target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        let mut folder = Self {
            unfinished: sibling(&target, UNFINISHED),
            parents_made: parent.ancestors().take_while(|folder| !folder.exists()).map(Path::to_path_buf).collect(),
            lock: None,
            target: target.clone(),
        };
        fs::create_dir_all(parent).map_err(|error| WriteError::io(parent, &error))?;
        remove_abandoned(parent, &target);
        fs::create_dir(&folder.unfinished).map_err(|error| WriteError::io(&folder.unfinished, &error))?;
        folder.lock = locked(&folder.unfinished);
        Ok(folder)
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
        // After a success it is no longer there, and the folders around it are not empty.
        let _ = fs::remove_dir_all(&self.unfinished);
        for parent in &self.parents_made {
            let _ = fs::remove_dir(parent);
        }
    }
}

/// What unfinished folders are called after.
const UNFINISHED: &str = "unfinished";

/// Removes the unfinished folders of `target` in `parent` that no living process fills.
fn remove_abandoned(parent: &Path, target: &Path) {
    let prefix = sibling_prefix(target, UNFINISHED);
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let process = name.as_encoded_bytes().strip_prefix(prefix.as_encoded_bytes());
        let is_unfinished = process.is_some_and(|process| process.iter().all(u8::is_ascii_digit));
        if is_unfinished && locked(&entry.path()).is_some() {
            // What cannot be removed is in nobody's way.
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

/// A folder with its lock; `None` where another process holds it, or the system cannot lock folders.
fn locked(folder: &Path) -> Option<File> {
    File::open(folder).ok().filter(|folder| folder.try_lock().is_ok())
}

/// What stands in the way at `target`, if anything does.
fn obstacle(target: &Path, contents: Contents, replace: bool) -> io::Result<Option<Problem>> {
    let problem = |found: &str, advice: &str| Some(Problem::new(target, found).advice(advice));
    if target.file_name().is_none() {
        return Ok(problem("no folder of its own", "Name a new folder for the results"));
    }
    if fs::symlink_metadata(target).is_err() {
        return Ok(None);
    }
    if !target.is_dir() {
        return Ok(problem("a file or a link that leads nowhere stands there", "Choose another folder"));
    }
    if fs::read_dir(target)?.next().is_none() {
        return Ok(None);
    }
    let kind = match contents {
        Contents::Run => "run",
        Contents::Simulation => "simulation",
    };
    if !contents.are_in(target) {
        return Ok(problem(&format!("it holds files that are no results of a {kind}"), "Choose another folder"));
    }
    if !replace {
        return Ok(problem(
            &format!("it holds an earlier {kind}"),
            "Choose another folder, or replace it with --force",
        ));
    }
    // Nothing but results is ever deleted.
    let mut others = Vec::new();
    add_files(target, "", &mut others)?;
    others.retain(|name| !contents.include(name));
    others.sort();
    Ok(match &others[..] {
        [] => None,
        [first, rest @ ..] => {
            let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
            problem(
                &format!("it holds an earlier {kind}, but also {first}{more}"),
                "Move what is not a result elsewhere, or choose another folder",
            )
        }
    })
}

/// Appends the names of all files in a folder, at any depth, each behind `prefix`.
fn add_files(folder: &Path, prefix: &str, names: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            add_files(&entry.path(), &format!("{name}/"), names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}
