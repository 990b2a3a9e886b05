//! Simulated drives solved and compared with their truth.

#![allow(dead_code, reason = "each test uses its part of the outcome")]
#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use floorprint::config::Layer;
use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions};
use floorprint::loop_closure::Verdict;
use floorprint::odometry::Frames;
use floorprint::sensors::RobotConfig;
use floorprint::simulator::{Fault, SimulationConfig, World, simulate};
use floorprint::{Config, NoProfiler, Slam, SlamResult};
use std::fmt;

/// A scan of which less than this share lies on the map does not fit.
const MISFIT_INLIER_SHARE: f64 = 0.6;

/// A solved drive.
pub struct Outcome {
    pub result: SlamResult,
    pub error: TrajectoryError,
    pub dead_reckoning: TrajectoryError,
    /// Distance of the last pose from the true one, metres.
    pub final_m: f64,
    /// When scan and odometry contradicted each other, seconds since the first scan.
    pub rejected_s: Vec<f64>,
    /// When a scan did not fit the map, seconds since the first scan.
    pub misfits_s: Vec<f64>,
    /// Distance from the truth at every scan: seconds since the first scan, metres.
    errors: Vec<(f64, f64)>,
    /// How far each closure in force is off: metres, radians.
    pub closure_errors: Vec<(f64, f64)>,
}

impl Outcome {
    pub fn rejected_within(&self, from_s: f64, to_s: f64) -> usize {
        self.rejected_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
    }

    pub fn misfits_within(&self, from_s: f64, to_s: f64) -> usize {
        self.misfits_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
    }

    /// How far the worst closure in force is off: metres, radians, each by itself.
    pub fn worst_closure(&self) -> (f64, f64) {
        self.closure_errors.iter().fold((0.0, 0.0), |worst, error| (worst.0.max(error.0), worst.1.max(error.1)))
    }

    /// The largest error up to a time, metres.
    pub fn error_until(&self, time_s: f64) -> f64 {
        self.errors.iter().filter(|(at_s, _)| *at_s < time_s).map(|(_, error_m)| *error_m).fold(0.0, f64::max)
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "RMSE {:.4} m {:.3}°, largest {:.3} m, at the end {:.3} m; dead reckoning {:.3} m; {} closures, off by up to {:.3?} m, rad; rejected at {:.2?} s, misfits at {:.2?} s",
            self.error.translation_m.rmse,
            self.error.rotation_deg.rmse,
            self.error.translation_m.max,
            self.final_m,
            self.dead_reckoning.translation_m.max,
            self.closure_errors.len(),
            self.worst_closure(),
            self.rejected_s,
            self.misfits_s
        )
    }
}

/// Drives through a world with 361 rays and ten scans a second and solves it with the defaults and `settings`.
pub fn solve(world: &str, seed: u64, faults: &[Fault], settings: &str) -> Outcome {
    let mut simulation = SimulationConfig { faults: faults.to_vec(), ..SimulationConfig::default() };
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (361, 10.0, 0.0);
    solve_simulated(world, seed, simulation, settings)
}

/// Drives through a world with the sensors of the old robots of the benchmarks and solves it with the defaults.
pub fn solve_sparse(world: &str, seed: u64) -> Outcome {
    solve_simulated(world, seed, SimulationConfig::default().with_sparse_lidar(), "")
}

fn solve_simulated(world: &str, seed: u64, simulation: SimulationConfig, settings: &str) -> Outcome {
    let drive = simulate(World::named(world, seed).unwrap(), simulation, seed).unwrap();
    let layers = [Layer::from_robot(&RobotConfig::ece276a()), Layer::from_toml("settings", settings).unwrap()];
    let config = Config::resolve(&layers).unwrap();
    let records = drive.records();
    let frames = Frames::new(&records, &config).unwrap();
    let truth = drive.truth();

    let mut slam = Slam::new(&config);
    let (mut rejected_s, mut misfits_s) = (Vec::new(), Vec::new());
    for frame in frames.iter() {
        let step = slam.process(&frame, &mut NoProfiler).unwrap().filter;
        let time_s = frame.stamp_s - truth[0].stamp_s;
        if step.odometry_rejected {
            rejected_s.push(time_s);
        }
        if step.inlier_share < MISFIT_INLIER_SHARE {
            misfits_s.push(time_s);
        }
    }
    let result = slam.finish(|| frames.iter(), &mut NoProfiler);
    let errors: Vec<(f64, f64)> = result
        .trajectory
        .iter()
        .map(|pose| (pose.stamp_s - truth[0].stamp_s, drive.true_pose(pose.stamp_s).between(&pose.pose).distance()))
        .collect();
    let compare = |poses: &[_]| TrajectoryError::new(poses, &truth, &TrajectoryErrorOptions::default()).unwrap();
    let dead_reckoning: Vec<_> = frames.dead_reckoned_poses().collect();
    let in_force = result.closures.iter().filter(|closure| closure.verdict == Verdict::Accepted);
    let closure_errors = in_force
        .map(|closure| {
            let [older, newer] = closure.frames.map(|frame| drive.true_pose(result.trajectory[frame].stamp_s));
            let error = older.between(&newer).between(&closure.middle_from_middle);
            (error.distance(), error.theta.abs())
        })
        .collect();
    Outcome {
        error: compare(&result.trajectory),
        dead_reckoning: compare(&dead_reckoning),
        final_m: errors.last().unwrap().1,
        rejected_s,
        misfits_s,
        errors,
        closure_errors,
        result,
    }
}
