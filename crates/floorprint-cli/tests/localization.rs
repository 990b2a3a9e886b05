//! A robot is localised in a finished map: the built program from the outside.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A short simulated drive and the session of its run, made once.
struct Drive {
    folder: TempDir,
}

/// A small sensor and no images: quick, and still everything that a drive needs.
const SMALL: &str = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 10.0\n[camera]\nrate_hz = 0.0\n";

impl Drive {
    fn shared() -> &'static Path {
        static DRIVE: OnceLock<Drive> = OnceLock::new();
        let drive = DRIVE.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            simulate("rooms", folder.path(), "drive");
            let (drive, run) = (folder.path().join("drive"), folder.path().join("run"));
            succeed(&["run", drive.to_str().unwrap(), "--out", run.to_str().unwrap()]);
            Drive { folder }
        });
        drive.folder.path()
    }
}

fn simulate(world: &str, folder: &Path, name: &str) {
    let settings = folder.join("simulation.toml");
    fs::write(&settings, SMALL).unwrap();
    let out = folder.join(name);
    let arguments = ["simulate", "--world", world, "--config", settings.to_str().unwrap(), "--out"];
    succeed(&[&arguments[..], &[out.to_str().unwrap()]].concat());
}

fn path(parts: &str) -> String {
    Drive::shared().join(parts).display().to_string()
}

fn floorprint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must succeed; gives what it prints.
fn succeed(arguments: &[&str]) -> String {
    let output = floorprint(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Localises the shared drive in a map; gives what is printed, and the folder of the results.
fn localize(map: &str, more: &[&str]) -> (String, Value, PathBuf, TempDir) {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("localized");
    let drive = path("drive");
    let printed = succeed(&[&["localize", map, &drive, "--out", out.to_str().unwrap()], more].concat());
    let report = serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    (printed, report, out, scratch)
}

fn number(report: &Value, pointer: &str) -> f64 {
    report.pointer(pointer).and_then(Value::as_f64).unwrap()
}

#[test]
fn a_start_that_is_known_is_tracked_in_a_session_that_stays_as_it_is() {
    let session = path("run/session.gpkg");
    let before = fs::read(&session).unwrap();
    let (printed, report, out, _scratch) =
        localize(&session, &["--start", "0,0,0", "--truth", &path("drive/truth.tum")]);
    assert!(printed.contains("start") && printed.contains("given"), "{printed}");
    assert!((number(&report, "/localised_share") - 1.0).abs() < 1e-9);
    assert!(number(&report, "/errors/translation_m/max") < 0.05 && number(&report, "/errors/wrong") == 0.0);
    for name in ["trajectory.tum", "localization.png", "config.toml", "report.html"] {
        assert!(fs::metadata(out.join(name)).unwrap().len() > 100, "{name}");
    }
    assert_eq!(fs::read(&session).unwrap(), before);
}

#[test]
fn a_start_that_is_not_known_is_found_in_a_map_of_ros() {
    let map = path("drive/truth_map.yaml");
    let (printed, report, _, _scratch) = localize(&map, &["--truth", &path("drive/truth.tum")]);
    assert!(printed.contains("found"), "{printed}");
    assert!(number(&report, "/found/after_m") < 5.0 && number(&report, "/localised_share") > 0.6);
    assert!(number(&report, "/errors/translation_m/max") < 0.1 && number(&report, "/errors/wrong") == 0.0);
}

#[test]
fn in_the_map_of_another_building_nothing_is_claimed() {
    let elsewhere = tempfile::tempdir().unwrap();
    simulate("corridors", elsewhere.path(), "elsewhere");
    let map = elsewhere.path().join("elsewhere/truth_map.yaml");
    let (printed, report, out, _scratch) = localize(map.to_str().unwrap(), &[]);
    assert!(printed.contains("none is claimed") && printed.contains("somewhere else"), "{printed}");
    assert!(report.pointer("/found").is_none());
    assert_eq!(number(&report, "/localised_share"), 0.0);
    assert_eq!(
        fs::read_to_string(out.join("trajectory.tum")).unwrap().lines().filter(|line| !line.starts_with('#')).count(),
        0
    );
}

/// A map of ROS in which a piece of wall stands that is none.
fn falsified_map(folder: &Path) -> PathBuf {
    let picture = fs::read(path("drive/truth_map.pgm")).unwrap();
    let yaml = fs::read_to_string(path("drive/truth_map.yaml")).unwrap();
    // "P5", width, height, largest value: the rest are cells.
    let mut fields = Vec::new();
    let mut at = 0;
    while fields.len() < 4 {
        if picture[at] == b'#' {
            at += picture[at..].iter().position(|&byte| byte == b'\n').unwrap();
        }
        let end = at + picture[at..].iter().position(u8::is_ascii_whitespace).unwrap();
        if end > at {
            fields.push(text(&picture[at..end]));
        }
        at = end + 1;
    }
    let width: usize = fields[1].parse().unwrap();
    let height: usize = fields[2].parse().unwrap();
    let mut cells = picture[at..].to_vec();
    let origin: Vec<f64> = yaml
        .lines()
        .find_map(|line| line.strip_prefix("origin:"))
        .map(|list| list.trim_matches([' ', '[', ']']).split(',').map(|part| part.trim().parse().unwrap()).collect())
        .unwrap();
    // 0.4 m of wall beside the way of the robot, far from any other.
    let index = |x: f64, y: f64| {
        let (column, row) = (((x - origin[0]) / 0.05) as usize, ((y - origin[1]) / 0.05) as usize);
        (height - 1 - row) * width + column
    };
    for (step, row) in (0..8).flat_map(|step| (0..4).map(move |row| (step, row))) {
        cells[index(-2.475 + 0.05 * f64::from(step), -2.975 + 0.05 * f64::from(row))] = 0;
    }
    fs::write(folder.join("map.pgm"), [&picture[..at], &cells].concat()).unwrap();
    let yaml: Vec<String> = yaml
        .lines()
        .map(|line| if line.starts_with("image:") { "image: map.pgm".to_owned() } else { line.to_owned() })
        .collect();
    fs::write(folder.join("map.yaml"), yaml.join("\n") + "\n").unwrap();
    folder.join("map.yaml")
}

#[test]
fn what_changed_is_proposed_and_the_map_stays_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let map = falsified_map(folder.path());
    let before = fs::read(folder.path().join("map.pgm")).unwrap();
    let (printed, report, out, _scratch) = localize(map.to_str().unwrap(), &["--start", "0,0,0", "--update"]);
    assert!(printed.contains("seen from"), "{printed}");
    let document: Value = serde_json::from_slice(&fs::read(out.join("changes.geojson")).unwrap()).unwrap();
    let features = document["features"].as_array().unwrap();
    assert_eq!(report["changes"].as_array().unwrap().len(), features.len());
    let is_there = |feature: &&Value| {
        let corner = &feature["geometry"]["coordinates"][0][0][0];
        let [x, y] = [0, 1].map(|axis| corner[axis].as_f64().unwrap());
        (x + 2.3).abs() < 0.4 && (y + 2.9).abs() < 0.2
    };
    let there: Vec<&Value> = features.iter().filter(is_there).collect();
    let [gone] = there.as_slice() else { panic!("{features:?}") };
    let properties = &gone["properties"];
    assert_eq!(properties["change"], "gone");
    assert!((properties["area_m2"].as_f64().unwrap() - 0.08).abs() < 0.011, "{properties}");
    assert!(properties["last_seen_s"].as_f64() > properties["first_seen_s"].as_f64(), "{properties}");
    assert!(fs::metadata(out.join("changes.png")).unwrap().len() > 100);
    assert_eq!(fs::read(folder.path().join("map.pgm")).unwrap(), before);
    // Nothing changed of the map of the drive itself.
    let session = path("run/session.gpkg");
    let (printed, ..) = localize(&session, &["--start", "0,0,0", "--update"]);
    assert!(printed.contains("gone     0 patches") && printed.contains("new      0 patches"), "{printed}");
}

#[test]
fn a_session_is_updated_only_to_a_new_one_and_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let (session, new) = (path("run/session.gpkg"), folder.path().join("new.gpkg"));
    let before = fs::read(&session).unwrap();
    let update = ["--start", "0,0,0", "--update", "--update-session", new.to_str().unwrap()];
    localize(&session, &update);
    assert_eq!(fs::read(&session).unwrap(), before);
    // The new one is a session like any other, with the drive in it.
    assert_ne!(succeed(&["map", "info", &session]), succeed(&["map", "info", new.to_str().unwrap()]));
    localize(new.to_str().unwrap(), &["--start", "0,0,0"]);
    // Neither is one replaced, nor a picture updated.
    for (map, expected) in [(session.as_str(), "a file stands there"), (&path("drive/truth_map.yaml"), "is no session")]
    {
        let drive = path("drive");
        let arguments = [&["localize", map, &drive, "--out", "never"], &update[..]].concat();
        let output = floorprint(&arguments);
        assert!(!output.status.success() && text(&output.stderr).contains(expected), "{}", text(&output.stderr));
    }
}
