//! `floorprint bench`: presets over logs, simulated worlds and seeds, with accuracy and cost.
//!
//! Each run is a process of its own, so that its CPU time and its memory are its own.

mod book;
mod data_sets;
mod drives;
mod gauntlet;
mod growth;
mod localization;
mod machine;
mod run;
mod simulated;
mod table;

pub(crate) use data_sets::{DataSet, find as find_data_sets};
pub(crate) use gauntlet::{DriveArguments as GauntletDriveArguments, execute_drive as execute_gauntlet_drive};
pub(crate) use localization::{
    DriveArguments as LocalizationDriveArguments, execute_drive as execute_localization_drive,
};
pub(crate) use machine::today;
pub(crate) use simulated::{Arguments as DriveArguments, execute as execute_drive};

use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::number::number;
use crate::outcome::{BadArguments, Outcome};
use crate::program::Program;
use crate::stopwatch::children_cpu_time_s;
use crate::terminal::{self, Terminal};
use crate::topics::Topics;
use anyhow::{Context as _, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;
use floorprint::config::Preset;
use floorprint::front_end::FilterKind;
use floorprint::simulator::World;
use floorprint_io::write_files;
use machine::Machine;
use run::Run;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use simulated::Lidar;
use std::env;
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Run presets over data sets and simulated worlds with several seeds; tell accuracy and cost.
///
/// Leaves bench.md and bench.json in the folder of --out, a folder for each run on a data set, and
/// growth.svg with --growth; with --gauntlet gauntlet.md, gauntlet.json and gauntlet.html; with --localization
/// localization.md and localization.json. Ctrl-C ends it with the table of the runs so far.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data sets, or folders that hold some at any depth (CARMEN and encoder logs, bags, ECE276A folders).
    #[arg(value_name = "DIR")]
    paths: Vec<PathBuf>,
    /// Simulated world to drive through and compare with its truth. Can be repeated.
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(World::names()))]
    world: Vec<String>,
    /// How cost and error grow with the drive: simulated offices of about these lengths in km,
    /// e.g. 0.5,1,2,5,10.
    #[arg(long, value_name = "KM,…", value_delimiter = ',', value_parser = number(0.1, 100.0))]
    growth: Vec<f64>,
    /// Preset to measure. Can be repeated [default: all; of --growth: default].
    #[arg(long, value_name = "NAME", value_parser = |name: &str| name.parse::<Preset>())]
    preset: Vec<Preset>,
    /// Number of seeds [default: 5; of --growth: 1]. What fails with the first one is not tried with the others.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// Threads of each run.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: u16,
    /// Single setting for all runs, e.g. filter.particles=60. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Paint the floor, too, where there are images.
    #[arg(long)]
    texture: bool,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    lidar: Lidar,
    #[command(flatten)]
    gauntlet: gauntlet::Options,
    #[command(flatten)]
    localization: localization::Options,
    #[command(flatten)]
    drives: drives::Options,
    /// Folder of the results.
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
    /// Print the JSON schema of bench.json instead.
    #[arg(long)]
    schema: bool,
    /// Make the tables in this Markdown file anew from the stored figures that it names, instead.
    #[arg(long, value_name = "FILE", conflicts_with = "schema")]
    render: Option<PathBuf>,
    /// Measure what this stored bench.json holds of the data sets and does not depend on chance once more, and of the worlds
    /// with the first seeds [default: 1], instead; fail where a figure differs.
    #[arg(long, value_name = "JSON", conflicts_with_all = ["schema", "render"])]
    verify: Option<PathBuf>,
}

/// What `bench.json` says.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
struct Benchmark {
    /// Version of this format.
    schema: u32,
    /// Version of the program.
    version: String,
    /// When it ran, UTC, as 2026-01-31.
    date: String,
    /// Where it ran.
    machine: Machine,
    /// Threads of each run.
    threads: u16,
    /// Settings laid over the presets.
    settings: Vec<String>,
    /// The simulated LiDAR; null without simulated worlds.
    simulated_lidar: Option<String>,
    /// Whether the user stopped it before its end.
    interrupted: bool,
    /// Presets on data sets.
    data_sets: Vec<Row>,
    /// Presets in simulated worlds.
    worlds: Vec<Row>,
    /// Presets in simulated offices of growing length.
    growth: Vec<Row>,
    /// Runs that gave no figures.
    failures: Vec<Failure>,
}

/// One preset on one data set or in one world, over all seeds.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
struct Row {
    /// The data set or the world.
    name: String,
    /// The preset.
    preset: String,
    /// One entry for each seed; a single one where the preset draws nothing at random.
    runs: Vec<Run>,
}

/// A run that gave no figures.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
struct Failure {
    /// The data set or the world.
    name: String,
    /// The preset.
    preset: String,
    /// The seed.
    seed: u64,
    /// Why.
    message: String,
}

/// What is measured.
enum Case {
    DataSet(DataSet),
    World(String),
    Office { length_km: f64 },
}

impl Case {
    fn name(&self) -> String {
        match self {
            Self::DataSet(data_set) => data_set.name.clone(),
            Self::World(name) => name.clone(),
            Self::Office { length_km } => format!("office {length_km} km"),
        }
    }
}

impl Benchmark {
    fn rows_of(&mut self, case: &Case) -> &mut Vec<Row> {
        match case {
            Case::DataSet(_) => &mut self.data_sets,
            Case::World(_) => &mut self.worlds,
            Case::Office { .. } => &mut self.growth,
        }
    }
}

/// Runs `floorprint bench`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    if arguments.schema {
        writeln!(terminal.results(), "{}", serde_json::to_string_pretty(&schemars::schema_for!(Benchmark))?)?;
        return Ok(Outcome::Fine);
    }
    if let Some(document) = &arguments.render {
        return book::render(document, terminal);
    }
    if arguments.gauntlet.is_asked_for() || arguments.localization.is_asked_for() {
        let preset = arguments.preset.first().copied().unwrap_or_default().name();
        let Arguments { set, out, drives, .. } = arguments;
        let around = drives::Surroundings { preset, set, out, drives, terminal };
        return if arguments.gauntlet.is_asked_for() {
            gauntlet::execute(&arguments.gauntlet, &around)
        } else {
            localization::execute(&arguments.localization, &around)
        };
    }
    // Whatever can be wrong is told before an hour of runs.
    Settings { set: arguments.set.clone(), ..Settings::default() }.resolve(None)?;
    arguments.lidar.simulation().validate()?;
    if let Some(stored) = &arguments.verify {
        return book::verify(arguments, stored, terminal);
    }
    let cases = cases(arguments)?;
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    let mut benchmark = arguments.benchmark();
    benchmark.write(arguments)?;

    let work: Vec<(&Case, Preset, u64)> = cases
        .iter()
        .flat_map(|case| arguments.presets(case).into_iter().map(move |preset| (case, preset)))
        .flat_map(|(case, preset)| (0..arguments.seeds(case, preset)).map(move |seed| (case, preset, seed)))
        .collect();
    let interrupt = Interrupt::listen();
    let progress = terminal.progress("measuring", "runs", work.len());
    for (case, preset, seed) in work {
        let (name, preset) = (case.name(), preset.name().to_owned());
        // What fails with the first seed is not tried with the others: most often the log has not what the preset needs.
        let is_hopeless = |failure: &Failure| failure.name == name && failure.preset == preset && failure.seed == 0;
        if benchmark.failures.iter().any(is_hopeless) {
            progress.inc(1);
            continue;
        }
        let measured = arguments.measure(case, &preset, seed, &interrupt);
        if interrupt.requested() {
            // What was interrupted is no measurement.
            benchmark.interrupted = true;
            break;
        }
        match measured {
            Ok(run) => {
                let rows = benchmark.rows_of(case);
                match rows.last_mut().filter(|row| row.name == name && row.preset == preset) {
                    Some(row) => row.runs.push(run),
                    None => rows.push(Row { name, preset, runs: vec![run] }),
                }
            }
            Err(error) => {
                let message = format!("{error:#}");
                progress.suspend(|| terminal.warn(&format!("{name}, {preset}, seed {seed}: {message}")));
                benchmark.failures.push(Failure { name, preset, seed, message });
            }
        }
        benchmark.write(arguments)?;
        progress.inc(1);
    }
    progress.finish_and_clear();
    let markdown = benchmark.write(arguments)?;
    if !terminal.is_quiet() {
        terminal.results().write_all(terminal::markdown(&markdown).as_bytes())?;
    }
    if benchmark.interrupted {
        terminal.warn("stopped before its end: the table holds the runs so far");
        return Ok(Outcome::Interrupted);
    }
    Ok(if benchmark.failures.is_empty() { Outcome::Fine } else { Outcome::Failed })
}

/// Everything that was asked for, in its order.
fn cases(arguments: &Arguments) -> anyhow::Result<Vec<Case>> {
    let mut cases: Vec<Case> = data_sets::find(&arguments.paths)?.into_iter().map(Case::DataSet).collect();
    cases.extend(distinct(&arguments.world).into_iter().map(Case::World));
    cases.extend(distinct(&arguments.growth).into_iter().map(|length_km| Case::Office { length_km }));
    if cases.is_empty() {
        let advice =
            "name data sets or folders that hold some, --gauntlet N, --localization N, --world NAME, or --growth KM,…";
        return Err(BadArguments(format!("there is nothing to measure: {advice}")).into());
    }
    Ok(cases)
}

/// Each of the items once, in their order: what was asked for twice is measured once.
fn distinct<T: PartialEq + Clone>(items: &[T]) -> Vec<T> {
    let mut distinct = Vec::with_capacity(items.len());
    for item in items {
        if !distinct.contains(item) {
            distinct.push(item.clone());
        }
    }
    distinct
}

impl Arguments {
    fn presets(&self, case: &Case) -> Vec<Preset> {
        match case {
            _ if !self.preset.is_empty() => distinct(&self.preset),
            Case::Office { .. } => vec![Preset::default()],
            _ => Preset::ALL.to_vec(),
        }
    }

    fn seeds(&self, case: &Case, preset: Preset) -> u64 {
        match case {
            Case::DataSet(_) if !self.draws_at_random(preset) => 1,
            Case::Office { .. } => self.seeds.unwrap_or(1),
            _ => self.seeds.unwrap_or(5),
        }
    }

    /// Whether a run on a data set depends on the seed: one particle of its own map draws nothing.
    fn draws_at_random(&self, preset: Preset) -> bool {
        let settings = Settings { preset, set: self.set.clone(), ..Settings::default() };
        !settings
            .resolve(None)
            .is_ok_and(|config| config.filter.kind == FilterKind::RaoBlackwellized && config.filter.particles == 1)
    }

    /// Nothing measured yet.
    fn benchmark(&self) -> Benchmark {
        let simulates = !self.world.is_empty() || !self.growth.is_empty();
        Benchmark {
            schema: 1,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            date: machine::today(),
            machine: Machine::here(),
            threads: self.threads,
            settings: self.set.clone(),
            simulated_lidar: simulates.then(|| self.lidar.description()),
            interrupted: false,
            data_sets: Vec::new(),
            worlds: Vec::new(),
            growth: Vec::new(),
            failures: Vec::new(),
        }
    }

    /// One run in a process of its own.
    fn measure(&self, case: &Case, preset: &str, seed: u64, interrupt: &Interrupt) -> anyhow::Result<Run> {
        let mut command = Program::command()?;
        let out = self.out.join(format!("{}-{preset}-{seed}", case.name()));
        match case {
            Case::DataSet(_) => {
                command.args(["run", "--force", "--max-dropped", "1", "--out"]).arg(&out);
                if !self.texture {
                    command.arg("--no-texture");
                }
                self.topics.pass_on(&mut command);
            }
            Case::World(name) => {
                command.args(["bench-drive", "--world", name]);
                self.lidar.pass_on(&mut command);
            }
            Case::Office { length_km } => {
                command.args(["bench-drive", "--office-km", &length_km.to_string()]);
                self.lidar.pass_on(&mut command);
            }
        }
        command.args(["--quiet", "--preset", preset, "--seed", &seed.to_string()]);
        command.args(["--threads", &self.threads.to_string()]);
        for setting in &self.set {
            command.args(["--set", setting]);
        }
        if let Case::DataSet(data_set) = case {
            // Its name may begin as an option does.
            command.arg("--").arg(&data_set.path);
        }
        let finished = run_to_its_end(&mut command, interrupt)?;
        let Case::DataSet(data_set) = case else { return Ok(serde_json::from_slice(&finished.stdout)?) };
        let path = out.join("report.json");
        let text = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let report: Value = serde_json::from_slice(&text)?;
        Ok(Run {
            wrong_closures: data_set.wrong_closures(&report)?,
            // The report's own figures end where it is written.
            cpu_s: finished.cpu_s,
            wall_s: finished.wall_s,
            ..Run::from_report(&report)
        })
    }
}

impl Benchmark {
    /// Writes what is known by now, each file whole; gives the tables.
    fn write(&self, arguments: &Arguments) -> anyhow::Result<String> {
        let markdown = table::markdown(self);
        let out = &arguments.out;
        let json = serde_json::to_string_pretty(self)? + "\n";
        let plot = growth::plot(&self.growth);
        let [table, figures, growth] = ["bench.md", "bench.json", "growth.svg"].map(|name| out.join(name));
        let mut files = vec![(table.as_path(), markdown.as_bytes()), (figures.as_path(), json.as_bytes())];
        files.extend(plot.as_ref().map(|svg| (growth.as_path(), svg.as_bytes())));
        write_files(&files)?;
        Ok(markdown)
    }
}

/// What a process said and cost.
struct Finished {
    stdout: Vec<u8>,
    cpu_s: Option<f64>,
    wall_s: f64,
}

/// Runs a command to its end; fails with what it wrote to stderr when it fails. A request to stop is
/// handed on to it.
fn run_to_its_end(command: &mut Command, interrupt: &Interrupt) -> anyhow::Result<Finished> {
    let before_s = children_cpu_time_s();
    let started = Instant::now();
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // Ctrl-C would reach the process directly, too, and a second one ends it where it stands.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    let child = command.spawn()?;
    let process = child.id();
    let waiting = thread::spawn(move || (child.wait_with_output(), started.elapsed().as_secs_f64()));
    let mut told = false;
    while !waiting.is_finished() {
        if interrupt.requested() && !told {
            ask_to_stop(process);
            told = true;
        }
        thread::sleep(Duration::from_millis(10));
    }
    let Ok((output, wall_s)) = waiting.join() else { bail!("waiting for a run failed") };
    let output = output?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        let message = text.trim().trim_start_matches("error: ");
        bail!("{}", if message.is_empty() { output.status.to_string() } else { message.to_owned() });
    }
    let cpu_s = children_cpu_time_s().zip(before_s).map(|(after_s, before_s)| after_s - before_s);
    Ok(Finished { stdout: output.stdout, cpu_s, wall_s })
}

/// Asks a process for an orderly end, where the system has a way to.
fn ask_to_stop(process: u32) {
    #[cfg(unix)]
    {
        use nix::sys::signal::{Signal, kill};
        use nix::unistd::Pid;
        if let Ok(process) = i32::try_from(process) {
            // It may have ended by itself meanwhile.
            let _ = kill(Pid::from_raw(process), Signal::SIGINT);
        }
    }
    #[cfg(not(unix))]
    let _ = process;
}
