//! What came of comparing places that a drive passed more than once.

use floorprint::back_end::{ClosureReport, Verdict};
use floorprint::sensors::StampedPose;
use serde::Serialize;

/// Loop closures: how many candidates had which verdict, and each one's figures.
#[derive(Debug, Serialize)]
pub(crate) struct Loops {
    /// Candidates that became factors of the pose graph.
    pub(crate) closed: usize,
    /// Candidates that did not.
    pub(crate) rejected: usize,
    /// Candidates by verdict.
    pub(crate) verdicts: Vec<VerdictCount>,
    /// Every comparison, in the order in which they were made.
    pub(crate) candidates: Vec<Candidate>,
}

/// How often a verdict was given.
#[derive(Debug, Serialize)]
pub(crate) struct VerdictCount {
    /// The verdict.
    pub(crate) verdict: Verdict,
    /// The same in words.
    pub(crate) meaning: &'static str,
    /// How often.
    pub(crate) count: usize,
}

/// A comparison of two places.
#[derive(Debug, Serialize)]
pub(crate) struct Candidate {
    /// When the robot was at the older and at the newer place, seconds.
    pub(crate) stamps_s: [f64; 2],
    /// The figures and the verdict.
    #[serde(flatten)]
    pub(crate) closure: ClosureReport,
}

impl Loops {
    /// Sums up the comparisons made along a trajectory.
    pub(crate) fn new(closures: &[ClosureReport], trajectory: &[StampedPose]) -> Self {
        let count = |verdict| closures.iter().filter(|closure| closure.verdict == verdict).count();
        let closed = count(Verdict::Accepted);
        let stamp_s = |frame: usize| trajectory.get(frame).map_or(f64::NAN, |stamped| stamped.stamp_s);
        let candidate =
            |closure: &ClosureReport| Candidate { stamps_s: closure.frames.map(stamp_s), closure: closure.clone() };
        Self {
            closed,
            rejected: closures.len() - closed,
            verdicts: Verdict::ALL
                .map(|verdict| VerdictCount { verdict, meaning: verdict.meaning(), count: count(verdict) })
                .into_iter()
                .filter(|verdict| verdict.count > 0)
                .collect(),
            candidates: closures.iter().map(candidate).collect(),
        }
    }

    /// The candidates that were tied together.
    pub(crate) fn accepted(&self) -> impl Iterator<Item = &ClosureReport> {
        self.candidates.iter().map(|candidate| &candidate.closure).filter(|c| c.verdict == Verdict::Accepted)
    }
}
