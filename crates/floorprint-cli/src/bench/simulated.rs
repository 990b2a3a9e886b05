//! `floorprint bench-drive`: one simulated drive, solved and compared with its truth in a process of
//! its own, so that its memory is its own. `floorprint bench` runs it; its result is JSON on stdout.
//!
//! Scans are simulated as they are consumed: the longest drive fits into memory, and nothing is written
//! to disk. What the simulation costs is measured on the way and taken off.

use super::run::{Run, accepted, count_wrong};
use crate::config::Settings;
use crate::number::number;
use crate::outcome::Outcome;
use crate::report::Loops;
use crate::stopwatch::{MemoryMark, ScanTimes, fine_cpu_time_s};
use crate::terminal::Terminal;
use anyhow::bail;
use clap::Args;
use clap::builder::PossibleValuesParser;
use floorprint::evaluation::{
    MapQuality, MapQualityOptions, PoseError, Span, TrajectoryError, TrajectoryErrorOptions, WallSharpness,
};
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, Records, StampedPose};
use floorprint::simulator::{SimulatedDrive, SimulationConfig, World, simulate};
use floorprint::{Config, Frames, Slam};
use std::borrow::Cow;
use std::io::Write as _;
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};

/// Side of a cell of the true map, metres.
const MAP_RESOLUTION_M: f64 = 0.05;
/// Forty commands of a tenth of a second each.
const WINDOW_S: f64 = 4.0;

/// Solve one simulated drive and print its figures as JSON.
#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    world: WorldChoice,
    #[command(flatten)]
    lidar: Lidar,
    #[command(flatten)]
    settings: Settings,
    /// Threads.
    #[arg(long, default_value_t = 1)]
    threads: u16,
}

/// Which world is driven through.
#[derive(Args, Debug, Clone)]
#[group(required = true, multiple = false)]
pub(super) struct WorldChoice {
    /// A named world.
    #[arg(long, value_parser = PossibleValuesParser::new(World::names()))]
    pub(super) world: Option<String>,
    /// An office of about this length, km.
    #[arg(long)]
    pub(super) office_km: Option<f64>,
}

/// The simulated LiDAR.
#[derive(Args, Debug, Clone)]
pub(super) struct Lidar {
    /// Rays of a simulated scan.
    #[arg(long, value_name = "N", default_value_t = 1081, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    beams: u32,
    /// Simulated scans a second.
    #[arg(long, value_name = "HZ", default_value_t = 40.0, value_parser = number(0.1, 1000.0))]
    rate_hz: f64,
    /// Farthest range of the simulated LiDAR, metres.
    #[arg(long, value_name = "METRES", default_value_t = 30.0, value_parser = number(0.1, 1000.0))]
    range_m: f64,
    /// Angle from the first simulated ray to the last, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 270.0, value_parser = number(1.0, 360.0))]
    field_of_view_deg: f64,
    /// Where the simulated LiDAR sits on the robot: x ahead, y left (metres) and yaw (degrees),
    /// e.g. -0.2,0.1,30 [default: 0.13323,0,0].
    #[arg(long, value_name = "X,Y,YAW", allow_hyphen_values = true, value_parser = place)]
    lidar_at: Option<Pose2>,
}

fn place(text: &str) -> Result<Pose2, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, yaw_deg]) if [x, y, yaw_deg].iter().all(|number| number.is_finite()) => {
            Ok(Pose2::new(x, y, yaw_deg.to_radians()))
        }
        _ => Err("expected three numbers with commas between them: x and y in metres, yaw in degrees".to_owned()),
    }
}

impl Lidar {
    /// The simulation with this LiDAR and without a camera.
    pub(super) fn simulation(&self) -> SimulationConfig {
        let mut simulation = SimulationConfig::default();
        simulation.lidar.beams = self.beams as usize;
        simulation.lidar.rate_hz = self.rate_hz;
        simulation.lidar.range_max_m = self.range_m;
        simulation.lidar.field_of_view_rad = self.field_of_view_deg.to_radians();
        simulation.camera.rate_hz = 0.0;
        let sweep_s = &mut simulation.robot.lidar.sweep_duration_s;
        *sweep_s = sweep_s.min(1.0 / self.rate_hz);
        match self.lidar_at {
            Some(place) => simulation.with_lidar_at(place),
            None => simulation,
        }
    }

    /// Whether the user has chosen another than the default.
    fn is_chosen(&self) -> bool {
        let is_default = (self.beams, self.rate_hz, self.range_m) == (1081, 40.0, 30.0);
        !is_default || self.field_of_view_deg != 270.0 || self.lidar_at.is_some()
    }

    /// Hands the options on to a process.
    pub(super) fn pass_on(&self, command: &mut Command) {
        command.args(["--beams", &self.beams.to_string(), "--rate-hz", &self.rate_hz.to_string()]);
        command.args(["--range-m", &self.range_m.to_string()]);
        command.args(["--field-of-view-deg", &self.field_of_view_deg.to_string()]);
        if let Some(Pose2 { x, y, theta }) = self.lidar_at {
            command.arg(format!("--lidar-at={x},{y},{}", theta.to_degrees()));
        }
    }

    /// In words, for the table.
    pub(super) fn description(&self) -> String {
        let place = self.lidar_at.map_or(String::new(), |place| {
            format!(", at {:.2}, {:.2} m, {:.0}°", place.x, place.y, place.theta.to_degrees())
        });
        format!(
            "{} beams over {}°, {} Hz, range {} m{place}",
            self.beams, self.field_of_view_deg, self.rate_hz, self.range_m
        )
    }
}

/// Runs `floorprint bench-drive`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let seed = arguments.settings.seed.unwrap_or(0);
    let world = match (&arguments.world.world, arguments.world.office_km) {
        (Some(name), _) => World::named(name, seed)?,
        (None, Some(length_km)) => World::office(1e3 * length_km, seed),
        (None, None) => bail!("no world to drive through"),
    };
    let own_robot = arguments.world.world.as_deref().and_then(World::own_robot);
    let simulation = own_robot.filter(|_| !arguments.lidar.is_chosen()).unwrap_or_else(|| arguments.lidar.simulation());
    let drive = simulate(world, simulation, seed)?;
    let config = arguments.settings.resolve(Some(&drive.config().robot))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads.into()).build()?;
    let compare_maps = arguments.world.world.is_some();
    let run = pool.install(|| solve(&drive, &config, compare_maps))?;
    writeln!(terminal.results(), "{}", serde_json::to_string(&run)?)?;
    Ok(Outcome::Fine)
}

fn solve(drive: &SimulatedDrive, config: &Config, compare_maps: bool) -> anyhow::Result<Run> {
    let memory = MemoryMark::set();
    let source = Source { drive, simulating_ns: AtomicU64::new(0) };
    let clock = || fine_cpu_time_s() - source.simulating_ns.load(Ordering::Relaxed) as f64 * 1e-9;
    let started_s = clock();
    let frames = Frames::of(&source, config)?;
    let mut slam = Slam::new(config);
    let mut scan_times = ScanTimes::default();
    let mut pass = frames.iter();
    let mut dead_reckoning = Vec::with_capacity(frames.len());
    loop {
        let before_s = clock();
        let Some(frame) = pass.next() else { break };
        slam.process(&frame)?;
        scan_times.add(clock() - before_s);
        dead_reckoning.push(StampedPose { stamp_s: frame.stamp_s, pose: frame.dead_reckoning });
    }
    let live_s = clock();
    let result = slam.finish();
    let finish_s = clock() - live_s;
    let cpu_s = clock() - started_s;
    let peak_memory_bytes = memory.peak_beyond_bytes();

    let truth = drive.truth();
    let options = TrajectoryErrorOptions { spans: Vec::new(), ..TrajectoryErrorOptions::default() };
    let error = TrajectoryError::new(&result.trajectory, &truth, &options)?;
    let windowed = Windowed::of(drive, &result.trajectory, &truth)?;
    let odometry = TrajectoryError::new(&dead_reckoning, &truth, &options)?;
    let end = result.trajectory.last().map(|last| PoseError::between(&drive.true_pose(last.stamp_s), &last.pose));
    let candidates = serde_json::to_value(Loops::new(&result.closures, &result.trajectory).candidates)?;
    let map = compare_maps.then(|| result.map.to_raster()).flatten();
    let quality = map
        .as_ref()
        .and_then(|map| MapQuality::new(map, &drive.true_map(MAP_RESOLUTION_M), &MapQualityOptions::default()).ok());
    Ok(Run {
        seed: drive.seed(),
        translation_m: Some(error.translation_m.rmse),
        rotation_deg: Some(error.rotation_deg.rmse),
        largest_m: Some(error.translation_m.max),
        windowed_m: windowed.as_ref().and_then(|windowed| windowed.translation_m),
        yaw_spread_deg: windowed.map(|windowed| windowed.yaw_spread_deg),
        end_m: end.map(|end| end.translation_m),
        end_deg: end.map(|end| end.rotation_deg),
        odometry_m: Some(odometry.translation_m.rmse),
        closures: Some(accepted(&candidates).count()),
        wrong_closures: count_wrong(&candidates, |stamp_s| Some(drive.true_pose(stamp_s))),
        map_f1: quality.map(|quality| quality.f1),
        doubled_share: map.as_ref().and_then(WallSharpness::of).map(|walls| walls.doubled_share),
        scans: result.trajectory.len(),
        duration_s: drive.duration_s(),
        length_m: error.path_length_m,
        cpu_s: Some(cpu_s),
        wall_s: cpu_s,
        scan_ms: scan_times.summary(),
        finish_s: Some(finish_s),
        peak_memory_bytes,
    })
}

/// Drift while a robot keeps to a command, as those who complain of it measure it.
struct Windowed {
    /// RMSE of the motion over windows of [`WINDOW_S`], metres.
    translation_m: Option<f64>,
    /// Largest heading error less the smallest, degrees.
    yaw_spread_deg: f64,
}

impl Windowed {
    /// Of drives that keep to a command; `None` of all others.
    fn of(drive: &SimulatedDrive, trajectory: &[StampedPose], truth: &[StampedPose]) -> anyhow::Result<Option<Self>> {
        if drive.world().commands().is_empty() {
            return Ok(None);
        }
        let options =
            TrajectoryErrorOptions { spans: vec![Span::TimeS(WINDOW_S)], ..TrajectoryErrorOptions::default() };
        let error = TrajectoryError::new(trajectory, truth, &options)?;
        let headings_rad =
            trajectory.iter().map(|stamped| drive.true_pose(stamped.stamp_s).between(&stamped.pose).theta);
        let [low, high] = headings_rad.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], heading_rad| {
            [low.min(heading_rad), high.max(heading_rad)]
        });
        let relative = error.relative.first().and_then(|relative| relative.translation_m.as_ref());
        Ok(Some(Self { translation_m: relative.map(|errors| errors.rmse), yaw_spread_deg: (high - low).to_degrees() }))
    }
}

/// The drive's records, with the time that it takes to simulate them.
#[derive(Debug)]
struct Source<'a> {
    drive: &'a SimulatedDrive,
    simulating_ns: AtomicU64,
}

impl Records for Source<'_> {
    fn count(&self) -> usize {
        self.drive.count()
    }

    fn record(&self, position: usize) -> Option<Cow<'_, Record>> {
        let before_s = fine_cpu_time_s();
        let record = self.drive.record(position);
        self.simulating_ns.fetch_add(((fine_cpu_time_s() - before_s) * 1e9) as u64, Ordering::Relaxed);
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_and_nonsense_is_not() {
        let found = place("-0.2, 0.1,90").unwrap();
        assert!((found.x + 0.2).abs() < 1e-12 && (found.theta - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        for text in ["", "1,2", "1,2,x", "1,2,nan"] {
            assert!(place(text).is_err(), "{text}");
        }
    }
}
