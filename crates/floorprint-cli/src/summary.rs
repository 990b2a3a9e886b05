//! What a run ends with on the terminal: a short table and where to look.

use crate::report::Report;
use crate::terminal::{HEADING, prose};
use std::io::{self, Write};
use std::path::Path;

/// Odometry that reads longer or shorter by this share is told.
const WORTH_TELLING: f64 = 0.01;

/// Columns for the names of lines.
const NAME: usize = 12;

/// A number of things, in words.
pub(crate) fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Prints the summary of a run whose results lie in `folder`.
pub(crate) fn print(out: &mut impl Write, report: &Report, folder: &Path) -> io::Result<()> {
    let drive = &report.drive;
    let mut line = |name: &str, text: String| writeln!(out, "{HEADING}{name:<NAME$}{HEADING:#}{}", prose(&text, NAME));
    let poses = if drive.poses > drive.scans && report.map.is_some() {
        format!(
            "{} with those of the session, {} of them new",
            counted(drive.poses, "pose"),
            counted(drive.scans, "scan")
        )
    } else if report.map.is_some() {
        format!("{} of {}", drive.poses, counted(drive.scans, "scan"))
    } else {
        format!("{} by dead reckoning", counted(drive.poses, "pose"))
    };
    line("drive", format!("{:.1} m in {:.1} s, {poses}", drive.length_m, drive.duration_s))?;
    let errors = &report.errors;
    for (name, error) in [("trajectory", &errors.trajectory), ("odometry", &errors.odometry)] {
        if let Some(error) = error {
            line(
                name,
                format!(
                    "RMSE {:.4} m, {:.3}°  (largest {:.4} m, {:.3}°)",
                    error.translation_m.rmse, error.rotation_deg.rmse, error.translation_m.max, error.rotation_deg.max
                ),
            )?;
        }
    }
    for (name, relations) in [("relations", &errors.relations), ("odometry", &errors.odometry_relations)] {
        if let Some(relations) = relations
            && let (Some(translation), Some(rotation)) = (&relations.all.translation_m, &relations.all.rotation_deg)
        {
            line(
                name,
                format!(
                    "mean error {:.4} m, {:.3}°  ({} of {} matched)",
                    translation.mean, rotation.mean, relations.all.matched, relations.all.relations
                ),
            )?;
        }
    }
    let odometry_scale = report.filter.as_ref().and_then(|filter| filter.odometry_scale);
    if let Some(scale) = odometry_scale.filter(|scale| (scale - 1.0).abs() > WORTH_TELLING) {
        let off = if scale < 1.0 { "long" } else { "short" };
        line("odometry", format!("reads {:.1} % too {off}; corrected for", 100.0 * (1.0 / scale - 1.0).abs()))?;
    }
    if let Some(filter) = report.filter.as_ref().filter(|filter| filter.odometry_rejections > 0) {
        line(
            "conflicts",
            format!(
                "the scan won over the odometry at {} in {}",
                counted(filter.odometry_rejections, "scan"),
                counted(filter.contradictions.len(), "place")
            ),
        )?;
    }
    if let Some(loops) = &report.loops {
        line("loops", format!("{} closed, {} rejected", loops.closed, loops.rejected))?;
    }
    if let Some(uncertain) = &report.uncertain {
        line("uncertain", uncertain.in_words())?;
    }
    for kidnapped in &report.kidnappings {
        line("robot", kidnapped.in_words())?;
    }
    if let Some(map) = &report.map {
        let quality = errors.map.map_or(String::new(), |quality| {
            format!(", F1 {:.4} (precision {:.4}, recall {:.4})", quality.f1, quality.precision, quality.recall)
        });
        line("map", format!("{}×{} cells, {:.1} m² free{quality}", map.size_cells[0], map.size_cells[1], map.free_m2))?;
    }
    if let Some(texture) = &report.texture {
        let error = errors.texture.map_or(String::new(), |error| {
            let coverage =
                error.coverage.map_or(String::new(), |share| format!(", {:.1} % of the floor seen", 100.0 * share));
            format!(", colour error {:.2} / 255{coverage}", error.mean_absolute_error)
        });
        line("floor", format!("{:.1} m² from {}{error}", texture.painted_m2, counted(texture.images, "image pair")))?;
    }
    if !report.dropped.is_empty() {
        let lost: usize = report.dropped.iter().map(|dropped| dropped.count).sum();
        line("dropped", format!("{lost} ({:.2} % of the data)", 100.0 * report.dropped_share))?;
    }
    let cost = &report.cost;
    let cpu = cost.cpu_s.map_or(String::new(), |seconds| format!(", {seconds:.2} s of CPU"));
    let memory = cost.peak_memory_bytes.map_or(String::new(), |bytes| format!(", {:.0} MB", bytes as f64 / 1e6));
    line("cost", format!("{:.2} s{cpu}{memory}, {:.0}× real time", cost.wall_s, cost.real_time_factor))?;
    line("results", folder.join("report.html").display().to_string())?;
    out.flush()
}
