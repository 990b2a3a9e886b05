//! How well a map's occupied cells agree with those of the true map: precision, recall and F1.

use super::EvaluationError;
use crate::map::{Occupancy, Raster};
use serde::Serialize;

/// From a known free cell on, free cells of the truth this far count as explored, metres.
const EXPLORED_REACH_M: f64 = 0.25;

/// How [`MapQuality::new`] compares.
#[derive(Debug, Clone, PartialEq)]
pub struct MapQualityOptions {
    /// How far apart, along x and along y, two occupied cells may be and still be the same wall; cells of the true map.
    pub tolerance_cells: u32,
    /// The shift of the estimate with the best F1 is searched up to this far along x and y; cells of the true map.
    pub max_shift_cells: u32,
}

impl Default for MapQualityOptions {
    fn default() -> Self {
        Self { tolerance_cells: 1, max_shift_cells: 0 }
    }
}

/// Agreement of the occupied cells.
///
/// *Precision* counts every occupied cell of the estimate: also where the truth says
/// unknown, which in a true map is what lies behind walls and inside things.
/// *Recall* counts the occupied cells of the truth that the drive came to see: those
/// beside a free cell of the truth that the estimate knows, or that free cells connect
/// within 0.25 m to one it knows, so that a wall drawn too near does not hide the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MapQuality {
    /// Share of the estimate's occupied cells that have one of the truth within the tolerance.
    pub precision: f64,
    /// Share of the explored occupied cells of the truth that have one of the estimate within the tolerance.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Share of all occupied cells of the truth, explored or not, that were found.
    pub completeness: f64,
    /// Share of the truth's free cells that the estimate knows.
    pub explored: f64,
    /// Occupied cells of the estimate.
    pub estimated_cells: usize,
    /// Occupied cells of the truth that count for the recall.
    pub explored_true_cells: usize,
    /// How the estimate was shifted for these figures, metres along x and y.
    pub shift_m: [f64; 2],
}

impl MapQuality {
    /// Compares two maps of the same frame; their resolutions and origins may differ.
    ///
    /// # Errors
    /// [`EvaluationError::NothingOccupied`] when one of the maps has no occupied cell.
    pub fn new(
        estimate: &Raster<Occupancy>,
        truth: &Raster<Occupancy>,
        options: &MapQualityOptions,
    ) -> Result<Self, EvaluationError> {
        for (map, name) in [(estimate, "estimated"), (truth, "true")] {
            if !map.cells.contains(&Occupancy::Occupied) {
                return Err(EvaluationError::NothingOccupied { map: name });
            }
        }
        let tolerance_m = f64::from(options.tolerance_cells) * truth.resolution_m;
        let comparison = Comparison {
            estimate,
            truth,
            near_estimate: near_occupied(estimate, tolerance_m),
            near_truth: near_occupied(truth, tolerance_m),
            explored: explored_walls(estimate, truth),
        };
        let mut best = comparison.at_shift([0.0, 0.0]);
        let reach = i64::from(options.max_shift_cells);
        for (y, x) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
            let shifted = comparison.at_shift([x as f64 * truth.resolution_m, y as f64 * truth.resolution_m]);
            // Of equally good shifts the first found stays, and no shift before all others.
            if shifted.f1 > best.f1 {
                best = shifted;
            }
        }
        Ok(best)
    }
}

struct Comparison<'a> {
    estimate: &'a Raster<Occupancy>,
    truth: &'a Raster<Occupancy>,
    /// Whether an occupied cell of the same map is within the tolerance.
    near_estimate: Raster<bool>,
    near_truth: Raster<bool>,
    /// Occupied cells of the truth that count for the recall, whatever the shift.
    explored: Vec<usize>,
}

impl Comparison<'_> {
    fn at_shift(&self, shift_m: [f64; 2]) -> MapQuality {
        let (estimate, truth) = (self.estimate, self.truth);
        let is_right = |index: &usize| {
            let [x, y] = estimate.center_m(*index);
            self.near_truth.at([x + shift_m[0], y + shift_m[1]]) == Some(&true)
        };
        let is_found = |index: &usize| {
            let [x, y] = truth.center_m(*index);
            self.near_estimate.at([x - shift_m[0], y - shift_m[1]]) == Some(&true)
        };
        let precision = share(cells_with(estimate, Occupancy::Occupied), is_right);
        let recall = share(self.explored.iter().copied(), is_found);
        MapQuality {
            precision,
            recall,
            f1: if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 },
            completeness: share(cells_with(truth, Occupancy::Occupied), is_found),
            explored: share(cells_with(truth, Occupancy::Free), |index| is_known(estimate, truth.center_m(*index))),
            estimated_cells: cells_with(estimate, Occupancy::Occupied).count(),
            explored_true_cells: self.explored.len(),
            shift_m,
        }
    }
}

fn is_known(map: &Raster<Occupancy>, point_m: [f64; 2]) -> bool {
    map.at(point_m).is_some_and(|cell| *cell != Occupancy::Unknown)
}

/// The occupied cells of the truth beside free cells that the estimate knows or that
/// free cells connect to such ones within [`EXPLORED_REACH_M`].
fn explored_walls(estimate: &Raster<Occupancy>, truth: &Raster<Occupancy>) -> Vec<usize> {
    let mut reached =
        truth.map(|index, center_m| truth.cells[index] == Occupancy::Free && is_known(estimate, center_m)).cells;
    let mut front: Vec<_> = (0..reached.len()).filter(|index| reached[*index]).collect();
    for _ in 0..(EXPLORED_REACH_M / truth.resolution_m).round() as usize {
        let mut next = Vec::new();
        for neighbour in front.iter().flat_map(|index| neighbours(truth, *index)) {
            if truth.cells[neighbour] == Occupancy::Free && !std::mem::replace(&mut reached[neighbour], true) {
                next.push(neighbour);
            }
        }
        front = next;
    }
    cells_with(truth, Occupancy::Occupied).filter(|wall| neighbours(truth, *wall).any(|cell| reached[cell])).collect()
}

fn cells_with(map: &Raster<Occupancy>, what: Occupancy) -> impl Iterator<Item = usize> {
    map.cells.iter().enumerate().filter(move |(_, cell)| **cell == what).map(|(index, _)| index)
}

/// Share of the cells that pass; 0 of none.
fn share(cells: impl Iterator<Item = usize>, passes: impl Fn(&usize) -> bool) -> f64 {
    let (mut passed, mut total) = (0_usize, 0_usize);
    for cell in cells {
        total += 1;
        passed += usize::from(passes(&cell));
    }
    if total == 0 { 0.0 } else { passed as f64 / total as f64 }
}

/// The up to eight cells around a cell.
fn neighbours<T>(map: &Raster<T>, index: usize) -> impl Iterator<Item = usize> {
    let (row, column) = map.row_and_column(index);
    (row - 1..=row + 1)
        .flat_map(move |r| (column - 1..=column + 1).map(move |c| (r, c)))
        .filter_map(|(r, c)| map.index(r, c))
        .filter(move |n| *n != index)
}

fn near_occupied(map: &Raster<Occupancy>, tolerance_m: f64) -> Raster<bool> {
    let reach = (tolerance_m / map.resolution_m).round() as i64;
    let mut near = map.map(|_, _| false);
    for occupied in cells_with(map, Occupancy::Occupied) {
        let (row, column) = map.row_and_column(occupied);
        for r in row - reach..=row + reach {
            for c in column - reach..=column + reach {
                if let Some(index) = map.index(r, c) {
                    near.cells[index] = true;
                }
            }
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map from a drawing: `#` occupied, `.` free, anything else unknown.
    fn drawn(rows: &[&str]) -> Raster<Occupancy> {
        let meaning = |c| match c {
            '#' => Occupancy::Occupied,
            '.' => Occupancy::Free,
            _ => Occupancy::Unknown,
        };
        Raster {
            width: rows[0].len(),
            height: rows.len(),
            resolution_m: 0.05,
            origin_m: [0.0, 0.0],
            cells: rows.concat().chars().map(meaning).collect(),
        }
    }

    fn room() -> Raster<Occupancy> {
        drawn(&["         ", " ####### ", " #.....# ", " #.....# ", " #.....# ", " ####### ", "         "])
    }

    fn quality(estimate: &Raster<Occupancy>, truth: &Raster<Occupancy>, tolerance: u32, shift: u32) -> MapQuality {
        let options = MapQualityOptions { tolerance_cells: tolerance, max_shift_cells: shift };
        MapQuality::new(estimate, truth, &options).unwrap()
    }

    #[test]
    fn the_true_map_is_perfect() {
        let found = quality(&room(), &room(), 0, 2);
        assert_eq!((found.precision, found.recall, found.f1), (1.0, 1.0, 1.0));
        assert_eq!((found.completeness, found.explored, found.shift_m), (1.0, 1.0, [0.0, 0.0]));
    }

    #[test]
    fn what_was_not_explored_does_not_count_for_the_recall() {
        let truth = drawn(&["####################", "#..................#", "####################"]);
        let left_end = drawn(&["############", "#.....      ", "############"]);
        let found = quality(&left_end, &truth, 0, 0);
        assert_eq!((found.precision, found.recall), (1.0, 1.0));
        // The left end; above and below 5 known cells, 5 within reach of them and 2 corners.
        assert_eq!(found.explored_true_cells, 1 + 2 * 12);
        assert_eq!(found.completeness, 25.0 / 42.0);
        assert_eq!(found.explored, 5.0 / 18.0);
    }

    #[test]
    fn a_wall_drawn_too_near_does_not_hide_the_true_one() {
        let truth = drawn(&["#########", "#.......#", "#.......#", "#.......#", "#########"]);
        let near = drawn(&["         ", "#########", "#.......#", "#.......#", "#########"]);
        let found = quality(&near, &truth, 0, 0);
        assert_eq!((found.recall, found.precision), (15.0 / 24.0, 15.0 / 22.0));
    }

    #[test]
    fn a_shifted_map_is_found_by_the_search_and_reported() {
        let mut shifted = room();
        shifted.origin_m = [0.10, -0.05];
        let plain = quality(&shifted, &room(), 0, 0);
        assert!(plain.f1 < 0.7, "{plain:?}");
        let found = quality(&shifted, &room(), 0, 3);
        assert_eq!(found.f1, 1.0);
        assert!((found.shift_m[0] + 0.10).abs() < 1e-12 && (found.shift_m[1] - 0.05).abs() < 1e-12);
    }

    #[test]
    fn a_ghost_wall_costs_precision_and_a_gap_recall() {
        let ghost = drawn(&["         ", " ####### ", " #.....# ", " #..#..# ", " #.....# ", " ####### ", "         "]);
        assert_eq!(quality(&ghost, &room(), 0, 0).precision, 20.0 / 21.0);
        let outside =
            drawn(&["#        ", " ####### ", " #.....# ", " #.....# ", " #.....# ", " ####### ", "         "]);
        assert_eq!(quality(&outside, &room(), 0, 0).precision, 20.0 / 21.0);
        let gap = drawn(&["         ", " ####### ", " #.....# ", " #.....  ", " #.....# ", " ####### ", "         "]);
        let found = quality(&gap, &room(), 0, 0);
        assert_eq!((found.precision, found.recall), (1.0, 19.0 / 20.0));
        assert_eq!(quality(&gap, &room(), 1, 0).recall, 1.0);
    }

    #[test]
    fn a_finer_map_of_the_same_walls_agrees() {
        let truth = room();
        let (width, height, origin_m) = (2 * truth.width, 2 * truth.height, truth.origin_m);
        let fine = Raster { width, height, resolution_m: 0.025, origin_m, cells: vec![(); width * height] };
        let fine = fine.map(|_, center| *truth.at(center).unwrap());
        let found = quality(&fine, &truth, 1, 0);
        assert_eq!((found.f1, found.estimated_cells), (1.0, 80));
    }

    #[test]
    fn a_map_without_walls_is_an_error() {
        let empty = drawn(&["..."]);
        let message = MapQuality::new(&empty, &room(), &MapQualityOptions::default()).unwrap_err().to_string();
        assert!(message.contains("estimated"), "{message}");
    }
}
