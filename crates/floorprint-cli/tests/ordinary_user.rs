//! What a user without rights is told where files may not be read or folders not be written.
//!
//! Permissions mean nothing to root, as whom containers run tests: there the program is started as nobody.

#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use std::collections::BTreeSet;
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Who nobody is on most systems.
const NOBODY: u32 = 65534;

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

/// A place that belongs to an ordinary user, in which the program can be started as that user.
struct Desk {
    folder: tempfile::TempDir,
    program: PathBuf,
    /// Whether it is root who runs the tests.
    by_root: bool,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let by_root = folder.path().metadata().unwrap().uid() == 0;
        let mut program = PathBuf::from(env!("CARGO_BIN_EXE_floorprint"));
        if by_root {
            // Where the sources lie nobody else may look. Another process copies: what this one has open for writing, the
            // programs that other tests are starting have for a moment, too, and nobody can start a file that is open so.
            program = folder.path().join("floorprint");
            let copied = Command::new("cp").arg(env!("CARGO_BIN_EXE_floorprint")).arg(&program).status().unwrap();
            assert!(copied.success());
        }
        set_mode(folder.path(), 0o777);
        let desk = Self { folder, program, by_root };
        let line = |scan: i32| {
            let ranges: String =
                (0..60).map(|ray| format!("{:.2} ", 2.0 + f64::from((ray * 7 + scan) % 9) * 0.01)).collect();
            let stamp_s = f64::from(scan) * 0.2;
            format!("FLASER 60 {ranges}0 0 0 0 0 0 {stamp_s} host {stamp_s}\n")
        };
        fs::write(desk.at("drive.clf"), (0..8).map(line).collect::<String>()).unwrap();
        desk
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Makes a folder with the given permissions, which belongs to the user.
    fn folder(&self, name: &str, mode: u32) {
        fs::create_dir(self.at(name)).unwrap();
        if self.by_root {
            chown(self.at(name), Some(NOBODY), Some(NOBODY)).unwrap();
        }
        set_mode(&self.at(name), mode);
    }

    fn started(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(&self.program);
        command.args(arguments).current_dir(self.folder.path());
        if self.by_root {
            command.uid(NOBODY).gid(NOBODY);
        }
        command.output().unwrap()
    }

    fn everything(&self) -> BTreeSet<PathBuf> {
        fn add(folder: &Path, all: &mut BTreeSet<PathBuf>) {
            let Ok(entries) = fs::read_dir(folder) else { return };
            for path in entries.map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    add(&path, all);
                }
                all.insert(path);
            }
        }
        let mut all = BTreeSet::new();
        add(self.folder.path(), &mut all);
        all
    }

    /// Runs a command that must fail with one clear message and leave nothing; `about` is what that names.
    fn refused(&self, arguments: &[&str], about: &str) -> String {
        let before = self.everything();
        let output = self.started(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
        let errors: Vec<&str> = said.lines().filter(|line| !line.starts_with("note: ")).collect();
        assert!(
            errors.len() == 1 && errors[0].starts_with("error: ") && errors[0].contains(about),
            "{arguments:?}: {said}"
        );
        assert_eq!(self.everything(), before, "{arguments:?} leaves nothing behind");
        said
    }
}

#[test]
fn input_that_may_not_be_read_is_named() {
    let desk = Desk::new();
    for name in ["secret.clf", "secret.bag", "secret.csv"] {
        fs::copy(desk.at("drive.clf"), desk.at(name)).unwrap();
        set_mode(&desk.at(name), 0o000);
        for command in ["run", "check", "info"] {
            assert!(desk.refused(&[command, name], name).contains("Permission denied"));
        }
    }
    // A folder that may be listed but not entered, and one that may not even be listed.
    for (name, mode) in [("listed", 0o444), ("closed", 0o000)] {
        desk.folder(name, 0o755);
        fs::copy(desk.at("drive.clf"), desk.at(name).join("drive.clf")).unwrap();
        set_mode(&desk.at(name), mode);
        desk.refused(&["run", name], name);
        desk.refused(&["run", &format!("{name}/drive.clf")], name);
        set_mode(&desk.at(name), 0o755);
    }
    // One part of a course folder.
    desk.folder("course", 0o777);
    let simulated = desk.started(&["simulate", "--world", "spin", "--out", "course/drive", "-q"]);
    assert_eq!(simulated.status.code(), Some(0), "{}", String::from_utf8_lossy(&simulated.stderr));
    set_mode(&desk.at("course/drive/Imu1.npz"), 0o000);
    desk.refused(&["run", "course/drive"], "Imu1.npz");
}

#[test]
fn folders_that_may_not_be_written_are_told_before_any_work() {
    let desk = Desk::new();
    desk.folder("fixed", 0o555);
    set_mode(desk.folder.path(), 0o755);
    let above = if desk.by_root { "results" } else { "fixed/results" };
    for out in [above, "fixed/out", "fixed/deep/er/out"] {
        let said = desk.refused(&["run", "drive.clf", "--out", out], out.split('/').next().unwrap());
        assert!(said.contains("Choose a folder that you may write to"), "{said}");
        desk.refused(&["simulate", "--world", "spin", "--out", out], "Permission denied");
    }
}

#[test]
fn other_results_that_may_not_be_written_are_told() {
    let desk = Desk::new();
    desk.folder("mine", 0o755);
    desk.folder("fixed", 0o555);
    let run = desk.started(&["run", "drive.clf", "--out", "mine/run", "-q"]);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    for arguments in [
        &["plot", "mine/run", "--out", "fixed/plot.svg"][..],
        &["compare", "mine/run", "mine/run", "--out", "fixed/compare.html"],
        &["map", "export", "mine/run/session.gpkg", "--out", "fixed/map"],
        &["batch", "drive.clf", "--out", "fixed/batch"],
        &["bench", "drive.clf", "--out", "fixed/bench"],
    ] {
        desk.refused(arguments, "fixed");
    }
}

#[test]
fn a_run_that_may_not_be_removed_is_not_replaced() {
    let desk = Desk::new();
    desk.folder("shared", 0o777);
    let run = |folder: &str| desk.started(&["run", "drive.clf", "--out", folder, "-q"]);
    assert_eq!(run("shared/run").status.code(), Some(0));
    set_mode(&desk.at("shared/run"), 0o555);
    let replace = ["run", "drive.clf", "--out", "shared/run", "--force"];
    assert!(desk.refused(&replace, "shared/run").contains("may not remove"));
    set_mode(&desk.at("shared/run"), 0o755);
    assert_eq!(desk.started(&replace).status.code(), Some(0));
    if !desk.by_root {
        println!("skipped: only root can make a run of another user");
        return;
    }
    chown(desk.at("shared/run"), Some(0), Some(0)).unwrap();
    assert!(desk.refused(&replace, "shared/run").contains("may not remove"));
    // What another user's run that was stopped left.
    fs::create_dir(desk.at("shared/.new.unfinished")).unwrap();
    desk.refused(&["run", "drive.clf", "--out", "shared/new"], "shared/.new.unfinished");
}
