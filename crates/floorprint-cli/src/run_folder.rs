//! The content of a run folder.

use crate::figure::{DEAD_RECKONING, Figure, TRAJECTORY};
use crate::map_drawing::map_drawing;
use crate::report::{Exhibits, Report, page};
use crate::solve::Solution;
use crate::stopwatch::Stopwatch;
use floorprint::Config;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint_io::{write_file, write_floor, write_g2o, write_kitti, write_map, write_png, write_trajectory};
use rayon::prelude::*;
use std::fs;
use std::path::Path;

/// Writes everything: poses, maps, pictures, configuration and reports.
///
/// # Errors
/// A file cannot be written.
pub(crate) fn write(
    folder: &Path,
    report: &mut Report,
    solution: &Solution,
    map: &Raster<Occupancy>,
    config: &Config,
    stopwatch: &mut Stopwatch,
) -> anyhow::Result<()> {
    let files: [&(dyn Fn() -> anyhow::Result<()> + Sync); 5] = [
        &|| Ok(write_png(&folder.join("trajectories.png"), &with_trajectories(map, solution).into_picture())?),
        &|| Ok(write_file(&folder.join("trajectories.svg"), map_drawing(map, solution)?.as_bytes())?),
        &|| Ok(write_trajectory(&folder.join("trajectory.tum"), &solution.trajectory)?),
        &|| Ok(write_kitti(&folder.join("trajectory.kitti"), &solution.trajectory)?),
        &|| Ok(write_file(&folder.join("config.toml"), config.to_toml().as_bytes())?),
    ];
    // What scans alone give; where there is no LiDAR dead reckoning is the trajectory.
    let of_scans: [&(dyn Fn() -> anyhow::Result<()> + Sync); 3] = [
        &|| Ok(write_png(&folder.join("map.png"), &Figure::of_map(map).into_picture())?),
        &|| Ok(write_map(&folder.join("map.yaml"), map)?),
        &|| Ok(write_trajectory(&folder.join("live.tum"), &as_known_then(solution))?),
    ];
    let of_scans = if solution.is_dead_reckoning() { &of_scans[..0] } else { &of_scans };
    files.par_iter().chain(of_scans).try_for_each(|write| write())?;
    if solution.has_odometry() {
        write_trajectory(&folder.join("odometry.tum"), &solution.odometry)?;
    }
    if let Some(graph) = &solution.graph {
        write_g2o(&folder.join("graph.g2o"), &graph.clone().into())?;
    }
    let mut floor_png = None;
    if let Some(floor) = &solution.floor {
        write_floor(&folder.join("texture.png"), &floor.map)?;
        write_trajectory(&folder.join("images.tum"), &floor.images)?;
        floor_png = Some(fs::read(folder.join("texture.png"))?);
    }
    report.take_cost(stopwatch);
    let exhibits = Exhibits { solution, map, floor_png: floor_png.as_deref(), config, folder };
    write_file(&folder.join("report.html"), page(report, &exhibits)?.as_bytes())?;
    // Last: a folder with it is complete.
    write_file(&folder.join("report.json"), (serde_json::to_string_pretty(report)? + "\n").as_bytes())?;
    Ok(())
}

/// The body's pose at each scan as it was known then: what a robot that drives by it would have had.
fn as_known_then(solution: &Solution) -> Vec<StampedPose> {
    solution.steps.iter().map(|step| StampedPose { stamp_s: step.stamp_s, pose: step.pose }).collect()
}

/// The map with dead reckoning and the trajectory.
pub(crate) fn with_trajectories(map: &Raster<Occupancy>, solution: &Solution) -> Figure {
    let mut figure = Figure::of_map(map);
    let points =
        |poses: &[StampedPose]| poses.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]).collect::<Vec<_>>();
    figure.draw_line(points(&solution.odometry).into_iter(), DEAD_RECKONING, 1.5);
    figure.draw_line(points(&solution.trajectory).into_iter(), TRAJECTORY, 2.0);
    figure
}

/// What a data set is called: its file name without endings.
pub(crate) fn data_set_name(path: &Path) -> String {
    if path == Path::new("-") {
        return "stdin".to_owned();
    }
    let absolute = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let name = absolute.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if absolute.is_dir() { name } else { name.split('.').next().unwrap_or_default().to_owned() }
}
