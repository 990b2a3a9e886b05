//! `floorprint calibrate`: what a drive tells of the robot, as a configuration for its next drives.

use crate::config::Settings;
use crate::outcome::Outcome;
use crate::terminal::{HEADING, Terminal, prose};
use crate::topics::Topics;
use anyhow::Context as _;
use clap::Args;
use floorprint::calibration::{Calibration, Parameter, Unit};
use floorprint_io::{open, write_file};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use toml::{Table, Value};

/// Calibrate wheels, odometry, gyro, LiDAR mounts and clocks from an ordinary drive, without targets.
///
/// The LiDAR's own motion, by its scans, is compared with what wheels, gyro and odometry state. Each value comes with
/// its uncertainty; what this drive cannot tell is said, with what to drive so that it can. The mount is measured from
/// the point about which the robot turns: for a differential drive the middle of its axle.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file or a folder, recognised by its content.
    path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    /// Write what was found as a configuration that `--config` takes.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    settings: Settings,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Told<'a> {
    /// SHA-256 of the data set.
    sha256: &'a str,
    stretches: usize,
    residual_m: f64,
    residual_rad: f64,
    parameters: &'a [Parameter],
}

/// Runs `floorprint calibrate`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let data_set = open(&arguments.path, &arguments.topics.open_options(arguments.drive, None))?;
    let config = arguments.settings.resolve(Some(&data_set.robot))?;
    let busy = terminal.busy("comparing scans and odometry");
    let calibration = Calibration::of(&data_set.records, &config)
        .with_context(|| format!("cannot calibrate by {}", arguments.path.display()));
    busy.finish_and_clear();
    let calibration = calibration?;
    let mut out = terminal.results();
    if arguments.json {
        let [residual_m, residual_rad] = calibration.residual;
        let told = Told {
            sha256: &data_set.input_hash,
            stretches: calibration.stretches,
            residual_m,
            residual_rad,
            parameters: &calibration.parameters,
        };
        writeln!(out, "{}", serde_json::to_string_pretty(&told)?)?;
    } else {
        write_table(&mut out, &calibration)?;
    }
    out.flush()?;
    if let Some(path) = &arguments.out {
        let heading = format!("{} (SHA-256 {})", arguments.path.display(), data_set.input_hash);
        write_file(path, document(&calibration, &heading)?.as_bytes())?;
        terminal.say(&format!("written to {}; use it with --config {}", path.display(), path.display()));
    }
    Ok(Outcome::Fine)
}

fn write_table(out: &mut impl std::io::Write, calibration: &Calibration) -> anyhow::Result<()> {
    let width = calibration.parameters.iter().map(|parameter| parameter.key.len()).max().unwrap_or(0);
    writeln!(out, "{HEADING}{:width$}  {:>10}  {:>10}  {:>9}{HEADING:#}", "parameter", "configured", "found", "±")?;
    for parameter in &calibration.parameters {
        let [before, found, sigma] =
            [parameter.before, parameter.found, parameter.sigma].map(|value| shown(value, parameter.unit));
        if parameter.is_told {
            writeln!(out, "{:width$}  {before:>10}  {found:>10}  {sigma:>9}  {}", parameter.key, name(parameter.unit))?;
        } else {
            writeln!(out, "{:width$}  {before:>10}  {:>10}  not told by this drive", parameter.key, "–")?;
        }
    }
    let mut advice: Vec<&str> = Vec::new();
    for parameter in calibration.parameters.iter().filter(|parameter| !parameter.is_told) {
        if !advice.contains(&parameter.advice) {
            advice.push(parameter.advice);
        }
    }
    for advice in advice {
        writeln!(out, "{}", prose(&format!("to have the rest told, {advice}"), 0))?;
    }
    let [residual_m, residual_rad] = calibration.residual;
    let compared = format!(
        "compared over {} stretches of up to a metre or 40°; they differ by {:.1} mm and {:.2}° (standard deviations)",
        calibration.stretches,
        1000.0 * residual_m,
        residual_rad.to_degrees()
    );
    writeln!(out, "{}", prose(&compared, 0))?;
    Ok(())
}

fn shown(value: f64, unit: Unit) -> String {
    match unit {
        Unit::Metres | Unit::Radians | Unit::Factor | Unit::Seconds => format!("{value:.4}"),
        Unit::MetresPerTick => format!("{value:.7}"),
    }
}

fn name(unit: Unit) -> &'static str {
    match unit {
        Unit::Metres => "m",
        Unit::Radians => "rad",
        Unit::Factor => "",
        Unit::MetresPerTick => "m/tick",
        Unit::Seconds => "s",
    }
}

/// The configuration, with what each value rests on.
fn document(calibration: &Calibration, data_set: &str) -> anyhow::Result<String> {
    let robot = Value::try_from(&calibration.robot).context("the calibration cannot be written as TOML")?;
    let mut document = format!("# Calibrated by floorprint {} from {data_set}\n", env!("CARGO_PKG_VERSION"));
    let mut table = Table::new();
    for parameter in &calibration.parameters {
        let Parameter { key, sigma, advice, .. } = parameter;
        let sigma = shown(*sigma, parameter.unit);
        if parameter.is_told {
            writeln!(document, "# {key}: ± {sigma} {}", name(parameter.unit))?;
        } else {
            writeln!(document, "# {key}: not told by this drive; {advice}")?;
        }
        // Lists are written whole.
        let path: Vec<&str> = key.split(['.', '[']).skip(1).take_while(|part| !part.ends_with(']')).collect();
        let found = path.iter().try_fold(&robot, |value, part| value.get(part));
        if let Some(value) = found.filter(|_| parameter.is_told) {
            insert(&mut table, &["robot"].into_iter().chain(path).collect::<Vec<_>>(), value.clone());
        }
    }
    document.push('\n');
    document.push_str(&table.to_string());
    Ok(document)
}

/// Puts a value where it belongs in tables in tables.
fn insert(table: &mut Table, path: &[&str], value: Value) {
    match path {
        [] => {}
        [key] => {
            table.insert((*key).to_owned(), value);
        }
        [section, rest @ ..] => {
            let section = table.entry((*section).to_owned()).or_insert_with(|| Value::Table(Table::new()));
            if let Value::Table(section) = section {
                insert(section, rest, value);
            }
        }
    }
}
