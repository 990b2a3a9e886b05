//! Solves a drive with the library: `cargo run --release --example solve -- intel.clf.gz`.

use floorprint::config::Layer;
use floorprint::{Config, Frames, Slam};
use floorprint_io::{OpenOptions, open, write_trajectory};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a data set")?;
    let data_set = open(Path::new(&path), &OpenOptions::default())?;
    let config = Config::resolve(&[Layer::from_robot(&data_set.robot)])?;
    let frames = Frames::new(&data_set.records, &config)?;
    let mut slam = Slam::new(&config);
    for frame in frames.iter() {
        // The pose so far, live; loop closure may move it later.
        let _step = slam.process(&frame)?;
    }
    let result = slam.finish();
    write_trajectory(Path::new("trajectory.tum"), &result.trajectory)?;
    Ok(())
}
