//! Mount, scales and lag at which odometry and scans show the same motion.

use super::readings::Step;
use super::scan_path::{ScanPath, Stretch};
use crate::odometry::{OdometrySource, median};
use crate::sensors::RobotConfig;
use nalgebra::{SMatrix, SVector};

/// What is sought: the factors of a step's two parts, the width that turns are divided by, x, y and yaw of the mount,
/// and by how much the stamps are late.
pub(super) const PARAMETERS: usize = 7;
pub(super) const FIRST: usize = 0;
pub(super) const SECOND: usize = 1;
pub(super) const WIDTH: usize = 2;
pub(super) const X: usize = 3;
pub(super) const Y: usize = 4;
pub(super) const YAW: usize = 5;
pub(super) const LAG: usize = 6;

pub(super) type Parameters = SVector<f64, PARAMETERS>;

/// Lags that are looked at, and in which steps, seconds.
const LONGEST_LAG_S: f64 = 0.6;
const LAG_STEP_S: f64 = 0.01;
/// The readings must cover this share of a stretch.
const LEAST_COVER: f64 = 0.95;
/// Steps of Gauss and Newton.
const ITERATIONS: usize = 20;
/// They end when no parameter moves by more than this share of its uncertainty.
const CONVERGED: f64 = 1e-3;
/// What is this many standard deviations off counts half (Cauchy).
const OUTLIER: f64 = 3.0;
/// So many parts of the drive are left out in turn.
const PARTS: usize = 10;
/// Standard deviation of the normal distribution by its median absolute deviation.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Residuals are never taken to be smaller than this, metres or radians.
const LEAST_SIGMA: f64 = 1e-5;

/// What is known beforehand.
#[derive(Debug, Clone)]
pub(super) struct Known {
    /// The parameters as they are configured.
    start: Parameters,
    /// Standard deviations of what is known of them: so wide that a drive which shows something overrules them; 0 for
    /// what is not sought.
    prior: Parameters,
    /// Steps for derivatives.
    step: Parameters,
    /// Whether the steps say how far the body moved.
    moves: bool,
}

impl Known {
    /// Of wheels or stated poses.
    pub(super) fn of(robot: &RobotConfig, source: OdometrySource) -> Self {
        let mount = &robot.lidar.mount;
        let wheels = robot.wheels.as_ref().filter(|_| source != OdometrySource::Log);
        let (first, second, width, lag_s) = match wheels {
            Some(wheels) => {
                (wheels.left_m_per_tick, wheels.right_m_per_tick, wheels.track_width_m, robot.lag.encoders_s)
            }
            None => (robot.scale.odometry_distance, robot.scale.odometry_turn, 1.0, robot.lag.odometry_s),
        };
        let width_prior = if wheels.is_some() { width } else { 0.0 };
        Self {
            start: Parameters::from([first, second, width, mount.x_m, mount.y_m, mount.yaw_rad, lag_s]),
            prior: Parameters::from([first.abs(), second.abs(), width_prior, 1.0, 1.0, 1.0, 0.3]),
            step: Parameters::from([1e-4 * first.abs(), 1e-4 * second.abs(), 1e-4 * width, 1e-4, 1e-4, 1e-4, 1e-3]),
            moves: true,
        }
    }

    /// Of a gyro: what is left of its bias (rad/s), its scale, its lag.
    pub(super) fn of_gyro(robot: &RobotConfig) -> Self {
        Self {
            start: Parameters::from([0.0, robot.scale.gyro, 1.0, 0.0, 0.0, 0.0, robot.lag.imu_s]),
            prior: Parameters::from([0.1, 1.0, 0.0, 0.0, 0.0, 0.0, 0.3]),
            step: Parameters::from([1e-4, 1e-4, 1.0, 1.0, 1.0, 1.0, 1e-3]),
            moves: false,
        }
    }
}

/// What was found.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub(super) found: Parameters,
    /// Standard deviations.
    pub(super) sigma: Parameters,
    /// Standard deviations of what is left over a stretch: metres and radians.
    pub(super) residual: [f64; 2],
}

/// The steps of a stretch, summed up: each part's motion in the axes of its beginning, and its turn.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    moved: [[f64; 2]; 2],
    turned: [f64; 2],
    covered_s: f64,
}

/// Scans and readings side by side.
#[derive(Debug)]
pub(super) struct Fit<'a> {
    path: &'a ScanPath,
    stretches: &'a [Stretch],
    steps: &'a [Step],
    known: Known,
}

impl<'a> Fit<'a> {
    pub(super) fn new(path: &'a ScanPath, stretches: &'a [Stretch], steps: &'a [Step], known: Known) -> Self {
        Self { path, stretches, steps, known }
    }

    /// The parameters that fit best, and how far they are to be trusted.
    pub(super) fn solve(&self) -> Solution {
        let mut start = self.known.start;
        start[LAG] = self.likely_lag_s().unwrap_or(start[LAG]);
        if self.known.moves {
            start[YAW] = self.likely_yaw_rad(&start).unwrap_or(start[YAW]);
        }
        let everything: Vec<usize> = (0..self.stretches.len()).collect();
        let (found, information, residual) = self.refine(start, &everything);
        let covariance = information.try_inverse().unwrap_or_else(SMatrix::identity);
        let mut sigma = covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
        // Errors that go together for a while, as of a wheel that slips on one floor, show when that is left out.
        let parts = PARTS.min(self.stretches.len());
        let without: Vec<Parameters> = (0..parts)
            .map(|part| {
                let [from, to] = [part, part + 1].map(|part| part * everything.len() / parts);
                let rest: Vec<usize> = everything.iter().copied().filter(|index| !(from..to).contains(index)).collect();
                self.refine(found, &rest).0
            })
            .collect();
        let mean = without.iter().sum::<Parameters>() / parts as f64;
        let spread: Parameters = without.iter().map(|part| (part - mean).component_mul(&(part - mean))).sum();
        let jackknife = (spread * ((parts - 1) as f64 / parts as f64)).map(f64::sqrt);
        sigma = sigma.sup(&jackknife);
        Solution { found, sigma, residual }
    }

    /// The steps of a stretch, its time shifted by a lag.
    fn sum(&self, stretch: &Stretch, lag_s: f64) -> Sum {
        let [from_s, to_s] = [stretch.from_s + lag_s, stretch.to_s + lag_s];
        let first = self.steps.partition_point(|step| step.to_s <= from_s);
        let start_rad = self.path.heading_rad(stretch.from_s);
        let mut sum = Sum::default();
        for step in self.steps[first..].iter().take_while(|step| step.from_s < to_s) {
            let [begin_s, end_s] = [step.from_s.max(from_s), step.to_s.min(to_s)];
            let share = (end_s - begin_s).max(0.0) / (step.to_s - step.from_s);
            let middle_s = 0.5 * (begin_s + end_s) - lag_s;
            let (sin, cos) = (self.path.heading_rad(middle_s) - start_rad).sin_cos();
            for part in 0..2 {
                let [x, y] = step.moved[part];
                sum.moved[part][0] += share * (cos * x - sin * y);
                sum.moved[part][1] += share * (sin * x + cos * y);
                sum.turned[part] += share * step.turned[part];
            }
            sum.covered_s += (end_s - begin_s).max(0.0);
        }
        sum
    }

    fn turn_rad(parameters: &Parameters, sum: &Sum) -> f64 {
        (parameters[FIRST] * sum.turned[0] + parameters[SECOND] * sum.turned[1]) / parameters[WIDTH]
    }

    fn moved_m(parameters: &Parameters, sum: &Sum) -> [f64; 2] {
        [0, 1].map(|axis| parameters[FIRST] * sum.moved[0][axis] + parameters[SECOND] * sum.moved[1][axis])
    }

    /// By how much scans and readings differ over a stretch: metres ahead, metres to the left, radians; `None` where
    /// readings are missing.
    fn residual(&self, stretch: &Stretch, parameters: &Parameters) -> Option<[f64; 3]> {
        let sum = self.sum(stretch, parameters[LAG]);
        if sum.covered_s < LEAST_COVER * (stretch.to_s - stretch.from_s) {
            return None;
        }
        let turn = stretch.turned_rad - Self::turn_rad(parameters, &sum);
        if !self.known.moves {
            return Some([0.0, 0.0, turn]);
        }
        let (sin, cos) = parameters[YAW].sin_cos();
        let [moved_x, moved_y] = Self::moved_m(parameters, &sum);
        let (turned_sin, turned_cos) = stretch.turned_rad.sin_cos();
        let (x, y) = (parameters[X], parameters[Y]);
        let lever = [(turned_cos - 1.0) * x - turned_sin * y, turned_sin * x + (turned_cos - 1.0) * y];
        let seen = [cos * stretch.motion.x - sin * stretch.motion.y, sin * stretch.motion.x + cos * stretch.motion.y];
        Some([seen[0] - moved_x - lever[0], seen[1] - moved_y - lever[1], turn])
    }

    /// The lag at which turns go together best.
    fn likely_lag_s(&self) -> Option<f64> {
        let steps = (LONGEST_LAG_S / LAG_STEP_S) as i32;
        let correlation = |lag_s: f64| -> f64 {
            let (mut both, mut seen, mut stated) = (0.0, 0.0, 0.0);
            for stretch in self.stretches {
                let turn = Self::turn_rad(&self.known.start, &self.sum(stretch, lag_s));
                both += turn * stretch.turned_rad;
                seen += stretch.turned_rad * stretch.turned_rad;
                stated += turn * turn;
            }
            both / (seen * stated).sqrt()
        };
        let lags = (-steps..=steps).map(|step| f64::from(step) * LAG_STEP_S);
        let best = lags.map(|lag_s| (lag_s, correlation(lag_s))).filter(|(_, fit)| fit.is_finite());
        best.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(lag_s, _)| lag_s)
    }

    /// The mount's yaw at which straight on is straight on.
    fn likely_yaw_rad(&self, start: &Parameters) -> Option<f64> {
        let (mut along, mut across) = (0.0, 0.0);
        for stretch in self.stretches {
            let [x, y] = Self::moved_m(start, &self.sum(stretch, start[LAG]));
            // A bend tells the lever's motion, too.
            let weight = (-(stretch.turned_rad / 0.3).powi(2)).exp();
            along += weight * (stretch.motion.x * x + stretch.motion.y * y);
            across += weight * (stretch.motion.x * y - stretch.motion.y * x);
        }
        (along.hypot(across) > 1.0).then(|| across.atan2(along))
    }

    /// Gauss–Newton over some stretches, with the noise seen in the residuals and what lies far off weighed less.
    fn refine(
        &self,
        mut parameters: Parameters,
        chosen: &[usize],
    ) -> (Parameters, SMatrix<f64, PARAMETERS, PARAMETERS>, [f64; 2]) {
        let known = &self.known;
        let mut information = SMatrix::identity();
        let mut sigmas = [1.0; 3];
        for _ in 0..ITERATIONS {
            let seen: Vec<(&Stretch, [f64; 3])> = chosen
                .iter()
                .filter_map(|&index| {
                    let stretch = &self.stretches[index];
                    Some((stretch, self.residual(stretch, &parameters)?))
                })
                .collect();
            sigmas = [0, 1, 2].map(|axis| {
                let mut sizes: Vec<f64> = seen.iter().map(|(_, residual)| residual[axis].abs()).collect();
                (SIGMA_PER_MAD * median(&mut sizes).unwrap_or(0.0)).max(LEAST_SIGMA)
            });
            information = SMatrix::zeros();
            let mut gradient = Parameters::zeros();
            for (stretch, residual) in &seen {
                let mut jacobian = SMatrix::<f64, 3, PARAMETERS>::zeros();
                for column in (0..PARAMETERS).filter(|&column| known.prior[column] > 0.0) {
                    let mut beside = parameters;
                    beside[column] += known.step[column];
                    let Some(moved) = self.residual(stretch, &beside) else { continue };
                    for row in 0..3 {
                        jacobian[(row, column)] = (moved[row] - residual[row]) / known.step[column];
                    }
                }
                for row in 0..3 {
                    let off = residual[row] / (OUTLIER * sigmas[row]);
                    let weight = 1.0 / ((1.0 + off * off) * sigmas[row] * sigmas[row]);
                    let line = jacobian.row(row).transpose();
                    information += line * line.transpose() * weight;
                    gradient += line * (weight * residual[row]);
                }
            }
            for index in 0..PARAMETERS {
                if known.prior[index] > 0.0 {
                    let weight = known.prior[index].powi(-2);
                    information[(index, index)] += weight;
                    gradient[index] += weight * (parameters[index] - known.start[index]);
                } else {
                    information[(index, index)] = 1.0;
                    gradient[index] = 0.0;
                }
            }
            let Some(inverse) = information.try_inverse() else { break };
            let step = inverse * gradient;
            if step.iter().any(|value| !value.is_finite()) {
                break;
            }
            parameters -= step;
            let moves = (0..PARAMETERS).any(|index| step[index].abs() > CONVERGED * inverse[(index, index)].sqrt());
            if !moves {
                break;
            }
        }
        (parameters, information, [sigmas[0].hypot(sigmas[1]), sigmas[2]])
    }
}
