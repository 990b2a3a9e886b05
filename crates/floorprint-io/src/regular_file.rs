//! Files that are read whole: never a pipe or a device, which may keep a reader waiting for ever.

use crate::error::{Problem, ReadError};
use std::fs;
use std::io;
use std::path::Path;

/// The bytes of the file at `path`.
pub(crate) fn read_regular(path: &Path) -> Result<Vec<u8>, ReadError> {
    let failed = |error: io::Error| ReadError::io(path, &error);
    // Where the shell puts the output of another program, which ends.
    let is_given_by_shell = path.starts_with("/dev/fd") || path.starts_with("/proc/self/fd");
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() && !metadata.is_dir() && !is_given_by_shell {
        return Err(Problem::new(path, "a pipe or a device").expected("a file").into());
    }
    fs::read(path).map_err(failed)
}

/// The text in the file at `path`.
///
/// # Errors
/// When it cannot be read, is a pipe or a device, or is no text in UTF-8.
pub fn read_text(path: &Path) -> Result<String, ReadError> {
    String::from_utf8(read_regular(path)?).map_err(|error| {
        Problem::new(path, "bytes that are no text")
            .at(format!("byte {}", error.utf8_error().valid_up_to()))
            .expected("text in UTF-8")
            .into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        for path in [pipe.as_path(), Path::new("/dev/zero")] {
            let error = read_regular(path).unwrap_err();
            assert!(error.to_string().contains("a pipe or a device"), "{error}");
        }
    }

    #[test]
    fn what_is_no_text_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.yaml");
        fs::write(&path, b"image\xff").unwrap();
        assert_eq!(read_text(&path).unwrap_err().problem().place, "byte 5");
    }
}
