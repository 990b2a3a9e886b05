//! Who holds a session's memory.

use super::Session;
use super::session::StoredScan;
use crate::back_end::PlaceGraph;

/// Bytes that a session holds, by what they are for. Copies of a session share most of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionMemory {
    /// The front end's poses: all that grows with each scan.
    pub trajectory: usize,
    /// Key scans: with the area, but for what changes in it.
    pub key_scans: usize,
    /// The newest scans between key scans: bounded.
    pub scans_between: usize,
    /// What submaps look like: with the area.
    pub looks: usize,
    /// What is remembered of each submap: with the distance.
    pub submaps: usize,
    /// Comparisons of submaps: as the key scans.
    pub comparisons: usize,
    /// Hypotheses, each with its pose graph, which grows with the area, and the retired submaps, which grow with the
    /// distance.
    pub hypotheses: usize,
    /// What was put away in a store (see [`Session::limit_memory`]); none of the others counts it.
    pub put_away: usize,
}

impl SessionMemory {
    /// All of it that is in memory.
    #[must_use]
    pub fn total(&self) -> usize {
        let Self { trajectory, key_scans, scans_between, looks, submaps, comparisons, hypotheses, put_away: _ } = *self;
        trajectory + key_scans + scans_between + looks + submaps + comparisons + hypotheses
    }
}

impl Session {
    /// Who holds its memory; takes time as the session is long.
    #[must_use]
    pub fn memory(&self) -> SessionMemory {
        let key_scans = self.scans().iter().map(|scan| size_of::<StoredScan>() + scan.points.held_bytes());
        let [looks, submaps, comparisons, hypotheses] = self.places().map(PlaceGraph::held_bytes).unwrap_or_default();
        SessionMemory {
            trajectory: self.bytes_of_poses(),
            key_scans: key_scans.sum(),
            scans_between: self.bytes_between(),
            looks,
            submaps,
            comparisons,
            hypotheses,
            put_away: self.bytes_put_away(),
        }
    }
}
