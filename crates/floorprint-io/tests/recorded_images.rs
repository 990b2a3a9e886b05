//! The floor painted from the images of a recording is the one painted from the course's files.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where a step fails")]

mod bag_writers;
mod camera_drive;

use bag_writers::{Message, mcap, ros1_bag, sqlite};
use camera_drive::{LENS, Packing, drive, messages, nanoseconds};
use floorprint::evaluation::{TextureError, TextureErrorOptions};
use floorprint::sensors::{ColorImage, DepthImage};
use floorprint::simulator::SimulatedDrive;
use floorprint::texture::{FloorMapper, RgbdCamera, RgbdFrame, TextureConfig, TextureMap, pair_by_time};
use floorprint_io::{DataSet, LoadedPair, OpenOptions, TopicChoice, open};
use std::fs;
use std::path::Path;

/// What is recorded of the drive, seconds.
const SECONDS: f64 = 4.5;

/// The floor that images show from where they truly were taken.
fn painted(drive: &SimulatedDrive, camera: RgbdCamera, pairs: &[(DepthImage, ColorImage)]) -> TextureMap {
    let mapper = FloorMapper::new(&TextureConfig::default(), camera, 1).unwrap();
    let patch = |(depth, color): &(DepthImage, ColorImage)| {
        let motion = drive.true_pose(depth.stamp_s).between(&drive.true_pose(color.stamp_s));
        mapper.patch(&RgbdFrame { depth, color, depth_body_from_color_body: motion }).unwrap()
    };
    let patches: Vec<_> = pairs.iter().map(patch).collect();
    let poses: Vec<_> = pairs.iter().map(|(_, color)| drive.true_pose(color.stamp_s)).collect();
    mapper.paint(&patches, &poses)
}

fn error(map: &TextureMap, drive: &SimulatedDrive) -> TextureError {
    TextureError::new(map, &drive.true_floor(0.02), None, &TextureErrorOptions::default()).unwrap()
}

/// The floor from the simulated Kinect's own images.
fn from_kinect(drive: &SimulatedDrive) -> TextureMap {
    let within = |stamps_s: Vec<f64>| -> Vec<f64> {
        let end_s = drive.config().start_stamp_s + SECONDS;
        stamps_s.into_iter().take_while(|stamp_s| *stamp_s < end_s).collect()
    };
    let pairing = pair_by_time(&within(drive.disparity_stamps_s()), &within(drive.color_stamps_s()), 0.1);
    let load = |pair: &floorprint::texture::ImagePair| {
        (drive.disparity_image(pair.depth).unwrap(), drive.color_image(pair.color).unwrap())
    };
    let pairs: Vec<_> = pairing.pairs.iter().map(load).collect();
    painted(drive, RgbdCamera::of(&drive.config().robot).unwrap(), &pairs)
}

fn recorded_pairs(data_set: &DataSet) -> Vec<(DepthImage, ColorImage)> {
    let images = data_set.images.as_ref().unwrap();
    let stamps = |entries: &[floorprint_io::ImageEntry]| entries.iter().map(|entry| entry.stamp_s).collect::<Vec<_>>();
    let pairing = pair_by_time(&stamps(&images.depth), &stamps(&images.color), 0.1);
    images.for_each_pair(&pairing.pairs, &|| false, &|pair: LoadedPair| pair.unwrap_or_else(|error| panic!("{error}")))
}

fn from_recording(drive: &SimulatedDrive, path: &Path) -> TextureMap {
    let data_set = open(path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    painted(drive, RgbdCamera::of(&data_set.robot).unwrap(), &recorded_pairs(&data_set))
}

#[test]
fn the_floor_is_the_same_from_every_kind_of_recording() {
    let drive = drive();
    let kinect = error(&from_kinect(&drive), &drive);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let recorded = |packing, lens: &[f64]| messages(&drive, SECONDS, packing, lens);
    let plain = [0.0; 5];
    fs::write(path("raw.bag"), ros1_bag(&recorded(Packing::Raw, &plain), "lz4", 20)).unwrap();
    fs::write(path("metres.mcap"), mcap(&recorded(Packing::Metres, &plain), "", 20, false)).unwrap();
    sqlite(&path("compressed.db3"), &recorded(Packing::Compressed, &plain), <[u8]>::to_vec);
    fs::write(path("lens.mcap"), mcap(&recorded(Packing::Lens, &LENS), "lz4", 20, true)).unwrap();
    for name in ["raw.bag", "metres.mcap", "compressed.db3", "lens.mcap"] {
        let floor = error(&from_recording(&drive, &path(name)), &drive);
        let difference = floor.mean_absolute_error - kinect.mean_absolute_error;
        assert!(difference < 1.0, "{name}: {floor:?}, from the Kinect {kinect:?}");
        let cells = floor.compared_cells as f64 / kinect.compared_cells as f64;
        assert!((0.97..1.05).contains(&cells), "{name}: {floor:?}, from the Kinect {kinect:?}");
    }
    // Were the lens ignored, the floor would be another.
    fs::write(path("ignored.mcap"), mcap(&recorded(Packing::Lens, &plain), "lz4", 20, true)).unwrap();
    let ignored = error(&from_recording(&drive, &path("ignored.mcap")), &drive);
    assert!(ignored.mean_absolute_error > kinect.mean_absolute_error + 2.0, "{ignored:?}, from the Kinect {kinect:?}");
}

fn described(messages: &[Message], topics: TopicChoice) -> Result<DataSet, String> {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), mcap(messages, "", 50, false)).unwrap();
    open(file.path(), &OpenOptions { topics, ..OpenOptions::default() }).map_err(|error| error.to_string())
}

#[test]
fn cameras_are_found_and_what_is_missing_is_told() {
    let drive = drive();
    let mut all = messages(&drive, 1.2, Packing::Raw, &[0.0; 5]);
    // A grey camera elsewhere that has no depth, and one whose images nobody reads.
    let grey = vec![7; 640 * 480];
    let stamp_ns = nanoseconds(drive.config().start_stamp_s) + 1_000_000_000;
    all.push(bag_writers::image("/rear/image", stamp_ns, "rear", camera_drive::SIZE_PX, "mono8", &grey));
    all.push(bag_writers::image("/bayer/image", stamp_ns, "rear", camera_drive::SIZE_PX, "bayer_rggb8", &grey));
    let data_set = described(&all, TopicChoice::default()).unwrap();
    let roles: Vec<String> = data_set
        .bag
        .as_ref()
        .unwrap()
        .roles
        .iter()
        .map(|role| format!("{} {}: {}", role.role, role.what, role.reason))
        .collect();
    let role = |words: &[&str]| roles.iter().any(|role| words.iter().all(|word| role.contains(word)));
    assert!(role(&["colour /camera/color/image_raw", "rgb8"]), "{roles:?}");
    assert!(role(&["depth /camera/depth/image_raw", "16UC1", "0.180 m, 0.005 m"]), "{roles:?}");
    assert!(role(&["not used /rear/image", "no CameraInfo"]), "{roles:?}");
    assert!(role(&["not used /bayer/image", "bayer_rggb8"]), "{roles:?}");
    // The footprint lies on the floor, not the base.
    let camera = data_set.robot.depth_camera.as_ref().unwrap();
    assert!((camera.depth.mount.z_m - 0.487).abs() < 1e-6 && (camera.depth.mount.pitch_rad - 0.36).abs() < 1e-6);

    let wish = |depth: &str| TopicChoice { depth: Some(depth.to_owned()), ..TopicChoice::default() };
    let message = described(&all, wish("/camera/depth/image")).unwrap_err();
    assert!(message.contains("--depth") && message.contains("Did you mean /camera/depth/image_raw?"), "{message}");
    let message = described(&all, wish("/rear/image")).unwrap_err();
    assert!(message.contains("sensor_msgs/msg/Image, no depth images"), "{message}");

    // Without the mount: images, but no camera; without intrinsics: neither.
    let without =
        |part: &str| -> Vec<Message> { all.iter().filter(|message| !message.topic.contains(part)).cloned().collect() };
    let data_set = described(&without("tf_static"), TopicChoice::default()).unwrap();
    assert!(data_set.robot.depth_camera.is_none() && data_set.images.is_some());
    let note = |data_set: &DataSet, words: &str| data_set.notes.iter().any(|note| note.contains(words));
    assert!(note(&data_set, "the floor is not painted: depth_optical"), "{:?}", data_set.notes);
    let data_set = described(&without("camera_info"), TopicChoice::default()).unwrap();
    assert!(data_set.images.is_none() && note(&data_set, "CameraInfo"), "{:?}", data_set.notes);
}
