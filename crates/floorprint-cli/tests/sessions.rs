//! Sessions as users have them: drives that go on, killed runs, maps that are put together, changed and compared.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use floorprint_io::{Annotations, NamedPlace, SessionFile};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::Duration;
use tempfile::TempDir;

/// Two short drives of one building and what came of the first, made once.
fn shared() -> &'static Path {
    static SHARED: OnceLock<TempDir> = OnceLock::new();
    SHARED
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name).display().to_string();
            // Two robots in one building.
            let monday = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 10.0\n[camera]\nrate_hz = 0.2\n";
            let tuesday = "[motion]\nspeed_m_s = 1.0\n[lidar]\nbeams = 361\nrate_hz = 5.0\n[camera]\nrate_hz = 0.0\n";
            for (name, robot) in [("monday", monday), ("tuesday", tuesday)] {
                let config = at(&format!("{name}.toml"));
                fs::write(&config, robot).unwrap();
                let options = ["--world", "rooms", "--seed", "1", "--config", &config, "--out", &at(name)];
                floorprint(&[&["simulate"], &options[..]].concat(), 0);
            }
            floorprint(&["run", &at("monday"), "--out", &at("first")], 0);
            folder
        })
        .path()
}

fn at(name: &str) -> String {
    shared().join(name).display().to_string()
}

fn session() -> String {
    at("first/session.gpkg")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must end with a code; gives what it prints.
fn floorprint(arguments: &[&str], code: i32) -> String {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap();
    let message = text(&stderr);
    assert_eq!(status.code(), Some(code), "{arguments:?}: {message}");
    assert!(!message.contains("panicked"), "{message}");
    if code == 0 { text(&stdout) } else { message }
}

/// Frames of a session, as `map info` counts them.
fn frames(session: &str) -> usize {
    let info = floorprint(&["map", "info", session], 0);
    let line = info.lines().find(|line| line.starts_with("trajectory")).unwrap();
    line.split_once(" m, ").unwrap().1.split_once(" frames").unwrap().0.parse().unwrap()
}

#[test]
fn a_second_drive_goes_on_from_the_first_and_finds_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("second");
    let arguments =
        ["run", &at("tuesday"), "--continue", &session(), "--start", "unknown", "--out", out.to_str().unwrap()];
    let summary = floorprint(&arguments, 0);
    assert!(summary.contains("poses with those of the session") && summary.contains("scans of them new"), "{summary}");
    let both = out.join("session.gpkg").display().to_string();
    assert!(frames(&both) > frames(&session()) + 100);
    let info = floorprint(&["map", "info", &both], 0);
    assert!(info.contains("placed on what was seen before"), "{info}");
    // Nothing in the building changed between the drives.
    let changes = floorprint(&["map", "diff", &session(), &both, "--json"], 0);
    let changes: serde_json::Value = serde_json::from_str(&changes).unwrap();
    let areas =
        changes["features"].as_array().unwrap().iter().map(|patch| patch["properties"]["area_m2"].as_f64().unwrap());
    assert!(areas.sum::<f64>() < 0.5, "{changes}");
}

#[test]
fn the_folder_of_a_run_stands_for_its_session() {
    let folder = tempfile::tempdir().unwrap();
    let at_out = |name: &str| folder.path().join(name).display().to_string();
    assert_eq!(floorprint(&["map", "info", &at("first")], 0), floorprint(&["map", "info", &session()], 0));
    floorprint(&["map", "export", &at("first"), "--out", &at_out("files")], 0);
    let found = floorprint(&["localize", &at("first"), &at("tuesday"), "--out", &at_out("found")], 0);
    assert!(found.contains("localised"), "{found}");
    let summary = floorprint(&["run", &at("tuesday"), "--continue", &at("first"), "--out", &at_out("second")], 0);
    assert!(summary.contains("poses with those of the session"), "{summary}");
    let refused = floorprint(&["map", "info", folder.path().to_str().unwrap()], 1);
    assert!(refused.contains("session.gpkg: there is nothing"), "{refused}");
}

#[test]
fn sessions_are_merged_without_knowing_how_they_lie() {
    let folder = tempfile::tempdir().unwrap();
    let at_out = |name: &str| folder.path().join(name).display().to_string();
    floorprint(&["run", &at("tuesday"), "--no-texture", "--out", &at_out("second")], 0);
    let second = at_out("second/session.gpkg");
    // Something is said of where the second drive began, and of the end of the first.
    let say = |path: &str, name: &str, at: [f64; 2]| {
        let place = NamedPlace { name: name.to_owned(), at };
        let area = vec![at, [at[0] + 1.0, at[1]], [at[0], at[1] + 1.0]];
        SessionFile::open(Path::new(path))
            .unwrap()
            .annotate(&Annotations::new(vec![place], vec![area]).unwrap())
            .unwrap();
    };
    let first = at_out("first.gpkg");
    fs::copy(session(), &first).unwrap();
    say(&first, "dock", [0.5, 0.0]);
    say(&second, "start of Tuesday", [0.0, 0.0]);
    let said = floorprint(&["map", "merge", &first, &second, "--out", &at_out("both.gpkg")], 0);
    let both = PathBuf::from(at_out("both.gpkg"));
    let annotations = SessionFile::read_annotations(&both).unwrap();
    let [dock, start] = annotations.places() else { panic!("{annotations:?}") };
    assert_eq!((&dock.name[..], dock.at, &start.name[..]), ("dock", [0.5, 0.0], "start of Tuesday"));
    let begins =
        SessionFile::read(&both).unwrap().trajectory()[SessionFile::read(Path::new(&first)).unwrap().frames()].pose;
    assert!((start.at[0] - begins.x).hypot(start.at[1] - begins.y) < 1e-9, "{start:?} {begins:?}");
    assert_eq!(annotations.keep_out().len(), 2);
    assert!(said.contains("was placed on"), "{said}");
    assert_eq!(frames(&at_out("both.gpkg")), frames(&session()) + frames(&second));
    let refused = floorprint(&["map", "merge", &session(), &second, "--out", &at_out("both.gpkg")], 1);
    assert!(refused.contains("a file stands there"), "{refused}");
}

#[test]
fn maps_are_turned_cropped_erased_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let at_out = |name: &str| folder.path().join(name).display().to_string();
    floorprint(&["map", "rotate", &session(), "--out", &at_out("straight.gpkg")], 0);
    let info = floorprint(&["map", "info", &at_out("straight.gpkg")], 0);
    assert!(info.contains("once turned by 0.0°") || info.contains("once turned by -0.0°"), "{info}");
    let polygon = ["--polygon", "-2,-2 2,2"];
    floorprint(&[&["map", "crop", &session(), "--out", &at_out("crop.gpkg")], &polygon[..]].concat(), 0);
    floorprint(
        &[&["map", "erase", &session(), "--out", &at_out("erased.gpkg")], &["--polygon", "-50,-50 50,0"][..]].concat(),
        0,
    );
    let nothing =
        floorprint(&["map", "crop", &session(), "--polygon", "900,900 901,901", "--out", &at_out("none.gpkg")], 2);
    assert!(nothing.contains("nothing of") && !folder.path().join("none.gpkg").exists(), "{nothing}");

    for mode in ["trinary", "scale", "raw"] {
        let out = at_out(mode);
        let names = floorprint(&["map", "export", &at_out("straight.gpkg"), "--mode", mode, "--out", &out], 0);
        for name in ["map.tif", "floor.tif", "trajectory.tum", "graph.g2o", "map.yaml"] {
            assert!(names.contains(name), "{names}");
        }
        // Who reads it sees the same map, but for cells that hardly lean to either side.
        let against = floorprint(&["evaluate", "map", &at_out("trinary/map.yaml"), &format!("{out}/map.yaml")], 0);
        assert!(against.contains("0.9") || against.contains("1.0") || against.contains("100"), "{against}");
    }
}

#[test]
fn what_is_no_session_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.gpkg");
    let name = path.to_str().unwrap();
    assert!(floorprint(&["map", "info", name], 1).contains("there is nothing"));
    fs::write(&path, "not a database, and long enough to be looked at as one").unwrap();
    assert!(floorprint(&["map", "info", name], 1).contains("it is no session of floorprint"));
    // Cut anywhere, it is told; nothing panics.
    let whole = fs::read(session()).unwrap();
    for share in [0.01, 0.3, 0.6, 0.99] {
        fs::write(&path, &whole[..(whole.len() as f64 * share) as usize]).unwrap();
        let message = floorprint(&["map", "info", name], 1);
        assert!(message.contains(name), "{message}");
    }
    // A byte changed anywhere is told or does no harm.
    for step in 0..60 {
        let mut bytes = whole.clone();
        let at = 100 + step * (bytes.len() - 200) / 60;
        bytes[at] ^= 0x55;
        fs::write(&path, &bytes).unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_floorprint")).args(["map", "info", name]).output().unwrap();
        let told = text(&output.stderr);
        let is_told = output.status.code() == Some(1) && told.contains(name);
        assert!(is_told || output.status.success(), "byte {at}: {told}");
    }
    // Nor does it blame the user if it is the configuration within.
    fs::write(&path, &whole).unwrap();
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection
        .execute("UPDATE floorprint_meta SET value = replace(value, 'resample_below', 'res4mple_below')", [])
        .unwrap();
    drop(connection);
    let message = floorprint(&["map", "info", name], 1);
    assert!(message.contains("res4mple_below") && message.contains("earlier copy"), "{message}");
}

/// The kept session of a run that was killed.
fn kept(folder: &Path) -> Option<PathBuf> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut kept = files.filter(|path| path.to_string_lossy().ends_with(".gpkg"));
    kept.next()
}

/// Runs are killed at moments spread over their whole length: what they kept opens, and can be gone on from.
#[test]
fn a_run_that_is_killed_keeps_its_session() {
    let folder = tempfile::tempdir().unwrap();
    let at_out = |name: &str| folder.path().join(name).display().to_string();
    // Many rays, so that the run is long enough.
    fs::write(at_out("long.toml"), "[lidar]\nbeams = 1081\nrate_hz = 40.0\n[camera]\nrate_hz = 0.0\n").unwrap();
    floorprint(&["simulate", "--world", "rooms", "--config", &at_out("long.toml"), "--out", &at_out("long")], 0);
    let (mut whole, mut last) = (0, None);
    for round in 0..6_u64 {
        let place = folder.path().join(format!("round-{round}"));
        fs::create_dir(&place).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
            .args(["run", &at_out("long"), "--continue", &session(), "--threads", "1", "-q"])
            .args(["--set", "matcher.iterations=50", "--out", place.join("out").to_str().unwrap()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        sleep(Duration::from_millis(1050 + 250 * round));
        child.kill().unwrap();
        child.wait().unwrap();
        let Some(kept) = kept(&place) else { continue };
        let kept = kept.display().to_string();
        let info = Command::new(env!("CARGO_BIN_EXE_floorprint")).args(["map", "info", &kept]).output().unwrap();
        if info.status.success() {
            whole += 1;
            last = Some(kept);
        } else {
            // Killed before the first save was whole.
            let message = text(&info.stderr);
            assert!(message.contains("nothing was saved") || message.contains("no session"), "{message}");
        }
    }
    // What was gone on from is untouched.
    assert!(frames(&session()) > 100);
    let last = last.expect("no run was killed between its first save and its end");
    let before = frames(&last);
    let resumed = at_out("resumed");
    let arguments =
        ["run", &at("monday"), "--continue", &last, "--start", "unknown", "--no-texture", "--out", &resumed];
    floorprint(&arguments, 0);
    assert!(frames(&format!("{resumed}/session.gpkg")) > before && whole > 0);
}

#[test]
fn what_a_killed_run_kept_stays_and_is_in_nobodys_way() {
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("out.session-1.gpkg");
    fs::copy(session(), &kept).unwrap();
    let out = folder.path().join("out");
    let run = Command::new(env!("CARGO_BIN_EXE_floorprint"))
        .args(["run", &at("tuesday"), "--no-texture", "--out", out.to_str().unwrap()])
        .output()
        .unwrap();
    let message = text(&run.stderr);
    assert!(
        run.status.success() && message.contains("out.session-1.gpkg") && message.contains("--continue"),
        "{message}"
    );
    assert_eq!(fs::read(&kept).unwrap(), fs::read(session()).unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    assert!(frames(out.join("session.gpkg").to_str().unwrap()) > 100);
}

/// `tests/golden` holds a session of each version of the file format, as the program of that time wrote it: the drive
/// "rooms" of 35 m, seed 1. A new version adds its own.
#[test]
fn sessions_of_all_earlier_versions_open_and_are_gone_on_with() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let folder = tempfile::tempdir().unwrap();
    let mut versions = 0;
    for entry in fs::read_dir(golden).unwrap() {
        let stored = entry.unwrap().path();
        let name = stored.file_stem().unwrap().to_str().unwrap().to_owned();
        let session = folder.path().join(format!("{name}.gpkg"));
        fs::copy(&stored, &session).unwrap();
        let session = session.to_str().unwrap();
        let info = floorprint(&["map", "info", session], 0);
        assert!(info.contains("35.3 m, 190 frames") && info.contains("9, 10 loops closed"), "{name}: {info}");
        assert!(info.contains("113.4 m² free"), "{name}: {info}");
        let out = folder.path().join(&name);
        let arguments = ["run", &at("tuesday"), "--continue", session, "--start", "unknown", "--out"];
        floorprint(&[&arguments[..], &[out.to_str().unwrap()]].concat(), 0);
        assert!(frames(out.join("session.gpkg").to_str().unwrap()) > 190);
        versions += 1;
    }
    assert!(versions > 0);
}
