//! `floorprint check`: what is wrong with a recording, before it becomes a wrong map.

use crate::config::Settings;
use crate::outcome::Outcome;
use crate::terminal::{HEADING, Terminal};
use crate::topics::Topics;
use anyhow::bail;
use clap::Args;
use floorprint::doctor::{Severity, Symptom, examine};
use floorprint_io::{OpenOptions, open};
use serde::Serialize;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Look for what is wrong with a recording: units, stamps, clocks, mounts, signs. Exit code 1 if there can be no map.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file or a folder, recognised by its content.
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

/// Runs `floorprint check`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let data_set = open(&arguments.path, &arguments.topics.open_options(arguments.drive, None))?;
    let config = arguments.settings.resolve(Some(&data_set.robot))?;
    let symptoms = examine(&data_set.records, &config);
    let mut out = terminal.results();
    if arguments.json {
        let told: Vec<Told> = symptoms.iter().map(Told::of).collect();
        writeln!(out, "{}", serde_json::to_string_pretty(&told)?)?;
    } else if symptoms.is_empty() {
        writeln!(out, "nothing seems wrong with {}", arguments.path.display())?;
    } else {
        for symptom in &symptoms {
            writeln!(out, "{HEADING}{}{HEADING:#}: {symptom}", word(symptom.severity()))?;
            writeln!(out, "  effect: {}", symptom.effect())?;
            writeln!(out, "  remedy: {}", symptom.remedy())?;
        }
    }
    out.flush()?;
    if data_set.scans().next().is_none() {
        let topics =
            data_set.bag.as_ref().map_or(String::new(), |bag| format!("; its topics: {}", bag.list_of_topics()));
        bail!("no map can be made of {}: it holds no scan{topics}", arguments.path.display());
    }
    let is_hopeless = symptoms.iter().any(|symptom| symptom.severity() == Severity::Fatal);
    Ok(if is_hopeless { Outcome::Failed } else { Outcome::Fine })
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
