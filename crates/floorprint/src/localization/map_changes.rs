//! What changed since a map was made, as seen by a robot that knows where it is. The map stays as it is.

use crate::frame::BodyScan;
use crate::geometry::{Polygon, Pose2};
use crate::map::{Change, ChangedPatch, MapConfig, Occupancy, OccupancyGrid, Raster, difference, passed_cells};

/// What was seen that the map does not show, and what it shows that is gone.
#[derive(Debug, Clone)]
pub struct MapChanges {
    map: Raster<Occupancy>,
    /// What is seen now, in the frame whose origin is the lower left corner of the map.
    now: OccupancyGrid,
    /// For each cell of the map the first and the last time at which something stood there, seconds …
    stood: Vec<Option<[f64; 2]>>,
    /// … and at which a ray passed, of cells that are occupied on the map.
    passed: Vec<Option<[f64; 2]>>,
    step_m: f64,
    step_rad: f64,
    last: Option<Pose2>,
}

/// A patch that changed.
#[derive(Debug, Clone, PartialEq)]
pub struct MapChange {
    /// Where and what.
    pub patch: ChangedPatch,
    /// Stamp of the first scan that showed it, seconds.
    pub first_seen_s: f64,
    /// Stamp of the last scan that showed it, seconds.
    pub last_seen_s: f64,
}

/// What was seen for less than this was somebody who walked by, seconds.
const SHORTEST_S: f64 = 1.0;

impl MapChanges {
    /// Nothing seen yet of a map. `config` says how what is seen is drawn, but for the size of the cells, which is the map's.
    #[must_use]
    pub fn new(map: Raster<Occupancy>, config: &MapConfig) -> Self {
        let cells = map.cells.len();
        Self {
            now: OccupancyGrid::new(&MapConfig { resolution_m: map.resolution_m, ..config.clone() }),
            stood: vec![None; cells],
            passed: vec![None; cells],
            step_m: config.redraw_distance_m,
            step_rad: config.redraw_angle_rad,
            last: None,
            map,
        }
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &Raster<Occupancy> {
        &self.map
    }

    /// Takes in a scan at a pose that is certain, `map_from_body`; whether it was used. A robot that stands still sees the
    /// same again and again.
    pub fn observe(&mut self, stamp_s: f64, map_from_body: &Pose2, scan: &BodyScan) -> bool {
        let stands_still = self.last.is_some_and(|last| {
            let step = last.between(map_from_body);
            step.distance() < self.step_m && step.theta.abs() < self.step_rad
        });
        if stands_still {
            return false;
        }
        self.last = Some(*map_from_body);
        let [left, below] = self.map.origin_m;
        let corner_from_body = Pose2 { x: map_from_body.x - left, y: map_from_body.y - below, ..*map_from_body };
        self.now.draw_scan(&corner_from_body, scan);
        let origin = self.now.cell_at(corner_from_body.transform_point(scan.origin_m));
        let hits = scan.hits.iter().map(|point| (point, true));
        for (point, is_hit) in hits.chain(scan.free_ends.iter().map(|point| (point, false))) {
            let end = self.now.cell_at(corner_from_body.transform_point(point.map(f64::from)));
            for cell in passed_cells(origin, end) {
                if let Some(index) = self.index(cell).filter(|&index| self.map.cells[index] == Occupancy::Occupied) {
                    extend(&mut self.passed[index], stamp_s);
                }
            }
            if let Some(index) = self.index(end).filter(|_| is_hit) {
                extend(&mut self.stood[index], stamp_s);
            }
        }
        true
    }

    fn index(&self, cell: crate::map::Cell) -> Option<usize> {
        self.map.index(self.map.height as i64 - 1 - i64::from(cell.y), i64::from(cell.x))
    }

    /// The patches that changed, the largest first, as [`difference`] tells them apart: walls that moved by no more than
    /// `tolerance_m` did not, and patches smaller than `least_area_m2` are left out. What was seen for a moment only is left
    /// out, too.
    #[must_use]
    pub fn found(&self, tolerance_m: f64, least_area_m2: f64) -> Vec<MapChange> {
        let Some(mut now) = self.now.to_raster() else { return Vec::new() };
        (0..2).for_each(|axis| now.origin_m[axis] += self.map.origin_m[axis]);
        let patches = difference(&self.map, &now, tolerance_m, least_area_m2);
        let lasts = |change: &MapChange| change.last_seen_s - change.first_seen_s >= SHORTEST_S;
        patches.into_iter().filter_map(|patch| self.dated(patch)).filter(lasts).collect()
    }

    /// A patch with the times at which it was seen.
    fn dated(&self, patch: ChangedPatch) -> Option<MapChange> {
        let times = if patch.change == Change::New { &self.stood } else { &self.passed };
        let outlines: Vec<Polygon> =
            patch.outlines_m.iter().filter_map(|outline| Polygon::new(outline.clone()).ok()).collect();
        let corners = || patch.outlines_m.iter().flatten().copied();
        let cell_at = |pick: fn(f64, f64) -> f64, from: f64| {
            self.map.row_and_column_at([0, 1].map(|axis| corners().map(|corner| corner[axis]).fold(from, pick)))
        };
        let ((bottom, left), (top, right)) = (cell_at(f64::min, f64::INFINITY), cell_at(f64::max, f64::NEG_INFINITY));
        let mut seen: Option<[f64; 2]> = None;
        for (row, column) in (top..=bottom).flat_map(|row| (left..=right).map(move |column| (row, column))) {
            let Some(index) = self.map.index(row, column) else { continue };
            let Some([first_s, last_s]) = times[index] else { continue };
            let center = self.map.center_m(index);
            // A cell in a hole lies in two outlines.
            if outlines.iter().filter(|outline| outline.contains(center)).count() % 2 == 1 {
                extend(&mut seen, first_s);
                extend(&mut seen, last_s);
            }
        }
        seen.map(|[first_seen_s, last_seen_s]| MapChange { patch, first_seen_s, last_seen_s })
    }
}

/// Extends a span of time.
fn extend(span: &mut Option<[f64; 2]>, stamp_s: f64) {
    *span = Some(span.map_or([stamp_s; 2], |[first_s, last_s]| [first_s.min(stamp_s), last_s.max(stamp_s)]));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room of 6 m × 4 m whose lower left corner lies at an odd place, with a box in it or not, seen from `at`.
    fn seen(at: [f64; 2], has_box: bool) -> BodyScan {
        let mut scan = BodyScan::default();
        for ray in 0..720 {
            let (sin, cos) = (0.5 * (f64::from(ray) + 0.5)).to_radians().sin_cos();
            let to_x = (if cos > 0.0 { 6.0 } else { 0.0 } - at[0]) / cos;
            let to_y = (if sin > 0.0 { 4.0 } else { 0.0 } - at[1]) / sin;
            // The near side of a box of 0.6 m at (4, 2).
            let to_box = (3.7 - at[0]) / cos;
            let hits_box = has_box && to_box > 0.0 && (at[1] + to_box * sin - 2.0).abs() < 0.3;
            let range = if hits_box { to_box } else { to_x.min(to_y) };
            scan.hits.push((range * cos) as f32, (range * sin) as f32);
        }
        scan
    }

    fn drive(changes: &mut MapChanges, origin: [f64; 2], has_box: impl Fn(i32) -> bool) {
        for step in 0..20 {
            let at = [1.0 + 0.11 * f64::from(step), 1.0];
            let pose = Pose2::new(origin[0] + at[0], origin[1] + at[1], 0.0);
            assert!(changes.observe(100.0 + f64::from(step), &pose, &seen(at, has_box(step))));
            assert!(!changes.observe(100.5 + f64::from(step), &pose, &seen(at, true)), "it stands still");
        }
    }

    fn map(origin: [f64; 2], has_box: bool) -> Raster<Occupancy> {
        let mut grid = OccupancyGrid::new(&MapConfig::default());
        for step in 0..20 {
            let at = [1.0 + 0.11 * f64::from(step), 1.0];
            grid.draw_scan(&Pose2::new(origin[0] + at[0], origin[1] + at[1], 0.0), &seen(at, has_box));
        }
        grid.to_raster().unwrap()
    }

    #[test]
    fn what_is_new_and_what_is_gone_is_told_with_its_times() {
        let origin = [-31.234, 17.789];
        for is_new in [true, false] {
            let mut changes = MapChanges::new(map(origin, !is_new), &MapConfig::default());
            drive(&mut changes, origin, |step| if is_new { step >= 4 } else { false });
            let found = changes.found(0.15, 0.02);
            let [change] = found.as_slice() else { panic!("{found:?}") };
            let expected = if is_new { Change::New } else { Change::Gone };
            assert_eq!(change.patch.change, expected);
            let [x, y] = change.patch.outlines_m[0][0];
            assert!((x - origin[0] - 3.7).abs() < 0.15 && (y - origin[1] - 2.0).abs() < 0.4, "{x} {y}");
            assert!((change.first_seen_s - if is_new { 104.0 } else { 100.0 }).abs() < 1.5, "{change:?}");
            assert!((change.last_seen_s - 119.0).abs() < 1.5, "{change:?}");
        }
    }

    #[test]
    fn who_walks_by_is_no_change_and_neither_is_nothing() {
        let origin = [0.0, 0.0];
        let mut changes = MapChanges::new(map(origin, false), &MapConfig::default());
        assert!(changes.found(0.15, 0.0).is_empty());
        drive(&mut changes, origin, |step| step == 9);
        assert_eq!(changes.found(0.15, 0.0), []);
    }
}
