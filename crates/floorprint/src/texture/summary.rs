//! What became of the images, for reports.

use super::floor_mapper::SkipReason;
use super::floor_patch::FloorPatch;
use super::painter::TextureMap;
use serde::Serialize;
use std::collections::BTreeMap;

/// What became of the images, and how much floor they show.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct TextureSummary {
    /// Pairs of images that show floor.
    pub images_used: usize,
    /// Pairs of images that add nothing, by reason.
    pub images_skipped: BTreeMap<SkipReason, usize>,
    /// Median roll of the camera beyond the stated one, as the floor shows it, radians; absent without a fit.
    pub roll_error_rad: Option<f64>,
    /// Median pitch of the camera beyond the stated one, radians.
    pub pitch_error_rad: Option<f64>,
    /// Median height of the camera above the stated one, metres.
    pub height_error_m: Option<f64>,
    /// Floor that was painted, square metres.
    pub coverage_m2: f64,
    /// Mean size of a patch, bytes.
    pub bytes_per_patch: usize,
}

impl TextureSummary {
    /// Sums up the patches, the frames that gave none and the map.
    #[must_use]
    pub fn new(patches: &[FloorPatch], skipped: &[SkipReason], map: &TextureMap) -> Self {
        let mut images_skipped = BTreeMap::new();
        for reason in skipped {
            *images_skipped.entry(*reason).or_insert(0) += 1;
        }
        let tilts = || patches.iter().filter_map(|patch| patch.tilt);
        let bytes: usize = patches.iter().map(FloorPatch::size_bytes).sum();
        Self {
            images_used: patches.len(),
            images_skipped,
            roll_error_rad: median(tilts().map(|tilt| tilt.roll_rad)),
            pitch_error_rad: median(tilts().map(|tilt| tilt.pitch_rad)),
            height_error_m: median(tilts().map(|tilt| tilt.height_m)),
            coverage_m2: map.cells.iter().flatten().count() as f64 * map.resolution_m * map.resolution_m,
            bytes_per_patch: bytes / patches.len().max(1),
        }
    }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
