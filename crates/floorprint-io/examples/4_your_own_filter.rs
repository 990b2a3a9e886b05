//! A sensor model of your own in a particle filter of your own, on the library's frames, grids and random numbers:
//! `cargo run --release --example 4_your_own_filter -- intel.clf.gz`.
//!
//! One map, as in the report of 2015 that this program began with; the sensor model is a Gaussian of the distance to the
//! nearest occupied cell.

use floorprint::front_end::{ResamplerKind, resample};
use floorprint::motion_model::MotionConfig;
use floorprint::prelude::*;
use floorprint::random::{Stage, generator};
use floorprint_io::{OpenOptions, open, write_map};
use std::error::Error;
use std::path::Path;

const PARTICLES: usize = 40;
/// Rays end this far from what stands there, metres: one standard deviation.
const SIGMA_M: f64 = 0.05;
/// One ray in so many has a say: neighbours see the same.
const RAY_STEP: usize = 6;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a recording")?;
    let map = your_own_filter(Path::new(&path), usize::MAX)?;
    write_map(Path::new("map.yaml"), &map)?;
    Ok(())
}

/// The map of the first `most_frames` frames.
pub fn your_own_filter(path: &Path, most_frames: usize) -> Result<Raster<Occupancy>, Box<dyn Error>> {
    let recording = open(path, &OpenOptions::default())?;
    let config = Config::resolve(&[Layer::from_robot(&recording.robot)])?;
    let frames = Frames::new(&recording.records, &config)?;
    let mut map = OccupancyGrid::new(&config.map);
    let mut poses = vec![Pose2::IDENTITY; PARTICLES];
    for (step, frame) in (0..).zip(frames.iter().take(most_frames)) {
        predict(&mut poses, &frame, &config.motion, step);
        let weights = weights(&poses, &frame, &map);
        let heaviest = (0..PARTICLES).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0);
        map.draw_scan(&poses[heaviest], &frame.scan);
        let mut random = generator(0, Stage::Resampling, step, 0);
        let chosen = resample(ResamplerKind::Systematic, &weights, PARTICLES, &mut random);
        poses = chosen.into_iter().map(|particle| poses[particle]).collect();
    }
    Ok(map.to_raster().ok_or("nothing was seen")?)
}

fn predict(poses: &mut [Pose2], frame: &Frame, motion_model: &MotionConfig, step: u64) {
    let motion = frame.motion.unwrap_or(Pose2::IDENTITY);
    for (particle, pose) in (0..).zip(poses) {
        *pose = motion_model.sample(pose, &motion, 0, step, particle);
    }
}

/// Weights that sum to one.
fn weights(poses: &[Pose2], frame: &Frame, map: &OccupancyGrid) -> Vec<f64> {
    let likelihood = |pose: &Pose2| -> f64 {
        frame.scan.hits.iter().step_by(RAY_STEP).map(|end| log_likelihood(map, pose, end)).sum()
    };
    let logs: Vec<f64> = poses.iter().map(likelihood).collect();
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = logs.iter().map(|log| (log - most).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

/// The sensor model: how well it fits that a ray ends where it does.
fn log_likelihood(map: &OccupancyGrid, pose: &Pose2, end: [f32; 2]) -> f64 {
    let [x, y] = pose.transform_point(end.map(f64::from));
    let side = map.resolution_m();
    let around = (-2..=2).flat_map(|row| (-2..=2).map(move |column| (f64::from(column) * side, f64::from(row) * side)));
    let occupied = around.filter(|(dx, dy)| map.is_occupied(map.cell_at([x + dx, y + dy])));
    let distance = occupied.map(|(dx, dy)| dx.hypot(dy)).fold(3.0 * side, f64::min);
    -0.5 * (distance / SIGMA_M).powi(2)
}
