//! One drive of the gauntlet: simulated, solved and judged.

use super::super::drives::{Surroundings, limit_cpu_time};
use super::judgement::{Claim, Judgement, Verdict};
use super::picture::Picture;
use crate::config::Settings;
use crate::figure::{DEAD_RECKONING, Figure, TRAJECTORY};
use crate::outcome::Outcome;
use crate::stopwatch::fine_cpu_time_s;
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::Args;
use clap::builder::PossibleValuesParser;
use floorprint::Frames;
use floorprint::evaluation::PoseError;
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, StampedPose};
use floorprint::simulator::{Fault, Scenario, SimulatedDrive};
use floorprint::{Config, Slam, SlamResult};
use floorprint_io::{write_file, write_map, write_png, write_trajectory};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;

/// A kidnapping that is reported within this time of a true one is right, seconds.
const KIDNAPPED_WITHIN_S: f64 = 10.0;

/// Solve one drive of the gauntlet and print its row as JSON.
#[derive(Args)]
pub(crate) struct Arguments {
    /// The drive's seed.
    drive: u64,
    /// Let nothing but this go wrong.
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(Scenario::FAULT_KINDS))]
    fault: Option<String>,
    /// CPU time after which the system ends it, seconds.
    #[arg(long, default_value_t = 300)]
    cpu_limit: u32,
    #[command(flatten)]
    settings: Settings,
}

/// What is said of a drive.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Row {
    /// Its seed, by which it can be run alone.
    pub(super) seed: u64,
    /// The kind of world.
    pub(super) world: String,
    /// How the robot drives and what it tells of that.
    pub(super) base: String,
    /// The LiDAR.
    pub(super) lidar: String,
    /// Rays of a scan.
    pub(super) beams: usize,
    /// Scans a second.
    pub(super) rate_hz: f64,
    /// Angle from the first ray to the last, degrees.
    pub(super) field_of_view_deg: f64,
    /// What goes wrong.
    pub(super) fault: String,
    /// Length of the drive, seconds.
    pub(super) duration_s: f64,
    /// Length of its route, metres.
    pub(super) length_m: f64,
    /// What it amounts to.
    pub(super) outcome: Verdict,
    /// Why there is no result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) failure: Option<String>,
    /// What was claimed live.
    pub(super) live: Judgement,
    /// What is claimed in the end.
    pub(super) result: Judgement,
    /// Largest error of the odometry, metres, and its RMSE.
    pub(super) odometry_max_m: f64,
    pub(super) odometry_rmse_m: f64,
    /// CPU time without that of the simulation, seconds.
    pub(super) cpu_s: f64,
    /// That of the end, from the last scan on, seconds.
    pub(super) finish_s: f64,
    /// CPU time of the longest step, milliseconds.
    pub(super) largest_step_ms: f64,
    /// How often the robot was kidnapped.
    pub(super) kidnapped: usize,
    /// How often that was noticed, and how often it was reported though nothing had happened.
    pub(super) kidnappings_noticed: usize,
    pub(super) false_kidnappings: usize,
}

/// A drive's row, and its picture where it is not right.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Answer {
    pub(super) row: Row,
    pub(super) picture: Option<String>,
}

/// A drive that was solved.
pub(super) struct Solved {
    scenario: Scenario,
    drive: SimulatedDrive,
    result: SlamResult,
    odometry: Vec<StampedPose>,
    truth: Vec<StampedPose>,
    config: Config,
    pub(super) row: Row,
    live: Vec<Claim>,
    claims: Vec<Claim>,
}

/// What the program says of a drive while it comes in, and in the end.
pub(super) struct Followed {
    pub(super) live: Vec<Claim>,
    pub(super) result: SlamResult,
    odometry: Vec<StampedPose>,
    /// The numbers of the scans that were taken in.
    pub(super) taken: Vec<usize>,
    cost: Cost,
}

/// CPU time in all, from the last scan on, and of the longest step.
#[derive(Default)]
struct Cost {
    cpu_s: f64,
    finish_s: f64,
    largest_step_ms: f64,
}

impl Followed {
    pub(super) fn new(records: &[Record], config: &Config) -> anyhow::Result<Self> {
        let started_s = fine_cpu_time_s();
        let frames = Frames::new(records, config)?;
        let mut slam = Slam::new(config);
        let (mut live, mut odometry, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        let mut cost = Cost::default();
        let mut pass = frames.iter();
        loop {
            let before_s = fine_cpu_time_s();
            let Some(frame) = pass.next() else { break };
            if let Ok(step) = slam.process(&frame) {
                live.push(Claim::of_step(&step));
                odometry.push(StampedPose { stamp_s: frame.stamp_s, pose: frame.dead_reckoning });
                taken.push(frame.index);
            }
            cost.largest_step_ms = cost.largest_step_ms.max(1e3 * (fine_cpu_time_s() - before_s));
        }
        let live_s = fine_cpu_time_s();
        let result = slam.finish();
        (cost.finish_s, cost.cpu_s) = (fine_cpu_time_s() - live_s, fine_cpu_time_s() - started_s);
        Ok(Self { live, result, odometry, taken, cost })
    }
}

/// The drive of a number: as it was drawn, or with nothing going wrong but `fault`.
pub(super) fn scenario(seed: u64, fault: Option<&str>) -> Scenario {
    let drawn = Scenario::random(seed);
    // What is no kind of fault the command line has refused.
    fault.and_then(|kind| drawn.clone().with_fault(kind)).unwrap_or(drawn)
}

/// Runs `floorprint gauntlet-drive`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let Settings { preset, set, .. } = &arguments.settings;
    limit_cpu_time(arguments.cpu_limit)?;
    let solved = solve(
        scenario(arguments.drive, arguments.fault.as_deref()),
        &Settings { preset: *preset, set: set.clone(), ..Settings::default() },
    )?;
    let picture = (solved.row.outcome != Verdict::Right).then(|| solved.picture());
    writeln!(terminal.results(), "{}", serde_json::to_string(&Answer { row: solved.row, picture })?)?;
    Ok(Outcome::Fine)
}

/// Solves a drive and leaves what can be looked at in a folder.
pub(super) fn leave_folder(scenario: Scenario, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    let preset = around.preset.parse().map_err(anyhow::Error::msg)?;
    let seed = scenario.seed;
    let solved = solve(scenario, &Settings { preset, set: around.set.to_vec(), ..Settings::default() })?;
    let folder = around.out.join(format!("drive-{seed}"));
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    write_trajectory(&folder.join("trajectory.tum"), &solved.result.trajectory)?;
    write_trajectory(&folder.join("odometry.tum"), &solved.odometry)?;
    write_trajectory(&folder.join("truth.tum"), &solved.truth)?;
    write_file(&folder.join("claims.csv"), solved.claims_table().as_bytes())?;
    write_file(&folder.join("config.toml"), solved.config.to_toml().as_bytes())?;
    write_file(&folder.join("simulation.toml"), toml::to_string(&solved.scenario.config)?.as_bytes())?;
    write_file(&folder.join("picture.svg"), solved.picture().as_bytes())?;
    if let Some(map) = solved.result.map.to_raster() {
        write_map(&folder.join("map.yaml"), &map)?;
        let mut figure = Figure::of_map(&map);
        let points = |poses: &[StampedPose]| poses.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]).collect();
        let lines: [(Vec<[f64; 2]>, _); 2] =
            [(points(&solved.odometry), DEAD_RECKONING), (points(&solved.result.trajectory), TRAJECTORY)];
        for (line, color) in lines {
            figure.draw_line(line.into_iter(), color, 2.0);
        }
        write_png(&folder.join("map.png"), &figure.into_picture())?;
    }
    let row = serde_json::to_string_pretty(&solved.row)? + "\n";
    write_file(&folder.join("row.json"), row.as_bytes())?;
    around.terminal.results().write_all(row.as_bytes())?;
    around.terminal.say(&format!("its poses, map and picture are in {}", folder.display()));
    Ok(Outcome::Fine)
}

pub(super) fn solve(scenario: Scenario, settings: &Settings) -> anyhow::Result<Solved> {
    let drive = scenario.simulate()?;
    let mut config = settings.resolve(Some(&scenario.config.robot))?;
    config.seed = scenario.seed;
    // Scans are needed several times over, which costs more to simulate than to keep.
    let records = drive.records();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let truth = drive.truth();
    let Followed { live, result, odometry, taken, cost } = pool.install(|| Followed::new(&records, &config))?;
    let mut row = Row::of(&scenario, &drive);
    (row.cpu_s, row.finish_s, row.largest_step_ms) = (cost.cpu_s, cost.finish_s, cost.largest_step_ms);
    // Stamps may be wrong; the number of a scan is not.
    let true_poses: Vec<Pose2> = taken.iter().filter_map(|&scan| Some(truth.get(scan)?.pose)).collect();
    let times_s: Vec<f64> = taken.iter().filter_map(|&scan| drive.scan_time_s(scan)).collect();
    let start = true_poses.first().copied().unwrap_or(Pose2::IDENTITY);
    let true_poses: Vec<Pose2> = true_poses.iter().map(|pose| start.between(pose)).collect();
    let judge = |claims: &[Claim]| {
        let truths = times_s.iter().copied().zip(true_poses.iter().copied());
        Judgement::new(claims.iter().zip(truths).map(|(claim, (time_s, pose))| (claim, time_s, pose)))
    };
    let claims = Claim::of_result(&result);
    let stated = |stamped: &StampedPose| Claim { pose: stamped.pose, is_lost: false, radius_m: 0.0, radius_deg: 0.0 };
    let of_odometry = judge(&odometry.iter().map(stated).collect::<Vec<_>>());
    (row.live, row.result) = (judge(&live), judge(&claims));
    (row.odometry_max_m, row.odometry_rmse_m) = (of_odometry.max_m, of_odometry.rmse_m);
    row.outcome = Verdict::of(&row.live, &row.result);
    let kidnapped_s: Vec<f64> = (scenario.config.faults.iter())
        .filter_map(|fault| if let Fault::Kidnapping { at_s, .. } = *fault { Some(at_s) } else { None })
        .collect();
    let is_true = |time_s: f64, kidnapped_s: f64| (-1.0..KIDNAPPED_WITHIN_S).contains(&(time_s - kidnapped_s));
    let told_s: Vec<f64> = result.kidnappings.iter().filter_map(|told| times_s.get(told.frame).copied()).collect();
    row.kidnapped = kidnapped_s.len();
    row.kidnappings_noticed =
        kidnapped_s.iter().filter(|kidnapped| told_s.iter().any(|told| is_true(*told, **kidnapped))).count();
    row.false_kidnappings =
        told_s.iter().filter(|told| !kidnapped_s.iter().any(|kidnapped| is_true(**told, *kidnapped))).count();
    let truth = true_poses.iter().zip(&result.trajectory);
    let truth = truth.map(|(&pose, stamped)| StampedPose { stamp_s: stamped.stamp_s, pose }).collect();
    Ok(Solved { scenario, drive, result, odometry, truth, config, row, live, claims })
}

impl Row {
    /// What is known of a drive before it is solved.
    fn of(scenario: &Scenario, drive: &SimulatedDrive) -> Self {
        Self { duration_s: drive.duration_s(), ..Self::failed(scenario, String::new()) }.without_failure()
    }

    fn without_failure(mut self) -> Self {
        self.failure = None;
        self
    }

    /// A drive that gave no result.
    pub(super) fn failed(scenario: &Scenario, failure: String) -> Self {
        let lidar = &scenario.config.lidar;
        Self {
            seed: scenario.seed,
            world: scenario.world_kind.to_owned(),
            base: scenario.base.to_owned(),
            lidar: scenario.lidar.to_owned(),
            beams: lidar.beams,
            rate_hz: lidar.rate_hz,
            field_of_view_deg: lidar.field_of_view_rad.to_degrees(),
            fault: scenario.fault_kind.clone(),
            duration_s: 0.0,
            length_m: scenario.world.route_length_m(),
            outcome: Verdict::Failed,
            failure: Some(failure),
            live: Judgement::default(),
            result: Judgement::default(),
            odometry_max_m: 0.0,
            odometry_rmse_m: 0.0,
            cpu_s: 0.0,
            finish_s: 0.0,
            largest_step_ms: 0.0,
            kidnapped: 0,
            kidnappings_noticed: 0,
            false_kidnappings: 0,
        }
    }

    /// Whether the trajectory is worse than a metre and than twice the odometry without a word; where there is no
    /// odometry there is nothing to be worse than.
    pub(super) fn is_worse_than_odometry(&self) -> bool {
        let claimed_m = self.live.claimed_max_m.max(self.result.claimed_max_m);
        self.outcome == Verdict::SilentlyWrong
            && self.base != "no_odometry"
            && claimed_m > (2.0 * self.odometry_max_m).max(1.0)
    }

    /// The larger of what was claimed wrongly live and in the end, metres.
    pub(super) fn claimed_max_m(&self) -> f64 {
        self.live.claimed_max_m.max(self.result.claimed_max_m)
    }
}

impl Solved {
    /// What was claimed of each scan, live and in the end, beside how far it is off: metres, degrees; stated regions hold
    /// 95 %.
    fn claims_table(&self) -> String {
        let mut text = String::from(
            "scan,stamp_s,live_off_m,live_off_deg,live_stated_m,live_stated_deg,live_lost,off_m,off_deg,stated_m,stated_deg,lost\n",
        );
        for (scan, ((live, claim), truth)) in self.live.iter().zip(&self.claims).zip(&self.truth).enumerate() {
            let _ = write!(text, "{scan},{:.6}", truth.stamp_s);
            for claim in [live, claim] {
                let error = PoseError::between(&truth.pose, &claim.pose);
                let Claim { radius_m, radius_deg, is_lost, .. } = claim;
                let (off_m, off_deg) = (error.translation_m, error.rotation_deg.abs());
                let _ = write!(text, ",{off_m:.3},{off_deg:.2},{radius_m:.3},{radius_deg:.2},{}", u8::from(*is_lost));
            }
            text.push('\n');
        }
        text
    }

    fn picture(&self) -> String {
        let lost = |claims: &[Claim]| claims.iter().map(|claim| (claim.pose, claim.is_lost)).collect::<Vec<_>>();
        let picture = Picture {
            walls: self.drive.world().walls(),
            start: self.drive.start(),
            truth: self.truth.iter().map(|stamped| stamped.pose).collect(),
            odometry: self.odometry.iter().map(|stamped| stamped.pose).collect(),
            live: lost(&self.live),
            result: lost(&self.claims),
        };
        picture.to_svg()
    }
}
