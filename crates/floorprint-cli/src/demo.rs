//! `floorprint demo`: a simulated drive with known truth, made and solved on the spot.

use crate::config::Settings;
use crate::outcome::Outcome;
use crate::run::{Task, Work};
use crate::terminal::Terminal;
use crate::{simulate, summary};
use clap::Args;
use floorprint::simulator::{self, SimulationConfig, World};
use floorprint_io::OpenOptions;
use std::path::PathBuf;

/// World that is driven through.
const WORLD: &str = "rooms";

/// Simulate a drive with known truth and solve it.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder for the drive and its results; those of an earlier demo are replaced.
    #[arg(long, value_name = "DIR", default_value = "runs/demo")]
    out: PathBuf,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    work: Work,
}

/// Runs `floorprint demo`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let (drive, results) = (arguments.out.join(WORLD), arguments.out.join("results"));
    let seed = arguments.settings.seed.unwrap_or_default();
    let simulated = simulator::simulate(World::named(WORLD, seed)?, SimulationConfig::default(), seed)?;
    arguments.work.pool()?.install(|| simulate::write(&simulated, &drive, 1, true, terminal))?;
    let task = Task {
        path: &drive,
        options: OpenOptions::default(),
        settings: &arguments.settings,
        work: &arguments.work,
        out: &results,
        arrival: None,
        force: true,
        earlier: None,
        mcap: None,
    };
    let Some((report, results)) = task.execute(terminal)? else { return Ok(Outcome::Interrupted) };
    if !terminal.is_quiet() {
        summary::print(&mut terminal.results(), &report, &results)?;
    }
    Ok(if report.partial { Outcome::Interrupted } else { Outcome::Fine })
}
