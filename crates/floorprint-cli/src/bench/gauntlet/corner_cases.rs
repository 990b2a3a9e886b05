//! Drives at the corners of what a robot may meet: sparse and short-sighted LiDARs, noise, wrong wheels, kidnappings where
//! places look alike. Each is right, or says that it is not.
//!
//! `cargo test` drives some that take seconds. `FLOORPRINT_CORNERS=all` drives all 249, which takes long and shows what is still
//! silently wrong (BENCHMARK.md); a part of a name, those that have it:
//! `FLOORPRINT_CORNERS="pillars Range" cargo test -p floorprint-cli --lib corner_cases -- --nocapture`.

use super::drive::{Row, solve};
use super::judgement::Verdict;
use crate::config::Settings;
use floorprint::simulator::{Fault, Scenario, SimulationConfig, World, simulate};
use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// What is out of the ordinary on a drive.
#[derive(Debug, Clone, Copy)]
enum Corner {
    /// So many scans a second.
    RateHz(f64),
    /// 16 rays.
    FewRays,
    /// A LiDAR that sees 60°, 20 m far.
    NarrowView,
    /// A LiDAR that sees so far, metres.
    RangeM(f64),
    /// Ranges with a noise of so many metres.
    NoiseM(f64),
    /// Wheels that are off by this share (standard deviation).
    WheelsOff(f64),
    /// A gyro's bias, rad/s.
    GyroBias(f64),
    /// The robot is set down so far along its way, metres, half-way through the drive.
    Kidnapped(f64),
    /// From this share of the drive on the wheels turn too far for so many seconds, by so large a share.
    Slip(f64, f64, f64),
}

const KIDNAPPED: [Corner; 4] =
    [Corner::Kidnapped(2.0), Corner::Kidnapped(5.0), Corner::Kidnapped(20.0), Corner::Kidnapped(-20.0)];
const SLOW: [Corner; 4] = [Corner::RateHz(0.7), Corner::RateHz(1.0), Corner::RateHz(1.5), Corner::RateHz(2.0)];
const SEES_LITTLE: [Corner; 5] =
    [Corner::FewRays, Corner::NarrowView, Corner::RangeM(2.0), Corner::RangeM(3.0), Corner::RangeM(5.0)];
const NOISY: [Corner; 3] = [Corner::NoiseM(0.05), Corner::NoiseM(0.1), Corner::NoiseM(0.2)];
const WHEELS_OFF: [Corner; 3] = [Corner::WheelsOff(0.05), Corner::WheelsOff(0.1), Corner::WheelsOff(0.3)];
const BIASED: [Corner; 2] = [Corner::GyroBias(0.05), Corner::GyroBias(0.2)];
const SLIPS: [Corner; 5] = [
    Corner::Slip(0.3, 20.0, 1.0),
    Corner::Slip(0.5, 20.0, 1.0),
    Corner::Slip(0.7, 20.0, 1.0),
    Corner::Slip(0.4, 20.0, 0.3),
    Corner::Slip(0.4, 60.0, 1.0),
];

/// Where which corners are driven, three times each.
const MATRIX: [(&[&str], &[Corner]); 7] = [
    (&["corridors", "figure_of_eight", "glass", "identical_rooms", "large_hall", "pillars", "rooms"], &SLOW),
    (&["figure_of_eight", "large_hall", "main_building", "pillars"], &SEES_LITTLE),
    (&["five_corridors", "identical_rooms", "look_alike", "main_building"], &KIDNAPPED),
    (&["figure_of_eight", "rooms"], &NOISY),
    (&["figure_of_eight", "rooms"], &WHEELS_OFF),
    (&["figure_of_eight"], &BIASED),
    (&["figure_of_eight"], &SLIPS),
];

/// Cases of every kind that take a second or two.
const QUICK: [&str; 31] = [
    "figure_of_eight RateHz(0.7) 1",
    "corridors RateHz(0.7) 1",
    "glass RateHz(0.7) 1",
    "identical_rooms RateHz(0.7) 1",
    "large_hall RateHz(0.7) 1",
    "pillars RateHz(0.7) 1",
    "rooms RateHz(0.7) 1",
    "figure_of_eight RateHz(2.0) 1",
    "corridors RateHz(2.0) 1",
    "glass RateHz(2.0) 1",
    "identical_rooms RateHz(2.0) 1",
    "pillars RateHz(2.0) 1",
    "rooms RateHz(2.0) 1",
    "figure_of_eight NarrowView 1",
    "figure_of_eight RangeM(2.0) 1",
    "figure_of_eight RangeM(3.0) 3",
    "figure_of_eight RangeM(5.0) 1",
    "pillars FewRays 1",
    "pillars NarrowView 1",
    "pillars RangeM(2.0) 1",
    "pillars RangeM(3.0) 1",
    "pillars RangeM(5.0) 1",
    "look_alike Kidnapped(20.0) 1",
    "figure_of_eight NoiseM(0.05) 1",
    "rooms NoiseM(0.05) 1",
    "figure_of_eight WheelsOff(0.1) 1",
    "figure_of_eight WheelsOff(0.3) 1",
    "rooms WheelsOff(0.3) 2",
    "figure_of_eight GyroBias(0.2) 1",
    "figure_of_eight Slip(0.5, 20.0, 1.0) 1",
    "figure_of_eight Slip(0.4, 20.0, 0.3) 1",
];

/// A drive of the matrix.
struct Case {
    world: &'static str,
    corner: Corner,
    seed: u64,
}

impl Case {
    fn all() -> Vec<Self> {
        let kinds = MATRIX.iter().flat_map(|(worlds, corners)| {
            worlds.iter().flat_map(|&world| corners.iter().map(move |&corner| (world, corner)))
        });
        kinds.flat_map(|(world, corner)| (1..=3).map(move |seed| Self { world, corner, seed })).collect()
    }

    /// Such as `pillars RangeM(3.0) 1`.
    fn name(&self) -> String {
        format!("{} {:?} {}", self.world, self.corner, self.seed)
    }

    /// The course's robot with a LiDAR of 180 rays over 180°, five scans a second, that sees 80 m, but for the corner.
    fn scenario(&self) -> Scenario {
        let mut config = SimulationConfig::default();
        config.camera.rate_hz = 0.0;
        let lidar = &mut config.lidar;
        (lidar.beams, lidar.field_of_view_rad, lidar.rate_hz, lidar.range_max_m) = (180, PI, 5.0, 80.0);
        let world = World::named(self.world, self.seed).unwrap();
        match self.corner {
            Corner::RateHz(rate_hz) => lidar.rate_hz = rate_hz,
            Corner::FewRays => (lidar.beams, lidar.field_of_view_rad) = (16, 1.5 * PI),
            Corner::NarrowView => (lidar.beams, lidar.field_of_view_rad, lidar.range_max_m) = (61, PI / 3.0, 20.0),
            Corner::RangeM(range_max_m) => lidar.range_max_m = range_max_m,
            Corner::NoiseM(noise_m) => (lidar.near_noise_m, lidar.far_noise_m) = (noise_m, noise_m),
            Corner::WheelsOff(share) => config.wheels.scale_error = share,
            Corner::GyroBias(bias_rad_s) => config.imu.gyro_bias_rad_s = bias_rad_s,
            Corner::Kidnapped(_) | Corner::Slip(..) => {}
        }
        let duration_s = simulate(world.clone(), config.clone(), self.seed).unwrap().duration_s();
        config.faults = match self.corner {
            Corner::Kidnapped(ahead_m) => vec![Fault::Kidnapping { at_s: (0.5 * duration_s).round(), ahead_m }],
            Corner::Slip(from, for_s, share) => {
                vec![Fault::WheelSlip { from_s: (from * duration_s).round(), for_s, share }]
            }
            _ => Vec::new(),
        };
        let fault_kind = self.name();
        Scenario { seed: self.seed, world_kind: self.world, base: "course", lidar: "sparse", fault_kind, world, config }
    }

    fn row(&self) -> Row {
        solve(self.scenario(), &Settings::default()).unwrap().row
    }
}

/// Drives the cases, as many at a time as there are cores, and says how each went.
fn rows(cases: &[Case]) -> Vec<Row> {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut rows = Vec::new();
        while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
            let row = case.row();
            println!(
                "{}: {}, claimed {:.2} m, in the end {:.2} m, odometry {:.2} m; lost {:.0} %, vague {:.0} %; {:.2} s",
                row.fault,
                row.outcome.name(),
                row.claimed_max_m(),
                row.result.max_m,
                row.odometry_max_m,
                100.0 * row.result.lost_share,
                100.0 * row.result.vague_share,
                row.cpu_s
            );
            rows.push(row);
        }
        rows
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    })
}

#[test]
fn corner_cases_are_right_or_say_so() {
    let wanted = std::env::var("FLOORPRINT_CORNERS").ok();
    let mut cases = Case::all();
    assert_eq!(cases.len(), 249);
    cases.retain(|case| match wanted.as_deref() {
        None => QUICK.contains(&case.name().as_str()),
        Some("all") => true,
        Some(part) => case.name().contains(part),
    });
    assert!(wanted.is_some() || cases.len() == QUICK.len(), "each of them is there");
    assert!(!cases.is_empty(), "no such case");
    let rows = rows(&cases);
    let wrong: Vec<&str> =
        rows.iter().filter(|row| row.outcome == Verdict::SilentlyWrong).map(|row| row.fault.as_str()).collect();
    assert!(wrong.is_empty(), "{} of {} are silently wrong: {wrong:#?}", wrong.len(), rows.len());
}
