//! A file for what a session does not need in memory now.

use crate::error::WriteError;
use floorprint::storage::{Store, StoreError};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Lengths are rounded up to a multiple of this, so that what is freed is of use for others, bytes.
const GRAIN: usize = 1024;

/// A file without a name: the system takes it away when the process ends, however that ends.
#[derive(Debug)]
pub struct ScratchFile {
    /// The folder on whose disk it lies, for messages.
    folder: PathBuf,
    file: File,
    end: u64,
    /// Where room was freed, by how much.
    free: BTreeMap<usize, Vec<u64>>,
}

impl ScratchFile {
    /// Makes the file on the disk of a folder.
    ///
    /// # Errors
    /// When it cannot be made there.
    pub fn create_in(folder: &Path) -> Result<Self, WriteError> {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let file = tempfile::tempfile_in(folder).map_err(|error| WriteError::io(folder, &error))?;
        Ok(Self { folder: folder.to_path_buf(), file, end: 0, free: BTreeMap::new() })
    }

    fn write(&mut self, at: u64, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(at))?;
        self.file.write_all(bytes)
    }

    fn read(&mut self, at: u64, length: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

impl Store for ScratchFile {
    fn put(&mut self, bytes: &[u8]) -> Result<u64, StoreError> {
        let room = bytes.len().next_multiple_of(GRAIN);
        let freed = self.free.get_mut(&room).and_then(Vec::pop);
        let at = freed.unwrap_or(self.end);
        self.write(at, bytes).map_err(|error| StoreError(WriteError::io(&self.folder, &error).to_string()))?;
        if freed.is_none() {
            self.end += room as u64;
        }
        Ok(at)
    }

    fn get(&mut self, key: u64, length: usize) -> Result<Vec<u8>, StoreError> {
        self.read(key, length).map_err(|error| {
            StoreError(format!("what was put away in {} cannot be read: {error}", self.folder.display()))
        })
    }

    fn free(&mut self, key: u64, length: usize) {
        self.free.entry(length.next_multiple_of(GRAIN)).or_default().push(key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_put_away_comes_back_and_freed_room_is_used_again() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = ScratchFile::create_in(folder.path()).unwrap();
        let piece = |number: usize| vec![number as u8; 100 + 700 * number];
        let keys: Vec<u64> = (0..5).map(|number| file.put(&piece(number)).unwrap()).collect();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the file has no name");
        file.free(keys[3], piece(3).len());
        let end = file.end;
        let again = file.put(&[9; 2100]).unwrap();
        assert_eq!((again, file.end), (keys[3], end));
        for number in [4, 0, 2, 1] {
            assert_eq!(file.get(keys[number], piece(number).len()).unwrap(), piece(number));
        }
        assert_eq!(file.get(again, 2100).unwrap(), [9; 2100]);
        assert!(file.get(end, 1).is_err());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_told() {
        let mut file = ScratchFile::create_in(Path::new("")).unwrap();
        file.file = File::options().read(true).write(true).open("/dev/full").unwrap();
        let StoreError(why) = file.put(&[1; 10]).unwrap_err();
        assert!(why.contains("Free some space"), "{why}");
    }
}
