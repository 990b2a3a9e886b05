//! What people have recorded becomes a map as it is: bags with images, archives, text, standard input, several drives.

#![allow(clippy::unwrap_used, reason = "a test ends where a step fails")]

#[path = "../../floorprint-io/tests/bag_writers/mod.rs"]
mod bag_writers;
#[path = "../../floorprint-io/tests/camera_drive/mod.rs"]
mod camera_drive;

use bag_writers::{Message, image, mcap, ros1_bag};
use camera_drive::{Packing, SIZE_PX, messages, nanoseconds};
use floorprint::geometry::Pose2;
use floorprint::simulator::SimulatedDrive;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

fn floorprint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_floorprint")).args(arguments).output().unwrap()
}

fn floorprint_reading(arguments: &[&str], input: &[u8]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    child.wait_with_output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// What a command that must succeed prints.
fn fine(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    text(&output.stdout)
}

fn report(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap()
}

fn name(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A short simulated drive in the course's layout.
fn course_folder(folder: &TempDir) -> String {
    let (settings, out) = (folder.path().join("simulation.toml"), folder.path().join("drive"));
    let small = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 5.0\n[camera]\nrate_hz = 0.2\n";
    fs::write(&settings, small).unwrap();
    fine(&floorprint(&["simulate", "--world", "rooms", "--config", name(&settings), "--out", name(&out)]));
    out.display().to_string()
}

#[test]
fn a_bag_with_images_is_painted_without_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let (bag, out) = (folder.path().join("drive.bag"), folder.path().join("out"));
    let drive = camera_drive::drive();
    fs::write(&bag, ros1_bag(&messages(&drive, 4.5, Packing::Compressed, &[0.0; 5]), "none", 30)).unwrap();
    let told = fine(&floorprint(&["info", name(&bag)]));
    for words in [
        "colour images",
        "depth images",
        "/camera/color/image_raw/compressed: with rgb8; jpeg",
        "depth_optical sits at 0.180 m",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    fine(&floorprint(&["run", name(&bag), "--out", name(&out)]));
    let texture = &report(&out)["texture"];
    assert!(texture["images"].as_u64().unwrap() >= 4 && texture["painted_m2"].as_f64().unwrap() > 2.0, "{texture}");
    assert!(out.join("texture.png").is_file());
    // The camera's calibration is one like any other.
    let config = fs::read_to_string(out.join("config.toml")).unwrap();
    assert!(config.contains("[robot.depth_camera.color.mount]"), "{config}");
    let wrong = floorprint(&["info", name(&bag), "--depth", "/camera/depth"]);
    assert!(
        text(&wrong.stderr).contains("Did you mean /camera/depth/image_raw/compressedDepth?"),
        "{}",
        text(&wrong.stderr)
    );
}

/// Adds images of nothing, of about a megabyte each, to the short drive.
fn with_ballast(drive: &SimulatedDrive, images: u64) -> Vec<Message> {
    let mut all = messages(drive, 3.0, Packing::Raw, &[0.0; 5]);
    let start_ns = nanoseconds(drive.config().start_stamp_s);
    let rgb = vec![90; 640 * 480 * 3];
    all.extend(
        (0..images).map(|index| image("/rear/image_raw", start_ns + index * 10_000_000, "rear", SIZE_PX, "rgb8", &rgb)),
    );
    all.sort_by_key(|message| message.log_ns);
    all
}

#[test]
fn memory_does_not_grow_with_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let drive = camera_drive::drive();
    let peak_mb = |images: u64| {
        let (bag, out) = (folder.path().join("drive.mcap"), folder.path().join(images.to_string()));
        fs::write(&bag, mcap(&with_ballast(&drive, images), "", 4, false)).unwrap();
        fine(&floorprint(&["run", name(&bag), "--threads", "1", "--out", name(&out)]));
        report(&out)["cost"]["peak_memory_bytes"].as_f64().unwrap() / 1e6
    };
    let (small, large) = (peak_mb(1), peak_mb(160));
    assert!(large < small + 20.0, "{small:.0} MB, with 150 MB more in the file {large:.0} MB");
}

#[test]
fn an_archive_of_a_drive_is_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let drive = course_folder(&folder);
    let (archive, plain, zipped) =
        (folder.path().join("drive.zip"), folder.path().join("plain"), folder.path().join("zipped"));
    let mut writer = zip::ZipWriter::new(File::create(&archive).unwrap());
    pack(&mut writer, Path::new(&drive), "course/drive");
    writer.finish().unwrap();
    fine(&floorprint(&["run", &drive, "--out", name(&plain)]));
    fine(&floorprint(&["run", name(&archive), "--out", name(&zipped)]));
    for result in ["trajectory.tum", "map.pgm", "texture.png"] {
        assert!(fs::read(plain.join(result)).unwrap() == fs::read(zipped.join(result)).unwrap(), "{result}");
    }
    // As it comes out of a pipe, too; and what is wrong in it is told by its name there.
    let told = fine(&floorprint_reading(&["info", "-"], &fs::read(&archive).unwrap()));
    assert!(told.contains("encoders") && told.contains("colour images"), "{told}");
    let mut writer = zip::ZipWriter::new(File::create(&archive).unwrap());
    writer.start_file("data/Hokuyo1.npz", zip::write::SimpleFileOptions::default()).unwrap();
    writer.write_all(b"nothing").unwrap();
    writer.finish().unwrap();
    let message = text(&floorprint(&["info", name(&archive)]).stderr);
    assert!(message.contains("drive.zip/data/Hokuyo1.npz"), "{message}");
}

/// Puts a folder into an archive.
fn pack(writer: &mut zip::ZipWriter<File>, folder: &Path, inner: &str) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let inner = format!("{inner}/{}", path.file_name().unwrap().to_string_lossy());
        if path.is_dir() {
            pack(writer, &path, &inner);
        } else {
            writer.start_file(inner, zip::write::SimpleFileOptions::default()).unwrap();
            writer.write_all(&fs::read(path).unwrap()).unwrap();
        }
    }
}

/// A robot that drives along a bend in a hall of 16 m × 10 m, as text.
fn hall() -> (String, Vec<Pose2>) {
    let pose = |step: u32| {
        let turned = f64::from(step) * 0.02;
        Pose2::new(3.0 * turned.sin(), 2.0 - 3.0 * turned.cos(), turned)
    };
    let mut log = "t,x,y,yaw\n".to_owned();
    let poses: Vec<Pose2> = (0..60).map(pose).collect();
    for (step, Pose2 { x, y, theta }) in poses.iter().enumerate() {
        let stamp_s = 100.0 + 0.1 * step as f64;
        // Its odometry turns 2 % too far.
        writeln!(log, "{stamp_s},{x},{y},{}", theta * 1.02).unwrap();
        write!(log, "{stamp_s},-2.0,2.0").unwrap();
        for ray in 0..201 {
            let (sin, cos) = (theta - 2.0 + 0.02 * f64::from(ray)).sin_cos();
            let along = |from: f64, half: f64, direction: f64| (half.copysign(direction) - from) / direction;
            write!(log, ",{:.4}", along(*x, 8.0, cos).min(along(*y, 5.0, sin))).unwrap();
        }
        log.push('\n');
    }
    (log, poses)
}

#[test]
fn text_from_a_file_or_a_pipe_becomes_a_map() {
    let folder = tempfile::tempdir().unwrap();
    let (log, poses) = hall();
    let path = folder.path().join("drive.csv");
    fs::write(&path, &log).unwrap();
    let (from_file, from_pipe) = (folder.path().join("file"), folder.path().join("pipe"));
    fine(&floorprint(&["run", name(&path), "--out", name(&from_file)]));
    fine(&floorprint_reading(&["run", "-", "--out", name(&from_pipe)], log.as_bytes()));
    let [file, pipe] = [&from_file, &from_pipe].map(|out| fs::read_to_string(out.join("trajectory.tum")).unwrap());
    assert_eq!(file, pipe);
    // The scans put the odometry's turn right.
    let last: Vec<f64> = file.lines().last().unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
    let truth = poses[0].between(&poses[59]);
    let turned = 2.0 * last[6].atan2(last[7]);
    assert!((last[1] - truth.x).hypot(last[2] - truth.y) < 0.02 && (turned - truth.theta).abs() < 0.003, "{last:?}");
    let checked = fine(&floorprint_reading(&["check", "-"], log.as_bytes()));
    assert!(!checked.contains("no map"), "{checked}");
    let nothing = floorprint_reading(&["info", "-"], b"");
    assert!(text(&nothing.stderr).contains("-: the file is empty"), "{}", text(&nothing.stderr));
}

#[test]
fn several_drives_are_listed_and_checked_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let drive = course_folder(&folder);
    let both = folder.path().join("both");
    fs::create_dir(&both).unwrap();
    for entry in fs::read_dir(&drive).unwrap() {
        let path = entry.unwrap().path();
        let file = path.file_name().unwrap().to_string_lossy().into_owned();
        let stem = file.trim_end_matches(".npz").trim_end_matches(char::is_numeric).to_owned();
        if file.ends_with(".npz") && stem != "Kinect" {
            fs::copy(&path, both.join(format!("{stem}20.npz"))).unwrap();
            if stem != "Imu" {
                fs::copy(&path, both.join(format!("{stem}21.npz"))).unwrap();
            }
        }
    }
    let told = fine(&floorprint(&["info", name(&both)]));
    assert!(told.contains("2 drives") && told.contains("both --drive 20  encoders, IMU, Hokuyo\n"), "{told}");
    assert!(told.contains("both --drive 21  encoders, Hokuyo\n"), "{told}");
    let listed: serde_json::Value =
        serde_json::from_slice(&floorprint(&["info", name(&both), "--json"]).stdout).unwrap();
    assert_eq!((listed[0]["drive"].as_u64(), listed.as_array().unwrap().len()), (Some(20), 2));
    let checked = floorprint(&["check", name(&both)]);
    let told = text(&checked.stdout);
    assert!(told.contains("both --drive 20") && told.contains("both --drive 21"), "{told}");
    let message = text(&floorprint(&["run", name(&both)]).stderr);
    assert!(message.contains("Choose one with --drive 20"), "{message}");

    // Any recordings in a folder.
    let logs = folder.path().join("logs");
    fs::create_dir(&logs).unwrap();
    // One alone is the drive that is meant, and the truth beside it is found.
    let (log, poses) = hall();
    fs::write(logs.join("monday.csv"), log).unwrap();
    let line = |(step, Pose2 { x, y, theta }): (usize, &Pose2)| {
        let (sin, cos) = (0.5 * theta).sin_cos();
        format!("{} {x} {y} 0 0 0 {sin} {cos}\n", 100.0 + 0.1 * step as f64)
    };
    fs::write(logs.join("monday.truth.tum"), poses.iter().enumerate().map(line).collect::<String>()).unwrap();
    let out = folder.path().join("monday");
    fine(&floorprint(&["run", name(&logs), "--out", name(&out)]));
    let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert!(report["errors"]["trajectory"].is_object(), "{}", report["errors"]);
    fs::write(logs.join("tuesday.csv"), hall().0).unwrap();
    let told = fine(&floorprint(&["info", name(&logs)]));
    assert!(told.contains("monday.csv") && told.contains("tuesday.csv"), "{told}");
    let message = text(&floorprint(&["run", name(&logs)]).stderr);
    assert!(message.contains("a folder of recordings") && message.contains("monday.csv"), "{message}");
}
