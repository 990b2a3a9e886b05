//! The figures of one run, whatever it ran on.

use crate::stopwatch::ScanCost;
use floorprint::geometry::{Pose2, wrap_angle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// An accepted closure farther off the truth than this is wrong, metres …
const WRONG_M: f64 = 0.2;
/// … or radians.
const WRONG_RAD: f64 = 0.05;

/// One run. What is not known or was not measured is null.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
pub(super) struct Run {
    /// Seed of the filter's random draws; of a simulated world also that of the world and of the drive.
    pub(super) seed: u64,
    /// Translation error, metres: the mean over the benchmark's relations where there are any, else
    /// the RMSE against the true trajectory, without alignment.
    pub(super) translation_m: Option<f64>,
    /// The same for rotation, degrees.
    pub(super) rotation_deg: Option<f64>,
    /// Largest translation error, metres.
    pub(super) largest_m: Option<f64>,
    /// RMSE of the motion over windows of 4 s, metres (worlds in which the robot keeps to a command only).
    pub(super) windowed_m: Option<f64>,
    /// Largest heading error less the smallest, degrees (worlds in which the robot keeps to a command only).
    pub(super) yaw_spread_deg: Option<f64>,
    /// Translation error of the last pose, metres (simulated worlds only).
    pub(super) end_m: Option<f64>,
    /// Rotation error of the last pose, degrees (simulated worlds only).
    pub(super) end_deg: Option<f64>,
    /// What `translation_m` is for dead reckoning.
    pub(super) odometry_m: Option<f64>,
    /// Loop closures in force at the end.
    pub(super) closures: Option<usize>,
    /// Those among them that are off the true relative pose by more than 0.2 m or 0.05 rad.
    pub(super) wrong_closures: Option<usize>,
    /// F1 of occupied cells against the true map.
    pub(super) map_f1: Option<f64>,
    /// Share of wall cells with a second wall close by.
    pub(super) doubled_share: Option<f64>,
    /// Scans that became poses.
    pub(super) scans: usize,
    /// Length of the drive, seconds.
    pub(super) duration_s: f64,
    /// Length of the estimated path, metres.
    pub(super) length_m: f64,
    /// CPU time, seconds: of a data set that of the whole process, of a simulated world that of
    /// dead reckoning, filter and loop closure, without the simulation.
    pub(super) cpu_s: Option<f64>,
    /// Wall time of the same, seconds; of a simulated world its CPU time.
    pub(super) wall_s: f64,
    /// Time of a scan, live, milliseconds: of a data set wall time, of a simulated world CPU time.
    pub(super) scan_ms: Option<ScanCost>,
    /// The same for the end of the drive, from the last scan to the final map, seconds.
    pub(super) finish_s: Option<f64>,
    /// Most memory held, bytes: of a data set by the whole process, of a simulated world beyond what
    /// the simulation holds.
    pub(super) peak_memory_bytes: Option<u64>,
}

impl Run {
    /// Seconds of drive per second of work.
    pub(super) fn real_time_factor(&self) -> Option<f64> {
        (self.wall_s > 0.0).then(|| self.duration_s / self.wall_s)
    }

    /// What `report.json` says of a run.
    pub(super) fn from_report(report: &Value) -> Self {
        let number = |pointer: &str| report.pointer(pointer).and_then(Value::as_f64);
        let count = |pointer: &str| report.pointer(pointer).and_then(Value::as_u64);
        let either = |relations: &str, trajectory: &str| number(relations).or_else(|| number(trajectory));
        Self {
            seed: count("/seed").unwrap_or(0),
            translation_m: either("/errors/relations/all/translation_m/mean", "/errors/trajectory/translation_m/rmse"),
            rotation_deg: either("/errors/relations/all/rotation_deg/mean", "/errors/trajectory/rotation_deg/rmse"),
            largest_m: either("/errors/relations/all/translation_m/max", "/errors/trajectory/translation_m/max"),
            odometry_m: either(
                "/errors/odometry_relations/all/translation_m/mean",
                "/errors/odometry/translation_m/rmse",
            ),
            closures: report.pointer("/loops/candidates").map(|candidates| accepted(candidates).count()),
            map_f1: number("/errors/map/f1"),
            doubled_share: number("/map/walls/doubled_share"),
            scans: count("/drive/poses").unwrap_or(0) as usize,
            duration_s: number("/drive/duration_s").unwrap_or(0.0),
            length_m: number("/drive/length_m").unwrap_or(0.0),
            cpu_s: number("/cost/cpu_s"),
            wall_s: number("/cost/wall_s").unwrap_or(0.0),
            scan_ms: report.pointer("/cost/scan_ms").and_then(|cost| serde_json::from_value(cost.clone()).ok()),
            finish_s: number("/cost/finish_s"),
            peak_memory_bytes: count("/cost/peak_memory_bytes"),
            ..Self::default()
        }
    }
}

/// The candidates, as in `report.json`, that are tied together at the end.
pub(super) fn accepted(candidates: &Value) -> impl Iterator<Item = &Value> {
    candidates.as_array().into_iter().flatten().filter(|candidate| candidate["verdict"] == "accepted")
}

/// How many accepted candidates are off the truth; `None` when they do not say where they put the newer
/// place, or the truth is not known there.
pub(super) fn count_wrong(candidates: &Value, true_pose: impl Fn(f64) -> Option<Pose2>) -> Option<usize> {
    let is_wrong = |candidate: &Value| {
        let number = |value: &Value| value.as_f64();
        let pose = &candidate["middle_from_middle"];
        let found = Pose2::new(number(&pose["x"])?, number(&pose["y"])?, number(&pose["theta"])?);
        let [older, newer] = [0, 1].map(|place| number(&candidate["stamps_s"][place]).and_then(&true_pose));
        let off = older?.between(&newer?).between(&found);
        Some(off.distance() > WRONG_M || wrap_angle(off.theta).abs() > WRONG_RAD)
    };
    accepted(candidates).map(is_wrong).try_fold(0, |wrong, is_wrong| Some(wrong + usize::from(is_wrong?)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn closures_off_the_truth_are_counted() {
        let candidate = |x: f64, theta: f64, verdict: &str| json!({"stamps_s": [1.0, 5.0], "verdict": verdict, "middle_from_middle": {"x": x, "y": 0.0, "theta": theta}});
        let candidates = json!([
            candidate(4.1, 0.0, "accepted"),
            candidate(4.3, 0.0, "accepted"),
            candidate(4.0, 0.1, "accepted"),
            candidate(9.0, 0.0, "does_not_fit"),
        ]);
        let along_x = |stamp_s: f64| Some(Pose2::new(stamp_s, 0.0, 0.0));
        assert_eq!(count_wrong(&candidates, along_x), Some(2));
        assert_eq!(count_wrong(&json!([]), along_x), Some(0));
        let silent = json!([{"stamps_s": [1.0, 5.0], "verdict": "accepted"}]);
        assert_eq!(count_wrong(&silent, along_x), None);
    }
}
