//! `floorprint bench`: presets over logs and seeds, with accuracy and cost.
//!
//! Each run is a process of its own, so that its CPU time and its memory are its own.

use crate::config::Settings;
use crate::outcome::Outcome;
use crate::run_folder::data_set_name;
use crate::stopwatch::children_cpu_time_s;
use crate::terminal::Terminal;
use anyhow::{Context as _, bail};
use clap::Args;
use floorprint::config::Preset;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use std::{env, fs};

/// Run presets over data sets with several seeds; tell accuracy and cost.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data sets, or folders that hold some at any depth (CARMEN and encoder logs, ECE276A folders).
    #[arg(required = true, value_name = "DIR")]
    paths: Vec<PathBuf>,
    /// Preset to measure. Can be repeated [default: all].
    #[arg(long, value_name = "NAME", value_parser = |name: &str| name.parse::<Preset>())]
    preset: Vec<Preset>,
    /// Number of seeds.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Threads of each run.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: u16,
    /// Single setting for all runs, e.g. filter.particles=60. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Paint the floor, too, where there are images.
    #[arg(long)]
    texture: bool,
    /// Folder for bench.md and bench.json.
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
}

/// One preset on one data set, over all seeds.
#[derive(Debug, Serialize)]
struct Row {
    data_set: String,
    preset: &'static str,
    runs: Vec<Run>,
}

/// One run.
#[derive(Debug, Serialize)]
struct Run {
    seed: u64,
    /// Mean translation error over the benchmark's relations, else the RMSE against the true trajectory, metres.
    translation_m: Option<f64>,
    /// The same for rotation, degrees.
    rotation_deg: Option<f64>,
    /// F1 of occupied cells against the true map.
    map_f1: Option<f64>,
    /// Share of wall cells with a second wall close by.
    doubled_share: Option<f64>,
    /// User and system time of the whole process, seconds.
    cpu_s: Option<f64>,
    wall_s: f64,
    peak_memory_bytes: Option<f64>,
    /// Length of the drive, seconds.
    duration_s: f64,
}

/// Runs `floorprint bench`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    // Misspelt settings are told before an hour of runs.
    Settings { set: arguments.set.clone(), ..Settings::default() }.resolve(None)?;
    let mut data_sets = Vec::new();
    for path in &arguments.paths {
        find_data_sets(path, &mut data_sets).with_context(|| format!("cannot look into {}", path.display()))?;
    }
    if data_sets.is_empty() {
        bail!("no data sets found; expected .clf, .log or .dat files (also .gz), or ECE276A folders");
    }
    let presets = if arguments.preset.is_empty() { Preset::ALL.to_vec() } else { arguments.preset.clone() };
    let runs = data_sets.len() * presets.len() * arguments.seeds as usize;
    let progress = terminal.progress("measuring", "runs", runs);
    let mut rows = Vec::new();
    let mut failures = 0;
    for data_set in &data_sets {
        for &preset in &presets {
            let mut row = Row { data_set: data_set_name(data_set), preset: preset.name(), runs: Vec::new() };
            for seed in 0..arguments.seeds {
                match measure(arguments, data_set, preset, seed) {
                    Ok(run) => row.runs.push(run),
                    Err(error) => {
                        failures += 1;
                        progress.suspend(|| {
                            terminal.warn(&format!("{}, {}: {error:#}", data_set.display(), preset.name()))
                        });
                    }
                }
                progress.inc(1);
            }
            rows.push(row);
        }
    }
    progress.finish_and_clear();

    let markdown = table(&rows, arguments);
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    floorprint_io::write_file(&arguments.out.join("bench.md"), markdown.as_bytes())?;
    floorprint_io::write_file(&arguments.out.join("bench.json"), serde_json::to_string_pretty(&rows)?.as_bytes())?;
    terminal.results().write_all(markdown.as_bytes())?;
    Ok(if failures == 0 { Outcome::Fine } else { Outcome::Failed })
}

/// Appends the data sets at `path` or below it, in the order of their names.
fn find_data_sets(path: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !path.is_dir() {
        found.push(path.to_path_buf());
        return Ok(());
    }
    let mut entries: Vec<PathBuf> =
        fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    entries.sort();
    let name = |entry: &Path| entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if entries.iter().any(|entry| name(entry).starts_with("Hokuyo")) {
        found.push(path.to_path_buf());
        return Ok(());
    }
    for entry in entries {
        let name = name(&entry);
        let log = name.strip_suffix(".gz").unwrap_or(&name);
        if entry.is_dir() {
            find_data_sets(&entry, found)?;
        } else if [".clf", ".log", ".dat"].iter().any(|ending| log.ends_with(ending)) {
            found.push(entry);
        }
    }
    Ok(())
}

/// One run in a process of its own.
fn measure(arguments: &Arguments, data_set: &Path, preset: Preset, seed: u64) -> anyhow::Result<Run> {
    let out = arguments.out.join(format!("{}-{}-{seed}", data_set_name(data_set), preset.name()));
    let mut command = Command::new(env::current_exe()?);
    command.arg("run").arg(data_set).args(["--quiet", "--force", "--max-dropped", "1", "--preset", preset.name()]);
    command.args(["--seed", &seed.to_string(), "--threads", &arguments.threads.to_string()]);
    command.arg("--out").arg(&out);
    for setting in &arguments.set {
        command.args(["--set", setting]);
    }
    if !arguments.texture {
        command.arg("--no-texture");
    }
    let usage = run_to_its_end(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()))?;
    let report: Value = serde_json::from_slice(&fs::read(out.join("report.json"))?)?;
    let number = |pointer: &str| report.pointer(pointer).and_then(Value::as_f64);
    Ok(Run {
        seed,
        translation_m: number("/errors/relations/all/translation_m/mean")
            .or(number("/errors/trajectory/translation_m/rmse")),
        rotation_deg: number("/errors/relations/all/rotation_deg/mean")
            .or(number("/errors/trajectory/rotation_deg/rmse")),
        map_f1: number("/errors/map/f1"),
        doubled_share: number("/map/walls/doubled_share"),
        cpu_s: usage.cpu_s,
        wall_s: usage.wall_s,
        peak_memory_bytes: number("/cost/peak_memory_bytes"),
        duration_s: number("/drive/duration_s").unwrap_or(0.0),
    })
}

/// The rows as Markdown.
fn table(rows: &[Row], arguments: &Arguments) -> String {
    let mut text = format!(
        "Floorprint {}, {} seed{}, {} thread{} a run. Errors are the mean over the seeds (the worst seed in brackets): \
         against the benchmark's relations where there are any, else RMSE against the true trajectory. \
         CPU time and memory are those of the whole process.\n\n\
         | data set | preset | translation m | rotation ° | map F1 | double walls % | CPU s | wall s | memory MB | × real time |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
        env!("CARGO_PKG_VERSION"),
        arguments.seeds,
        if arguments.seeds == 1 { "" } else { "s" },
        arguments.threads,
        if arguments.threads == 1 { "" } else { "s" },
    );
    for row in rows {
        let column = |value: fn(&Run) -> Option<f64>| row.runs.iter().filter_map(value).collect::<Vec<_>>();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let plain = |values: Vec<f64>, scale: f64, decimals: usize| {
            if values.is_empty() { "–".to_owned() } else { format!("{:.decimals$}", mean(&values) * scale) }
        };
        let with_worst = |values: Vec<f64>, decimals: usize| match values.iter().copied().reduce(f64::max) {
            None => "–".to_owned(),
            Some(worst) => format!("{:.decimals$} ({worst:.decimals$})", mean(&values)),
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            row.data_set,
            row.preset,
            with_worst(column(|run| run.translation_m), 4),
            with_worst(column(|run| run.rotation_deg), 3),
            plain(column(|run| run.map_f1), 1.0, 3),
            plain(column(|run| run.doubled_share), 100.0, 2),
            plain(column(|run| run.cpu_s), 1.0, 2),
            plain(column(|run| Some(run.wall_s)), 1.0, 2),
            plain(column(|run| run.peak_memory_bytes), 1e-6, 0),
            plain(column(|run| Some(run.duration_s / run.wall_s)), 1.0, 0),
        );
    }
    text
}

/// What a process cost.
struct Usage {
    cpu_s: Option<f64>,
    wall_s: f64,
}

/// Runs a command to its end; fails with what it wrote to stderr when it fails.
fn run_to_its_end(command: &mut Command) -> anyhow::Result<Usage> {
    let before_s = children_cpu_time_s();
    let started = Instant::now();
    let output = command.output()?;
    let wall_s = started.elapsed().as_secs_f64();
    if !output.status.success() {
        bail!("{}", String::from_utf8_lossy(&output.stderr).trim());
    }
    let cpu_s = children_cpu_time_s().zip(before_s).map(|(after_s, before_s)| after_s - before_s);
    Ok(Usage { cpu_s, wall_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(seed: u64, translation_m: f64) -> Run {
        Run {
            seed,
            translation_m: Some(translation_m),
            rotation_deg: None,
            map_f1: None,
            doubled_share: None,
            cpu_s: Some(2.0),
            wall_s: 1.0,
            peak_memory_bytes: Some(5e6),
            duration_s: 100.0,
        }
    }

    #[test]
    fn rows_give_the_mean_and_the_worst() {
        let arguments = Arguments {
            paths: vec![],
            preset: vec![],
            seeds: 2,
            threads: 1,
            set: vec![],
            texture: false,
            out: PathBuf::new(),
        };
        let rows = [Row { data_set: "a".into(), preset: "default", runs: vec![run(0, 0.01), run(1, 0.03)] }];
        let text = table(&rows, &arguments);
        assert!(text.ends_with("| a | default | 0.0200 (0.0300) | – | – | – | 2.00 | 1.00 | 5 | 100 |\n"), "{text}");
    }
}
