use super::*;
use floorprint::config::Layer;
use floorprint::simulator::{SimulationConfig, World, simulate};
use floorprint::{Config, Frame, Frames, Slam};

/// A short drive, to and fro so many times: the way back is its scans in reverse order with inverted motions.
fn to_and_fro(times: usize) -> (Config, Vec<Frame>) {
    let mut simulation = SimulationConfig::default();
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (181, 5.0, 0.0);
    let drive = simulate(World::named("rooms", 1).unwrap(), simulation, 1).unwrap();
    let mut config = Config::resolve(&[Layer::from_robot(&drive.config().robot)]).unwrap();
    config.loop_closure.passes_kept = 1;
    let there: Vec<Frame> = Frames::new(&drive.records(), &config).unwrap().iter().collect();
    let back = there.iter().enumerate().rev().map(|(k, frame)| {
        let motion = there.get(k + 1).map_or(Some(Pose2::IDENTITY), |next| next.motion.map(|step| step.inverse()));
        Frame { motion, ..frame.clone() }
    });
    let mut trip: Vec<Frame> = there.iter().cloned().chain(back).collect();
    trip[0].motion = Some(Pose2::IDENTITY);
    let frames = (0..times).flat_map(|_| trip.iter().cloned());
    (config, frames.collect())
}

/// All that Floorprint's own tables hold.
fn contents(file: &SessionFile) -> Vec<(&'static str, i64, Vec<u8>)> {
    let tables = [
        ("poses", "SELECT block, poses FROM floorprint_packed_poses ORDER BY block"),
        ("key scans", "SELECT number, points FROM floorprint_key_scans ORDER BY number"),
        ("submaps", "SELECT number, value FROM floorprint_submaps ORDER BY number"),
        ("state", "SELECT id, value FROM floorprint_state"),
    ];
    let rows = tables.into_iter().flat_map(|(name, query)| {
        let mut select = file.connection.prepare(query).unwrap();
        let rows = select.query_map([], |row| Ok((name, row.get(0)?, row.get(1)?))).unwrap();
        rows.map(Result::unwrap).collect::<Vec<_>>()
    });
    rows.collect()
}

#[test]
fn a_save_writes_what_changed_and_the_file_is_the_one_that_is_written_at_once() {
    let (config, frames) = to_and_fro(5);
    let folder = tempfile::tempdir().unwrap();
    let mut file = SessionFile::create(&folder.path().join("kept.gpkg")).unwrap();
    let mut slam = Slam::new(&config);
    let (mut most_rows, mut state_bytes) = (0, Vec::new());
    for (number, frame) in frames.iter().enumerate() {
        slam.process(frame).unwrap();
        // Every five seconds of driving.
        if number % 25 == 0 {
            let before = file.connection.total_changes();
            file.save(slam.session(), &config.matcher).unwrap();
            if number > 0 {
                most_rows = most_rows.max(file.connection.total_changes() - before);
            }
            let state: i64 =
                file.connection.query_row("SELECT length(value) FROM floorprint_state", [], |row| row.get(0)).unwrap();
            state_bytes.push(state);
        }
    }
    file.save(slam.session(), &config.matcher).unwrap();
    let kept = contents(&file);
    let session = slam.session();
    assert!(kept.len() > 4 * most_rows as usize, "{most_rows} rows of {}", kept.len());
    // What is written whole each time does not grow with the distance.
    let [half_way, end] = [state_bytes.len() / 2, state_bytes.len() - 1].map(|at| state_bytes[at] as f64);
    assert!(end < 1.25 * half_way, "{state_bytes:?}");
    let at_once = folder.path().join("at-once.gpkg");
    SessionFile::write(&at_once, session, &config.matcher).unwrap();
    let at_once = SessionFile::open(&at_once).unwrap();
    assert!(kept == contents(&at_once));
    let loaded = at_once.load().unwrap();
    assert_eq!(loaded.trajectory(), session.trajectory());
    // Who goes on from the file goes on as if there had been no file.
    let (mut goes_on, mut resumed) = (slam, Slam::resume(loaded, &config).unwrap());
    for frame in &frames[..100] {
        goes_on.process(frame).unwrap();
        resumed.process(frame).unwrap();
    }
    assert_eq!(resumed.session().scans(), goes_on.session().scans());
    let (a, b) = (goes_on.trajectory(), resumed.trajectory());
    let largest_m = a.iter().zip(&b).map(|(a, b)| a.pose.between(&b.pose).distance()).fold(0.0, f64::max);
    assert!(a.len() == b.len() && largest_m < 0.02, "{largest_m} m");
}

#[test]
fn a_file_of_the_first_version_becomes_one_of_this_with_the_first_save() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../floorprint-cli/tests/golden/session-format-1.gpkg");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.gpkg");
    fs::copy(golden, &path).unwrap();
    let mut file = SessionFile::open(&path).unwrap();
    let old = file.load().unwrap();
    assert_eq!((file.version, old.frames()), (1, 190));
    // A reader changes nothing.
    assert_eq!(SessionFile::read(&path).unwrap().trajectory(), old.trajectory());
    file.save(&old, &MatcherConfig::default()).unwrap();
    drop(file);
    let file = SessionFile::open(&path).unwrap();
    let new = file.load().unwrap();
    assert_eq!((file.version, new.trajectory()), (FORMAT_VERSION, old.trajectory()));
    assert_eq!(new.scans(), old.scans());
    assert_eq!(new.map().to_raster(), old.map().to_raster());
    let integrity: String = file.connection.query_row("PRAGMA integrity_check", [], |row| row.get(0)).unwrap();
    assert_eq!(integrity, "ok");
}

#[test]
fn a_log_that_a_killed_process_left_is_not_read_into_a_new_file() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../floorprint-cli/tests/golden/session-format-1.gpkg");
    let session = SessionFile::read(&golden).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (killed, path) = (folder.path().join("killed.gpkg"), folder.path().join("new.gpkg"));
    let mut file = SessionFile::create(&killed).unwrap();
    file.save(&session, &MatcherConfig::default()).unwrap();
    file.note("what", "an old one").unwrap();
    let leave_logs = || {
        for (from, to) in logs_of(&killed).iter().zip(logs_of(&path)).take(2) {
            fs::copy(from, to).unwrap();
        }
    };
    // The file itself was removed, its log was not.
    leave_logs();
    let mut new = SessionFile::create(&path).unwrap();
    new.save(&session, &MatcherConfig::default()).unwrap();
    new.close().unwrap();
    let notes = |path: &Path| SessionFile::open(path).unwrap().notes().unwrap();
    assert!(!notes(&path).contains_key("what"));
    // Nor is it where the file is there, and another one takes its place.
    fs::copy(&killed, &path).unwrap();
    leave_logs();
    assert!(notes(&path).contains_key("what"));
    fs::copy(&killed, &path).unwrap();
    leave_logs();
    SessionFile::write(&path, &session, &MatcherConfig::default()).unwrap();
    assert!(!notes(&path).contains_key("what"));
    assert_eq!(SessionFile::read(&path).unwrap().frames(), session.frames());
}

#[test]
fn one_process_makes_a_file_and_what_a_killed_one_left_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new.gpkg");
    let left = hidden(&path, "new");
    fs::write(&left, "half of a file").unwrap();
    let first = SessionFile::create(&path).unwrap();
    let error = SessionFile::create(&path).unwrap_err().to_string();
    assert!(error.contains("another process is writing it"), "{error}");
    drop(first);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    assert!(SessionFile::create(&path).is_ok());
}
