//! The examples do what they say.

#![allow(clippy::unwrap_used, reason = "a test ends where a step fails")]
#![allow(clippy::print_stdout, reason = "examples show what they found")]
#![allow(dead_code, reason = "examples have a main function of their own")]

#[path = "../examples/5_evaluate.rs"]
mod evaluate;
#[path = "../examples/1_log_to_map.rs"]
mod log_to_map;
#[path = "../examples/3_save_and_resume.rs"]
mod save_and_resume;
#[path = "../examples/4_your_own_filter.rs"]
mod your_own_filter;
#[path = "../examples/2_your_own_robot.rs"]
mod your_own_robot;

use floorprint::simulator::{SimulationConfig, World, simulate};
use floorprint_io::{SessionFile, read_map, read_trajectory, write_ece276a};
use std::path::Path;
use tempfile::TempDir;

/// A short drive in the layout of the course, with its truth.
fn drive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut simulation = SimulationConfig::default();
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (181, 10.0, 0.0);
    let drive = simulate(World::named("rooms", 1).unwrap(), simulation, 1).unwrap();
    write_ece276a(&folder.path().join("drive"), &drive, 1, false, &mut |_, _, _| {}).unwrap();
    folder
}

#[test]
fn a_log_becomes_a_map_and_is_evaluated() {
    let folder = drive();
    let path = folder.path().join("drive");
    log_to_map::log_to_map(&path, folder.path()).unwrap();
    assert!(read_map(&folder.path().join("map.yaml")).unwrap().width > 100);
    assert!(read_trajectory(&folder.path().join("trajectory.tum")).unwrap().len() > 100);
    let [slam, odometry] = evaluate::evaluate(&path, &path.join("truth.tum")).unwrap();
    assert!(slam.translation_m.rmse < 0.05 && slam.translation_m.rmse < odometry.translation_m.rmse);
}

#[test]
fn readings_are_pushed_one_by_one() {
    let error_m = your_own_robot::your_own_robot().unwrap();
    assert!(error_m < 0.05, "{error_m} m");
}

#[test]
fn a_drive_is_saved_and_resumed() {
    let folder = drive();
    let session = folder.path().join("session.gpkg");
    let frames = save_and_resume::save_and_resume(&folder.path().join("drive"), &session).unwrap();
    assert_eq!(SessionFile::open(&session).unwrap().load().unwrap().frames(), frames);
}

#[test]
fn a_filter_of_ones_own_makes_a_map() {
    let folder = drive();
    let map = your_own_filter::your_own_filter(Path::new(&folder.path().join("drive")), 200).unwrap();
    let occupied = map.cells.iter().filter(|cell| **cell == floorprint::map::Occupancy::Occupied).count();
    assert!(occupied > 200, "{occupied} occupied cells");
}
