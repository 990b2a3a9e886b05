//! Recordings of ROS in all their containers: the same drive is the same records, what is cut off is read as far as
//! it goes, and roles are chosen by what is there.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test ends where a step fails"
)]

mod bag_writers;
mod data_folder;

use bag_writers::{
    Message, Rays, imu, joints, mcap, odometry, pose, ros1_bag, scan, scan_up_to, sqlite, transform, zstd,
};
use data_folder::data;
use floorprint::Frames;
use floorprint::config::Layer;
use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions, TruthAlignment};
use floorprint::geometry::Pose3;
use floorprint::sensors::Record;
use floorprint::{Config, Frame, SensorId, Slam};
use floorprint_io::{DataSet, OpenOptions, ReadError, TopicChoice, drives, open};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

const RAYS: Rays = Rays {
    angle_min_rad: -1.5,
    angle_increment_rad: 0.025,
    time_increment_s: 0.0,
    scan_time_s: 0.0,
    range_min_m: 0.01,
    range_max_m: 30.0,
};

/// Stamp of a moment, nanoseconds.
fn at(step: u32) -> u64 {
    1_700_000_000_123_456_000 + u64::from(step) * 100_000_007
}

/// The same stamp in seconds, as it is read.
fn seconds(stamp_ns: u64) -> f64 {
    (stamp_ns / 1_000_000_000) as f64 + (stamp_ns % 1_000_000_000) as f64 * 1e-9
}

/// Where the robot is: along a bend.
fn place(step: u32) -> [f64; 3] {
    let turned = f64::from(step) * 0.02;
    [3.0 * turned.sin(), 3.0 - 3.0 * turned.cos(), turned]
}

/// What it sees of a hall of 16 m × 16 m around the origin.
fn ranges_m(step: u32) -> Vec<f32> {
    let [x, y, theta] = place(step);
    let range_m = |ray: u32| {
        let (sin, cos) = (theta - 1.5 + 0.025 * f64::from(ray)).sin_cos();
        let along = |from: f64, direction: f64| (8.0_f64.copysign(direction) - from) / direction;
        along(x, cos).min(along(y, sin)) as f32
    };
    (0..121).map(range_m).collect()
}

/// A drive with one LiDAR at the base's origin.
fn drive(steps: u32) -> Vec<Message> {
    let step = |step| {
        [
            odometry("/odom", at(step), "base_link", place(step)),
            scan("/scan", at(step), "base_link", &RAYS, &ranges_m(step)),
        ]
    };
    (0..steps).flat_map(step).collect()
}

/// The same drive as a CARMEN log.
fn carmen_log(steps: u32) -> String {
    let mut log = "# CARMEN Logfile\n".to_owned();
    for step in 0..steps {
        let stamp_s = seconds(at(step));
        let [x, y, theta] = place(step);
        let (sin, cos) = (theta / 2.0).sin_cos();
        let theta = Pose3::from_quaternion([0.0; 3], [0.0, 0.0, sin, cos]).in_plane().theta;
        writeln!(log, "ODOM {x} {y} {theta} 0 0 0 {stamp_s} robot {stamp_s}").unwrap();
        let ranges: Vec<String> = ranges_m(step).iter().map(|range_m| format!("{}", f64::from(*range_m))).collect();
        let (start, increment) = (f64::from(RAYS.angle_min_rad), f64::from(RAYS.angle_increment_rad));
        let head = format!("RAWLASER1 0 {start} 3 {increment} 30 0 0 {}", ranges.len());
        writeln!(log, "{head} {} 0 {stamp_s} robot {stamp_s}", ranges.join(" ")).unwrap();
    }
    log
}

fn read(path: &Path) -> DataSet {
    open(path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn read_bytes(bytes: &[u8]) -> Result<DataSet, ReadError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    open(file.path(), &OpenOptions::default())
}

fn note_of<'a>(data_set: &'a DataSet, words: &str) -> Option<&'a String> {
    data_set.notes.iter().find(|note| note.contains(words))
}

#[test]
fn the_same_drive_is_the_same_records_in_every_container() {
    const STEPS: u32 = 60;
    let messages = drive(STEPS);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("carmen.log"), carmen_log(STEPS)).unwrap();
    for compression in ["none", "bz2", "lz4"] {
        fs::write(path(&format!("{compression}.bag")), ros1_bag(&messages, compression, 17)).unwrap();
    }
    for compression in ["", "lz4", "zstd"] {
        fs::write(path(&format!("{compression}.mcap")), mcap(&messages, compression, 17, false)).unwrap();
    }
    fs::write(path("ros1.mcap"), mcap(&messages, "zstd", 1000, true)).unwrap();
    fs::write(path("file.mcap.zstd"), zstd(&mcap(&messages, "", 17, false))).unwrap();
    sqlite(&path("plain.db3"), &messages, <[u8]>::to_vec);
    fs::write(path("file.db3.zstd"), zstd(&fs::read(path("plain.db3")).unwrap())).unwrap();
    // Folders, one with packed messages, one in parts that no longer sort as texts.
    fs::create_dir(path("packed")).unwrap();
    sqlite(&path("packed/packed_0.db3"), &messages, zstd);
    fs::create_dir(path("parts")).unwrap();
    for (number, part) in messages.chunks(9).enumerate() {
        fs::write(path(&format!("parts/parts_{number}.mcap")), mcap(part, "zstd", 4, false)).unwrap();
    }

    let expected = read(&path("carmen.log"));
    assert_eq!(expected.scans().count(), STEPS as usize);
    let expected = format!("{:?}", expected.records);
    for (name, kind) in [
        ("none.bag", "a ROS 1 bag"),
        ("bz2.bag", "a ROS 1 bag"),
        ("lz4.bag", "a ROS 1 bag"),
        (".mcap", "an MCAP file"),
        ("lz4.mcap", "an MCAP file"),
        ("zstd.mcap", "an MCAP file"),
        ("ros1.mcap", "an MCAP file"),
        ("file.mcap.zstd", "an MCAP file"),
        ("plain.db3", "a rosbag2 database (SQLite)"),
        ("file.db3.zstd", "a rosbag2 database (SQLite)"),
        ("packed", "a rosbag2 folder (SQLite)"),
        ("parts", "a rosbag2 folder (MCAP)"),
    ] {
        let data_set = read(&path(name));
        assert_eq!((data_set.format.name, data_set.format.description), ("ros", kind), "{name}");
        assert!(format!("{:?}", data_set.records) == expected, "{name}: other records");
        assert_eq!(data_set.dropped.total(), 0, "{name}");
        assert_eq!(data_set.input_hash.len(), 64, "{name}");
        assert!(data_set.notes.iter().all(|note| note.contains("no transform")), "{name}: {:?}", data_set.notes);
    }
}

#[test]
fn what_is_cut_off_is_read_up_to_there_and_told() {
    let messages = drive(100);
    let whole = |bytes: &[u8]| read_bytes(bytes).unwrap().records.len();
    for (name, file) in [
        ("bag", ros1_bag(&messages, "none", 50)),
        ("lz4 bag", ros1_bag(&messages, "lz4", 50)),
        ("bz2 bag", ros1_bag(&messages, "bz2", 50)),
        ("mcap", mcap(&messages, "", 50, false)),
        ("lz4 mcap", mcap(&messages, "lz4", 50, false)),
    ] {
        assert_eq!(whole(&file), 200, "{name}");
        // In the middle of the last of the four chunks.
        let cut = read_bytes(&file[..file.len() * 7 / 8]).unwrap();
        let least = if name.contains("bz2") || name.contains("lz4") { 150 } else { 165 };
        assert!((least..200).contains(&cut.records.len()), "{name}: {}", cut.records.len());
        assert!(note_of(&cut, "cut off").is_some(), "{name}: {:?}", cut.notes);
    }
}

/// A recorder that was killed leaves the lengths of its last chunk open, and no index.
#[test]
fn a_bag_whose_recorder_was_killed_is_read() {
    let messages = drive(100);
    for compression in ["none", "lz4"] {
        let mut bag = ros1_bag(&messages, compression, 50);
        let last_chunk = bag.windows(5).rposition(|bytes| bytes == b"op=\x05\x09").unwrap();
        // Behind the field of the kind follows that of the size, then the length of the data.
        let length = last_chunk + 4 + 4 + 9;
        bag[length..length + 4].fill(0);
        let index = bag.windows(10).position(|bytes| bytes == b"index_pos=").unwrap() + 10;
        bag[index..index + 8].fill(0);
        let data_set = read_bytes(&bag).unwrap();
        assert_eq!(data_set.records.len(), 200, "{compression}: {:?}", data_set.notes);
        assert!(note_of(&data_set, "not finished").is_some(), "{:?}", data_set.notes);
    }
}

#[test]
fn a_damaged_chunk_costs_only_itself() {
    let messages = drive(100);
    let bag = ros1_bag(&messages, "bz2", 20);
    for (name, file, head) in [("bag", bag, &b"op=\x05"[..]), ("mcap", mcap(&messages, "zstd", 20, false), b"zstd")] {
        let mut damaged = file;
        let places = damaged.windows(head.len()).enumerate().filter(|(_, bytes)| *bytes == head);
        let (third, _) = places.take(3).last().unwrap();
        damaged[third + 100..third + 164].fill(0xff);
        let data_set = read_bytes(&damaged).unwrap();
        assert!((160..200).contains(&data_set.records.len()), "{name}: {}", data_set.records.len());
        assert!(note_of(&data_set, "chunk").is_some(), "{name}: {:?}", data_set.notes);
    }
}

/// A robot whose frames ROS 1 repeats on `/tf`: laser in front, laser behind and upside down, another far above, and poses
/// that were made of the one above.
fn robot() -> Vec<Message> {
    let mut messages = Vec::new();
    for step in 0..40 {
        let [x, y, theta] = place(step);
        messages.extend([
            transform("/tf", at(step), "odom", "/base_footprint", [x, y, 0.0], [0.0, theta]),
            transform("/tf", at(step), "base_footprint", "base_link", [0.0, 0.0, 0.1], [0.0; 2]),
            transform("/tf", at(step), "/base_link", "front", [0.4, 0.0, 0.2], [0.0; 2]),
            transform("/tf", at(step), "base_link", "rear", [-0.4, 0.1, 0.25], [std::f64::consts::PI, 3.0]),
            transform("/tf", at(step), "base_link", "top", [0.0, 0.0, 1.9], [0.0; 2]),
            transform("/tf", at(step), "base_link", "tilting", [0.0, 0.0, 0.3], [0.1 * f64::from(step), 0.0]),
            scan("/front", at(step), "front", &RAYS, &ranges_m(step)),
            scan("/front_filtered", at(step), "/front", &RAYS, &ranges_m(step)),
            scan("/rear", at(step) + 5_000_000, "rear", &RAYS, &ranges_m(step)[..100]),
            scan("/top", at(step) + 9_000_000, "top", &RAYS, &[&ranges_m(step)[..], &ranges_m(step)].concat()),
            scan("/tilting", at(step), "tilting", &RAYS, &ranges_m(step)),
            pose("/ground_truth", at(step) + 9_000_000, [x, y, theta]),
        ]);
    }
    messages
}

fn choose(messages: &[Message], topics: TopicChoice) -> Result<DataSet, ReadError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), ros1_bag(messages, "none", 100)).unwrap();
    open(file.path(), &OpenOptions { topics, ..OpenOptions::default() })
}

#[test]
fn roles_are_chosen_by_what_is_there() {
    let data_set = choose(&robot(), TopicChoice::default()).unwrap();
    let bag = data_set.bag.as_ref().unwrap();
    let role = |what: &str| bag.roles.iter().find(|role| role.what == what).unwrap();
    assert_eq!(role("base_footprint").role, "base");
    assert_eq!((role("/front").role, role("/rear").role), ("scans", "not used"));
    assert!(role("/rear").reason.contains("--scan /front --scan /rear"), "{:?}", role("/rear"));
    for (topic, reason) in [("/top", "its stamps"), ("/tilting", "moves"), ("/front_filtered", "the same LiDAR")] {
        assert!(role(topic).role == "not used" && role(topic).reason.contains(reason), "{:?}", role(topic));
    }
    assert_eq!(bag.truth.as_ref().unwrap().poses.len(), 40);
    // The two LiDARs, where both are asked for, with mounts in the base's frame.
    let scans = vec!["/front".to_owned(), "/rear".to_owned()];
    let data_set = choose(&robot(), TopicChoice { scans, ..TopicChoice::default() }).unwrap();
    let lidar = |sensor| data_set.robot.lidar_of(SensorId(sensor));
    assert!((lidar(0).mount.x_m - 0.4).abs() < 1e-9 && (lidar(0).mount.z_m - 0.3).abs() < 1e-9);
    assert!(
        (lidar(1).mount.y_m - 0.1).abs() < 1e-9 && (lidar(1).mount.roll_rad.abs() - std::f64::consts::PI).abs() < 1e-9
    );
    assert_eq!(data_set.scans().filter(|scan| scan.sensor == SensorId(1)).count(), 40);
    let config = Config::resolve(&[Layer::from_robot(&data_set.robot)]).unwrap();
    assert_eq!(config.robot, data_set.robot);
    let poses = data_set.records.iter().filter(|record| matches!(record, Record::Odometry(_))).count();
    assert_eq!(poses, 40);
}

#[test]
fn roles_that_are_asked_for_are_taken() {
    let topics =
        TopicChoice { scans: vec!["top".to_owned()], base: Some("base_link".to_owned()), ..TopicChoice::default() };
    let data_set = choose(&robot(), topics).unwrap();
    assert!((data_set.robot.lidar.mount.z_m - 1.9).abs() < 1e-9);
    let refused = |topics: TopicChoice| choose(&robot(), topics).unwrap_err().to_string();
    let message = refused(TopicChoice { scans: vec!["/fornt".to_owned()], ..TopicChoice::default() });
    assert!(message.contains("no such topic") && message.contains("Did you mean /front"), "{message}");
    let message = refused(TopicChoice { truth: Some("/front".to_owned()), ..TopicChoice::default() });
    assert!(message.contains("sensor_msgs/LaserScan, no poses"), "{message}");
    let message = refused(TopicChoice { base: Some("base_lnk".to_owned()), ..TopicChoice::default() });
    assert!(message.contains("Did you mean base_link"), "{message}");
}

#[test]
fn a_folder_of_recordings_is_not_one_of_them() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("monday.bag"), ros1_bag(&drive(3), "none", 17)).unwrap();
    fs::write(folder.path().join("tuesday.mcap"), mcap(&drive(3), "", 17, false)).unwrap();
    let error = open(folder.path(), &OpenOptions::default()).unwrap_err().to_string();
    assert!(error.contains("a folder of recordings") && error.contains("monday.bag"), "{error}");
    let listed = drives(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(listed.iter().map(|entry| entry.drive).collect::<Vec<_>>(), [None, None]);
    assert!(listed[1].path.ends_with("tuesday.mcap"), "{listed:?}");
    // One file alone is what it is.
    fs::remove_file(folder.path().join("monday.bag")).unwrap();
    assert_eq!(read(folder.path()).scans().count(), 3);
    assert!(drives(folder.path(), &OpenOptions::default()).unwrap().is_empty());
}

#[test]
fn wheels_among_joints_are_the_odometry_where_that_is_asked_for() {
    const RADIUS_M: f64 = 0.1;
    const TRACK_M: f64 = 0.4;
    // The arm speaks on the same topic.
    let step = |step| {
        let [_, _, turned] = place(step);
        let angle_rad = |side: f64| (3.0 + side * TRACK_M / 2.0) * turned / RADIUS_M;
        let wheels = [("wheel_right_joint", angle_rad(1.0)), ("wheel_left_joint", angle_rad(-1.0))];
        [
            joints("/joint_states", at(step), &wheels),
            joints("/joint_states", at(step), &[("arm_joint", 0.3)]),
            odometry("/odom", at(step), "base_link", place(step)),
            scan("/scan", at(step), "base_link", &RAYS, &ranges_m(step)),
        ]
    };
    let messages: Vec<Message> = (0..60).flat_map(step).collect();
    let found = choose(&messages, TopicChoice::default()).unwrap();
    let role = found.bag.as_ref().unwrap().roles.iter().find(|role| role.what == "/joint_states").unwrap().clone();
    assert!(role.role == "not used" && role.reason.contains("--odom /joint_states"), "{role:?}");
    assert!(!found.records.iter().any(|record| matches!(record, Record::Encoders(_))));

    let wheels = TopicChoice { odometry: Some("/joint_states".to_owned()), ..TopicChoice::default() };
    let data_set = choose(&messages, wheels).unwrap();
    assert!(note_of(&data_set, "robot.wheels").is_some_and(|note| note.contains("radius")), "{:?}", data_set.notes);
    let count = |wanted: fn(&Record) -> bool| data_set.records.iter().filter(|record| wanted(record)).count();
    assert_eq!(count(|record| matches!(record, Record::Encoders(_))), 60);
    assert_eq!(count(|record| matches!(record, Record::Odometry(_))), 0);
    // Without radius and track width that is an error that says what is missing …
    let config = Config::resolve(&[Layer::from_robot(&data_set.robot)]).unwrap();
    let error = data_set.frames(&config).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("robot.wheels is not set"), "{error}");
    // … and with them the drive's own way.
    let text = format!(
        "[robot.wheels]\nleft_m_per_tick = {RADIUS_M}\nright_m_per_tick = {RADIUS_M}\ntrack_width_m = {TRACK_M}\n"
    );
    let layers = [Layer::from_robot(&data_set.robot), Layer::from_toml("my.toml", &text).unwrap()];
    let config = Config::resolve(&layers).unwrap();
    let last = data_set.frames(&config).unwrap().iter().last().unwrap();
    let [x, y, theta] = place(59);
    let pose = last.dead_reckoning;
    assert!((pose.x - x).abs() < 0.01 && (pose.y - y).abs() < 0.01 && (pose.theta - theta).abs() < 0.01, "{pose:?}");
}

#[test]
fn rays_have_times_and_a_zero_may_mean_that_nothing_came_back() {
    let step = |step| {
        let mut ranges_m = ranges_m(step);
        ranges_m[7] = 0.0;
        ranges_m[8] = f32::NEG_INFINITY;
        let rays = Rays { scan_time_s: 0.1, ..RAYS };
        [odometry("/odom", at(step), "base_link", place(step)), scan("/scan", at(step), "laser", &rays, &ranges_m)]
    };
    let data_set = choose(&(0..9).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap();
    let scan = data_set.scans().next().unwrap();
    assert_eq!((scan.ranges_m[7], scan.ranges_m[8]), (f32::INFINITY, f32::NEG_INFINITY));
    // 120 steps of 0.025 rad of a turn that takes 0.1 s.
    let last_s = scan.geometry.time_offsets_s[120];
    assert!((last_s - 0.1 * 3.0 / std::f32::consts::TAU).abs() < 1e-5, "{last_s}");
    assert!(note_of(&data_set, "ranges of 0").is_some() && note_of(&data_set, "no transform").is_some());
}

/// A robot with a LiDAR 0.3 m ahead of `base_link`, whose mount `/tf_static` states, and what else it records at each step.
fn with_others(others: impl Fn(u32) -> Vec<Message>) -> DataSet {
    let step = |step| {
        let own = [
            odometry("/odom", at(step), "base_link", place(step)),
            scan("/scan", at(step), "laser", &RAYS, &ranges_m(step)),
        ];
        own.into_iter().chain(others(step)).collect::<Vec<_>>()
    };
    let mount = transform("/tf_static", at(0), "base_link", "laser", [0.3, 0.0, 0.2], [0.0; 2]);
    let messages: Vec<Message> = std::iter::once(mount).chain((0..40).flat_map(step)).collect();
    choose(&messages, TopicChoice::default()).unwrap()
}

fn reason_of(data_set: &DataSet, what: &str) -> (&'static str, String) {
    let role = data_set.bag.as_ref().unwrap().roles.iter().find(|role| role.what == what);
    role.map(|role| (role.role, role.reason.clone())).unwrap_or_default()
}

#[test]
fn two_lidars_on_one_topic_are_not_taken_for_one() {
    let other = |step| vec![scan("/scan", at(step), "another", &RAYS, &[1.0; 60])];
    let mount = |step| transform("/tf_static", at(step), "base_link", "another", [-0.3, 0.0, 0.2], [0.0; 2]);
    let both = |step| if step % 4 == 0 { vec![mount(step)] } else { other(step) };
    // Another name of the same LiDAR, or none, is no other LiDAR.
    let renamed = with_others(|step| vec![scan("/scan", at(step) + 50_000_000, "", &RAYS, &ranges_m(step))]);
    assert!(renamed.scans().count() == 80 && note_of(&renamed, "several LiDARs").is_none());
    let data_set = with_others(both);
    assert_eq!(data_set.scans().count(), 40);
    assert!(data_set.scans().all(|scan| scan.ranges_m.len() == 121));
    assert!((data_set.robot.lidar.mount.x_m - 0.3).abs() < 1e-9);
    let note = note_of(&data_set, "several LiDARs").unwrap();
    assert!(note.contains("laser are used") && note.contains("another are not"), "{note}");
}

#[test]
fn a_range_that_a_driver_writes_where_nothing_came_back_is_no_wall() {
    let with_mark = |mark_m: f32, beyond: bool| {
        let step = |step| {
            let mut ranges_m = ranges_m(step);
            ranges_m[20..60].fill(mark_m);
            ranges_m[61] = if beyond { f32::INFINITY } else { ranges_m[61] };
            [odometry("/odom", at(step), "base_link", place(step)), scan("/scan", at(step), "laser", &RAYS, &ranges_m)]
        };
        choose(&(0..120).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap()
    };
    let data_set = with_mark(25.5, false);
    assert!(note_of(&data_set, "ranges of 25.5 m and more").is_some(), "{:?}", data_set.notes);
    assert!(data_set.scans().all(|scan| scan.ranges_m[20..60].iter().all(|range_m| range_m.is_infinite())));
    assert!(data_set.scans().all(|scan| scan.ranges_m[60..].iter().all(|range_m| *range_m < 25.5)));
    // Who says in another way that nothing came back does not say it in this one.
    let data_set = with_mark(25.5, true);
    assert!(note_of(&data_set, "25.5").is_none() && data_set.scans().all(|scan| scan.ranges_m[20] == 25.5));
}

#[test]
fn what_a_scan_states_of_its_angles_is_held_against_each_other() {
    let with_angles = |angle_increment_rad: f32, angle_max_rad: f32| {
        let rays = Rays { angle_increment_rad, ..RAYS };
        let step = |step| {
            [
                odometry("/odom", at(step), "base_link", place(step)),
                scan_up_to("/scan", at(step), "base_link", &rays, angle_max_rad, &ranges_m(step)),
            ]
        };
        choose(&(0..9).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap()
    };
    let last_rad = |data_set: &DataSet| data_set.scans().next().unwrap().geometry.angles_rad[120];
    // Not stated, stated as it should be, off by one ray, and wrong.
    for (increment_rad, max_rad, expected_rad, is_told) in
        [(0.0, 1.5, 1.5, false), (0.025, 1.5, 1.5, false), (0.025, 1.525, 1.5, false), (0.05, 1.5, 4.5, true)]
    {
        let data_set = with_angles(increment_rad, max_rad);
        assert!((last_rad(&data_set) - expected_rad).abs() < 1e-5, "{increment_rad}: {}", last_rad(&data_set));
        assert_eq!(note_of(&data_set, "one of them is wrong").is_some(), is_told, "{increment_rad}, {max_rad}");
    }
}

#[test]
fn who_sees_all_around_is_preferred_to_who_looks_ahead() {
    // A depth camera's rows: more rays and more often, but all of them ahead.
    let narrow = Rays { angle_min_rad: -0.4, angle_increment_rad: 0.002, ..RAYS };
    let data_set = with_others(|step| {
        let row = |part: u64| scan("/camera/scan", at(step) + part * 30_000_000, "laser", &narrow, &[2.0; 400]);
        (0..3).map(row).collect()
    });
    assert_eq!((reason_of(&data_set, "/scan").0, reason_of(&data_set, "/camera/scan").0), ("scans", "not used"));
}

#[test]
fn an_imu_without_a_gyro_is_none() {
    let data_set = with_others(|step| {
        let accelerometer = |part: u64| imu("/accel", at(3 * step) + part * 30_000_000, "base_link", 0.0);
        (0..3).map(accelerometer).chain([imu("/gyro", at(3 * step), "base_link", 0.2)]).collect()
    });
    assert_eq!((reason_of(&data_set, "/gyro").0, reason_of(&data_set, "/accel").0), ("IMU", "not used"));
    let turning = data_set.records.iter().filter(|record| matches!(record, Record::Imu(_))).count();
    assert_eq!(turning, 40);
}

#[test]
fn odometry_is_what_hangs_together_with_the_lidar() {
    // Of a camera that nobody says where it sits, and more often; and places in a map that others have made.
    let data_set = with_others(|step| {
        let camera = |part: u64| odometry("/camera/odom", at(step) + part * 30_000_000, "camera_pose", place(step));
        (0..3).map(camera).collect()
    });
    assert_eq!((reason_of(&data_set, "/odom").0, reason_of(&data_set, "/camera/odom").0), ("odometry", "not used"));
    assert!((data_set.robot.lidar.mount.x_m - 0.3).abs() < 1e-9);

    // The odometry names a frame that /tf does not know; /tf moves another in the same frame.
    let step = |step| {
        let [x, y, theta] = place(step);
        [
            transform("/tf", at(step), "odom", "base_link", [x, y, 0.0], [0.0, theta]),
            odometry("/odom", at(step), "base_footprint", [x, y, theta]),
            scan("/scan", at(step), "laser", &RAYS, &ranges_m(step)),
        ]
    };
    let mount = |x_m| transform("/tf_static", at(0), "base_link", "laser", [x_m, 0.0, 0.2], [0.0; 2]);
    // What is static and stated anew was mended.
    let messages: Vec<Message> = [mount(0.1), mount(0.3)].into_iter().chain((0..9).flat_map(step)).collect();
    let data_set = choose(&messages, TopicChoice::default()).unwrap();
    assert_eq!(reason_of(&data_set, "base_link").0, "base");
    assert!((data_set.robot.lidar.mount.x_m - 0.3).abs() < 1e-9, "{:?}", data_set.robot.lidar.mount);
    // A frame whose pose is stated in itself is not named.
    let step = |step| {
        [odometry("/odom", at(step), "odom", place(step)), scan("/scan", at(step), "laser", &RAYS, &ranges_m(step))]
    };
    let messages: Vec<Message> = std::iter::once(mount(0.3)).chain((0..9).flat_map(step)).collect();
    let data_set = choose(&messages, TopicChoice::default()).unwrap();
    assert!((data_set.robot.lidar.mount.x_m - 0.3).abs() < 1e-9, "{:?}", data_set.notes);
}

#[test]
fn odometry_that_was_recorded_much_later_than_its_stamps_is_told() {
    let with_delay = |delay_ns: u64| {
        let step = |step| {
            let odometry = odometry("/odom", at(step) - delay_ns, "base_link", place(step));
            let recorded = Message { log_ns: at(step), ..odometry };
            [recorded, scan("/scan", at(step), "base_link", &RAYS, &ranges_m(step))]
        };
        choose(&(0..9).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap()
    };
    let late = with_delay(3_000_000_000);
    assert!(note_of(&late, "the stamps of /odom are 3.0 s behind those of /scan").is_some(), "{:?}", late.notes);
    assert!(with_delay(100_000_000).notes.iter().all(|note| !note.contains("behind")));
}

#[test]
fn of_two_robots_with_the_same_frames_one_is_taken_whole() {
    let of = |robot: &str, x_m: f64, step| {
        let [x, y, theta] = place(step);
        let x = x + 100.0 * x_m;
        [
            transform(&format!("/{robot}/tf_static"), at(step), "base_link", "laser", [x_m, 0.0, 0.2], [0.0; 2]),
            transform(&format!("/{robot}/tf"), at(step), "odom", "base_link", [x, y, 0.0], [0.0, theta]),
            scan(&format!("/{robot}/scan"), at(step), "laser", &RAYS, &ranges_m(step)),
        ]
    };
    let step = |step| [of("robot1", 0.1, step), of("robot2", 0.3, step)].concat();
    let messages: Vec<Message> = (0..9).flat_map(step).collect();
    let own = |scans: &[&str]| {
        let scans = scans.iter().map(|name| (*name).to_owned()).collect();
        let data_set = choose(&messages, TopicChoice { scans, ..TopicChoice::default() }).unwrap();
        assert!(note_of(&data_set, "several robots").is_some(), "{:?}", data_set.notes);
        let poses = data_set.records.iter().filter_map(|record| match record {
            Record::Odometry(stamped) => Some(stamped.pose.x),
            _ => None,
        });
        let poses: Vec<f64> = poses.collect();
        assert_eq!((data_set.scans().count(), poses.len()), (9, 9));
        (data_set.robot.lidar.mount.x_m, poses[0])
    };
    assert_eq!(own(&[]), (0.1, 10.0));
    assert_eq!(own(&["/robot2/scan"]), (0.3, 30.0));
    // One of them has no namespace.
    let messages: Vec<Message> = messages
        .iter()
        .map(|message| Message { topic: message.topic.trim_start_matches("/robot1").to_owned(), ..message.clone() })
        .collect();
    for (scan, expected) in [("/scan", (0.1, 10.0)), ("/robot2/scan", (0.3, 30.0))] {
        let topics = TopicChoice { scans: vec![scan.to_owned()], ..TopicChoice::default() };
        let data_set = choose(&messages, topics).unwrap();
        let first_m = data_set.records.iter().find_map(|record| match record {
            Record::Odometry(stamped) => Some(stamped.pose.x),
            _ => None,
        });
        assert_eq!((data_set.robot.lidar.mount.x_m, first_m), (expected.0, Some(expected.1)));
    }
}

#[test]
fn transforms_of_another_clock_count_as_taken_when_they_were_recorded() {
    let step = |step| {
        let [x, y, theta] = place(step);
        let late = transform("/tf", at(step) - 1_000_000_000_000, "odom", "base_link", [x, y, 0.0], [0.0, theta]);
        [Message { log_ns: at(step), ..late }, scan("/scan", at(step), "base_link", &RAYS, &ranges_m(step))]
    };
    let data_set = choose(&(0..9).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap();
    assert!(note_of(&data_set, "odom → base_link on /tf are 1000.0 s off").is_some(), "{:?}", data_set.notes);
    let stamps = data_set.records.iter().map(Record::stamp_s);
    assert!(stamps.into_iter().all(|stamp_s| (stamp_s - seconds(at(4))).abs() < 1.0));
}

#[test]
fn stamps_that_do_not_advance_are_replaced_and_told() {
    let step = |step| {
        let moved = |message: Message| Message { log_ns: at(step), ..message };
        [
            moved(odometry("/odom", at(0), "base_link", place(step))),
            moved(scan("/scan", 0, "base_link", &RAYS, &ranges_m(step))),
        ]
    };
    let data_set = choose(&(0..9).flat_map(step).collect::<Vec<_>>(), TopicChoice::default()).unwrap();
    assert!(note_of(&data_set, "do not advance").is_some(), "{:?}", data_set.notes);
    let stamps: Vec<f64> = data_set.scans().map(|scan| scan.stamp_s).collect();
    assert!(stamps.iter().zip(0..).all(|(stamp_s, step)| (stamp_s - seconds(at(step))).abs() < 1e-6), "{stamps:?}");
}

#[test]
fn the_real_bags_are_read_whole_with_their_roles() {
    let Some(data) = data() else { return };
    // Name, LiDARs, scans, odometry poses (about), true poses.
    for (name, topics, scans, poses, truth) in [
        ("guardian_controller_2.bag", &["/scan"][..], 1028, 2060, 0),
        ("jarvis_circular_path_fast.bag", &["/driver_laser_security/laser_scan"], 213, 638, 204),
        ("jarvis_complex_path_fast.bag", &["/driver_laser_security/laser_scan"], 619, 1850, 591),
        ("turtlebot_2018_dec13.bag", &["/scan"], 857, 863, 0),
        ("turtlebot_2018_dec14_after.bag", &["/scan"], 609, 640, 0),
        ("turtlebot_2018_dec14_before.bag", &["/scan"], 484, 485, 0),
        ("turtlebot_2019_jan17.bag", &["/scan"], 962, 977, 0),
    ] {
        let data_set = read(&data.join("bags").join(name));
        let bag = data_set.bag.as_ref().unwrap();
        let mut used: Vec<&str> =
            bag.roles.iter().filter(|role| role.role == "scans").map(|role| role.what.as_str()).collect();
        let mut topics = topics.to_vec();
        topics.sort_unstable();
        used.sort_unstable();
        assert_eq!(used, topics, "{name}");
        assert_eq!(data_set.scans().count(), scans, "{name}");
        let odometry = data_set.records.iter().filter(|record| matches!(record, Record::Odometry(_))).count();
        assert!(odometry <= poses && odometry * 10 > poses * 9, "{name}: {odometry}");
        assert_eq!(bag.truth.as_ref().map_or(0, |truth| truth.poses.len()), truth, "{name}");
        assert_eq!(data_set.dropped.total(), 0, "{name}");
    }
    let without_scans = read(&data.join("bags/nav2_turtlebot.mcap"));
    assert_eq!(without_scans.scans().count(), 0);
    assert!(
        without_scans.bag.unwrap().list_of_topics().contains("/amcl_pose (geometry_msgs/msg/PoseWithCovarianceStamped")
    );
}

/// Odometry by transforms, mount by transforms, another laser than the one that the truth is made of.
#[test]
fn a_bag_with_its_own_truth_is_solved_to_two_centimetres() {
    let Some(data) = data() else { return };
    for name in ["jarvis_circular_path_fast", "jarvis_complex_path_fast"] {
        let data_set = read(&data.join("bags").join(format!("{name}.bag")));
        let config = Config::resolve(&[Layer::from_robot(&data_set.robot)]).unwrap();
        let frames: Vec<Frame> = Frames::new(&data_set.records, &config).unwrap().iter().collect();
        let mut slam = Slam::new(&config);
        for frame in &frames {
            slam.process(frame).unwrap();
        }
        let estimate = slam.finish().trajectory;
        let truth = data_set.bag.unwrap().truth.unwrap().poses;
        let alignment = TruthAlignment::estimate(&estimate, &truth).unwrap();
        let aligned = alignment.apply(&truth);
        let error = TrajectoryError::new(&estimate, &aligned, &TrajectoryErrorOptions::default()).unwrap();
        assert!(error.translation_m.rmse <= 0.02, "{name}: {:?}, {alignment:?}", error.translation_m);
    }
}
