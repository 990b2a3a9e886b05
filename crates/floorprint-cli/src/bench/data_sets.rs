//! Finds data sets below folders and gives each a name of its own.

use super::run::count_wrong;
use crate::run_folder::data_set_name;
use crate::truth::TruthFiles;
use anyhow::{Context as _, bail};
use floorprint::evaluation::StampIndex;
use floorprint_io::read_trajectory;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// How the names of data sets end that are one file, before `.gz`.
const ENDINGS: [&str; 6] = [".clf", ".log", ".dat", ".bag", ".mcap", ".db3"];

/// A data set to measure on.
#[derive(Debug, PartialEq)]
pub(crate) struct DataSet {
    /// Where it lies.
    pub(crate) path: PathBuf,
    /// What it is called; no two have the same name.
    pub(crate) name: String,
}

impl DataSet {
    /// How many of a run's loop closures are off the true trajectory that lies beside the data; `None`
    /// where there is none.
    ///
    /// # Errors
    /// The true trajectory cannot be read.
    pub(super) fn wrong_closures(&self, report: &Value) -> anyhow::Result<Option<usize>> {
        let Some(path) = TruthFiles::beside(&self.path).trajectory else { return Ok(None) };
        let poses = read_trajectory(&path)?;
        let truth = StampIndex::new(&poses);
        let candidates = report.pointer("/loops/candidates");
        Ok(candidates.and_then(|found| count_wrong(found, |stamp_s| truth.interpolated(stamp_s, 1e-4, 0.5))))
    }
}

/// The data sets at these paths or below them, in the order of their names.
///
/// # Errors
/// A path does not exist or a folder cannot be listed.
pub(crate) fn find(paths: &[PathBuf]) -> anyhow::Result<Vec<DataSet>> {
    let mut found = Vec::new();
    for path in paths {
        if !path.exists() {
            bail!("cannot read {}: there is no such file or folder", path.display());
        }
        let before = found.len();
        look_into(path, &mut found).with_context(|| format!("cannot look into {}", path.display()))?;
        if found.len() == before {
            let (last, others) = ENDINGS.split_last().unwrap_or((&"", &[]));
            let (path, others) = (path.display(), others.join(", "));
            bail!(
                "no data sets in {path}; expected {others} or {last} files (also .gz), or folders of ECE276A or rosbag2"
            );
        }
    }
    let mut data_sets: Vec<DataSet> = Vec::new();
    for path in found {
        let plain = data_set_name(&path);
        let mut name = plain.clone();
        let mut number = 2;
        while data_sets.iter().any(|other| other.name == name) {
            name = format!("{plain}-{number}");
            number += 1;
        }
        data_sets.push(DataSet { path, name });
    }
    Ok(data_sets)
}

/// Appends the data sets at `path` or below it, in the order of their names.
fn look_into(path: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !path.is_dir() {
        found.push(path.to_path_buf());
        return Ok(());
    }
    let mut entries: Vec<PathBuf> =
        fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    entries.sort();
    let name = |entry: &Path| entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_course = entries.iter().any(|entry| name(entry).starts_with("Hokuyo"));
    if is_course || entries.iter().any(|entry| name(entry) == "metadata.yaml") {
        found.push(path.to_path_buf());
        return Ok(());
    }
    for entry in entries {
        let name = name(&entry);
        let log = name.strip_suffix(".gz").unwrap_or(&name);
        if entry.is_dir() {
            look_into(&entry, found)?;
        } else if ENDINGS.iter().any(|ending| log.ends_with(ending)) {
            found.push(entry);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_are_found_at_any_depth_and_have_names_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        for name in
            ["a/drive.clf", "b/drive.clf.gz", "b/notes.txt", "c/Hokuyo1.npz", "d/metadata.yaml", "d/d_0.mcap", "e.bag"]
        {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let names: Vec<String> =
            find(&[folder.path().to_path_buf()]).unwrap().into_iter().map(|data_set| data_set.name).collect();
        assert_eq!(names, ["drive", "drive-2", "c", "d", "e"]);
        let empty = folder.path().join("empty");
        fs::create_dir(&empty).unwrap();
        let error = find(&[empty]).unwrap_err().to_string();
        for expected in ENDINGS.iter().chain(&["ECE276A", "rosbag2"]) {
            assert!(error.contains(expected), "{error}");
        }
        let message = find(&[folder.path().join("f")]).unwrap_err().to_string();
        assert!(message.contains("no such file"), "{message}");
    }
}
