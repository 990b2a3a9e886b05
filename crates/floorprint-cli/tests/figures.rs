//! The figures in the documents are the stored ones, and the stored ones are what the program gives.

#[path = "../../floorprint-io/tests/data_folder/mod.rs"]
mod data_folder;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn the_tables_of_the_benchmark_are_those_of_the_stored_figures() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("bench")).unwrap();
    for entry in fs::read_dir(repository().join("bench")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "json") {
            fs::copy(&path, folder.path().join("bench").join(path.file_name().unwrap())).unwrap();
        }
    }
    let document = folder.path().join("BENCHMARK.md");
    fs::copy(repository().join("BENCHMARK.md"), &document).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_floorprint")).args(["bench", "--render"]).arg(&document).output();
    let message = String::from_utf8_lossy(&output.unwrap().stderr).into_owned();
    assert!(message.contains("is as the stored figures have it"), "make it anew with bench/make tables: {message}");
}

#[test]
fn the_program_gives_the_stored_figures_of_a_world() {
    let folder = tempfile::tempdir().unwrap();
    let verify = |stored: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
        command.args(["bench", "--world", "large_hall", "--beams", "180", "--rate-hz", "5", "--range-m", "80"]);
        command.args(["--field-of-view-deg", "180", "--preset", "default", "--out"]).arg(folder.path().join("runs"));
        let output = command.arg("--verify").arg(stored).output().unwrap();
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let stored = repository().join("bench/sparse-worlds.json");
    let (is_same, message) = verify(&stored);
    assert!(is_same && message.contains("1 runs give the stored figures"), "{message}");
    // A figure that was changed by hand is found.
    let mut figures: serde_json::Value = serde_json::from_slice(&fs::read(&stored).unwrap()).unwrap();
    let rows = figures["worlds"].as_array_mut().unwrap();
    let row = rows.iter_mut().find(|row| row["name"] == "large_hall").unwrap();
    row["runs"][0]["end_m"] = serde_json::json!(0.0123);
    let changed = folder.path().join("changed.json");
    fs::write(&changed, figures.to_string()).unwrap();
    let (is_same, message) = verify(&changed);
    assert!(
        !is_same && message.contains("large_hall, default, seed 0: error at the end 0.0123 is now 0."),
        "{message}"
    );
}

#[test]
fn the_program_gives_the_stored_figures() {
    let Some(data) = data_folder::data() else { return };
    let log = data.join("relations/mit-csail");
    let folder = tempfile::tempdir().unwrap();
    let verify_of = |log: &Path, stored: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
        command.arg("bench").arg(log).arg("--verify").arg(stored).args(["--preset", "fast", "--out"]);
        command.arg(folder.path().join("runs")).output().unwrap()
    };
    let verify = |stored: &Path| verify_of(&log, stored);
    let stored = repository().join("bench/logs.json");
    let drive = (data.join("ece276a/semi20"), repository().join("bench/drives.json"));
    for output in [verify(&stored), verify_of(&drive.0, &drive.1)] {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    // A figure that is not the program's is found.
    let mut figures: serde_json::Value = serde_json::from_slice(&fs::read(&stored).unwrap()).unwrap();
    let rows = figures["data_sets"].as_array_mut().unwrap();
    let row = rows.iter_mut().find(|row| row["name"] == "mit-csail" && row["preset"] == "fast").unwrap();
    row["runs"][0]["translation_m"] = serde_json::json!(0.0123);
    let changed = folder.path().join("changed.json");
    fs::write(&changed, figures.to_string()).unwrap();
    let output = verify(&changed);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("translation 0.0123 is now 0.0"), "{message}");
}
