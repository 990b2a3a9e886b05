//! `floorprint localize`: a robot found and followed in a finished map.

mod page;
mod report;
mod update;

use crate::config::Settings;
use crate::figure::{Color, Figure, TRAJECTORY};
use crate::interrupt::Interrupt;
use crate::map::{is_session, map_path};
use crate::number::number;
use crate::outcome::Outcome;
use crate::run_folder;
use crate::stopwatch::ScanTimes;
use crate::terminal::Terminal;
use crate::topics::Topics;
use anyhow::{Context as _, ensure};
use clap::Args;
use floorprint::geometry::Pose2;
use floorprint::localization::{LocalizationMap, LocalizationReport, Localizer, Start};
use floorprint::map::{Occupancy, Raster};
use floorprint_io::{
    Contents, RunFolder, SessionFile, free_beside, open, read_map, read_trajectory, write_file, write_png,
    write_trajectory,
};
use report::Report;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use update::{Found, Update};

/// Find a robot in a finished map and follow it. The map is never written.
///
/// Without --start the robot may be anywhere in the map; its pose is claimed once one place stands alone. Where the
/// drive does not decide it, the places that are left are listed with their weights, and none is claimed.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Map: the folder of a run or its session.gpkg, or a map.yaml of ROS with its picture.
    #[arg(value_parser = map_path())]
    map: PathBuf,
    /// Data set: a file or a folder, recognised by its content.
    path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    /// Where the robot starts in the map's frame, metres and radians; or unknown.
    #[arg(long, value_name = "X,Y,YAW", default_value = "unknown", value_parser = parse_start)]
    start: Start,
    /// TUM file of true poses in the map's frame, to compare with.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Topic of a bag's scans. Can be repeated: several LiDARs are used together.
    #[arg(long, value_name = "TOPIC")]
    scan: Vec<String>,
    /// Topic of a bag's odometry; /tf for the odometry among its transforms.
    #[arg(long, value_name = "TOPIC")]
    odom: Option<String>,
    /// Frame of a bag that is taken for the robot's body.
    #[arg(long, value_name = "FRAME")]
    base: Option<String>,
    #[command(flatten)]
    settings: Settings,
    /// Threads that share the work; the results are the same for any number [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: Option<u16>,
    /// Folder of the results [default: runs/NAME-localized after the data set, with a number where that exists].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the folder if it exists.
    #[arg(long)]
    force: bool,
    /// Tell what changed since the map was made, with the times at which it was seen: printed as `map diff` does, and left
    /// in changes.geojson and changes.png.
    #[arg(long)]
    update: bool,
    /// Put this drive and its changes into a new session besides; the map must be a session.
    #[arg(long, value_name = "SESSION", requires = "update")]
    update_session: Option<PathBuf>,
    /// How many times its size a file of the data set may take in memory, besides 256 MB [default: 64].
    #[arg(long, value_name = "TIMES", value_parser = number(0.0, 1e9))]
    max_expansion: Option<f64>,
}

/// Colour of modes that are not claimed, and of the truth.
const MODE: Color = [37, 99, 235];
const TRUTH: Color = [21, 128, 61];

/// A pose in the words of the command line.
pub(crate) fn parse_start(text: &str) -> Result<Start, String> {
    if text == "unknown" {
        return Ok(Start::Unknown);
    }
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|number: &f64| number.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[x, y, yaw]) => Ok(Start::At(Pose2::new(x, y, yaw))),
        _ => Err("expected x,y,yaw in metres and radians, as 1.5,-2,0.3, or unknown".to_owned()),
    }
}

/// The map of a session or of a file of ROS, and as it is drawn.
pub(crate) fn read_any_map(path: &Path) -> anyhow::Result<(LocalizationMap, Raster<Occupancy>)> {
    if is_session(path) {
        let session = SessionFile::read(path)?;
        let map = LocalizationMap::of_session(&session);
        let (map, raster) = map.zip(session.map().to_raster()).context("the session's map shows nothing")?;
        return Ok((map, raster));
    }
    let raster = read_map(path)?;
    Ok((LocalizationMap::new(&raster), raster))
}

/// Runs `floorprint localize`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let threads = arguments.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| localize(arguments, terminal))
}

fn localize(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    if let Some(session) = &arguments.update_session {
        update::check(&arguments.map, session)?;
    }
    let interrupt = Interrupt::listen();
    let out = arguments.out.clone().unwrap_or_else(|| {
        let plain = Path::new("runs").join(format!("{}-localized", run_folder::data_set_name(&arguments.path)));
        if plain.exists() && !arguments.force { free_beside(&plain) } else { plain }
    });
    let folder = RunFolder::create(&out, Contents::Localization, arguments.force)?;
    interrupt.removes(folder.path());
    folder.notes().iter().for_each(|note| terminal.warn(note));
    let reading = terminal.busy("reading");
    let (map, raster) = read_any_map(&arguments.map)?;
    ensure!(
        !map.is_empty(),
        "{} shows no wall next to free space: there is nothing to be localised by",
        arguments.map.display()
    );
    let topics = Topics::without_truth(arguments.scan.clone(), arguments.odom.clone(), arguments.base.clone());
    let data_set = open(&arguments.path, &topics.open_options(arguments.drive, arguments.max_expansion))?;
    let truth = arguments.truth.as_deref().map(read_trajectory).transpose()?;
    reading.finish_and_clear();
    data_set.notes.iter().for_each(|note| terminal.note(note));
    let config = arguments.settings.resolve(Some(&data_set.robot))?;

    let started = Instant::now();
    let mut localizer = Localizer::new(Arc::new(map), arguments.start, &config);
    let mut update = arguments.update.then(|| Update::new(&raster, &config.map));
    let prepared_s = started.elapsed().as_secs_f64();
    let frames = data_set.frames(&config).with_context(|| format!("cannot localise {}", arguments.path.display()))?;
    let progress = terminal.progress("localising", "scans", frames.len());
    let mut steps: Vec<LocalizationReport> = Vec::new();
    let mut dead_reckoning = Vec::new();
    let mut times = [ScanTimes::default(), ScanTimes::default()];
    let mut refused = 0;
    let mut pass = frames.iter();
    let mut partial = false;
    for frame in pass.by_ref() {
        partial = interrupt.requested();
        if partial {
            break;
        }
        let started = Instant::now();
        match localizer.process(&frame) {
            Ok(step) => {
                times[usize::from(step.pose.is_none())].add(started.elapsed().as_secs_f64());
                if let Some(update) = &mut update {
                    update.observe(&frame, &step);
                }
                steps.push(step);
                dead_reckoning.push(frame.dead_reckoning);
            }
            Err(_) => refused += 1,
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    if let Some(error) = pass.error() {
        return Err(error.clone().into());
    }

    let _writing = terminal.busy("writing");
    let changes = update.map(Update::found);
    let report = Report::new(report::Inputs {
        changes: changes.as_ref().map(Found::listed),
        arguments,
        data_set: &data_set,
        config: &config,
        free_m2: localizer.map().free_m2(),
        steps: &steps,
        dead_reckoning: &dead_reckoning,
        truth: truth.as_deref(),
        prepared_s,
        times: &times,
        refused,
        partial,
    });
    write_trajectory(&folder.path().join("trajectory.tum"), &report.trajectory)?;
    write_png(&folder.path().join("localization.png"), &picture(&raster, &report).into_picture())?;
    write_file(&folder.path().join("config.toml"), config.to_toml().as_bytes())?;
    write_file(&folder.path().join("report.html"), page::page(&report, &raster, &steps)?.as_bytes())?;
    write_file(&folder.path().join("report.json"), (serde_json::to_string_pretty(&report)? + "\n").as_bytes())?;
    if let Some(changes) = &changes {
        changes.write(folder.path())?;
        if let Some(session) = arguments.update_session.as_ref().filter(|_| !partial) {
            changes.write_session(&arguments.map, &data_set, session)?;
        }
    }
    interrupt.is_finishing();
    let out = if partial { folder.finish_partial()? } else { folder.finish().map(|()| out)? };
    if !terminal.is_quiet() {
        report.print(&mut terminal.results(), &out)?;
        if let Some(changes) = &changes {
            changes.print(&mut terminal.results())?;
        }
    }
    if partial {
        terminal.warn("stopped before its end: the results are partial");
        return Ok(Outcome::Interrupted);
    }
    Ok(Outcome::Fine)
}

/// The map with the truth, the trajectory, and the modes where nothing is claimed at the end.
fn picture(map: &Raster<Occupancy>, report: &Report) -> Figure {
    let mut figure = Figure::of_map(map);
    for pieces in &report.true_pieces {
        figure.draw_line(pieces.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]), TRUTH, 1.5);
    }
    for piece in &report.pieces {
        figure.draw_line(piece.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]), TRAJECTORY, 2.0);
    }
    if let Some(end) = report.ended.as_ref().filter(|end| !end.is_localised) {
        for mode in &end.modes {
            figure.draw_disc([mode.x_m, mode.y_m], MODE, 3.0 + 9.0 * mode.weight.sqrt());
        }
    }
    figure
}
