//! Many logs at once, and runs beside each other: the built program from the outside.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use rusqlite::Connection;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn floorprint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap()
}

fn succeed(arguments: &[&str]) -> String {
    let output = floorprint(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A short drive, with its truth.
fn simulate(folder: &Path, seed: &str) {
    let settings = folder.with_extension("toml");
    let small = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 91\nrate_hz = 5.0\n[camera]\nrate_hz = 0.0\n";
    fs::write(&settings, small).unwrap();
    let (settings, folder) = (settings.to_str().unwrap(), folder.to_str().unwrap());
    succeed(&["simulate", "--world", "rooms", "--seed", seed, "--config", settings, "--out", folder]);
}

fn rows(results: &Path, query: &str) -> Vec<(String, String)> {
    let connection = Connection::open(results).unwrap();
    let mut query = connection.prepare(query).unwrap();
    let rows = query.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
    rows.collect::<Result<_, _>>().unwrap()
}

#[test]
fn a_batch_has_a_row_for_each_run_and_runs_nothing_twice() {
    let folder = tempfile::tempdir().unwrap();
    let (logs, out) = (folder.path().join("logs"), folder.path().join("out"));
    fs::create_dir_all(&logs).unwrap();
    simulate(&logs.join("one"), "1");
    fs::write(logs.join("broken.clf"), "FLASER nonsense\n").unwrap();
    let list = folder.path().join("list.txt");
    fs::write(&list, "# all there are\nlogs/one\nlogs/broken.clf\n").unwrap();
    let results = out.join("results.sqlite");
    let batch = |more: &[&str]| {
        let common = ["batch", list.to_str().unwrap(), "--out", out.to_str().unwrap(), "--preset", "fast"];
        succeed(&[&common, more].concat())
    };

    let said = batch(&["--preset", "default"]);
    assert!(said.contains("broken.clf"), "{said}");
    let query = "SELECT preset || ' ' || status, CAST(COALESCE(error_m, error) AS TEXT) FROM results ORDER BY 1";
    let first = rows(&results, query);
    let kinds: Vec<&str> = first.iter().map(|(kind, _)| kind.as_str()).collect();
    assert_eq!(kinds, ["default done", "default failed", "fast done", "fast failed"]);
    let error_m: f64 = first[0].1.parse().unwrap();
    assert!(error_m > 0.0 && error_m < 0.1, "{error_m}");
    assert!(first[1].1.contains("broken.clf"), "{}", first[1].1);
    assert_eq!(fs::read_dir(&out).unwrap().filter(|entry| entry.as_ref().unwrap().path().is_dir()).count(), 0);

    // The same once more is there already; one more seed is not.
    let said = batch(&["--preset", "default", "--seeds", "2", "--keep"]);
    assert!(said.contains("4 of 8 runs are there already"), "{said}");
    let folders = rows(&results, "SELECT folder, seed || '' FROM runs WHERE folder IS NOT NULL");
    assert_eq!(folders.len(), 2);
    assert!(folders.iter().all(|(folder, seed)| seed == "1" && Path::new(folder).join("report.html").exists()));
    assert_eq!(rows(&results, query).len(), 8);

    // What fails is not tried again, unless that is asked for; another configuration is another run.
    assert!(batch(&["--set", "scan.every=3"]).contains("broken.clf"));
    assert!(!batch(&["--set", "scan.every=3"]).contains("broken.clf"));
    assert!(batch(&["--set", "scan.every=3", "--retry"]).contains("broken.clf"));
    assert_eq!(rows(&results, query).len(), 10);

    // All of the report is there.
    let report = rows(&results, "SELECT report, '' FROM runs WHERE status = 'done' LIMIT 1");
    let report: serde_json::Value = serde_json::from_str(&report[0].0).unwrap();
    assert!(report.pointer("/errors/odometry/translation_m/rmse").is_some());

    compared(&folders[0].0, &folders[1].0, folder.path());
}

#[test]
fn runs_that_take_too_long_or_too_much_are_rows() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("drive"), folder.path().join("out"));
    simulate(&log, "2");
    let batch = |more: &[&str]| {
        succeed(&[&["batch", log.to_str().unwrap(), "--out", out.to_str().unwrap(), "--preset", "seed"], more].concat())
    };
    batch(&["--time-limit", "0.5", "--set", "filter.particles=20000"]);
    #[cfg(target_os = "linux")]
    batch(&["--memory-limit", "4"]);
    let found = rows(&out.join("results.sqlite"), "SELECT status, error FROM runs ORDER BY id");
    assert_eq!(found[0], ("timed out".to_owned(), "took longer than 0.5 s".to_owned()));
    #[cfg(target_os = "linux")]
    assert!(found[1].0 != "done" && !found[1].1.is_empty(), "{found:?}");
    assert!(!out.join(".running-drive-seed-0").exists());
}

#[cfg(unix)]
#[test]
fn a_batch_that_is_stopped_leaves_no_row_of_what_was_not_finished() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    use std::thread::sleep;
    use std::time::Duration;

    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("drive"), folder.path().join("out"));
    simulate(&log, "3");
    let mut batch = Command::new(env!("CARGO_BIN_EXE_floorprint"));
    batch.arg("batch").arg(&log).arg("--out").arg(&out).args(["--preset", "seed", "--set", "filter.particles=20000"]);
    let mut running = batch.spawn().unwrap();
    while !out.join(".running-drive-seed-0").exists() {
        sleep(Duration::from_millis(5));
    }
    kill(Pid::from_raw(i32::try_from(running.id()).unwrap()), Signal::SIGINT).unwrap();
    assert_eq!(running.wait().unwrap().code(), Some(130));
    assert!(rows(&out.join("results.sqlite"), "SELECT status, log FROM runs").is_empty());
    assert!(!out.join(".running-drive-seed-0").exists(), "no process is left, and nothing of it");
}

/// Compares two runs, and looks for what a page is to show.
fn compared(first: &str, second: &str, folder: &Path) {
    let page = folder.join("compare.html");
    succeed(&["compare", first, second, "--out", page.to_str().unwrap()]);
    let html = fs::read_to_string(&page).unwrap();
    assert_eq!(html.matches("data:image/png").count(), 2, "a map each");
    for part in
        ["position RMSE, m", "from the first run, metres", "By stretch of time", "id=\"blink\"", "What is different"]
    {
        assert!(html.contains(part), "{part}");
    }
    let output = floorprint(&["compare", first, folder.to_str().unwrap(), "--out", page.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("is no folder of a run"), "{said}");
}
