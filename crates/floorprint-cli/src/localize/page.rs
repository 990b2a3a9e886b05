//! `report.html` of a localization: the map with the trajectory, and modes and health over time.

use super::report::Report;
use crate::report::chart::Chart;
use crate::report::page::{View, ends, escape, map_png, poses};
use crate::run_folder::data_set_name;
use floorprint::localization::LocalizationReport;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use std::fmt::Write;
use std::path::Path;

/// The page as HTML.
///
/// # Errors
/// The map cannot be encoded as a picture.
pub(super) fn page(
    report: &Report,
    map: &Raster<Occupancy>,
    steps: &[LocalizationReport],
) -> Result<String, png::EncodingError> {
    let name = data_set_name(Path::new(&report.input));
    let partial = if report.partial { "<span class=\"badge\">partial: stopped before its end</span>" } else { "" };
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{0} localised · Floorprint</title>\n<style>\n{1}</style>\n</head>\n<body>\n<main>\n\
         <header><h1>{0}</h1>{partial}<p>localised in {2}</p><p>made on {3} with <code>{4}</code></p></header>\n",
        escape(&name),
        include_str!("../report/page.css"),
        escape(&report.map),
        report.made.date,
        escape(&report.made.command),
    );
    for section in [tiles(report), plan(report, map)?, events(report), charts(steps), notes(report)] {
        html.push_str(&section);
    }
    let _ = write!(
        html,
        "</main>\n<script type=\"application/json\" id=\"poses\">{}</script>\n<script>\n{}</script>\n</body>\n</html>\n",
        poses(&report.trajectory),
        include_str!("../report/page.js")
    );
    Ok(html)
}

fn tiles(report: &Report) -> String {
    let mut tiles = String::new();
    let mut tile = |class: &str, figure: String, label: &str, remark: String| {
        let _ =
            write!(tiles, "<div class=\"tile {class}\"><b>{figure}</b><span>{label}</span><span>{remark}</span></div>");
    };
    match &report.found {
        Some(found) => {
            tile("good", format!("{:.1} m", found.after_m), "driven until found", format!("{:.1} s", found.after_s));
        }
        None => tile("", "not found".to_owned(), "no place stands alone", "none is claimed".to_owned()),
    }
    let scans = format!("of {} scans", report.scans);
    tile("", format!("{:.1} %", 100.0 * report.localised_share), "localised", scans);
    if let Some(errors) = &report.errors {
        let largest = format!("largest {:.3} m", errors.translation_m.max);
        tile("good", format!("{:.3} m", errors.translation_m.rmse), "position RMSE", largest);
        let largest = format!("largest {:.2}°", errors.rotation_deg.max);
        tile("good", format!("{:.2}°", errors.rotation_deg.rmse), "heading RMSE", largest);
    }
    if let Some(cost) = &report.cost.tracking_ms {
        tile("", format!("{:.2} ms", cost.mean), "a scan while localised", format!("99 %: {:.2} ms", cost.p99));
    }
    if let Some(cost) = &report.cost.searching_ms {
        tile("", format!("{:.1} ms", cost.mean), "a scan while searching", format!("99 %: {:.1} ms", cost.p99));
    }
    tile("", format!("{:.0} m²", report.map_free_m2), "free floor of the map", String::new());
    format!("<section class=\"tiles\">{tiles}</section>\n")
}

fn plan(report: &Report, map: &Raster<Occupancy>) -> Result<String, png::EncodingError> {
    let truth: &[StampedPose] = report.true_pieces.first().map_or(&[], |piece| piece.as_slice());
    let drawn: [&[StampedPose]; 2] = [&report.trajectory, truth];
    let (view, all) = (View::around(&drawn, map).with_room_for_scale_bar(), View::of_all(&drawn, map));
    let mut svg = view.image("cells", map.origin_m, map.width, map.height, map.resolution_m, &map_png(map)?);
    let mut layers = vec![("map", "cells", "map"), ("trajectory", "trajectory", "claimed poses")];
    if !truth.is_empty() {
        layers.push(("truth", "truth", "truth"));
        svg.push_str(&view.path("truth", truth));
    }
    for piece in &report.pieces {
        svg.push_str(&view.path("trajectory", piece));
    }
    svg.push_str(&ends(&report.trajectory));
    let undecided = report.ended.as_ref().filter(|end| !end.is_localised);
    for place in undecided.iter().flat_map(|end| &end.modes) {
        let width_px = 6.0 + 18.0 * place.weight.sqrt();
        let _ = write!(
            svg,
            "<path class=\"odometry\" style=\"stroke-width:{width_px:.1}\" d=\"M{:.3} {:.3}h0\"><title>{:.1} %</title></path>",
            place.x_m,
            -place.y_m,
            100.0 * place.weight
        );
    }
    let modes = if undecided.is_some() {
        " Blue dots are the places that are left at the end, larger the more probable."
    } else {
        ""
    };
    let controls: String = layers
        .iter()
        .map(|(id, class, label)| {
            format!("<label><input type=\"checkbox\" id=\"show-{id}\" checked><i class=\"{class}\"></i>{label}</label>")
        })
        .collect();
    Ok(format!(
        "<section class=\"card\"><div class=\"head\"><h2>Map and claimed poses</h2><div class=\"layers\">{controls}</div></div>\
         {}<p class=\"caption\">Only poses that are claimed are drawn; the ring is the first, the dot the last.{modes} Drag to \
         move, Ctrl and the wheel or the buttons to zoom; point at the trajectory for stamp and pose.</p></section>\n",
        view.plan("", "map with the claimed poses", &svg, Some(&all))
    ))
}

fn events(report: &Report) -> String {
    let mut rows = String::new();
    for event in &report.events {
        let _ =
            write!(rows, "<tr><td>{}</td><td>{:.1} s</td><td>{:.1} m</td></tr>", event.what, event.at_s, event.at_m);
    }
    let mut places = String::new();
    if let Some(end) = report.ended.as_ref().filter(|end| !end.is_localised) {
        for place in &end.modes {
            let _ = write!(
                places,
                "<tr><td>{:.1} %</td><td>{:.2} m</td><td>{:.2} m</td><td>{:.1}°</td></tr>",
                100.0 * place.weight,
                place.x_m,
                place.y_m,
                place.yaw_rad.to_degrees()
            );
        }
        places = format!(
            "<section class=\"card\"><h2>Undecided: places at the end</h2><div class=\"scroll\"><table><thead><tr><th>weight</th>\
             <th>x</th><th>y</th><th>yaw</th></tr></thead><tbody>{places}</tbody></table></div><p class=\"caption\">{} in all; \
             {:.1} % for a place that was not proposed.</p></section>",
            end.count,
            100.0 * end.elsewhere_probability
        );
    }
    if rows.is_empty() && places.is_empty() {
        return String::new();
    }
    format!(
        "<div class=\"pair\"><section class=\"card\"><h2>Found and lost</h2><div class=\"scroll\"><table><thead><tr><th></th>\
         <th>time</th><th>driven</th></tr></thead><tbody>{rows}</tbody></table></div></section>{places}</div>\n"
    )
}

fn charts(steps: &[LocalizationReport]) -> String {
    let over_time = |value: fn(&LocalizationReport) -> f64| -> Vec<[f64; 2]> {
        steps.iter().map(|step| [step.stamp_s, value(step)]).collect()
    };
    let sigma_m = |step: &LocalizationReport| {
        if step.pose.is_some() { (step.covariance[(0, 0)] + step.covariance[(1, 1)]).max(0.0).sqrt() } else { f64::NAN }
    };
    let charts = [
        (
            Chart {
                title: "Probability of being lost",
                class: "",
                points: over_time(|step| step.lost_probability),
                maximum: Some(1.0),
            },
            "How probable it is that the robot is not where the heaviest mode has it; above a half nothing is claimed.",
        ),
        (
            Chart {
                title: "Share of the scan explained",
                class: "",
                points: over_time(|step| step.explained.on_map),
                maximum: Some(1.0),
            },
            "Rays that end where the map shows something. People and moved furniture lower it.",
        ),
        (
            Chart { title: "Modes", class: "", points: over_time(|step| step.modes.len() as f64), maximum: None },
            "Places that are considered.",
        ),
        (
            Chart {
                title: "Standard deviation of the position, m",
                class: "",
                points: over_time(sigma_m),
                maximum: None,
            },
            "While the pose is claimed.",
        ),
    ];
    let cards: String = charts
        .iter()
        .map(|(chart, meaning)| format!("<section class=\"card\">{}</section>", chart.to_html(meaning)))
        .collect();
    format!("<div class=\"pair\">{cards}</div>\n")
}

fn notes(report: &Report) -> String {
    let items: String = report.notes.iter().map(|note| format!("<li>{}</li>", escape(note))).collect();
    if items.is_empty() {
        String::new()
    } else {
        format!("<section class=\"card\"><h2>Notes</h2><ul>{items}</ul></section>\n")
    }
}
