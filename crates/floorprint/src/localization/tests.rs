//! Small worlds in which the robot has to be found, or must not be claimed.

use super::*;
use crate::config::{Config, Layer};
use crate::frame::{BodyScan, Frame};
use crate::frames::Frames;
use crate::geometry::Pose2;
use crate::map::{Occupancy, Raster};
use crate::simulator::{Fault, SimulatedDrive, SimulationConfig, World, simulate};
use std::sync::Arc;

struct Drive {
    frames: Vec<Frame>,
    truth: Vec<Pose2>,
    map: Raster<Occupancy>,
    config: Config,
}

/// A drive of some seconds with a small LiDAR, seen from `skipped` scans after its beginning on.
fn drive(world: &str, faults: Vec<Fault>) -> Drive {
    let mut config = SimulationConfig { faults, ..SimulationConfig::default() };
    (config.lidar.beams, config.lidar.rate_hz, config.camera.rate_hz) = (271, 5.0, 0.0);
    config.motion.standstill_s = 1.0;
    let drive: SimulatedDrive = simulate(World::named(world, 3).unwrap(), config, 3).unwrap();
    let records = drive.records();
    let config = Config::resolve(&[Layer::from_robot(&drive.config().robot)]).unwrap();
    let frames: Vec<Frame> = Frames::new(&records, &config).unwrap().iter().collect();
    let truth = frames.iter().map(|frame| drive.true_pose(frame.stamp_s)).collect();
    Drive { frames, truth, map: drive.true_map(0.05), config }
}

fn reports(drive: &Drive, start: Start, frames: std::ops::Range<usize>) -> Vec<LocalizationReport> {
    let mut localizer = Localizer::new(Arc::new(LocalizationMap::new(&drive.map)), start, &drive.config);
    let range = frames.start..frames.end.min(drive.frames.len());
    drive.frames[range].iter().map(|frame| localizer.process(frame).unwrap()).collect()
}

/// How far the claimed poses are off, metres.
fn errors_m(reports: &[LocalizationReport], truth: &[Pose2]) -> Vec<f64> {
    let error = |(report, truth): (&LocalizationReport, &Pose2)| Some(truth.between(&report.pose?).distance());
    reports.iter().zip(truth).filter_map(error).collect()
}

#[test]
fn a_robot_is_found_wherever_it_starts_and_followed_to_the_centimetre() {
    let drive = drive("rooms", Vec::new());
    for first in [0, drive.frames.len() / 2] {
        let reports = reports(&drive, Start::Unknown, first..first + 120);
        let errors_m = errors_m(&reports, &drive.truth[first..]);
        assert!(errors_m.len() > 20, "from {first}: claimed {} of {}", errors_m.len(), reports.len());
        let largest_m = errors_m.iter().copied().fold(0.0, f64::max);
        assert!(largest_m < 0.1, "from {first}: {largest_m} m off");
    }
}

#[test]
fn the_results_are_the_same_for_any_number_of_threads() {
    let drive = drive("rooms", Vec::new());
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reports(&drive, Start::Unknown, 0..50))
    };
    let one = with_threads(1);
    assert!(one.iter().any(|report| report.pose.is_some()));
    for threads in [2, 8] {
        assert_eq!(with_threads(threads), one, "{threads} threads");
    }
}

#[test]
fn where_in_the_world_a_map_lies_makes_no_difference() {
    let drive = drive("rooms", Vec::new());
    let here = reports(&drive, Start::At(drive.truth[0]), 0..40);
    // As far off as maps in coordinates of a country's survey are; whole cells, so that nothing is rounded differently.
    let moved = Pose2::new(512_000.0, 5_400_000.0, 0.0);
    let mut map = drive.map.clone();
    (map.origin_m[0], map.origin_m[1]) = (map.origin_m[0] + moved.x, map.origin_m[1] + moved.y);
    let there = Drive { map, frames: drive.frames.clone(), truth: Vec::new(), config: drive.config.clone() };
    let there = reports(&there, Start::At(moved.compose(&drive.truth[0])), 0..40);
    for (here, there) in here.iter().zip(&there) {
        let (here, there) = (moved.compose(&here.pose.unwrap()), there.pose.unwrap());
        assert!(here.between(&there).distance() < 1e-4, "{here:?} {there:?}");
    }
}

#[test]
fn a_kidnapped_robot_is_said_to_be_lost_and_found_again() {
    let drive = drive("rooms", vec![Fault::Kidnapping { at_s: 12.0, ahead_m: 14.0 }]);
    let reports = reports(&drive, Start::At(drive.truth[0]), 0..240);
    let kidnapped = 12 * 5;
    let lost = (kidnapped..reports.len()).find(|&step| reports[step].pose.is_none());
    assert!(lost.is_some_and(|lost| lost <= kidnapped + 15), "lost at {lost:?}");
    assert!(reports[5..kidnapped - 5].iter().all(|report| report.pose.is_some()), "a false alarm");
    let errors_m = errors_m(&reports[lost.unwrap()..], &drive.truth[lost.unwrap()..]);
    assert!(errors_m.len() > 20 && errors_m.iter().all(|&error_m| error_m < 0.3), "{errors_m:?}");
}

/// What a robot at `at` (metres, looking along x) in a rectangle from `low` to `high` sees.
fn scan_in_rectangle(at: [f64; 2], low: [f64; 2], high: [f64; 2], most_m: f64) -> BodyScan {
    let mut scan = BodyScan::default();
    for ray in 0..360 {
        let (sin, cos) = (f64::from(ray) + 0.5).to_radians().sin_cos();
        let to_x = if cos > 0.0 { high[0] - at[0] } else { low[0] - at[0] } / cos;
        let to_y = if sin > 0.0 { high[1] - at[1] } else { low[1] - at[1] } / sin;
        let range = to_x.min(to_y);
        if range < most_m {
            scan.hits.push((range * cos) as f32, (range * sin) as f32);
        }
    }
    scan
}

/// A rectangle of free floor, inner size in metres, with walls of so many cells of 5 cm; its lower left inner corner lies
/// at (1, 1) m.
fn walled(inner_m: [f64; 2], wall_cells: usize) -> Raster<Occupancy> {
    let inner = inner_m.map(|side| (side / 0.05).round() as usize);
    let (width, height) = (inner[0] + 40, inner[1] + 40);
    let mut cells = vec![Occupancy::Unknown; width * height];
    for row in 20 - wall_cells..20 + inner[1] + wall_cells {
        for column in 20 - wall_cells..20 + inner[0] + wall_cells {
            let is_free = (20..20 + inner[1]).contains(&row) && (20..20 + inner[0]).contains(&column);
            cells[row * width + column] = if is_free { Occupancy::Free } else { Occupancy::Occupied };
        }
    }
    Raster { width, height, resolution_m: 0.05, origin_m: [0.0, 0.0], cells }
}

#[test]
fn wheels_that_get_stuck_in_a_bare_corridor_do_not_keep_a_claim() {
    // 60 m long, and nothing to be seen of its ends but at the beginning.
    let map = Arc::new(LocalizationMap::new(&walled([60.0, 3.0], 1)));
    let config = Config::default();
    let mut localizer = Localizer::new(map, Start::At(Pose2::new(3.0, 2.4, 0.0)), &config);
    let mut claimed_for = 0;
    for step in 0..150 {
        let at = [3.0 + 0.1 * f64::from(step), 2.4];
        let is_stuck = at[0] > 12.0;
        let frame = Frame {
            index: step as usize,
            stamp_s: 0.2 * f64::from(step),
            elapsed_s: if step == 0 { 0.0 } else { 0.2 },
            motion: Some(Pose2::new(if step == 0 || is_stuck { 0.0 } else { 0.1 }, 0.0, 0.0)),
            dead_reckoning: Pose2::IDENTITY,
            scan: scan_in_rectangle(at, [0.975, 0.975], [61.025, 4.025], 8.0),
        };
        let report = localizer.process(&frame).unwrap();
        let Some(pose) = report.pose else { continue };
        let off_m = (pose.x - at[0]).abs();
        assert!(is_stuck || off_m < 0.4, "step {step}: {off_m} m off before anything went wrong");
        claimed_for = if off_m > 0.5 { claimed_for + 1 } else { 0 };
        assert!(claimed_for < 10, "step {step}: claimed for 2 s though {off_m} m off, {report:?}");
    }
}

#[test]
fn walls_drawn_too_thick_are_where_scans_see_them() {
    // Walls of six cells: scans end anywhere in the first ones, here 7.5 cm behind the free ones.
    let behind_m = 0.075;
    let map = LocalizationMap::new(&walled([8.0, 5.0], 6));
    let config = Config::default();
    let mut localizer = Localizer::new(Arc::new(map), Start::At(Pose2::new(3.1, 2.3, 0.02)), &config);
    for step in 0..30 {
        let at = [3.0 + 0.1 * f64::from(step), 2.4];
        let frame = Frame {
            index: step as usize,
            stamp_s: 0.2 * f64::from(step),
            elapsed_s: if step == 0 { 0.0 } else { 0.2 },
            motion: Some(Pose2::new(if step == 0 { 0.0 } else { 0.1 }, 0.0, 0.0)),
            dead_reckoning: Pose2::IDENTITY,
            scan: scan_in_rectangle(at, [1.0 - behind_m; 2], [9.0 + behind_m, 6.0 + behind_m], 20.0),
        };
        let report = localizer.process(&frame).unwrap();
        let pose = report.pose.unwrap();
        assert!(report.explained.on_map > 0.95, "step {step}: {:?}", report.explained);
        if step > 10 {
            let off_m = (pose.x - at[0]).hypot(pose.y - at[1]);
            assert!(off_m < 0.02, "step {step}: {off_m} m off");
        }
    }
}

#[test]
fn in_a_room_that_exists_twice_nothing_is_claimed() {
    // Two empty rooms of 6 m × 4 m, alike to the cell.
    let (width, height) = (320, 100);
    let mut cells = vec![Occupancy::Unknown; width * height];
    for left in [10, 180] {
        for row in 10..=90 {
            for column in left..=left + 120 {
                let is_wall = row == 10 || row == 90 || column == left || column == left + 120;
                cells[row * width + column] = if is_wall { Occupancy::Occupied } else { Occupancy::Free };
            }
        }
    }
    let map = Raster { width, height, resolution_m: 0.05, origin_m: [0.0, 0.0], cells };
    let config = Config::default();
    let mut localizer = Localizer::new(Arc::new(LocalizationMap::new(&map)), Start::Unknown, &config);
    // The room's walls as seen from a robot that drives 2.5 m through the left one.
    let mut last = None;
    for step in 0..26 {
        let at = [2.0 + 0.1 * f64::from(step), 2.2];
        let frame = Frame {
            index: step as usize,
            stamp_s: 0.2 * f64::from(step),
            elapsed_s: 0.2,
            motion: Some(Pose2::new(if step == 0 { 0.0 } else { 0.1 }, 0.0, 0.0)),
            dead_reckoning: Pose2::IDENTITY,
            scan: scan_in_rectangle(at, [0.525, 0.475], [6.525, 4.475], f64::INFINITY),
        };
        let report = localizer.process(&frame).unwrap();
        assert_eq!(report.pose, None, "step {step}: {:?}", report.modes);
        last = Some(report);
    }
    let modes = last.unwrap().modes;
    // Either room: nothing tells them apart.
    let near = |x: f64| modes.iter().any(|mode| (mode.pose.x - x).hypot(mode.pose.y - 2.2) < 0.3 && mode.weight > 0.1);
    assert!(near(4.5) && near(13.0), "{modes:?}");
}
