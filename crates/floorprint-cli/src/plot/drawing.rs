//! The picture as SVG: a title, the map with its lines, and charts of errors over time.

use super::Plot;
use crate::compare::distances;
use crate::figure::scale_bar_length_m;
use crate::report::chart::{self, Chart};
use crate::report::page::{View, ends, escape, map_png};
use floorprint::evaluation::StampIndex;
use floorprint::sensors::StampedPose;
use std::fmt::Write as _;

/// Sizes in pixels, as they are where the picture is shown as large as it is meant to be: two charts and a gap.
const WIDTH: f64 = 2.0 * chart::WIDTH + GAP;
const GAP: f64 = 20.0;
const MARGIN: f64 = 24.0;
const HEAD: f64 = 100.0;
const HIGHEST_PLAN: f64 = 1000.0;
/// Height of a chart's title.
const CAPTION: f64 = 24.0;

/// How it looks whoever shows it; the plan's lines have widths in metres, and follow.
const STYLE: &str = "text{font-family:system-ui,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;fill:#14181f}\
    path{fill:none;stroke-linejoin:round;stroke-linecap:round}image{image-rendering:pixelated}\
    .name{font-size:26px;font-weight:600}.soft{font-size:15px;fill:#5b6472}.legend,.title{font-size:15px}\
    .tick{font-size:11px;fill:#5b6472}.grid{stroke:#e1e5ea}.line{stroke-width:1.4}.bar{stroke:#14181f;stroke-width:2}\
    .trajectory{stroke:#dc2626}.odometry{stroke:#2563eb}.truth{stroke:#15803d}.loops{stroke:#a21caf;stroke-opacity:.6}\
    .trajectory-end{stroke:#dc2626}.start.inner,.end{stroke:#fff}.end.inner{stroke:#dc2626}";

/// Draws it.
///
/// # Errors
/// The map cannot be encoded as a picture.
pub(super) fn draw(plot: &Plot) -> Result<String, png::EncodingError> {
    let view = View::around(&[&plot.trajectory, &plot.odometry, &plot.truth], &plot.map).with_room_for_scale_bar();
    let [width_m, height_m] = view.size_m();
    let height = (WIDTH * height_m / width_m).min(HIGHEST_PLAN);
    let px_per_m = (WIDTH / width_m).min(height / height_m);
    let mut svg = head(plot);
    let _ = writeln!(
        svg,
        "<rect x=\"{MARGIN}\" y=\"{HEAD}\" width=\"{WIDTH}\" height=\"{height:.0}\" fill=\"#cdcdcd\"/>\
         <svg x=\"{MARGIN}\" y=\"{HEAD}\" width=\"{WIDTH}\" height=\"{height:.0}\" viewBox=\"{}\">{}{}</svg>",
        view.view_box(),
        widths(px_per_m),
        plan(plot, &view)?
    );
    svg.push_str(&scale_bar(px_per_m, HEAD + height));
    let mut charts = 0;
    let mut below = HEAD + height;
    for chart in errors(plot) {
        let Some(lines) = chart.lines("s", None) else { continue };
        let left = if charts % 2 == 0 { MARGIN } else { MARGIN + chart::WIDTH + GAP };
        let top = HEAD + height + GAP + f64::from(charts / 2) * (chart::HEIGHT + CAPTION + GAP);
        let _ = writeln!(
            svg,
            "<g transform=\"translate({left} {top:.0})\"><text class=\"title\" y=\"15\">{}</text>\
             <g transform=\"translate(0 {CAPTION})\">{lines}</g></g>",
            chart.title
        );
        charts += 1;
        below = top + CAPTION + chart::HEIGHT;
    }
    let (all_width, all_height) = (WIDTH + 2.0 * MARGIN, below + MARGIN);
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{all_width}\" height=\"{all_height:.0}\" \
         viewBox=\"0 0 {all_width} {all_height:.0}\">\n<style>{STYLE}</style>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{svg}</svg>\n"
    ))
}

/// Name, figures and legend.
fn head(plot: &Plot) -> String {
    let mut head = format!(
        "<text class=\"name\" x=\"{MARGIN}\" y=\"40\">{}</text><text class=\"soft\" x=\"{MARGIN}\" y=\"62\">{}</text>\n",
        escape(&plot.name),
        escape(&plot.figures.join(" · "))
    );
    let mut left = MARGIN;
    for (class, name, is_drawn) in [
        ("trajectory", "trajectory", !plot.trajectory.is_empty()),
        ("odometry", "dead reckoning", !plot.odometry.is_empty()),
        ("truth", "truth", !plot.truth.is_empty()),
        ("loops", "loop closures", !plot.loops.is_empty()),
    ] {
        if !is_drawn {
            continue;
        }
        let _ = writeln!(
            head,
            "<path class=\"{class}\" stroke-width=\"3\" d=\"M{left} 84h24\"/>\
             <text class=\"legend\" x=\"{}\" y=\"89\">{name}</text>",
            left + 32.0
        );
        // There is no telling how wide the letters are.
        left += 32.0 + 8.5 * name.chars().count() as f64 + 24.0;
    }
    head
}

/// The widths of the plan's lines, in metres.
fn widths(px_per_m: f64) -> String {
    let m = |px: f64| format!("{:.4}", px / px_per_m);
    format!(
        "<style>.plan{{stroke-width:{}}}.plan .odometry{{stroke-width:{}}}.plan .loops{{stroke-width:{}}}\
         .plan .truth{{stroke-dasharray:{} {}}}.plan .trajectory-end{{stroke-width:{}}}\
         .plan .trajectory-end.inner{{stroke-width:{}}}</style>",
        m(2.0),
        m(1.5),
        m(1.0),
        m(6.0),
        m(4.0),
        m(13.0),
        m(8.0)
    )
}

/// The map and its lines.
fn plan(plot: &Plot, view: &View) -> Result<String, png::EncodingError> {
    let map = &plot.map;
    let image = view.image("", map.origin_m, map.width, map.height, map.resolution_m, &map_png(map)?);
    let mut plan = format!("<g class=\"plan\">{image}{}", view.path("odometry", &plot.odometry));
    // Many loops would bury the trajectory.
    plan.push_str(&view.segments("loops", plot.loops.iter().map(|[older, newer]| [older, newer])));
    plan.push_str(&view.path("trajectory", &plot.trajectory));
    // Above the trajectory, which it would else be hidden by.
    plan.push_str(&view.path("truth", &plot.truth));
    plan.push_str(&ends(&plot.trajectory));
    plan.push_str("</g>");
    Ok(plan)
}

/// A bar of a round length in the plan's lower left corner.
fn scale_bar(px_per_m: f64, bottom: f64) -> String {
    let length_m = scale_bar_length_m(WIDTH / px_per_m);
    let (left, right, y) = (MARGIN + 16.0, MARGIN + 16.0 + length_m * px_per_m, bottom - 16.0);
    format!(
        "<path class=\"bar\" d=\"M{left} {:.1}V{y:.1}H{right:.1}V{:.1}\"/>\
         <text class=\"legend\" x=\"{:.1}\" y=\"{:.1}\">{length_m} m</text>\n",
        y - 7.0,
        y - 7.0,
        right + 8.0,
        y + 1.0
    )
}

/// Errors over time against the truth; where it is not known, how much was put right later.
fn errors(plot: &Plot) -> Vec<Chart<'static>> {
    let chart = |title, class, poses: &[StampedPose], truth: &StampIndex, axis: usize| {
        let points = distances(poses, truth).iter().map(|distance| [distance[0], distance[axis]]).collect();
        Chart { title, class, points, maximum: None }
    };
    if plot.truth.is_empty() {
        let last = StampIndex::new(&plot.trajectory);
        return vec![
            chart("What was put right later in the position, m", "trajectory", &plot.live, &last, 1),
            chart("What was put right later in the heading, °", "trajectory", &plot.live, &last, 2),
        ];
    }
    let truth = StampIndex::new(&plot.truth);
    vec![
        chart("Position error, m", "trajectory", &plot.trajectory, &truth, 1),
        chart("Heading error, °", "trajectory", &plot.trajectory, &truth, 2),
        chart("Position error of dead reckoning, m", "odometry", &plot.odometry, &truth, 1),
        chart("Heading error of dead reckoning, °", "odometry", &plot.odometry, &truth, 2),
    ]
}
