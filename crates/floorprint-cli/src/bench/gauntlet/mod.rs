//! `floorprint bench --gauntlet N`: random drives, each right, said to be lost, or silently wrong.
//!
//! Each drive is a process of its own with a limit on its time: one that hangs or fails is a row of the table, too.

mod drive;
mod judgement;
mod page;
mod picture;
mod table;

pub(crate) use drive::{Arguments as DriveArguments, execute as execute_drive};

use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::outcome::Outcome;
use crate::program::Program;
use crate::terminal::Terminal;
use anyhow::{Context as _, bail};
use clap::Args;
use drive::{Answer, Row};
use floorprint::simulator::Scenario;
use floorprint_io::write_file;
use judgement::Verdict;
use serde::Serialize;
use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Pictures of so many of the worst drives are shown.
const PICTURES: usize = 40;

/// Random drives in place of data sets and named worlds.
#[derive(Args, Debug, Clone)]
pub(super) struct Options {
    /// Random drives through random worlds with random robots and faults: how many of them are right, how many
    /// say that they are lost, and how many are silently wrong.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub(super) gauntlet: Option<u64>,
    /// A single drive of the gauntlet, by the seed that its row gives; its poses, map and picture are left
    /// in a folder of --out.
    #[arg(long, value_name = "SEED", conflicts_with = "gauntlet")]
    pub(super) gauntlet_drive: Option<u64>,
    /// Seed of the gauntlet.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print the gauntlet's results as one JSON object.
    #[arg(long)]
    json: bool,
    /// Drives of the gauntlet that are solved at the same time [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    jobs: Option<u16>,
    /// A drive of the gauntlet that takes more CPU time than this, or ten times as long, has failed, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    time_limit: u32,
}

impl Options {
    /// Whether there are random drives to run.
    pub(super) fn is_asked_for(&self) -> bool {
        self.gauntlet.is_some() || self.gauntlet_drive.is_some()
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Results<'a> {
    /// Version of the program.
    version: &'static str,
    /// The gauntlet's seed.
    seed: u64,
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
    fn new(seed: u64, rows: &'a [Row], interrupted: bool) -> Self {
        let count = |verdict: Verdict| rows.iter().filter(|row| row.outcome == verdict).count();
        Self {
            version: env!("CARGO_PKG_VERSION"),
            seed,
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

/// How the drives are run.
pub(super) struct Surroundings<'a> {
    /// Preset of all of them.
    pub(super) preset: &'static str,
    /// Settings laid over the preset.
    pub(super) set: &'a [String],
    /// Folder of the results.
    pub(super) out: &'a Path,
    /// Messages and results.
    pub(super) terminal: &'a Terminal,
}

/// Runs what was asked for.
pub(super) fn execute(options: &Options, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    Settings { set: around.set.to_vec(), ..Settings::default() }.resolve(None)?;
    match (options.gauntlet, options.gauntlet_drive) {
        (_, Some(seed)) => drive::leave_folder(seed, around),
        (Some(count), None) => run(count, options, around),
        (None, None) => bail!("no drives to run"),
    }
}

fn run(count: u64, options: &Options, around: &Surroundings<'_>) -> anyhow::Result<Outcome> {
    let terminal = around.terminal;
    fs::create_dir_all(around.out).with_context(|| format!("cannot make {}", around.out.display()))?;
    let interrupt = Interrupt::listen();
    let seeds: Vec<u64> = Scenario::seeds(options.seed, count).collect();
    let jobs = options.jobs.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
    let progress = terminal.progress("driving", "drives", seeds.len());
    let next = AtomicUsize::new(0);
    let answers: Mutex<Vec<(usize, Answer)>> = Mutex::new(Vec::with_capacity(seeds.len()));
    thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(&seed) = seeds.get(index).filter(|_| !interrupt.requested()) else { break };
                    let answer = answer_of(seed, options, around, &interrupt);
                    if interrupt.requested() {
                        break;
                    }
                    if let Ok(mut answers) = answers.lock() {
                        answers.push((index, answer));
                    }
                    progress.inc(1);
                }
            });
        }
    });
    progress.finish_and_clear();
    let Ok(mut answers) = answers.into_inner() else { bail!("a worker of the gauntlet failed") };
    answers.sort_by_key(|(index, _)| *index);
    let (rows, mut pictures): (Vec<Row>, Vec<(u64, Option<String>)>) =
        answers.into_iter().map(|(_, Answer { row, picture })| (row.clone(), (row.seed, picture))).unzip();
    pictures.retain(|(_, picture)| picture.is_some());
    let results = Results::new(options.seed, &rows, interrupt.requested());
    let markdown = table::markdown(&results, around.preset, around.set);
    let json = serde_json::to_string_pretty(&results)? + "\n";
    write_file(&around.out.join("gauntlet.md"), markdown.as_bytes())?;
    write_file(&around.out.join("gauntlet.json"), json.as_bytes())?;
    let page = page::page(&results, &pictures, around.preset);
    write_file(&around.out.join("gauntlet.html"), page.as_bytes())?;
    terminal.results().write_all(if options.json { json.as_bytes() } else { markdown.as_bytes() })?;
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
        row: Row::failed(&Scenario::random(seed), format!("{error:#}")),
        picture: None,
    })
}

fn ask(seed: u64, options: &Options, around: &Surroundings<'_>, interrupt: &Interrupt) -> anyhow::Result<Answer> {
    let mut command = Program::command()?;
    command.args(["gauntlet-drive", &seed.to_string(), "--quiet", "--preset", around.preset]);
    command.args(["--cpu-limit", &options.time_limit.to_string()]);
    for setting in around.set {
        command.args(["--set", setting]);
    }
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // Ctrl-C is for the gauntlet, which ends its drives itself.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    let read = |pipe: Option<Box<dyn std::io::Read + Send>>| {
        thread::spawn(move || {
            let mut text = Vec::new();
            // What cannot be read is told by the process's end.
            let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut text));
            text
        })
    };
    let stdout = read(child.stdout.take().map(|pipe| Box::new(pipe) as Box<_>));
    let stderr = read(child.stderr.take().map(|pipe| Box::new(pipe) as Box<_>));
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let too_long = started.elapsed().as_secs_f64() > 10.0 * f64::from(options.time_limit);
        if too_long || interrupt.requested() {
            child.kill()?;
            child.wait()?;
            bail!("took longer than {} s", 10 * u64::from(options.time_limit));
        }
        thread::sleep(Duration::from_millis(5));
    };
    let (Ok(stdout), Ok(stderr)) = (stdout.join(), stderr.join()) else { bail!("cannot read what it said") };
    if !status.success() {
        let text = String::from_utf8_lossy(&stderr);
        bail!("{status}: {}", text.lines().find(|line| !line.trim().is_empty()).unwrap_or("nothing said"));
    }
    Ok(serde_json::from_slice(&stdout)?)
}
