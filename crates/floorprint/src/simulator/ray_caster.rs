//! First hits of rays on a world's walls, through a uniform grid.
//!
//! Amanatides & Woo, "A fast voxel traversal algorithm for ray tracing" (1987): a
//! ray visits the grid's cells in order and tests the walls listed there only.

use super::world::{Material, Wall};

/// Side of a cell, metres: a cell along a wall then lists one or two walls.
const CELL_M: f64 = 0.5;
/// Slack at the ends of walls and cells, so that no ray slips through a joint.
const SLACK_M: f64 = 1e-9;

/// The walls of a world, indexed for ray casting.
#[derive(Debug, Clone)]
pub(super) struct RayCaster {
    segments: Vec<Segment>,
    origin_m: [f64; 2],
    columns: usize,
    rows: usize,
    /// Where each cell's list starts in `listed`; one more entry than cells.
    first: Vec<u32>,
    listed: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Segment {
    start_m: [f64; 2],
    along_m: [f64; 2],
    pass_probability: f64,
}

/// Where a ray ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// Distance along the ray, metres.
    pub(super) range_m: f64,
    /// Index of the wall.
    pub(super) wall: usize,
}

impl RayCaster {
    /// Indexes the walls.
    pub(super) fn new(walls: &[Wall]) -> Self {
        let segments: Vec<Segment> = walls
            .iter()
            .map(|wall| Segment {
                start_m: wall.from_m,
                along_m: [wall.to_m[0] - wall.from_m[0], wall.to_m[1] - wall.from_m[1]],
                pass_probability: match wall.material {
                    Material::Opaque => 0.0,
                    Material::Glass { pass_probability } => pass_probability,
                },
            })
            .collect();
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for point in walls.iter().flat_map(|wall| [wall.from_m, wall.to_m]) {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis] - CELL_M);
                high[axis] = high[axis].max(point[axis] + CELL_M);
            }
        }
        let cells = |axis: usize| if walls.is_empty() { 1 } else { ((high[axis] - low[axis]) / CELL_M) as usize + 1 };
        let (columns, rows) = (cells(0), cells(1));
        let mut lists = vec![Vec::new(); columns * rows];
        for (index, segment) in segments.iter().enumerate() {
            segment.cells(low, columns, rows, |cell| lists[cell].push(index as u32));
        }
        let mut first = Vec::with_capacity(lists.len() + 1);
        let mut listed = Vec::new();
        for list in &lists {
            first.push(listed.len() as u32);
            listed.extend_from_slice(list);
        }
        first.push(listed.len() as u32);
        Self { segments, origin_m: low, columns, rows, first, listed }
    }

    /// The first wall that stops a ray within `reach_m`. The ray starts among the walls; `direction` has length one;
    /// `passes(p)` decides whether the ray goes through a wall that lets through a share `p` of all rays.
    pub(super) fn cast(
        &self,
        from_m: [f64; 2],
        direction: [f64; 2],
        reach_m: f64,
        mut passes: impl FnMut(f64) -> bool,
    ) -> Option<Hit> {
        let mut cell = [0_i64; 2];
        let mut step = [0_i64; 2];
        let mut next_m = [f64::INFINITY; 2];
        let mut stride_m = [f64::INFINITY; 2];
        for axis in 0..2 {
            let place = (from_m[axis] - self.origin_m[axis]) / CELL_M;
            cell[axis] = place.floor() as i64;
            if direction[axis] > 0.0 {
                step[axis] = 1;
                stride_m[axis] = CELL_M / direction[axis];
                next_m[axis] = (place.floor() + 1.0 - place) * stride_m[axis];
            } else if direction[axis] < 0.0 {
                step[axis] = -1;
                stride_m[axis] = -CELL_M / direction[axis];
                next_m[axis] = (place - place.floor()) * stride_m[axis];
            }
        }
        let mut beyond_m = SLACK_M;
        while cell[0] >= 0 && cell[1] >= 0 && cell[0] < self.columns as i64 && cell[1] < self.rows as i64 {
            let index = cell[1] as usize * self.columns + cell[0] as usize;
            let listed = &self.listed[self.first[index] as usize..self.first[index + 1] as usize];
            let leaves_m = next_m[0].min(next_m[1]).min(reach_m);
            while let Some(hit) = self.nearest(listed, from_m, direction, beyond_m, leaves_m + SLACK_M) {
                let share = self.segments[hit.wall].pass_probability;
                if share == 0.0 || !passes(share) {
                    return Some(hit);
                }
                beyond_m = hit.range_m + SLACK_M;
            }
            if leaves_m >= reach_m {
                return None;
            }
            let axis = usize::from(next_m[1] < next_m[0]);
            cell[axis] += step[axis];
            next_m[axis] += stride_m[axis];
        }
        None
    }

    fn nearest(
        &self,
        listed: &[u32],
        from_m: [f64; 2],
        direction: [f64; 2],
        beyond_m: f64,
        up_to_m: f64,
    ) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for &wall in listed {
            let range_m = self.segments[wall as usize].range_m(from_m, direction);
            if range_m > beyond_m && range_m <= nearest.map_or(up_to_m, |hit| hit.range_m) {
                nearest = Some(Hit { range_m, wall: wall as usize });
            }
        }
        nearest
    }
}

impl Segment {
    /// Distance along the ray at which it crosses the segment; NaN where it does not.
    fn range_m(&self, from_m: [f64; 2], direction: [f64; 2]) -> f64 {
        let [ax, ay] = self.along_m;
        let [sx, sy] = [self.start_m[0] - from_m[0], self.start_m[1] - from_m[1]];
        let determinant = direction[0] * ay - direction[1] * ax;
        let share = (sy * direction[0] - sx * direction[1]) / -determinant;
        if (-SLACK_M..=1.0 + SLACK_M).contains(&share) { (sx * ay - sy * ax) / determinant } else { f64::NAN }
    }

    /// Every cell that the segment touches; a cell too many does no harm.
    fn cells(&self, origin_m: [f64; 2], columns: usize, rows: usize, mut visit: impl FnMut(usize)) {
        let end_m = [self.start_m[0] + self.along_m[0], self.start_m[1] + self.along_m[1]];
        let place = |value: f64, axis: usize| ((value - origin_m[axis]) / CELL_M).floor() as usize;
        let span = |axis: usize, slack: f64| {
            let (low, high) = (self.start_m[axis].min(end_m[axis]), self.start_m[axis].max(end_m[axis]));
            (place(low - slack, axis), place(high + slack, axis))
        };
        let ((left, right), (bottom, top)) = (span(0, 1e-6), span(1, 1e-6));
        let length_m = self.along_m[0].hypot(self.along_m[1]).max(SLACK_M);
        let half_diagonal_m = CELL_M * std::f64::consts::FRAC_1_SQRT_2 + 1e-6;
        for row in bottom..=top.min(rows - 1) {
            for column in left..=right.min(columns - 1) {
                let x = origin_m[0] + (column as f64 + 0.5) * CELL_M - self.start_m[0];
                let y = origin_m[1] + (row as f64 + 0.5) * CELL_M - self.start_m[1];
                if (x * self.along_m[1] - y * self.along_m[0]).abs() / length_m <= half_diagonal_m {
                    visit(row * columns + column);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn wall(from_m: [f64; 2], to_m: [f64; 2]) -> Wall {
        Wall { from_m, to_m, material: Material::Opaque, color: [0; 3] }
    }

    #[test]
    fn glass_is_passed_once_or_stops_the_ray() {
        let mut glass = wall([1.0, -1.0], [1.0, 1.0]);
        glass.material = Material::Glass { pass_probability: 0.5 };
        let walls = [glass, wall([2.0, -1.0], [2.0, 1.0]), wall([-1.0, -1.0], [-1.0, 1.0])];
        let caster = RayCaster::new(&walls);
        let mut asked = 0;
        let mut cast = |through: bool| {
            caster
                .cast([0.0, 0.1], [1.0, 0.0], 10.0, |_| {
                    asked += 1;
                    through
                })
                .map(|hit| hit.wall)
        };
        assert_eq!(cast(true), Some(1));
        assert_eq!(cast(false), Some(0));
        assert_eq!(asked, 2);
    }

    proptest! {
        /// The grid must change nothing but the speed.
        #[test]
        fn agrees_with_testing_every_wall(
            ends in prop::collection::vec((-9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64), 1..12),
            x in -9.0..9.0_f64, y in -9.0..9.0_f64, angle in 0.0..6.3_f64,
        ) {
            let walls: Vec<Wall> = ends.iter().map(|&(a, b, c, d)| wall([a, b], [c, d])).collect();
            let caster = RayCaster::new(&walls);
            let direction = [angle.cos(), angle.sin()];
            let every: Vec<u32> = (0..walls.len() as u32).collect();
            let expected = caster.nearest(&every, [x, y], direction, SLACK_M, 30.0);
            let inside = walls.iter().flat_map(|w| [w.from_m, w.to_m]).fold([[f64::MAX; 2], [f64::MIN; 2]], |[l, h], p| {
                [[l[0].min(p[0]), l[1].min(p[1])], [h[0].max(p[0]), h[1].max(p[1])]]
            });
            prop_assume!(x > inside[0][0] && x < inside[1][0] && y > inside[0][1] && y < inside[1][1]);
            prop_assert_eq!(caster.cast([x, y], direction, 30.0, |_| false), expected);
        }
    }
}
