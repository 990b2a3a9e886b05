//! `floorprint view`: a finished session in the browser.

use crate::interrupt::Interrupt;
use crate::live::Page;
use crate::live::housekeeper::next_picture;
use crate::localize::read_any_map;
use crate::outcome::Outcome;
use crate::run_folder;
use crate::terminal::Terminal;
use clap::Args;
use floorprint::sensors::RobotConfig;
use floorprint::session::Renderer;
use floorprint_io::{SessionFile, read_trajectory};
use floorprint_live::{Board, FrameNames, Inbox, MapPicture, Mode, Picture};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::park;

/// Show a finished session in the browser: map, trajectory, loop closures.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder of a run, a session.gpkg, or a map.yaml of ROS.
    path: PathBuf,
    #[command(flatten)]
    page: Page,
}

/// Where the page is unless another address is asked for: a port that is free.
const ADDRESS: &str = "127.0.0.1:0";

/// Runs `floorprint view`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let interrupt = Interrupt::listen();
    let name = run_folder::data_set_name(&arguments.path);
    let board = Arc::new(Board::new(Mode::Viewing, &name, Arc::new(Inbox::new())));
    board.show_picture(picture(&arguments.path)?);
    let mut page = arguments.page.clone();
    if !page.is_asked_for() {
        page.http = ADDRESS.parse().ok();
    }
    let waiting = std::thread::current();
    interrupt.on_request(move || waiting.unpark());
    page.show(&board, &FrameNames::of(&RobotConfig::default()), terminal)?;
    terminal.say("Ctrl-C ends it");
    while !interrupt.requested() {
        park();
    }
    Ok(Outcome::Fine)
}

/// What there is to see of a run, a session or a map.
fn picture(path: &Path) -> anyhow::Result<Picture> {
    let session = if path.is_dir() { path.join("session.gpkg") } else { path.to_path_buf() };
    if session.extension().is_some_and(|ending| ending == "gpkg") && session.is_file() {
        let session = SessionFile::read(&session)?;
        let mut renderer = Renderer::new(session.map_config());
        return Ok(next_picture(&Picture::default(), &session, &mut renderer));
    }
    let map = if path.is_dir() { path.join("map.yaml") } else { path.to_path_buf() };
    let (_, raster) = read_any_map(&map)?;
    let trajectory = match map.with_file_name("trajectory.tum") {
        beside if path.is_dir() && beside.is_file() => read_trajectory(&beside)?,
        _ => Vec::new(),
    };
    let trajectory = trajectory.iter().map(|stamped| [stamped.pose.x as f32, stamped.pose.y as f32]).collect();
    Ok(Picture { revision: 1, map: MapPicture::of_raster(raster, 1), trajectory, closures: Vec::new() })
}
