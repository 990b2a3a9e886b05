//! `floorprint compare`: runs beside each other on one page.

mod page;

use crate::outcome::{BadArguments, Outcome};
use crate::solved::unknown_ground;
use crate::terminal::Terminal;
use anyhow::{Context as _, ensure};
use clap::Args;
use floorprint::evaluation::{PoseError, StampIndex};
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint_io::{Contents, read_map, read_text, read_trajectory, write_file};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Table;

/// Compare runs on a page: maps that blink over each other, trajectories, errors over time and by stretch, figures, and
/// what is different in the configurations.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folders of runs; the first is what the others are compared with.
    #[arg(required = true, num_args = 2.., value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// TUM file of true poses, to compare all of them with.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Page to write.
    #[arg(long, value_name = "FILE", default_value = "compare.html")]
    out: PathBuf,
}

/// A run as its folder tells of it.
pub(crate) struct Run {
    name: String,
    pub(crate) report: Value,
    pub(crate) map: Raster<Occupancy>,
    pub(crate) trajectory: Vec<StampedPose>,
    /// The configuration, option by option.
    options: BTreeMap<String, String>,
}

/// Runs that are compared are told apart by colours and numbers.
const MOST_RUNS: usize = 8;
/// Poses are compared with those of another trajectory that are no farther apart in time than these, seconds.
const SAME_S: f64 = 1e-4;
const LARGEST_GAP_S: f64 = 0.5;

/// Runs `floorprint compare`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    if arguments.runs.len() > MOST_RUNS {
        let count = arguments.runs.len();
        return Err(BadArguments(format!("{count} runs: more than {MOST_RUNS} cannot be told apart on a page")).into());
    }
    let mut runs: Vec<Run> = arguments.runs.iter().map(|folder| Run::read(folder)).collect::<anyhow::Result<_>>()?;
    runs.iter_mut().zip(names(&arguments.runs)).for_each(|(run, name)| run.name = name);
    let truth = arguments.truth.as_deref().map(read_trajectory).transpose()?;
    write_file(&arguments.out, page::page(&runs, truth.as_deref())?.as_bytes())?;
    terminal.say(&format!("comparison  {}", arguments.out.display()));
    Ok(Outcome::Fine)
}

/// How far each pose is from another trajectory at its time: stamp in seconds, metres, degrees. Poses at whose time the
/// other one tells nothing are left out.
#[must_use]
pub fn distances(trajectory: &[StampedPose], other: &StampIndex) -> Vec<[f64; 3]> {
    let distance = |StampedPose { stamp_s, pose }: &StampedPose| {
        let error = PoseError::between(&other.interpolated(*stamp_s, SAME_S, LARGEST_GAP_S)?, pose);
        Some([*stamp_s, error.translation_m, error.rotation_deg])
    };
    trajectory.iter().filter_map(distance).collect()
}

impl Run {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// It is none, or a file in it is missing or damaged.
    pub(crate) fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join("report.json");
        let text = read_text(&path).with_context(|| format!("{} is no folder of a run", folder.display()))?;
        let report: Value = serde_json::from_str(&text).with_context(|| format!("cannot read {}", path.display()))?;
        let is_run = report.get("what").and_then(Value::as_str) == Some(Contents::Run.what());
        ensure!(is_run, "{} is no folder of a run: what is in it was made by another command", folder.display());
        let path = folder.join("config.toml");
        let table: Table = read_text(&path)?.parse().with_context(|| format!("cannot read {}", path.display()))?;
        let mut options = BTreeMap::new();
        flatten("", &table, &mut options);
        let trajectory = read_trajectory(&folder.join("trajectory.tum"))?;
        // Dead reckoning has no map.
        let map = match report.get("map") {
            Some(_) => read_map(&folder.join("map.yaml"))?,
            None => unknown_ground(&trajectory),
        };
        Ok(Self { name: String::new(), report, map, trajectory, options })
    }
}

/// What runs are called: the end of each folder's path by which it differs from all others.
fn names(folders: &[PathBuf]) -> Vec<String> {
    let parts = |folder: &PathBuf| -> Vec<String> {
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        folder.iter().map(|part| part.to_string_lossy().into_owned()).collect()
    };
    let paths: Vec<Vec<String>> = folders.iter().map(parts).collect();
    let end = |path: &[String], length: usize| path[path.len().saturating_sub(length)..].join("/");
    let name = |path: &Vec<String>| {
        let is_alone =
            |length: &usize| paths.iter().filter(|other| end(other, *length) == end(path, *length)).count() == 1;
        // A folder that is named twice has its whole path twice.
        end(path, (1..path.len()).find(is_alone).unwrap_or(1))
    };
    paths.iter().map(name).collect()
}

/// Every option of a configuration by its dotted key.
fn flatten(prefix: &str, table: &Table, options: &mut BTreeMap<String, String>) {
    for (key, value) in table {
        let key = format!("{prefix}{key}");
        match value {
            toml::Value::Table(table) => flatten(&format!("{key}."), table, options),
            value => _ = options.insert(key, value.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_called_by_what_tells_them_apart() {
        let names_of = |folders: &[&str]| names(&folders.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(names_of(&["/a/fast/drive", "/a/seed/drive", "/b/other"]), ["fast/drive", "seed/drive", "other"]);
        assert_eq!(names_of(&["/a/drive", "/a/drive"]), ["drive", "drive"]);
    }
}
