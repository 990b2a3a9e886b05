//! How good a trajectory is: against the truth, and beside dead reckoning:
//! `cargo run --release --example 5_evaluate -- RECORDING TRUTH.tum`.

#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions};
use floorprint::prelude::*;
use floorprint_io::{OpenOptions, open, read_trajectory};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (path, truth) =
        (arguments.next().ok_or("name a recording")?, arguments.next().ok_or("name a true trajectory")?);
    let [slam, odometry] = evaluate(Path::new(&path), Path::new(&truth))?;
    for (name, error) in [("slam", slam), ("odometry", odometry)] {
        let (position, heading) = (error.translation_m, error.rotation_deg);
        println!("{name:<9} RMSE {:.4} m {:.3}°, largest {:.3} m", position.rmse, heading.rmse, position.max);
    }
    Ok(())
}

/// Errors of the trajectory and of dead reckoning; starts are laid onto each other.
pub fn evaluate(path: &Path, truth: &Path) -> Result<[TrajectoryError; 2], Box<dyn Error>> {
    let recording = open(path, &OpenOptions::default())?;
    let truth = read_trajectory(truth)?;
    let config = Config::resolve(&[Layer::from_robot(&recording.robot)])?;
    let frames = Frames::new(&recording.records, &config)?;
    let mut slam = Slam::new(&config);
    for frame in frames.iter() {
        slam.process(&frame)?;
    }
    let options = TrajectoryErrorOptions::default();
    Ok([
        TrajectoryError::new(&slam.finish().trajectory, &truth, &options)?,
        TrajectoryError::new(&frames.dead_reckoned_poses(), &truth, &options)?,
    ])
}
