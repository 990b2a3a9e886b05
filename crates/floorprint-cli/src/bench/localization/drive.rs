//! One case of the benchmark of localization: simulated, localised and judged.

use super::super::drives::limit_cpu_time;
use super::case::{Case, Fault, Setting, Start};
use super::judgement::{Judgement, Said};
use crate::config::Settings;
use crate::outcome::Outcome;
use crate::stopwatch::{ScanCost, ScanTimes, fine_cpu_time_s};
use crate::terminal::Terminal;
use anyhow::ensure;
use clap::Args;
use floorprint::Frames;
use floorprint::geometry::Pose2;
use floorprint::localization::{LocalizationMap, Localizer, Start as Given};
use serde::{Deserialize, Serialize};
use std::io::Write as _;
use std::sync::Arc;

/// Side of a cell of the map, metres.
const MAP_RESOLUTION_M: f64 = 0.05;

/// Localise in one case and print its row as JSON.
#[derive(Args)]
pub(crate) struct Arguments {
    /// The case.
    #[arg(value_name = "FAULT/START/SEED")]
    case: Case,
    /// CPU time after which the system ends it, seconds.
    #[arg(long, default_value_t = 300)]
    cpu_limit: u32,
    #[command(flatten)]
    settings: Settings,
}

/// What is said of a case.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Row {
    /// By which it can be run alone: FAULT/START/SEED.
    pub(super) case: String,
    /// What goes wrong.
    pub(super) fault: Fault,
    /// What is known of the start.
    pub(super) start: Start,
    /// The kind of world, the base, and the LiDAR.
    pub(super) world: String,
    pub(super) base: String,
    pub(super) lidar: String,
    /// Rays of a scan, and scans a second.
    pub(super) beams: usize,
    pub(super) rate_hz: f64,
    /// Free floor of the map, square metres.
    pub(super) map_m2: f64,
    /// Scans, their time in seconds, and how far the robot drove, metres.
    pub(super) scans: usize,
    pub(super) duration_s: f64,
    pub(super) length_m: f64,
    /// Why there is no result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) failure: Option<String>,
    /// What was said against the truth.
    pub(super) judgement: Judgement,
    /// CPU time of a scan while a pose is claimed, and while none is, milliseconds, without that of the frame.
    pub(super) tracking_ms: Option<ScanCost>,
    pub(super) searching_ms: Option<ScanCost>,
    /// CPU time of the first scan, milliseconds.
    pub(super) first_ms: f64,
    /// Making the map ready, seconds.
    pub(super) prepared_s: f64,
}

/// Runs `floorprint localization-drive`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    limit_cpu_time(arguments.cpu_limit)?;
    let row = localise(&arguments.case, &arguments.settings)?;
    writeln!(terminal.results(), "{}", serde_json::to_string(&row)?)?;
    Ok(Outcome::Fine)
}

/// Localises in one case.
pub(super) fn localise(case: &Case, settings: &Settings) -> anyhow::Result<Row> {
    let Setting { scenario, from_to_s: [from_s, to_s], kidnapped_s, start_off } = case.setting()?;
    let drive = scenario.simulate()?;
    let mut config = settings.resolve(Some(&scenario.config.robot))?;
    config.seed = case.seed;
    let truth = drive.truth();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let map = Arc::new(LocalizationMap::new(&drive.true_map(MAP_RESOLUTION_M)));
    let mut row = Row {
        case: case.to_string(),
        fault: case.fault,
        start: case.start,
        world: scenario.world_kind.to_owned(),
        base: scenario.base.to_owned(),
        lidar: scenario.lidar.to_owned(),
        beams: scenario.config.lidar.beams,
        rate_hz: scenario.config.lidar.rate_hz,
        map_m2: map.free_m2(),
        scans: 0,
        duration_s: 0.0,
        length_m: 0.0,
        failure: None,
        judgement: Judgement::default(),
        tracking_ms: None,
        searching_ms: None,
        first_ms: 0.0,
        prepared_s: 0.0,
    };
    let said = pool.install(|| -> anyhow::Result<Vec<Said>> {
        let frames = Frames::of(&drive, &config)?;
        let mut pass = frames.iter();
        let mut said: Vec<Said> = Vec::new();
        let mut times = [ScanTimes::default(), ScanTimes::default()];
        let mut localizer: Option<Localizer> = None;
        let mut before: Option<Pose2> = None;
        for mut frame in pass.by_ref() {
            // Stamps may be wrong; the number of a scan is not.
            let Some((time_s, truth)) = drive.scan_time_s(frame.index).zip(truth.get(frame.index)) else { break };
            if time_s < from_s {
                continue;
            }
            if time_s > to_s {
                break;
            }
            let truth = truth.pose;
            case.spoil(&mut frame);
            if localizer.is_none() {
                frame.motion = frame.motion.map(|_| Pose2::IDENTITY);
                let started_s = fine_cpu_time_s();
                localizer = Some(Localizer::new(map.clone(), case.given(&truth, start_off, &config), &config));
                row.prepared_s = fine_cpu_time_s() - started_s;
            }
            let Some(localizer) = &mut localizer else { break };
            let started_s = fine_cpu_time_s();
            let Ok(report) = localizer.process(&frame) else { continue };
            let cost_s = fine_cpu_time_s() - started_s;
            times[usize::from(report.pose.is_none())].add(cost_s);
            if said.is_empty() {
                row.first_ms = 1e3 * cost_s;
            }
            row.length_m += before.map_or(0.0, |before| before.between(&truth).distance());
            before = Some(truth);
            said.push(Said {
                time_s,
                driven_m: row.length_m,
                truth,
                claimed: report.pose,
                heaviest: report.modes.first().map(|mode| mode.pose),
                lost_probability: report.lost_probability,
            });
        }
        [row.tracking_ms, row.searching_ms] = times.map(|times| times.summary());
        Ok(said)
    })?;
    ensure!(!said.is_empty(), "the drive has no scans between {from_s:.1} and {to_s:.1} s");
    // Lengths and times count from the beginning of what is looked at.
    let began_s = said[0].time_s;
    let said: Vec<Said> = said.into_iter().map(|moment| Said { time_s: moment.time_s - began_s, ..moment }).collect();
    row.scans = said.len();
    row.duration_s = said.last().map_or(0.0, |last| last.time_s);
    // What a kidnapping adds was not driven.
    let kidnapped_s = kidnapped_s.map(|at_s| at_s - began_s);
    row.judgement = Judgement::new(&said, kidnapped_s, case.start == Start::Known);
    Ok(row)
}

impl Case {
    /// The start as it is given, about as far off as it is said to be.
    fn given(&self, truth: &Pose2, off: [f64; 3], config: &floorprint::Config) -> Given {
        match self.start {
            Start::Unknown => Given::Unknown,
            Start::Known => {
                let (sigma_m, sigma_rad) = (config.localization.start_sigma_m, config.localization.start_sigma_rad);
                let off = Pose2::new(sigma_m * off[0], sigma_m * off[1], sigma_rad * off[2]);
                Given::At(Pose2::new(truth.x + off.x, truth.y + off.y, truth.theta + off.theta))
            }
        }
    }
}

impl Row {
    /// A case that gave no result.
    pub(super) fn failed(case: &Case, failure: String) -> Self {
        Self {
            case: case.to_string(),
            fault: case.fault,
            start: case.start,
            world: String::new(),
            base: String::new(),
            lidar: String::new(),
            beams: 0,
            rate_hz: 0.0,
            map_m2: 0.0,
            scans: 0,
            duration_s: 0.0,
            length_m: 0.0,
            failure: Some(failure),
            judgement: Judgement::default(),
            tracking_ms: None,
            searching_ms: None,
            first_ms: 0.0,
            prepared_s: 0.0,
        }
    }
}
