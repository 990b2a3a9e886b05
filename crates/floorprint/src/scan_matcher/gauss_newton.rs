//! Gauss–Newton on the distance of a scan's points to the lines of a surface map.
//!
//! The residual is that of point-to-line ICP (Censi 2008), found by one look-up per point
//! instead of a search; robust weights are Cauchy's. The odometry enters as a prior, so that
//! directions in which the scan says nothing (corridors) are left to it.

use super::{MatcherConfig, SurfaceScan};
use crate::geometry::{Pose2, wrap_angle};
use crate::map::SurfaceMap;
use nalgebra::{Matrix3, Vector3};

/// A Gaussian belief about a pose: the mean, and the information matrix over (x, y, θ) in the
/// world's axes (1/m², 1/m·rad, 1/rad²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseBelief {
    /// Mean.
    pub pose: Pose2,
    /// Inverse covariance.
    pub information: Matrix3<f64>,
}

impl PoseBelief {
    /// A pose's offset from the mean over (x, y, θ).
    fn offset(&self, pose: &Pose2) -> Vector3<f64> {
        Vector3::new(pose.x - self.pose.x, pose.y - self.pose.y, wrap_angle(pose.theta - self.pose.theta))
    }

    /// A pose's distance from the mean in standard deviations (Mahalanobis).
    #[must_use]
    pub fn sigmas_to(&self, pose: &Pose2) -> f64 {
        let offset = self.offset(pose);
        (offset.transpose() * self.information * offset).x.max(0.0).sqrt()
    }
}

/// Where a scan fits a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchResult {
    /// The optimum and the information of scan and prior together.
    pub belief: PoseBelief,
    /// The information that the scan alone gives.
    pub scan_information: Matrix3<f64>,
    /// Share of the points that lie on surfaces of the map.
    pub inlier_share: f64,
    /// Mean log-likelihood per point at the optimum.
    pub score: f64,
}

/// Fits `scan` to `map`, starting at the mean of `prior`.
#[must_use]
pub fn match_scan(map: &SurfaceMap, scan: &SurfaceScan, prior: &PoseBelief, config: &MatcherConfig) -> MatchResult {
    match_scan_against(map, scan, prior, f64::INFINITY, config)
}

/// Fits `scan` to `map`, starting at the mean of a `prior` that may itself be wrong: from about
/// `trusted_sigmas` away from it on the scan prevails (Cauchy's weights).
#[must_use]
pub fn match_scan_against(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    prior: &PoseBelief,
    trusted_sigmas: f64,
    config: &MatcherConfig,
) -> MatchResult {
    let mut pose = prior.pose;
    let mut last = Linearisation::default();
    let mut gate = config.wide_gate_sigmas;
    for _ in 0..config.iterations {
        last = linearise(map, scan, &pose, gate, config);
        let prior_information = prior.information / (1.0 + (prior.sigmas_to(&pose) / trusted_sigmas).powi(2));
        let information = last.information + prior_information;
        let gradient = last.gradient + prior_information * prior.offset(&pose);
        let Some(step) = information.cholesky().map(|factor| -factor.solve(&gradient)) else { break };
        pose = Pose2::new(pose.x + step.x, pose.y + step.y, pose.theta + step.z);
        let (step_m, step_rad) = (step.x.hypot(step.y), step.z.abs());
        if step_m < config.stop_step_m && step_rad < config.stop_step_rad && gate == config.gate_sigmas {
            break;
        }
        // Once the scan lies about right, points that do not fit are no longer worth following.
        if step_m < NEAR_STEP_M && step_rad < NEAR_STEP_RAD {
            gate = config.gate_sigmas;
        }
    }
    MatchResult {
        belief: PoseBelief { pose, information: last.information + prior.information },
        scan_information: last.information,
        inlier_share: last.inliers / (scan.len().max(1) as f64),
        score: last.log_likelihood / (scan.len().max(1) as f64),
    }
}

/// The normal equations at a pose.
#[derive(Debug, Clone, Copy, Default)]
struct Linearisation {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    inliers: f64,
    log_likelihood: f64,
}

fn linearise(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    pose: &Pose2,
    gate_sigmas: f64,
    config: &MatcherConfig,
) -> Linearisation {
    let (sin, cos) = pose.theta.sin_cos();
    let flat_weight = 1.0 / (config.sigma_m * config.sigma_m);
    let rough_weight = 1.0 / (config.rough_sigma_m * config.rough_sigma_m);
    let inverse_gate = 1.0 / (gate_sigmas * gate_sigmas);
    let (mut xx, mut xy, mut xt, mut yy, mut yt, mut tt) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let (mut gx, mut gy, mut gt) = (0.0, 0.0, 0.0);
    let (mut inliers, mut log_likelihood) = (0.0, 0.0);
    for (point, normal) in scan.iter() {
        let (px, py) = (f64::from(point[0]), f64::from(point[1]));
        let (rx, ry) = (cos * px - sin * py, sin * px + cos * py);
        let (wx, wy) = (pose.x + rx, pose.y + ry);
        let Some(surface) = map.nearest([wx, wy]) else {
            log_likelihood += OUTLIER_LOG_LIKELIHOOD;
            continue;
        };
        let [nx, ny] = surface.normal.map(f64::from);
        let flatness = f64::from(surface.flatness);
        let (scan_nx, scan_ny) = (f64::from(normal[0]), f64::from(normal[1]));
        // Both sides of a thin wall are surfaces; a point belongs to the one that faces the robot.
        let facing = (cos * scan_nx - sin * scan_ny) * nx + (sin * scan_nx + cos * scan_ny) * ny;
        if facing * flatness < -0.2 {
            log_likelihood += OUTLIER_LOG_LIKELIHOOD;
            continue;
        }
        let (dx, dy) = (wx - f64::from(surface.mean_m[0]), wy - f64::from(surface.mean_m[1]));
        let across = nx * dx + ny * dy;
        let along = -ny * dx + nx * dy;
        let weight_along = (1.0 - flatness) * rough_weight;
        let weight_across = flatness * flat_weight + weight_along;
        let square = weight_across * across * across + weight_along * along * along;
        let robust = 1.0 / (1.0 + square * inverse_gate);
        // W = R diag(across, along) Rᵀ in world axes.
        let wxx = robust * (weight_across * nx * nx + weight_along * ny * ny);
        let wxy = robust * (weight_across - weight_along) * nx * ny;
        let wyy = robust * (weight_across * ny * ny + weight_along * nx * nx);
        let (ex, ey) = (wxx * dx + wxy * dy, wxy * dx + wyy * dy);
        let (jx, jy) = (-ry, rx);
        let (vx, vy) = (wxx * jx + wxy * jy, wxy * jx + wyy * jy);
        xx += wxx;
        xy += wxy;
        yy += wyy;
        xt += vx;
        yt += vy;
        tt += vx * jx + vy * jy;
        gx += ex;
        gy += ey;
        gt += jx * ex + jy * ey;
        if square < 9.0 {
            inliers += 1.0;
        }
        log_likelihood += (-0.5 * square).max(OUTLIER_LOG_LIKELIHOOD);
    }
    // Neighbouring points err together: beyond a number of points more do not say more.
    let temper = (config.independent_points / (scan.len().max(1) as f64)).min(1.0);
    Linearisation {
        information: Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt) * temper,
        gradient: Vector3::new(gx, gy, gt) * temper,
        inliers,
        log_likelihood,
    }
}

/// Steps smaller than these, metres and radians, are taken for the last ones of the approach.
const NEAR_STEP_M: f64 = 0.01;
const NEAR_STEP_RAD: f64 = 0.005;
/// What a point that lies on nothing known adds to the log-likelihood.
const OUTLIER_LOG_LIKELIHOOD: f64 = -4.5;
