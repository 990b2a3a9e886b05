//! A robot of another make on the network: its scans become a map, and it gets the map, its pose and map→odom.
//!
//! The other side is Cyclone DDS from PyPI (`pip install cyclonedds`), run by `python3` or what `FLOORPRINT_PYTHON` names, in
//! a network of its own (`unshare`). Where one of them is missing that is said, and nothing is tested.

#![cfg(all(target_os = "linux", feature = "ros2"))]
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test ends where a step fails, and says what it skips")]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// Both sides, in a network with nobody else.
const SCRIPT: &str = r#"
ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo || exit 1
"$FLOORPRINT" live --ros2 --out "$FOLDER/live" --record "$FOLDER/drive.mcap" --save-to "$FOLDER" 2> "$FOLDER/said" &
live=$!
"$PYTHON" "$PEER" "$RATE" 2 map < "$FOLDER/drive.jsonl" > "$FOLDER/found.json" 2> "$FOLDER/peer"
kill -TERM $live
wait $live
ended=$?
"$FLOORPRINT" live --ros2 --map "$FOLDER/live/session.gpkg" --pose 0,0,0 --save-to "$FOLDER" 2>> "$FOLDER/said" &
live=$!
"$PYTHON" "$PEER" "$RATE" 1 follow < "$FOLDER/drive.jsonl" > "$FOLDER/followed.json" 2>> "$FOLDER/peer"
kill -TERM $live
wait $live
"$FLOORPRINT" live --ros2 --session "$FOLDER/other.gpkg" --record "$FOLDER/other.mcap" --save-to "$FOLDER" 2>> "$FOLDER/said" &
live=$!
"$PYTHON" "$PEER" 4 0 change < "$FOLDER/drive.jsonl" > "$FOLDER/changed.json" 2>> "$FOLDER/peer"
kill -TERM $live
wait $live
exit $ended
"#;

/// A drive along a corridor with doors, ten seconds long.
fn drive() -> String {
    let mut lines = String::new();
    for scan in 0..100 {
        let (stamp, x) = (1000.0 + 0.1 * f64::from(scan), 0.04 * f64::from(scan));
        for part in 0..4 {
            let (stamp, x) = (stamp + 0.025 * f64::from(part), x + 0.01 * f64::from(part));
            lines += &format!("{{\"type\":\"odometry\",\"stamp\":{stamp:.3},\"x\":{x:.4},\"y\":0.0}}\n");
        }
        let range = |ray: i32| {
            let angle = -2.0 + 4.0 * f64::from(ray) / 360.0;
            let side = if angle.sin() > 0.0 { 1.5 } else { 1.2 };
            let (to_side, to_end) = (side / angle.sin().abs().max(1e-6), (9.0 - x) / angle.cos().max(1e-6));
            let along = x + to_side * angle.cos();
            let door = if (along.rem_euclid(2.5)) < 0.5 { 0.3 / angle.sin().abs().max(0.1) } else { 0.0 };
            (to_side + door).min(to_end).min(15.0)
        };
        let ranges: Vec<String> = (0..361).map(|ray| format!("{:.4}", range(ray))).collect();
        lines += &format!(
            "{{\"type\":\"scan\",\"stamp\":{stamp:.3},\"angle_min\":-2.0,\"angle_increment\":{},\"ranges\":[{}]}}\n",
            4.0 / 360.0,
            ranges.join(",")
        );
    }
    // In the order of time.
    let mut lines: Vec<&str> = lines.lines().collect();
    let stamp =
        |line: &str| line.split("\"stamp\":").nth(1).unwrap().split(',').next().unwrap().parse::<f64>().unwrap();
    lines.sort_by(|a, b| stamp(a).total_cmp(&stamp(b)));
    lines.join("\n") + "\n"
}

/// Whether there is all that is needed; says what is not.
fn is_possible(python: &str) -> bool {
    let runs = |program: &str, arguments: &[&str]| {
        Command::new(program)
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    for (what, is_there) in [
        ("python with the package cyclonedds", runs(python, &["-c", "import cyclonedds.idl"])),
        ("a network of its own (unshare -rn)", runs("unshare", &["-rn", "true"])),
        ("the command ip", runs("ip", &["link"])),
    ] {
        if !is_there {
            println!("skipped: there is no {what}");
            return false;
        }
    }
    true
}

#[test]
fn a_robot_of_another_make_is_mapped() {
    let python = std::env::var("FLOORPRINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    if !is_possible(&python) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("drive.jsonl"), drive()).unwrap();
    let rate = std::env::var("FLOORPRINT_RATE").unwrap_or_else(|_| "1".to_owned());
    let status = Command::new("unshare")
        .args(["-rn", "sh", "-c", SCRIPT])
        .env("FLOORPRINT", env!("CARGO_BIN_EXE_floorprint"))
        .env("FOLDER", folder.path())
        .env("PYTHON", python)
        .env("PEER", Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ros2/peer.py"))
        .env("RATE", rate)
        .status()
        .unwrap();
    let read = |name: &str| fs::read_to_string(at(name)).unwrap_or_default();
    let said = format!("{}{}", read("said"), read("peer"));
    assert!(matches!(status.code(), Some(0 | 130)), "{status}: {said}");
    let found: serde_json::Value = serde_json::from_str(&read("found.json")).unwrap_or_else(|_| panic!("{said}"));
    println!("{found}");
    let number = |key: &str| found[key].as_f64().unwrap_or(0.0);
    assert!(number("poses") >= 60.0 && number("transforms") >= 100.0 && number("maps") >= 1.0, "{found}, {said}");
    assert_eq!(found["parent"], "map");
    // At 0.4 m/s along the corridor, from the first scan that came.
    let ends = |number: usize| ["first", "last"].map(|end| found[end][number].as_f64().unwrap());
    let ([from_s, to_s], [from_m, to_m]) = (ends(0), ends(1));
    assert!(to_s > 1009.8 && (to_m - from_m - 0.4 * (to_s - from_s)).abs() < 0.05, "{found}");
    assert!(found["map"][2].as_u64().unwrap() > 100, "{found}");
    let [meta_data, map] = [&found["meta_data"], &found["map"]];
    assert_eq!([&meta_data[0], &meta_data[1]], [&map[0], &map[1]], "{found}");
    assert!((meta_data[2].as_f64().unwrap() - 0.05).abs() < 1e-6, "{found}");
    assert!(found["late_s"].as_f64().is_some_and(|late_s| late_s < 3.0), "{found}");
    // In the map that was made the robot is followed, as AMCL's listeners expect it.
    let followed: serde_json::Value = serde_json::from_str(&read("followed.json")).unwrap_or_else(|_| panic!("{said}"));
    println!("{followed}");
    assert!(
        followed["poses"].as_u64().unwrap() >= 60 && followed["clouds"].as_u64().unwrap() >= 60,
        "{followed}, {said}"
    );
    let particles = &followed["particles"];
    let (stamp_s, [x_m, weight]) =
        (particles[0].as_f64().unwrap(), [0, 1].map(|at| particles[1][0][at].as_f64().unwrap()));
    assert!(
        (x_m - from_m - 0.4 * (stamp_s - from_s)).abs() < 0.1 && weight > 0.5 && weight <= 1.0 + 1e-9,
        "{followed}"
    );
    // Services of slam_toolbox and AMCL answer, and refuse what cannot be.
    let services = &found["services"];
    // Since the last whole map patches came.
    let [newest, whole] = [&services["map"], &found["map"]].map(|map| map[2].as_u64().unwrap_or(0));
    assert!(newest >= whole && newest < whole + 100, "{found}");
    for (service, answer) in [("serialize", 0), ("clear", 0), ("elsewhere", 1), ("nowhere", 3), ("localize", 2)] {
        assert_eq!(services[service], answer, "{service}: {found}, {said}");
    }
    assert_eq!(followed["services"], serde_json::json!({"pose": 0, "mapping": 2, "load": 0}), "{said}");
    // A session that began anew has set the one before it aside, and goes on with the one that was saved.
    let changed: serde_json::Value = serde_json::from_str(&read("changed.json")).unwrap_or_else(|_| panic!("{said}"));
    println!("{changed}");
    // Of two nodes on one topic the first one is believed; and datagrams of chance ended nothing.
    assert!(said.contains("several nodes publish on /odom"), "{said}");
    // The other one says that it is 50 m away, which map→odom would have to make up for.
    assert!(changed["largest_m"].as_f64().is_some_and(|largest_m| largest_m < 1.0), "{changed}");
    let (end_s, end_m) = (changed["last"][0].as_f64().unwrap(), changed["last"][1].as_f64().unwrap());
    assert!(end_s > 1009.0 && (end_m - 0.4 * (end_s - 1000.0)).abs() < 0.1, "{changed}");
    let services = &changed["services"];
    assert_eq!([&services["reset"], &services["load"]], [0, 0], "{changed}, {said}");
    let [loaded, saved] = [&services["map"], &found["services"]["map"]];
    assert_eq!([&loaded[0], &loaded[1]], [&saved[0], &saved[1]], "{changed}, {said}");
    // As it is made a map follows corrections of less than a quarter of a cell only in part.
    let [loaded, saved] = [loaded, saved].map(|map| map[2].as_f64().unwrap());
    assert!((loaded / saved - 1.0).abs() < 0.05, "{changed}, {found}");
    for name in ["other-2.gpkg", "other.gpkg", "other.mcap", "other-2.mcap", "other-3.mcap"] {
        assert!(at(name).is_file(), "no {name}: {said}");
    }
    // What was recorded gives the same, to the byte; where the machine is so busy that the last loops could not be closed
    // within the second that the session had, there is nothing to compare with.
    if !read("live/live.json").contains("\"finished\": true") {
        println!("the session was ended before its last loops were closed: not compared");
        return;
    }
    let again = at("again");
    let mut run = Command::new(env!("CARGO_BIN_EXE_floorprint"));
    run.arg("run").arg(at("drive.mcap")).arg("--out").arg(&again);
    let status = run.stderr(Stdio::null()).stdout(Stdio::null()).status().unwrap();
    assert!(status.success());
    for name in ["trajectory.tum", "map.pgm"] {
        assert!(fs::read(at("live").join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name} differs");
    }
}
