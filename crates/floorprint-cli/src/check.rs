//! `floorprint check`: what is wrong with a recording, before it becomes a wrong map.

use crate::config::Settings;
use crate::outcome::Outcome;
use crate::terminal::{HEADING, Terminal, prose};
use crate::topics::Topics;
use anyhow::{anyhow, bail};
use clap::Args;
use floorprint::doctor::{Severity, Symptom, examine};
use floorprint_io::{DriveEntry, OpenOptions, drives, open};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Look for what is wrong with a recording: units, stamps, clocks, mounts, signs. Exit code 1 if there can be no map.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file or a folder, recognised by its content; - for standard input. Of several drives each is looked at.
    path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    settings: Settings,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A symptom with what is to be said of it.
#[derive(Debug, Clone, Serialize)]
pub struct Told {
    severity: Severity,
    #[serde(flatten)]
    symptom: Symptom,
    evidence: String,
    effect: &'static str,
    remedy: String,
}

/// What is wrong with a recording.
///
/// # Errors
/// It cannot be read; whatever is wrong with a setting.
pub fn examine_recording(path: &Path, options: &OpenOptions, settings: &Settings) -> anyhow::Result<Vec<Told>> {
    let data_set = open(path, options)?;
    let config = settings.resolve(Some(&data_set.robot))?;
    Ok(examine(&data_set.records, &config).iter().map(Told::of).collect())
}

/// Runs `floorprint check`: of a folder with several drives on each of them.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let options = arguments.topics.open_options(arguments.drive, None);
    let drives = drives(&arguments.path, &options)?;
    let mut out = terminal.results();
    let outcome = if drives.len() > 1 {
        check_all(arguments, &options, &drives, &mut out)?
    } else {
        let (told, outcome) = check(&arguments.path, &options, &arguments.settings)?;
        if arguments.json {
            writeln!(out, "{}", serde_json::to_string_pretty(&told)?)?;
        } else if !told.is_empty() || outcome.is_ok() {
            print(&told, &arguments.path.display().to_string(), false, &mut out)?;
        }
        outcome
    };
    out.flush()?;
    outcome
}

/// What is wrong with a recording, and what comes of it: an error where it holds no scan.
type Checked = (Vec<Told>, anyhow::Result<Outcome>);

fn check(path: &Path, options: &OpenOptions, settings: &Settings) -> anyhow::Result<Checked> {
    let data_set = open(path, options)?;
    let config = settings.resolve(Some(&data_set.robot))?;
    let symptoms = examine(&data_set.records, &config);
    let told = symptoms.iter().map(Told::of).collect();
    if data_set.scans().next().is_none() {
        let found = match &data_set.bag {
            Some(bag) => format!("it holds no scan; its topics: {}", bag.list_of_topics()),
            None => "there is no LiDAR and so no map, only dead reckoning".to_owned(),
        };
        return Ok((told, Err(anyhow!("{}: {found}", path.display()))));
    }
    let is_hopeless = symptoms.iter().any(|symptom| symptom.severity() == Severity::Fatal);
    Ok((told, Ok(if is_hopeless { Outcome::Failed } else { Outcome::Fine })))
}

/// What is wrong with each of several drives.
#[derive(Serialize)]
struct CheckedDrive<'a> {
    #[serde(flatten)]
    drive: &'a DriveEntry,
    findings: Vec<Told>,
    /// Why there can be no map, where there are no findings to say so.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

fn check_all(
    arguments: &Arguments,
    options: &OpenOptions,
    drives: &[DriveEntry],
    out: &mut impl Write,
) -> anyhow::Result<anyhow::Result<Outcome>> {
    let mut all = Vec::new();
    let mut worst = Outcome::Fine;
    for drive in drives {
        let options = OpenOptions { drive: drive.drive, ..options.clone() };
        let (findings, outcome) = match check(&drive.path, &options, &arguments.settings) {
            Ok((findings, outcome)) => (findings, outcome),
            Err(error) => (Vec::new(), Err(error)),
        };
        if !matches!(outcome, Ok(Outcome::Fine)) {
            worst = Outcome::Failed;
        }
        let error = outcome.err().map(|error| format!("{error:#}"));
        if !arguments.json {
            match &error {
                Some(_) if findings.is_empty() => writeln!(out, "{HEADING}{}{HEADING:#}", drive.arguments())?,
                _ => print(&findings, &drive.arguments(), true, out)?,
            }
            if let Some(error) = &error {
                writeln!(out, "{}", prose(&format!("{HEADING}error{HEADING:#}: {error}"), 0))?;
            }
        }
        all.push(CheckedDrive { drive, findings, error });
    }
    if arguments.json {
        writeln!(out, "{}", serde_json::to_string_pretty(&all)?)?;
    }
    Ok(Ok(worst))
}

fn print(told: &[Told], name: &str, is_one_of_several: bool, out: &mut impl Write) -> anyhow::Result<()> {
    if told.is_empty() {
        writeln!(out, "nothing seems wrong with {name}")?;
    } else if is_one_of_several {
        writeln!(out, "{HEADING}{name}{HEADING:#}")?;
    }
    for Told { severity, evidence, effect, remedy, .. } in told {
        writeln!(out, "{}", prose(&format!("{HEADING}{}{HEADING:#}: {evidence}", word(*severity)), 0))?;
        writeln!(out, "  {}", prose(&format!("effect: {effect}"), 2))?;
        writeln!(out, "  {}", prose(&format!("remedy: {remedy}"), 2))?;
    }
    Ok(())
}

impl Told {
    fn of(symptom: &Symptom) -> Self {
        Self {
            severity: symptom.severity(),
            symptom: *symptom,
            evidence: symptom.to_string(),
            effect: symptom.effect(),
            remedy: symptom.remedy(),
        }
    }
}

fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Note => "note",
        Severity::Warning => "warning",
        Severity::Error => "error",
        Severity::Fatal => "no map",
    }
}

/// All of a symptom in one line.
pub(crate) fn sentence(symptom: &Symptom) -> String {
    format!("{symptom}. {}. {}", symptom.effect(), symptom.remedy())
}

/// Ends the work where there can be no map.
///
/// # Errors
/// There can be none.
pub(crate) fn refuse_hopeless(symptoms: &[Symptom], path: &Path) -> anyhow::Result<()> {
    match symptoms.iter().find(|symptom| symptom.severity() == Severity::Fatal) {
        Some(symptom) => bail!("no map can be made of {}: {}", path.display(), sentence(symptom)),
        None => Ok(()),
    }
}

/// Says what may have spoilt the map.
pub(crate) fn tell(symptoms: &[Symptom], terminal: &Terminal) {
    for symptom in symptoms.iter().filter(|symptom| symptom.severity() >= Severity::Warning) {
        terminal.warn(&sentence(symptom));
    }
}
