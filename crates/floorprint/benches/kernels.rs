//! The kernels that a drive spends its time in, each on its own: ray tracing, matching,
//! copying and writing of maps.
//!
//! `cargo bench -p floorprint` prints the time of each; `KERNEL=match_scan` runs only that one, so that
//! valgrind can count its instructions.

use floorprint::geometry::Pose2;
use floorprint::map::{Cell, MapConfig, OccupancyGrid, SurfaceMap, passed_cells};
use floorprint::odometry::Frames;
use floorprint::scan_matcher::{MatcherConfig, PoseBelief, SearchWindow, SurfaceScan, match_scan, search};
use floorprint::simulator::{SimulationConfig, World, simulate};
use floorprint::{BodyScan, Config};
use nalgebra::Matrix3;
use std::hint::black_box;
use std::io::Write;
use std::time::{Duration, Instant};

/// Each kernel is repeated for about this long.
const LONG_ENOUGH: Duration = Duration::from_millis(300);

/// Prints the mean time of `kernel`, unless another one was asked for.
fn measure(name: &str, mut kernel: impl FnMut()) -> std::io::Result<()> {
    let mut out = std::io::stdout();
    if let Ok(only) = std::env::var("KERNEL") {
        if only == name {
            (0..REPEATS_UNDER_VALGRIND).for_each(|_| kernel());
            writeln!(out, "{name}: {REPEATS_UNDER_VALGRIND} times")?;
        }
        return Ok(());
    }
    kernel();
    let (start, mut times) = (Instant::now(), 0_u32);
    while start.elapsed() < LONG_ENOUGH {
        kernel();
        times += 1;
    }
    writeln!(out, "{name:12} {:>10.1} µs", start.elapsed().as_secs_f64() * 1e6 / f64::from(times))
}

/// Enough to make what leads up to a kernel small beside it.
const REPEATS_UNDER_VALGRIND: usize = 100;

/// A scan of 1081 rays in the simulated rooms, as the robot starts to move.
fn scan_in_rooms() -> Result<BodyScan, Box<dyn std::error::Error>> {
    let drive = simulate(World::named("rooms", 1)?, SimulationConfig::default(), 1)?;
    let records: Vec<_> = drive.stream().take(400).collect();
    let config = Config { robot: drive.config().robot.clone(), ..Config::default() };
    let frames = Frames::new(&records, &config)?;
    Ok(frames.iter().next().ok_or("the drive has no scan")?.scan)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let body_scan = scan_in_rooms()?;
    let matcher = MatcherConfig::default();
    let scan = SurfaceScan::new(&body_scan, &matcher);
    let mut map = SurfaceMap::new(matcher.cell_m);
    map.add_scan(&Pose2::IDENTITY, &scan);
    let guess = Pose2::new(0.05, -0.03, 0.02);
    let prior = PoseBelief { pose: guess, information: Matrix3::identity() * 100.0 };
    let window = SearchWindow { distance_m: 0.6, angle_rad: 0.8 };

    measure("ray", || {
        passed_cells(Cell { x: 0, y: 0 }, black_box(Cell { x: 400, y: 170 })).for_each(|cell| {
            black_box(cell);
        });
    })?;
    let mut grid = OccupancyGrid::new(&MapConfig::default());
    let mut flips = Vec::new();
    measure("grid_scan", || {
        flips.clear();
        grid.add_scan(black_box(&guess), &body_scan, &mut flips);
    })?;
    measure("surfaces", || {
        black_box(SurfaceScan::new(black_box(&body_scan), &matcher));
    })?;
    measure("match_scan", || {
        black_box(match_scan(&map, &scan, black_box(&prior), &matcher));
    })?;
    measure("search", || {
        black_box(search(&map, &scan, black_box(&guess), window, 4));
    })?;
    let mut written = map.clone();
    measure("map_write", || written.add_scan(black_box(&guess), &scan))?;
    measure("map_carve", || written.carve(black_box(&guess), &scan))?;
    measure("map_copy", || {
        black_box(black_box(&map).clone());
    })?;
    Ok(())
}
