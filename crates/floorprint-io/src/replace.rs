//! Files that appear whole or not at all.

use crate::error::WriteError;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes the file at `path` beside it under another name and then moves it into place, so that
/// whoever reads it sees the old content or the new, and a failure leaves nothing half-written.
pub(crate) fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let unfinished = sibling(path, "unfinished");
    let result = write_all(&unfinished, write).and_then(|()| fs::rename(&unfinished, path));
    if result.is_err() {
        // The failure that is reported is the first one; the leftover may not even exist.
        let _ = fs::remove_file(&unfinished);
    }
    result.map_err(|error| WriteError::io(path, &error))
}

/// Writes `bytes` as the file at `path`, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    replace_file(path, |file| file.write_all(bytes))
}

fn write_all(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 16, File::create(path)?);
    write(&mut writer)?;
    // Some file systems tell only now that the disk is full.
    writer.into_inner()?.sync_all()
}

/// A name beside `path` that no one else uses: hidden, with the process's number.
pub(crate) fn sibling(path: &Path, purpose: &str) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{purpose}-{}", std::process::id()));
    path.with_file_name(name)
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
}
