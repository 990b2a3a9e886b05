//! `report.html`: one page that holds everything and needs no network.

use super::chart::Chart;
use super::{Made, Report};
use crate::figure::{FREE, OCCUPIED, UNKNOWN, scale_bar_length_m};
use crate::run_folder::data_set_name;
use crate::solve::Solution;
use crate::summary::counted;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use floorprint::back_end::ClosureReport;
use floorprint::evaluation::{ErrorStatistics, PoseError, StampIndex};
use floorprint::map::{Occupancy, Raster};
use floorprint::odometry::OdometrySource;
use floorprint::sensors::StampedPose;
use floorprint::{Config, StepReport};
use floorprint_io::RESULTS_OF_RUN;
use std::fmt::Write;
use std::path::Path;

/// Most stretches of contradiction that are listed; `report.json` has them all.
const STRETCHES_SHOWN: usize = 8;

/// Poses that can be pointed at; of longer drives every so many.
const POSES_NAMED: usize = 6000;

/// Everything is shown at first where it is at most so many times as large as the map.
const FARTHEST_SHOWN: f64 = 1.8;

/// What the page shows besides the report's figures.
pub(crate) struct Exhibits<'a> {
    /// The run's result.
    pub(crate) solution: &'a Solution,
    /// The map.
    pub(crate) map: &'a Raster<Occupancy>,
    /// The floor as a PNG file.
    pub(crate) floor_png: Option<&'a [u8]>,
    /// The resolved configuration.
    pub(crate) config: &'a Config,
    /// Where all but the page and `report.json` lies already.
    pub(crate) folder: &'a Path,
}

/// The page as HTML.
///
/// # Errors
/// The map cannot be encoded as a picture.
pub(crate) fn page(report: &Report, exhibits: &Exhibits<'_>) -> Result<String, png::EncodingError> {
    let name = data_set_name(Path::new(&report.input.path));
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{} · Floorprint</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n",
        escape(&name),
        include_str!("page.css")
    );
    for section in [
        header(report, &name),
        tiles(report),
        map_section(report, exhibits)?,
        floor_section(report, exhibits),
        kidnappings(report),
        loops_and_contradictions(report),
        charts(report, exhibits.solution),
        errors(report),
        cost_and_losses(report),
        notes(report),
        files(exhibits.folder),
        configuration(exhibits.config),
        footer(report),
    ] {
        html.push_str(&section);
    }
    let _ = write!(
        html,
        "</main>\n<script type=\"application/json\" id=\"poses\">{}</script>\n<script>\n{}</script>\n</body>\n</html>\n",
        poses(&exhibits.solution.trajectory),
        include_str!("page.js")
    );
    Ok(html)
}

/// The poses that the page can name: seconds since the first, x, y (metres), heading (degrees) and stamp.
pub(crate) fn poses(trajectory: &[StampedPose]) -> String {
    let start_s = trajectory.first().map_or(0.0, |first| first.stamp_s);
    let every = trajectory.len().div_ceil(POSES_NAMED).max(1);
    let pose = |StampedPose { stamp_s, pose }: &StampedPose| {
        let [x, y] = [pose.x, pose.y].map(|metres| fixed(metres, 3));
        format!("[{:.2},{x},{y},{},{stamp_s:.3}]", stamp_s - start_s, fixed(pose.theta.to_degrees(), 2))
    };
    format!("[{}]", trajectory.iter().step_by(every).map(pose).collect::<Vec<_>>().join(","))
}

/// A number with so many decimals; what is rounded to zero has no sign.
pub(super) fn fixed(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|digit| matches!(digit, '0' | '.')) => zero.to_owned(),
        _ => text,
    }
}

fn header(report: &Report, name: &str) -> String {
    let Made { date, command } = &report.made;
    let partial = if report.partial { "<span class=\"badge\">partial: stopped before its end</span>" } else { "" };
    let no_map =
        if report.map.is_none() { "<span class=\"badge\">no LiDAR: dead reckoning, no map</span>" } else { "" };
    format!(
        "<header><h1>{}</h1>{partial}{no_map}<p>{} · preset {} · seed {} · odometry from {}</p>\
         <p>made on {date} by Floorprint {} with <code>{}</code></p></header>\n",
        escape(name),
        escape(report.input.format),
        report.preset,
        report.seed,
        odometry_name(report.drive.odometry),
        report.version,
        escape(command)
    )
}

fn tiles(report: &Report) -> String {
    let mut tiles = String::new();
    let mut tile = |class: &str, figure: String, label: &str, remark: String| {
        let _ =
            write!(tiles, "<div class=\"tile {class}\"><b>{figure}</b><span>{label}</span><span>{remark}</span></div>");
    };
    let errors = &report.errors;
    if let Some(error) = &errors.trajectory {
        let of_odometry = |figure: fn(&floorprint::evaluation::TrajectoryError) -> String| {
            errors.odometry.as_ref().map_or(String::new(), |odometry| format!("dead reckoning {}", figure(odometry)))
        };
        let (position, heading) = (error.translation_m.rmse, error.rotation_deg.rmse);
        tile(
            "good",
            format!("{position:.3} m"),
            "position RMSE",
            of_odometry(|e| format!("{:.3} m", e.translation_m.rmse)),
        );
        tile("good", format!("{heading:.2}°"), "heading RMSE", of_odometry(|e| format!("{:.2}°", e.rotation_deg.rmse)));
    }
    if let Some(relations) = &errors.relations
        && let (Some(translation), Some(rotation)) = (&relations.all.translation_m, &relations.all.rotation_deg)
    {
        let matched = format!("{} of {} relations", relations.all.matched, relations.all.relations);
        tile("good", format!("{:.3} m", translation.mean), "mean translation error", matched.clone());
        tile("good", format!("{:.2}°", rotation.mean), "mean rotation error", matched);
    }
    if let Some(quality) = &errors.map {
        tile(
            "good",
            format!("{:.3}", quality.f1),
            "F1 of occupied cells",
            format!("{:.0} % explored", 100.0 * quality.explored),
        );
    }
    if let Some(texture) = &errors.texture {
        let coverage =
            texture.coverage.map_or(String::new(), |share| format!("{:.1} % of the floor seen", 100.0 * share));
        tile("good", format!("{:.1} / 255", texture.mean_absolute_error), "floor colour error", coverage);
    }
    let drive = &report.drive;
    tile(
        "",
        format!("{:.1} m", drive.length_m),
        "driven",
        format!("in {:.0} s, {} poses", drive.duration_s, drive.poses),
    );
    if let Some(map) = &report.map {
        let cells = format!("{:.0} mm cells", 1e3 * map.resolution_m);
        tile("", format!("{:.0} m²", map.free_m2), "free floor", cells);
    }
    if let Some(texture) = &report.texture {
        tile("", format!("{:.0} m²", texture.painted_m2), "painted", format!("from {} images", texture.images));
    }
    tile(
        "",
        format!("{:.0}×", report.cost.real_time_factor),
        "real time",
        format!("{:.2} s of work", report.cost.wall_s),
    );
    tile("", format!("{:.2} %", 100.0 * report.dropped_share), "of the data dropped", String::new());
    format!("<section class=\"tiles\">{tiles}</section>\n")
}

fn map_section(report: &Report, exhibits: &Exhibits<'_>) -> Result<String, png::EncodingError> {
    let Exhibits { solution, map, .. } = exhibits;
    let truth = &report.errors.true_trajectory;
    let drawn: [&[StampedPose]; 3] = [&solution.trajectory, &solution.odometry, truth];
    let (near, all) = (View::around(&drawn, map), View::of_all(&drawn, map));
    // Dead reckoning that runs far off must not shrink the map to a spot: then a button shows it.
    let view = if all.longest_m() < FARTHEST_SHOWN * near.longest_m() { View::of_all(&drawn, map) } else { near };
    let view = view.with_room_for_scale_bar();
    let has_map = report.map.is_some();
    let (mut layers, mut svg) = (Vec::new(), String::new());
    if has_map {
        layers.extend([("map", "cells", "map", "checked"), ("trajectory", "trajectory", "trajectory", "checked")]);
        if solution.has_odometry() {
            layers.push(("odometry", "odometry", "dead reckoning", "checked"));
        }
        svg.push_str(&view.image("cells", map.origin_m, map.width, map.height, map.resolution_m, &map_png(map)?));
        svg.push_str(&view.path("odometry", &solution.odometry));
    } else {
        layers.push(("trajectory", "trajectory", "dead reckoning", "checked"));
    }
    if !truth.is_empty() {
        layers.push(("truth", "truth", "truth", "checked"));
        svg.push_str(&view.path("truth", truth));
    }
    if let Some(loops) = report.loops.as_ref().filter(|loops| loops.closed > 0) {
        // Many loops would bury the trajectory.
        layers.push(("loops", "loops", "loop closures", ""));
        let ends = loops.accepted().map(|closure| closure.frames.map(|frame| &solution.trajectory[frame]));
        svg.push_str(&view.segments("loops", ends));
    }
    svg.push_str(&view.path("trajectory", &solution.trajectory));
    svg.push_str(&ends(&solution.trajectory));
    let controls: String = layers
        .iter()
        .map(|(id, class, label, checked)| {
            format!(
                "<label><input type=\"checkbox\" id=\"show-{id}\" {checked}><i class=\"{class}\"></i>{label}</label>"
            )
        })
        .collect();
    let (title, label, colors) = if has_map {
        (
            "Map and trajectory",
            if solution.has_odometry() { "map with trajectory and dead reckoning" } else { "map with trajectory" },
            "Free cells are white, occupied ones black, unknown ones grey (in dark mode the other way round). ",
        )
    } else {
        ("Trajectory", "trajectory by dead reckoning", "")
    };
    Ok(format!(
        "<section class=\"card\"><div class=\"head\"><h2>{title}</h2><div class=\"layers\">{controls}</div></div>\
         {}<p class=\"caption\">{colors}The ring is the start, the dot the end. Drag to move, Ctrl and the wheel or the \
         buttons to zoom; point at the trajectory for stamp and pose.</p></section>\n",
        view.plan("", label, &svg, Some(&all))
    ))
}

fn floor_section(report: &Report, exhibits: &Exhibits<'_>) -> String {
    let (Some(floor), Some(png), Some(summary)) = (&exhibits.solution.floor, exhibits.floor_png, &report.texture)
    else {
        return String::new();
    };
    let map = &floor.map;
    let view = View {
        low_m: map.origin_m,
        high_m: [
            map.origin_m[0] + map.width as f64 * map.resolution_m,
            map.origin_m[1] + map.height as f64 * map.resolution_m,
        ],
    }
    .with_room_for_scale_bar();
    let nothing_new = match summary.images_of_nothing_new {
        0 => String::new(),
        pairs => format!(" ({pairs} more show the same places)"),
    };
    let mut svg = view.image("", map.origin_m, map.width, map.height, map.resolution_m, png);
    svg.push_str(&view.path("trajectory", &exhibits.solution.trajectory));
    format!(
        "<section class=\"card\"><div class=\"head\"><h2>Floor</h2><div class=\"layers\">\
         <label><input type=\"checkbox\" id=\"show-path\"><i class=\"trajectory\"></i>trajectory</label></div></div>\
         {}<p class=\"caption\">{:.1} m² painted from {} image pairs{nothing_new}, {:.0} mm cells.</p></section>\n",
        view.plan("floor", "colours of the floor", &svg, None),
        summary.painted_m2,
        summary.images,
        1e3 * summary.resolution_m
    )
}

fn kidnappings(report: &Report) -> String {
    let uncertain = report.uncertain.as_ref().map_or(String::new(), |uncertain| {
        let words = escape(&uncertain.in_words());
        format!("<section class=\"card\"><h2>How uncertain the poses are</h2><p>{words}</p></section>\n")
    });
    if report.kidnappings.is_empty() {
        return uncertain;
    }
    let items: String = report.kidnappings.iter().map(|at| format!("<li>{}</li>", escape(&at.in_words()))).collect();
    format!("{uncertain}<section class=\"card\"><h2>Robot carried elsewhere</h2><ul>{items}</ul></section>\n")
}

fn loops_and_contradictions(report: &Report) -> String {
    let mut cards = String::new();
    if let Some(loops) = &report.loops {
        let mut rows = String::new();
        for verdict in &loops.verdicts {
            let _ = write!(rows, "<tr><td>{}</td><td>{}</td></tr>", verdict.meaning, verdict.count);
        }
        let most = |of: fn(&ClosureReport) -> f64| loops.accepted().map(of).fold(0.0, f64::max);
        let caption = match (loops.candidates.len(), loops.closed) {
            (0, _) => "No place was passed twice.".to_owned(),
            (_, 0) => "Places close to each other were compared; none was recognised.".to_owned(),
            _ => format!(
                "Places close to each other were compared. The largest correction was {:.2} m and {:.1}°.",
                most(|closure| closure.correction_m),
                most(|closure| closure.correction_rad.abs().to_degrees())
            ),
        };
        let _ = write!(
            cards,
            "<section class=\"card\"><h2>Loops</h2><div class=\"scroll\"><table><tbody>{rows}</tbody></table></div><p class=\"caption\">{caption}</p></section>"
        );
    }
    if let Some(filter) = report.filter.as_ref().filter(|filter| !filter.contradictions.is_empty()) {
        let contradictions = &filter.contradictions;
        let start_s = report.drive.start_s;
        let mut longest: Vec<_> = contradictions.iter().collect();
        longest.sort_by_key(|stretch| std::cmp::Reverse(stretch.scans));
        let mut rows = String::new();
        for stretch in longest.iter().take(STRETCHES_SHOWN) {
            let [from_s, to_s] = [stretch.from_s, stretch.to_s].map(|stamp_s| stamp_s - start_s);
            let time =
                if stretch.scans > 1 { format!("{from_s:.1} s – {to_s:.1} s") } else { format!("{from_s:.1} s") };
            let _ = write!(rows, "<tr><td>{time}</td><td>{}</td></tr>", stretch.scans);
        }
        let _ = write!(
            cards,
            "<section class=\"card\"><h2>Scan against odometry</h2><table><thead><tr><th>time of the drive</th>\
             <th>scans</th></tr></thead><tbody>{rows}</tbody></table>\
             <p class=\"caption\">They contradicted each other at {} of {}, in {}{}; there the scan won.</p></section>",
            filter.odometry_rejections,
            counted(report.drive.scans, "scan"),
            counted(contradictions.len(), "place"),
            if contradictions.len() > STRETCHES_SHOWN { ", the longest of which are listed" } else { "" }
        );
    }
    pair(&cards)
}

/// Cards side by side; nothing where there is none.
fn pair(cards: &str) -> String {
    if cards.is_empty() { String::new() } else { format!("<div class=\"pair\">{cards}</div>\n") }
}

fn charts(report: &Report, solution: &Solution) -> String {
    let over_time = |value: fn(&StepReport) -> f64| -> Vec<[f64; 2]> {
        solution.steps.iter().map(|step| [step.stamp_s, value(step)]).collect()
    };
    let particles = report.filter.as_ref().map_or(0, |filter| filter.particles);
    let effective = Chart {
        title: "Effective number of particles",
        class: "",
        points: over_time(|step| step.filter.effective_particles),
        maximum: Some(particles as f64),
    };
    let score = Chart { title: "Match score", class: "", points: over_time(|step| step.filter.score), maximum: None };
    let inliers = Chart {
        title: "Share of points on the map",
        class: "",
        points: over_time(|step| step.filter.inlier_share),
        maximum: Some(1.0),
    };
    let mut charts = Vec::new();
    if particles > 1 {
        charts.push((effective, "How many particles really carry weight; they are resampled when these are few."));
    }
    if report.filter.is_some() {
        charts.extend([
            (
                score,
                "How well each scan fits the map, in the filter's own measure: sudden drops are places to look at.",
            ),
            (
                inliers,
                "Of each scan, how many of its points lie on walls of the map, from 0 to 1; new ground lowers it.",
            ),
        ]);
    }
    if !report.errors.true_trajectory.is_empty() {
        let truth = StampIndex::new(&report.errors.true_trajectory);
        let errors = |poses: &[StampedPose], error: fn(PoseError) -> f64| -> Vec<[f64; 2]> {
            let at = |pose: &StampedPose| {
                let truth = truth.interpolated(pose.stamp_s, 1e-4, 0.5)?;
                Some([pose.stamp_s, error(PoseError::between(&truth, &pose.pose))])
            };
            poses.iter().filter_map(at).collect()
        };
        let position: fn(PoseError) -> f64 = |error| error.translation_m;
        // Dead reckoning has a chart of its own: its errors would flatten the others.
        for (title, class, poses, error) in [
            ("Position error, m", "trajectory", &solution.trajectory, position),
            ("Heading error, °", "trajectory", &solution.trajectory, |error| error.rotation_deg),
            ("Position error of dead reckoning, m", "odometry", &solution.odometry, position),
        ] {
            let chart = Chart { title, class, points: errors(poses, error), maximum: None };
            if !poses.is_empty() {
                charts.push((chart, "Distance from the truth at each pose, without alignment."));
            }
        }
    }
    let cards: String = charts
        .iter()
        .map(|(chart, meaning)| format!("<section class=\"card\">{}</section>", chart.to_html(meaning)))
        .collect();
    pair(&cards)
}

fn errors(report: &Report) -> String {
    let mut rows = String::new();
    let mut row = |name: &str, statistics: Option<&ErrorStatistics>| {
        if let Some(ErrorStatistics { rmse, mean, median, max, .. }) = statistics {
            let _ = write!(
                rows,
                "<tr><td>{name}</td><td>{rmse:.4}</td><td>{mean:.4}</td><td>{median:.4}</td><td>{max:.4}</td></tr>"
            );
        }
    };
    let errors = &report.errors;
    for (name, error) in [("trajectory", &errors.trajectory), ("dead reckoning", &errors.odometry)] {
        if let Some(error) = error {
            row(&format!("{name}, position, m"), Some(&error.translation_m));
            row(&format!("{name}, heading, °"), Some(&error.rotation_deg));
        }
    }
    for (name, relations) in [("trajectory", &errors.relations), ("dead reckoning", &errors.odometry_relations)] {
        if let Some(relations) = relations {
            row(&format!("{name}, relations, m"), relations.all.translation_m.as_ref());
            row(&format!("{name}, relations, °"), relations.all.rotation_deg.as_ref());
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<section class=\"card\"><h2>Errors against the truth</h2><div class=\"scroll\"><table><thead><tr><th></th>\
         <th>RMSE</th><th>mean</th><th>median</th><th>max</th></tr></thead><tbody>{rows}</tbody></table></div></section>\n"
    )
}

fn cost_and_losses(report: &Report) -> String {
    let total: f64 = report.cost.phases.iter().map(|phase| phase.seconds).sum();
    let mut phases = String::new();
    for phase in &report.cost.phases {
        let share = 100.0 * phase.seconds / total.max(f64::MIN_POSITIVE);
        let _ = write!(
            phases,
            "<tr><td>{}</td><td>{:.3} s</td><td class=\"share\"><i style=\"width:{share:.1}%\"></i></td></tr>",
            phase.phase, phase.seconds
        );
    }
    let cpu = report.cost.cpu_s.map_or(String::new(), |seconds| format!(" · {seconds:.2} s of CPU"));
    let memory =
        report.cost.peak_memory_bytes.map_or(String::new(), |bytes| format!(" · {:.0} MB at most", bytes as f64 / 1e6));
    let mut losses = String::new();
    for dropped in &report.dropped {
        let _ = write!(losses, "<tr><td>{}</td><td>{}</td></tr>", escape(&dropped.reason), dropped.count);
    }
    if losses.is_empty() {
        losses.push_str("<tr><td>nothing</td><td>0</td></tr>");
    }
    format!(
        "<div class=\"pair\"><section class=\"card\"><h2>Time</h2><div class=\"scroll\"><table><tbody>{phases}</tbody></table></div>\
         <p class=\"caption\">{:.2} s in all, {} thread{}{cpu}{memory}</p></section>\
         <section class=\"card\"><h2>Dropped data</h2><div class=\"scroll\"><table><tbody>{losses}</tbody></table></div></section></div>\n",
        report.cost.wall_s,
        report.cost.threads,
        if report.cost.threads == 1 { "" } else { "s" }
    )
}

fn notes(report: &Report) -> String {
    if report.notes.is_empty() {
        return String::new();
    }
    let items: String = report.notes.iter().map(|note| format!("<li>{}</li>", escape(note))).collect();
    format!("<section class=\"card\"><h2>Notes</h2><ul>{items}</ul></section>\n")
}

/// Links to what lies beside the page.
fn files(folder: &Path) -> String {
    let lies_there = |name: &str| name == "report.json" || folder.join(name).is_file();
    let items: String = RESULTS_OF_RUN
        .iter()
        .filter(|(file, _)| lies_there(file))
        .map(|(file, what)| format!("<li><a href=\"{file}\">{file}</a> {what}</li>"))
        .collect();
    format!("<section class=\"card\"><h2>Files beside this page</h2><ul class=\"files\">{items}</ul></section>\n")
}

fn configuration(config: &Config) -> String {
    format!(
        "<details class=\"card\"><summary>Configuration</summary><pre>{}</pre></details>\n",
        escape(config.to_toml().trim())
    )
}

fn footer(report: &Report) -> String {
    format!(
        "<footer>Floorprint {} · {} · calibration {} · SHA-256 {}</footer>\n",
        report.version,
        escape(&report.input.path),
        escape(&report.input.robot),
        report.input.sha256
    )
}

fn odometry_name(source: OdometrySource) -> &'static str {
    match source {
        OdometrySource::Auto => "whatever there is",
        OdometrySource::Wheels => "the wheels",
        OdometrySource::WheelsAndGyro => "wheels and gyro",
        OdometrySource::Log => "the log",
        OdometrySource::ScanMatching => "scan matching alone",
    }
}

/// A part of the world, drawn in metres with y upwards.
pub(crate) struct View {
    low_m: [f64; 2],
    high_m: [f64; 2],
}

impl View {
    /// A view with some air around of the map's walls and the trajectories. Single far returns
    /// and a dead reckoning that runs off must not shrink the map to a spot: walls count but for
    /// the outermost few, trajectories up to a little beyond them.
    pub(crate) fn around(trajectories: &[&[StampedPose]], map: &Raster<Occupancy>) -> Self {
        const OUTERMOST_SHARE: f64 = 0.004;
        let occupied = || (0..map.cells.len()).filter(|index| map.cells[*index] == Occupancy::Occupied);
        let (mut low_m, mut high_m) = ([0.0; 2], [0.0; 2]);
        for axis in 0..2 {
            let mut places: Vec<f64> = occupied().map(|index| map.center_m(index)[axis]).collect();
            places.sort_by(f64::total_cmp);
            let outermost = (places.len() as f64 * OUTERMOST_SHARE) as usize;
            let (low, high) = match (places.get(outermost), places.iter().rev().nth(outermost)) {
                (Some(low), Some(high)) => (*low, *high),
                // Without a wall all of the map counts.
                _ => {
                    let cells = [map.width, map.height][axis];
                    (map.origin_m[axis], map.origin_m[axis] + cells as f64 * map.resolution_m)
                }
            };
            let furthest_m = 0.15 * (high - low) + 1.0;
            (low_m[axis], high_m[axis]) = (low, high);
            for StampedPose { pose, .. } in trajectories.iter().copied().flatten() {
                let position = if axis == 0 { pose.x } else { pose.y };
                low_m[axis] = low_m[axis].min(position.max(low - furthest_m));
                high_m[axis] = high_m[axis].max(position.min(high + furthest_m));
            }
        }
        let air_m = 0.03 * (high_m[0] - low_m[0]).max(high_m[1] - low_m[1]);
        Self { low_m: low_m.map(|low| low - air_m), high_m: high_m.map(|high| high + air_m) }
    }

    pub(crate) fn longest_m(&self) -> f64 {
        let [width, height] = self.size_m();
        width.max(height)
    }

    /// All that is drawn, however far off.
    pub(crate) fn of_all(trajectories: &[&[StampedPose]], map: &Raster<Occupancy>) -> Self {
        let mut view = Self::around(&[], map);
        for StampedPose { pose, .. } in trajectories.iter().copied().flatten() {
            for (axis, position) in [pose.x, pose.y].into_iter().enumerate() {
                view.low_m[axis] = view.low_m[axis].min(position);
                view.high_m[axis] = view.high_m[axis].max(position);
            }
        }
        let air_m = 0.03 * view.longest_m();
        Self { low_m: view.low_m.map(|low| low - air_m), high_m: view.high_m.map(|high| high + air_m) }
    }

    /// Width and height, metres.
    pub(crate) fn size_m(&self) -> [f64; 2] {
        [self.high_m[0] - self.low_m[0], self.high_m[1] - self.low_m[1]]
    }

    /// Left, top, width and height, y downwards, metres.
    pub(crate) fn view_box(&self) -> String {
        let [width, height] = self.size_m();
        format!("{:.3} {:.3} {width:.3} {height:.3}", self.low_m[0], -self.high_m[1])
    }

    /// A plan with its buttons, scale bar and read-out, which the page's script fills; `all` is what a button shows.
    pub(crate) fn plan(&self, class: &str, label: &str, content: &str, all: Option<&Self>) -> String {
        let everything = all.map_or(String::new(), |all| format!(" data-all=\"{}\"", all.view_box()));
        let button = all.map_or("", |_| "<button type=\"button\" name=\"all\">everything</button>");
        format!(
            "<div class=\"paper plan {class}\"{everything}><svg viewBox=\"{}\" role=\"img\" tabindex=\"0\" \
             aria-label=\"{label}\">{content}{}<path class=\"here\" visibility=\"hidden\" d=\"\"/></svg>\
             <div class=\"zoom\"><button type=\"button\" name=\"in\" aria-label=\"zoom in\">+</button>\
             <button type=\"button\" name=\"out\" aria-label=\"zoom out\">−</button>\
             <button type=\"button\" name=\"fit\">fit</button>{button}</div>\
             <div class=\"scale\"><i></i><span></span></div><output></output></div>",
            self.view_box(),
            self.scale_bar()
        )
    }

    /// A bar of a round length, for who has no script: with one there is another that follows the zoom.
    fn scale_bar(&self) -> String {
        let (longest_m, length_m) = (self.longest_m(), scale_bar_length_m(self.size_m()[0]));
        let [air_m, tip_m, letters_m] = [0.012, 0.01, 0.024].map(|share| share * longest_m);
        let (left_m, below_m) = (self.low_m[0] + air_m, -self.low_m[1] - air_m);
        format!(
            "<g class=\"bar\"><path d=\"M{left_m:.3} {:.3}v{tip_m:.3}h{length_m}v-{tip_m:.3}\"/>\
             <text x=\"{:.3}\" y=\"{below_m:.3}\" font-size=\"{letters_m:.3}\">{length_m} m</text></g>",
            below_m - tip_m,
            left_m + length_m + air_m
        )
    }

    pub(crate) fn image(
        &self,
        class: &str,
        origin_m: [f64; 2],
        width: usize,
        height: usize,
        resolution_m: f64,
        png: &[u8],
    ) -> String {
        let (width_m, height_m) = (width as f64 * resolution_m, height as f64 * resolution_m);
        format!(
            "<image class=\"{class}\" x=\"{:.3}\" y=\"{:.3}\" width=\"{width_m:.3}\" height=\"{height_m:.3}\" \
             preserveAspectRatio=\"none\" href=\"data:image/png;base64,{}\"/>",
            origin_m[0],
            -(origin_m[1] + height_m),
            STANDARD.encode(png)
        )
    }

    /// A trajectory as a path; points nearer to each other than can be seen are left out. Nothing where there is no pose.
    pub(crate) fn path(&self, class: &str, poses: &[StampedPose]) -> String {
        if poses.is_empty() {
            return String::new();
        }
        let least_m = self.longest_m() / 2000.0;
        let mut data = String::new();
        let mut last: Option<[f64; 2]> = None;
        for StampedPose { pose, .. } in poses {
            if last.is_some_and(|[x, y]| (pose.x - x).hypot(pose.y - y) < least_m) {
                continue;
            }
            let command = if last.is_none() { 'M' } else { 'L' };
            let _ = write!(data, "{command}{:.3} {:.3}", pose.x, -pose.y);
            last = Some([pose.x, pose.y]);
        }
        format!("<path class=\"{class}\" d=\"{data}\"/>")
    }

    /// Straight lines, each between two poses.
    pub(crate) fn segments<'a>(&self, class: &str, ends: impl Iterator<Item = [&'a StampedPose; 2]>) -> String {
        let mut data = String::new();
        for [from, to] in ends {
            let _ = write!(data, "M{:.3} {:.3}L{:.3} {:.3}", from.pose.x, -from.pose.y, to.pose.x, -to.pose.y);
        }
        format!("<path class=\"{class}\" d=\"{data}\"/>")
    }

    /// The same view with room for a scale bar at the bottom.
    pub(crate) fn with_room_for_scale_bar(mut self) -> Self {
        self.low_m[1] -= 0.05 * self.longest_m();
        self
    }
}

/// A ring where the drive begins and a dot where it ends, of the same size at any zoom.
pub(crate) fn ends(poses: &[StampedPose]) -> String {
    let dot = |class: &str, stamped: Option<&StampedPose>| {
        stamped.map_or(String::new(), |StampedPose { pose, .. }| {
            ["", " inner"]
                .map(|part| {
                    format!("<path class=\"{class}{part} trajectory-end\" d=\"M{:.3} {:.3}h0\"/>", pose.x, -pose.y)
                })
                .concat()
        })
    };
    dot("start", poses.first()) + &dot("end", poses.last())
}

/// The map as a small PNG, one pixel a cell.
pub(crate) fn map_png(map: &Raster<Occupancy>) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let length = |cells: usize| u32::try_from(cells).unwrap_or(0);
    let mut encoder = png::Encoder::new(&mut bytes, length(map.width), length(map.height));
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette([UNKNOWN, FREE, OCCUPIED].concat());
    let level = |cell: &Occupancy| match cell {
        Occupancy::Unknown => 0,
        Occupancy::Free => 1,
        Occupancy::Occupied => 2,
    };
    let packed: Vec<u8> = map
        .cells
        .chunks(map.width.max(1))
        .flat_map(|row| row.chunks(4))
        .map(|cells| cells.iter().enumerate().fold(0, |byte, (index, cell)| byte | level(cell) << (6 - 2 * index)))
        .collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&packed)?;
    writer.finish()?;
    Ok(bytes)
}

/// Text that is safe between tags and in attributes.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::geometry::Pose2;

    #[test]
    fn what_is_rounded_to_zero_has_no_sign() {
        let pose = StampedPose { stamp_s: 2.0, pose: Pose2::new(-0.0001, -0.5, -1e-6) };
        assert_eq!(poses(&[pose]), "[[0.00,0.000,-0.500,0.00,2.000]]");
    }

    #[test]
    fn a_plan_has_a_scale_bar_without_a_script() {
        let view = View { low_m: [0.0; 2], high_m: [20.0, 10.0] };
        assert!(view.plan("", "map", "", None).contains("h5v-0.200\"/><text"), "{}", view.plan("", "map", "", None));
    }
}
