//! `floorprint batch`: logs × presets × seeds, each run a process of its own; results in one SQLite file.

mod job;
mod store;

use crate::bench::{DataSet, find_data_sets};
use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::number::number;
use crate::outcome::{BadArguments, Outcome};
use crate::summary::counted;
use crate::terminal::{HEADING, Terminal};
use crate::topics::Topics;
use anyhow::Context as _;
use clap::Args;
use floorprint::config::Preset;
use floorprint_io::read_text;
use job::{Job, Limits, Row, Status};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, mpsc};
use std::thread;
use store::Store;

/// Solve many logs, each with each preset and seed, on all cores; results.sqlite holds a row for each run.
///
/// A log that crashes, hangs or cannot be read is a row that says why. What was stopped goes on when it is started again:
/// the same input, configuration, seed and version are not run twice.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Logs, folders of logs, or text files (.txt) with the path of a log in each line.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Preset to run. Can be repeated.
    #[arg(long, value_name = "NAME", default_value = "default", value_parser = |name: &str| name.parse::<Preset>())]
    preset: Vec<Preset>,
    /// Seeds for each log and preset: 0 to N − 1.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// TOML file laid over the preset.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Single setting laid over all else. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    topics: Topics,
    /// Folder of results.sqlite, and of the runs with --keep.
    #[arg(long, value_name = "DIR", default_value = "runs/batch")]
    out: PathBuf,
    /// Runs at a time [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    jobs: Option<u16>,
    /// Threads of each run.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: u16,
    /// A run that takes longer is ended, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 3600.0, value_parser = number(0.1, 1e9))]
    time_limit: f64,
    /// A run that needs more memory is ended, megabytes (Linux).
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    memory_limit: Option<u64>,
    /// Leave the floors unpainted.
    #[arg(long)]
    no_texture: bool,
    /// Keep each run's folder below runs/, with maps and pages.
    #[arg(long)]
    keep: bool,
    /// Run again what was not done: failed, crashed, timed out.
    #[arg(long)]
    retry: bool,
}

/// Runs `floorprint batch`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let interrupt = Interrupt::listen();
    let logs = find_data_sets(&arguments.paths()?)?;
    fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the folder {}", arguments.out.display()))?;
    let path = arguments.out.join("results.sqlite");
    let store = Store::open(&path)?;
    let mut jobs = Vec::new();
    let reading = terminal.progress("hashing", "logs", logs.len());
    for log in &logs {
        let input_sha256 =
            store.input_hash(&log.path).with_context(|| format!("cannot read {}", log.path.display()))?;
        jobs.extend(arguments.jobs_of(log, &input_sha256)?);
        reading.inc(1);
    }
    reading.finish_and_clear();
    let planned = jobs.len();
    if arguments.retry {
        store.forget_what_was_not_done(&jobs)?;
    }
    let known = store.known(&jobs)?;
    jobs = jobs.into_iter().zip(&known).filter(|(_, known)| !**known).map(|(job, _)| job).collect();
    // One input under two names is one run.
    let mut keys = BTreeSet::new();
    jobs.retain(|job| {
        let (input, config, seed) = job.key();
        keys.insert((input.to_owned(), config.to_owned(), seed))
    });
    if jobs.len() < planned {
        terminal.note(&format!("{} of {} are there already", planned - jobs.len(), counted(planned, "run")));
    }

    let workers = arguments.jobs.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
    let progress = terminal.progress("solving", "runs", jobs.len());
    let waiting = Mutex::new(jobs.into_iter());
    let (told, rows) = mpsc::channel::<(Job, anyhow::Result<Option<Row>>)>();
    let outcome = thread::scope(|scope| -> anyhow::Result<()> {
        for _ in 0..workers {
            let (told, waiting, interrupt) = (told.clone(), &waiting, &interrupt);
            scope.spawn(move || {
                while !interrupt.requested() {
                    let Some(job) = waiting.lock().unwrap_or_else(PoisonError::into_inner).next() else { break };
                    let row = job.run(&arguments.limits(), &arguments.out, interrupt);
                    if told.send((job, row)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(told);
        for (job, row) in rows {
            // A run that was stopped is run again the next time.
            let Some(row) = row? else { continue };
            if let Some(error) = &row.error {
                terminal.warn(&format!("{}, {}, seed {}: {error}", job.log.display(), job.preset.name(), job.seed));
            }
            store.add(&job, &row)?;
            progress.inc(1);
        }
        Ok(())
    });
    progress.finish_and_clear();
    outcome?;
    if !terminal.is_quiet() {
        let mut out = terminal.results();
        writeln!(
            out,
            "{HEADING}{:<10} {:>5} {:>7} {:>8} {:>9}  {:>12} {:>9}{HEADING:#}",
            "preset", "done", "failed", "crashed", "timed out", "mean error, m", "CPU, s"
        )?;
        for line in store.summary()? {
            let counts = Status::ALL.map(|status| line.counts[status as usize]);
            let [done, failed, crashed, timed_out] = counts;
            let figure =
                |value: Option<f64>, digits: usize| value.map_or("–".to_owned(), |value| format!("{value:.digits$}"));
            let (error, cpu) = (figure(line.mean_error_m, 4), figure(line.cpu_s, 1));
            writeln!(
                out,
                "{:<10} {done:>5} {failed:>7} {crashed:>8} {timed_out:>9}  {error:>13} {cpu:>9}",
                line.preset
            )?;
        }
        writeln!(out, "results     {}", path.display())?;
    }
    if interrupt.requested() {
        terminal.warn("stopped before its end: the same command goes on");
        return Ok(Outcome::Interrupted);
    }
    Ok(Outcome::Fine)
}

impl Arguments {
    /// The paths that are named, on the command line and in lists.
    fn paths(&self) -> anyhow::Result<Vec<PathBuf>> {
        let mut paths = Vec::new();
        for path in &self.logs {
            if path.extension().is_none_or(|ending| ending != "txt") || !path.is_file() {
                paths.push(path.clone());
                continue;
            }
            let folder = path.parent().unwrap_or(Path::new(""));
            let text = read_text(path)?;
            let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
            let before = paths.len();
            paths.extend(lines.map(|line| folder.join(line)));
            if paths.len() == before {
                return Err(BadArguments(format!("{}: no log in the list", path.display())).into());
            }
        }
        Ok(paths)
    }

    fn jobs_of(&self, log: &DataSet, input_sha256: &str) -> anyhow::Result<Vec<Job>> {
        let mut jobs = Vec::new();
        for &preset in &self.preset {
            let settings = Settings { preset, config: self.config.clone(), set: self.set.clone(), seed: None };
            let config = settings.resolve(None)?;
            // What the robot's calibration adds is the input's; what the command line adds to the input is here.
            let mut hash = Sha256::new();
            for part in [preset.name(), preset.toml(), &config.to_toml(), &format!("{:?}", self.topics)] {
                hash.update(part.as_bytes());
                hash.update([0]);
            }
            if let Some(path) = &self.config {
                hash.update(read_text(path)?.as_bytes());
            }
            hash.update([u8::from(self.no_texture)]);
            let config_sha256 = hex(&hash.finalize());
            for seed in 0..self.seeds {
                jobs.push(Job {
                    log: log.path.clone(),
                    name: format!("{}-{}-{seed}", log.name, preset.name()),
                    input_sha256: input_sha256.to_owned(),
                    config_sha256: config_sha256.clone(),
                    preset,
                    config: self.config.clone(),
                    set: self.set.clone(),
                    seed,
                    topics: self.topics.clone(),
                    no_texture: self.no_texture,
                });
            }
        }
        Ok(jobs)
    }

    fn limits(&self) -> Limits {
        Limits { threads: self.threads, time_s: self.time_limit, memory_mb: self.memory_limit, keeps: self.keep }
    }
}

/// Bytes as hexadecimal digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
