//! The folder of a run's results or of a simulation, which appears whole or not at all.

use crate::error::{Problem, WriteError};
use crate::exchange::exchange;
use crate::regular_file::read_regular;
use crate::replace::{behind_links, hidden, sibling_prefix, sync_folder};
use serde_json::Value;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// What a folder holds when it is complete; one kind never takes the place of the other.
#[derive(Debug, Clone, Copy)]
pub enum Contents {
    /// The results of a run.
    Run,
    /// A simulated drive with its truth.
    Simulation,
    /// A robot followed in a finished map.
    Localization,
    /// A session that was live.
    Live,
}

/// What a run leaves, and what it is, in a few words; `#` stands for a number. What there is nothing for is missing.
pub const RESULTS_OF_RUN: [(&str, &str); 19] = [
    ("report.html", "everything on one page"),
    ("report.json", "all figures"),
    ("trajectory.tum", "poses"),
    ("trajectory.kitti", "poses as matrices"),
    ("live.tum", "poses as they were known at the time"),
    ("odometry.tum", "dead reckoning"),
    ("graph.g2o", "pose graph"),
    ("session.gpkg", "session, to go on with"),
    ("map.yaml", "map for ROS"),
    ("map.pgm", "its cells"),
    ("map.png", "map"),
    ("trajectories.png", "map and trajectories"),
    ("trajectories.svg", "the same, without loss"),
    ("texture.png", "floor"),
    ("texture.json", "its resolution and origin"),
    ("images.tum", "poses at the images of the floor"),
    ("config.toml", "configuration"),
    ("snapshots/#.png", "map on the way"),
    ("snapshots/animation.png", "the same as an animation"),
];

impl Contents {
    /// The file by which such a folder is known; it is written last.
    fn mark(self) -> &'static str {
        match self {
            Self::Run | Self::Localization => "report.json",
            Self::Simulation => "simulation.json",
            Self::Live => "live.json",
        }
    }

    /// What the mark says under `what`: no other program writes that.
    #[must_use]
    pub fn what(self) -> &'static str {
        match self {
            Self::Run => "results of floorprint run",
            Self::Simulation => "a simulated drive in the layout of ECE276A, with its truth",
            Self::Localization => "results of floorprint localize",
            Self::Live => "results of floorprint live",
        }
    }

    /// What the folder is called in messages.
    fn kind(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Simulation => "simulation",
            Self::Localization => "localization",
            Self::Live => "live session",
        }
    }

    /// All files that may be in it beside the mark; `#` stands for a number.
    fn files(self) -> Vec<&'static str> {
        match self {
            Self::Run => RESULTS_OF_RUN.iter().map(|(name, _)| *name).collect(),
            Self::Simulation => vec![
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
            Self::Live => vec!["session.gpkg", "trajectory.tum", "map.pgm", "map.yaml", "config.toml"],
            Self::Localization => {
                vec![
                    "report.html",
                    "trajectory.tum",
                    "localization.png",
                    "config.toml",
                    "changes.geojson",
                    "changes.png",
                ]
            }
        }
    }

    /// What the mark in `folder` says, if it is such a folder.
    fn mark_in(self, folder: &Path) -> Option<Value> {
        let mark: Value = serde_json::from_slice(&read_regular(&folder.join(self.mark())).ok()?).ok()?;
        (mark.get("what").and_then(Value::as_str) == Some(self.what())).then_some(mark)
    }

    /// Whether a file of this name, relative to the folder, is one of them, perhaps half-written.
    fn include(self, name: &str) -> bool {
        let name = finished_name(name);
        let pattern = pattern(&name);
        name == self.mark() || self.files().contains(&&*name) || self.files().contains(&&*pattern)
    }

    /// Whether a folder of this name, relative to the folder, holds some of them.
    fn include_folder(self, name: &str) -> bool {
        let start = pattern(name) + "/";
        self.files().iter().any(|file| file.starts_with(&start))
    }
}

/// Whether this process may put files into a folder and remove them.
#[cfg(unix)]
fn may_change(folder: &Path) -> bool {
    use nix::unistd::{AccessFlags, access};
    access(folder, AccessFlags::W_OK | AccessFlags::X_OK).is_ok()
}

#[cfg(not(unix))]
fn may_change(_folder: &Path) -> bool {
    true
}

/// The name that a file gets when it is whole, of its own one or of that while it is written.
fn finished_name(name: &str) -> String {
    let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
    let whole = file.strip_prefix('.').and_then(|file| file.rsplit_once(".unfinished-"));
    match whole.filter(|(_, process)| process.bytes().all(|byte| byte.is_ascii_digit())) {
        Some((whole, _)) if folder.is_empty() => whole.to_owned(),
        Some((whole, _)) => format!("{folder}/{whole}"),
        None => name.to_owned(),
    }
}

/// A name with `#` for each number in it.
fn pattern(name: &str) -> String {
    let mut pattern = String::with_capacity(name.len());
    for character in name.chars() {
        if !character.is_ascii_digit() {
            pattern.push(character);
        } else if !pattern.ends_with('#') {
            pattern.push('#');
        }
    }
    pattern
}

/// What folders are called after that are being filled.
const UNFINISHED: &str = "unfinished";

/// What earlier results are called after while they are out of the way.
const REPLACED: &str = "replaced";

/// A folder that is filled beside its final place and moved there when it is complete.
///
/// While it lives, no other process can fill a folder for the same place. Dropped without
/// [`finish`](Self::finish) it leaves nothing behind, and what stood at the final place is untouched.
/// Nothing but results is ever deleted, whenever it was put there.
#[derive(Debug)]
pub struct RunFolder {
    target: PathBuf,
    unfinished: PathBuf,
    contents: Contents,
    replace: bool,
    notes: Vec<String>,
    /// Folders that were made to hold it, the innermost first.
    parents_made: Vec<PathBuf>,
    /// Whether the unfinished folder is this process's to remove.
    is_claimed: bool,
    /// Held as long as this process fills the folder: by it others know that it is not abandoned.
    lock: Option<File>,
}

impl RunFolder {
    /// Makes the folder that is to become `target`; what `target` links to, where it is a link.
    ///
    /// What processes that were killed left of earlier attempts is removed, what they left of complete
    /// results is put back; see [`notes`](Self::notes).
    ///
    /// # Errors
    /// When `target` exists, unless it is an empty folder, or `replace` is set and it holds earlier
    /// contents of the same kind and nothing else; when another process is filling a folder for the
    /// same place; and when the folder cannot be made.
    pub fn create(target: &Path, contents: Contents, replace: bool) -> Result<Self, WriteError> {
        if target.file_name().is_none() {
            let problem = Problem::new(target, "no folder of its own").advice("Name a new folder for the results");
            return Err(problem.into());
        }
        if target.is_symlink() && !target.exists() {
            return Err(Problem::new(target, "a link that leads nowhere stands there")
                .advice("Choose another folder")
                .into());
        }
        let target = behind_links(target);
        let parent = parent_of(&target);
        let mut folder = Self {
            unfinished: hidden(&target, UNFINISHED),
            parents_made: parent.ancestors().take_while(|folder| !folder.exists()).map(Path::to_path_buf).collect(),
            target: target.clone(),
            contents,
            replace,
            notes: Vec::new(),
            is_claimed: false,
            lock: None,
        };
        fs::create_dir_all(parent).map_err(|error| WriteError::io(parent, &error))?;
        folder.claim()?;
        if !may_change(&folder.unfinished) {
            folder.is_claimed = false;
            let found = format!("a folder of another user is in the way: {}", folder.unfinished.display());
            return Err(Problem::new(&target, found).advice("Choose another folder").into());
        }
        folder.recover(parent)?;
        match folder.obstacle().map_err(|error| WriteError::io(&target, &error))? {
            Some(problem) => Err(problem.into()),
            None => Ok(folder),
        }
    }

    /// Where to write the results for now.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.unfinished
    }

    /// Plain sentences for the user: what was found of earlier attempts, and what became of it.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Moves the results into place, and an earlier run out of the way only when they are complete.
    ///
    /// # Errors
    /// When something was put at the final place that is no result, or the results cannot be moved there:
    /// they are then kept beside it, and the error says where.
    pub fn finish(mut self) -> Result<(), WriteError> {
        self.sync()?;
        let problem = match self.settle() {
            Ok(None) => return Ok(()),
            Ok(Some(problem)) => problem,
            Err(error) => WriteError::io(&self.target, &error).problem().clone(),
        };
        let kept = self.move_beside();
        let advice = [problem.advice.clone(), format!("The results are kept in {}", kept.display())];
        let advice: Vec<String> = advice.into_iter().filter(|advice| !advice.is_empty()).collect();
        Err(problem.advice(advice.join(". ")).into())
    }

    /// Moves results that are partial into place; beside it where complete ones stand. Says where they are.
    ///
    /// # Errors
    /// As [`finish`](Self::finish).
    pub fn finish_partial(mut self) -> Result<PathBuf, WriteError> {
        let earlier = self.contents.mark_in(&self.target);
        if earlier.is_some_and(|mark| mark.get("partial") != Some(&Value::Bool(true))) {
            self.sync()?;
            return Ok(self.move_beside());
        }
        let target = self.target.clone();
        self.finish().map(|()| target)
    }

    /// Makes the unfinished folder this process's own.
    fn claim(&mut self) -> Result<(), WriteError> {
        let path = &self.unfinished;
        let error = |error: io::Error| WriteError::io(path, &error);
        let busy = |advice: &str| {
            let found = format!("another process is filling it, in {}", path.display());
            WriteError::from(Problem::new(&self.target, found).advice(advice))
        };
        loop {
            let is_new = match fs::create_dir(path) {
                Ok(()) => true,
                Err(failure) if failure.kind() == io::ErrorKind::AlreadyExists => false,
                Err(failure) => return Err(error(failure)),
            };
            let lock = match File::open(path) {
                Ok(folder) => folder,
                // Whoever filled it has just finished.
                Err(failure) if failure.kind() == io::ErrorKind::NotFound => continue,
                Err(_) if is_new => break self.is_claimed = true,
                Err(failure) => return Err(error(failure)),
            };
            match lock.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(busy("Wait for it, or choose another folder")),
                // The file system knows no locks.
                Err(TryLockError::Error(_)) if is_new => break self.is_claimed = true,
                Err(TryLockError::Error(_)) => {
                    return Err(busy("If that process is gone, remove that folder; else choose another one"));
                }
            }
            if !is_at(&lock, path) {
                continue;
            }
            (self.is_claimed, self.lock) = (true, Some(lock));
            break;
        }
        Ok(())
    }

    /// Puts back or removes what earlier attempts left.
    fn recover(&mut self, parent: &Path) -> Result<(), WriteError> {
        for folder in left_over(&self.target, parent, REPLACED) {
            let is_complete = self.contents.mark_in(&folder).is_some();
            if is_complete && !self.target.exists() && fs::rename(&folder, &self.target).is_ok() {
                let note = "a run that was stopped had moved the earlier results away: they are put back";
                self.notes.push(format!("{}: {note}", self.target.display()));
            } else {
                let removed = remove_contents(&folder, self.contents).is_ok();
                let note = if removed { "removed" } else { "it holds what is no result, so it stays" };
                self.notes.push(format!("{}: left by a run that was stopped; {note}", folder.display()));
            }
        }
        for folder in left_over(&self.target, parent, UNFINISHED) {
            let is_own = folder == self.unfinished;
            if is_own && fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_none()) {
                continue;
            }
            if !is_own && File::open(&folder).is_ok_and(|folder| folder.try_lock().is_err()) {
                continue;
            }
            if self.contents.mark_in(&folder).is_some() {
                let kept = free_beside(&self.target);
                fs::rename(&folder, &kept).map_err(|error| WriteError::io(&folder, &error))?;
                self.notes.push(format!("{}: complete results of a run that was stopped, put there", kept.display()));
                if is_own {
                    (self.is_claimed, self.lock) = (false, None);
                    self.claim()?;
                }
                continue;
            }
            let removed = match is_own {
                // It stays, and so does the lock on it.
                true => remove_within(&folder, "", self.contents),
                false => remove_contents(&folder, self.contents),
            };
            let is_empty = fs::read_dir(&folder).map_or(true, |mut entries| entries.next().is_none());
            if removed.is_err() || !is_empty {
                self.is_claimed = false;
                let problem = Problem::new(&folder, "a run that was stopped left it, and it holds what is no result");
                return Err(problem.advice("Move it elsewhere").into());
            }
            self.notes.push(format!("{}: left by a run that was stopped; removed", folder.display()));
        }
        Ok(())
    }

    /// Puts on the disk what is in the folder.
    fn sync(&self) -> Result<(), WriteError> {
        sync_folders(&self.unfinished).map_err(|error| WriteError::io(&self.unfinished, &error))
    }

    /// Moves the results to their place; what stands in the way, if something does.
    fn settle(&mut self) -> io::Result<Option<Problem>> {
        self.settle_by(exchange)
    }

    fn settle_by(&mut self, exchange: impl Fn(&Path, &Path) -> io::Result<()>) -> io::Result<Option<Problem>> {
        // The folder may have been filled since the run began.
        if let Some(problem) = self.obstacle()? {
            return Ok(Some(problem));
        }
        let parent = parent_of(&self.target).to_path_buf();
        let is_free = fs::read_dir(&self.target).map_or(true, |mut entries| entries.next().is_none());
        if is_free {
            // Systems other than Unix do not move a folder onto an empty one.
            if cfg!(not(unix)) {
                let _ = fs::remove_dir(&self.target);
            }
            return match fs::rename(&self.unfinished, &self.target) {
                Ok(()) => {
                    self.is_claimed = false;
                    sync_folder(&parent).map(|()| None)
                }
                Err(failure) => self.obstacle()?.map(Some).ok_or(failure),
            };
        }
        // Nobody else may take it for abandoned while it is out of the way.
        let earlier_lock = File::open(&self.target).ok();
        if let Some(lock) = &earlier_lock {
            let _ = lock.try_lock();
        }
        let earlier = match exchange(&self.unfinished, &self.target) {
            Ok(()) => {
                if let Some(problem) = self.foreign_in(&self.unfinished)? {
                    exchange(&self.unfinished, &self.target)?;
                    return Ok(Some(problem));
                }
                self.unfinished.clone()
            }
            Err(failure) if failure.kind() == io::ErrorKind::Unsupported => {
                let earlier = hidden(&self.target, REPLACED);
                fs::rename(&self.target, &earlier)?;
                let foreign = self.foreign_in(&earlier);
                if let Ok(None) = foreign
                    && let Err(failure) = fs::rename(&self.unfinished, &self.target)
                {
                    fs::rename(&earlier, &self.target)?;
                    return Err(failure);
                }
                if !matches!(foreign, Ok(None)) {
                    fs::rename(&earlier, &self.target)?;
                    return foreign;
                }
                earlier
            }
            Err(failure) => return Err(failure),
        };
        self.is_claimed = false;
        sync_folder(&parent)?;
        // The results are in place. What cannot be removed of the earlier ones the next run will remove.
        let _ = remove_contents(&earlier, self.contents);
        Ok(None)
    }

    /// Moves the results to the first free name beside their place, and says where they are: where even that
    /// fails, where they were made.
    fn move_beside(&mut self) -> PathBuf {
        if !self.is_claimed {
            return self.target.clone();
        }
        self.is_claimed = false;
        let kept = free_beside(&self.target);
        match fs::rename(&self.unfinished, &kept).and_then(|()| sync_folder(parent_of(&kept))) {
            Ok(()) => kept,
            Err(_) if kept.exists() => kept,
            Err(_) => self.unfinished.clone(),
        }
    }

    /// What stands in the way at the target, if anything does.
    fn obstacle(&self) -> io::Result<Option<Problem>> {
        let target = &self.target;
        let problem = |found: &str, advice: &str| Some(Problem::new(target, found).advice(advice));
        if fs::symlink_metadata(target).is_err() {
            return Ok(None);
        }
        if !target.is_dir() {
            return Ok(problem("a file stands there", "Choose another folder"));
        }
        if fs::read_dir(target)?.next().is_none() {
            return Ok(None);
        }
        let kind = self.contents.kind();
        if self.contents.mark_in(target).is_none() {
            return Ok(problem(&format!("it holds files that are no results of a {kind}"), "Choose another folder"));
        }
        if !self.replace {
            return Ok(problem(
                &format!("it holds an earlier {kind}"),
                "Choose another folder, or replace it with --force",
            ));
        }
        if !may_change(target) {
            return Ok(problem(
                &format!("it holds an earlier {kind} that you may not remove"),
                "Choose another folder",
            ));
        }
        self.foreign_in(target)
    }

    /// What there is in a folder of results that is no result, if there is something.
    fn foreign_in(&self, folder: &Path) -> io::Result<Option<Problem>> {
        let mut others = Vec::new();
        add_foreign(folder, "", self.contents, &mut others)?;
        others.sort();
        Ok(others.split_first().map(|(first, rest)| {
            let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
            Problem::new(&self.target, format!("it holds an earlier {}, but also {first}{more}", self.contents.kind()))
                .advice("Move what is not a result elsewhere, or choose another folder")
        }))
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        if self.is_claimed {
            let _ = fs::remove_dir_all(&self.unfinished);
        }
        // After a success the folders around it are not empty.
        for parent in &self.parents_made {
            let _ = fs::remove_dir(parent);
        }
    }
}

/// The folder that holds `path`.
fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// The first name `target-2`, `target-3`, … at which nothing stands.
#[must_use]
pub fn free_beside(target: &Path) -> PathBuf {
    let name = target.file_name().unwrap_or_default();
    let mut number = 2_u64;
    loop {
        let mut candidate = name.to_os_string();
        candidate.push(format!("-{number}"));
        let candidate = target.with_file_name(candidate);
        if fs::symlink_metadata(&candidate).is_err() {
            return candidate;
        }
        number += 1;
    }
}

/// Whether `folder` is what stands at `path`.
#[cfg(unix)]
pub(crate) fn is_at(folder: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |found: &fs::Metadata| (found.dev(), found.ino());
    matches!((folder.metadata(), fs::metadata(path)), (Ok(own), Ok(there)) if identity(&own) == identity(&there))
}

/// Whether `folder` is what stands at `path`: elsewhere, folders that are open cannot be moved.
#[cfg(not(unix))]
pub(crate) fn is_at(_folder: &File, path: &Path) -> bool {
    path.exists()
}

/// Puts the entries of a folder and of those in it on the disk.
fn sync_folders(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_folders(&entry.path())?;
        }
    }
    sync_folder(folder)
}

/// Removes results and the folder that holds them; the mark first, so that what is left is not taken for a whole.
///
/// # Errors
/// When something else is in it, which stays, or the system refuses.
fn remove_contents(folder: &Path, contents: Contents) -> io::Result<()> {
    match fs::remove_file(folder.join(contents.mark())) {
        Err(failure) if failure.kind() != io::ErrorKind::NotFound => Err(failure),
        _ => remove_within(folder, "", contents).and_then(|()| fs::remove_dir(folder)),
    }
}

fn remove_within(folder: &Path, prefix: &str, contents: Contents) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if !entry.file_type()?.is_dir() {
            if contents.include(&name) {
                fs::remove_file(entry.path())?;
            }
        } else if contents.include_folder(&name) {
            remove_within(&entry.path(), &format!("{name}/"), contents)?;
            fs::remove_dir(entry.path())?;
        }
    }
    Ok(())
}

/// The folders beside `target` that earlier attempts left, also those that are called after a process.
fn left_over(target: &Path, parent: &Path, purpose: &str) -> Vec<PathBuf> {
    let (plain, prefix) = (hidden(target, purpose), sibling_prefix(target, purpose));
    let entries = fs::read_dir(parent).into_iter().flatten().flatten();
    let by_process = entries.filter(|entry| {
        let name = entry.file_name();
        let process = name.as_encoded_bytes().strip_prefix(prefix.as_encoded_bytes());
        process.is_some_and(|process| !process.is_empty() && process.iter().all(u8::is_ascii_digit))
    });
    let mut found: Vec<PathBuf> = by_process.map(|entry| entry.path()).collect();
    found.sort();
    found.extend(plain.is_dir().then_some(plain));
    found
}

/// Appends the names of what is in a folder, at any depth, and is no result; each behind `prefix`.
fn add_foreign(folder: &Path, prefix: &str, contents: Contents, names: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let is_folder = entry.file_type()?.is_dir();
        if is_folder && contents.include_folder(&name) {
            add_foreign(&entry.path(), &format!("{name}/"), contents, names)?;
        } else if is_folder || !contents.include(&name) {
            names.push(name);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complete(target: &Path, what: &str) -> RunFolder {
        let run = RunFolder::create(target, Contents::Run, true).unwrap();
        let mark = serde_json::json!({"what": Contents::Run.what(), "of": what});
        fs::write(run.path().join("report.json"), mark.to_string()).unwrap();
        run
    }

    fn of(target: &Path) -> Value {
        Contents::Run.mark_in(target).unwrap()["of"].clone()
    }

    #[test]
    fn where_folders_cannot_change_places_the_earlier_one_is_moved_away_and_back() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("run");
        complete(&target, "first").finish().unwrap();
        let unsupported = |_: &Path, _: &Path| Err(io::ErrorKind::Unsupported.into());
        assert!(complete(&target, "second").settle_by(unsupported).unwrap().is_none());
        assert_eq!(of(&target), "second");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        // The system refuses the second move: nothing has changed.
        let mut third = complete(&target, "third");
        let vanishes = |unfinished: &Path, _: &Path| -> io::Result<()> {
            fs::remove_dir_all(unfinished)?;
            Err(io::ErrorKind::Unsupported.into())
        };
        assert!(third.settle_by(vanishes).is_err());
        assert_eq!(of(&target), "second");
    }

    #[test]
    fn what_comes_between_the_last_look_and_the_move_stays() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("run");
        complete(&target, "first").finish().unwrap();
        for supported in [true, false] {
            let mut second = complete(&target, "second");
            let meanwhile = |unfinished: &Path, target: &Path| {
                fs::write(target.join("thesis.txt"), "mine")?;
                if supported { exchange(unfinished, target) } else { Err(io::ErrorKind::Unsupported.into()) }
            };
            let problem = second.settle_by(meanwhile).unwrap().unwrap();
            assert!(problem.found.contains("thesis.txt"), "{problem}");
            assert_eq!(of(&target), "first");
            fs::remove_file(target.join("thesis.txt")).unwrap();
        }
    }
}
