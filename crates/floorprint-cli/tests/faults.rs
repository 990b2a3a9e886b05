//! Whatever file call fails, and wherever the program is killed: no result is lost, none is half there.
//!
//! A small library that is loaded before the C library lets one call after the other fail. It is compiled on
//! the spot; where there is no C compiler, that is said and nothing is tested. `FLOORPRINT_KILLS=1000` makes
//! so many runs instead of one for each call.
#![allow(clippy::panic, clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "tests")]
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test ends where a step fails, and says what it skips")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Input/output error, and no space left on the device, as Linux numbers them.
const ERRORS: [&str; 2] = ["5", "28"];

/// The library, compiled; `None` where there is no compiler.
fn shim(folder: &Path) -> Option<PathBuf> {
    let library = folder.join("shim.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults/shim.c");
    let compiled = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).arg("-ldl").output();
    match compiled {
        Ok(output) if output.status.success() => Some(library),
        Ok(output) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => {
            println!("skipped: no C compiler ({error})");
            None
        }
    }
}

/// A log of a robot that stands in a room.
fn log(folder: &Path) -> PathBuf {
    let range = |ray: i32, scan: i32| 2.0 + f64::from((ray * 7 + scan * 3) % 11) * 0.01;
    let line = |scan: i32| {
        let ranges: String = (0..60).map(|ray| format!("{:.2} ", range(ray, scan))).collect();
        let stamp_s = f64::from(scan) * 0.2;
        format!("FLASER 60 {ranges}0 0 0 0 0 0 {stamp_s} host {stamp_s}\n")
    };
    let path = folder.join("drive.clf");
    fs::write(&path, (0..4).map(line).collect::<String>()).unwrap();
    path
}

struct Trial {
    folder: tempfile::TempDir,
    shim: PathBuf,
    log: PathBuf,
}

impl Trial {
    fn run(&self, out: &Path, seed: &str, variables: &[(&str, &str)]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
        command.arg("run").arg(&self.log).arg("--out").arg(out);
        command.args(["--quiet", "--force", "--threads", "1", "--preset", "fast", "--seed", seed]);
        if !variables.is_empty() {
            command.env("LD_PRELOAD", &self.shim).envs(variables.iter().copied());
        }
        command.stdin(Stdio::null()).output().unwrap()
    }

    /// How many calls a run makes that change files.
    fn calls(&self, out: &Path) -> usize {
        let count = self.folder.path().join("count");
        assert!(self.run(out, "2", &[("FAULT_COUNT", count.to_str().unwrap())]).status.success());
        fs::read_to_string(&count).unwrap().lines().count()
    }
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The seed of the complete results in a folder.
fn seed_in(folder: &Path, whole: &[String]) -> u64 {
    assert_eq!(names(folder), whole, "what is in {}", folder.display());
    let text = fs::read(folder.join("report.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&text).unwrap()["seed"].as_u64().unwrap()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for name in names(from) {
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

#[test]
fn no_result_is_lost_whatever_call_fails_and_wherever_the_program_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let Some(shim) = shim(folder.path()) else { return };
    let trial = Trial { log: log(folder.path()), shim, folder };
    let first = trial.folder.path().join("first");
    assert!(trial.run(&first, "1", &[]).status.success());
    let whole = names(&first);
    let scratch = trial.folder.path().join("scratch");
    copy(&first, &scratch);
    let calls = trial.calls(&scratch);
    assert!(calls > 30, "{calls} calls that change files");

    let hows = ["before", "after", ERRORS[0], ERRORS[1]];
    let trials = std::env::var("FLOORPRINT_KILLS").map_or(calls, |kills| kills.parse().unwrap());
    for index in 0..trials {
        // Each call in one of the ways, and every way at the last ones, where results change places.
        let at = 1 + index % calls;
        let settles = at + 20 > calls && trials == calls;
        for how in if settles { &hows[..] } else { &hows[(index + index / calls) % 4..][..1] } {
            let place = trial.folder.path().join("place");
            fs::create_dir(&place).unwrap();
            let out = place.join("out");
            copy(&first, &out);
            let output = trial.run(&out, "2", &[("FAULT_AT", &at.to_string()), ("FAULT_HOW", how)]);
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!message.contains("panicked"), "call {at}, {how}: {message}");
            let seed = seed_in(&out, &whole);
            match output.status.code() {
                Some(0) => assert_eq!(seed, 2, "call {at}, {how}"),
                Some(1) => assert!(message.contains("error"), "call {at}, {how}: {message}"),
                Some(code) => panic!("call {at}, {how}: exit code {code}, {message}"),
                None => assert!(["before", "after"].contains(how), "call {at}, {how}"),
            }
            if settles || index % 4 == 0 {
                // Whatever was left is in nobody's way.
                let output = trial.run(&out, "3", &[]);
                let message = String::from_utf8_lossy(&output.stderr).into_owned();
                assert!(output.status.success(), "after call {at}, {how}: {message}");
                assert_eq!(seed_in(&out, &whole), 3);
                // The session of a run that was killed is kept: what it saw is not lost. It is hidden if it was just made.
                let is_session = |name: &str| name.trim_start_matches('.').starts_with("out.session-");
                for other in names(&place).iter().filter(|name| *name != "out" && !is_session(name)) {
                    assert_eq!(other, "out-2", "after call {at}, {how}: {message}");
                    seed_in(&place.join(other), &whole);
                }
            }
            fs::remove_dir_all(&place).unwrap();
        }
    }
}

#[test]
fn of_two_runs_into_one_new_folder_one_says_that_the_other_is_filling_it() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let pairs = std::env::var("FLOORPRINT_PAIRS").map_or(5, |pairs| pairs.parse().unwrap());
    for pair in 0..pairs {
        let out = folder.path().join(format!("out-of-{pair}"));
        let start = || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
            command.arg("run").arg(&log).arg("--out").arg(&out).args(["--quiet", "--preset", "fast"]);
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        };
        let runs = [start(), start()].map(|run| run.wait_with_output().unwrap());
        let fine = runs.iter().filter(|run| run.status.success()).count();
        assert_eq!(fine, 1, "{runs:?}");
        for run in runs.iter().filter(|run| !run.status.success()) {
            let message = String::from_utf8_lossy(&run.stderr);
            assert!(message.contains("another process is filling it") || message.contains("--force"), "{message}");
        }
        assert!(out.join("report.json").is_file() && out.join("report.html").is_file());
        let beside = names(folder.path()).into_iter().filter(|name| name.starts_with('.')).count();
        assert_eq!(beside, 0, "{:?}", names(folder.path()));
    }
}
