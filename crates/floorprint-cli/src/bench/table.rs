//! The benchmark as Markdown.

use super::run::Run;
use super::{Benchmark, Row};
use std::fmt::Write as _;

/// The head and a table for each kind of run that there was.
pub(super) fn markdown(benchmark: &Benchmark) -> String {
    let mut text = head(benchmark);
    if !benchmark.data_sets.is_empty() {
        text.push_str(DATA_SETS);
        text.push_str(&named(benchmark, "accuracy").unwrap_or_default());
        text.push('\n');
        text.push_str(&named(benchmark, "cost").unwrap_or_default());
    }
    if !benchmark.worlds.is_empty() {
        text.push_str(WORLDS);
        text.push_str(&named(benchmark, "worlds").unwrap_or_default());
        text.push('\n');
        text.push_str(&named(benchmark, "cost of worlds").unwrap_or_default());
    }
    if !benchmark.growth.is_empty() {
        text.push_str(GROWTH);
        text.push_str(&named(benchmark, "growth").unwrap_or_default());
        text.push('\n');
        text.push_str(&named(benchmark, "errors of growth").unwrap_or_default());
    }
    for failure in &benchmark.failures {
        let message = failure.message.lines().next().unwrap_or_default();
        let _ =
            writeln!(text, "\nNo figures from {}, {}, seed {}: {message}", failure.name, failure.preset, failure.seed);
    }
    text
}

/// One table of a benchmark by its name; `None` where there is none of that name.
pub(super) fn named(benchmark: &Benchmark, name: &str) -> Option<String> {
    let Benchmark { data_sets, worlds, growth, .. } = benchmark;
    Some(match name {
        "accuracy" => table("data set", data_sets, &accuracy_columns()),
        "cost" => table("data set", data_sets, &cost_columns()),
        "worlds" => table("world", worlds, &world_columns()),
        "cost of worlds" => table("world", worlds, &world_cost_columns()),
        "growth" => table("drive", growth, &growth_columns()),
        "errors of growth" => table("drive", growth, &growth_error_columns()),
        "head" => head(benchmark),
        _ => return None,
    })
}

const DATA_SETS: &str = "\nErrors on data sets are the mean over the benchmark's relations where there are any, else the \
    RMSE against the true trajectory. A closure is \
    wrong that is off the true relative pose by more than 0.2 m or 0.05 rad. CPU time and memory are those of the \
    whole process; a scan's time is wall time. Presets that draw nothing at random are run once.\n\n";
const WORLDS: &str = "\nSome worlds have a robot of their own, which drives unless a LiDAR is chosen. Errors in simulated worlds are RMSE, largest and last error against the truth. A closure is \
    wrong that is off the true relative pose by more than 0.2 m or 0.05 rad; wrong ones are given in all seeds together. CPU \
    time and memory are without those of the simulation.\n\n";
const GROWTH: &str = "\nSimulated offices of growing length. CPU time of a scan is its frame and the filter, live; the end is \
    all that comes after the last scan. Memory is what is held beyond the simulation.\n\n";

fn head(benchmark: &Benchmark) -> String {
    let Benchmark { version, date, machine, threads, settings, simulated_lidar, interrupted, .. } = benchmark;
    let mut text = format!(
        "Floorprint {version}, {date}, {} ({} core{}, {}), {threads} thread{} a run{}{}. Figures are means over the \
         seeds, the worst seed in brackets.\n",
        machine.cpu,
        machine.cores,
        plural(machine.cores),
        machine.system,
        plural((*threads).into()),
        if settings.is_empty() { String::new() } else { format!(", with {}", settings.join(", ")) },
        simulated_lidar.as_ref().map_or(String::new(), |lidar| format!("; simulated LiDAR: {lidar}")),
    );
    if *interrupted {
        text.push_str("\n**Stopped before its end: these are the runs so far.**\n");
    }
    text
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

/// A column: its head and what it shows of a row.
type Column = (&'static str, Box<dyn Fn(&Row) -> String>);

/// A Markdown table whose columns are aligned in a terminal, too.
fn table(first: &str, rows: &[Row], columns: &[Column]) -> String {
    let heads = [first, "preset", "runs"].into_iter().chain(columns.iter().map(|(head, _)| *head));
    let mut lines = vec![heads.map(str::to_owned).collect::<Vec<String>>()];
    for row in rows {
        let own = [row.name.clone(), row.preset.clone(), row.runs.len().to_string()];
        lines.push(own.into_iter().chain(columns.iter().map(|(_, cell)| cell(row))).collect());
    }
    let length = |cell: &String| cell.chars().count();
    let widths: Vec<usize> =
        (0..lines[0].len()).map(|column| lines.iter().map(|line| length(&line[column])).max().unwrap_or(0)).collect();
    let mut text = String::new();
    for (index, line) in lines.iter().enumerate() {
        for (cell, &width) in line.iter().zip(&widths) {
            let _ = write!(text, "| {cell:<width$} ");
        }
        text.push_str("|\n");
        if index == 0 {
            widths.iter().for_each(|&width| _ = write!(text, "|{}", "-".repeat(width + 2)));
            text.push_str("|\n");
        }
    }
    text
}

fn closures() -> Box<dyn Fn(&Row) -> String> {
    mean(|run| run.closures.map(|closures| closures as f64), 1.0, 0)
}

fn memory_mb() -> Box<dyn Fn(&Row) -> String> {
    with_worst(|run| run.peak_memory_bytes.map(|bytes| bytes as f64 * 1e-6), 0)
}

fn accuracy_columns() -> Vec<Column> {
    vec![
        ("mean m", with_worst(|run| run.translation_m, 4)),
        ("mean °", with_worst(|run| run.rotation_deg, 3)),
        ("max m", largest(|run| run.largest_m, 2)),
        ("odometry", mean(|run| run.odometry_m, 1.0, 3)),
        ("loops", closures()),
        ("wrong", Box::new(wrong)),
    ]
}

fn cost_columns() -> Vec<Column> {
    vec![
        ("map F1", mean(|run| run.map_f1, 1.0, 3)),
        ("double", mean(|run| run.doubled_share, 100.0, 2)),
        ("scan ms, p99, max", Box::new(scan_ms)),
        ("CPU s", mean(|run| run.cpu_s, 1.0, 2)),
        ("MB", memory_mb()),
        ("× real", Box::new(real_time)),
    ]
}

fn world_columns() -> Vec<Column> {
    vec![
        ("km", mean(|run| Some(run.length_m), 1e-3, 2)),
        ("RMSE m", with_worst(|run| run.translation_m, 3)),
        ("max m", largest(|run| run.largest_m, 3)),
        ("end m", largest(|run| run.end_m, 3)),
        ("odometry", mean(|run| run.odometry_m, 1.0, 1)),
        ("loops", closures()),
        ("wrong", Box::new(wrong)),
    ]
}

fn world_cost_columns() -> Vec<Column> {
    vec![
        ("RMSE °", with_worst(|run| run.rotation_deg, 3)),
        ("4 s m", with_worst(|run| run.windowed_m, 4)),
        ("yaw °", with_worst(|run| run.yaw_spread_deg, 3)),
        ("F1", mean(|run| run.map_f1, 1.0, 3)),
        ("scan ms", Box::new(scan_ms)),
        ("CPU s", mean(|run| run.cpu_s, 1.0, 1)),
        ("MB", memory_mb()),
    ]
}

fn growth_columns() -> Vec<Column> {
    vec![
        ("scans", mean(|run| Some(run.scans as f64), 1.0, 0)),
        ("scan ms, p99, max", Box::new(scan_ms)),
        ("end s", mean(|run| run.finish_s, 1.0, 2)),
        ("CPU s", mean(|run| run.cpu_s, 1.0, 1)),
        ("× real", Box::new(real_time)),
        ("MB", memory_mb()),
    ]
}

fn growth_error_columns() -> Vec<Column> {
    vec![
        ("km", mean(|run| Some(run.length_m), 1e-3, 2)),
        ("RMSE m", with_worst(|run| run.translation_m, 3)),
        ("end m", largest(|run| run.end_m, 3)),
        ("odometry", mean(|run| run.odometry_m, 1.0, 1)),
        ("loops", closures()),
        ("wrong", Box::new(wrong)),
    ]
}

/// What stands where nothing is known.
const UNKNOWN: &str = "–";

fn values(row: &Row, value: fn(&Run) -> Option<f64>) -> Vec<f64> {
    row.runs.iter().filter_map(value).collect()
}

fn mean_of(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn mean(value: fn(&Run) -> Option<f64>, scale: f64, decimals: usize) -> Box<dyn Fn(&Row) -> String> {
    Box::new(move |row| match values(row, value).as_slice() {
        [] => UNKNOWN.to_owned(),
        values => format!("{:.decimals$}", mean_of(values) * scale),
    })
}

fn with_worst(value: fn(&Run) -> Option<f64>, decimals: usize) -> Box<dyn Fn(&Row) -> String> {
    Box::new(move |row| {
        let values = values(row, value);
        match values.iter().copied().reduce(f64::max) {
            None => UNKNOWN.to_owned(),
            Some(worst) if values.len() == 1 => format!("{worst:.decimals$}"),
            Some(worst) => format!("{:.decimals$} ({worst:.decimals$})", mean_of(&values)),
        }
    })
}

/// The largest of all runs.
fn largest(value: fn(&Run) -> Option<f64>, decimals: usize) -> Box<dyn Fn(&Row) -> String> {
    Box::new(move |row| match values(row, value).into_iter().reduce(f64::max) {
        None => UNKNOWN.to_owned(),
        Some(largest) => format!("{largest:.decimals$}"),
    })
}

fn real_time(row: &Row) -> String {
    let factors = values(row, Run::real_time_factor);
    match factors.iter().copied().reduce(f64::min) {
        None => UNKNOWN.to_owned(),
        Some(slowest) if factors.len() == 1 => format!("{slowest:.0}"),
        Some(slowest) => format!("{:.0} ({slowest:.0})", mean_of(&factors)),
    }
}

/// Means of means and percentiles; the largest of all.
fn scan_ms(row: &Row) -> String {
    let costs: Vec<_> = row.runs.iter().filter_map(|run| run.scan_ms).collect();
    let Some(max) = costs.iter().map(|cost| cost.max).reduce(f64::max) else { return UNKNOWN.to_owned() };
    let count = costs.len() as f64;
    let mean = costs.iter().map(|cost| cost.mean).sum::<f64>() / count;
    let p99 = costs.iter().map(|cost| cost.p99).sum::<f64>() / count;
    format!("{mean:.2}/{p99:.2}/{max:.1}")
}

/// Wrong closures of all seeds, and in how many seeds they are.
fn wrong(row: &Row) -> String {
    let wrong: Vec<usize> = row.runs.iter().filter_map(|run| run.wrong_closures).collect();
    match wrong.iter().filter(|wrong| **wrong > 0).count() {
        _ if wrong.is_empty() => UNKNOWN.to_owned(),
        0 => "0".to_owned(),
        seeds => format!("**{}** ({seeds} seed{})", wrong.iter().sum::<usize>(), plural(seeds)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stopwatch::ScanCost;

    fn run(seed: u64, translation_m: f64, wrong_closures: usize) -> Run {
        Run {
            seed,
            translation_m: Some(translation_m),
            cpu_s: Some(2.0),
            wall_s: 1.0,
            peak_memory_bytes: Some(5_000_000),
            duration_s: 100.0 * (seed + 1) as f64,
            scan_ms: Some(ScanCost { mean: 0.5, p99: 1.0, max: 2.0 }),
            wrong_closures: Some(wrong_closures),
            ..Run::default()
        }
    }

    fn rows() -> [Row; 1] {
        [Row { name: "a".into(), preset: "default".into(), runs: vec![run(0, 0.01, 0), run(1, 0.03, 2)] }]
    }

    /// The cells of the last line.
    fn cells(text: &str) -> Vec<&str> {
        text.lines().last().unwrap().trim_matches('|').split('|').map(str::trim).collect()
    }

    #[test]
    fn rows_give_the_mean_and_the_worst() {
        let text = table("data set", &rows(), &accuracy_columns());
        let expected = ["a", "default", "2", "0.0200 (0.0300)", "–", "–", "–", "–", "**2** (1 seed)"];
        assert_eq!(cells(&text), expected);
        let text = table("data set", &rows(), &cost_columns());
        assert_eq!(cells(&text)[3..], ["–", "–", "0.50/1.00/2.0", "2.00", "5 (5)", "150 (100)"]);
    }

    #[test]
    fn tables_fit_into_a_hundred_columns() {
        let rows = [Row { name: "main_building".into(), preset: "gmapping".into(), runs: vec![run(0, 0.01, 0)] }];
        for columns in [
            accuracy_columns(),
            cost_columns(),
            world_columns(),
            world_cost_columns(),
            growth_columns(),
            growth_error_columns(),
        ] {
            let text = table("data set", &rows, &columns);
            let lengths: Vec<usize> = text.lines().map(|line| line.chars().count()).collect();
            assert!(lengths.iter().all(|&length| length == lengths[0] && length <= 100), "{text}");
        }
    }
}
