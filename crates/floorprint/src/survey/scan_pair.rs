//! How two scans show that the robot moved between them, without any odometry.

use crate::frame::BodyScan;
use crate::geometry::Pose2;
use crate::scan_matcher::{MatcherConfig, PoseBelief, SearchWindow, match_scan, search};
use crate::surface::{SurfaceMap, SurfaceScan};
use nalgebra::Matrix3;

/// Places of a search that are fitted.
const CANDIDATES: usize = 3;
/// Both scans must show this much of the same.
const LEAST_INLIER_SHARE: f64 = 0.7;
/// Fewer points than this fit anywhere.
const LEAST_POINTS: usize = 40;
/// Hardly any prior: directions in which the scans say nothing stay where they are, 1/m² and 1/rad².
const PRIOR_INFORMATION: f64 = 1e-3;

/// `earlier_body_from_later_body` by two scans, looked for in a window around `expected`, with its covariance; `None`
/// where they do not show the same.
pub(crate) fn motion_between(
    earlier: &BodyScan,
    later: &BodyScan,
    expected: &Pose2,
    window: SearchWindow,
    matcher: &MatcherConfig,
) -> Option<(Pose2, Matrix3<f64>)> {
    let thinning = matcher.thinning();
    let [before, after] = [earlier, later].map(|scan| SurfaceScan::new(scan, &thinning));
    if before.len() < LEAST_POINTS || after.len() < LEAST_POINTS {
        return None;
    }
    let mut map = SurfaceMap::new(matcher.cell_m);
    map.add_scan(&Pose2::IDENTITY, &before);
    let fits = search(&map, &after, expected, window, CANDIDATES).into_iter().map(|pose| {
        let prior = PoseBelief { pose, information: Matrix3::identity() * PRIOR_INFORMATION };
        match_scan(&map, &after, &prior, matcher)
    });
    let best = fits.max_by(|a, b| a.inlier_share.total_cmp(&b.inlier_share))?;
    if best.inlier_share < LEAST_INLIER_SHARE {
        return None;
    }
    let covariance = (best.scan_information + Matrix3::identity() * PRIOR_INFORMATION).try_inverse()?;
    Some((best.belief.pose, covariance))
}
