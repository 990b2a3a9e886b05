//! What a scan is made into before anything is asked of the map.

use crate::compact_scan::CompactScan;
use crate::frame::BodyScan;
use crate::surface::{SurfaceScan, Thinning};
use std::sync::Arc;

/// A scan's surfaces and packed points. They depend on the scan alone, so that they can be made ahead of the filter.
#[derive(Debug, Clone, Default)]
pub struct PreparedScan {
    /// What is matched.
    pub surfaces: Arc<SurfaceScan>,
    /// What is kept.
    pub points: CompactScan,
}

impl PreparedScan {
    /// Prepares a scan.
    #[must_use]
    pub fn of(scan: &BodyScan, thinning: &Thinning) -> Self {
        Self { surfaces: Arc::new(SurfaceScan::new(scan, thinning)), points: CompactScan::new(scan) }
    }
}
