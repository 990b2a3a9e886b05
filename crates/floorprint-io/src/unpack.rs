//! Input that is no file of its own yet: archives are unpacked, and standard input is put away, for as long as a data
//! set is open.

use crate::budget::Budget;
use crate::data_set::OpenOptions;
use crate::error::{Problem, ReadError};
use crate::scratch_folder::ScratchFolder;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// The name of standard input as a path.
pub(crate) const STANDARD_INPUT: &str = "-";

/// Standard input counts as a file of this size: what it may unpack to is what it may be, bytes.
const STANDARD_INPUT_BYTES: f64 = 256e6;

/// Bytes unpacked at a time.
const PIECE: usize = 1 << 16;

/// Files that the user did not name, in folders that are removed with this value.
#[derive(Debug)]
pub(crate) struct Unpacked {
    folders: Vec<ScratchFolder>,
    /// Where the data set is.
    pub(crate) path: PathBuf,
}

impl Unpacked {
    /// All of standard input as a file.
    pub(crate) fn standard_input(options: &OpenOptions) -> Result<Self, ReadError> {
        let most_bytes = options.max_expansion * STANDARD_INPUT_BYTES;
        Self::copied(&mut io::stdin().lock(), most_bytes as u64)
    }

    /// All that `reader` gives as a file, if that is at most so much.
    fn copied(reader: &mut dyn Read, most_bytes: u64) -> Result<Self, ReadError> {
        let refused = |error: io::Error| ReadError::io(Path::new(STANDARD_INPUT), &error);
        let folder = ScratchFolder::create().map_err(refused)?;
        let path = folder.path().join("standard input");
        let mut file = File::create(&path).map_err(refused)?;
        if io::copy(&mut reader.take(most_bytes), &mut file).map_err(refused)? == most_bytes
            && reader.read(&mut [0]).map_err(refused)? > 0
        {
            let found = format!("it goes on after {:.0} MB", most_bytes as f64 / 1e6);
            return Err(Problem::new(Path::new(STANDARD_INPUT), found)
                .expected("a recorded data set, which ends")
                .advice("Name the file instead, or allow more with --max-expansion")
                .into());
        }
        Ok(Self { folders: vec![folder], path })
    }

    /// What is in the archive at `path`, with its folders; hidden files and those of macOS's finder are left out.
    ///
    /// Names that lead out of the archive are refused, and so is what grows beyond the options' bounds.
    pub(crate) fn archive(path: &Path, options: &OpenOptions) -> Result<Self, ReadError> {
        let refused = |error: io::Error| ReadError::io(path, &error);
        let file = File::open(path).map_err(refused)?;
        let packed_bytes = file.metadata().map_err(refused)?.len();
        let budget = Budget::new(usize::try_from(packed_bytes).unwrap_or(usize::MAX), options.max_expansion);
        Self::archive_within(path, file, budget)
    }

    fn archive_within(path: &Path, file: File, mut budget: Budget) -> Result<Self, ReadError> {
        let refused = |error: io::Error| ReadError::io(path, &error);
        let whole = "a whole zip archive, stored or deflated";
        let broken = |place: String, found: String| Problem::new(path, found).at(place).expected(whole);
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| {
            broken(String::new(), error.to_string()).advice("It may have been cut off: fetch it again")
        })?;
        let folder = ScratchFolder::create().map_err(refused)?;
        let mut piece = vec![0; PIECE];
        for index in 0..archive.len() {
            let mut entry =
                archive.by_index(index).map_err(|error| broken(format!("file {}", index + 1), error.to_string()))?;
            let place = format!("file {}", entry.name().unwrap_or_default());
            let Some(inner) = entry.enclosed_name() else {
                return Err(broken(place, "a name that leads out of the archive".to_owned()).into());
            };
            if entry.is_dir() || is_hidden(&inner) {
                continue;
            }
            let target = folder.path().join(&inner);
            let write = |error: io::Error| {
                ReadError::from(
                    Problem::new(path, format!("it cannot be unpacked: {error}"))
                        .at(place.clone())
                        .advice("TMPDIR says where; it needs room for all of the archive"),
                )
            };
            fs::create_dir_all(target.parent().unwrap_or(folder.path())).map_err(write)?;
            let mut file = File::create(&target).map_err(write)?;
            loop {
                let count =
                    entry.read(&mut piece).map_err(|error| broken(place.clone(), format!("damaged ({error})")))?;
                if count == 0 {
                    break;
                }
                budget.take::<u8>(count).ok_or_else(|| budget.exceeded(path).at(place.clone()))?;
                file.write_all(&piece[..count]).map_err(write)?;
            }
        }
        let path = only_entry(folder.path()).map_err(refused)?;
        Ok(Self { folders: vec![folder], path })
    }

    /// Keeps what was unpacked out of this as long as this.
    pub(crate) fn around(mut self, inner: Option<Self>) -> Self {
        self.folders.extend(inner.into_iter().flat_map(|inner| inner.folders));
        self
    }

    /// The same error about what the user named.
    pub(crate) fn named(&self, error: &ReadError, path: &Path) -> ReadError {
        let mut problem = error.problem().clone();
        for folder in &self.folders {
            if let Ok(inner) = problem.file.strip_prefix(folder.path()) {
                problem.file = if path == Path::new(STANDARD_INPUT) { path.to_path_buf() } else { path.join(inner) };
            }
            let own = format!("{}/", folder.path().display());
            for text in [&mut problem.found, &mut problem.expected, &mut problem.advice] {
                *text = text.replace(&own, "");
            }
        }
        problem.into()
    }
}

fn is_hidden(path: &Path) -> bool {
    path.iter().any(|part| part.as_encoded_bytes().starts_with(b".") || part == "__MACOSX")
}

/// The folder itself, or what is in it as long as that is one thing.
fn only_entry(folder: &Path) -> io::Result<PathBuf> {
    let mut path = folder.to_path_buf();
    while path.is_dir() {
        let mut entries = fs::read_dir(&path)?;
        match (entries.next(), entries.next()) {
            (Some(only), None) => path = only?.path(),
            _ => break,
        }
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use zip::write::SimpleFileOptions;

    fn archive(entries: &[(&str, &[u8])]) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut writer = zip::ZipWriter::new(file.reopen().unwrap());
        for (name, bytes) in entries {
            writer.start_file(*name, SimpleFileOptions::default()).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap();
        file
    }

    #[test]
    fn archives_are_unpacked_down_to_where_something_is_and_vanish() {
        let packed = archive(&[
            ("drives/data/Encoders20.npz", b"e"),
            ("drives/data/Imu20.npz", b"i"),
            ("__MACOSX/drives/data/._Imu20.npz", b"?"),
        ]);
        let unpacked = Unpacked::archive(packed.path(), &OpenOptions::default()).unwrap();
        assert!(unpacked.path.ends_with("drives/data"));
        assert_eq!(fs::read(unpacked.path.join("Imu20.npz")).unwrap(), b"i");
        let inside: ReadError = Problem::new(&unpacked.path.join("Imu20.npz"), "broken").into();
        let named = unpacked.named(&inside, Path::new("drives.zip")).to_string();
        assert!(named.contains("drives.zip/drives/data/Imu20.npz: broken"), "{named}");
        let path = unpacked.path.clone();
        drop(unpacked);
        assert!(!path.exists());
    }

    #[test]
    fn bombs_ways_out_and_damage_are_refused() {
        let options = OpenOptions::default();
        let bomb = archive(&[("a.npz", &vec![0; 3 << 20])]);
        let error = Unpacked::archive_within(bomb.path(), bomb.reopen().unwrap(), Budget::of(2_000_000)).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("file a.npz: 0.0 MB that unpack to more than 2 MB"), "{error}");
        assert!(error.contains("--max-expansion"), "{error}");
        assert!(Unpacked::archive_within(bomb.path(), bomb.reopen().unwrap(), Budget::of(4_000_000)).is_ok());
        let error = Unpacked::archive(archive(&[("../a.npz", b"a")]).path(), &options).unwrap_err().to_string();
        assert!(error.contains("leads out of the archive"), "{error}");
        let whole = fs::read(archive(&[("a.npz", b"some bytes")]).path()).unwrap();
        let cut = tempfile::NamedTempFile::new().unwrap();
        fs::write(cut.path(), &whole[..whole.len() / 2]).unwrap();
        assert!(Unpacked::archive(cut.path(), &options).unwrap_err().to_string().contains("cut off"));
    }

    #[test]
    fn what_comes_in_is_a_file() {
        let unpacked = Unpacked::copied(&mut &b"FLASER"[..], 6).unwrap();
        assert_eq!(fs::read(&unpacked.path).unwrap(), b"FLASER");
        let inside: ReadError = Problem::new(&unpacked.path, "its content is of no known format").into();
        let named = unpacked.named(&inside, Path::new("-")).to_string();
        assert_eq!(named, "cannot read -: its content is of no known format");
    }

    #[test]
    fn what_comes_in_without_end_is_refused() {
        let error = Unpacked::copied(&mut io::repeat(0), 3_000_000).unwrap_err().to_string();
        assert!(error.contains("it goes on after 3 MB") && error.contains("--max-expansion"), "{error}");
    }
}
