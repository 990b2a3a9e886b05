//! Simulated drives in the course ECE276A's layout, with the truth beside them.
//!
//! `EncodersN.npz`, `HokuyoN.npz`, `ImuN.npz`, `KinectN.npz` and
//! `dataRGBD/{RGBN,DisparityN}/….png` as the course hands them out; `truth.tum`,
//! `truth_map.yaml/.pgm` and `truth_texture.json/.png` for evaluation; `simulation.json`
//! says how it was made.

use crate::error::{Problem, WriteError};
use crate::map_file::write_map;
use crate::npz_writer::NpzWriter;
use crate::picture::{Picture, Pixels, write_png};
use crate::replace::write_file;
use crate::run_folder::{Contents, RunFolder};
use crate::trajectory::write_trajectory;
use crate::write_floor;
use floorprint::simulator::{SimulatedDrive, SimulationConfig};
use rayon::prelude::*;
use serde::Serialize;
use std::fs;
use std::io;
use std::path::Path;

/// Standard gravity, m/s²: the IMU's unit of acceleration.
const GRAVITY_M_S2: f64 = 9.80665;

/// Side of a cell of the true map, metres.
const MAP_RESOLUTION_M: f64 = 0.05;

/// Side of a cell of the true floor, metres; twice that, and so on, where the picture would get too large.
const FLOOR_RESOLUTION_M: f64 = 0.01;

/// The most cells of the true floor.
const MOST_FLOOR_CELLS: f64 = 40e6;

/// Images rendered between two reports of progress.
const IMAGES_AT_A_TIME: usize = 16;

/// What `simulation.json` says.
#[derive(Serialize)]
struct Description<'a> {
    what: &'static str,
    version: &'static str,
    world: &'a str,
    seed: u64,
    frame: &'static str,
    config: &'a SimulationConfig,
}

/// Writes `drive` as the folder `target`, whole or not at all, with `number` in the files' names.
///
/// `progress` is told how many of how many scans are done, and then of how many images, which take longer each.
///
/// # Errors
/// When `target` exists (unless it is empty, or `replace` is set and it holds an earlier
/// simulation) and when something cannot be written.
pub fn write_ece276a(
    target: &Path,
    drive: &SimulatedDrive,
    number: u32,
    replace: bool,
    progress: &mut dyn FnMut(&'static str, usize, usize),
) -> Result<(), WriteError> {
    let folder = RunFolder::create(target, Contents::Simulation, replace)?;
    let path = folder.path();
    let (disparity_images, color_images) = (drive.disparity_stamps_s().len(), drive.color_stamps_s().len());
    let (scans, all_images) = (drive.scan_count(), disparity_images + color_images);

    let archive = |name: &str, fill: &mut dyn FnMut(&mut NpzWriter) -> io::Result<()>| {
        let path = path.join(format!("{name}{number}.npz"));
        let mut write = || {
            let mut npz = NpzWriter::create(&path)?;
            fill(&mut npz)?;
            npz.finish()
        };
        write().map_err(|error| WriteError::io(&path, &error))
    };
    if !drive.wheel_counts().is_empty() {
        archive("Encoders", &mut |npz| write_encoders(npz, drive))?;
    }
    archive("Imu", &mut |npz| write_imu(npz, drive))?;
    archive("Hokuyo", &mut |npz| write_hokuyo(npz, drive, &mut |done| progress("scans", done, scans)))?;
    if disparity_images > 0 {
        archive("Kinect", &mut |npz| write_kinect(npz, drive))?;
        let mut done = 0;
        let mut images = |kind: &str, count: usize, picture: &(dyn Fn(usize) -> Option<Picture> + Sync)| {
            let folder = path.join("dataRGBD").join(format!("{kind}{number}"));
            fs::create_dir_all(&folder).map_err(|error| WriteError::io(&folder, &error))?;
            for first in (0..count).step_by(IMAGES_AT_A_TIME) {
                let last = (first + IMAGES_AT_A_TIME).min(count);
                (first..last).into_par_iter().try_for_each(|index| {
                    let name = format!("{}{number}_{}.png", kind.to_ascii_lowercase(), index + 1);
                    picture(index).map_or(Ok(()), |picture| write_png(&folder.join(name), &picture))
                })?;
                done += last - first;
                progress("images", done, all_images);
            }
            Ok::<(), WriteError>(())
        };
        images("Disparity", disparity_images, &|index| {
            let image = drive.disparity_image(index)?;
            Some(Picture { width: image.width, height: image.height, pixels: Pixels::Gray16(image.values) })
        })?;
        images("RGB", color_images, &|index| {
            let image = drive.color_image(index)?;
            Some(Picture { width: image.width, height: image.height, pixels: Pixels::Rgb8(image.rgb) })
        })?;
        write_floor(&path.join("truth_texture.png"), &drive.true_floor(floor_resolution_m(drive)))?;
    }
    write_trajectory(&path.join("truth.tum"), &drive.truth())?;
    write_map(&path.join("truth_map.yaml"), &drive.true_map(MAP_RESOLUTION_M))?;
    write_description(&path.join("simulation.json"), drive)?;
    folder.finish()
}

fn write_encoders(npz: &mut NpzWriter, drive: &SimulatedDrive) -> io::Result<()> {
    let counts = drive.wheel_counts();
    npz.array("counts", &[4, counts.len()], counts.iter().flat_map(|reading| reading.ticks))?;
    npz.array("time_stamps", &[counts.len()], counts.iter().map(|reading| reading.stamp_s))
}

fn write_imu(npz: &mut NpzWriter, drive: &SimulatedDrive) -> io::Result<()> {
    let readings = drive.imu_readings();
    let shape = [3, readings.len()];
    npz.array("angular_velocity", &shape, readings.iter().flat_map(|reading| reading.angular_velocity_rad_s))?;
    let accelerations_g = readings.iter().flat_map(|reading| reading.linear_acceleration_m_s2);
    npz.array("linear_acceleration", &shape, accelerations_g.map(|value| value / GRAVITY_M_S2))?;
    npz.array("time_stamps", &[readings.len()], readings.iter().map(|reading| reading.stamp_s))
}

fn write_hokuyo(npz: &mut NpzWriter, drive: &SimulatedDrive, progress: &mut dyn FnMut(usize)) -> io::Result<()> {
    let geometry = drive.scan_geometry();
    let angles_rad = &geometry.angles_rad;
    let (first_rad, last_rad) = (angles_rad[0], angles_rad[angles_rad.len() - 1]);
    npz.array("angle_min", &[], [first_rad])?;
    npz.array("angle_max", &[], [last_rad])?;
    npz.array("angle_increment", &[1, 1], [(last_rad - first_rad) / (angles_rad.len() - 1) as f64])?;
    npz.array("range_min", &[], [f64::from(geometry.range_min_m)])?;
    npz.array("range_max", &[], [f64::from(geometry.range_max_m)])?;
    let scans = (0..drive.scan_count()).flat_map(|index| {
        progress(index + 1);
        drive.scan(index).ranges_m
    });
    npz.array("ranges", &[angles_rad.len(), drive.scan_count()], scans.map(f64::from))?;
    npz.array("time_stamps", &[drive.scan_count()], drive.truth().iter().map(|truth| truth.stamp_s))
}

fn write_kinect(npz: &mut NpzWriter, drive: &SimulatedDrive) -> io::Result<()> {
    for (name, stamps_s) in
        [("disparity_time_stamps", drive.disparity_stamps_s()), ("rgb_time_stamps", drive.color_stamps_s())]
    {
        npz.array(name, &[stamps_s.len()], stamps_s)?;
    }
    Ok(())
}

fn floor_resolution_m(drive: &SimulatedDrive) -> f64 {
    let [low_m, high_m] = drive.world().bounds_m();
    let area_m2 = (high_m[0] - low_m[0]) * (high_m[1] - low_m[1]);
    let mut resolution_m = FLOOR_RESOLUTION_M;
    while area_m2 / (resolution_m * resolution_m) > MOST_FLOOR_CELLS {
        resolution_m *= 2.0;
    }
    resolution_m
}

fn write_description(path: &Path, drive: &SimulatedDrive) -> Result<(), WriteError> {
    let description = Description {
        what: Contents::Simulation.what(),
        version: env!("CARGO_PKG_VERSION"),
        world: drive.world().name(),
        seed: drive.seed(),
        frame: "the body's pose at the first scan is the identity; x ahead, y left, metres",
        config: drive.config(),
    };
    let text = serde_json::to_string_pretty(&description).map_err(|error| Problem::new(path, error.to_string()))?;
    write_file(path, (text + "\n").as_bytes())
}
