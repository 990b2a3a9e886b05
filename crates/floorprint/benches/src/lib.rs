//! The kernels that a drive spends its time in, each on its own: ray tracing, normals, matching,
//! copying and writing of maps.

use floorprint::geometry::Pose2;
use floorprint::map::{Cell, MapConfig, OccupancyGrid, passed_cells};
use floorprint::surface::{SurfaceMap};
use floorprint::Frames;
use floorprint::scan_matcher::{MatcherConfig, PoseBelief, SearchWindow, match_scan, search};
use floorprint::surface::{SurfaceScan};
use floorprint::simulator::{SimulationConfig, World, simulate};
use floorprint::{BodyScan, Config};
use nalgebra::Matrix3;
use std::error::Error;
use std::hint::black_box;

/// Every kernel with its name.
pub const KERNELS: [(&str, fn(&mut Inputs)); 8] = [
    ("ray", Inputs::ray),
    ("grid_scan", Inputs::grid_scan),
    ("surfaces", Inputs::surfaces),
    ("match_scan", Inputs::match_scan),
    ("search", Inputs::search),
    ("map_write", Inputs::map_write),
    ("map_carve", Inputs::map_carve),
    ("map_copy", Inputs::map_copy),
];

/// What the kernels work on: a scan of 1081 rays in the simulated rooms, as the robot starts to move,
/// and maps in which it stands already.
pub struct Inputs {
    body_scan: BodyScan,
    matcher: MatcherConfig,
    scan: SurfaceScan,
    map: SurfaceMap,
    written: SurfaceMap,
    grid: OccupancyGrid,
    guess: Pose2,
}

impl Inputs {
    /// Simulates the scan and draws the maps.
    ///
    /// # Errors
    /// The simulation gives no scan.
    pub fn new() -> Result<Self, Box<dyn Error>> {
        let drive = simulate(World::named("rooms", 1)?, SimulationConfig::default(), 1)?;
        let records: Vec<_> = drive.stream().take(400).collect();
        let config = Config { robot: drive.config().robot.clone(), ..Config::default() };
        let frames = Frames::new(&records, &config)?;
        let body_scan = frames.iter().next().ok_or("the drive has no scan")?.scan;
        let matcher = MatcherConfig::default();
        let scan = SurfaceScan::new(&body_scan, &matcher.thinning());
        let mut map = SurfaceMap::new(matcher.cell_m);
        map.add_scan(&Pose2::IDENTITY, &scan);
        let written = map.clone();
        let grid = OccupancyGrid::new(&MapConfig::default());
        Ok(Self { body_scan, matcher, scan, map, written, grid, guess: Pose2::new(0.05, -0.03, 0.02) })
    }

    /// A ray of 20 m over the occupancy grid.
    pub fn ray(&mut self) {
        passed_cells(Cell { x: 0, y: 0 }, black_box(Cell { x: 400, y: 170 })).for_each(|cell| {
            black_box(cell);
        });
    }

    /// A scan into the occupancy grid.
    pub fn grid_scan(&mut self) {
        self.grid.add_scan(black_box(&self.guess), &self.body_scan, &mut Vec::new());
    }

    /// The surfaces and normals of a scan.
    pub fn surfaces(&mut self) {
        black_box(SurfaceScan::new(black_box(&self.body_scan), &self.matcher.thinning()));
    }

    /// A scan matched to the map, from 6 cm and 1° off.
    pub fn match_scan(&mut self) {
        let prior = PoseBelief { pose: self.guess, information: Matrix3::identity() * 100.0 };
        black_box(match_scan(&self.map, &self.scan, black_box(&prior), &self.matcher));
    }

    /// A scan searched within 0.6 m and 0.8 rad.
    pub fn search(&mut self) {
        let window = SearchWindow { distance_m: 0.6, angle_rad: 0.8 };
        black_box(search(&self.map, &self.scan, black_box(&self.guess), window, 4));
    }

    /// A scan into the surface map.
    pub fn map_write(&mut self) {
        self.written.add_scan(black_box(&self.guess), &self.scan);
    }

    /// What a scan sees through, out of the surface map.
    pub fn map_carve(&mut self) {
        self.written.carve(black_box(&self.guess), &self.scan);
    }

    /// A copy of the surface map, as for a particle.
    pub fn map_copy(&mut self) {
        black_box(black_box(&self.map).clone());
    }
}
