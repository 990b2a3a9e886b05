//! Simulated drives solved and compared with their truth.

#![allow(dead_code, reason = "each test uses its part of the outcome")]
#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use floorprint::config::Layer;
use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions};
use floorprint::loop_closure::{ClosureReport, Verdict};
use floorprint::odometry::Frames;
use floorprint::sensors::RobotConfig;
use floorprint::simulator::{Fault, SimulationConfig, World, simulate};
use floorprint::{Config, NoProfiler, Slam, SlamResult};
use std::fmt;

/// A scan of which less than this share lies on the map does not fit.
const MISFIT_INLIER_SHARE: f64 = 0.6;

/// A closure farther off the truth than this is wrong, metres and radians.
const WRONG_M: f64 = 0.2;
const WRONG_RAD: f64 = 0.05;

/// A solved drive.
pub struct Outcome {
    pub result: SlamResult,
    pub error: TrajectoryError,
    pub dead_reckoning: TrajectoryError,
    /// Distance of the last pose from the true one, metres.
    pub final_m: f64,
    /// How many of the closures that are in force put two places where they are not.
    pub wrong_closures: usize,
    /// When scan and odometry contradicted each other, seconds since the first scan.
    pub rejected_s: Vec<f64>,
    /// When a scan did not fit the map, seconds since the first scan.
    pub misfits_s: Vec<f64>,
    /// Distance from the truth at every scan: seconds since the first scan, metres.
    errors: Vec<(f64, f64)>,
}

impl Outcome {
    pub fn rejected_within(&self, from_s: f64, to_s: f64) -> usize {
        self.rejected_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
    }

    pub fn misfits_within(&self, from_s: f64, to_s: f64) -> usize {
        self.misfits_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
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
            "RMSE {:.4} m {:.3}°, largest {:.3} m, at the end {:.3} m; {} wrong closures; dead reckoning {:.3} m; rejected at {:.2?} s, misfits at {:.2?} s",
            self.error.translation_m.rmse,
            self.error.rotation_deg.rmse,
            self.error.translation_m.max,
            self.final_m,
            self.wrong_closures,
            self.dead_reckoning.translation_m.max,
            self.rejected_s,
            self.misfits_s
        )
    }
}

/// Drives through a world with 361 rays and ten scans a second and solves it with the defaults and `settings`.
pub fn solve(world: &str, seed: u64, faults: &[Fault], settings: &str) -> Outcome {
    solve_as(world, seed, SimulationConfig { faults: faults.to_vec(), ..quick() }, settings)
}

/// The course's robot with 361 rays, ten scans a second and no camera.
pub fn quick() -> SimulationConfig {
    let mut simulation = SimulationConfig::default();
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (361, 10.0, 0.0);
    simulation
}

/// Drives through a world as `simulation` has it and solves it with the defaults and `settings`.
pub fn solve_as(world: &str, seed: u64, simulation: SimulationConfig, settings: &str) -> Outcome {
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
    let truth_at = |frame: usize| drive.true_pose(result.trajectory[frame].stamp_s);
    let is_wrong = |closure: &&ClosureReport| {
        let [older, newer] = closure.frames.map(truth_at);
        let off = older.between(&newer).between(&closure.middle_from_middle);
        closure.verdict == Verdict::Accepted && (off.distance() > WRONG_M || off.theta.abs() > WRONG_RAD)
    };
    let wrong_closures = result.closures.iter().filter(is_wrong).count();
    let compare = |poses: &[_]| TrajectoryError::new(poses, &truth, &TrajectoryErrorOptions::default()).unwrap();
    let dead_reckoning: Vec<_> = frames.dead_reckoned_poses().collect();
    Outcome {
        error: compare(&result.trajectory),
        dead_reckoning: compare(&dead_reckoning),
        wrong_closures,
        final_m: errors.last().unwrap().1,
        rejected_s,
        misfits_s,
        errors,
        result,
    }
}
