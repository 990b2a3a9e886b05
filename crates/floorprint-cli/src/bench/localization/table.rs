//! The benchmark of localization as Markdown.

use super::Results;
use super::case::{Fault, Start};
use super::drive::Row;
use super::judgement::{BINS, Bin, Decision};
use std::fmt::Write as _;

/// So many of the wrong cases are listed.
const LISTED: usize = 25;
/// What stands where nothing is known.
const UNKNOWN: &str = "–";

/// All tables.
pub(super) fn markdown(results: &Results, preset: &str, settings: &[String]) -> String {
    let rows = &results.rows;
    let with = if settings.is_empty() { String::new() } else { format!(" with {}", settings.join(", ")) };
    let hours = rows.iter().map(|row| row.duration_s).sum::<f64>() / 3600.0;
    let km = rows.iter().map(|row| row.length_m).sum::<f64>() * 1e-3;
    let mut text = format!(
        "Floorprint {}, preset {preset}{with}: localization in {} cases with seed {}, {hours:.2} h and {km:.2} km.\n\n",
        results.version,
        rows.len(),
        results.seed,
    );
    let heads = ["fault", "start", "n", "found", "right", "wrong", "m", "cm", "lost s", "alarm", "ms", "p99"];
    let mut lines = vec![heads.map(str::to_owned)];
    for fault in Fault::ALL {
        for start in Start::ALL {
            let of_kind: Vec<&Row> = rows.iter().filter(|row| row.fault == fault && row.start == start).collect();
            if !of_kind.is_empty() {
                lines.push(line(fault.name(), start.name(), &of_kind));
            }
        }
    }
    let all: Vec<&Row> = rows.iter().collect();
    lines.push(line("all", "", &all));
    text.push_str(&aligned(&lines));
    text.push_str(
        "\nfound: cases in which a pose was claimed after a search; right: of these claims those within 0.1 m and 2°; wrong:\n\
         cases in which a claim was off by more than 0.5 m or 10° when it was made, or for 2 s on end; m: driven until a\n\
         start was found, median; cm: mean error while tracking; lost s: median and largest time until a kidnapping was\n\
         noticed, and how many never were; alarm: right poses that were given up; ms, p99: CPU time of an update while a\n\
         pose is claimed.\n\n",
    );
    text.push_str(&calibration(&all));
    let mean = |value: fn(&Row) -> Option<f64>| mean_of(rows.iter().filter_map(value));
    let _ = writeln!(
        text,
        "\nWhile searching an update takes {} ms on average, 99 % of a case's no more than {} ms (mean of the cases).",
        shown(mean(|row| row.searching_ms.map(|cost| cost.mean)), 2),
        shown(mean(|row| row.searching_ms.map(|cost| cost.p99)), 1),
    );
    let wrong: Vec<&Row> = rows.iter().filter(|row| row.failure.is_some() || row.judgement.is_wrong()).collect();
    if !wrong.is_empty() {
        text.push_str(
            "\nWrong or without result, each to be run alone with `floorprint bench --localization-case CASE`:\n\n",
        );
        for row in wrong.iter().take(LISTED) {
            let what = row.failure.clone().unwrap_or_else(|| {
                let decisions = row.judgement.decisions.iter().filter(|decision| decision.is_wrong());
                let worst_m = decisions.map(|decision| decision.off_m).fold(0.0, f64::max);
                format!("claimed {worst_m:.1} m off, wrong for {:.0} s", row.judgement.wrong_s)
            });
            let _ = writeln!(text, "- {} ({}, {}, {}): {what}", row.case, row.world, row.base, row.lidar);
        }
    }
    text
}

fn line(fault: &str, start: &str, rows: &[&Row]) -> [String; 12] {
    let decisions: Vec<&Decision> = rows.iter().flat_map(|row| &row.judgement.decisions).collect();
    let searched = rows.iter().filter(|row| row.start == Start::Unknown || row.judgement.noticed_after_s.is_some());
    let searched = searched.count();
    let decided = rows.iter().filter(|row| !row.judgement.decisions.is_empty()).count();
    let right = decisions.iter().filter(|decision| decision.is_right()).count();
    let wrong = rows.iter().filter(|row| row.judgement.is_wrong()).count();
    let first = rows.iter().filter(|row| row.start == Start::Unknown).filter_map(|row| row.judgement.decisions.first());
    let until_m = median(first.map(|decision| decision.after_m).collect());
    let tracked = rows.iter().filter_map(|row| row.judgement.tracking_mean_m.map(|mean_m| 100.0 * mean_m));
    let kidnapped: Vec<_> = rows.iter().filter(|row| row.judgement.was_tracked_at_kidnapping).collect();
    let noticed: Vec<f64> = kidnapped.iter().filter_map(|row| row.judgement.noticed_after_s).collect();
    let lost = match (kidnapped.len(), noticed.iter().copied().reduce(f64::max)) {
        (0, _) => UNKNOWN.to_owned(),
        (count, None) => format!("+{count}"),
        (count, Some(largest_s)) => {
            let never = if count > noticed.len() { format!(" +{}", count - noticed.len()) } else { String::new() };
            format!("{}/{largest_s:.1}{never}", shown(median(noticed.clone()), 1))
        }
    };
    let costs = || rows.iter().filter_map(|row| row.tracking_ms);
    [
        fault.to_owned(),
        start.to_owned(),
        rows.len().to_string(),
        if searched == 0 && decided == 0 { UNKNOWN.to_owned() } else { format!("{decided}/{}", searched.max(decided)) },
        if decisions.is_empty() { UNKNOWN.to_owned() } else { format!("{right}/{}", decisions.len()) },
        if wrong == 0 { "0".to_owned() } else { format!("**{wrong}**") },
        shown(until_m, 1),
        shown(mean_of(tracked), 1),
        lost,
        rows.iter().map(|row| row.judgement.false_alarms).sum::<usize>().to_string(),
        shown(mean_of(costs().map(|cost| cost.mean)), 2),
        shown(mean_of(costs().map(|cost| cost.p99)), 1),
    ]
}

/// What is said to be the probability of being lost, and how often the robot was.
fn calibration(rows: &[&Row]) -> String {
    let mut lines = vec![["said to be lost", "moments", "said %", "lost %"].map(str::to_owned)];
    for (number, end) in BINS.iter().enumerate() {
        let mut bin = Bin::default();
        rows.iter().for_each(|row| bin.add(&row.judgement.calibration[number]));
        let share = |sum: f64| shown((bin.moments > 0).then(|| 100.0 * sum / bin.moments as f64), 2);
        let begin = number.checked_sub(1).map_or(0.0, |before| BINS[before]);
        let range = format!("{} to {} %", 100.0 * begin, 100.0 * end);
        lines.push([range, bin.moments.to_string(), share(bin.said), share(bin.lost as f64)]);
    }
    aligned(&lines)
}

fn mean_of(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn shown(value: Option<f64>, decimals: usize) -> String {
    value.map_or(UNKNOWN.to_owned(), |value| format!("{value:.decimals$}"))
}

/// A Markdown table whose columns are aligned in a terminal, too.
fn aligned<const N: usize>(lines: &[[String; N]]) -> String {
    let length = |cell: &String| cell.chars().count();
    let widths: [usize; N] =
        std::array::from_fn(|column| lines.iter().map(|line| length(&line[column])).max().unwrap_or(0));
    let mut text = String::new();
    for (index, line) in lines.iter().enumerate() {
        for (cell, width) in line.iter().zip(widths) {
            let _ = write!(text, "|{cell:<width$} ");
        }
        text.push_str("|\n");
        if index == 0 {
            widths.iter().for_each(|&width| _ = write!(text, "|{}", "-".repeat(width + 1)));
            text.push_str("|\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::case::Case;
    use super::super::judgement::Judgement;
    use super::*;
    use crate::stopwatch::ScanCost;

    fn row(case: &str, judgement: Judgement) -> Row {
        let case: Case = case.parse().unwrap();
        let cost = Some(ScanCost { mean: 12.25, p99: 120.5, max: 200.0 });
        Row { failure: None, judgement, tracking_ms: cost, duration_s: 60.0, ..Row::failed(&case, String::new()) }
    }

    #[test]
    fn the_table_fits_into_a_hundred_columns_and_counts() {
        let decision = |off_m: f64| Decision { after_m: 2.5, after_s: 3.0, off_m, off_deg: 0.1 };
        let found = Judgement { decisions: vec![decision(0.02), decision(3.0)], ..Judgement::default() };
        let kidnapped = Judgement {
            noticed_after_s: Some(1.25),
            was_tracked_at_kidnapping: true,
            tracking_mean_m: Some(0.0123),
            ..Judgement::default()
        };
        let rows = vec![row("people+furniture/unknown/1", found), row("kidnapped_alike/known/4000000000", kidnapped)];
        let results = Results { version: "1", seed: 5, interrupted: false, rows };
        let text = markdown(&results, "default", &[]);
        assert!(text.lines().filter(|line| line.starts_with('|')).all(|line| line.chars().count() <= 100), "{text}");
        let cells = |start: &str| -> Vec<String> {
            let line = text.lines().find(|line| line.starts_with(start)).unwrap();
            line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
        };
        assert_eq!(cells("|people+furniture")[3..8], ["1/1", "1/2", "**1**", "2.5", "–"]);
        assert_eq!(cells("|kidnapped_alike")[6..12], ["–", "1.2", "1.2/1.2", "0", "12.25", "120.5"]);
        assert!(text.contains("- people+furniture/unknown/1"), "{text}");
    }
}
