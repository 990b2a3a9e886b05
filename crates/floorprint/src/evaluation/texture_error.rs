//! How well the floor's colours agree with the true ones.

use super::EvaluationError;
use crate::map::Raster;
use serde::Serialize;

/// A floor: the colour of each cell, `None` where it was not seen (estimate) or there is no floor (truth).
pub type FloorImage = Raster<Option<[u8; 3]>>;

/// How [`TextureError::new`] compares.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureErrorOptions {
    /// The shift of the estimate with the least error is searched up to this far along x and y; cells of the estimate.
    pub max_shift_cells: u32,
}

impl Default for TextureErrorOptions {
    fn default() -> Self {
        Self { max_shift_cells: 3 }
    }
}

/// Agreement of a painted floor with the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TextureError {
    /// Mean absolute difference over the painted cells and the three channels, steps of 255.
    pub mean_absolute_error: f64,
    /// The same without any shift.
    pub unshifted_mean_absolute_error: f64,
    /// Share of the floor the camera saw that is painted; absent when it is not known what the camera saw.
    pub coverage: Option<f64>,
    /// Painted cells that were compared.
    pub compared_cells: usize,
    /// Painted cells where there is no true floor.
    pub cells_off_the_floor: usize,
    /// How the estimate was shifted, metres along x and y.
    pub shift_m: [f64; 2],
}

impl TextureError {
    /// Compares two floors of the same frame; their resolutions and origins may differ.
    ///
    /// The true colour of a cell is the mean of the true floor over the cell's area.
    /// `seen` says for each of its cells whether the camera saw the floor there
    /// (see [`camera_footprint`](super::camera_footprint)).
    ///
    /// # Errors
    /// [`EvaluationError::NoCommonFloor`] when no painted cell lies on the true floor.
    pub fn new(
        estimate: &FloorImage,
        truth: &FloorImage,
        seen: Option<&Raster<bool>>,
        options: &TextureErrorOptions,
    ) -> Result<Self, EvaluationError> {
        let reach = i64::from(options.max_shift_cells);
        let expected = Expected::new(estimate, truth, reach);
        let painted: Vec<usize> = (0..estimate.cells.len()).filter(|index| estimate.cells[*index].is_some()).collect();
        let unshifted = Difference::at_shift(estimate, &painted, &expected, [0, 0]);
        let mut best = unshifted;
        for shift in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x, y])) {
            let shifted = Difference::at_shift(estimate, &painted, &expected, shift);
            if shifted.mean() < best.mean() {
                best = shifted;
            }
        }
        if unshifted.compared == 0 {
            return Err(EvaluationError::NoCommonFloor);
        }
        Ok(Self {
            mean_absolute_error: best.mean(),
            unshifted_mean_absolute_error: unshifted.mean(),
            coverage: seen.and_then(|seen| coverage(estimate, truth, seen, best.shift_m)),
            compared_cells: best.compared,
            cells_off_the_floor: best.off_the_floor,
            shift_m: best.shift_m,
        })
    }
}

fn coverage(estimate: &FloorImage, truth: &FloorImage, seen: &Raster<bool>, shift_m: [f64; 2]) -> Option<f64> {
    let (mut painted, mut total) = (0_usize, 0_usize);
    for index in (0..seen.cells.len()).filter(|index| seen.cells[*index]) {
        let [x, y] = seen.center_m(index);
        if truth.at([x, y]).is_some_and(Option::is_some) {
            total += 1;
            painted += usize::from(estimate.at([x - shift_m[0], y - shift_m[1]]).is_some_and(Option::is_some));
        }
    }
    (total > 0).then(|| painted as f64 / total as f64)
}

#[derive(Clone, Copy)]
struct Difference {
    sum: f64,
    compared: usize,
    off_the_floor: usize,
    shift_m: [f64; 2],
}

impl Difference {
    fn at_shift(estimate: &FloorImage, painted: &[usize], expected: &Expected, shift: [i64; 2]) -> Self {
        let shift_m = shift.map(|cells| cells as f64 * estimate.resolution_m);
        let mut difference = Self { sum: 0.0, compared: 0, off_the_floor: 0, shift_m };
        for &index in painted {
            let Some(color) = estimate.cells[index] else { continue };
            let (row, column) = estimate.row_and_column(index);
            match expected.at(row - shift[1], column + shift[0]) {
                Some(mean) => {
                    let channels = color.iter().zip(mean).map(|(c, m)| (f64::from(*c) - f64::from(m)).abs());
                    difference.sum += channels.sum::<f64>() / 3.0;
                    difference.compared += 1;
                }
                None => difference.off_the_floor += 1,
            }
        }
        difference
    }

    /// Infinite when nothing was compared, so that any shift with a comparison is better.
    fn mean(&self) -> f64 {
        if self.compared == 0 { f64::INFINITY } else { self.sum / self.compared as f64 }
    }
}

/// The true colours in the estimate's own cells, and in as many around it as it is shifted.
struct Expected {
    width: i64,
    margin: i64,
    colors: Vec<Option<[f32; 3]>>,
}

impl Expected {
    fn new(estimate: &FloorImage, truth: &FloorImage, margin: i64) -> Self {
        let (width, height) = (estimate.width as i64 + 2 * margin, estimate.height as i64 + 2 * margin);
        let left_m = estimate.origin_m[0] - margin as f64 * estimate.resolution_m;
        let top_m = estimate.origin_m[1] + (estimate.height as i64 + margin) as f64 * estimate.resolution_m;
        let cells = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
        let center_m = |[column, row]: [i64; 2]| {
            let from_corner = |cells: i64| (cells as f64 + 0.5) * estimate.resolution_m;
            [left_m + from_corner(column), top_m - from_corner(row)]
        };
        let colors = cells.map(|cell| mean_in_square(truth, center_m(cell), estimate.resolution_m)).collect();
        Self { width, margin, colors }
    }

    /// The true colour at a row and a column of the estimate; `None` where there is no floor.
    fn at(&self, row: i64, column: i64) -> Option<[f32; 3]> {
        let (row, column) = (row + self.margin, column + self.margin);
        self.colors[(row * self.width + column) as usize]
    }
}

/// The mean colour over the cells whose centres lie in a square, at least the
/// one that holds its centre; `None` where no cell has a colour.
fn mean_in_square(image: &FloorImage, center_m: [f64; 2], side_m: f64) -> Option<[f32; 3]> {
    let cells = ((side_m / image.resolution_m).round() as i64).max(1);
    let offset_m = 0.5 * (cells - 1) as f64 * image.resolution_m;
    // The top left cell of the square; the small push decides ties between cells the same way everywhere.
    let push_m = 1e-6 * image.resolution_m;
    let corner_m = [center_m[0] - offset_m + push_m, center_m[1] + offset_m + push_m];
    let (row, column) = image.row_and_column_at(corner_m);
    let inside =
        |first: i64, size: usize| first.clamp(0, size as i64) as usize..(first + cells).clamp(0, size as i64) as usize;
    let columns = inside(column, image.width);
    let (mut sum, mut count) = ([0_u64; 3], 0_u64);
    for row in inside(row, image.height) {
        for color in image.cells[row * image.width..][columns.clone()].iter().flatten() {
            sum = std::array::from_fn(|channel| sum[channel] + u64::from(color[channel]));
            count += 1;
        }
    }
    (count > 0).then(|| sum.map(|sum| (sum as f64 / count as f64) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor of 2 m × 1 m with colours that vary from cell to cell and repeat nowhere near.
    fn floor(resolution_m: f64) -> FloorImage {
        let (width, height) = ((2.0 / resolution_m).round() as usize, (1.0 / resolution_m).round() as usize);
        let blank = Raster { width, height, resolution_m, origin_m: [-1.0, 3.0], cells: vec![(); width * height] };
        blank.map(|_, [x, y]| {
            let wave = |a: f64, b: f64| (127.5 + 127.0 * (a * x + b * y).sin()) as u8;
            Some([wave(9.0, 2.0), wave(-4.0, 11.0), wave(5.0, 7.0)])
        })
    }

    fn error(estimate: &FloorImage, truth: &FloorImage, shift: u32) -> TextureError {
        TextureError::new(estimate, truth, None, &TextureErrorOptions { max_shift_cells: shift }).unwrap()
    }

    #[test]
    fn the_true_floor_has_no_error() {
        let truth = floor(0.01);
        let found = error(&truth, &truth, 2);
        assert_eq!((found.mean_absolute_error, found.shift_m), (0.0, [0.0, 0.0]));
        assert_eq!((found.compared_cells, found.cells_off_the_floor, found.coverage), (20_000, 0, None));
    }

    #[test]
    fn a_coarser_floor_is_compared_with_the_mean_of_the_fine_one() {
        let truth = floor(0.01);
        let coarse = floor(0.02).map(|_, center| {
            let mean = mean_in_square(&truth, center, 0.02).unwrap();
            let (row, column) = truth.row_and_column_at([center[0] - 0.005, center[1] + 0.005]);
            let corner = truth.cells[truth.index(row, column).unwrap()].unwrap();
            assert!((mean[0] - f32::from(corner[0])).abs() < 20.0);
            Some(mean.map(|m| m.round() as u8))
        });
        assert!(error(&coarse, &truth, 0).mean_absolute_error <= 0.5);
    }

    #[test]
    fn a_brighter_floor_is_off_by_as_much() {
        let truth = floor(0.01).map(|_, [x, _]| Some([if x > 0.0 { 100 } else { 20 }; 3]));
        let brighter = truth.map(|index, _| truth.cells[index].map(|c| c.map(|v| v + 12)));
        assert!((error(&brighter, &truth, 0).mean_absolute_error - 12.0).abs() < 1e-12);
    }

    #[test]
    fn a_shift_is_found_and_reported() {
        let truth = floor(0.01);
        let shifted = FloorImage { origin_m: [-0.98, 2.99], ..truth.clone() };
        let found = error(&shifted, &truth, 3);
        assert!(found.mean_absolute_error < 1e-12 && found.unshifted_mean_absolute_error > 5.0);
        assert!((found.shift_m[0] + 0.02).abs() < 1e-9 && (found.shift_m[1] - 0.01).abs() < 1e-9);
    }

    #[test]
    fn coverage_is_over_the_floor_that_was_seen() {
        let mut truth = floor(0.01);
        let mut estimate = truth.map(|index, [x, _]| truth.cells[index].filter(|_| x < 0.5));
        let seen = truth.map(|_, [x, _]| x > 0.0);
        let options = TextureErrorOptions { max_shift_cells: 0 };
        let found = TextureError::new(&estimate, &truth, Some(&seen), &options).unwrap();
        assert!((found.coverage.unwrap() - 0.5).abs() < 1e-9);
        truth = truth.map(|index, [x, _]| truth.cells[index].filter(|_| x < 0.5));
        let found = TextureError::new(&estimate, &truth, Some(&seen), &options).unwrap();
        assert_eq!(found.coverage, Some(1.0));
        estimate.origin_m = [50.0, 0.0];
        let missed = TextureError::new(&estimate, &truth, Some(&seen), &options);
        assert_eq!(missed, Err(EvaluationError::NoCommonFloor));
    }
}
