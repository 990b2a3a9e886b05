//! `run --mcap`: what Foxglove's own packages find in the file.
//!
//! They come from PyPI into an environment below the target folder. Where there is no Python, or no package index, that is
//! said, and nothing is tested by them.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// The packages with what they need besides each other.
const PACKAGES: [&str; 4] =
    ["mcap>=1.3,<2", "mcap-protobuf-support>=0.6", "mcap-ros2-support>=0.6", "foxglove-schemas-protobuf>=0.4"];

/// Python with the packages, if there can be one; else why not.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mcap");
    let python = folder.join("bin/python");
    let installed = folder.join("packages.txt");
    if fs::read_to_string(&installed).is_ok_and(|found| found == PACKAGES.join("\n")) {
        return Ok(python);
    }
    let _ = fs::remove_dir_all(&folder);
    let made = Command::new("python3").args(["-m", "venv"]).arg(&folder).output();
    if !made.is_ok_and(|output| output.status.success()) {
        return Err("there is no python3 with venv".to_owned());
    }
    let mut install = Command::new(&python);
    let options = ["-m", "pip", "install", "--quiet", "--retries=1", "--disable-pip-version-check"];
    let install = install.args(options).args(PACKAGES).output().unwrap();
    if !install.status.success() {
        let said = String::from_utf8_lossy(&install.stderr).into_owned();
        let unreachable = ["onnection", "resolve", "timed out", "No matching distribution"];
        assert!(unreachable.iter().any(|sign| said.contains(sign)), "{said}");
        return Err(format!("the package index cannot be reached: {}", said.lines().next().unwrap_or_default()));
    }
    fs::write(installed, PACKAGES.join("\n")).unwrap();
    Ok(python)
}

fn floorprint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap()
}

/// A short drive with a camera, in a folder of its own.
fn drive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let robot = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 10.0\n[camera]\nrate_hz = 0.5\n";
    fs::write(at("robot.toml"), robot).unwrap();
    let options = ["simulate", "--world", "rooms", "--seed", "1", "--config", &at("robot.toml"), "--out", &at("drive")];
    assert!(floorprint(&options).status.success());
    folder
}

#[test]
fn foxgloves_packages_decode_all_of_it() {
    let folder = drive();
    let at = |name: &str| folder.path().join(name).display().to_string();
    fs::write(at("out.mcap"), "an earlier one").unwrap();
    let run = floorprint(&["run", &at("drive"), "--out", &at("run"), "--mcap", &at("out.mcap")]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(fs::read(at("out.mcap")).unwrap().starts_with(b"\x89MCAP0\r\n"));
    let beside: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(beside.len(), 4, "{beside:?}");
    let python = match python() {
        Ok(python) => python,
        Err(reason) => return eprintln!("SKIPPED: the file is not read: {reason}"),
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mcap/reader.py");
    let output = Command::new(python).arg(script).arg(at("out.mcap")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();

    assert_eq!(found["differences"], json!([]), "the schemas are Foxglove's");
    let trajectory = fs::read_to_string(at("run/trajectory.tum")).unwrap();
    let poses = trajectory.lines().count() as u64;
    let topic = |name: &str| &found["topics"][name];
    for (name, schema, count) in [
        ("/map", "foxglove.Grid", 1),
        ("/floor", "foxglove.Grid", 1),
        ("/floor/image", "foxglove.CompressedImage", 1),
        ("/scene", "foxglove.SceneUpdate", 1),
        ("/tf_static", "foxglove.FrameTransforms", 1),
        ("/tf", "foxglove.FrameTransforms", poses),
        ("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", poses),
        ("/scan", "foxglove.PointCloud", poses),
    ] {
        assert_eq!((&topic(name)["schema"], topic(name)["count"].as_u64()), (&json!(schema), Some(count)), "{name}");
    }
    assert_eq!(found["announced"].as_u64(), Some(5 + 3 * poses));
    // The last pose, and the transforms that lead to it, are those of the trajectory.
    let last: Vec<f64> = trajectory.lines().last().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    let numbers = |value: &Value| value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect();
    let pose: Vec<f64> = numbers(&topic("/pose")["newest"]);
    assert!((pose[0] - last[1]).abs() < 1e-5 && (pose[1] - last[2]).abs() < 1e-5, "{pose:?}, {last:?}");
    assert!(pose[2] > 0.0 && pose[3] > 0.0, "{pose:?}");
    assert!((topic("/pose")["last"].as_f64().unwrap() * 1e-9 - last[0]).abs() < 1e-3, "{found}");
    assert_eq!(topic("/tf")["newest"], json!([["map", "odom"], ["odom", "base_link"]]));
    assert_eq!(topic("/tf_static")["newest"], json!([["base_link", "laser"]]));
    // The map's cells are those of the map's file, the scene's lines those of the trajectory.
    let pgm = fs::read(at("run/map.pgm")).unwrap();
    let head: Vec<u64> = String::from_utf8_lossy(&pgm[..40])
        .lines()
        .filter(|line| !line.starts_with('#'))
        .flat_map(|line| line.split(' '))
        .filter_map(|word| word.parse().ok())
        .collect();
    let map = &topic("/map")["newest"];
    assert_eq!([map[0].as_u64(), map[1].as_u64()], [Some(head[0]), Some(head[1])]);
    assert!(map[3].as_u64().unwrap() > 1000 && topic("/floor")["newest"][3].as_u64().unwrap() > 1000, "{found}");
    assert_eq!(topic("/scene")["newest"]["trajectory"].as_u64(), Some(poses));
    assert_eq!(topic("/floor/image")["newest"], json!(["png", "PNG"]));
}

#[test]
fn a_place_where_it_cannot_be_is_told_before_anything_is_computed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    fs::write(at("drive.clf"), "FLASER 3 2.0 2.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n").unwrap();
    for (place, reason) in [("nowhere/out.mcap", "there is no folder"), ("", "a folder stands there")] {
        let output = floorprint(&["run", &at("drive.clf"), "--out", &at("run"), "--mcap", &at(place)]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(reason), "{said}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
