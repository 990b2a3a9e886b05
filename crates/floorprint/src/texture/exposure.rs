//! Balances brightness and tint of the images where they see the same floor.
//!
//! An image's automatic exposure and white balance multiply its colours, so in logarithms
//! an image i sees the true colour m of a cell as `m + g_i`. The gains g and the colours m
//! are fitted to all images at once by least squares (Brown & Lowe 2007, §6), with weights
//! that let go of cells where images contradict each other (graduated, Geman–McClure). The
//! colours are eliminated cell by cell and conjugate gradients solve for the gains.

use super::painter::PlacedPatch;
use rayon::prelude::*;

/// Side of the cells in which images are compared, metres: large enough that a small
/// error of the trajectory hardly changes a cell's mean colour.
const CELL_M: f64 = 0.1;
/// Means of channels outside these limits are too dark or too bright to tell a gain.
const USABLE: std::ops::RangeInclusive<f32> = 16.0..=245.0;
/// Expected spread of log gains common to the channels.
const SPREAD: f64 = 0.15;
/// Expected spread of what a log gain differs from channel to channel.
const TINT_SPREAD: f64 = 0.03;
/// How well an image's gain is known from all its cells together, in logarithms.
const PRECISION: f64 = 0.01;
/// Residuals beyond which a cell is let go, in logarithms, from the first round to the last.
const OUTLIER_SCALES: [f64; 5] = [0.3, 0.2, 0.1, 0.05, 0.05];
/// Steps of conjugate gradients in each round, at most.
const STEPS_MAX: usize = 100;
/// Relative residual at which conjugate gradients stop.
const CONVERGED: f64 = 1e-6;

/// What one image says about one cell.
#[derive(Debug, Clone, Copy)]
struct Observation {
    cell: [i32; 2],
    image: u32,
    /// Logarithm of the mean of the channels, and red and blue against it.
    value: [f32; 3],
    weight: f32,
}

/// Factors for red, green and blue that make the images agree; 1 for an image that shares no floor.
///
/// The gains' logarithms are drawn to zero by their expected spread, so the colours as a
/// whole stay what they are.
pub(super) fn balancing_factors(placed: &[PlacedPatch<'_>]) -> Vec<[f32; 3]> {
    let mut observations: Vec<Observation> = placed
        .par_iter()
        .enumerate()
        .map(|(image, patch)| observe(image as u32, patch))
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();
    observations.sort_unstable_by_key(|observation| (observation.cell, observation.image));
    let gains = fit_gains(&observations, placed.len());
    gains
        .into_iter()
        .map(|[common, red, blue]| [common + red, common - red - blue, common + blue].map(|gain| (-gain).exp() as f32))
        .collect()
}

/// Mean colours of the cells that a patch shows.
fn observe(image: u32, patch: &PlacedPatch<'_>) -> Vec<Observation> {
    let cell = |value_m: f64| (value_m / CELL_M).floor() as i32;
    let least = patch.bounds_m[0].map(cell);
    let [width, height] = [0, 1].map(|axis| (cell(patch.bounds_m[1][axis]) - least[axis] + 1).max(0) as usize);
    let mut sums = vec![[0.0_f32; 5]; width * height];
    patch.for_each_pixel(|[x_m, y_m], rgb, depth_m| {
        // Far pixels mix the colours of neighbouring cells: their area on the floor grows with the cube of the depth.
        let weight = 1.0 / (1.0 + depth_m * depth_m * depth_m);
        let (column, row) = (cell(x_m) - least[0], cell(y_m) - least[1]);
        if (0..width as i32).contains(&column) && (0..height as i32).contains(&row) {
            let sum = &mut sums[row as usize * width + column as usize];
            for (sum, value) in sum.iter_mut().zip([rgb[0], rgb[1], rgb[2], 1.0, weight]) {
                *sum += value;
            }
        }
    });
    let mut observations = Vec::new();
    for (index, [r, g, b, count, weight]) in sums.into_iter().enumerate() {
        let rgb = [r / count, g / count, b / count];
        if count > 0.0 && rgb.iter().all(|value| USABLE.contains(value)) {
            let [r, g, b] = rgb.map(f32::ln);
            let mean = (r + g + b) / 3.0;
            observations.push(Observation {
                cell: [least[0] + (index % width) as i32, least[1] + (index / width) as i32],
                image,
                value: [mean, r - mean, b - mean],
                weight: weight / count,
            });
        }
    }
    observations
}

/// Log gains of the images: common to the channels, and red and blue against it.
fn fit_gains(observations: &[Observation], images: usize) -> Vec<[f64; 3]> {
    let mut gains = vec![[0.0; 3]; images];
    let total: f64 = observations.iter().map(|observation| f64::from(observation.weight)).sum();
    let scale = images as f64 / (total * PRECISION * PRECISION);
    for outlier_scale in OUTLIER_SCALES {
        let weights = robust_weights(observations, &gains, outlier_scale, scale);
        for (axis, spread) in [SPREAD, TINT_SPREAD, TINT_SPREAD].into_iter().enumerate() {
            let system = GainSystem { observations, weights: &weights, prior: 1.0 / (spread * spread) };
            let values: Vec<f64> = observations.iter().map(|observation| f64::from(observation.value[axis])).collect();
            let start: Vec<f64> = gains.iter().map(|gain| gain[axis]).collect();
            for (gain, solved) in gains.iter_mut().zip(system.solve(&values, start)) {
                gain[axis] = solved;
            }
        }
    }
    gains
}

/// Weights that fall where an image differs from the others' mean in a cell.
fn robust_weights(observations: &[Observation], gains: &[[f64; 3]], outlier_scale: f64, scale: f64) -> Vec<f64> {
    let corrected = |o: &Observation| [0, 1, 2].map(|axis| f64::from(o.value[axis]) - gains[o.image as usize][axis]);
    let mut weights = Vec::with_capacity(observations.len());
    for cell in observations.chunk_by(|a, b| a.cell == b.cell) {
        let middle = [0, 1, 2].map(|axis| {
            let mut values: Vec<f64> = cell.iter().map(|o| corrected(o)[axis]).collect();
            values.sort_by(f64::total_cmp);
            (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0
        });
        for observation in cell {
            let value = corrected(observation);
            let square: f64 = (0..3).map(|axis| (value[axis] - middle[axis]).powi(2)).sum();
            let kept = 1.0 / (1.0 + square / (outlier_scale * outlier_scale)).powi(2);
            weights.push(f64::from(observation.weight) * scale * kept);
        }
    }
    weights
}

/// Least squares for one axis of the gains, the cells' colours eliminated.
struct GainSystem<'a> {
    observations: &'a [Observation],
    weights: &'a [f64],
    prior: f64,
}

impl GainSystem<'_> {
    /// For each image the sum of `weight · (value − weighted mean of its cell)`.
    fn residuals(&self, value: impl Fn(usize) -> f64, images: usize) -> Vec<f64> {
        let mut sums = vec![0.0; images];
        let mut start = 0;
        for cell in self.observations.chunk_by(|a, b| a.cell == b.cell) {
            let range = start..start + cell.len();
            start = range.end;
            let weight: f64 = self.weights[range.clone()].iter().sum();
            let mean = range.clone().map(|i| self.weights[i] * value(i)).sum::<f64>() / weight;
            for i in range {
                sums[self.observations[i].image as usize] += self.weights[i] * (value(i) - mean);
            }
        }
        sums
    }

    /// The matrix of the normal equations times a vector of gains.
    fn times(&self, gains: &[f64]) -> Vec<f64> {
        let mut product = self.residuals(|i| gains[self.observations[i].image as usize], gains.len());
        for (product, gain) in product.iter_mut().zip(gains) {
            *product += self.prior * gain;
        }
        product
    }

    /// Conjugate gradients from `gains`.
    fn solve(&self, values: &[f64], mut gains: Vec<f64>) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let target = self.residuals(|i| values[i], gains.len());
        let mut residual: Vec<f64> = target.iter().zip(self.times(&gains)).map(|(a, b)| a - b).collect();
        let mut direction = residual.clone();
        let mut square = dot(&residual, &residual);
        let enough = CONVERGED * CONVERGED * dot(&target, &target);
        for _ in 0..STEPS_MAX {
            if square <= enough {
                break;
            }
            let image = self.times(&direction);
            let step = square / dot(&direction, &image);
            for i in 0..gains.len() {
                gains[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            let next = dot(&residual, &residual);
            let turn = next / square;
            square = next;
            for (direction, residual) in direction.iter_mut().zip(&residual) {
                *direction = residual + turn * *direction;
            }
        }
        gains
    }
}
