//! What became of every comparison of two places, for the report.

use crate::geometry::Pose2;
use serde::{Deserialize, Serialize};

/// A comparison of two submaps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClosureReport {
    /// The older submap.
    pub older: usize,
    /// The newer submap.
    pub newer: usize,
    /// Which frames lie in the middle of the two, counted from 0.
    pub frames: [usize; 2],
    /// Standard deviation of where the newer one was thought to lie, seen from the older, metres.
    pub uncertainty_m: f64,
    /// How far the newer one was moved against where it was thought to be, metres.
    pub correction_m: f64,
    /// The same in heading, radians.
    pub correction_rad: f64,
    /// Share of the newer one's surfaces that the older one had in view, and the other way round.
    pub overlap_shares: [f64; 2],
    /// Share of those that lie on surfaces of the other.
    pub inlier_shares: [f64; 2],
    /// How much more of the newer one fits there than at any place a little farther on.
    pub distinctness: f64,
    /// Standard deviation of the fit in the direction in which it is the least certain, metres.
    pub sigma_m: f64,
    /// In how many places the newer one fits.
    pub placements: usize,
    /// Pose of the newer one's middle seen from the older one's middle.
    pub middle_from_middle: Pose2,
    /// Whether it is a factor of the graph.
    pub verdict: Verdict,
}

/// What closing loops works with at a time. It grows with the area that was seen, not with time, and so do the
/// cost of a submap and the memory that is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClosureLoad {
    /// Submaps whose surfaces are kept.
    pub submaps: usize,
    /// Nodes of the largest pose graph.
    pub nodes: usize,
    /// Relative measurements of the largest pose graph.
    pub factors: usize,
}

/// What became of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Tied together.
    Accepted,
    /// The two hardly had the same things in view.
    TooLittleInCommon,
    /// Too little of the newer submap fits the older.
    DoesNotFit,
    /// The older submap does not fit the newer.
    DoesNotFitBack,
    /// It fits, but ambiguous along the same corridor.
    Inconclusive,
    /// It fits, but so does another place, or the drive would have to be bent too much: more speaks for the newer one's lying elsewhere.
    Elsewhere,
    /// It was connected, but later closures contradict it.
    Contradicted,
}

impl Verdict {
    /// Every verdict, in the order of the tests.
    pub const ALL: [Self; 7] = [
        Self::Accepted,
        Self::TooLittleInCommon,
        Self::DoesNotFit,
        Self::DoesNotFitBack,
        Self::Inconclusive,
        Self::Elsewhere,
        Self::Contradicted,
    ];

    /// The verdict in words.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Accepted => "tied together",
            Self::TooLittleInCommon => "the two places hardly had the same things in view",
            Self::DoesNotFit => "too little of the newer place lies on the older",
            Self::DoesNotFitBack => "the older place does not lie on the newer",
            Self::Inconclusive => "it fits, but hardly better than a little farther on",
            Self::Elsewhere => "it fits, but more speaks for another place",
            Self::Contradicted => "tied together first, then contradicted by later closures",
        }
    }
}
