//! Draws how cost and error grow with the length of the drive.

use super::Row;
use super::run::Run;
use crate::report::chart::{Chart, HEIGHT, WIDTH};
use std::fmt::Write as _;

/// Room for the title above a chart, SVG units.
const TITLE: f64 = 30.0;
/// Charts beside each other.
const COLUMNS: usize = 2;
/// The colours of the report's page, light.
const STYLE: &str = "svg{font-family:system-ui,sans-serif}.title{fill:#14181f;font-size:14px;font-weight:600}\
    .grid{stroke:#e1e5ea;fill:none}.tick{fill:#5b6472;font-size:11px}\
    .line{fill:none;stroke:#0f766e;stroke-width:1.6;stroke-linejoin:round}.line.trajectory{stroke:#dc2626}\
    .line.odometry{stroke:#2563eb}.mark{fill:#14181f}";

/// What is drawn, with the class of its line.
type Figure = (&'static str, &'static str, fn(&Run) -> Option<f64>);

const FIGURES: [Figure; 8] = [
    ("CPU time of a scan, mean, ms", "", |run| run.scan_ms.map(|cost| cost.mean)),
    ("CPU time of a scan, 99th percentile, ms", "", |run| run.scan_ms.map(|cost| cost.p99)),
    ("CPU time of a scan, largest, ms", "", |run| run.scan_ms.map(|cost| cost.max)),
    ("CPU time of the end, s", "", |run| run.finish_s),
    ("Memory, MB", "", |run| run.peak_memory_bytes.map(|bytes| bytes as f64 * 1e-6)),
    ("RMSE, m", "trajectory", |run| run.translation_m),
    ("Error at the end, m", "trajectory", |run| run.end_m),
    ("RMSE of dead reckoning, m", "odometry", |run| run.odometry_m),
];

/// Charts over the drive's length, a group for each preset; `None` before there are two lengths.
pub(super) fn plot(rows: &[Row]) -> Option<String> {
    let mut presets: Vec<&str> = rows.iter().map(|row| row.preset.as_str()).collect();
    presets.sort_unstable();
    presets.dedup();
    let mut panels = String::new();
    let mut count = 0;
    for preset in presets {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.preset == preset).collect();
        if rows.len() < 2 {
            continue;
        }
        for (title, class, value) in FIGURES {
            let mut points: Vec<[f64; 2]> = rows.iter().filter_map(|row| point(row, value)).collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let chart = Chart { title, class, points, maximum: None };
            let Some(svg) = chart.to_svg("km", Some(0.0)) else { continue };
            let (x, y) = ((count % COLUMNS) as f64 * WIDTH, (count / COLUMNS) as f64 * (HEIGHT + TITLE));
            let placed = svg.replacen("<svg ", &format!(r#"<svg y="{TITLE}" width="{WIDTH}" height="{HEIGHT}" "#), 1);
            let _ = write!(
                panels,
                r#"<g transform="translate({x} {y})"><text class="title" x="12" y="22">{title} ({preset})</text>{placed}</g>"#
            );
            count += 1;
        }
    }
    let (width, height) = (COLUMNS as f64 * WIDTH, count.div_ceil(COLUMNS) as f64 * (HEIGHT + TITLE));
    (count > 0).then(|| {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\"><style>{STYLE}</style>\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>{panels}</svg>\n"
        )
    })
}

/// The means over the seeds: length in km and value.
fn point(row: &Row, value: fn(&Run) -> Option<f64>) -> Option<[f64; 2]> {
    let values: Vec<f64> = row.runs.iter().filter_map(value).collect();
    let count = values.len() as f64;
    let length_km = row.runs.iter().map(|run| run.length_m * 1e-3).sum::<f64>() / row.runs.len() as f64;
    (!values.is_empty()).then(|| [length_km, values.iter().sum::<f64>() / count])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_needs_two_lengths() {
        let row = |length_m: f64| Row {
            name: String::new(),
            preset: "default".to_owned(),
            runs: vec![Run { length_m, translation_m: Some(0.1), ..Run::default() }],
        };
        assert_eq!(plot(&[row(500.0)]), None);
        let svg = plot(&[row(500.0), row(1000.0)]).unwrap();
        assert_eq!(svg.matches("class=\"mark\"").count(), 2, "{svg}");
    }
}
