//! A scan's points with the normals of the surfaces they lie on.

use super::MatcherConfig;
use crate::frame::BodyScan;
use crate::geometry::Pose2;
use crate::map::Surface;

/// Neighbours within this distance along the scan share a normal, metres.
const NEIGHBOURHOOD_M: f32 = 0.12;
/// At least this many beam spacings are looked at to each side, so that far walls have normals too.
const NEIGHBOURHOOD_SPACINGS: f32 = 2.5;

/// Points with normals in the body's frame, thinned to about equal distances along the surfaces.
#[derive(Debug, Clone, Default)]
pub struct SurfaceScan {
    /// Where the LiDAR is in the body's frame, metres.
    pub origin_m: [f64; 2],
    /// Points, metres, and their normals, stored by coordinate so that loops over them vectorise.
    pub(super) x_m: Vec<f32>,
    pub(super) y_m: Vec<f32>,
    pub(super) normal_x: Vec<f32>,
    pub(super) normal_y: Vec<f32>,
}

impl SurfaceScan {
    /// Points of `scan`, thinned as `config` asks, with normals from all its points.
    ///
    /// The step from one point to the next follows from how densely the surface was hit. Taking
    /// the first point that is far enough away would prefer points whose noise moves them away:
    /// walls ahead and behind would seem turned, always the same way.
    #[must_use]
    pub fn new(scan: &BodyScan, config: &MatcherConfig) -> Self {
        let xs = &scan.hits.x_m;
        let ys = &scan.hits.y_m;
        let count = xs.len();
        let sums = RunningSums::new(xs, ys);
        let spacing = spacing_for(xs, ys, config);
        let (origin_x, origin_y) = (scan.origin_m[0] as f32, scan.origin_m[1] as f32);
        let mut result = Self::with_capacity(scan.origin_m, count.min(config.max_points));
        let mut i = 0;
        while i < count {
            let (x, y) = (xs[i], ys[i]);
            let range = length(x - origin_x, y - origin_y);
            let reach =
                NEIGHBOURHOOD_M.max(spacing).max(NEIGHBOURHOOD_SPACINGS * spacing_between_beams(xs, ys, i, range));
            let within = |j: usize| {
                let (dx, dy) = (xs[j] - x, ys[j] - y);
                dx * dx + dy * dy <= reach * reach
            };
            let mut begin = i;
            while begin > 0 && within(begin - 1) {
                begin -= 1;
            }
            let mut end = i + 1;
            while end < count && within(end) {
                end += 1;
            }
            result.push([x, y], sums.normal(begin, end, [origin_x - x, origin_y - y]));
            let extent = length(xs[end - 1] - xs[begin], ys[end - 1] - ys[begin]);
            let step = (spacing * (end - begin - 1) as f32 / extent.max(1e-3) + 0.5) as usize;
            i = (i + step.max(1)).min(end);
        }
        result
    }

    /// The surfaces of a map as if they had been seen from one place.
    #[must_use]
    pub fn from_surfaces<'a>(origin_m: [f64; 2], surfaces: impl Iterator<Item = &'a Surface>) -> Self {
        let mut result = Self::with_capacity(origin_m, 0);
        surfaces.for_each(|surface| result.push(surface.mean_m, surface.normal.map(|n| n * surface.flatness)));
        result
    }

    fn with_capacity(origin_m: [f64; 2], points: usize) -> Self {
        let column = || Vec::with_capacity(points);
        Self { origin_m, x_m: column(), y_m: column(), normal_x: column(), normal_y: column() }
    }

    #[inline]
    fn push(&mut self, [x, y]: [f32; 2], [normal_x, normal_y]: [f32; 2]) {
        self.x_m.push(x);
        self.y_m.push(y);
        self.normal_x.push(normal_x);
        self.normal_y.push(normal_y);
    }

    /// The same points as seen from another frame, given that frame's pose in this one.
    #[must_use]
    pub fn seen_from(&self, pose: &Pose2) -> Self {
        let inverse = pose.inverse();
        let (sin, cos) = (inverse.theta.sin() as f32, inverse.theta.cos() as f32);
        let mut result = Self::with_capacity(inverse.transform_point(self.origin_m), self.len());
        for (point, [nx, ny]) in self.iter() {
            let moved = inverse.transform_point(point.map(f64::from)).map(|v| v as f32);
            result.push(moved, [cos * nx - sin * ny, sin * nx + cos * ny]);
        }
        result
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.x_m.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x_m.is_empty()
    }

    /// Each point (metres) with its normal, whose length says how flat the surface is (1 a wall, 0 no direction).
    pub fn iter<'a>(&'a self) -> impl Iterator<Item = ([f32; 2], [f32; 2])> + 'a {
        let pairs = |x: &'a [f32], y: &'a [f32]| x.iter().zip(y).map(|(&x, &y)| [x, y]);
        pairs(&self.x_m, &self.y_m).zip(pairs(&self.normal_x, &self.normal_y))
    }
}

/// The distance between kept points that leaves about as many as asked for: `point_spacing_m`, or more in
/// scans that see so much surface that there would be too many.
fn spacing_for(xs: &[f32], ys: &[f32], config: &MatcherConfig) -> f32 {
    let spacing_m = config.point_spacing_m as f32;
    let steps = |i: usize| length(xs[i] - xs[i - 1], ys[i] - ys[i - 1]);
    // Steps longer than the spacing keep a point each, whatever their length.
    let surface_m: f32 = (1..xs.len()).map(steps).filter(|step| *step < spacing_m).sum();
    spacing_m.max(surface_m / config.max_points as f32)
}

/// Distance to the nearer of the two neighbours in the scan, at most what a gap of a few degrees makes.
fn spacing_between_beams(xs: &[f32], ys: &[f32], i: usize, range: f32) -> f32 {
    let to = |j: usize| length(xs[j] - xs[i], ys[j] - ys[i]);
    let before = if i > 0 { to(i - 1) } else { f32::INFINITY };
    let after = if i + 1 < xs.len() { to(i + 1) } else { f32::INFINITY };
    before.min(after).min(0.05 * range)
}

/// Length of a vector. `hypot`, which is exact for lengths near the limits of floats, is a slow function call.
#[inline]
fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// Sums over the first k points, so that the spread of any run of points costs one subtraction.
struct RunningSums(Vec<[f64; 5]>);

impl RunningSums {
    fn new(xs: &[f32], ys: &[f32]) -> Self {
        let mut sums = Vec::with_capacity(xs.len() + 1);
        let mut total = [0.0; 5];
        sums.push(total);
        for (&x, &y) in xs.iter().zip(ys) {
            let (x, y) = (f64::from(x), f64::from(y));
            for (sum, term) in total.iter_mut().zip([x, y, x * x, x * y, y * y]) {
                *sum += term;
            }
            sums.push(total);
        }
        Self(sums)
    }

    /// The normal of the line through points `begin..end` on the side of `towards`; its length
    /// is 1 for points on a line and 0 for points without direction.
    fn normal(&self, begin: usize, end: usize, towards: [f32; 2]) -> [f32; 2] {
        let count = (end - begin) as f64;
        if end - begin < 3 {
            return [0.0, 0.0];
        }
        let (low, high) = (&self.0[begin], &self.0[end]);
        let mean = |k: usize| (high[k] - low[k]) / count;
        let (mean_x, mean_y) = (mean(0), mean(1));
        let xx = mean(2) - mean_x * mean_x;
        let xy = mean(3) - mean_x * mean_y;
        let yy = mean(4) - mean_y * mean_y;
        // Eigenvalues of the 2 × 2 covariance.
        let half_trace = 0.5 * (xx + yy);
        let root = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        let (small, large) = ((half_trace - root).max(0.0), half_trace + root);
        let flatness = (1.0 - 4.0 * small / large.max(1e-12)).clamp(0.0, 1.0);
        if root <= 0.0 {
            return [0.0, 0.0];
        }
        // Cosine and sine of the line's angle from those of twice the angle.
        let (cos_twice, sin_twice) = (0.5 * (xx - yy) / root, xy / root);
        let larger = (0.5 * (1.0 + cos_twice.abs())).sqrt();
        let smaller = 0.5 * sin_twice / larger;
        let (cos, sin) = if cos_twice >= 0.0 { (larger, smaller) } else { (smaller, larger) };
        let (mut nx, mut ny) = (-sin as f32, cos as f32);
        if nx * towards[0] + ny * towards[1] < 0.0 {
            (nx, ny) = (-nx, -ny);
        }
        [nx * flatness as f32, ny * flatness as f32]
    }
}
