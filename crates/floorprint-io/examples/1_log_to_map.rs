//! A recording to a trajectory and a map: `cargo run --release --example 1_log_to_map -- intel.clf.gz`.

#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use floorprint::prelude::*;
use floorprint_io::{OpenOptions, open, write_map, write_trajectory};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a recording: a CARMEN log, a bag, a folder of the course …")?;
    log_to_map(Path::new(&path), Path::new("."))
}

/// Writes trajectory.tum, map.yaml and map.pgm into the folder `out`.
pub fn log_to_map(path: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let recording = open(path, &OpenOptions::default())?;
    // The defaults, with the robot as the recording describes it. More layers may follow: a preset, a file, settings.
    let config = Config::resolve(&[Layer::from_robot(&recording.robot)])?;
    // Frames: scans with the motion that leads to them.
    let frames = Frames::new(&recording.records, &config)?;
    let mut slam = Slam::new(&config);
    for frame in frames.iter() {
        let step = slam.process(&frame)?;
        if step.is_lost {
            println!("{:.1} s: lost", step.stamp_s);
        }
    }
    // Closes the last loops and fits all scans to each other.
    let result = slam.finish();
    write_trajectory(&out.join("trajectory.tum"), &result.trajectory)?;
    write_map(&out.join("map.yaml"), &result.map.to_raster().ok_or("nothing was seen")?)?;
    Ok(())
}
