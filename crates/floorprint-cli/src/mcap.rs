//! `run --mcap`: a solved drive for Foxglove, Rerun and whoever reads MCAP, in Foxglove's schemas.
//!
//! Map, floor, trajectory and loop closures stand at the beginning, as they are known at the end; transforms, poses with
//! their covariance and scans follow at the scans' stamps.

use crate::solve::Solution;
use anyhow::Context as _;
use floorprint::back_end::{Uncertainty, Verdict};
use floorprint::geometry::Pose2;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint::{Config, Frames};
use floorprint_io::foxglove::{
    CompressedImage, FrameTransform, FrameTransforms, Line, LineKind, Message, PointCloud, SceneUpdate, Schema,
    floor_grid, map_grid,
};
use floorprint_io::ros::{Header, Message as _, PoseWithCovariance, nanoseconds};
use floorprint_io::{McapWriter, floor_picture, png_bytes, write_mcap};
use floorprint_live::FrameNames;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Colours of lines, as in the pictures: red, green, blue, opacity.
const TRAJECTORY: [f64; 4] = [0.86, 0.15, 0.15, 1.0];
const ODOMETRY: [f64; 4] = [0.15, 0.39, 0.92, 1.0];
const CLOSURES: [f64; 4] = [0.09, 0.64, 0.29, 0.8];

/// Fails where a file cannot be at the end, before anything is computed.
pub(crate) fn check_place(path: &Path) -> anyhow::Result<()> {
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    anyhow::ensure!(folder.is_dir(), "--mcap {}: there is no folder {}", path.display(), folder.display());
    let is_free = fs::metadata(path).map_or(true, |found| !found.is_dir());
    anyhow::ensure!(is_free, "--mcap {}: a folder stands there", path.display());
    Ok(())
}

/// Writes the file; `frames` are those that were solved.
///
/// # Errors
/// When it cannot be written; the floor is too large to be a picture.
pub(crate) fn write(
    path: &Path,
    frames: &Frames<'_>,
    config: &Config,
    solution: &Solution,
    map: &Raster<Occupancy>,
) -> anyhow::Result<()> {
    let floor_png = match &solution.floor {
        Some(floor) => Some(png_bytes(&floor_picture(&floor.map)).context("the floor cannot be encoded as a picture")?),
        None => None,
    };
    Ok(write_mcap(path, |file| {
        let drive = Drive { frames, names: FrameNames::of(&config.robot), solution, map, floor_png };
        drive.write_beginning(file)?;
        drive.write_scans(file)
    })?)
}

struct Drive<'a> {
    frames: &'a Frames<'a>,
    names: FrameNames,
    solution: &'a Solution,
    map: &'a Raster<Occupancy>,
    floor_png: Option<Vec<u8>>,
}

type File<'a> = McapWriter<&'a mut dyn Write>;

impl Drive<'_> {
    /// What does not change.
    fn write_beginning(&self, file: &mut File<'_>) -> io::Result<()> {
        let stamp_s = self.solution.steps.first().map_or(0.0, |step| step.stamp_s);
        let frame = &self.names.map;
        put(file, "/map", stamp_s, &map_grid(self.map, stamp_s, frame))?;
        if let (Some(floor), Some(bytes)) = (&self.solution.floor, &self.floor_png) {
            put(file, "/floor", stamp_s, &floor_grid(&floor.map, stamp_s, frame))?;
            put(file, "/floor/image", stamp_s, &CompressedImage { stamp_s, frame, format: "png", bytes })?;
        }
        put(file, "/scene", stamp_s, &self.scene(stamp_s))?;
        let mounts = self.names.lidars.iter().map(|(child, mount)| FrameTransform {
            stamp_s,
            parent: &self.names.base,
            child,
            pose: mount.into(),
        });
        put(file, "/tf_static", stamp_s, &FrameTransforms(mounts.collect()))
    }

    fn scene(&self, stamp_s: f64) -> SceneUpdate<'_> {
        let point = |pose: &Pose2| [pose.x as f32, pose.y as f32];
        let points = |poses: &[StampedPose]| poses.iter().map(|stamped| point(&stamped.pose)).collect();
        let trajectory = &self.solution.trajectory;
        let accepted = self.solution.closures.iter().filter(|closure| closure.verdict == Verdict::Accepted);
        let ends = accepted.flat_map(|closure| closure.frames).filter_map(|frame| trajectory.get(frame));
        let line = |id, kind, points_m, color| Line { id, kind, points_m, color };
        let mut lines = vec![line("trajectory", LineKind::Strip, points(trajectory), TRAJECTORY)];
        if self.solution.has_odometry() {
            lines.push(line("dead reckoning", LineKind::Strip, points(&self.solution.odometry), ODOMETRY));
        }
        lines.push(line(
            "loop closures",
            LineKind::Pairs,
            ends.map(|stamped| point(&stamped.pose)).collect(),
            CLOSURES,
        ));
        SceneUpdate { stamp_s, frame: &self.names.map, lines }
    }

    /// What comes with each scan.
    fn write_scans(&self, file: &mut File<'_>) -> io::Result<()> {
        let FrameNames { map, odom, base, .. } = &self.names;
        let channels = [
            file.add_channel("/tf", &Schema::of_foxglove::<FrameTransforms<'_>>(), false),
            file.add_channel("/pose", &Schema::of_ros::<PoseWithCovariance<'_>>(), false),
            file.add_channel("/scan", &Schema::of_foxglove::<PointCloud<'_>>(), false),
        ];
        let Solution { steps, trajectory, uncertainties, .. } = self.solution;
        // Poses of an earlier session come before those of this drive.
        let earlier = trajectory.len().saturating_sub(steps.len());
        let mut steps = steps.iter().zip(earlier..).peekable();
        let mut latest_ns = 0;
        for frame in self.frames.iter() {
            // Frames that the filter refused have no step.
            let Some((step, at)) = steps.next_if(|(step, _)| step.index == frame.index) else { continue };
            let Some(StampedPose { stamp_s, pose }) = trajectory.get(at).copied() else { break };
            latest_ns = nanoseconds(stamp_s).max(latest_ns);
            let map_from_odom = pose.compose(&step.dead_reckoning.inverse());
            let transforms = [(map, odom, map_from_odom), (odom, base, step.dead_reckoning)]
                .map(|(parent, child, pose)| FrameTransform { stamp_s, parent, child, pose: (&pose).into() });
            let header = Header { stamp_s, frame: map };
            let covariance = uncertainties.get(at).map_or([[0.0; 3]; 3], covariance);
            let messages = [
                FrameTransforms(transforms.into()).to_protobuf(),
                PoseWithCovariance { header, pose, covariance }.to_cdr(),
                PointCloud { stamp_s, frame: base, points: &frame.scan.hits }.to_protobuf(),
            ];
            for (channel, message) in channels.into_iter().zip(&messages) {
                file.write(channel, latest_ns, message)?;
            }
        }
        Ok(())
    }
}

/// Over (x, y, θ), m² and rad².
fn covariance(uncertainty: &Uncertainty) -> [[f64; 3]; 3] {
    let [xy, theta] = [uncertainty.sigma_m, uncertainty.sigma_rad].map(|sigma| sigma * sigma);
    [[xy, 0.0, 0.0], [0.0, xy, 0.0], [0.0, 0.0, theta]]
}

/// Writes the only message of a channel.
fn put<M: Message>(file: &mut File<'_>, topic: &str, stamp_s: f64, message: &M) -> io::Result<()> {
    let channel = file.add_channel(topic, &Schema::of_foxglove::<M>(), false);
    file.write(channel, nanoseconds(stamp_s), &message.to_protobuf())
}
