//! `floorprint bench --gauntlet N`: random drives, each right, said to be lost, or silently wrong.

#[cfg(test)]
mod corner_cases;
#[cfg(test)]
mod degraded_logs;
mod drive;
mod judgement;
mod page;
mod picture;
mod table;

pub(crate) use drive::{Arguments as DriveArguments, execute as execute_drive};

use super::drives::Surroundings;
use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::outcome::Outcome;
use crate::program::Program;
use crate::terminal;
use anyhow::{Context as _, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;
use drive::{Answer, Row};
use floorprint::simulator::Scenario;
use floorprint_io::write_file;
use judgement::Verdict;
use serde::Serialize;
use std::fs;
use std::io::Write as _;

/// Pictures of so many of the worst drives are shown.
const PICTURES: usize = 40;

/// Random drives in place of data sets and named worlds.
#[derive(Args, Debug, Clone)]
#[group(skip)]
pub(super) struct Options {
    /// Random drives through random worlds with random robots and faults: how many of them are right, how many
    /// say that they are lost, and how many are silently wrong.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub(super) gauntlet: Option<u64>,
    /// A single drive of the gauntlet, by the seed that its row gives; its poses, map and picture are left
    /// in a folder of --out.
    #[arg(long, value_name = "SEED", conflicts_with = "gauntlet")]
    pub(super) gauntlet_drive: Option<u64>,
    /// Let nothing but this go wrong on drives of the gauntlet, and on each of them.
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(Scenario::FAULT_KINDS))]
    gauntlet_fault: Option<String>,
}

impl Options {
    /// The drive of a number.
    fn scenario(&self, seed: u64) -> Scenario {
        drive::scenario(seed, self.gauntlet_fault.as_deref())
    }

    /// Whether there are random drives to run.
    pub(super) fn is_asked_for(&self) -> bool {
        self.gauntlet.is_some() || self.gauntlet_drive.is_some() || self.gauntlet_fault.is_some()
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Results<'a> {
    /// Version of the program.
    version: &'static str,
    /// The gauntlet's seed.
    seed: u64,
    /// What alone went wrong, on each of the drives; none where each has faults of its own or none.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<&'a str>,
    /// Drives that were run.
    drives: usize,
    /// Those right from beginning to end.
    right: usize,
    /// Those whose errors were told.
    told: usize,
    /// Those that claimed what is not so.
    silently_wrong: usize,
    /// Those that gave no result.
    failed: usize,
    /// Those among all that were worse than a metre and twice the odometry's error without a word.
    worse_than_odometry: usize,
    /// Whether the user stopped it before its end.
    interrupted: bool,
    /// One entry for each drive.
    rows: &'a [Row],
}

impl<'a> Results<'a> {
    fn new(seed: u64, fault: Option<&'a str>, rows: &'a [Row], interrupted: bool) -> Self {
        let count = |verdict: Verdict| rows.iter().filter(|row| row.outcome == verdict).count();
        Self {
            version: env!("CARGO_PKG_VERSION"),
            seed,
            fault,
            drives: rows.len(),
            right: count(Verdict::Right),
            told: count(Verdict::Told),
            silently_wrong: count(Verdict::SilentlyWrong),
            failed: count(Verdict::Failed),
            worse_than_odometry: rows.iter().filter(|row| row.is_worse_than_odometry()).count(),
            interrupted,
            rows,
        }
    }
}

/// Runs what was asked for.
pub(super) fn execute(options: &Options, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    Settings { set: around.set.to_vec(), ..Settings::default() }.resolve(None)?;
    match (options.gauntlet, options.gauntlet_drive) {
        (_, Some(seed)) => drive::leave_folder(options.scenario(seed), around),
        (Some(count), None) => run(count, options, around),
        (None, None) => bail!("no drives to run: --gauntlet-fault goes with --gauntlet N or --gauntlet-drive SEED"),
    }
}

fn run(count: u64, options: &Options, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    let terminal = around.terminal;
    fs::create_dir_all(around.out).with_context(|| format!("cannot make {}", around.out.display()))?;
    let interrupt = Interrupt::listen();
    let seeds: Vec<u64> = Scenario::seeds(around.drives.seed, count).collect();
    let answers = around
        .drives
        .side_by_side(&seeds, &interrupt, terminal, |&seed| answer_of(seed, options, around, &interrupt))?;
    let (rows, mut pictures): (Vec<Row>, Vec<(u64, Option<String>)>) =
        answers.into_iter().map(|Answer { row, picture }| (row.clone(), (row.seed, picture))).unzip();
    pictures.retain(|(_, picture)| picture.is_some());
    let results = Results::new(around.drives.seed, options.gauntlet_fault.as_deref(), &rows, interrupt.requested());
    let markdown = table::markdown(&results, around.preset, around.set);
    let json = serde_json::to_string_pretty(&results)? + "\n";
    write_file(&around.out.join("gauntlet.md"), markdown.as_bytes())?;
    write_file(&around.out.join("gauntlet.json"), json.as_bytes())?;
    let page = page::page(&results, &pictures, around.preset);
    write_file(&around.out.join("gauntlet.html"), page.as_bytes())?;
    let printed = if around.drives.json { json } else { terminal::markdown(&markdown) };
    terminal.results().write_all(printed.as_bytes())?;
    if results.interrupted {
        terminal.warn("stopped before its end: these are the drives so far");
        return Ok(Outcome::Interrupted);
    }
    Ok(Outcome::Fine)
}

/// Runs one drive in a process of its own; whatever happens to it becomes its row.
fn answer_of(seed: u64, options: &Options, around: &Surroundings<'_>, interrupt: &Interrupt) -> Answer {
    let result = ask(seed, options, around, interrupt);
    result.unwrap_or_else(|error| Answer {
        row: Row::failed(&options.scenario(seed), format!("{error:#}")),
        picture: None,
    })
}

fn ask(seed: u64, options: &Options, around: &Surroundings<'_>, interrupt: &Interrupt) -> anyhow::Result<Answer> {
    let mut command = Program::command()?;
    command.args(["gauntlet-drive", &seed.to_string(), "--quiet", "--preset", around.preset]);
    if let Some(kind) = &options.gauntlet_fault {
        command.args(["--fault", kind]);
    }
    for setting in around.set {
        command.args(["--set", setting]);
    }
    Ok(serde_json::from_slice(&around.drives.ask(&mut command, interrupt)?)?)
}
