//! The gauntlet as Markdown.

use super::Results;
use super::drive::Row;
use super::judgement::Verdict;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// So many of the worst drives are listed.
const WORST: usize = 25;

/// The whole table.
pub(super) fn markdown(results: &Results<'_>, preset: &str, settings: &[String]) -> String {
    let mut text = summary(results, preset, settings);
    for (title, kind) in GROUPS {
        let _ = write!(text, "\n{}", group(results.rows, title, kind));
    }
    let fault = results.fault.map_or_else(String::new, |kind| format!(" --gauntlet-fault {kind}"));
    let _ = writeln!(text, "\nThe worst, each to be run alone with `floorprint bench --gauntlet-drive SEED{fault}`:\n");
    text.push_str(
        "| seed | outcome | world | base | LiDAR | fault | claimed m | ° | wrong s live / end | odometry m |\n",
    );
    text.push_str("|---|---|---|---|---|---|---|---|---|---|\n");
    for row in worst(results.rows).into_iter().take(WORST) {
        let degrees = row.live.claimed_max_deg.max(row.result.claimed_max_deg);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {:.2} | {degrees:.1} | {:.0} / {:.0} | {:.2} |",
            row.seed,
            row.failure.as_deref().unwrap_or(row.outcome.name()),
            row.world,
            row.base,
            lidar(row),
            row.fault,
            row.claimed_max_m(),
            row.live.wrong_s,
            row.result.wrong_s,
            row.odometry_max_m,
        );
    }
    text
}

/// A row's LiDAR in short.
pub(super) fn lidar(row: &Row) -> String {
    format!("{}, {} rays over {:.0}°, {:.1} Hz", row.lidar, row.beams, row.field_of_view_deg, row.rate_hz)
}

/// The drives from the worst on that are silently wrong or gave no result.
pub(super) fn worst(rows: &[Row]) -> Vec<&Row> {
    let is_bad = |row: &&Row| matches!(row.outcome, Verdict::SilentlyWrong | Verdict::Failed);
    let mut worst: Vec<&Row> = rows.iter().filter(is_bad).collect();
    let key = |row: &Row| if row.outcome == Verdict::Failed { f64::INFINITY } else { row.claimed_max_m() };
    worst.sort_by(|a, b| key(b).total_cmp(&key(a)).then(a.seed.cmp(&b.seed)));
    worst
}

fn summary(results: &Results<'_>, preset: &str, settings: &[String]) -> String {
    let Results { version, seed, drives, right, told, silently_wrong, failed, worse_than_odometry, rows, .. } = results;
    let share = |count: usize| 100.0 * count as f64 / (*drives).max(1) as f64;
    let alone = results.fault.map_or_else(String::new, |kind| format!(" on which nothing but {kind} goes wrong,"));
    let with = if settings.is_empty() { String::new() } else { format!(" with {}", settings.join(", ")) };
    let sum = |value: fn(&Row) -> f64| rows.iter().map(value).sum::<f64>();
    let hours = sum(|row| row.duration_s) / 3600.0;
    let slowest_ms = rows.iter().map(|row| row.largest_step_ms).fold(0.0, f64::max);
    let slow = rows.iter().filter(|row| row.largest_step_ms > 20.0).count();
    let kidnapped: usize = rows.iter().map(|row| row.kidnapped).sum();
    let noticed: usize = rows.iter().map(|row| row.kidnappings_noticed).sum();
    let invented: usize = rows.iter().map(|row| row.false_kidnappings).sum();
    format!(
        "Floorprint {version}, preset {preset}{with}: gauntlet of {drives} drives{alone} with seed {seed}, {hours:.1} h and {:.1} km of driving.\n\n\
         | right | told | silently wrong | no result | worse than the odometry without a word |\n|---|---|---|---|---|\n\
         | {right} ({:.1} %) | {told} ({:.1} %) | {silently_wrong} ({:.1} %) | {failed} | {worse_than_odometry} |\n\n\
         CPU {:.0} s, {:.2} s of the worst drive; the longest step {slowest_ms:.0} ms, more than 20 ms in {slow} drives. \
         {noticed} of {kidnapped} kidnappings were noticed, {invented} reported that there were none.\n",
        sum(|row| row.length_m) * 1e-3,
        share(*right),
        share(*told),
        share(*silently_wrong),
        sum(|row| row.cpu_s),
        rows.iter().map(|row| row.cpu_s).fold(0.0, f64::max),
    )
}

/// How the rows of a table are named.
type Kind = fn(&Row) -> &str;

const GROUPS: [(&str, Kind); 4] =
    [("world", |row| &row.world), ("base", |row| &row.base), ("LiDAR", |row| &row.lidar), ("fault", |row| &row.fault)];

/// One line for each kind.
fn group(rows: &[Row], title: &str, kind: Kind) -> String {
    let mut kinds: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in rows {
        // A drive with two faults counts for both.
        for name in kind(row).split('+') {
            kinds.entry(name).or_default().push(row);
        }
    }
    let mut text = format!(
        "| {title} | drives | right | told | silently wrong | no result | RMSE m, median | odometry | false kidnappings | CPU s |\n|---|---|---|---|---|---|---|---|---|---|\n"
    );
    for (name, rows) in kinds {
        let count = |verdict: Verdict| rows.iter().filter(|row| row.outcome == verdict).count();
        let median = |value: fn(&Row) -> f64| {
            let mut values: Vec<f64> = rows.iter().map(|row| value(row)).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {} | {} | {} | {:.3} | {:.2} | {} | {:.1} |",
            rows.len(),
            count(Verdict::Right),
            count(Verdict::Told),
            count(Verdict::SilentlyWrong),
            count(Verdict::Failed),
            median(|row| row.result.rmse_m),
            median(|row| row.odometry_rmse_m),
            rows.iter().map(|row| row.false_kidnappings).sum::<usize>(),
            rows.iter().map(|row| row.cpu_s).sum::<f64>(),
        );
    }
    text
}
