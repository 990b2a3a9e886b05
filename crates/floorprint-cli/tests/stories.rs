//! What users do and what goes wrong: the built program from the outside.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use floorprint_io::RESULTS_OF_RUN;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A short simulated drive, made once.
struct Drive {
    folder: TempDir,
}

impl Drive {
    fn shared() -> &'static Path {
        static DRIVE: OnceLock<Drive> = OnceLock::new();
        DRIVE
            .get_or_init(|| {
                let folder = tempfile::tempdir().unwrap();
                let settings = folder.path().join("simulation.toml");
                // A small sensor and few images: quick, and still everything that a drive has.
                let small =
                    "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 10.0\n[camera]\nrate_hz = 0.5\n";
                fs::write(&settings, small).unwrap();
                let output = floorprint(&[
                    "simulate",
                    "--world",
                    "rooms",
                    "--config",
                    settings.to_str().unwrap(),
                    "--out",
                    folder.path().join("drive").to_str().unwrap(),
                ]);
                assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
                Drive { folder }
            })
            .folder
            .path()
    }
}

fn drive() -> String {
    Drive::shared().join("drive").display().to_string()
}

fn floorprint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must fail; gives what it says.
fn failure(arguments: &[&str], code: i32) -> String {
    let output = floorprint(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert!(output.stdout.is_empty(), "a failure prints no results: {}", text(&output.stdout));
    assert!(!message.contains("panicked"), "{message}");
    message
}

/// Runs the drive into a folder that must not exist yet.
fn run(drive: &str, out: &Path, more: &[&str]) -> Output {
    let output = floorprint(&[&["run", drive, "--out", out.to_str().unwrap()], more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    output
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap()
}

/// The files in a folder and in those in it, by their names relative to it.
fn files_below(folder: &Path, prefix: &str) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let names = |path: std::path::PathBuf| {
        let name = format!("{prefix}{}", path.file_name().unwrap().to_string_lossy());
        if path.is_dir() { files_below(&path, &format!("{name}/")) } else { vec![name] }
    };
    entries.flat_map(names).collect()
}

/// A line of a CARMEN log: a scan with all ranges alike, and the base's odometry.
fn flaser(range: &str, odometry: &str, stamp_s: &str) -> String {
    let ranges = vec![range; 180].join(" ");
    format!("FLASER 180 {ranges} {odometry} {odometry} {stamp_s} host {stamp_s}\n")
}

/// A log of a robot that stands still for two seconds.
fn standing_log(range: &str) -> String {
    (0..20).map(|index| flaser(range, "0 0 0", &format!("{:.1}", f64::from(index) * 0.1))).collect()
}

#[test]
fn a_drive_becomes_a_folder_with_everything_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a folder with spaces");
    let output = run(&drive(), &out, &["--snapshots", "10"]);
    assert!(text(&output.stdout).contains("report.html"));
    for name in [
        "trajectory.tum",
        "trajectory.kitti",
        "live.tum",
        "odometry.tum",
        "map.pgm",
        "map.yaml",
        "map.png",
        "trajectories.png",
        "trajectories.svg",
        "texture.png",
        "texture.json",
        "images.tum",
        "config.toml",
        "report.json",
        "report.html",
        "snapshots/0000.png",
        "snapshots/animation.png",
    ] {
        assert!(out.join(name).metadata().unwrap().len() > 0, "{name}");
    }
    let report = report(&out);
    assert_eq!(report["partial"], false);
    assert!(report["errors"]["trajectory"]["translation_m"]["rmse"].as_f64().unwrap() < 0.2);
    assert!(report["errors"]["map"]["f1"].as_f64().unwrap() > 0.5);
    let trajectory = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    assert_eq!(trajectory.lines().count() as u64, report["drive"]["poses"].as_u64().unwrap());
    let first: Vec<f64> = trajectory.lines().next().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    assert_eq!(first[1..], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "the first pose is the identity");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    // Page and README name all of it, and nothing else.
    let left = files_below(&out, "");
    let is_known = |file: &&String| !file.starts_with("snapshots/0");
    let named: Vec<&str> = page.split("<li><a href=\"").skip(1).filter_map(|item| item.split('"').next()).collect();
    let mut beside: Vec<&str> =
        left.iter().filter(is_known).map(String::as_str).filter(|file| *file != "report.html").collect();
    let mut listed: Vec<&str> =
        RESULTS_OF_RUN.iter().map(|(file, _)| *file).filter(|file| named.contains(file)).collect();
    beside.sort_unstable();
    listed.sort_unstable();
    assert_eq!(beside, listed);
    assert_eq!(named.len(), listed.len());
    let readme = include_str!("../../../README.md");
    let table = readme.split("## What a run leaves").nth(1).unwrap().split("\n## ").next().unwrap();
    for (file, _) in RESULTS_OF_RUN.iter().filter(|(file, _)| !file.starts_with("snapshots/")) {
        assert!(table.contains(&format!("`{file}`")), "README does not name {file}");
    }
    assert!(!page.contains("http://") && !page.contains("https://"), "the page needs no network");
    assert!(page.trim_end().ends_with("</html>"));
    let loops = &report["loops"];
    let counted = loops["closed"].as_u64().unwrap() + loops["rejected"].as_u64().unwrap();
    assert_eq!(loops["candidates"].as_array().unwrap().len() as u64, counted);
}

/// Where `script` stands in for a terminal of 60 columns.
#[test]
fn prose_is_broken_to_fit_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("standing.clf");
    fs::write(&log, standing_log("1.0")).unwrap();
    let program = env!("CARGO_BIN_EXE_floorprint");
    for command in [
        format!("info {}", log.display()),
        "run nothing/lies/here --out o".to_owned(),
        "config explain map".to_owned(),
        "bench --world rooms --set filter.particels=3".to_owned(),
    ] {
        let shell = format!("stty rows 40 cols 60; cd '{}'; '{program}' {command}", folder.path().display());
        let Ok(output) = Command::new("script").args(["-qec", &shell, "/dev/null"]).env("NO_COLOR", "1").output()
        else {
            println!("skipped: there is no `script`");
            return;
        };
        let printed = text(&output.stdout).replace('\r', "");
        let is_table = |line: &&str| {
            line.starts_with("sha256 ")
                || line.starts_with("sensor ")
                || line.starts_with("LiDAR  ")
                || line.starts_with("odometry ")
        };
        for line in printed.lines().filter(|line| !is_table(line) && line.contains(' ')) {
            assert!(line.chars().count() <= 60, "{command}: {line}");
        }
        assert!(printed.lines().count() > 1, "{printed}");
    }
}

#[test]
fn the_results_are_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    for preset in ["default", "fast", "accurate", "seed", "gmapping"] {
        let runs: Vec<_> = ["1", "2", "8"]
            .map(|threads| {
                let out = folder.path().join(format!("{preset}-{threads}"));
                run(&drive(), &out, &["--threads", threads, "--preset", preset, "--set", "filter.particles=12"]);
                out
            })
            .into();
        for name in ["trajectory.tum", "odometry.tum", "map.pgm", "map.png", "texture.png", "config.toml"] {
            let first = fs::read(runs[0].join(name)).unwrap();
            for other in &runs[1..] {
                assert!(
                    first == fs::read(other.join(name)).unwrap(),
                    "{preset}: {name} differs in {}",
                    other.display()
                );
            }
        }
        let without_cost = |out: &Path| {
            let mut report = report(out);
            report.as_object_mut().unwrap().remove("cost");
            report.as_object_mut().unwrap().remove("made");
            report
        };
        assert_eq!(without_cost(&runs[0]), without_cost(&runs[1]));
        assert_eq!(without_cost(&runs[0]), without_cost(&runs[2]));
    }
}

#[test]
fn a_drive_that_comes_in_live_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let results =
        |out: &Path| ["trajectory.tum", "odometry.tum", "map.pgm"].map(|name| fs::read(out.join(name)).unwrap());
    for survey in ["true", "false"] {
        let survey = format!("odometry.survey={survey}");
        let out = folder.path().join(format!("run-{survey}"));
        run(&drive(), &out, &["--no-texture", "--set", &survey]);
        let expected = results(&out);
        for (threads, jitter) in [("1", "0"), ("2", "0.15"), ("8", "0.29")] {
            let out = folder.path().join(format!("replay-{survey}-{threads}"));
            let output = floorprint(&[
                "replay",
                &drive(),
                "--out",
                out.to_str().unwrap(),
                "--jitter",
                jitter,
                "--threads",
                threads,
                "--no-texture",
                "--set",
                &survey,
            ]);
            assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
            assert!(results(&out) == expected, "{survey}, {threads} threads, {jitter} s of jitter");
        }
    }
    let out = folder.path().join("lossy");
    let output = floorprint(&[
        "replay",
        &drive(),
        "--out",
        out.to_str().unwrap(),
        "--jitter",
        "0.1",
        "--drop",
        "0.1",
        "--seed",
        "3",
        "--no-texture",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let (all, lossy) = (report(&folder.path().join("run-odometry.survey=true")), report(&out));
    let poses = |report: &serde_json::Value| report["drive"]["poses"].as_f64().unwrap();
    let share = poses(&lossy) / poses(&all);
    assert!((0.85..0.95).contains(&share), "{share}");
    assert!(lossy["errors"]["trajectory"]["translation_m"]["rmse"].as_f64().unwrap() < 0.03, "{lossy}");
}

#[test]
fn the_resolved_configuration_repeats_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    run(&drive(), &first, &["--no-texture", "--set", "map.resolution_m=0.1", "--seed", "7"]);
    run(&drive(), &second, &["--no-texture", "--config", first.join("config.toml").to_str().unwrap()]);
    for name in ["trajectory.tum", "map.pgm", "config.toml"] {
        assert!(fs::read(first.join(name)).unwrap() == fs::read(second.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn an_earlier_run_is_replaced_only_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    run(&drive(), &out, &["--no-texture"]);
    let message = failure(&["run", &drive(), "--no-texture", "--out", out.to_str().unwrap()], 1);
    assert!(message.contains("--force"), "{message}");
    run(&drive(), &out, &["--no-texture", "--force", "--snapshots", "30"]);
    run(&drive(), &out, &["--no-texture", "--force"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside the results");
    fs::write(out.join("thesis.doc"), "mine").unwrap();
    let message = failure(&["run", &drive(), "--no-texture", "--force", "--out", out.to_str().unwrap()], 1);
    assert!(message.contains("thesis.doc"), "{message}");
    assert_eq!(fs::read(out.join("thesis.doc")).unwrap(), b"mine");
}

#[test]
fn results_are_evaluated_against_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    run(&drive(), &out, &[]);
    let file = |base: &Path, name: &str| base.join(name).display().to_string();
    let truth = Path::new(&drive()).to_path_buf();
    let json = |arguments: &[&str]| -> serde_json::Value {
        let output = floorprint(arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (estimate, true_file) = (file(&out, "trajectory.tum"), file(&truth, "truth.tum"));
    let error = json(&["evaluate", "trajectory", &true_file, &estimate, "--json"]);
    let rmse = |error: &serde_json::Value| error["translation_m"]["rmse"].as_f64().unwrap();
    // Files hold micrometres.
    assert!((rmse(&error) - rmse(&report(&out)["errors"]["trajectory"])).abs() < 1e-6);
    let (estimate, true_file) = (file(&out, "map.yaml"), file(&truth, "truth_map.yaml"));
    let quality = json(&["evaluate", "map", &true_file, &estimate, "--json"]);
    assert_eq!(quality, report(&out)["errors"]["map"]);
    let (estimate, true_file) = (file(&out, "texture.json"), file(&truth, "truth_texture.json"));
    let error = json(&["evaluate", "texture", "--texture", &estimate, "--truth", &true_file, "--json"]);
    let reported = &report(&out)["errors"]["texture"];
    assert_eq!(error["mean_absolute_error"], reported["mean_absolute_error"]);
    let coverage = |error: &serde_json::Value| error["coverage"].as_f64().unwrap();
    assert!((coverage(&error) - coverage(reported)).abs() < 1e-3);
    fs::remove_file(out.join("images.tum")).unwrap();
    let output = floorprint(&["evaluate", "texture", "--texture", &estimate, "--truth", &true_file]);
    assert!(text(&output.stdout).contains("coverage unknown"));
}

#[test]
fn a_drive_without_camera_or_imu_is_solved_and_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let poor = folder.path().join("poor");
    fs::create_dir(&poor).unwrap();
    for name in ["Encoders1.npz", "Hokuyo1.npz"] {
        fs::copy(Path::new(&drive()).join(name), poor.join(name)).unwrap();
    }
    let out = folder.path().join("out");
    let output = run(poor.to_str().unwrap(), &out, &[]);
    let message = text(&output.stderr);
    assert!(message.contains("IMU") && message.contains("Kinect"), "{message}");
    assert!(!out.join("texture.png").exists());
}

#[test]
fn a_drive_without_odometry_has_no_dead_reckoning() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    run(&drive(), &out, &["--set", "odometry.source=scan_matching"]);
    assert!(!out.join("odometry.tum").exists() && out.join("live.tum").exists());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(!page.contains("odometry.tum") && !page.contains("id=\"show-odometry\""));
    // What reads runs takes this one, too.
    let out = out.to_str().unwrap();
    for arguments in [&["plot", out, "--out"][..], &["compare", out, out, "--out"]] {
        let written = folder.path().join(if arguments[0] == "plot" { "plot.svg" } else { "compare.html" });
        let output = floorprint(&[arguments, &[written.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
}

#[test]
fn a_drive_without_a_lidar_is_dead_reckoned_and_has_no_map() {
    let folder = tempfile::tempdir().unwrap();
    let (blind, out) = (folder.path().join("blind"), folder.path().join("out"));
    fs::create_dir(&blind).unwrap();
    for name in ["Encoders1.npz", "Imu1.npz", "Kinect1.npz", "truth.tum", "truth_map.yaml", "truth_map.pgm"] {
        fs::copy(Path::new(&drive()).join(name), blind.join(name)).unwrap();
    }
    let blind = blind.to_str().unwrap();
    let sentence = "there is no LiDAR and so no map, only dead reckoning";
    let said = run(blind, &out, &["--snapshots", "10"]);
    assert_eq!(text(&said.stderr).matches(sentence).count(), 1, "{}", text(&said.stderr));
    assert!(text(&said.stdout).contains("poses by dead reckoning") && !text(&said.stdout).contains("map"));
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    let expected = ["config.toml", "report.html", "report.json", "trajectories.png", "trajectories.svg"];
    assert_eq!(names, [&expected[..], &["trajectory.kitti", "trajectory.tum"]].concat());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left beside the results");
    let report = report(&out);
    assert!(report.get("map").is_none() && report.get("filter").is_none() && report.get("loops").is_none());
    assert_eq!(report["drive"]["odometry"], "wheels_and_gyro");
    assert_eq!(report["dropped_share"], 0.0, "who leaves all images out has lost none: {}", report["dropped"]);
    assert!(report["errors"].get("map").is_none(), "{}", report["errors"]);
    assert!(report["errors"]["trajectory"]["translation_m"]["rmse"].as_f64().unwrap() < 1.0);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("no LiDAR: dead reckoning, no map") && !page.contains("map.png"));
    assert!(!page.contains("<div class=\"pair\"></div>"), "no strip of nothing");

    assert!(text(&floorprint(&["info", blind]).stdout).contains(sentence));
    let checked = floorprint(&["check", blind]);
    assert_eq!(checked.status.code(), Some(1), "there can be no map");
    assert!(text(&checked.stderr).contains(sentence), "{}", text(&checked.stderr));
    // What shows or compares runs takes this one, too.
    let (out, picture) = (out.to_str().unwrap(), folder.path().join("plot.svg"));
    assert_eq!(floorprint(&["plot", out, "--out", picture.to_str().unwrap()]).status.code(), Some(0));
    let page = folder.path().join("compare.html");
    assert_eq!(floorprint(&["compare", out, out, "--out", page.to_str().unwrap()]).status.code(), Some(0));
    assert!(fs::read_to_string(page).unwrap().contains("<section class=\"card\"><figure"), "charts lie on cards");
    // What needs scans says so before any work.
    let more = folder.path().join("more");
    let refused = |extra: &[&str]| failure(&[&["run", blind, "--out", more.to_str().unwrap()], extra].concat(), 1);
    assert!(refused(&["--mcap", more.with_extension("mcap").to_str().unwrap()]).contains("there is no LiDAR"));
    fs::remove_file(Path::new(blind).join("Encoders1.npz")).unwrap();
    assert!(refused(&[]).contains("a map needs a HokuyoN.npz"));
}

/// Once the robot comes by places that it knows, once the drive ends before that.
#[test]
fn without_odometry_nothing_is_said_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let summary = text(&run(&drive(), &out, more).stdout);
        let rows: Vec<String> = summary.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect();
        (rows, report(&out))
    };
    let (rows, with) = told("with", &[]);
    assert!(rows.iter().any(|row| row == "odometry") && with["errors"]["odometry"].is_object(), "{rows:?}");
    let (rows, without) = told("without", &["--set", "odometry.source=\"scan_matching\""]);
    assert!(!rows.iter().any(|row| row == "odometry" || row == "conflicts"), "{rows:?}");
    assert!(without["errors"]["odometry"].is_null() && without["errors"]["trajectory"].is_object(), "{without}");
    assert_eq!(without["filter"]["odometry_rejections"], 0);
}

#[test]
fn a_robot_that_was_carried_elsewhere_is_said_to_be_and_where_it_was_found() {
    let folder = tempfile::tempdir().unwrap();
    for (name, faults, is_found) in [
        ("found", "[[faults]]\nkidnapping = { at_s = 28.0, ahead_m = -8.0 }\n", true),
        ("lost", "[[faults]]\nkidnapping = { at_s = 40.0, ahead_m = 6.0 }\n", false),
    ] {
        let settings = folder.path().join(format!("{name}.toml"));
        fs::write(&settings, format!("camera.rate_hz = 0.0\n[lidar]\nbeams = 361\nrate_hz = 10.0\n{faults}")).unwrap();
        let drive = folder.path().join(format!("{name}-drive"));
        let simulate = ["simulate", "--seed", "1", "--config", settings.to_str().unwrap(), "--out"];
        let output = floorprint(&[&simulate[..], &[drive.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let out = folder.path().join(name);
        let printed = text(&run(drive.to_str().unwrap(), &out, &[]).stdout);
        let report = report(&out);
        let kidnappings = report["kidnappings"].as_array().unwrap();
        assert_eq!(kidnappings.len(), 1, "{kidnappings:?}");
        let time_s = kidnappings[0]["time_s"].as_f64().unwrap();
        let stamp_s = kidnappings[0]["stamp_s"].as_f64().unwrap();
        let line = printed.lines().find(|line| line.contains("carried elsewhere")).unwrap();
        assert!(line.contains(&format!("after {time_s:.1} s (stamp {stamp_s:.3} s)")), "{line}");
        assert_eq!(line.contains("found again") && line.contains("set down at"), is_found, "{line}");
        assert_eq!(line.contains("not found again"), !is_found, "{line}");
        assert_eq!(kidnappings[0]["found"].is_object(), is_found, "{kidnappings:?}");
        assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("Robot carried elsewhere"));
    }
}

#[test]
fn usage_shows_what_is_needed() {
    for what in ["trajectory", "map", "texture", "relations"] {
        let help = text(&floorprint(&["evaluate", what, "--help"]).stdout);
        let usage = help.lines().find(|line| line.starts_with("Usage:")).unwrap();
        assert!(
            usage.ends_with("[OPTIONS] <TRUTH> <ESTIMATE>") || usage.ends_with("<RELATIONS> <ESTIMATE>"),
            "{usage}"
        );
    }
}

#[test]
fn wrong_and_empty_paths_are_explained() {
    let message = failure(&["run", "no/such/drive"], 1);
    assert!(message.contains("no/such/drive"), "{message}");
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.clf");
    fs::write(&empty, "").unwrap();
    let out = folder.path().join("out");
    let message = failure(&["run", empty.to_str().unwrap(), "--out", out.to_str().unwrap()], 1);
    assert!(message.contains("the file is empty"), "{message}");
    let message = failure(&["run", tempfile::tempdir().unwrap().path().to_str().unwrap()], 1);
    assert!(message.contains("the folder is empty") && message.contains("one of:"), "{message}");
    let message = failure(&["run", "no/such/drive", "--out", folder.path().join("deep/er/x").to_str().unwrap()], 1);
    assert!(message.contains("no/such/drive"), "{message}");
    let message = failure(&["run", &drive(), "--out", empty.join("x").to_str().unwrap()], 1);
    assert!(message.contains("choose another place"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "a failure leaves nothing behind");
}

#[test]
fn logs_in_which_nothing_is_seen_are_failures_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("drive.clf"), folder.path().join("out"));
    let fails = |content: &str| {
        fs::write(&log, content).unwrap();
        let message = failure(&["run", log.to_str().unwrap(), "--out", out.to_str().unwrap()], 1);
        assert!(message.contains("drive.clf") && !out.exists(), "{message}");
        assert_eq!(message.lines().filter(|line| line.starts_with("error")).count(), 1, "{message}");
        message
    };
    for range in ["1e30", "4500"] {
        let message = fails(&standing_log(range));
        assert!(message.contains("which cannot be metres"), "{message}");
    }
    // Ranges that may be metres, none of which is a measurement.
    let message = fails(&standing_log("79.5"));
    assert!(message.contains("of the rays hit anything") && message.contains("scan.range_max_m"), "{message}");
    let message = fails(&"ODOM 1.0 0.0 0.0 0.1 0.0 0.0 1.0 host 0.1\n".repeat(3));
    assert!(message.contains("a map needs FLASER") && !message.contains("stands out"), "{message}");
    let message = fails(&standing_log("2.0").replace("FLASER 180", "FLASER 999"));
    assert!(message.contains("announces 999 ranges") && message.len() < 400, "{message}");
    fs::write(&log, standing_log("2.0")).unwrap();
    let message = failure(&["run", log.to_str().unwrap(), "--drive", "3"], 1);
    assert!(message.contains("no drive 3"), "{message}");
}

#[test]
fn scans_that_the_filter_refuses_shift_no_poses() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("drive.clf"), folder.path().join("out"));
    // The odometry leaps so far that motions overflow, and comes back.
    let leaps = |index: u32| if (8..11).contains(&index) { "1e308 0 0" } else { "-1e308 0 0" };
    let lines: String = (0..20).map(|index| flaser("2.0", leaps(index), &format!("{index}.0"))).collect();
    fs::write(&log, lines).unwrap();
    run(log.to_str().unwrap(), &out, &["--max-dropped", "1", "--snapshots", "5"]);
    let stamps = |name: &str| -> Vec<String> {
        let text = fs::read_to_string(out.join(name)).unwrap();
        text.lines().map(|line| line.split(' ').next().unwrap().to_owned()).collect()
    };
    assert_eq!(stamps("trajectory.tum"), stamps("odometry.tum"));
    assert_eq!(stamps("trajectory.tum").len(), 16);
    assert_eq!(report(&out)["dropped"][0]["count"], 4, "{}", report(&out)["dropped"]);
}

#[test]
fn a_trajectory_that_shares_nothing_with_the_truth_is_no_result() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        fs::write(folder.path().join(name), content).unwrap();
        folder.path().join(name).display().to_string()
    };
    let trajectory = file("a.tum", "10 0 0 0 0 0 0 1\n11 1 0 0 0 0 0 1\n");
    let relations = file("a.relations", "10 11 1 0 0 0 0 0\n");
    let evaluate = |trajectory: &str, relations: &str, code: i32| {
        let arguments = ["evaluate", "relations", "--trajectory", trajectory, "--relations", relations];
        if code == 0 { text(&floorprint(&arguments).stdout) } else { failure(&arguments, code) }
    };
    assert!(evaluate(&trajectory, &relations, 0).contains("1 of 1 relations matched"));
    let shifted = file("b.tum", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n");
    let message = evaluate(&shifted, &relations, 1);
    assert!(message.contains("b.tum") && message.contains("a.relations"), "{message}");
    assert!(message.contains("0.000 to 1.000 s") && message.contains("10.000 to 11.000 s"), "{message}");
    assert!(evaluate(&file("c.tum", "# nothing\n"), &relations, 1).contains("c.tum: it holds no pose"));
    let two = file("b.relations", "10 11 1 0 0 0 0 0\n11 10 -1 0 0 0 0 0\n");
    let with_odometry = |odometry: &str| {
        floorprint(&["evaluate", "relations", "--trajectory", &trajectory, "--relations", &two, "--odometry", odometry])
    };
    assert!(text(&with_odometry(&trajectory).stdout).contains("own noise"));
    assert!(text(&with_odometry(&shifted).stderr).contains("fewer than two short relations"));
    assert_eq!(evaluate(&relations, &trajectory, 1).lines().count(), 1);
}

#[test]
fn pose_graphs_keep_their_names_and_faults_are_told_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let (graph, out) = (folder.path().join("a.g2o"), folder.path().join("b.g2o"));
    let arguments = ["optimize", graph.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let information = "1 0 0 1 0 1";
    let text_of = |edge: &str| format!("VERTEX_SE2 3 0 0 0\nVERTEX_SE2 9 2 0 0\nFIX 3\nEDGE_SE2 3 9 1 0 0 {edge}\n");
    fs::write(&graph, text_of(information)).unwrap();
    let output = floorprint(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let solved = fs::read_to_string(&out).unwrap();
    assert!(solved.starts_with("VERTEX_SE2 3 0.0 0.0 0.0\nVERTEX_SE2 9 1.0"), "{solved}");
    assert!(solved.contains("FIX 3\nEDGE_SE2 3 9 "), "{solved}");
    for (content, said) in [
        (String::new(), "a.g2o: it holds no VERTEX_SE2"),
        (text_of("1 5 0 1 0 1"), "a.g2o, line 4: an information matrix with a negative eigenvalue"),
        (text_of("1e300 0 0 1 0 1"), "a.g2o, line 4: an information matrix that is not finite or beyond 1e30"),
        (text_of("0 0 0 0 0 0"), "a.g2o: the graph does not determine"),
        (text_of("1 0 0 1 0 1 7"), "a.g2o, line 4: \"EDGE_SE2 3 9"),
    ] {
        fs::write(&graph, content).unwrap();
        let message = failure(&arguments, 1);
        assert!(message.contains(said) && message.lines().count() == 1, "{message}");
        assert_eq!(fs::read_to_string(&out).unwrap(), solved, "a failure leaves the old file");
    }
}

#[test]
fn misspelt_settings_lead_to_the_right_ones() {
    let message = failure(&["run", &drive(), "--preset", "defualt"], 2);
    assert!(message.contains("`default`"), "{message}");
    let message = failure(&["run", &drive(), "--out", "unused", "--set", "filter.particels=3"], 2);
    assert!(message.contains("filter.particles"), "{message}");
    let message = failure(&["run", &drive(), "--out", "unused", "--set", "map.resolution_m=-1"], 2);
    assert!(message.contains("expected a number from 0.005 to 2"), "{message}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("my.toml");
    fs::write(&file, "[filter]\nresampler = \"stratifed\"\n").unwrap();
    let message = failure(&["config", "show", "--config", file.to_str().unwrap()], 2);
    assert!(message.contains("my.toml:2") && message.contains("stratified"), "{message}");
    assert!(failure(&["config", "explain", "particels"], 2).contains("no option"));
    assert!(failure(&["simulate", "--world", "room", "--out", "unused"], 2).contains("rooms"));
    fs::write(&file, "[lidar]\nbeems = 3\n").unwrap();
    let message = failure(&["simulate", "--config", file.to_str().unwrap(), "--out", "unused"], 2);
    assert!(message.contains("line 2") && message.contains("beams") && message.lines().count() == 1, "{message}");
}

#[test]
fn bad_arguments_have_an_exit_code_of_their_own_and_name_the_option() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    for (arguments, said) in [
        (&["run", "x", "--threads", "-1"][..], "--threads"),
        (&["run", "x", "--seed", "-1"], "--seed"),
        (&["run", "x", "--max-dropped", "7"], "from 0 to 1"),
        (&["run", "x", "--max-dropped", "nan"], "from 0 to 1"),
        (&["run", "x", "--max-dropped", "-1"], "from 0 to 1"),
        (&["optimize", "x", "--out", out, "--iterations", "-1"], "--iterations"),
        (&["bench", "--world", "rooms", "--range-m", "-3"], "--range-m"),
        (&["bench", "--world", "rooms", "--rate-hz", "0"], "--rate-hz"),
        (&["bench", "--world", "rooms", "--field-of-view-deg", "720"], "from 1 to 360"),
        (&["bench", "--out", out], "--world NAME, or --growth"),
        (&["run", &drive(), "--out", out, "--config", "missing.toml"], "missing.toml"),
        (&["run", &drive(), "--out", out, "--config", folder.path().to_str().unwrap()], "configuration file"),
        (&["run", &drive(), "--out", out, "--set", "scan.range_max_m=0.06", "--set", "scan.range_min_m=3"], "scan."),
    ] {
        let message = failure(arguments, 2);
        assert!(message.contains(said) && !message.contains("-- -"), "{arguments:?}: {message}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    let message = failure(&["bench", folder.path().to_str().unwrap(), "--out", out], 1);
    assert!(message.contains(folder.path().to_str().unwrap()), "{message}");
}

#[test]
fn the_configuration_is_shown_and_explained() {
    let shown = text(&floorprint(&["config", "show", "--preset", "seed"]).stdout);
    assert!(shown.contains("kind = \"shared_map\""), "{shown}");
    let explained = text(&floorprint(&["config", "explain", "filter.particles"]).stdout);
    assert!(explained.contains("whole number") && explained.contains("seed"), "{explained}");
    let schema: serde_json::Value = serde_json::from_slice(&floorprint(&["config", "schema"]).stdout).unwrap();
    assert!(schema["properties"]["filter"].is_object());
}

#[test]
fn a_data_set_is_described() {
    let info: serde_json::Value = serde_json::from_slice(&floorprint(&["info", &drive(), "--json"]).stdout).unwrap();
    let sensors: Vec<_> = info["sensors"].as_array().unwrap().iter().map(|s| s["sensor"].as_str().unwrap()).collect();
    assert_eq!(sensors, ["LiDAR", "encoders", "IMU", "depth images", "colour images"]);
    let rate = info["sensors"][0]["rate_hz"].as_f64().unwrap();
    assert!((rate - 10.0).abs() < 0.1, "{rate}");
    assert!(text(&floorprint(&["info", &drive()]).stdout).contains("track_width_m"));
}

#[test]
fn too_many_dropped_data_have_an_exit_code_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("garbled.clf");
    fs::write(&log, standing_log("2.0") + &"FLASER 180 1.0 garbled\n".repeat(10)).unwrap();
    let out = folder.path().join("out");
    let arguments = ["run", log.to_str().unwrap(), "--out", out.to_str().unwrap(), "--force"];
    assert_eq!(floorprint(&arguments).status.code(), Some(3));
    assert_eq!(report(&out)["dropped"][0]["count"], 10);
    assert_eq!(floorprint(&[&arguments[..], &["--max-dropped", "0.5"]].concat()).status.code(), Some(0));
}

#[test]
fn presets_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bench");
    let bench = ["bench", &drive(), "--preset", "fast", "--preset", "seed", "--seeds", "2", "--out"];
    let output = floorprint(&[&bench[..], &[out.to_str().unwrap(), "--set", "loop_closure.enabled=false"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&fs::read(out.join("bench.json")).unwrap()).unwrap();
    let runs = |row: usize| found["data_sets"][row]["runs"].as_array().unwrap();
    assert_eq!([runs(0).len(), runs(1).len()], [1, 2], "one particle draws nothing: one run stands for all seeds");
    assert!(runs(0)[0]["translation_m"].as_f64().unwrap() < 0.2);
    assert!(runs(0)[0]["scan_ms"]["p99"].as_f64().unwrap() > 0.0);
    let printed = text(&output.stdout);
    assert!(printed.contains("| drive    | fast   | 1    |"), "{printed}");
    let width = printed.lines().filter(|line| line.starts_with('|')).map(|line| line.chars().count()).max();
    assert!(width.unwrap() <= 100, "{printed}");
}

#[test]
fn a_simulated_world_is_measured_against_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bench");
    let world = ["bench", "--world", "rooms", "--preset", "fast", "--seeds", "1", "--beams", "181", "--rate-hz", "10"];
    let growth = ["--growth", "0.15,0.3", "--lidar-at", "-0.1,0.05,10", "--out", out.to_str().unwrap()];
    let output = floorprint(&[&world[..], &growth[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "bench.md, bench.json, growth.svg and no drive: {names:?}");
    let found: serde_json::Value = serde_json::from_slice(&fs::read(out.join("bench.json")).unwrap()).unwrap();
    let run = &found["worlds"][0]["runs"][0];
    let number = |key: &str| run[key].as_f64().unwrap();
    assert!(number("translation_m") < 0.05 && number("translation_m") <= number("largest_m"), "{run}");
    assert!(number("map_f1") > 0.5 && number("cpu_s") > 0.0 && number("peak_memory_bytes") > 0.0, "{run}");
    let growth = found["growth"].as_array().unwrap();
    assert!(growth[0]["runs"][0]["scans"].as_u64() < growth[1]["runs"][0]["scans"].as_u64());
    assert!(fs::read_to_string(out.join("growth.svg")).unwrap().contains("CPU time of a scan"));
    let schema = floorprint(&["bench", "--schema"]);
    assert!(text(&schema.stdout).contains("wrong_closures"));
}

#[test]
fn a_benchmark_tells_first_what_cannot_work_and_goes_on_past_a_broken_log() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bench");
    let out = out.to_str().unwrap();
    assert!(failure(&["bench", "no/such/folder", "--out", out], 1).contains("no/such/folder"));
    assert!(failure(&["bench", &drive(), "--set", "filter.particels=3", "--out", out], 2).contains("filter.particles"));
    assert!(failure(&["bench", "--world", "room", "--out", out], 2).contains("rooms"));
    assert!(!Path::new(out).exists());
    let broken = folder.path().join("broken.clf");
    fs::write(&broken, "nonsense").unwrap();
    let good = drive();
    let output =
        floorprint(&["bench", broken.to_str().unwrap(), &good, "--preset", "fast", "--seeds", "1", "--out", out]);
    assert_eq!(output.status.code(), Some(1));
    let table = text(&output.stdout);
    assert!(
        table.contains("| drive    | fast   | 1    |") && table.contains("No figures from broken, fast"),
        "{table}"
    );
    // What cannot be done with one seed is not tried with five.
    let output = floorprint(&["bench", broken.to_str().unwrap(), "--preset", "seed", "--seeds", "5", "--out", out]);
    let figures: serde_json::Value =
        serde_json::from_slice(&fs::read(Path::new(out).join("bench.json")).unwrap()).unwrap();
    assert_eq!(figures["failures"].as_array().unwrap().len(), 1, "{}", text(&output.stderr));
}

#[test]
fn a_benchmark_measures_once_what_was_asked_for_twice_and_takes_any_name() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("-odd.clf"), standing_log("2.0")).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_floorprint"))
        .current_dir(folder.path())
        .args(["bench", "--seeds", "1", "--preset", "fast", "--preset", "fast", "--out", "bench"])
        .args(["--growth", "0.1,0.10", "--beams", "91", "--rate-hz", "5", "--", "-odd.clf"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("bench/bench.json")).unwrap()).unwrap();
    assert_eq!(found["data_sets"][0]["runs"].as_array().unwrap().len(), 1);
    assert_eq!(found["growth"].as_array().unwrap().len(), 1);
    assert_eq!(found["growth"][0]["runs"].as_array().unwrap().len(), 1);
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_was_computed_and_marks_it() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    use std::time::{Duration, Instant};
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // So many particles that the end is far away when the signal comes.
    let start = || {
        let child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
            .args([
                "run",
                &drive(),
                "--preset",
                "seed",
                "--set",
                "filter.particles=100000",
                "--snapshots",
                "0.1",
                "--out",
            ])
            .arg(&out)
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // The handler is set before the folder is made, and by and by the first scans are done.
        let started = Instant::now();
        while fs::read_dir(folder.path()).unwrap().next().is_none() {
            assert!(started.elapsed() < Duration::from_secs(60), "the run did not start");
            std::thread::sleep(Duration::from_millis(10));
        }
        std::thread::sleep(Duration::from_millis(1500));
        let process = Pid::from_raw(i32::try_from(child.id()).unwrap());
        (child, process)
    };
    let (mut child, process) = start();
    kill(process, Signal::SIGINT).unwrap();
    let status = child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
    let report = report(&out);
    assert_eq!(report["partial"], true);
    assert!(report["drive"]["poses"].as_u64().unwrap() < report["drive"]["scans"].as_u64().unwrap());
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("partial"));

    fs::remove_dir_all(&out).unwrap();
    let (mut child, process) = start();
    kill(process, Signal::SIGINT).unwrap();
    std::thread::sleep(Duration::from_millis(5));
    kill(process, Signal::SIGINT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let left = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(left.filter(|name| name != "out").count(), 0, "an end at once leaves nothing unfinished");
}

/// Whatever a run is at: reading, looking for a robot that was carried elsewhere, fitting all scans to each other, writing.
#[cfg(unix)]
#[test]
fn a_run_is_stopped_soon_at_any_moment_and_leaves_whole_results_or_none() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    use std::time::{Duration, Instant};
    let folder = tempfile::tempdir().unwrap();
    let (carried, out) = (folder.path().join("carried"), folder.path().join("out"));
    let settings = folder.path().join("carried.toml");
    let faults = "[[faults]]\nkidnapping = { at_s = 28.0, ahead_m = -8.0 }\n";
    fs::write(&settings, format!("camera.rate_hz = 0.0\n[lidar]\nbeams = 361\n{faults}")).unwrap();
    let [settings, carried] = [&settings, &carried].map(|path| path.to_str().unwrap());
    let made = floorprint(&["simulate", "--seed", "1", "--config", settings, "--out", carried, "-q"]);
    assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
    let start = || {
        let _ = fs::remove_dir_all(&out);
        let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
        command.args(["run", carried, "-q", "--out"]).arg(&out).stderr(std::process::Stdio::null());
        (command.spawn().unwrap(), Instant::now())
    };
    let (mut whole, started) = start();
    assert_eq!(whole.wait().unwrap().code(), Some(0));
    let takes = started.elapsed();
    for part in [0.05, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98] {
        let (mut child, _) = start();
        std::thread::sleep(takes.mul_f64(part));
        let _ = kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), Signal::SIGTERM);
        let told = Instant::now();
        let code = child.wait().unwrap().code();
        // Drawing and writing what there is takes a part of the whole.
        let most = Duration::from_secs(1) + takes / 2;
        assert!(told.elapsed() < most, "{part}: {:?} of {takes:?}", told.elapsed());
        // A handler that is not set yet stops nothing: then a signal ends the program.
        assert!(matches!(code, Some(0 | 130) | None), "{part}: {code:?}");
        if out.exists() {
            let report = report(&out);
            let poses = fs::read_to_string(out.join("trajectory.tum")).unwrap().lines().count() as u64;
            assert_eq!(report["drive"]["poses"].as_u64(), Some(poses), "{part}");
            assert_eq!(report["partial"] == true, code == Some(130), "{part}: {code:?}");
        }
        if code.is_some() {
            let names =
                fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
            let left: Vec<_> =
                names.filter(|name| !["carried", "carried.toml", "out"].contains(&name.as_str())).collect();
            assert!(left.is_empty(), "{part}: {left:?}");
        }
    }
}

#[cfg(unix)]
#[test]
fn a_benchmark_that_is_stopped_gives_the_table_of_the_runs_so_far() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    use std::time::{Duration, Instant};
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bench");
    let slow = ["bench", "--world", "long_loop", "--preset", "default", "--seeds", "1", "--out"];
    let child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
        .args(slow)
        .arg(&out)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while !out.join("bench.json").exists() {
        assert!(started.elapsed() < Duration::from_secs(60), "the benchmark did not start");
        std::thread::sleep(Duration::from_millis(10));
    }
    // Long enough for the first run to start, and far too short for its end.
    std::thread::sleep(Duration::from_millis(500));
    kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), Signal::SIGINT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    assert!(text(&output.stdout).contains("Stopped before its end"));
    assert_eq!(fs::read_dir(&out).unwrap().count(), 2, "bench.md and bench.json");
}

#[cfg(unix)]
#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    use std::process::Stdio;
    let mut child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
        .args(["config", "explain"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let output = floorprint(&["man", "--out", folder.path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    for page in ["floorprint.1", "floorprint-run.1", "floorprint-evaluate-map.1", "floorprint-config-show.1"] {
        let page = fs::read_to_string(folder.path().join(page)).unwrap();
        assert!(page.contains(".SH NAME") && page.contains(".SH SYNOPSIS"), "{page}");
    }
    assert!(!folder.path().join("floorprint-bench-drive.1").exists());
    assert!(text(&floorprint(&["man", "evaluate", "map"]).stdout).contains("floorprint-evaluate-map"));
    assert!(failure(&["man", "evaluate", "mop"], 2).contains("expected one of: trajectory, map"));
}

#[test]
fn the_configuration_is_shown_as_it_comes_out_for_a_data_set() {
    let plain = text(&floorprint(&["config", "show"]).stdout);
    let output = floorprint(&["config", "show", &drive(), "--preset", "seed"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("name = \"ece276a\"") && !plain.contains("name = \"ece276a\""));
    let schema = text(&floorprint(&["simulate", "--schema"]).stdout);
    assert!(schema.contains("kidnapping") && schema.contains("near_noise_m"), "{schema}");
}

#[test]
fn a_run_or_a_session_is_drawn_as_one_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    run(&drive(), &folder.path().join("run"), &["--no-texture"]);
    let plot = |run: &str, out: &str, more: &[&str]| {
        let output = floorprint(&[&["plot", &path(run), "--out", &path(out)], more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        (fs::read(path(out)).unwrap(), text(&output.stderr))
    };
    // The truth is found beside the data set, or where one says.
    let truth = format!("{}/truth.tum", drive());
    let (svg, _) = plot("run", "found.svg", &[]);
    assert_eq!(plot("run", "named.svg", &["--truth", &truth]).0, svg);
    let svg = text(&svg);
    for part in ["position RMSE", "class=\"truth\"", "class=\"odometry\"", ">Position error, m<", " m</text>"] {
        assert!(svg.contains(part), "{part}");
    }
    assert_eq!(svg.matches("data:image/png").count(), 1);
    // Without it what was put right later is told, and that it was known once.
    let report = fs::read_to_string(path("run/report.json")).unwrap();
    fs::write(path("run/report.json"), report.replace(&drive(), "nowhere")).unwrap();
    let (svg, said) = plot("run", "without.svg", &[]);
    assert!(text(&svg).contains("What was put right later") && !text(&svg).contains("class=\"truth\""));
    assert!(said.contains("--truth names it"), "{said}");
    // A session has its trajectory only; pixels hold what has no letters.
    let (svg, _) = plot("run/session.gpkg", "session.svg", &[]);
    assert!(text(&svg).contains("class=\"trajectory\"") && !text(&svg).contains("class=\"odometry\""));
    assert!(plot("run", "pixels.png", &[]).0.starts_with(b"\x89PNG"));
    assert!(failure(&["plot", &path("run"), "--out", "picture.pdf"], 2).contains(".svg or .png"));
    assert!(failure(&["plot", folder.path().to_str().unwrap()], 1).contains("is no folder of a run"));
    // What another command left looks like a run, but is none.
    fs::write(path("run/report.json"), report.replacen("\"what\": \"", "\"what\": \"another ", 1)).unwrap();
    assert!(failure(&["plot", &path("run")], 1).contains("made by another command"));
}

#[test]
fn a_quiet_run_says_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let output = run(&drive(), &out, &["--no-texture", "--quiet"]);
    assert!(output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");
}

#[test]
fn the_same_command_twice_has_two_folders() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("drive.clf");
    fs::write(&log, standing_log("2.0")).unwrap();
    for _ in 0..3 {
        let output =
            Command::new(env!("CARGO_BIN_EXE_floorprint")).args(["run", "drive.clf"]).current_dir(&folder).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
    let mut runs: Vec<_> =
        fs::read_dir(folder.path().join("runs")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    runs.sort();
    assert_eq!(runs, ["drive-default", "drive-default-2", "drive-default-3"]);
    let made = &report(&folder.path().join("runs/drive-default-3"))["made"];
    assert_eq!(made["command"], "floorprint run drive.clf");
}

#[test]
fn odometry_that_jumps_by_hundreds_of_metres_is_told_and_costs_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("drive.clf"), folder.path().join("out"));
    let lines: String = (0..20)
        .map(|index| flaser("2.0", if index < 10 { "0 0 0" } else { "700 700 0" }, &format!("{index}.0")))
        .collect();
    fs::write(&log, lines).unwrap();
    run(log.to_str().unwrap(), &out, &[]);
    let report = report(&out);
    let notes = report["notes"].to_string();
    assert!(notes.contains("jumps of the odometry") && notes.contains("the largest 990 m"), "{notes}");
    assert!(fs::metadata(out.join("map.pgm")).unwrap().len() < 1 << 20);
}

#[cfg(unix)]
#[test]
fn a_drive_calibrates_its_robot_and_the_next_run_takes_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.toml");
    let told = floorprint(&["calibrate", &drive(), "--out", file.to_str().unwrap()]);
    assert_eq!(told.status.code(), Some(0), "{}", text(&told.stderr));
    let table = text(&told.stdout);
    assert!(table.contains("robot.lidar.mount.x_m") && table.contains("compared over"), "{table}");
    let written = fs::read_to_string(&file).unwrap();
    assert!(written.contains("SHA-256") && written.contains("[robot."), "{written}");
    run(&drive(), &folder.path().join("out"), &["--config", file.to_str().unwrap()]);
    let json = floorprint(&["calibrate", &drive(), "--json", "-q"]);
    let told: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let parameters = told["parameters"].as_array().unwrap();
    let gyro = parameters.iter().find(|parameter| parameter["key"] == "robot.scale.gyro").unwrap();
    assert!((gyro["found"].as_f64().unwrap() - 1.0).abs() < 0.02, "{gyro}");
    let standing = folder.path().join("standing.log");
    fs::write(&standing, standing_log("2.5")).unwrap();
    let message = failure(&["calibrate", standing.to_str().unwrap()], 1);
    assert!(message.contains("none that ever moves") && message.contains("drive for a few minutes"), "{message}");
    fs::write(&standing, standing_log("2.5") + &flaser("2.5", "0.001 0 0", "2.0")).unwrap();
    let message = failure(&["calibrate", standing.to_str().unwrap()], 1);
    assert!(message.contains("stretches of driving") && message.contains("drive for a few minutes"), "{message}");
}

#[test]
fn a_recording_is_checked_before_it_becomes_a_map() {
    let folder = tempfile::tempdir().unwrap();
    let fine = floorprint(&["check", &drive()]);
    assert_eq!((fine.status.code(), text(&fine.stdout).contains("nothing seems wrong")), (Some(0), true));
    let log = folder.path().join("millimetres.log");
    fs::write(&log, standing_log("2500")).unwrap();
    let told = floorprint(&["check", log.to_str().unwrap()]);
    let findings = text(&told.stdout);
    assert_eq!(told.status.code(), Some(1), "{findings}");
    assert!(findings.contains("remedy"), "{findings}");
    let told = floorprint(&["check", log.to_str().unwrap(), "--json"]);
    let findings: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
    assert!(findings.as_array().is_some_and(|findings| findings.iter().any(|one| one["severity"] == "fatal")));
    let message = failure(&["run", log.to_str().unwrap(), "--out", folder.path().join("out").to_str().unwrap()], 1);
    assert!(message.contains("no map can be made"), "{message}");
}

#[test]
fn pipes_in_a_data_set_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    assert!(Command::new("mkfifo").arg(data.join("Hokuyo1.npz")).status().unwrap().success());
    let message = failure(&["info", data.to_str().unwrap()], 1);
    assert!(message.contains("a pipe or a device"), "{message}");
}

#[test]
fn a_gauntlet_can_have_any_one_fault() {
    let message = failure(&["bench", "--gauntlet-fault", "doors"], 1);
    assert!(message.contains("--gauntlet N or --gauntlet-drive SEED"), "{message}");
    let message = failure(&["bench", "--gauntlet", "1", "--gauntlet-fault", "misprint"], 2);
    assert!(message.contains("misprint") && message.contains("kidnapping"), "{message}");

    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let output = floorprint(&["bench", "--gauntlet", "1", "--seed", "5", "--gauntlet-fault", "doors", "--out", out]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("on which nothing but doors goes wrong"), "{table}");
    assert!(table.contains("`floorprint bench --gauntlet-drive SEED --gauntlet-fault doors`"), "{table}");
    let results: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("gauntlet.json")).unwrap()).unwrap();
    assert_eq!((&results["fault"], &results["rows"][0]["fault"]), (&"doors".into(), &"doors".into()));
}
