//! The page on which runs are compared.

use super::{Run, distances};
use crate::report::chart::Chart;
use crate::report::page::{View, escape, map_png, poses};
use anyhow::Context as _;
use floorprint::evaluation::StampIndex;
use floorprint::sensors::StampedPose;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// The drive is compared in so many stretches of equal time.
const STRETCHES: usize = 8;

/// The page as HTML.
///
/// # Errors
/// A map cannot be encoded as a picture.
pub(super) fn page(runs: &[Run], truth: Option<&[StampedPose]>) -> anyhow::Result<String> {
    let first = runs.first().context("no run to compare")?;
    let title = runs.iter().map(|run| escape(&run.name)).collect::<Vec<_>>().join(" · ");
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title} · Floorprint</title>\n\
         <style>\n{}{}</style>\n</head>\n<body>\n<main>\n<header><h1>Runs compared</h1><p>{}</p></header>\n",
        include_str!("../report/page.css"),
        include_str!("page.css"),
        runs.iter().enumerate().map(|(run, of)| legend(run, of)).collect::<String>()
    );
    html.push_str(&plan(runs, truth)?);
    html.push_str(&figures(runs));
    html.push_str(&errors(runs, truth));
    html.push_str(&configurations(runs));
    let _ = write!(
        html,
        "</main>\n<script type=\"application/json\" id=\"poses\">{}</script>\n<script>\n{}{}</script>\n</body>\n</html>\n",
        poses(&first.trajectory),
        include_str!("../report/page.js"),
        include_str!("page.js")
    );
    Ok(html)
}

/// A run's colour and name.
fn legend(number: usize, run: &Run) -> String {
    format!("<span class=\"legend\"><i class=\"run-{number}\"></i>{} {}</span> ", number + 1, escape(&run.name))
}

/// Maps and trajectories over each other.
fn plan(runs: &[Run], truth: Option<&[StampedPose]>) -> anyhow::Result<String> {
    let mut drawn: Vec<&[StampedPose]> = runs.iter().map(|run| run.trajectory.as_slice()).collect();
    drawn.extend(truth);
    let largest = runs.iter().max_by_key(|run| run.map.cells.len()).context("no run to compare")?;
    let (view, all) =
        (View::around(&drawn, &largest.map).with_room_for_scale_bar(), View::of_all(&drawn, &largest.map));
    let (mut svg, mut controls) = (String::new(), String::new());
    for (number, run) in runs.iter().enumerate() {
        let map = &run.map;
        let image = view.image("cells", map.origin_m, map.width, map.height, map.resolution_m, &map_png(map)?);
        let hidden = if number == 0 { "" } else { " hidden" };
        let _ = write!(svg, "<g class=\"blink{hidden}\">{image}</g>");
    }
    if let Some(truth) = truth {
        svg.push_str(&view.path("truth", truth));
    }
    for (number, run) in runs.iter().enumerate() {
        let _ = write!(svg, "<g class=\"drives run-{number}\">{}</g>", view.path("run", &run.trajectory));
        let checked = if number == 0 { " checked" } else { "" };
        let _ = write!(
            controls,
            "<label><input type=\"radio\" name=\"map\" value=\"{number}\"{checked}><i class=\"run-{number}\"></i>{}</label>",
            escape(&run.name)
        );
    }
    Ok(format!(
        "<section class=\"card\"><div class=\"head\"><h2>Maps and trajectories</h2><div class=\"layers\">{controls}\
         <label><input type=\"checkbox\" id=\"blink\">blink</label>\
         <label><input type=\"checkbox\" id=\"show-drives\" checked>trajectories</label></div></div>{}\
         <p class=\"caption\">One map at a time: what jumps while they blink is different. Drag to move, Ctrl and the wheel or \
         the buttons to zoom.</p></section>\n",
        view.plan("", "maps of the runs", &svg, Some(&all))
    ))
}

/// The runs' figures, a column each.
fn figures(runs: &[Run]) -> String {
    let number = |pointer: &'static str, factor: f64, digits: usize| {
        move |run: &Run| {
            let value = run.report.pointer(pointer).and_then(Value::as_f64)?;
            Some(format!("{:.digits$}", factor * value))
        }
    };
    let text =
        |pointer: &'static str| move |run: &Run| run.report.pointer(pointer).and_then(Value::as_str).map(str::to_owned);
    type Figure = Box<dyn Fn(&Run) -> Option<String>>;
    let figures: [(&str, Figure); 18] = [
        ("preset", Box::new(text("/preset"))),
        ("seed", Box::new(number("/seed", 1.0, 0))),
        ("version", Box::new(text("/version"))),
        ("input", Box::new(|run| Some(run.report.pointer("/input/sha256")?.as_str()?.chars().take(12).collect()))),
        ("poses", Box::new(number("/drive/poses", 1.0, 0))),
        ("length, m", Box::new(number("/drive/length_m", 1.0, 2))),
        ("position RMSE, m", Box::new(number("/errors/trajectory/translation_m/rmse", 1.0, 4))),
        ("heading RMSE, °", Box::new(number("/errors/trajectory/rotation_deg/rmse", 1.0, 3))),
        ("relations, m", Box::new(number("/errors/relations/all/translation_m/mean", 1.0, 4))),
        ("relations, °", Box::new(number("/errors/relations/all/rotation_deg/mean", 1.0, 3))),
        ("map F1", Box::new(number("/errors/map/f1", 1.0, 4))),
        ("free floor, m²", Box::new(number("/map/free_m2", 1.0, 1))),
        ("wall thickness, m", Box::new(number("/map/walls/mean_thickness_m", 1.0, 3))),
        ("double walls, %", Box::new(number("/map/walls/doubled_share", 100.0, 2))),
        ("dropped, %", Box::new(number("/dropped_share", 100.0, 2))),
        ("CPU, s", Box::new(number("/cost/cpu_s", 1.0, 2))),
        ("wall time, s", Box::new(number("/cost/wall_s", 1.0, 2))),
        ("memory, MB", Box::new(number("/cost/peak_memory_bytes", 1e-6, 0))),
    ];
    let rows = figures.iter().map(|(name, figure)| {
        let values: Vec<Option<String>> = runs.iter().map(figure).collect();
        if values.iter().all(Option::is_none) { String::new() } else { row(name, &values) }
    });
    table("Figures", "", runs, &rows.collect::<String>())
}

/// Errors against the truth where it is known, else how far the runs are from the first.
fn errors(runs: &[Run], truth: Option<&[StampedPose]>) -> String {
    let reference = StampIndex::new(truth.unwrap_or_else(|| &runs[0].trajectory));
    let what = if truth.is_some() { "from the truth" } else { "from the first run" };
    let is_compared = |number: usize| truth.is_some() || number > 0;
    // By seconds since the start, at which a run has its first pose.
    let distance = |(number, run): (usize, &Run)| {
        let start_s = run.trajectory.first().map_or(0.0, |first| first.stamp_s);
        let found = if is_compared(number) { distances(&run.trajectory, &reference) } else { Vec::new() };
        found.into_iter().map(|[stamp_s, metres, degrees]| [stamp_s - start_s, metres, degrees]).collect()
    };
    let distances: Vec<Vec<[f64; 3]>> = runs.iter().enumerate().map(distance).collect();
    // One scale for all, so that they can be compared.
    let largest_m = distances.iter().flatten().map(|[_, metres, _]| *metres).fold(0.0, f64::max);
    let mut charts = String::new();
    for (number, run) in runs.iter().enumerate() {
        let title = format!("{} {what}, metres", run.name);
        let points = distances[number].iter().map(|[s, metres, _]| [*s, *metres]).collect();
        let maximum = (largest_m > 0.0).then_some(largest_m);
        let chart = Chart { title: &escape(&title), class: &format!("run-{number}"), points, maximum };
        let figure = chart.to_html("Distance of the poses at the same time, without any alignment.");
        if !figure.is_empty() {
            let _ = write!(charts, "<section class=\"card\">{figure}</section>");
        }
    }
    let end_s = distances.iter().flatten().map(|[s, ..]| *s).fold(0.0, f64::max);
    let mut rows = String::new();
    for stretch in 0..STRETCHES {
        let [from_s, to_s] = [stretch, stretch + 1].map(|part| end_s * part as f64 / STRETCHES as f64);
        let is_last = stretch + 1 == STRETCHES;
        let values: Vec<Option<String>> = distances
            .iter()
            .map(|distance| {
                let inside = distance.iter().filter(|[s, ..]| *s >= from_s && (*s < to_s || is_last));
                let (count, metres, degrees) = inside
                    .fold((0_usize, 0.0, 0.0), |(count, metres, degrees), [_, m, deg]| {
                        (count + 1, metres + m * m, degrees + deg * deg)
                    });
                let rms = |sum: f64| (sum / count as f64).sqrt();
                (count > 0).then(|| format!("{:.4} m, {:.3}°", rms(metres), rms(degrees)))
            })
            .collect();
        rows.push_str(&row(&format!("{from_s:.0} to {to_s:.0} s"), &values));
    }
    let note = format!("Root mean square of position and heading {what}.");
    format!("<div class=\"pair\">{charts}</div>\n{}", table("By stretch of time", &note, runs, &rows))
}

/// Options that are not the same in all runs.
fn configurations(runs: &[Run]) -> String {
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.options.keys()).collect();
    let mut rows = String::new();
    for key in keys {
        let values: Vec<Option<String>> = runs.iter().map(|run| run.options.get(key).cloned()).collect();
        if values.windows(2).any(|pair| pair[0] != pair[1]) {
            rows.push_str(&row(key, &values));
        }
    }
    if rows.is_empty() {
        return "<section class=\"card\"><h2>Configuration</h2><p>The same in all runs.</p></section>\n".to_owned();
    }
    table("What is different in the configuration", "", runs, &rows)
}

/// A row of a table; what differs from the first run stands out.
fn row(name: &str, values: &[Option<String>]) -> String {
    let mut row = format!("<tr><td>{}</td>", escape(name));
    for value in values {
        let class = if value == &values[0] { "" } else { " class=\"differs\"" };
        let _ = write!(row, "<td{class}>{}</td>", value.as_deref().map_or("–".to_owned(), escape));
    }
    row + "</tr>"
}

fn table(title: &str, note: &str, runs: &[Run], rows: &str) -> String {
    let heads: String =
        runs.iter().enumerate().map(|(number, run)| format!("<th>{}</th>", legend(number, run))).collect();
    format!(
        "<section class=\"card\"><h2>{title}</h2><div class=\"scroll\"><table><thead><tr><th></th>{heads}</tr></thead>\
         <tbody>{rows}</tbody></table></div><p class=\"caption\">{note}</p></section>\n"
    )
}
