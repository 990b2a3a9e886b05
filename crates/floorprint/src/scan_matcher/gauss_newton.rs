//! Gauss–Newton on the distance of a scan's points to the lines of a surface map.
//!
//! The residual is that of point-to-line ICP (Censi 2008), found by one look-up per point
//! instead of a search; robust weights are Cauchy's. The odometry enters as a prior, so that
//! directions in which the scan says nothing (corridors) are left to it.

use super::MatcherConfig;
use crate::geometry::{Pose2, wrap_angle};
use crate::map::Cell;
use crate::surface::{SurfaceFinder, SurfaceMap, SurfaceScan};
use multiversion::multiversion;
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
    pub(crate) fn offset(&self, pose: &Pose2) -> Vector3<f64> {
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
    match_as(map, scan, prior, trusted_sigmas, config, &|last| last.without_hearsay(config))
}

/// Fits a `scan` of few points to `map`, starting at the mean of `prior`. The points count only as much as they fit: the few
/// that lie on something by chance do not say that the rest does not.
#[must_use]
pub(super) fn match_few(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    prior: &PoseBelief,
    config: &MatcherConfig,
) -> MatchResult {
    match_as(map, scan, prior, f64::INFINITY, config, &|last| {
        last.as_far_as_it_fits(scan.len()).without_hearsay(config)
    })
}

fn match_as(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    prior: &PoseBelief,
    trusted_sigmas: f64,
    config: &MatcherConfig,
    tempered: &dyn Fn(Linearisation) -> Linearisation,
) -> MatchResult {
    let mut pose = prior.pose;
    let mut last = Linearisation::default();
    let mut gate = config.wide_gate_sigmas;
    let mut nearest = Nearest::on(map, scan);
    for _ in 0..config.iterations {
        last = tempered(linearise(&mut nearest, scan, &pose, gate, config));
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
    linearise(&mut Nearest::on(map, scan), scan, pose, config.gate_sigmas, config).inliers / scan.len().max(1) as f64
}

/// The points of a scan that lie on no surface of a map at a pose.
#[must_use]
pub fn outliers(map: &SurfaceMap, scan: &SurfaceScan, pose: &Pose2, config: &MatcherConfig) -> SurfaceScan {
    let weights = Weights::new(config.gate_sigmas, config);
    let Nearest { mut finder, inverse_resolution, mut found } = Nearest::on(map, scan);
    let of_block = |(block, found): (Block, &mut Found)| {
        let mut sums = Sums::default();
        found.update(&mut finder, inverse_resolution, &block, pose);
        sums.add(found, &block, pose, &weights);
        sums.inliers.into_iter().take(block.count).map(|inliers| inliers == 0.0)
    };
    scan.selected(blocks(scan).zip(&mut found).flat_map(of_block))
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
    /// Divides by the variance factor that the residuals show, where that is larger than was taken for granted (a posteriori
    /// variance of the unit weight; Koch 1999, Parameter Estimation and Hypothesis Testing in Linear Models, § 3.2.3).
    fn as_far_as_it_fits(mut self, points: usize) -> Self {
        let unknowns = 3.0;
        let variance_factor = -2.0 * self.log_likelihood / (points as f64 - unknowns).max(f64::MIN_POSITIVE);
        let share = variance_factor.max(1.0).recip();
        self.information *= share;
        self.gradient *= share;
        self
    }

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

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn linearise(
    nearest: &mut Nearest<'_>,
    scan: &SurfaceScan,
    pose: &Pose2,
    gate_sigmas: f64,
    config: &MatcherConfig,
) -> Linearisation {
    let weights = Weights::new(gate_sigmas, config);
    let mut sums = Sums::default();
    let Nearest { finder, inverse_resolution, found } = nearest;
    for (block, found) in blocks(scan).zip(found) {
        found.update(finder, *inverse_resolution, &block, pose);
        sums.add(found, &block, pose, &weights);
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
    /// Adds what a block of points says at a pose, given the surfaces nearest to them.
    #[inline(always)] // What depends on the pose alone is then computed once for all blocks.
    fn add(&mut self, found: &Found, block: &Block, pose: &Pose2, weights: &Weights) {
        let (sin, cos) = pose.theta.sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        let (pose_x, pose_y) = (pose.x as f32, pose.y as f32);
        let Found { mean_x, mean_y, normal_x: nx, normal_y: ny, flatness, is_there, .. } = found;
        for lane in 0..LANES {
            let (nx, ny, flatness) = (nx[lane], ny[lane], flatness[lane]);
            let rx = cos * block.x_m[lane] - sin * block.y_m[lane];
            let ry = sin * block.x_m[lane] + cos * block.y_m[lane];
            let (scan_nx, scan_ny) = (block.normal_x[lane], block.normal_y[lane]);
            // Both sides of a thin wall are surfaces; a point belongs to the one that faces the robot.
            let facing = (cos * scan_nx - sin * scan_ny) * nx + (sin * scan_nx + cos * scan_ny) * ny;
            let used = if is_there[lane] != 0.0 && facing * flatness >= -0.2 { 1.0 } else { 0.0 };
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

/// The surfaces nearest to the points of a scan. From one pose to the next most points stay in their cell, so that
/// what was found is kept: only those that have moved on to another are looked up again.
struct Nearest<'a> {
    finder: SurfaceFinder<'a>,
    inverse_resolution: f32,
    /// Block by block.
    found: Vec<Found>,
}

impl<'a> Nearest<'a> {
    fn on(map: &'a SurfaceMap, scan: &SurfaceScan) -> Self {
        let found = vec![Found::NOTHING; scan.len().div_ceil(LANES)];
        Self { finder: map.finder(), inverse_resolution: map.inverse_resolution() as f32, found }
    }
}

/// The surfaces nearest to a block's points, and the cells in which these were when they were looked up.
#[derive(Clone)]
struct Found {
    cell_x: [i32; LANES],
    cell_y: [i32; LANES],
    mean_x: Lanes,
    mean_y: Lanes,
    normal_x: Lanes,
    normal_y: Lanes,
    flatness: Lanes,
    /// 1 where there is one, else 0.
    is_there: Lanes,
}

impl Found {
    /// So far away there is nothing.
    const NOTHING: Self = Self {
        cell_x: [i32::MIN; LANES],
        cell_y: [i32::MIN; LANES],
        mean_x: [0.0; LANES],
        mean_y: [0.0; LANES],
        normal_x: [0.0; LANES],
        normal_y: [0.0; LANES],
        flatness: [0.0; LANES],
        is_there: [0.0; LANES],
    };

    /// Looks up the points that are in another cell than before.
    #[inline(always)]
    fn update(&mut self, finder: &mut SurfaceFinder<'_>, inverse_resolution: f32, block: &Block, pose: &Pose2) {
        let (sin, cos) = pose.theta.sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        let (pose_x, pose_y) = (pose.x as f32, pose.y as f32);
        let (mut cell_x, mut cell_y) = ([0; LANES], [0; LANES]);
        let mut moved = 0;
        for lane in 0..LANES {
            let rx = cos * block.x_m[lane] - sin * block.y_m[lane];
            let ry = sin * block.x_m[lane] + cos * block.y_m[lane];
            cell_x[lane] = floor((pose_x + rx) * inverse_resolution);
            cell_y[lane] = floor((pose_y + ry) * inverse_resolution);
            moved |= (cell_x[lane] ^ self.cell_x[lane]) | (cell_y[lane] ^ self.cell_y[lane]);
        }
        if moved != 0 {
            self.look_up(finder, &cell_x, &cell_y, block.count);
        }
    }

    #[inline(never)] // The registers are all needed here.
    fn look_up(&mut self, finder: &mut SurfaceFinder<'_>, cell_x: &[i32; LANES], cell_y: &[i32; LANES], count: usize) {
        for lane in 0..LANES {
            let cell = Cell { x: cell_x[lane], y: cell_y[lane] };
            if (cell.x, cell.y) == (self.cell_x[lane], self.cell_y[lane]) {
                continue;
            }
            (self.cell_x[lane], self.cell_y[lane]) = (cell.x, cell.y);
            self.is_there[lane] = 0.0;
            if let Some(surface) = finder.nearest_to_cell(cell).filter(|_| lane < count) {
                [self.mean_x[lane], self.mean_y[lane]] = surface.mean_m;
                [self.normal_x[lane], self.normal_y[lane]] = surface.normal;
                self.flatness[lane] = surface.flatness;
                self.is_there[lane] = 1.0;
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use proptest::prelude::*;

    proptest! {
        /// What was found at one pose serves the next, but where a point has moved on to another cell.
        #[test]
        fn surfaces_found_before_are_those_that_would_be_found_now(
            steps in prop::collection::vec((-0.06..0.06_f64, -0.06..0.06_f64, -0.02..0.02_f64), 1..6)
        ) {
            let config = MatcherConfig::default();
            let walls = Walls::room();
            let scan = SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 213), &config.thinning());
            let mut map = SurfaceMap::new(config.cell_m);
            map.add_scan(&Pose2::IDENTITY, &scan);
            let mut nearest = Nearest::on(&map, &scan);
            let mut pose = Pose2::IDENTITY;
            for (x, y, theta) in steps {
                pose = pose.compose(&Pose2::new(x, y, theta));
                let [kept, anew] =
                    [&mut nearest, &mut Nearest::on(&map, &scan)].map(|nearest| linearise(nearest, &scan, &pose, 2.0, &config));
                prop_assert_eq!(kept.information, anew.information);
                prop_assert_eq!(kept.gradient, anew.gradient);
                prop_assert_eq!((kept.inliers, kept.log_likelihood), (anew.inliers, anew.log_likelihood));
            }
        }
    }

    /// A room, and a scan of it of which every second point lies on nothing if it `is_poor`.
    fn room(is_poor: bool) -> (SurfaceMap, SurfaceScan) {
        let config = MatcherConfig::default();
        let seen = |rays: usize| SurfaceScan::new(&Walls::room().scan_from(&Pose2::IDENTITY, rays), &config.thinning());
        let mut map = SurfaceMap::new(config.cell_m);
        map.add_scan(&Pose2::IDENTITY, &seen(720));
        let mut scan = seen(90);
        for k in (0..if is_poor { scan.len() } else { 0 }).step_by(2) {
            (scan.x_m[k], scan.y_m[k]) = (0.5 * scan.x_m[k], 0.5 * scan.y_m[k]);
        }
        (map, scan)
    }

    #[test]
    fn few_points_count_only_as_much_as_they_fit() {
        let config = MatcherConfig::default();
        let prior = PoseBelief { pose: Pose2::new(0.02, -0.01, 0.003), information: Matrix3::identity() * 100.0 };
        let information = |is_poor: bool| {
            let (map, scan) = room(is_poor);
            [match_few(&map, &scan, &prior, &config), match_scan(&map, &scan, &prior, &config)]
                .map(|fit| fit.scan_information[(2, 2)])
        };
        let [few, many] = information(false);
        assert!((few / many - 1.0).abs() < 1e-9, "what fits counts in full: {few}, {many}");
        let [few, many] = information(true);
        assert!(few < 0.4 * many, "half of them lie on nothing: {few}, {many}");
    }
}
