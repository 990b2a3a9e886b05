//! Gauss–Newton on the distance of a scan's points to the lines of a surface map.
//!
//! The residual is that of point-to-line ICP (Censi 2008), found by one look-up per point
//! instead of a search; robust weights are Cauchy's. The odometry enters as a prior, so that
//! directions in which the scan says nothing (corridors) are left to it.

use super::MatcherConfig;
use crate::geometry::{Pose2, wrap_angle};
use crate::map::Cell;
use crate::surface::{SurfaceFinder, SurfaceMap, SurfaceScan};
use nalgebra::{Matrix2, Matrix3, Vector3};

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
        last = linearise(map, scan, &pose, gate, config).without_hearsay(config);
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

/// Share of a scan's points that lie on surfaces of a map at a pose.
#[must_use]
pub fn inlier_share(map: &SurfaceMap, scan: &SurfaceScan, pose: &Pose2, config: &MatcherConfig) -> f64 {
    linearise(map, scan, pose, config.gate_sigmas, config).inliers / scan.len().max(1) as f64
}

/// The points of a scan that lie on no surface of a map at a pose.
#[must_use]
pub fn outliers(map: &SurfaceMap, scan: &SurfaceScan, pose: &Pose2, config: &MatcherConfig) -> SurfaceScan {
    let weights = Weights::new(config.gate_sigmas, config);
    let mut finder = map.finder();
    let of_block = |block: Block| {
        let mut sums = Sums::default();
        sums.add(&mut finder, map.inverse_resolution() as f32, &block, pose, &weights);
        sums.inliers.into_iter().take(block.count).map(|inliers| inliers == 0.0)
    };
    scan.selected(blocks(scan).flat_map(of_block))
}

/// The normal equations at a pose.
#[derive(Debug, Clone, Copy, Default)]
struct Linearisation {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    inliers: f64,
    log_likelihood: f64,
}

impl Linearisation {
    /// Takes back what errors alone make the scan say.
    fn without_hearsay(mut self, config: &MatcherConfig) -> Self {
        let scale = without_hearsay(&self.information, config);
        self.information = scale * self.information * scale;
        self.gradient = scale * scale * self.gradient;
        self
    }
}

/// The matrix S for which S·I·S is the information I of a scan without what errors alone make it say of a
/// direction of which it hardly says anything.
///
/// Along a bare corridor that comes from normals that err and from points without one, which lie where the same ray
/// ended before. It would hold the robot back, where the odometry knows better (degenerate directions,
/// Zhang, Kaess & Singh 2016; here without a threshold).
#[must_use]
pub fn without_hearsay(information: &Matrix3<f64>, config: &MatcherConfig) -> Matrix3<f64> {
    let hearsay = HEARSAY_SHARE * config.independent_points / (config.sigma_m * config.sigma_m);
    let position = information.fixed_view::<2, 2>(0, 0).into_owned();
    let half_trace = 0.5 * position.trace();
    let root = (half_trace * half_trace - position.determinant()).max(0.0).sqrt();
    let [small, large] = [half_trace - root, half_trace + root].map(|value| value.max(0.0));
    let mut whole = Matrix3::identity();
    if large > 0.0 {
        // Weights of the two directions; the matrix Σ √w v vᵀ follows from the position's block itself.
        let [weak, strong] = [small, large].map(|value| (value / (value + hearsay)).sqrt());
        let slope = if large - small > 1e-9 * large { (strong - weak) / (large - small) } else { 0.0 };
        let scale = Matrix2::identity() * (weak - slope * small) + position * slope;
        whole.fixed_view_mut::<2, 2>(0, 0).copy_from(&scale);
    }
    whole
}

/// What errors alone make a scan say of a direction, as a share of what it can say at most.
const HEARSAY_SHARE: f64 = 0.1;

/// Points that are worked on side by side. Single precision is enough for sums of this kind: it errs by
/// micrometres where points scatter by centimetres.
const LANES: usize = 8;
/// One number for each of them.
type Lanes = [f32; LANES];

/// Points of a scan with their normals, in the body's frame.
struct Block {
    x_m: Lanes,
    y_m: Lanes,
    normal_x: Lanes,
    normal_y: Lanes,
    /// How many of the lanes are in use.
    count: usize,
}

/// What the points add up to, each lane by itself.
#[derive(Default)]
struct Sums {
    xx: Lanes,
    xy: Lanes,
    xt: Lanes,
    yy: Lanes,
    yt: Lanes,
    tt: Lanes,
    gx: Lanes,
    gy: Lanes,
    gt: Lanes,
    inliers: Lanes,
    /// Beyond that of as many points on nothing known.
    log_likelihood: Lanes,
}

fn linearise(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    pose: &Pose2,
    gate_sigmas: f64,
    config: &MatcherConfig,
) -> Linearisation {
    let weights = Weights::new(gate_sigmas, config);
    let mut sums = Sums::default();
    let (mut finder, inverse_resolution) = (map.finder(), map.inverse_resolution() as f32);
    for block in blocks(scan) {
        sums.add(&mut finder, inverse_resolution, &block, pose, &weights);
    }
    let total = |lanes: Lanes| lanes.iter().map(|&lane| f64::from(lane)).sum::<f64>();
    let [xx, xy, xt, yy, yt, tt] = [sums.xx, sums.xy, sums.xt, sums.yy, sums.yt, sums.tt].map(total);
    // Neighbouring points err together: beyond a number of points more do not say more.
    let temper = (config.independent_points / (scan.len().max(1) as f64)).min(1.0);
    Linearisation {
        information: Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt) * temper,
        gradient: Vector3::from([sums.gx, sums.gy, sums.gt].map(total)) * temper,
        inliers: total(sums.inliers),
        log_likelihood: total(sums.log_likelihood) + OUTLIER_LOG_LIKELIHOOD * scan.len() as f64,
    }
}

/// A scan's points, block by block.
fn blocks(scan: &SurfaceScan) -> impl Iterator<Item = Block> {
    let columns = [&scan.x_m, &scan.y_m, &scan.normal_x, &scan.normal_y].map(|column| column.as_chunks::<LANES>());
    let [(x, last_x), (y, last_y), (nx, last_nx), (ny, last_ny)] = columns;
    let whole = x.iter().zip(y).zip(nx).zip(ny);
    let whole =
        whole.map(|(((&x_m, &y_m), &normal_x), &normal_y)| Block { x_m, y_m, normal_x, normal_y, count: LANES });
    let padded = |rest: &[f32]| -> Lanes { std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(0.0)) };
    let last = (!last_x.is_empty()).then(|| Block {
        x_m: padded(last_x),
        y_m: padded(last_y),
        normal_x: padded(last_nx),
        normal_y: padded(last_ny),
        count: last_x.len(),
    });
    whole.chain(last)
}

/// How much distances from a surface count.
struct Weights {
    /// Inverse variances, 1/m², across a flat surface and to one without direction.
    flat: f32,
    rough: f32,
    /// 1/g², where g is the scale of the robust weights in standard deviations.
    inverse_gate: f32,
}

impl Weights {
    fn new(gate_sigmas: f64, config: &MatcherConfig) -> Self {
        Self {
            flat: config.sigma_m.powi(-2) as f32,
            rough: config.rough_sigma_m.powi(-2) as f32,
            inverse_gate: gate_sigmas.powi(-2) as f32,
        }
    }
}

impl Sums {
    /// Adds what a block of points says at a pose.
    #[inline(always)] // What depends on the pose alone is then computed once for all blocks.
    fn add(
        &mut self,
        finder: &mut SurfaceFinder<'_>,
        inverse_resolution: f32,
        block: &Block,
        pose: &Pose2,
        weights: &Weights,
    ) {
        let (sin, cos) = pose.theta.sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        let (pose_x, pose_y) = (pose.x as f32, pose.y as f32);
        let zero: Lanes = [0.0; LANES];
        let (mut rx, mut ry, mut cell_x, mut cell_y) = (zero, zero, [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            rx[lane] = cos * block.x_m[lane] - sin * block.y_m[lane];
            ry[lane] = sin * block.x_m[lane] + cos * block.y_m[lane];
            cell_x[lane] = floor((pose_x + rx[lane]) * inverse_resolution);
            cell_y[lane] = floor((pose_y + ry[lane]) * inverse_resolution);
        }
        let Found { mean_x, mean_y, normal_x: nx, normal_y: ny, flatness, is_there: found } =
            Found::near(finder, &cell_x, &cell_y, block.count);
        for lane in 0..LANES {
            let (rx, ry, nx, ny, flatness) = (rx[lane], ry[lane], nx[lane], ny[lane], flatness[lane]);
            let (scan_nx, scan_ny) = (block.normal_x[lane], block.normal_y[lane]);
            // Both sides of a thin wall are surfaces; a point belongs to the one that faces the robot.
            let facing = (cos * scan_nx - sin * scan_ny) * nx + (sin * scan_nx + cos * scan_ny) * ny;
            let used = if found[lane] && facing * flatness >= -0.2 { 1.0 } else { 0.0 };
            let (dx, dy) = (pose_x + rx - mean_x[lane], pose_y + ry - mean_y[lane]);
            let (across, along) = (nx * dx + ny * dy, nx * dy - ny * dx);
            let weight_along = (1.0 - flatness) * weights.rough;
            let weight_across = flatness * weights.flat + weight_along;
            let square = weight_across * across * across + weight_along * along * along;
            let robust = used / (1.0 + square * weights.inverse_gate);
            // W = R diag(across, along) Rᵀ in world axes.
            let wxx = robust * (weight_across * nx * nx + weight_along * ny * ny);
            let wxy = robust * (weight_across - weight_along) * nx * ny;
            let wyy = robust * (weight_across * ny * ny + weight_along * nx * nx);
            let (ex, ey) = (wxx * dx + wxy * dy, wxy * dx + wyy * dy);
            let (jx, jy) = (-ry, rx);
            let (vx, vy) = (wxx * jx + wxy * jy, wxy * jx + wyy * jy);
            self.xx[lane] += wxx;
            self.xy[lane] += wxy;
            self.yy[lane] += wyy;
            self.xt[lane] += vx;
            self.yt[lane] += vy;
            self.tt[lane] += vx * jx + vy * jy;
            self.gx[lane] += ex;
            self.gy[lane] += ey;
            self.gt[lane] += jx * ex + jy * ey;
            self.inliers[lane] += if square < 9.0 { used } else { 0.0 };
            let beyond = -0.5 * square - OUTLIER;
            self.log_likelihood[lane] += if beyond > 0.0 { used * beyond } else { 0.0 };
        }
    }
}

/// The surfaces nearest to a block's points.
#[derive(Default)]
struct Found {
    mean_x: Lanes,
    mean_y: Lanes,
    normal_x: Lanes,
    normal_y: Lanes,
    flatness: Lanes,
    is_there: [bool; LANES],
}

impl Found {
    #[inline(never)] // The registers are all needed here.
    fn near(finder: &mut SurfaceFinder<'_>, cell_x: &[i32; LANES], cell_y: &[i32; LANES], count: usize) -> Self {
        let mut found = Self::default();
        for lane in 0..count.min(LANES) {
            if let Some(surface) = finder.nearest_to_cell(Cell { x: cell_x[lane], y: cell_y[lane] }) {
                [found.mean_x[lane], found.mean_y[lane]] = surface.mean_m;
                [found.normal_x[lane], found.normal_y[lane]] = surface.normal;
                found.flatness[lane] = surface.flatness;
                found.is_there[lane] = true;
            }
        }
        found
    }
}

/// The largest whole number that is not above `value`, for values up to four million: adding 1.5 · 2²³ leaves
/// no room for fractions in a float's mantissa. Unlike a conversion that takes care of all values, this
/// vectorises. At a whole number it may be one less, which is a neighbouring cell's border; values beyond
/// give some number.
#[inline]
fn floor(value: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    (value - 0.5 + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits()) as i32
}

/// Steps smaller than these, metres and radians, are taken for the last ones of the approach.
const NEAR_STEP_M: f64 = 0.01;
const NEAR_STEP_RAD: f64 = 0.005;
const OUTLIER: f32 = OUTLIER_LOG_LIKELIHOOD as f32;
/// What a point that lies on nothing known adds to the log-likelihood.
pub const OUTLIER_LOG_LIKELIHOOD: f64 = -4.5;
