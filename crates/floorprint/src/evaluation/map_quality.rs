//! How well a map's occupied cells agree with those of the true map: precision, recall and F1.

use super::EvaluationError;
use crate::map::{Occupancy, Raster};
use serde::Serialize;

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
/// *Recall* counts the occupied cells of the truth that the drive could have seen:
/// those with a free cell of the truth beside them that the estimate knows as well.
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
}

impl Comparison<'_> {
    fn at_shift(&self, shift_m: [f64; 2]) -> MapQuality {
        let (estimate, truth) = (self.estimate, self.truth);
        let into_estimate = |[x, y]: [f64; 2]| [x - shift_m[0], y - shift_m[1]];
        let into_truth = |[x, y]: [f64; 2]| [x + shift_m[0], y + shift_m[1]];
        let is_known = |index: &usize| {
            estimate.at(into_estimate(truth.center_m(*index))).is_some_and(|cell| *cell != Occupancy::Unknown)
        };
        let is_found = |index: &usize| self.near_estimate.at(into_estimate(truth.center_m(*index))) == Some(&true);
        let is_explored = |index: &usize| {
            neighbours(truth, *index).filter(|n| truth.cells[*n] == Occupancy::Free).any(|n| is_known(&n))
        };

        let estimated: Vec<_> = cells_with(estimate, Occupancy::Occupied).collect();
        let right = estimated.iter().filter(|i| self.near_truth.at(into_truth(estimate.center_m(**i))) == Some(&true));
        let occupied: Vec<_> = cells_with(truth, Occupancy::Occupied).collect();
        let explored: Vec<_> = occupied.iter().copied().filter(is_explored).collect();
        let free: Vec<_> = cells_with(truth, Occupancy::Free).collect();

        let precision = share(right.count(), estimated.len());
        let recall = share(explored.iter().filter(|i| is_found(i)).count(), explored.len());
        MapQuality {
            precision,
            recall,
            f1: if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 },
            completeness: share(occupied.iter().filter(|i| is_found(i)).count(), occupied.len()),
            explored: share(free.iter().filter(|i| is_known(i)).count(), free.len()),
            estimated_cells: estimated.len(),
            explored_true_cells: explored.len(),
            shift_m,
        }
    }
}

fn cells_with(map: &Raster<Occupancy>, what: Occupancy) -> impl Iterator<Item = usize> {
    map.cells.iter().enumerate().filter(move |(_, cell)| **cell == what).map(|(index, _)| index)
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
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
        let left_half =
            drawn(&["         ", " ###     ", " #.      ", " #.      ", " #.      ", " ###     ", "         "]);
        let found = quality(&left_half, &room(), 0, 0);
        assert_eq!((found.precision, found.recall), (1.0, 1.0));
        assert_eq!(found.explored_true_cells, 9);
        assert_eq!(found.completeness, 9.0 / 20.0);
        assert_eq!(found.explored, 3.0 / 15.0);
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
