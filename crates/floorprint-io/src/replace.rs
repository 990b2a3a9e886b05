//! Files that appear whole or not at all.

use crate::error::WriteError;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes the file at `path` beside it under another name and then moves it into place, so that
/// whoever reads it sees the old content or the new, and a failure leaves nothing half-written.
///
/// A link stays: the file that it leads to is replaced. A device or a pipe cannot be replaced: it is
/// written to as it is.
pub(crate) fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let result = if fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        write_all(path, write).map(drop)
    } else {
        let target = behind_links(path);
        let unfinished = sibling(&target, "unfinished");
        // Some file systems tell only when asked to sync that the disk is full.
        let written = write_all(&unfinished, write).and_then(|file| file.sync_all());
        let result = written.and_then(|()| fs::rename(&unfinished, &target));
        if result.is_err() {
            // The failure that is reported is the first one; the leftover may not even exist.
            let _ = fs::remove_file(&unfinished);
        }
        result.and_then(|()| sync_folder(target.parent().unwrap_or(Path::new(""))))
    };
    result.map_err(|error| WriteError::io(path, &error))
}

/// Puts a folder's list of entries on the disk, so that what was moved there is there after a power cut.
///
/// Where the system cannot open folders or the file system cannot sync them there is nothing to do.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(failure) if failure.kind() == io::ErrorKind::InvalidInput || cfg!(not(unix)) => Ok(()),
        // A folder that may be written to but not listed.
        Err(failure) if failure.kind() == io::ErrorKind::PermissionDenied => Ok(()),
        result => result,
    }
}

/// What a path leads to, also where there is nothing yet.
pub(crate) fn behind_links(path: &Path) -> PathBuf {
    let missing = || fs::read_link(path).map_or_else(|_| path.to_path_buf(), |to| path.with_file_name("").join(to));
    fs::canonicalize(path).unwrap_or_else(|_| missing())
}

/// Writes several files; none is replaced before all of them are whole on the disk.
///
/// # Errors
/// When a file cannot be written: those are then as they were that come later in the list.
pub fn write_files(files: &[(&Path, &[u8])]) -> Result<(), WriteError> {
    let targets: Vec<PathBuf> = files.iter().map(|(path, _)| behind_links(path)).collect();
    let mut result = Ok(());
    for (target, (path, bytes)) in targets.iter().zip(files) {
        let written = write_all(&sibling(target, "unfinished"), |file| file.write_all(bytes));
        result = written.and_then(|file| file.sync_all()).map_err(|error| WriteError::io(path, &error));
        if result.is_err() {
            break;
        }
    }
    for (target, (path, _)) in targets.iter().zip(files) {
        let unfinished = sibling(target, "unfinished");
        match &result {
            Ok(()) => {
                let moved = fs::rename(&unfinished, target);
                let moved = moved.and_then(|()| sync_folder(target.parent().unwrap_or(Path::new(""))));
                result = moved.map_err(|error| WriteError::io(path, &error));
            }
            // The failure that is reported is the first one; the leftover may not even exist.
            Err(_) => _ = fs::remove_file(&unfinished),
        }
    }
    result
}

/// Writes `bytes` as the file at `path`, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    replace_file(path, |file| file.write_all(bytes))
}

/// Makes a copy of a whole file, which is on the disk when this returns.
///
/// # Errors
/// When the file cannot be read, or `copy` cannot be written or exists.
pub fn copy_file(path: &Path, copy: &Path) -> Result<(), WriteError> {
    let copied = File::create_new(copy).and_then(|mut file| {
        io::copy(&mut File::open(path)?, &mut file)?;
        file.sync_all()
    });
    copied.map_err(|error| WriteError::io(copy, &error))
}

fn write_all(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<File> {
    let mut writer = BufWriter::with_capacity(1 << 16, File::create(path)?);
    write(&mut writer)?;
    Ok(writer.into_inner()?)
}

/// A hidden name beside `path`, the same for every process.
pub(crate) fn hidden(path: &Path, purpose: &str) -> PathBuf {
    path.with_file_name(hidden_name(path, purpose))
}

/// A name beside `path` that no one else uses: hidden, with the process's number.
pub(crate) fn sibling(path: &Path, purpose: &str) -> PathBuf {
    let mut name = sibling_prefix(path, purpose);
    name.push(std::process::id().to_string());
    path.with_file_name(name)
}

/// How the names of [`sibling`]s begin, whatever the process.
pub(crate) fn sibling_prefix(path: &Path, purpose: &str) -> OsString {
    let mut name = hidden_name(path, purpose);
    name.push("-");
    name
}

fn hidden_name(path: &Path, purpose: &str) -> OsString {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{purpose}"));
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_leaves_the_old_file_and_says_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.pgm");
        write_file(&path, b"old").unwrap();
        let error = replace_file(&path, |file| {
            file.write_all(&[0; 1 << 17])?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert!(error.problem().advice.contains("space"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_and_pipes_stay_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link, pipe) = (folder.path().join("file"), folder.path().join("link"), folder.path().join("pipe"));
        fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_file(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        // Also one that leads to where nothing is yet, named from its own folder.
        fs::remove_file(&file).unwrap();
        fs::remove_file(&link).unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        write_file(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");

        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_file(&pipe, b"through").unwrap();
        assert!(!pipe.metadata().unwrap().is_file());
        assert_eq!(reader.join().unwrap(), b"through");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
