//! Whatever file call fails, and wherever the program is killed: no result is lost, none is half there.
//!
//! A small library that is loaded before the C library lets one call after the other fail. It is compiled on
//! the spot; where there is no C compiler, that is said and nothing is tested. `FLOORPRINT_KILLS=1000` makes
//! so many runs instead of one for each call, `FLOORPRINT_PAIRS=200` so many pairs; `bench/kills` does both.
#![allow(clippy::panic, clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "tests")]
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test ends where a step fails, and says what it skips")]

use floorprint_io::SessionFile;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

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

/// A folder, in memory where the system has one there: syncing to a disk takes most of the time, and kills lose nothing there.
fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let made = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    made.unwrap()
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
    let folder = folder();
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
    let folder = folder();
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
    println!("{pairs} pairs of runs into one folder");
}

#[test]
fn of_two_merges_into_one_new_file_one_says_so_and_the_other_is_whole() {
    let folder = folder();
    let drive = log(folder.path());
    let sessions = Sessions::of(folder, drive);
    let pairs = std::env::var("FLOORPRINT_PAIRS").map_or(8, |pairs| pairs.parse().unwrap());
    for pair in 0..pairs {
        let place = sessions.folder.path().join(format!("place-{pair}"));
        fs::create_dir(&place).unwrap();
        let merges = [(); 2].map(|()| sessions.command(2, &place).spawn().unwrap());
        let merges = merges.map(|merge| merge.wait_with_output().unwrap());
        assert_eq!(merges.iter().filter(|merge| merge.status.success()).count(), 1, "pair {pair}: {merges:?}");
        for merge in &merges {
            assert_eq!(sessions.check(2, &place, merge, "two merges"), 0);
            let message = String::from_utf8_lossy(&merge.stderr);
            let is_told = message.contains("another process is writing it") || message.contains("a file stands there");
            assert!(merge.status.success() || is_told, "{message}");
        }
        assert_eq!(names(&place), ["both.gpkg"]);
    }
    println!("{pairs} pairs of merges into one file");
}

/// How often the tests of sessions are made, where nothing is said.
fn kills(usual: usize) -> usize {
    std::env::var("FLOORPRINT_KILLS").map_or(usual, |kills| kills.parse().unwrap())
}

/// The files in a folder and in those in it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Sessions with the number of frames in each. All of them are whole, whoever was killed while he wrote them.
fn whole_sessions(folder: &Path) -> Vec<(PathBuf, usize)> {
    let sessions = files(folder).into_iter().filter(|path| path.extension().is_some_and(|ending| ending == "gpkg"));
    let mut whole = Vec::new();
    for path in sessions {
        let session = SessionFile::open(&path).and_then(|file| file.load());
        let frames = session.unwrap_or_else(|error| panic!("{error}; {:?}", files(folder))).frames();
        let connection = rusqlite::Connection::open(&path).unwrap();
        let integrity: String = connection.query_row("PRAGMA integrity_check", [], |row| row.get(0)).unwrap();
        assert_eq!(integrity, "ok", "{}", path.display());
        whole.push((path, frames));
    }
    whole
}

/// Two sessions, and three commands that make a third one in a folder that they are given.
struct Sessions {
    folder: tempfile::TempDir,
    drive: PathBuf,
    stored: [PathBuf; 2],
    /// Frames of the two.
    frames: [usize; 2],
}

impl Sessions {
    /// Sessions of the drive in `folder`.
    fn of(folder: tempfile::TempDir, drive: PathBuf) -> Self {
        let stored = ["one", "other"].map(|name| {
            let out = folder.path().join(name);
            let options = ["--quiet", "--no-texture", "--preset", "fast"];
            let output = Command::new(env!("CARGO_BIN_EXE_floorprint"))
                .arg("run")
                .arg(&drive)
                .args(options)
                .arg("--out")
                .arg(&out)
                .output()
                .unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            out.join("session.gpkg")
        });
        let frames = stored.each_ref().map(|path| SessionFile::read(path).unwrap().frames());
        Self { folder, drive, stored, frames }
    }

    /// The command of this number, to be done in `place`.
    fn command(&self, number: usize, place: &Path) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
        let [one, other] = &self.stored;
        match number % 3 {
            0 => command.arg("run").arg(&self.drive).arg("--out").arg(place.join("out")),
            1 => command.arg("run").arg(&self.drive).arg("--out").arg(place.join("out")).arg("--continue").arg(one),
            _ => command.args(["map", "merge"]).arg(one).arg(other).arg("--out").arg(place.join("both.gpkg")),
        };
        if number % 3 < 2 {
            command.args(["--no-texture", "--preset", "fast", "--threads", "1", "--save-every", "0.02"]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// The frames of the command's result when it comes to its end.
    fn frames_of(&self, number: usize) -> usize {
        self.frames[0] + if number.is_multiple_of(3) { 0 } else { self.frames[1] }
    }

    /// Looks at what the command left: the result is whole or not there, and what was said to be safe is. Gives the number of
    /// sessions that are kept beside.
    fn check(&self, number: usize, place: &Path, output: &Output, how: &str) -> usize {
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!message.contains("panicked"), "{how}: {message}");
        let made = whole_sessions(place);
        // What was gone on from is as it was.
        let before = self.stored.iter().map(|path| whole_sessions(path.parent().unwrap())[0].1);
        assert!(before.eq(self.frames), "{how}");
        let result = [place.join("out/session.gpkg"), place.join("both.gpkg")];
        let result = made.iter().find(|(path, _)| result.contains(path));
        if output.status.success() || place.join("out").exists() {
            assert!(result.is_some(), "{how}: {:?} {message}", files(place));
        }
        if let Some((path, frames)) = result {
            assert_eq!(*frames, self.frames_of(number), "{how}");
            if path.ends_with("out/session.gpkg") {
                assert!(place.join("out/report.json").exists(), "{how}");
            }
            // Its pictures are there, too.
            let connection = rusqlite::Connection::open(path).unwrap();
            let tiles: i64 = connection.query_row("SELECT count(*) FROM occupancy", [], |row| row.get(0)).unwrap();
            assert!(tiles > 0, "{how}");
        }
        // A drive that goes on is kept together with what it goes on from.
        let earlier = if number % 3 == 1 { self.frames[0] } else { 0 };
        assert!(made.iter().all(|(_, frames)| *frames > earlier), "{how}: {made:?}");
        if let Some((_, said)) = message.split_once("what was seen so far is kept in ") {
            let (path, _) = said.split_once(" until").unwrap();
            assert!(result.is_some() || Path::new(path).exists(), "{how}: {message} {:?}", files(place));
        }
        let kept = made.iter().filter(|(path, _)| path.parent() == Some(place) && !path.ends_with("both.gpkg"));
        let kept = kept.count();
        // A run that fails says what it leaves.
        assert!(kept == 0 || output.status.code() != Some(1) || message.contains("is kept in"), "{how}: {message}");
        kept
    }

    /// Whatever was left is in nobody's way, and goes, but for kept sessions.
    fn check_again(&self, number: usize, place: &Path, how: &str) {
        let result = place.join(if number % 3 == 2 { "both.gpkg" } else { "out" });
        if result.is_dir() {
            fs::remove_dir_all(&result).unwrap();
        } else if result.exists() {
            fs::remove_file(&result).unwrap();
        }
        let output = self.command(number, place).output().unwrap();
        self.check(number, place, &output, how);
        assert!(output.status.success(), "{how}: {}", String::from_utf8_lossy(&output.stderr));
        // An empty journal of SQLite's may stay beside a kept session.
        let others = names(place).iter().filter(|name| !name.starts_with("out.session-")).count() - 1;
        // Complete results of a run that was killed just before they were put into place are put beside it.
        assert!(others == 0 || names(place).contains(&"out-2".to_owned()), "{how}: {:?}", names(place));
    }
}

#[test]
fn no_session_is_lost_whatever_call_fails() {
    let folder = folder();
    let Some(shim) = shim(folder.path()) else { return };
    let drive = log(folder.path());
    let sessions = Sessions::of(folder, drive);
    let is_thorough = std::env::var_os("FLOORPRINT_KILLS").is_some();
    let (mut trials, mut kept) = (0, 0);
    for number in 0..3 {
        let place = sessions.folder.path().join("place");
        let count = sessions.folder.path().join("count");
        fs::create_dir(&place).unwrap();
        let preload = |command: &mut Command| _ = command.env("LD_PRELOAD", &shim);
        let mut command = sessions.command(number, &place);
        preload(&mut command);
        assert!(command.env("FAULT_COUNT", &count).status().unwrap().success());
        let calls = fs::read_to_string(&count).unwrap().lines().count();
        fs::remove_file(&count).unwrap();
        fs::remove_dir_all(&place).unwrap();
        assert!(calls > 20, "{calls} calls that change files");
        // Each call in each way, or some of them: an odd number, so that each way comes up.
        let ways = ["before", "after", ERRORS[0], ERRORS[1]];
        let step = if is_thorough { 1 } else { (calls * ways.len() / 20) | 1 };
        for case in (0..calls * ways.len()).step_by(step) {
            let (at, how) = (1 + case / ways.len(), ways[case % ways.len()]);
            fs::create_dir(&place).unwrap();
            let mut command = sessions.command(number, &place);
            preload(&mut command);
            let output = command.env("FAULT_AT", at.to_string()).env("FAULT_HOW", how).output().unwrap();
            let how = format!("command {number}, call {at} of {calls}, {how}");
            kept += sessions.check(number, &place, &output, &how);
            if trials % 4 == 0 {
                sessions.check_again(number, &place, &how);
            }
            fs::remove_dir_all(&place).unwrap();
            trials += 1;
        }
    }
    println!("{trials} runs of which one file call failed, or at which they were killed: {kept} sessions kept");
}

#[test]
fn no_session_is_lost_wherever_runs_are_killed() {
    let folder = folder();
    let (robot, drive) = (folder.path().join("robot.toml"), folder.path().join("drive"));
    fs::write(&robot, "[lidar]\nbeams = 361\nrate_hz = 20.0\n[camera]\nrate_hz = 0.0\n").unwrap();
    let mut simulate = Command::new(env!("CARGO_BIN_EXE_floorprint"));
    simulate.args(["simulate", "--quiet", "--world", "rooms"]).arg("--config").arg(&robot).arg("--out").arg(&drive);
    assert!(simulate.status().unwrap().success());
    let sessions = Sessions::of(folder, drive);
    let place = sessions.folder.path().join("place");
    let whole_s = [0, 1, 2].map(|number| {
        fs::create_dir(&place).unwrap();
        let started = Instant::now();
        let output = sessions.command(number, &place).output().unwrap();
        let took_s = started.elapsed().as_secs_f64();
        assert_eq!(sessions.check(number, &place, &output, "whole"), 0);
        fs::remove_dir_all(&place).unwrap();
        took_s
    });
    let (mut ended, mut kept, mut gone_on) = ([0; 3], [0; 3], 0);
    let kills = kills(9);
    for kill in 0..kills {
        let number = kill % 3;
        fs::create_dir(&place).unwrap();
        let mut child = sessions.command(number, &place).spawn().unwrap();
        // Spread evenly over the length of the run.
        let share = (kill as f64 * 0.618_034).fract();
        sleep(Duration::from_secs_f64(whole_s[number] * share));
        child.kill().unwrap();
        let output = child.wait_with_output().unwrap();
        let how = format!("command {number}, killed at {share:.3}");
        let sessions_kept = sessions.check(number, &place, &output, &how);
        ended[number] += usize::from(output.status.success());
        kept[number] += sessions_kept;
        if kill % 5 == 0 {
            sessions.check_again(number, &place, &how);
        }
        // What was kept can be gone on with.
        if let (true, Some((session, _))) = (sessions_kept > 0 && gone_on * 10 <= kill, whole_sessions(&place).first())
        {
            let output = sessions.command(0, &place.join("on")).arg("--continue").arg(session).output().unwrap();
            assert!(output.status.success(), "{how}: {}", String::from_utf8_lossy(&output.stderr));
            gone_on += 1;
        }
        fs::remove_dir_all(&place).unwrap();
    }
    println!(
        "{kills} kills at moments spread over {whole_s:.2?} s of running, continuing and merging: {ended:?} had ended, {kept:?} \
         sessions kept, {gone_on} of them gone on with"
    );
}
