//! One process at a time works on a file.

use crate::error::{Problem, WriteError};
use crate::replace::{behind_links, hidden};
use crate::run_folder::is_at;
use std::fs::{self, File, TryLockError};
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

/// A claim to a file, as long as it lives; it ends with the process, however that ends.
///
/// It is a lock on a hidden file beside it: SQLite has locks of its own on the files that it writes.
#[derive(Debug)]
pub struct FileLock {
    path: PathBuf,
    _file: File,
}

impl FileLock {
    /// Claims the file at `path`, which need not exist yet. `None` where the file system knows no locks.
    ///
    /// # Errors
    /// Another process has it, which is told; nothing can be written there.
    pub fn claim(path: &Path) -> Result<Option<Self>, WriteError> {
        let lock_path = hidden(&behind_links(path), "lock");
        let refused = |error| WriteError::io(path, &error);
        loop {
            let mut file = File::options()
                .create(true)
                .truncate(false)
                .read(true)
                .write(true)
                .open(&lock_path)
                .map_err(refused)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::Error(_)) => return Ok(None),
                Err(TryLockError::WouldBlock) => {
                    let mut owner = String::new();
                    let _ = file.read_to_string(&mut owner);
                    let process = if owner.is_empty() { String::new() } else { format!(" (number {})", owner.trim()) };
                    return Err(Problem::new(path, format!("another process{process} works on it"))
                        .advice("End that one first, or choose another file")
                        .into());
                }
            }
            // Whoever had it may have removed it in between.
            if !is_at(&file, &lock_path) {
                continue;
            }
            let _ = file.set_len(0).and_then(|()| write!(file, "{}", std::process::id()));
            return Ok(Some(Self { path: lock_path, _file: file }));
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // Removed while it is held, so that nobody else's is.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_claimed_once_and_again_when_it_is_free() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("site.gpkg");
        let lock = FileLock::claim(&path).unwrap().unwrap();
        let error = FileLock::claim(&path).unwrap_err().to_string();
        assert!(error.contains("site.gpkg") && error.contains(&std::process::id().to_string()), "{error}");
        drop(lock);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(FileLock::claim(&path).unwrap().is_some());
    }
}
