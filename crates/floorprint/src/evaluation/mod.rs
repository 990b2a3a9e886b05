//! How good a result is, where the truth is known.

mod camera_footprint;
mod map_quality;
mod relation_noise;
mod relations;
mod stamp_index;
mod statistics;
mod texture_error;
mod trajectory_error;
mod truth_alignment;
mod wall_sharpness;

pub use camera_footprint::camera_footprint;
pub use map_quality::{MapQuality, MapQualityOptions};
pub use relation_noise::{MotionSigma, RelationNoise};
pub use relations::{PoseError, Relation, RelationGroup, RelationReport, relation_errors};
pub use stamp_index::StampIndex;
pub use statistics::ErrorStatistics;
pub use texture_error::{FloorImage, TextureError, TextureErrorOptions};
pub use trajectory_error::{Alignment, RelativeError, Span, TrajectoryError, TrajectoryErrorOptions};
pub use truth_alignment::TruthAlignment;
pub use wall_sharpness::WallSharpness;

use thiserror::Error;

/// Why an evaluation gives no figures.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EvaluationError {
    /// Estimate and truth share no moment.
    #[error(
        "none of the {estimates} estimated poses has a true pose at its time: the estimate spans \
         {estimate_span}, the truth {truth_span}; check that both use the same clock"
    )]
    NoCommonTime {
        /// Poses of the estimate.
        estimates: usize,
        /// First and last stamp of the estimate, as text.
        estimate_span: String,
        /// First and last stamp of the truth, as text.
        truth_span: String,
    },
    /// A trajectory and relations share no pair of moments.
    #[error(
        "none of the {relations} relations has a pose at both of its times: the trajectory spans \
         {trajectory_span}, the relations {relation_span}; check that both are of the same log and keep its stamps"
    )]
    NoCommonRelation {
        /// Relations.
        relations: usize,
        /// First and last stamp of the trajectory, as text.
        trajectory_span: String,
        /// First and last stamp of the relations, as text.
        relation_span: String,
    },
    /// A map shows no wall at all.
    #[error("the {map} map has no occupied cell; check its thresholds and whether it is negated")]
    NothingOccupied {
        /// Which of the two maps.
        map: &'static str,
    },
    /// Estimate and truth share no floor.
    #[error("no painted cell lies on the true floor; check the origins and resolutions of both pictures")]
    NoCommonFloor,
}
