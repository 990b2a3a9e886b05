//! What each fuzz target does with bytes: it must end soon, and neither panic nor take much memory.
//!
//! The targets run these with libFuzzer; the tests of `floorprint-io` run them with the corpus.

use floorprint::config::{Layer, Preset};
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, RobotConfig, Scan, ScanGeometry};
use floorprint::session::{Session, SessionState, StoredScan, pack_poses, unpack_poses};
use floorprint::texture::ImagePair;
use floorprint::{CompactScan, Config, Frames, SensorId, Slam};
use floorprint_io::{
    DataSet, OpenOptions, open, open_log, parse_map, read_floor, read_g2o, read_png, read_relations, read_trajectory,
};
use floorprint_io::{write_g2o, write_trajectory};
use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

/// A target: its name, which is that of its folder in the corpus, and what it does.
pub type Target = (&'static str, fn(&[u8]));

/// All targets.
pub const TARGETS: [Target; 14] = [
    ("carmen", carmen),
    ("encoder_log", encoder_log),
    ("ece276a", ece276a),
    ("text", text),
    ("recording", recording),
    ("trajectory", trajectory),
    ("relations", relations),
    ("g2o", g2o),
    ("map_yaml", map_yaml),
    ("pgm", pgm),
    ("png", png),
    ("floor", floor),
    ("slam", slam),
    ("session", session),
];

/// A folder in memory where the system has one there, removed with its thread.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        let memory = Path::new("/dev/shm");
        let place = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
        let thread = format!("{:?}", std::thread::current().id());
        let number: String = thread.chars().filter(char::is_ascii_digit).collect();
        let folder = place.join(format!("floorprint-fuzz-{}-{number}", std::process::id()));
        fs::create_dir_all(&folder).expect("a scratch folder");
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

thread_local! {
    static FOLDER: Folder = Folder::new();
    /// The last robot that was seen and its configuration: to resolve one takes longer than to read a short file.
    static RESOLVED: RefCell<Option<(RobotConfig, Option<Config>)>> = const { RefCell::new(None) };
}

/// Puts files into a folder of their own, looks at them, and removes them.
fn with_files(files: &[(&str, &[u8])], look: impl FnOnce(&Path)) {
    FOLDER.with(|Folder(folder)| {
        for (name, bytes) in files {
            fs::write(folder.join(name), bytes).expect("a file in the scratch folder");
        }
        look(folder);
        for (name, _) in files {
            let _ = fs::remove_file(folder.join(name));
        }
    });
}

/// The configuration for a robot, where there is one.
fn config_for(robot: &RobotConfig) -> Option<Config> {
    RESOLVED.with_borrow_mut(|resolved| match resolved {
        Some((known, config)) if known == robot => config.clone(),
        _ => {
            let config = Config::resolve(&[Layer::from_robot(robot)]).ok();
            resolved.insert((robot.clone(), config)).1.clone()
        }
    })
}

/// Opens a log, and makes frames of what is in it.
fn look_at_log(name: &str, bytes: &[u8]) {
    if let Ok(log) = open_log(Path::new(name), bytes.to_vec(), &OpenOptions::default()) {
        look_at(&log);
    }
}

fn opened(path: &Path) -> Option<DataSet> {
    let data_set = open(path, &OpenOptions::default()).ok()?;
    look_at(&data_set);
    Some(data_set)
}

fn look_at(data_set: &DataSet) {
    assert!(data_set.scans().all(|scan| scan.geometry.len() == scan.ranges_m.len()));
    if let Some(config) = config_for(&data_set.robot)
        && let Ok(frames) = Frames::new(&data_set.records, &config)
    {
        assert!(frames.iter().take(100).all(|frame| frame.motion.is_none_or(|motion| motion.is_finite())));
    }
}

/// A CARMEN log, plain or gzipped.
pub fn carmen(bytes: &[u8]) {
    look_at_log("log.clf", bytes);
}

/// An encoder log: the bytes, and a line of theirs behind what makes the format known.
pub fn encoder_log(bytes: &[u8]) {
    let line = [b"1000 0 5 6 ".as_slice(), &b"1500 ".repeat(682), b"\n", bytes].concat();
    look_at_log("log.dat", &line);
}

/// The archives of a course folder: the same bytes for each.
pub fn ece276a(bytes: &[u8]) {
    let names = ["Encoders1.npz", "Hokuyo1.npz", "Imu1.npz", "Kinect1.npz"];
    for name in names {
        with_files(&[(name, bytes)], |folder| drop(opened(folder)));
    }
}

/// Text with a reading a line.
pub fn text(bytes: &[u8]) {
    look_at_log("log.csv", bytes);
}

/// A recording of ROS in any container, with its images.
pub fn recording(bytes: &[u8]) {
    with_files(&[("drive.bag", bytes)], |folder| {
        let Some(images) = opened(&folder.join("drive.bag")).and_then(|data_set| data_set.images) else { return };
        let count = images.depth.len().min(images.color.len()).min(4);
        let pairs: Vec<ImagePair> = (0..count).map(|number| ImagePair { depth: number, color: number }).collect();
        let loaded = images.for_each_pair(&pairs, &|| false, &|pair| {
            let Ok((depth, color)) = pair else { return true };
            (depth.width * depth.height, color.width * color.height) == (depth.values.len(), color.rgb.len())
        });
        assert!(loaded.into_iter().all(|is_whole| is_whole));
    });
}

/// A trajectory: what is read is written and read again as it was.
pub fn trajectory(bytes: &[u8]) {
    with_files(&[("t.tum", bytes)], |folder| {
        if let Ok(poses) = read_trajectory(&folder.join("t.tum")) {
            let again = folder.join("again.tum");
            write_trajectory(&again, &poses).expect("a trajectory in the scratch folder");
            assert_eq!(read_trajectory(&again).map(|poses| poses.len()).ok(), Some(poses.len()));
        }
    });
}

/// Relations of the benchmark.
pub fn relations(bytes: &[u8]) {
    with_files(&[("t.relations", bytes)], |folder| drop(read_relations(&folder.join("t.relations"))));
}

/// A pose graph: what is written can be read.
pub fn g2o(bytes: &[u8]) {
    with_files(&[("a.g2o", bytes)], |folder| {
        if let Ok(graph) = read_g2o(&folder.join("a.g2o")) {
            let again = folder.join("again.g2o");
            write_g2o(&again, &graph).expect("what was read can be written");
            read_g2o(&again).expect("what was written can be read");
        }
    });
}

/// A map's description, with a small picture.
pub fn map_yaml(bytes: &[u8]) {
    let picture = b"P5\n3 2\n255\n\x00\xfe\xcd\x00\xfe\xcd";
    if let Ok(description) = std::str::from_utf8(bytes) {
        drop(parse_map(Path::new("map.yaml"), description, |_| Ok(picture.to_vec())));
    }
}

/// A map's picture.
pub fn pgm(bytes: &[u8]) {
    let description = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0.3]\n";
    drop(parse_map(Path::new("map.yaml"), description, |_| Ok(bytes.to_vec())));
}

/// A picture.
pub fn png(bytes: &[u8]) {
    with_files(&[("a.png", bytes)], |folder| drop(read_png(&folder.join("a.png"))));
}

/// A floor's description, with a picture that is none.
pub fn floor(bytes: &[u8]) {
    with_files(&[("floor.json", bytes), ("floor.png", b"\x89PNG")], |folder| {
        drop(read_floor(&folder.join("floor.json")));
    });
}

/// Rays of a scan of the `slam` target.
const RAYS: usize = 24;

/// A configuration for each preset, with small submaps and few particles, so that little data do much.
static CONFIGS: LazyLock<Vec<Config>> = LazyLock::new(|| {
    let settings = ["filter.particles=3", "matcher.search_below_inlier_share=0.5", "loop_closure.submap_length_m=0.5"];
    let layers = |preset: Preset| -> Result<Vec<Layer>, _> {
        std::iter::once(Ok(preset.layer())).chain(settings.map(Layer::from_setting)).collect()
    };
    let config = |preset| layers(preset).and_then(|layers| Config::resolve(&layers));
    Preset::ALL.iter().map(|&preset| config(preset).expect("settings within their bounds")).collect()
});

/// A drive: a byte for the preset, then for each scan a motion of three bytes and a byte for each ray.
pub fn slam(bytes: &[u8]) {
    let Some((&first, rest)) = bytes.split_first() else { return };
    let config = &CONFIGS[usize::from(first) % CONFIGS.len()];
    let records = records(rest);
    let Ok(frames) = Frames::new(&records, config) else { return };
    let mut slam = Slam::new(config);
    let taken = drive(&mut slam, &frames);
    let result = slam.finish();
    assert_eq!(result.trajectory.len(), taken);
    assert!(result.trajectory.iter().all(|stamped| stamped.pose.is_finite()));
}

/// Takes in all frames; tells how many of them were taken.
fn drive(slam: &mut Slam, frames: &Frames<'_>) -> usize {
    let mut taken = 0;
    for frame in frames.iter() {
        if let Ok(step) = slam.process(&frame) {
            assert!(step.pose.is_finite(), "{step:?}");
            taken += 1;
        }
    }
    taken
}

/// Three bytes of motion and one for each ray of each scan.
fn records(bytes: &[u8]) -> Vec<Record> {
    let step_rad = 6.0 / RAYS as f64;
    let geometry = Arc::new(ScanGeometry {
        angles_rad: (0..RAYS).map(|ray| -3.0 + ray as f64 * step_rad).collect(),
        time_offsets_s: vec![0.0; RAYS],
        range_min_m: 0.1,
        range_max_m: 7.5,
        below_minimum_is_no_return: false,
    });
    let mut pose = Pose2::IDENTITY;
    bytes
        .chunks_exact(3 + RAYS)
        .take(30)
        .enumerate()
        .map(|(index, scan)| {
            // An odd first byte leaps; else the robot moves by centimetres.
            let signed = |byte: u8| f64::from(i8::from_ne_bytes([byte]));
            let unit_m = if scan[0] % 16 == 15 { 1e3 } else { 0.01 };
            pose = pose.compose(&Pose2::new(unit_m * signed(scan[0]), 0.002 * signed(scan[1]), 0.02 * signed(scan[2])));
            Record::Scan(Scan {
                sensor: SensorId::default(),
                stamp_s: index as f64 * 0.2,
                ranges_m: scan[3..].iter().map(|&byte| f32::from(byte) * 0.03).collect(),
                geometry: Arc::clone(&geometry),
                odometry: Some(pose),
            })
        })
        .collect()
}

/// A session as it is stored, in its parts.
#[derive(Clone)]
struct Stored {
    state: Vec<u8>,
    submaps: Vec<Vec<u8>>,
    poses: Vec<u8>,
    scans: Vec<(usize, Vec<u8>)>,
}

impl Stored {
    /// A short drive through something, around a corner and back, which may have ended.
    fn new(has_ended: bool) -> Self {
        let config = &CONFIGS[0];
        let scan = |index: usize| {
            let turn = if index % 8 == 7 { 100 } else { 0 };
            let wall = move |ray: usize| 60 + (ray as u8 * 7 + index as u8) % 90;
            [20, 0, turn].into_iter().chain((0..RAYS).map(wall))
        };
        let records = records(&(0..30).flat_map(scan).collect::<Vec<u8>>());
        let frames = Frames::new(&records, config).expect("records with scans");
        let mut slam = Slam::new(config);
        drive(&mut slam, &frames);
        let session = if has_ended { slam.finish().session } else { slam.session().clone() };
        let stored = Self {
            state: rmp_serde::to_vec_named(&session.state(&config.matcher)).expect("a state"),
            submaps: session
                .submaps()
                .iter()
                .map(|submap| rmp_serde::to_vec_named(submap.as_ref()).expect("a submap"))
                .collect(),
            poses: pack_poses(&session.poses()),
            scans: session.scans().iter().map(|scan| (scan.frame, scan.points.bytes())).collect(),
        };
        assert!(stored.load().is_some_and(|session| session.frames() == 30), "what was stored is loaded");
        stored
    }

    /// The session that is made of the parts, if they make one.
    fn load(&self) -> Option<Session> {
        let mut state: SessionState = rmp_serde::from_slice(&self.state).ok()?;
        let submaps: Option<Vec<_>> = self.submaps.iter().map(|submap| rmp_serde::from_slice(submap).ok()).collect();
        state.set_submaps(submaps?);
        let scans = self.scans.iter().map(|(frame, points)| {
            Some(StoredScan { frame: *frame, points: CompactScan::from_bytes(points)?, is_drawn: true })
        });
        Session::restore(state, unpack_poses(&self.poses)?, scans.collect::<Option<_>>()?).ok()
    }
}

/// Two stored sessions: of a drive under way and of one that has ended.
static STORED: LazyLock<[Stored; 2]> = LazyLock::new(|| [false, true].map(Stored::new));

/// A stored session with one part changed: a byte says which kind, another which of those, the rest how. What can be loaded can
/// be drawn, stored and gone on with.
pub fn session(bytes: &[u8]) {
    let &[which, number, ref part @ ..] = bytes else { return };
    let stored = &STORED[usize::from(which & 1)];
    let Stored { mut state, mut submaps, mut poses, mut scans } = stored.clone();
    match (which >> 1) & 3 {
        0 => state = with_patches(&state, part),
        1 => {
            let count = submaps.len();
            let submap = &mut submaps[usize::from(number) % count];
            *submap = with_patches(submap, part);
        }
        2 => poses = part.to_vec(),
        _ => {
            let count = scans.len();
            scans[usize::from(number) % count].1 = part.to_vec();
        }
    }
    let Some(session) = (Stored { state, submaps, poses, scans }).load() else { return };
    let config = &CONFIGS[0];
    let grid = session.map();
    drop(grid.to_raster());
    assert_eq!(session.trajectory().len(), session.frames());
    drop(session.graph());
    rmp_serde::to_vec_named(&session.state(&config.matcher)).expect("what was read can be written");
    let Ok(mut slam) = Slam::resume(session, config) else { return };
    let records = records(&[80; 3 * (3 + RAYS)]);
    let Ok(frames) = Frames::new(&records, config) else { return };
    drive(&mut slam, &frames);
    drop(slam.finish());
}

/// Bytes with some of them replaced: two bytes say which, a third what by.
fn with_patches(whole: &[u8], patches: &[u8]) -> Vec<u8> {
    let mut patched = whole.to_vec();
    for patch in patches.chunks_exact(3) {
        let at = usize::from(u16::from_le_bytes([patch[0], patch[1]])) % patched.len().max(1);
        if let Some(byte) = patched.get_mut(at) {
            *byte = patch[2];
        }
    }
    patched
}
