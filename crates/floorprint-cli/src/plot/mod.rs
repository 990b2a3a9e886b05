//! `floorprint plot`: a run or a session as one picture.

mod drawing;

use crate::compare::Run;
use crate::figure::{DEAD_RECKONING, Figure, LOOPS, TRAJECTORY, TRUTH};
use crate::map::{Stored, is_session};
use crate::outcome::{BadArguments, Outcome};
use crate::run_folder::data_set_name;
use crate::terminal::Terminal;
use crate::truth::TruthFiles;
use clap::Args;
use floorprint::back_end::Verdict;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint_io::{Picture, read_trajectory, write_file, write_png};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Draw a run, or a session, as one picture: map, trajectory, dead reckoning, loop closures, and errors over time where
/// the truth is known.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder of a run, or a session.gpkg.
    run: PathBuf,
    /// TUM file of true poses; where none is named, the one beside the run's data set.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Picture to write: all of it as .svg, or the map with its lines, without any text, as .png.
    #[arg(long, value_name = "FILE", default_value = "plot.svg")]
    out: PathBuf,
}

/// What there is to draw.
struct Plot {
    name: String,
    /// What the drive was and how good the result is, in figures.
    figures: Vec<String>,
    map: Raster<Occupancy>,
    trajectory: Vec<StampedPose>,
    odometry: Vec<StampedPose>,
    /// The poses as they were known at the time.
    live: Vec<StampedPose>,
    truth: Vec<StampedPose>,
    /// Whether the run itself knew the truth.
    was_compared: bool,
    /// Places that were recognised: where the robot was then and again.
    loops: Vec<[StampedPose; 2]>,
}

/// Runs `floorprint plot`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let Arguments { run, truth, out } = arguments;
    let ending = out.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !["svg", "png"].contains(&ending.as_str()) {
        let out = out.display();
        return Err(BadArguments(format!("--out {out}: a picture is written as .svg or .png")).into());
    }
    let mut plot = if is_session(run) { Plot::of_session(run)? } else { Plot::of_run(run)? };
    match truth {
        Some(path) => plot.truth = read_trajectory(path)?,
        None if plot.truth.is_empty() && plot.was_compared => {
            terminal.note("the truth that the run was compared with is not beside its data set: --truth names it");
        }
        None => {}
    }
    match ending.as_str() {
        "png" => write_png(out, &plot.picture())?,
        _ => write_file(out, drawing::draw(&plot)?.as_bytes())?,
    }
    terminal.say(&format!("picture  {}", out.display()));
    Ok(Outcome::Fine)
}

impl Plot {
    fn of_run(folder: &Path) -> anyhow::Result<Self> {
        let Run { report, map, trajectory, .. } = Run::read(folder)?;
        let data_set = report.pointer("/input/path").and_then(Value::as_str).map(Path::new);
        let truth = data_set.and_then(|path| TruthFiles::beside(path).trajectory);
        // Without a LiDAR dead reckoning is the trajectory; without odometry there is none.
        let where_it_is = |file| {
            let path = folder.join(file);
            if path.exists() { read_trajectory(&path) } else { Ok(Vec::new()) }
        };
        Ok(Self {
            name: data_set_name(folder),
            figures: figures(&report),
            odometry: where_it_is("odometry.tum")?,
            live: where_it_is("live.tum")?,
            truth: truth.as_deref().map(read_trajectory).transpose()?.unwrap_or_default(),
            was_compared: report.pointer("/errors/trajectory").is_some(),
            loops: loops(&report, &trajectory),
            map,
            trajectory,
        })
    }

    fn of_session(path: &Path) -> anyhow::Result<Self> {
        let stored = Stored::load(path)?;
        let trajectory = stored.session.trajectory();
        let closures = stored.session.places().map(|places| places.reports()).unwrap_or_default();
        let accepted = closures.iter().filter(|closure| closure.verdict == Verdict::Accepted);
        Ok(Self {
            name: data_set_name(path),
            figures: vec![format!("{} poses", trajectory.len())],
            map: stored.map(path)?,
            odometry: Vec::new(),
            live: Vec::new(),
            truth: Vec::new(),
            was_compared: false,
            loops: accepted.filter_map(|closure| between(closure.frames, &trajectory)).collect(),
            trajectory,
        })
    }

    /// The map with its lines, as pixels.
    fn picture(&self) -> Picture {
        let mut figure = Figure::of_map(&self.map);
        let position = |stamped: &StampedPose| [stamped.pose.x, stamped.pose.y];
        // Many loops would bury the trajectory; the truth would be hidden by it.
        figure.draw_segments(self.loops.iter().map(|ends| ends.each_ref().map(position)), LOOPS, 1.0);
        figure.draw_line(self.odometry.iter().map(position), DEAD_RECKONING, 1.5);
        figure.draw_line(self.trajectory.iter().map(position), TRAJECTORY, 2.0);
        figure.draw_line(self.truth.iter().map(position), TRUTH, 1.0);
        figure.into_picture()
    }
}

/// What the drive was and how good the result is, as far as the report says so.
fn figures(report: &Value) -> Vec<String> {
    let number = |pointer: &str| report.pointer(pointer).and_then(Value::as_f64);
    let error = |pointer: &str, figure: &str, unit: &str, digits: usize, name: &str| {
        let value = number(&format!("/errors/{pointer}/{figure}"))?;
        Some(format!("{name} {value:.digits$}{unit}"))
    };
    [
        report.pointer("/preset").and_then(Value::as_str).map(|preset| format!("preset {preset}")),
        number("/drive/length_m").map(|length_m| format!("{length_m:.1} m")),
        number("/drive/duration_s").map(|duration_s| format!("{duration_s:.0} s")),
        error("trajectory/translation_m", "rmse", " m", 3, "position RMSE"),
        error("trajectory/rotation_deg", "rmse", "°", 2, "heading RMSE"),
        error("relations/all/translation_m", "mean", " m", 4, "relations"),
        error("relations/all/rotation_deg", "mean", "°", 3, "relations"),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The loops that a report says were closed.
fn loops(report: &Value, trajectory: &[StampedPose]) -> Vec<[StampedPose; 2]> {
    let candidates = report.pointer("/loops/candidates").and_then(Value::as_array);
    let ends = |candidate: &Value| {
        let verdict: Verdict = serde_json::from_value(candidate.get("verdict")?.clone()).ok()?;
        let frames: [usize; 2] = serde_json::from_value(candidate.get("frames")?.clone()).ok()?;
        if verdict == Verdict::Accepted { between(frames, trajectory) } else { None }
    };
    candidates.into_iter().flatten().filter_map(ends).collect()
}

/// Where the robot was at two scans.
fn between(frames: [usize; 2], trajectory: &[StampedPose]) -> Option<[StampedPose; 2]> {
    let [older, newer] = frames.map(|frame| trajectory.get(frame).copied());
    Some([older?, newer?])
}
