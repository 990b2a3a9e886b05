//! How a scan and a finished map go together: the fit of one to the other, and what of the scan the map explains.

use super::localization_map::{LocalizationMap, MapSurface};
use crate::geometry::Pose2;
use crate::map::Occupancy;
use crate::scan_matcher::{MatcherConfig, PoseBelief, without_hearsay};
use crate::surface::SurfaceScan;
use nalgebra::{Matrix3, Vector3};

/// How certain a finished map and a scan are of each other.
#[derive(Debug, Clone)]
pub(super) struct Sensing {
    matcher: MatcherConfig,
    /// Variance of a point across a flat surface, m², beside that of the surface itself.
    flat_m2: f32,
    /// Inverse variance of a point's distance from a surface without direction, 1/m².
    rough: f32,
    /// Median variance of where the map has its surfaces, m²: an error that all scans of a place share.
    shared_m2: f64,
}

/// Where a scan fits the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// The optimum and the information of scan and prior together.
    pub(super) belief: PoseBelief,
    /// The information that the scan alone gives.
    pub(super) scan_information: Matrix3<f64>,
}

/// What of a scan the map explains at a pose: shares of its rays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Explanation {
    /// They end on what the map shows.
    pub(super) on_map: f64,
    /// They end on something small before it that the map does not show: people, legs of chairs.
    pub(super) in_front: f64,
    /// They end on something flat before it that the map does not show: doors, cupboards; or a wrong place.
    pub(super) on_flat_in_front: f64,
    /// They went through what the map shows: it is gone, or the place is wrong.
    pub(super) through: f64,
    /// They end where the map knows nothing.
    pub(super) in_unknown: f64,
    /// Mean log-likelihood of a ray, 0 for the best that can be.
    pub(super) log_likelihood: f64,
}

impl Explanation {
    /// A part of the way to another.
    pub(super) fn towards(&self, other: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            on_map: between(self.on_map, other.on_map),
            in_front: between(self.in_front, other.in_front),
            on_flat_in_front: between(self.on_flat_in_front, other.on_flat_in_front),
            through: between(self.through, other.through),
            in_unknown: between(self.in_unknown, other.in_unknown),
            log_likelihood: between(self.log_likelihood, other.log_likelihood),
        }
    }
}

/// Scans share the errors of the map over this drive, metres; so many of them at most. A turn by one radian shows as much that
/// is new as a drive of so many metres.
const SHARED_OVER_M: f64 = 1.0;
const MOST_SHARING: f64 = 100.0;
const TURN_AS_MOTION_M: f64 = 0.5;
/// Rays that a scan is explained by.
const RAYS: usize = 100;
/// A surface may lie this share of a cell from where the map shows it (standard deviation).
const OF_CELL: f64 = 0.3;
/// A ray that ends so far behind a surface went through it, metres, beside what both err.
const THROUGH_M: f32 = 0.15;
/// Likelihood of a ray against one that ends exactly on the map: it ends before what the map shows, where the map knows
/// nothing, or behind what it shows.
const IN_FRONT: f32 = 0.03;
const IN_UNKNOWN: f32 = 0.06;
const THROUGH: f32 = 0.004;
/// A ray that ends within so many standard deviations of a surface ends on it.
const ON_MAP_SIGMAS: f32 = 3.0;
/// Surfaces that are less flat than this are small things.
const FLAT: f32 = 0.6;
/// Nearer than this to the scanner a ray goes through nothing, metres.
const NEAREST_M: f32 = 0.4;
/// A ray that touches the edge of a wall may end that much farther on the same edge, metres.
const PAST_EDGE_M: f32 = 0.3;
/// A ray that went by something small passes it by this much at least before that counts, metres.
const PAST_SMALL_M: f32 = 0.4;

impl Sensing {
    /// For a map.
    pub(super) fn new(matcher: &MatcherConfig, map: &LocalizationMap) -> Self {
        let resolution_m = map.resolution_m();
        let rough_sigma_m = matcher.rough_sigma_m.hypot(OF_CELL * resolution_m);
        Self {
            flat_m2: matcher.sigma_m.powi(2) as f32,
            rough: rough_sigma_m.powi(-2) as f32,
            shared_m2: map.median_variance_m2(),
            matcher: MatcherConfig { sigma_m: matcher.sigma_m.hypot(OF_CELL * resolution_m), ..matcher.clone() },
        }
    }

    /// A ray that ends so far behind a surface went through it, metres.
    #[inline]
    fn through_m(&self, surface: &MapSurface) -> f32 {
        THROUGH_M + 4.0 * (self.flat_m2 + surface.variance_m2).sqrt()
    }

    /// How many scans see about the same, given the motion from one to the next.
    pub(super) fn sharing(&self, motion: &Pose2) -> f64 {
        let moved_m = motion.distance() + TURN_AS_MOTION_M * motion.theta.abs();
        SHARED_OVER_M / moved_m.clamp(SHARED_OVER_M / MOST_SHARING, SHARED_OVER_M)
    }

    /// How much of a scan's information is new after a motion. Scans of the same walls share the walls' errors in the map:
    /// however many there are, together they know a place no better than the map does.
    pub(super) fn independence(&self, motion: &Pose2) -> f64 {
        let own_m2 = f64::from(self.flat_m2);
        (own_m2 + self.shared_m2) / (own_m2 + self.sharing(motion) * self.shared_m2)
    }

    /// Fits a scan to the map from the mean of a `prior` that may itself be wrong: from about `trusted_sigmas` away from
    /// it on the scan prevails (Cauchy's weights).
    pub(super) fn fit(
        &self,
        map: &LocalizationMap,
        scan: &SurfaceScan,
        prior: &PoseBelief,
        trusted_sigmas: f64,
    ) -> Fit {
        self.fit_from(map, scan, &prior.pose, prior, trusted_sigmas)
    }

    /// The same from another pose than the prior's mean.
    pub(super) fn fit_from(
        &self,
        map: &LocalizationMap,
        scan: &SurfaceScan,
        start: &Pose2,
        prior: &PoseBelief,
        trusted_sigmas: f64,
    ) -> Fit {
        let matcher = &self.matcher;
        let mut pose = *start;
        let mut gate = matcher.wide_gate_sigmas;
        let mut of_scan = Matrix3::zeros();
        for _ in 0..matcher.iterations {
            let (information, gradient) = self.linearise(map, scan, &pose, gate);
            let scale = without_hearsay(&information, matcher);
            of_scan = scale * information * scale;
            let of_prior = prior.information / (1.0 + (prior.sigmas_to(&pose) / trusted_sigmas).powi(2));
            let offset = prior.offset(&pose);
            let gradient = scale * scale * gradient + of_prior * offset;
            let Some(step) = (of_scan + of_prior).cholesky().map(|factor| -factor.solve(&gradient)) else { break };
            pose = Pose2::new(pose.x + step.x, pose.y + step.y, pose.theta + step.z);
            let (step_m, step_rad) = (step.x.hypot(step.y), step.z.abs());
            if step_m < matcher.stop_step_m && step_rad < matcher.stop_step_rad && gate == matcher.gate_sigmas {
                break;
            }
            if step_m < NEAR_STEP_M && step_rad < NEAR_STEP_RAD {
                gate = matcher.gate_sigmas;
            }
        }
        Fit { belief: PoseBelief { pose, information: of_scan + prior.information }, scan_information: of_scan }
    }

    /// The normal equations at a pose.
    fn linearise(
        &self,
        map: &LocalizationMap,
        scan: &SurfaceScan,
        pose: &Pose2,
        gate_sigmas: f64,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        let (sin, cos) = (pose.theta.sin() as f32, pose.theta.cos() as f32);
        let (pose_x, pose_y) = (pose.x as f32, pose.y as f32);
        let inverse_gate = gate_sigmas.powi(-2) as f32;
        let mut sums = [0.0_f32; 9];
        for ([x, y], [scan_nx, scan_ny]) in scan.iter() {
            let (rx, ry) = (cos * x - sin * y, sin * x + cos * y);
            let Some(surface) = map.nearest([pose_x + rx, pose_y + ry]) else { continue };
            let [nx, ny] = surface.normal;
            let facing = (cos * scan_nx - sin * scan_ny) * nx + (sin * scan_nx + cos * scan_ny) * ny;
            if !may_be_seen(surface, facing) {
                continue;
            }
            let flatness = surface.flatness;
            let (dx, dy) = (pose_x + rx - surface.mean_m[0], pose_y + ry - surface.mean_m[1]);
            let (across, along) = (nx * dx + ny * dy, nx * dy - ny * dx);
            let weight_along = (1.0 - flatness) * self.rough;
            let weight_across = flatness / (self.flat_m2 + surface.variance_m2) + weight_along;
            let square = weight_across * across * across + weight_along * along * along;
            let robust = 1.0 / (1.0 + square * inverse_gate);
            let robust = robust * robust;
            let wxx = robust * (weight_across * nx * nx + weight_along * ny * ny);
            let wxy = robust * (weight_across - weight_along) * nx * ny;
            let wyy = robust * (weight_across * ny * ny + weight_along * nx * nx);
            let (ex, ey) = (wxx * dx + wxy * dy, wxy * dx + wyy * dy);
            let (jx, jy) = (-ry, rx);
            let (vx, vy) = (wxx * jx + wxy * jy, wxy * jx + wyy * jy);
            let terms = [wxx, wxy, vx, wyy, vy, vx * jx + vy * jy, ex, ey, jx * ex + jy * ey];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        let [xx, xy, xt, yy, yt, tt, gx, gy, gt] = sums.map(f64::from);
        // Neighbouring points err together: beyond a number of points more do not say more.
        let temper = (self.matcher.independent_points / scan.len().max(1) as f64).min(1.0);
        (Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt) * temper, Vector3::new(gx, gy, gt) * temper)
    }

    /// What of a scan the map explains at a pose: each ray by the map, by something before it that the map does not show, or
    /// by nothing (the mixture of Thrun, Burgard & Fox 2005, §6.3, with the ends of rays in place of ranges).
    pub(super) fn explain(&self, map: &LocalizationMap, scan: &SurfaceScan, pose: &Pose2) -> Explanation {
        let mut explanation = Explanation::default();
        let (sin, cos) = (pose.theta.sin() as f32, pose.theta.cos() as f32);
        let to_grid = |[x, y]: [f32; 2]| [pose.x as f32 + cos * x - sin * y, pose.y as f32 + sin * x + cos * y];
        let from = to_grid(scan.origin_m.map(|v| v as f32));
        let stride = scan.len().div_ceil(RAYS).max(1);
        let mut rays = 0;
        for (point, [scan_nx, scan_ny]) in scan.iter().step_by(stride) {
            rays += 1;
            let end = to_grid(point);
            let normal = [cos * scan_nx - sin * scan_ny, sin * scan_nx + cos * scan_ny];
            let on_map = self.on_map(map, end, normal);
            let (dx, dy) = (end[0] - from[0], end[1] - from[1]);
            let range_m = dx.hypot(dy);
            let direction = [dx / range_m.max(1e-6), dy / range_m.max(1e-6)];
            // What touches the scanner itself is no wall.
            let passes = |at_m: f32, surface: &MapSurface| {
                at_m > NEAREST_M && self.is_passed(surface, from, end, range_m - at_m)
            };
            let goes_through = map.trace(from, direction, range_m - THROUGH_M, passes).is_some();
            let (otherwise, share) = if goes_through {
                (THROUGH, &mut explanation.through)
            } else if map.occupancy(end) == Occupancy::Unknown {
                (IN_UNKNOWN, &mut explanation.in_unknown)
            } else if normal[0].hypot(normal[1]) > FLAT {
                (IN_FRONT, &mut explanation.on_flat_in_front)
            } else {
                (IN_FRONT, &mut explanation.in_front)
            };
            let is_on_map = !goes_through && on_map < ON_MAP_SIGMAS * ON_MAP_SIGMAS;
            *(if is_on_map { &mut explanation.on_map } else { share }) += 1.0;
            let hit = if goes_through { 0.0 } else { (-0.5 * on_map).exp() };
            explanation.log_likelihood += f64::from((hit * (1.0 - otherwise) + otherwise).ln());
        }
        let scale = 1.0 / f64::from(rays.max(1));
        for part in [
            &mut explanation.on_map,
            &mut explanation.in_front,
            &mut explanation.on_flat_in_front,
            &mut explanation.through,
            &mut explanation.in_unknown,
            &mut explanation.log_likelihood,
        ] {
            *part *= scale;
        }
        explanation
    }

    /// Mean log-likelihood of a scan's points by their ends alone: what many particles are weighed by.
    pub(super) fn weigh(&self, map: &LocalizationMap, scan: &SurfaceScan, pose: &Pose2, points: usize) -> f64 {
        let (sin, cos) = (pose.theta.sin() as f32, pose.theta.cos() as f32);
        let stride = scan.len().div_ceil(points).max(1);
        let (mut sum, mut count) = (0.0_f32, 0);
        for ([x, y], [nx, ny]) in scan.iter().step_by(stride) {
            let end = [pose.x as f32 + cos * x - sin * y, pose.y as f32 + sin * x + cos * y];
            let square = self.on_map(map, end, [cos * nx - sin * ny, sin * nx + cos * ny]);
            sum += ((-0.5 * square).exp() * (1.0 - IN_FRONT) + IN_FRONT).ln();
            count += 1;
        }
        f64::from(sum) / f64::from(count.max(1))
    }

    /// Squared distance, in standard deviations, of a ray's end from the surface that it may lie on.
    #[inline]
    fn on_map(&self, map: &LocalizationMap, end: [f32; 2], normal: [f32; 2]) -> f32 {
        let Some(surface) = map.nearest(end) else { return f32::INFINITY };
        let [nx, ny] = surface.normal;
        if !may_be_seen(surface, normal[0] * nx + normal[1] * ny) {
            return f32::INFINITY;
        }
        let (dx, dy) = (end[0] - surface.mean_m[0], end[1] - surface.mean_m[1]);
        let (across, along) = (nx * dx + ny * dy, nx * dy - ny * dx);
        // A piece of wall ends somewhere: what lies far along it is not on it.
        let weight_along = ((1.0 - surface.flatness) * self.rough).max(0.05 * self.rough);
        let weight_across =
            surface.flatness / (self.flat_m2 + surface.variance_m2) + (1.0 - surface.flatness) * self.rough;
        weight_across * across * across + weight_along * along * along
    }

    /// Whether a ray that ends `beyond_m` farther than it meets a surface went through it.
    #[inline]
    fn is_passed(&self, surface: &MapSurface, from: [f32; 2], end: [f32; 2], beyond_m: f32) -> bool {
        if surface.flatness < FLAT {
            return beyond_m > PAST_SMALL_M;
        }
        let side = |point: [f32; 2]| {
            surface.normal[0] * (point[0] - surface.mean_m[0]) + surface.normal[1] * (point[1] - surface.mean_m[1])
        };
        let (here, there) = (side(from), side(end));
        // Along a wall hardly anything tells on which side of it a ray ends.
        here * there < 0.0 && there.abs() > self.through_m(surface) && beyond_m > PAST_EDGE_M
    }
}

/// Whether a surface can be what was seen, given how much the normals of both point the same way.
#[inline]
fn may_be_seen(surface: &MapSurface, facing: f32) -> bool {
    !surface.is_one_sided || facing * surface.flatness >= -0.2
}

/// Steps smaller than these, metres and radians, are taken for the last ones of the approach.
const NEAR_STEP_M: f64 = 0.01;
const NEAR_STEP_RAD: f64 = 0.005;
