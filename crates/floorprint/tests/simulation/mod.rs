//! Simulated drives solved and compared with their truth.

#![allow(dead_code, reason = "each test uses its part of the outcome")]
#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use floorprint::Frames;
use floorprint::back_end::{ClosureReport, Verdict};
use floorprint::config::Layer;
use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions};
use floorprint::sensors::RobotConfig;
use floorprint::simulator::{Fault, SimulationConfig, World, simulate};
use floorprint::{Config, Slam, SlamResult};
use std::fmt;

/// A scan of which less than this share lies on the map does not fit.
const MISFIT_INLIER_SHARE: f64 = 0.6;

/// A closure farther off the truth than this is wrong, metres and radians.
const WRONG_M: f64 = 0.2;
const WRONG_RAD: f64 = 0.05;

/// From one scan to the next the robot moves less than this unless it is carried, metres.
const CARRIED_M: f64 = 0.5;

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
    /// What was said of each scan when it came.
    pub live: Vec<Live>,
}

/// What was said of a scan when it came.
pub struct Live {
    /// Seconds since the first scan.
    pub time_s: f64,
    /// How far the robot had driven, metres; being carried does not count.
    pub driven_m: f64,
    /// Distance of the pose from the true one, metres.
    pub error_m: f64,
    pub is_lost: bool,
}

impl Outcome {
    pub fn rejected_within(&self, from_s: f64, to_s: f64) -> usize {
        self.rejected_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
    }

    pub fn misfits_within(&self, from_s: f64, to_s: f64) -> usize {
        self.misfits_s.iter().filter(|time_s| (from_s..to_s).contains(*time_s)).count()
    }

    /// When the robot was found to have been carried elsewhere, seconds since the first scan.
    pub fn kidnapped_s(&self) -> Vec<f64> {
        self.result.kidnappings.iter().map(|kidnapping| self.errors[kidnapping.frame].0).collect()
    }

    /// How far the robot drove after a time until its live pose was right for good, metres; infinite if it never was.
    pub fn driven_until_right_m(&self, after_s: f64, tolerance_m: f64) -> f64 {
        let start = self.live.partition_point(|live| live.time_s < after_s);
        match self.live[start..].iter().rposition(|live| live.error_m > tolerance_m) {
            None => 0.0,
            Some(wrong) => self
                .live
                .get(start + wrong + 1)
                .map_or(f64::INFINITY, |right| right.driven_m - self.live[start].driven_m),
        }
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
            "RMSE {:.4} m {:.3}°, largest {:.3} m, at the end {:.3} m; {} wrong closures; dead reckoning {:.3} m; rejected at {:.2?} s, misfits at {:.2?} s, carried at {:.2?} s: {:?}",
            self.error.translation_m.rmse,
            self.error.rotation_deg.rmse,
            self.error.translation_m.max,
            self.final_m,
            self.wrong_closures,
            self.dead_reckoning.translation_m.max,
            self.rejected_s,
            self.misfits_s,
            self.kidnapped_s(),
            self.result.kidnappings
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
    let (mut rejected_s, mut misfits_s, mut live) = (Vec::new(), Vec::new(), Vec::<Live>::new());
    let (mut driven_m, mut before) = (0.0, drive.true_pose(truth[0].stamp_s));
    for frame in frames.iter() {
        let report = slam.process(&frame).unwrap();
        let (step, true_pose) = (report.filter, drive.true_pose(frame.stamp_s));
        let time_s = frame.stamp_s - truth[0].stamp_s;
        let moved_m = before.between(&true_pose).distance();
        driven_m += if moved_m < CARRIED_M { moved_m } else { 0.0 };
        before = true_pose;
        let error_m = true_pose.between(&report.pose).distance();
        live.push(Live { time_s, driven_m, error_m, is_lost: report.is_lost });
        if step.odometry_rejected {
            rejected_s.push(time_s);
        }
        if step.inlier_share < MISFIT_INLIER_SHARE {
            misfits_s.push(time_s);
        }
    }
    let result = slam.finish();
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
    let dead_reckoning: Vec<_> = frames.dead_reckoned_poses();
    Outcome {
        error: compare(&result.trajectory),
        dead_reckoning: compare(&dead_reckoning),
        wrong_closures,
        final_m: errors.last().unwrap().1,
        rejected_s,
        misfits_s,
        errors,
        live,
        result,
    }
}
