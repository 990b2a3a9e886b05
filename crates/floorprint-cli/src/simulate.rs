//! `floorprint simulate`: a drive with known truth, in the course's file layout.

use crate::outcome::{BadArguments, Outcome};
use crate::terminal::Terminal;
use crate::watcher::Watcher;
use clap::Args;
use clap::builder::PossibleValuesParser;
use floorprint::simulator::{SimulatedDrive, SimulationConfig, World, simulate};
use floorprint_io::{read_text, write_ece276a};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Simulate a drive with exact truth, in the file layout of the course ECE276A.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder to make.
    #[arg(long, value_name = "DIR", required_unless_present = "schema")]
    out: Option<PathBuf>,
    /// World to drive through. "campus" and the maneuvers bring the LiDAR and the pace of a robot of their own, unless
    /// --config is given.
    #[arg(long, value_name = "NAME", default_value = "rooms", value_parser = PossibleValuesParser::new(World::names()))]
    world: String,
    /// Seed of the world's furniture and of all errors of the sensors.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Number of the drive in the files' names.
    #[arg(long, value_name = "N", default_value_t = 1)]
    drive: u32,
    /// TOML file with the simulation's settings: robot, sensors, faults.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Replace an earlier simulation.
    #[arg(long)]
    force: bool,
    /// Print the JSON schema of the file of settings and faults instead.
    #[arg(long)]
    schema: bool,
}

/// Runs `floorprint simulate`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let Some(out) = arguments.out.as_deref().filter(|_| !arguments.schema) else {
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(SimulationConfig))?;
        writeln!(terminal.results(), "{schema}")?;
        return Ok(Outcome::Fine);
    };
    let config = match &arguments.config {
        None => robot_of(&arguments.world),
        Some(path) => {
            let unusable = |what: &str| {
                BadArguments(format!("cannot use the simulation's settings in {}: {what}", path.display()))
            };
            let text = read_text(path).map_err(|error| unusable(&error.to_string()))?;
            toml::from_str(&text).map_err(|error| {
                let before = text.get(..error.span().map_or(0, |span| span.start)).unwrap_or_default();
                let line = 1 + before.matches('\n').count();
                unusable(&format!("line {line}: {}", error.message().replace('\n', ", ")))
            })?
        }
    };
    let drive = simulate(World::named(&arguments.world, arguments.seed)?, config, arguments.seed)?;
    write(&drive, out, arguments.drive, arguments.force, terminal)?;
    let (world, out) = (&arguments.world, out.display());
    terminal
        .say(&format!("{:.0} s through \"{world}\" written; solve it with: floorprint run {out}", drive.duration_s()));
    Ok(Outcome::Fine)
}

/// The robot that drives through a world: that of the course, with the LiDAR, the pace and the faults of the world's own one.
/// Mounts, wheels and gyro stay the course's, for they are not in its files.
fn robot_of(world: &str) -> SimulationConfig {
    let course = SimulationConfig::default();
    match World::own_robot(world) {
        Some(own) => {
            SimulationConfig { robot: course.robot, pose_odometry: course.pose_odometry, imu: course.imu, ..own }
        }
        None => course,
    }
}

/// Writes a drive with a progress bar.
///
/// # Errors
/// The folder exists or cannot be written.
pub(crate) fn write(
    drive: &SimulatedDrive,
    out: &Path,
    number: u32,
    replace: bool,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    // A bar for each kind of reading: from scans nothing follows for how long images take.
    let mut shown = ("", terminal.busy("simulating"));
    let mut show = |unit: &'static str, done: usize, total: usize| {
        if shown.0 != unit {
            shown.1.finish_and_clear();
            shown = (unit, terminal.progress("simulating", unit, total));
        }
        shown.1.set_position(done as u64);
        if done == total {
            shown.1.finish_and_clear();
            shown = ("", terminal.busy("writing"));
        }
    };
    let written = write_ece276a(out, drive, number, replace, &mut show);
    shown.1.finish_and_clear();
    Ok(written?)
}

/// Writes a drive in the file layout of the course, told to a watcher.
///
/// # Errors
/// The folder exists, unless it holds a simulation and is to be replaced; it cannot be written.
pub fn write_simulation(
    drive: &SimulatedDrive,
    out: &Path,
    number: u32,
    replace: bool,
    watcher: &Watcher,
) -> anyhow::Result<()> {
    write(drive, out, number, replace, &watcher.terminal())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_with_a_robot_of_its_own_is_driven_through_by_that() {
        for world in ["campus", "spin"] {
            let (robot, own) = (robot_of(world), World::own_robot(world).unwrap());
            assert_eq!((&robot.lidar, &robot.motion, &robot.faults), (&own.lidar, &own.motion, &own.faults));
            robot.validate().unwrap();
            assert_eq!((robot.robot, robot.imu), (SimulationConfig::default().robot, SimulationConfig::default().imu));
            assert!(robot.pose_odometry.is_none());
        }
        assert!(robot_of("campus").lidar.range_max_m >= 80.0);
        assert_eq!(robot_of("rooms"), SimulationConfig::default());
    }

    #[test]
    fn the_settings_and_faults_in_the_documentation_are_what_is_read() {
        let page = include_str!("../../../docs/simulation.md");
        let blocks: Vec<&str> = page.split("```toml\n").skip(1).filter_map(|block| block.split("```").next()).collect();
        let config: SimulationConfig = toml::from_str(&blocks.concat()).unwrap();
        config.validate().unwrap();
        let kinds = schemars::schema_for!(SimulationConfig);
        let kinds = kinds.pointer("/$defs/Fault/oneOf").and_then(|kinds| kinds.as_array()).unwrap();
        assert_eq!(config.faults.len(), kinds.len(), "every kind of fault is shown");
    }
}
