//! Documents whose tables come from stored figures, and the check that the figures still hold.
//!
//! A table stands between two comments, of which the first names the stored `bench.json`, beside the document
//! or below, and the table: `<!-- bench bench/logs.json accuracy -->` and `<!-- end of bench -->`. Of several files, with commas
//! between them, the rows stand together, each with the settings that its file was measured with.

use super::run::Run;
use super::{Arguments, Benchmark, Case, cases, table};
use crate::interrupt::Interrupt;
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::{Context as _, bail, ensure};
use floorprint_io::{read_text, write_file};
use std::path::Path;

const BEGIN: &str = "<!-- bench ";
const CLOSE: &str = " -->";
const END: &str = "<!-- end of bench -->";

/// Figures are compared to this share; they are stored with all their digits.
const SAME: f64 = 1e-9;

/// Makes the tables of a document anew.
///
/// # Errors
/// Stored figures cannot be read, a table is not known, or a mark has no end.
pub(super) fn render(document: &Path, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let before = read_text(document)?;
    let after = rendered(&before, &|file| {
        let path = document.with_file_name("").join(file);
        let text = read_text(&path)?;
        serde_json::from_str(&text).with_context(|| format!("{} is no bench.json", path.display()))
    })?;
    if after == before {
        terminal.say(&format!("{} is as the stored figures have it", document.display()));
        return Ok(Outcome::Fine);
    }
    write_file(document, after.as_bytes())?;
    terminal.say(&format!("{} made anew", document.display()));
    Ok(Outcome::Fine)
}

/// The text with its tables made from stored figures.
fn rendered(text: &str, stored: &dyn Fn(&str) -> anyhow::Result<Benchmark>) -> anyhow::Result<String> {
    let mut done = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once(BEGIN) {
        let (mark, old) = behind.split_once(CLOSE).context("a mark of a table without its end")?;
        let (_old, after) = old.split_once(END).with_context(|| format!("the table {mark} has no \"{END}\""))?;
        let (files, name) = mark.split_once(' ').with_context(|| format!("no table is named in \"{mark}\""))?;
        let benchmark = match files.split(',').collect::<Vec<_>>()[..] {
            [file] => stored(file)?,
            [first, ref others @ ..] => {
                let together = with_settings(stored(first)?);
                others
                    .iter()
                    .try_fold(together, |together, file| anyhow::Ok(joined(together, with_settings(stored(file)?))))?
            }
            [] => bail!("no file is named in \"{mark}\""),
        };
        let new = table::named(&benchmark, name).with_context(|| format!("no table is called {name}"))?;
        done.push_str(&format!("{before}{BEGIN}{mark}{CLOSE}\n\n{}\n{END}", new));
        rest = after;
    }
    Ok(done + rest)
}

/// The same, with the settings in the names of the rows.
fn with_settings(mut benchmark: Benchmark) -> Benchmark {
    let settings = benchmark.settings.iter().map(|setting| format!(", {setting}")).collect::<String>();
    for row in benchmark.data_sets.iter_mut().chain(&mut benchmark.worlds).chain(&mut benchmark.growth) {
        row.name.push_str(&settings);
    }
    benchmark
}

/// The rows of both.
fn joined(mut first: Benchmark, other: Benchmark) -> Benchmark {
    first.data_sets.extend(other.data_sets);
    first.worlds.extend(other.worlds);
    first.growth.extend(other.growth);
    first
}

/// Measures data sets and worlds of stored figures again: of data sets what chance has no part in, of worlds and offices the
/// seeds that are asked for (one by default), for theirs is chance of the simulation.
///
/// # Errors
/// The figures cannot be read, a run fails, or there is nothing to compare.
pub(super) fn verify(arguments: &Arguments, stored: &Path, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let text = read_text(stored)?;
    let benchmark: Benchmark =
        serde_json::from_str(&text).with_context(|| format!("{} is no bench.json", stored.display()))?;
    let interrupt = Interrupt::listen();
    let mut compared = 0;
    let mut different = Vec::new();
    for case in cases(arguments)? {
        let (rows, is_simulated) = match &case {
            Case::DataSet(_) => (&benchmark.data_sets, false),
            Case::World(_) => (&benchmark.worlds, true),
            Case::Office { .. } => (&benchmark.growth, true),
        };
        let chosen =
            |preset: &str| arguments.preset.is_empty() || arguments.preset.iter().any(|chosen| chosen.name() == preset);
        let seeds = arguments.seeds.unwrap_or(1);
        let runs = rows.iter().filter(|row| row.name == case.name() && chosen(&row.preset)).flat_map(|row| {
            let is_meant = move |run: &&Run| if is_simulated { run.seed < seeds } else { row.runs.len() == 1 };
            row.runs.iter().filter(is_meant).map(move |run| (&row.name, &row.preset, run))
        });
        for (name, preset, run) in runs {
            let now = arguments.measure(&case, preset, run.seed, &interrupt)?;
            if interrupt.requested() {
                return Ok(Outcome::Interrupted);
            }
            compared += 1;
            let figures = [
                ("translation", run.translation_m, now.translation_m),
                ("rotation", run.rotation_deg, now.rotation_deg),
                ("largest error", run.largest_m, now.largest_m),
                ("odometry", run.odometry_m, now.odometry_m),
                ("length", Some(run.length_m), Some(now.length_m)),
                ("error at the end", run.end_m, now.end_m),
                (
                    "closures",
                    run.closures.map(|closures| closures as f64),
                    now.closures.map(|closures| closures as f64),
                ),
            ];
            for (figure, then, now) in figures {
                let is_same = match (then, now) {
                    (Some(then), Some(now)) => (then - now).abs() <= SAME * then.abs(),
                    (then, now) => then == now,
                };
                if !is_same {
                    let in_words = |value: Option<f64>| value.map_or("none".to_owned(), |value| value.to_string());
                    different.push(format!(
                        "{name}, {preset}, seed {}: {figure} {} is now {}",
                        run.seed,
                        in_words(then),
                        in_words(now)
                    ));
                }
            }
        }
    }
    ensure!(
        compared > 0,
        "{} holds none of these worlds, and none of these data sets with a preset that draws nothing",
        stored.display()
    );
    if !different.is_empty() {
        bail!("{} is stale:\n  {}", stored.display(), different.join("\n  "));
    }
    terminal.say(&format!("{}: {compared} runs give the stored figures", stored.display()));
    Ok(Outcome::Fine)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(_file: &str) -> anyhow::Result<Benchmark> {
        Ok(serde_json::from_value(serde_json::json!({
            "schema": 1, "version": "1", "date": "2026-01-31", "threads": 1, "settings": [],
            "machine": {"cpu": "a CPU", "cores": 2, "system": "linux"},
            "simulated_lidar": null, "interrupted": false, "worlds": [], "growth": [], "failures": [],
            "data_sets": [{"name": "intel", "preset": "fast", "runs": [{
                "seed": 0, "translation_m": 0.0123, "rotation_deg": null, "largest_m": null, "end_m": null,
                "end_deg": null, "odometry_m": null, "closures": null, "wrong_closures": null, "map_f1": null,
                "doubled_share": null, "scans": 1, "duration_s": 1.0, "length_m": 1.0, "cpu_s": null,
                "wall_s": 1.0, "scan_ms": null, "finish_s": null, "peak_memory_bytes": null
            }]}]
        }))?)
    }

    #[test]
    fn tables_are_made_from_stored_figures_and_stay_as_they_are() {
        let text = "a\n<!-- bench bench/logs.json accuracy -->\nold\n<!-- end of bench -->\nb\n";
        let once = rendered(text, &stored).unwrap();
        assert!(once.contains("| intel") && once.contains("0.0123") && !once.contains("old"), "{once}");
        assert!(once.starts_with("a\n") && once.ends_with("\nb\n"), "{once}");
        assert_eq!(rendered(&once, &stored).unwrap(), once);
        assert_eq!(rendered("no table", &stored).unwrap(), "no table");
    }

    #[test]
    fn rows_of_several_files_stand_together_with_their_settings() {
        let few_and_many = |file: &str| {
            let settings = vec![format!("filter.particles={}", if file == "few.json" { 2 } else { 1000 })];
            Ok(Benchmark { settings, ..stored(file)? })
        };
        let text = "<!-- bench few.json,many.json accuracy -->\n<!-- end of bench -->";
        let table = rendered(text, &few_and_many).unwrap();
        let [few, many] =
            ["| intel, filter.particles=2 ", "| intel, filter.particles=1000 "].map(|row| table.find(row));
        assert!(few.is_some() && few < many && table.matches("| data set").count() == 1, "{table}");
    }

    #[test]
    fn marks_that_cannot_be_followed_are_errors() {
        for text in
            ["<!-- bench a.json accuracy -->", "<!-- bench a.json beauty --><!-- end of bench -->", "<!-- bench a"]
        {
            assert!(rendered(text, &stored).is_err(), "{text}");
        }
    }
}
