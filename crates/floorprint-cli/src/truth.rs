//! The truth, where it lies beside a data set, and the errors against it.
//!
//! A folder may hold `truth.tum`, `truth_map.yaml` and `truth_texture.json`; a log
//! `NAME.clf.gz` may have `NAME.relations` beside it.

use crate::solve::Solution;
use floorprint::Config;
use floorprint::evaluation::{
    EvaluationError, MapQuality, MapQualityOptions, RelationReport, StampIndex, TextureError, TextureErrorOptions,
    TrajectoryError, TrajectoryErrorOptions, TruthAlignment, camera_footprint,
};
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint::texture::RgbdCamera;
use floorprint_io::{
    DataSet, ReadError, RecordedTruth, lone_recording, read_floor, read_map, read_relations, read_trajectory,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Where the truth about a drive lies, as far as there is any.
#[derive(Debug, Default)]
pub(crate) struct TruthFiles {
    /// The true trajectory.
    pub(crate) trajectory: Option<PathBuf>,
    map: Option<PathBuf>,
    floor: Option<PathBuf>,
    relations: Option<PathBuf>,
}

/// Errors against the truth; absent where there is none.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Errors {
    /// Of the trajectory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) trajectory: Option<TrajectoryError>,
    /// Of dead reckoning, for comparison.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) odometry: Option<TrajectoryError>,
    /// Of the occupied cells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) map: Option<MapQuality>,
    /// Of the floor's colours.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) texture: Option<TextureError>,
    /// Of the trajectory against the benchmark's relations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) relations: Option<RelationReport>,
    /// The same of dead reckoning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) odometry_relations: Option<RelationReport>,
    /// The true trajectory itself, for drawing.
    #[serde(skip)]
    pub(crate) true_trajectory: Vec<StampedPose>,
}

impl TruthFiles {
    /// Looks for the truth beside the data set at `path`.
    pub(crate) fn beside(path: &Path) -> Self {
        if let Some(recording) = lone_recording(path) {
            return Self::beside(&recording);
        }
        let existing = |candidate: PathBuf| candidate.is_file().then_some(candidate);
        if path.is_dir() {
            return Self {
                trajectory: existing(path.join("truth.tum")),
                map: existing(path.join("truth_map.yaml")),
                floor: existing(path.join("truth_texture.json")),
                relations: None,
            };
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.split('.').next().unwrap_or_default();
        Self {
            trajectory: existing(path.with_file_name(format!("{stem}.truth.tum"))),
            relations: existing(path.with_file_name(format!("{stem}.relations"))),
            ..Self::default()
        }
    }

    /// Compares a solution with the truth. What cannot be compared becomes a note.
    ///
    /// # Errors
    /// A file with the truth is damaged.
    pub(crate) fn errors(
        &self,
        data_set: &DataSet,
        solution: &Solution,
        map: &Raster<Occupancy>,
        config: &Config,
        notes: &mut Vec<String>,
    ) -> Result<Errors, ReadError> {
        let mut errors = Errors::default();
        if let Some(path) = &self.trajectory {
            let truth = read_trajectory(path)?;
            let options = TrajectoryErrorOptions::default();
            errors.trajectory = noted(TrajectoryError::new(&solution.trajectory, &truth, &options), notes);
            if solution.has_odometry() {
                errors.odometry = noted(TrajectoryError::new(&solution.odometry, &truth, &options), notes);
            }
            errors.true_trajectory = truth;
        } else if let Some(truth) = data_set.bag.as_ref().and_then(|bag| bag.truth.as_ref()) {
            compare_with_recorded(truth, solution, &mut errors, notes);
        }
        if let Some(path) = &self.relations {
            let relations = read_relations(path)?;
            errors.relations = noted(RelationReport::new(&solution.trajectory, &relations), notes);
            let odometry = solution.has_odometry().then(|| RelationReport::new(&solution.odometry, &relations).ok());
            errors.odometry_relations = odometry.flatten();
        }
        let true_map = self.map.as_deref().map(read_map).transpose()?;
        if let Some(truth) = true_map.as_ref().filter(|_| !solution.is_dead_reckoning()) {
            errors.map = noted(MapQuality::new(map, truth, &MapQualityOptions::default()), notes);
        }
        if let (Some(path), Some(floor)) = (&self.floor, &solution.floor) {
            let seen = true_map.zip(seeing_camera(config));
            let seen = seen.map(|(map, camera)| seen_floor(&floor.images, &errors.true_trajectory, &camera, &map));
            let truth = read_floor(path)?;
            let options = TextureErrorOptions::default();
            errors.texture = noted(TextureError::new(&floor.map, &truth, seen.as_ref(), &options), notes);
        }
        Ok(errors)
    }
}

/// Compares with poses that the recording itself holds, in a frame of their own and of any part of the robot.
fn compare_with_recorded(truth: &RecordedTruth, solution: &Solution, errors: &mut Errors, notes: &mut Vec<String>) {
    let options = TrajectoryErrorOptions::default();
    let mut compare = |estimate: &[StampedPose]| {
        let alignment = noted(TruthAlignment::estimate(estimate, &truth.poses), notes)?;
        let aligned = alignment.apply(&truth.poses);
        let error = noted(TrajectoryError::new(estimate, &aligned, &options), notes)?;
        Some((error, aligned, alignment))
    };
    let odometry = solution.has_odometry().then(|| compare(&solution.odometry)).flatten();
    let Some((error, aligned, alignment)) = compare(&solution.trajectory) else { return };
    let place = alignment.body_from_measured;
    let measured = if alignment.place_is_known {
        format!(
            "what it measures lies {:.3} m ahead and {:.3} m to the left of the base, turned by {:.1}°",
            place.x,
            place.y,
            place.theta.to_degrees()
        )
    } else {
        format!(
            "the drive turns too little to show which part of the robot it measures: the base, turned by {:.1}°, is assumed",
            place.theta.to_degrees()
        )
    };
    notes.push(format!(
        "compared with {}, aligned to it (rotation and translation); {measured}, as estimated from the drive",
        truth.topic
    ));
    errors.odometry = odometry.map(|(error, ..)| error);
    errors.trajectory = Some(error);
    errors.true_trajectory = aligned;
}

/// The robot's camera as far as it paints.
pub(crate) fn seeing_camera(config: &Config) -> Option<RgbdCamera> {
    Some(RgbdCamera::of(&config.robot)?.up_to(config.texture.distance_max_m))
}

/// The floor that the camera saw from where it truly was when the images were taken.
pub(crate) fn seen_floor(
    images: &[StampedPose],
    true_trajectory: &[StampedPose],
    camera: &RgbdCamera,
    true_map: &Raster<Occupancy>,
) -> Raster<bool> {
    let truth = StampIndex::new(true_trajectory);
    let poses: Vec<_> = images.iter().filter_map(|image| truth.interpolated(image.stamp_s, 1e-4, 0.5)).collect();
    camera_footprint(&poses, camera, true_map)
}

fn noted<T>(result: Result<T, EvaluationError>, notes: &mut Vec<String>) -> Option<T> {
    result.map_err(|error| notes.push(format!("not compared with the truth: {error}"))).ok()
}
