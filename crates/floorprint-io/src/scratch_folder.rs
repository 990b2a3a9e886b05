//! Folders for what is unpacked.

use crate::run_folder::is_at;
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::TempDir;

/// How their names begin.
const PREFIX: &str = "floorprint-unpacked-";

/// Those of this process.
static OWN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// A folder in the system's place for such things (TMPDIR) that is removed with this value.
///
/// It is locked as long as it is used: one whose process was killed is removed when the next is made.
#[derive(Debug)]
pub(crate) struct ScratchFolder {
    folder: TempDir,
    /// None where the file system knows no locks.
    _lock: Option<File>,
}

impl ScratchFolder {
    /// Makes an empty folder.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(crate) fn create() -> io::Result<Self> {
        Self::create_in(&std::env::temp_dir())
    }

    fn create_in(parent: &Path) -> io::Result<Self> {
        remove_abandoned(parent);
        loop {
            let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(parent)?;
            // Where folders cannot be opened they cannot be locked.
            let lock = match File::open(folder.path()).map(|lock| lock.try_lock().map(|()| lock)) {
                Ok(Ok(lock)) => Some(lock),
                // Another process took it for abandoned before it was locked.
                Ok(Err(TryLockError::WouldBlock)) => continue,
                Ok(Err(TryLockError::Error(_))) | Err(_) => None,
            };
            if lock.as_ref().is_some_and(|lock| !is_at(lock, folder.path())) {
                continue;
            }
            own(|folders| folders.insert(folder.path().to_path_buf()));
            return Ok(Self { folder, _lock: lock });
        }
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }
}

impl Drop for ScratchFolder {
    fn drop(&mut self) {
        own(|folders| folders.remove(self.folder.path()));
    }
}

/// Removes what this process has unpacked, for one that ends at once: what it still works on cannot be read any more.
pub fn remove_unpacked() {
    own(|folders| {
        for folder in std::mem::take(folders) {
            // What cannot be removed now the next process will remove.
            let _ = fs::remove_dir_all(folder);
        }
    });
}

fn own<T>(work: impl FnOnce(&mut BTreeSet<PathBuf>) -> T) -> T {
    work(&mut OWN.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Removes folders whose process is gone.
fn remove_abandoned(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let is_ours = entry.file_name().as_encoded_bytes().starts_with(PREFIX.as_bytes());
        if is_ours
            && entry.file_type().is_ok_and(|kind| kind.is_dir())
            && let Ok(lock) = File::open(entry.path())
            && lock.try_lock().is_ok()
        {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn what_a_killed_process_left_goes_and_what_is_used_stays() {
        let parent = tempfile::tempdir().unwrap();
        let abandoned = parent.path().join(format!("{PREFIX}a1b2c3"));
        fs::create_dir_all(abandoned.join("data")).unwrap();
        fs::write(abandoned.join("data/log.clf"), "FLASER").unwrap();
        let (other, file) = (parent.path().join("other"), parent.path().join(format!("{PREFIX}file")));
        fs::create_dir(&other).unwrap();
        fs::write(&file, "no folder").unwrap();
        let link = parent.path().join(format!("{PREFIX}link"));
        std::os::unix::fs::symlink(&other, &link).unwrap();
        let one = ScratchFolder::create_in(parent.path()).unwrap();
        let two = ScratchFolder::create_in(parent.path()).unwrap();
        assert!(!abandoned.exists() && other.exists() && file.exists() && link.is_symlink());
        assert!(one.path().exists() && two.path().exists());
        let path = one.path().to_path_buf();
        drop(one);
        assert!(!path.exists() && two.path().exists());
    }
}
