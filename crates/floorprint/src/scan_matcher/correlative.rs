//! Exhaustive search of a window of poses (correlative scan matching, Olson 2009).
//!
//! The odometry of real logs lies for stretches: it stands still and then jumps. Where the
//! fit around its prediction fails, the whole neighbourhood is looked at, coarsely, and the
//! best places are handed to the finer matcher.

use super::SurfaceScan;
use crate::geometry::Pose2;
use crate::map::SurfaceMap;

/// The poses to look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchWindow {
    /// Largest offset in x and in y, metres.
    pub distance_m: f64,
    /// Largest offset in heading, radians.
    pub angle_rad: f64,
}

/// Steps of the search in x and y, metres, for windows up to one metre and for wider ones; the
/// map's reach makes the score smooth over them.
const STEP_M: f64 = 0.1;
const WIDE_STEP_M: f64 = 0.2;
/// Step of the search in heading, radians.
const STEP_RAD: f64 = 0.04;
/// Points of the scan that are looked up.
const POINTS: usize = 60;

/// The best poses of the window around `center`, best first, at most `count`, each the best of its heading.
#[must_use]
pub fn search(map: &SurfaceMap, scan: &SurfaceScan, center: &Pose2, window: SearchWindow, count: usize) -> Vec<Pose2> {
    let stride = scan.len().div_ceil(POINTS).max(1);
    let points: Vec<[f64; 2]> = scan.iter().step_by(stride).map(|(point, _)| point.map(f64::from)).collect();
    let step_m = if window.distance_m > 1.0 { WIDE_STEP_M } else { STEP_M };
    let steps = (window.distance_m / step_m).round() as i32;
    let turns = (window.angle_rad / STEP_RAD).round() as i32;
    let mut best_of_heading: Vec<(f32, Pose2)> = Vec::with_capacity(2 * turns as usize + 1);
    let mut rotated = Vec::with_capacity(points.len());
    for turn in -turns..=turns {
        let theta = center.theta + f64::from(turn) * STEP_RAD;
        let (sin, cos) = theta.sin_cos();
        rotated.clear();
        rotated.extend(points.iter().map(|[x, y]| [center.x + cos * x - sin * y, center.y + sin * x + cos * y]));
        let mut best = (-1.0, Pose2::IDENTITY);
        for row in -steps..=steps {
            for column in -steps..=steps {
                let (dx, dy) = (f64::from(column) * step_m, f64::from(row) * step_m);
                let score: f32 = rotated.iter().map(|[x, y]| map.proximity([x + dx, y + dy])).sum();
                if score > best.0 {
                    best = (score, Pose2::new(center.x + dx, center.y + dy, theta));
                }
            }
        }
        best_of_heading.push(best);
    }
    best_of_heading.sort_by(|a, b| b.0.total_cmp(&a.0));
    best_of_heading.into_iter().take(count).map(|(_, pose)| pose).collect()
}
