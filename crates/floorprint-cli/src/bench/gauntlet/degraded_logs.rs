//! Real logs made worse: fewer scans, fewer rays, noise, odometry that is wrong or missing, gaps. What comes out is near to what
//! the whole log gives, or said not to be.
//!
//! `cargo test` degrades one log in some ways; `FLOORPRINT_LOGS=all` all three in all of them, which shows what is still silently
//! wrong (BENCHMARK.md).

use super::drive::Followed;
use super::judgement::{Claim, Judgement, Verdict};
use floorprint::Config;
use floorprint::config::Layer;
use floorprint::geometry::Pose2;
use floorprint::sensors::Scan;
use floorprint_io::{DataSet, OpenOptions, open};
use std::fmt::Write as _;
use std::path::Path;

#[path = "../../../../floorprint-io/tests/data_folder/mod.rs"]
mod data_folder;

/// How a log is made worse.
#[derive(Debug, Clone, Copy)]
enum Damage {
    /// One of so many scans is kept.
    KeepOneOf(usize),
    /// One of so many scans is missing.
    DropOneOf(usize),
    /// From every second ray, at random, nothing comes back.
    RaysLost,
    /// Every other ray is not there.
    EveryOtherRay,
    /// Noise of so many metres.
    NoiseM(f64),
    /// Odometry whose lengths are so many times too long.
    OdometryTimes(f64),
    /// Odometry that never turns.
    OdometryWithoutTurns,
    /// No odometry.
    NoOdometry,
    /// Twenty seconds without scans at these shares of the drive.
    Gaps(&'static [f64]),
    /// The odometry jumps by 7 m half-way through.
    OdometryJumps,
}

const DAMAGES: [Damage; 15] = [
    Damage::KeepOneOf(3),
    Damage::KeepOneOf(5),
    Damage::KeepOneOf(10),
    Damage::DropOneOf(10),
    Damage::RaysLost,
    Damage::EveryOtherRay,
    Damage::NoiseM(0.05),
    Damage::NoiseM(0.2),
    Damage::OdometryTimes(1.1),
    Damage::OdometryTimes(1.3),
    Damage::OdometryWithoutTurns,
    Damage::NoOdometry,
    Damage::Gaps(&[0.5]),
    Damage::Gaps(&[0.1, 0.3, 0.5, 0.7, 0.9]),
    Damage::OdometryJumps,
];

/// Those that `cargo test` looks at, of mit-csail.
const QUICK: [Damage; 8] = [
    Damage::KeepOneOf(3),
    Damage::DropOneOf(10),
    Damage::RaysLost,
    Damage::EveryOtherRay,
    Damage::OdometryTimes(1.1),
    Damage::OdometryTimes(1.3),
    Damage::NoOdometry,
    Damage::OdometryJumps,
];

/// Numbers that look drawn at random, from 0 to 1.
struct Scattered(u64);

impl Scattered {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1_u32 << 31)
    }

    /// Close enough to a Gaussian of standard deviation 1.
    fn next_gaussian(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() - 6.0
    }
}

impl Damage {
    /// The log as CARMEN's text, and the numbers of the scans that are left.
    fn text(self, scans: &[&Scan]) -> (String, Vec<usize>) {
        let (first_s, last_s) = scans
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(first, last), scan| (first.min(scan.stamp_s), last.max(scan.stamp_s)));
        let mut scattered = Scattered(7);
        let (mut text, mut left) = (String::new(), Vec::new());
        let (mut before, mut straight) = (None::<Pose2>, [0.0, 0.0]);
        for (number, scan) in scans.iter().enumerate() {
            let odometry = scan.odometry.unwrap();
            let step = before.replace(odometry).unwrap_or(odometry).between(&odometry);
            (straight[0], straight[1]) = (straight[0] + step.x, straight[1] + step.y);
            let is_missing = match self {
                Self::KeepOneOf(count) => (number + 1) % count != 0,
                Self::DropOneOf(count) => (number + 1) % count == 0,
                Self::Gaps(shares) => {
                    shares.iter().any(|share| (scan.stamp_s - first_s - share * (last_s - first_s)).abs() < 10.0)
                }
                _ => false,
            };
            if is_missing {
                continue;
            }
            let mark_m = f64::from(scan.geometry.range_max_m);
            let mut ranges_m: Vec<f64> = scan.ranges_m.iter().map(|&range_m| f64::from(range_m)).collect();
            match self {
                Self::RaysLost => ranges_m.iter_mut().for_each(|range_m| {
                    if scattered.next() < 0.5 {
                        *range_m = mark_m;
                    }
                }),
                Self::EveryOtherRay => ranges_m = ranges_m.into_iter().step_by(2).collect(),
                Self::NoiseM(noise_m) => ranges_m.iter_mut().for_each(|range_m| {
                    if *range_m < mark_m - 0.5 {
                        *range_m = (*range_m + noise_m * scattered.next_gaussian()).max(0.05);
                    }
                }),
                _ => {}
            }
            let Pose2 { x, y, theta } = odometry;
            let [x, y, theta] = match self {
                Self::OdometryTimes(times) => [times * x, times * y, theta],
                Self::OdometryWithoutTurns => [straight[0], straight[1], 0.0],
                Self::NoOdometry => [0.0; 3],
                Self::OdometryJumps if number > scans.len() / 2 => [x + 5.0, y + 5.0, theta],
                _ => [x, y, theta],
            };
            let _ = write!(text, "FLASER {}", ranges_m.len());
            for range_m in ranges_m {
                let _ = write!(text, " {range_m:.2}");
            }
            let pose = format!("{x:.6} {y:.6} {theta:.6}");
            let stamp_s = scan.stamp_s;
            let _ = writeln!(text, " {pose} {pose} {stamp_s:.6} host {stamp_s:.6}");
            left.push(number);
        }
        (text, left)
    }
}

fn read(path: &Path) -> DataSet {
    open(path, &OpenOptions::default()).unwrap()
}

fn followed(log: &DataSet) -> Followed {
    let config = Config::resolve(&[Layer::from_robot(&log.robot)]).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| Followed::new(&log.records, &config)).unwrap()
}

#[test]
fn degraded_logs_are_right_or_say_so() {
    let Some(data) = data_folder::data() else { return };
    let is_thorough = std::env::var_os("FLOORPRINT_LOGS").is_some();
    let names: &[&str] = if is_thorough { &["intel", "aces", "mit-csail"] } else { &["mit-csail"] };
    let damages: &[Damage] = if is_thorough { &DAMAGES } else { &QUICK };
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = Vec::new();
    for name in names {
        let path = data.join(format!("relations/{name}/{name}.clf.gz"));
        let log = read(&path);
        let whole = followed(&log);
        let scans: Vec<&Scan> = log.scans().collect();
        for &damage in damages {
            let (text, left) = damage.text(&scans);
            let path = folder.path().join("degraded.clf");
            std::fs::write(&path, text).unwrap();
            let degraded = followed(&read(&path));
            let judge = |claims: &[Claim]| {
                let truth = degraded.taken.iter().map(|&taken| left[taken]);
                let truth: Vec<_> =
                    truth.map(|number| (scans[number].stamp_s, whole.result.trajectory[number].pose)).collect();
                let start = truth[0].1;
                Judgement::new(
                    claims.iter().zip(&truth).map(|(claim, (stamp_s, pose))| (claim, *stamp_s, start.between(pose))),
                )
            };
            let (live, result) = (judge(&degraded.live), judge(&Claim::of_result(&degraded.result)));
            let verdict = Verdict::of(&live, &result);
            println!(
                "{name} {damage:?}: {}, {:.2} m ({:.2} m live), lost {:.0} %, vague {:.0} %",
                verdict.name(),
                result.claimed_max_m,
                live.claimed_max_m,
                100.0 * result.lost_share,
                100.0 * result.vague_share
            );
            if verdict == Verdict::SilentlyWrong {
                wrong.push(format!("{name} {damage:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "silently wrong: {wrong:?}");
}
