//! Exhaustive search of a window of poses (correlative scan matching, Olson 2009).
//!
//! The odometry of real logs lies for stretches: it stands still and then jumps. Where the
//! fit around its prediction fails, the whole neighbourhood is looked at, coarsely, and the
//! best places are handed to the finer matcher.

use crate::geometry::Pose2;
use crate::map::Cell;
use crate::surface::SurfaceScan;
use crate::surface::{ProximityField, SurfaceMap};
use std::cmp::Reverse;

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
/// Points of the scan that are looked up: so many that their scores, 255 at most each, fit 16 bits.
const POINTS: usize = 60;
/// Scores of shifts are added up so many at a time.
const LANES: usize = 16;

/// The best poses of the window around `center`, best first, at most `count`, each the best of its heading.
///
/// Shifts are whole numbers of cells, so that each point's share in the scores of a row of shifts
/// is a row of the map's [`ProximityField`].
#[must_use]
pub fn search(map: &SurfaceMap, scan: &SurfaceScan, center: &Pose2, window: SearchWindow, count: usize) -> Vec<Pose2> {
    let points_apart = scan.len().div_ceil(POINTS).max(1);
    let points: Vec<[f64; 2]> = scan.iter().step_by(points_apart).map(|(point, _)| point.map(f64::from)).collect();
    let inverse_cell = map.inverse_resolution();
    let step_m = if window.distance_m > 1.0 { WIDE_STEP_M } else { STEP_M };
    let stride = ((step_m * inverse_cell).round() as i32).clamp(1, LARGEST_STRIDE);
    let step_m = f64::from(stride) / inverse_cell;
    let steps = (window.distance_m / step_m).round() as i32;
    let turns = (window.angle_rad / STEP_RAD).round() as i32;
    let shifts = 2 * steps as usize + 1;
    let row_length = shifts.next_multiple_of(LANES);
    let reach_m = points.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max) + step_m * f64::from(steps);
    let corner = |offset_m: f64| Cell::containing([center.x + offset_m, center.y + offset_m], inverse_cell);
    let field = ProximityField::new(map, stride, shifts, [corner(-reach_m), corner(reach_m)]);
    let mut scores = vec![0; shifts * row_length];
    let mut best_of_heading: Vec<(u16, Pose2)> = Vec::with_capacity(2 * turns as usize + 1);
    for turn in -turns..=turns {
        let theta = center.theta + f64::from(turn) * STEP_RAD;
        let (sin, cos) = theta.sin_cos();
        scores.fill(0);
        for [x, y] in &points {
            let point = [center.x + cos * x - sin * y, center.y + sin * x + cos * y];
            let cell = Cell::containing(point, inverse_cell);
            let first = Cell { x: cell.x - steps * stride, y: cell.y - steps * stride };
            field.add_shifted(first, shifts, row_length, &mut scores);
        }
        let (mut best, mut at) = (0, [0, 0]);
        for (row, scores) in scores.chunks_exact(row_length).enumerate() {
            for (column, &score) in scores[..shifts].iter().enumerate() {
                if score > best {
                    (best, at) = (score, [column as i32 - steps, row as i32 - steps]);
                }
            }
        }
        let [dx, dy] = at.map(|shift| f64::from(shift) * step_m);
        best_of_heading.push((best, Pose2::new(center.x + dx, center.y + dy, theta)));
    }
    best_of_heading.sort_by_key(|&(score, _)| Reverse(score));
    best_of_heading.into_iter().take(count).map(|(_, pose)| pose).collect()
}

/// Shifts are at most so many cells apart, however small the cells are.
const LARGEST_STRIDE: i32 = 8;
