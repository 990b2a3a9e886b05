//! `floorprint bench --localization N`: simulated worlds, faults and starts; how often a robot is found, and whether what
//! is said of its place is so.

mod case;
mod drive;
mod judgement;
mod table;

pub(crate) use drive::{Arguments as DriveArguments, execute as execute_drive};

use super::drives::Surroundings;
use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::outcome::Outcome;
use crate::program::Program;
use crate::terminal;
use anyhow::{Context as _, bail};
use case::Case;
use clap::Args;
use drive::Row;
use floorprint_io::write_files;
use serde::Serialize;
use std::fs;
use std::io::Write as _;

/// Localization in simulated worlds in place of data sets and named worlds.
#[derive(Args, Debug, Clone)]
#[group(skip)]
pub(super) struct Options {
    /// Localization in random worlds with random robots: ten faults by a start that is known and one that is not, in turn;
    /// how often the robot is found, how far off its pose is, and how often it is wrong [default: 100 cases].
    #[arg(
        long,
        value_name = "N",
        num_args = 0..=1,
        default_missing_value = "100",
        value_parser = clap::value_parser!(u64).range(1..=1_000_000),
        conflicts_with = "gauntlet"
    )]
    localization: Option<u64>,
    /// A single case of --localization, by the name that its row gives; prints its row.
    #[arg(long, value_name = "FAULT/START/SEED", conflicts_with_all = ["localization", "gauntlet"])]
    localization_case: Option<Case>,
}

impl Options {
    /// Whether there are cases to run.
    pub(super) fn is_asked_for(&self) -> bool {
        self.localization.is_some() || self.localization_case.is_some()
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Results {
    /// Version of the program.
    version: &'static str,
    /// The seed of all cases.
    seed: u64,
    /// Whether the user stopped it before its end.
    interrupted: bool,
    /// One entry for each case.
    rows: Vec<Row>,
}

/// Runs what was asked for.
pub(super) fn execute(options: &Options, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    let settings = Settings { set: around.set.to_vec(), ..Settings::default() };
    settings.resolve(None)?;
    match (options.localization, options.localization_case) {
        (_, Some(case)) => {
            let preset = around.preset.parse().map_err(anyhow::Error::msg)?;
            let row = drive::localise(&case, &Settings { preset, ..settings })?;
            writeln!(around.terminal.results(), "{}", serde_json::to_string_pretty(&row)?)?;
            Ok(Outcome::Fine)
        }
        (Some(count), None) => run(count, around),
        (None, None) => bail!("no cases to run"),
    }
}

fn run(count: u64, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    fs::create_dir_all(around.out).with_context(|| format!("cannot make {}", around.out.display()))?;
    let interrupt = Interrupt::listen();
    let cases = Case::all(around.drives.seed, count);
    let rows = around.drives.side_by_side(&cases, &interrupt, around.terminal, |case| {
        ask(case, around, &interrupt).unwrap_or_else(|error| Row::failed(case, format!("{error:#}")))
    })?;
    let seed = around.drives.seed;
    let results = Results { version: env!("CARGO_PKG_VERSION"), seed, interrupted: interrupt.requested(), rows };
    let markdown = table::markdown(&results, around.preset, around.set);
    let json = serde_json::to_string_pretty(&results)? + "\n";
    let [table, figures] = ["localization.md", "localization.json"].map(|name| around.out.join(name));
    write_files(&[(table.as_path(), markdown.as_bytes()), (figures.as_path(), json.as_bytes())])?;
    let printed = if around.drives.json { json } else { terminal::markdown(&markdown) };
    around.terminal.results().write_all(printed.as_bytes())?;
    if results.interrupted {
        around.terminal.warn("stopped before its end: these are the cases so far");
        return Ok(Outcome::Interrupted);
    }
    Ok(Outcome::Fine)
}

/// One case in a process of its own.
fn ask(case: &Case, around: &Surroundings<'_>, interrupt: &Interrupt) -> anyhow::Result<Row> {
    let mut command = Program::command()?;
    command.args(["localization-drive", &case.to_string(), "--quiet", "--preset", around.preset]);
    for setting in around.set {
        command.args(["--set", setting]);
    }
    Ok(serde_json::from_slice(&around.drives.ask(&mut command, interrupt)?)?)
}
