//! A drive in two sittings: saved after the first, gone on with in the second:
//! `cargo run --release --example 3_save_and_resume -- intel.clf.gz`.

#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use floorprint::prelude::*;
use floorprint_io::{Layers, OpenOptions, SessionFile, open};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a recording")?;
    let frames = save_and_resume(Path::new(&path), Path::new("session.gpkg"))?;
    println!("{frames} frames in session.gpkg");
    Ok(())
}

/// Solves half of a recording, saves the session, and goes on from the file; gives the number of frames.
pub fn save_and_resume(path: &Path, session: &Path) -> Result<usize, Box<dyn Error>> {
    let recording = open(path, &OpenOptions::default())?;
    let config = Config::resolve(&[Layer::from_robot(&recording.robot)])?;
    let frames: Vec<Frame> = Frames::new(&recording.records, &config)?.iter().collect();
    let (first, second) = frames.split_at(frames.len() / 2);

    let mut slam = Slam::new(&config);
    for frame in first {
        slam.process(frame)?;
    }
    // Each save holds what is new, whole or not at all: do this as often as you like while the robot drives.
    let mut file = SessionFile::create(session)?;
    file.save(slam.session(), &config.matcher)?;
    drop((file, slam));

    let stored = SessionFile::open(session)?.load()?;
    let mut slam = Slam::resume(stored, &config)?;
    // If the robot may have been moved meanwhile: `slam.interrupt();`
    for frame in second {
        slam.process(frame)?;
    }
    let result = slam.finish();
    let map = result.map.to_raster().ok_or("nothing was seen")?;
    // Pictures for QGIS and the like are drawn at the end.
    std::fs::remove_file(session)?;
    let mut file = SessionFile::create(session)?;
    file.save(&result.session, &config.matcher)?;
    file.draw(&Layers { session: &result.session, map: &map, floor: None })?;
    Ok(result.trajectory.len())
}
