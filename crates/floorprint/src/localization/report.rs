//! What the localizer says after each scan.

use super::sensing::Explanation;
use crate::geometry::Pose2;
use nalgebra::Matrix3;

/// What is known of the robot's place after a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalizationReport {
    /// Number of the scan.
    pub index: usize,
    /// The scan's stamp, seconds.
    pub stamp_s: f64,
    /// The pose that is claimed, `map_from_body`; `None` as long as nothing stands alone, and when the robot is lost.
    pub pose: Option<Pose2>,
    /// Its covariance over (x, y, θ) in the map's axes, m² and rad²; that of the heaviest mode where nothing is claimed.
    pub covariance: Matrix3<f64>,
    /// How probable it is that the robot is not where the heaviest mode has it.
    pub lost_probability: f64,
    /// Shares of the scan's rays at the heaviest mode.
    pub explained: Explained,
    /// Poses that are considered, the most probable first.
    pub modes: Vec<Mode>,
    /// How probable it is that the robot is where nothing was proposed.
    pub elsewhere_probability: f64,
    /// Whether a search over the whole map is under way.
    pub is_searching: bool,
    /// How far the robot drove since the search for it began, metres; 0 while its pose is claimed.
    pub searched_m: f64,
    /// Particles of this step.
    pub particles: usize,
}

/// A pose that is considered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// `map_from_body`.
    pub pose: Pose2,
    /// How probable it is.
    pub weight: f64,
}

/// What of a scan the map explains: shares of its rays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Explained {
    /// They end on what the map shows.
    pub on_map: f64,
    /// They end before that, on something that the map does not show: people, moved furniture, closed doors.
    pub in_front: f64,
    /// They went through what the map shows: it is gone, or the pose is wrong.
    pub through: f64,
    /// They end where the map knows nothing.
    pub in_unknown: f64,
}

impl From<Explanation> for Explained {
    fn from(shares: Explanation) -> Self {
        Self {
            on_map: shares.on_map,
            in_front: shares.in_front + shares.on_flat_in_front,
            through: shares.through,
            in_unknown: shares.in_unknown,
        }
    }
}
