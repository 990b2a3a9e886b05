//! A scan's points with the normals of the surfaces they lie on.

use super::packing::{push_rows, take_array, take_columns};
use super::{Horizon, Surface};
use crate::frame::BodyScan;
use crate::geometry::Pose2;
use multiversion::multiversion;

/// Neighbours within this distance along the scan share a normal, metres.
const NEIGHBOURHOOD_M: f32 = 0.12;
/// At least this many beam spacings are looked at to each side, so that far walls have normals too.
const NEIGHBOURHOOD_SPACINGS: f32 = 2.5;

/// … and so many standard deviations of the ranges, so that noise turns normals by a few degrees at most …
const NEIGHBOURHOOD_SIGMAS: f32 = 11.0;
/// … up to this, metres.
const WIDEST_M: f32 = 1.0;
/// Points may scatter from their surfaces by half a cell of the map that is matched against, metres. More would fill several cells
/// side by side, in each of which a point finds itself.
const MATCHED_NOISE_M: f32 = 0.025;

/// Directions of normals that are told apart when points are balanced.
const DIRECTIONS: usize = 16;
/// Surfaces less flat than this count as having no direction.
const ROUGH: f32 = 0.3;

/// How many points of a scan are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinning {
    /// Points are thinned to this distance along surfaces, metres.
    pub point_spacing_m: f64,
    /// Points are thinned further where there would be many more than this.
    pub max_points: usize,
}

impl Default for Thinning {
    fn default() -> Self {
        Self { point_spacing_m: 0.03, max_points: 300 }
    }
}

impl Thinning {
    /// For half as many points.
    #[must_use]
    pub fn halved(&self) -> Self {
        Self { point_spacing_m: 2.0 * self.point_spacing_m, max_points: self.max_points.div_ceil(2) }
    }
}

/// Points with normals in the body's frame, thinned to about equal distances along the surfaces.
#[derive(Debug, Clone, Default)]
pub struct SurfaceScan {
    /// Where the LiDAR is in the body's frame, metres.
    pub origin_m: [f64; 2],
    /// Points, metres, and their normals, stored by coordinate so that loops over them vectorise.
    pub(crate) x_m: Vec<f32>,
    pub(crate) y_m: Vec<f32>,
    pub(crate) normal_x: Vec<f32>,
    pub(crate) normal_y: Vec<f32>,
}

impl SurfaceScan {
    /// Appends it to bytes of which [`unpack`](Self::unpack) makes the same.
    pub(crate) fn pack(&self, bytes: &mut Vec<u8>) {
        self.origin_m.iter().for_each(|coordinate| bytes.extend(coordinate.to_le_bytes()));
        bytes.extend((self.len() as u32).to_le_bytes());
        push_rows(bytes, self.iter().map(|([x, y], [normal_x, normal_y])| [x, y, normal_x, normal_y]));
    }

    /// Takes a packed scan from the front of bytes; `None` if they are none.
    pub(crate) fn unpack(bytes: &mut &[u8]) -> Option<Self> {
        let [x, y] = [take_array(bytes)?, take_array(bytes)?];
        let origin_m = [f64::from_le_bytes(x), f64::from_le_bytes(y)];
        let points = u32::from_le_bytes(take_array(bytes)?) as usize;
        let [x_m, y_m, normal_x, normal_y] = take_columns(bytes, points)?;
        Some(Self { origin_m, x_m, y_m, normal_x, normal_y })
    }

    /// Points of `scan`, thinned as asked for, with normals from all its points.
    ///
    /// The step from one point to the next follows from how densely the surface was hit. Taking
    /// the first point that is far enough away would prefer points whose noise moves them away:
    /// walls ahead and behind would seem turned, always the same way.
    #[must_use]
    pub fn new(scan: &BodyScan, thinning: &Thinning) -> Self {
        surfaces_of(scan, thinning)
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

    /// Marks at most about `most` of the points, chosen so that surfaces of all directions have their say
    /// (normal-space sampling, Rusinkiewicz & Levoy 2001): along a corridor its few recesses and
    /// corners tell more than its long walls.
    #[must_use]
    pub fn balance(&self, most: usize) -> Vec<bool> {
        let mut buckets: Vec<Vec<usize>> = vec![Vec::new(); DIRECTIONS + 1];
        for (index, (_, [x, y])) in self.iter().enumerate() {
            let direction = if length(x, y) < ROUGH {
                DIRECTIONS
            } else {
                let turns = f64::from(y.atan2(x)) / std::f64::consts::TAU;
                ((turns * DIRECTIONS as f64).round() as i64).rem_euclid(DIRECTIONS as i64) as usize
            };
            buckets[direction].push(index);
        }
        // Small buckets keep all of their points; what they leave is shared among the larger ones.
        let mut by_size: Vec<usize> = (0..buckets.len()).filter(|&bucket| !buckets[bucket].is_empty()).collect();
        by_size.sort_by_key(|&bucket| (buckets[bucket].len(), bucket));
        let mut left = most;
        let mut marks = vec![false; self.len()];
        for (done, &bucket) in by_size.iter().enumerate() {
            let points = &buckets[bucket];
            let quota = (left / (by_size.len() - done)).clamp(1, points.len());
            (0..quota).for_each(|k| marks[points[k * points.len() / quota]] = true);
            left = left.saturating_sub(quota);
        }
        marks
    }

    /// The points that [`balance`](Self::balance) marks.
    #[must_use]
    pub fn balanced(&self, most: usize) -> Self {
        self.selected(self.balance(most).into_iter())
    }

    /// How far the scan saw, in the frame in which its origin has the pose `frame_from_scan`.
    #[must_use]
    pub fn horizon(&self, frame_from_scan: &Pose2) -> Horizon {
        let to_frame = frame_from_scan.point_transform();
        let ends = self.iter().map(|(point, _)| to_frame(point.map(f64::from)));
        Horizon::new(frame_from_scan.transform_point(self.origin_m), ends)
    }

    /// The points that another scan had in view; each scan with its pose.
    #[must_use]
    pub fn in_view_of(&self, pose: &Pose2, other: &Self, other_pose: &Pose2) -> Self {
        self.looked_through_by(pose, other, other_pose, 0.0)
    }

    /// The points that are wanted, given their places (metres).
    #[must_use]
    pub fn filtered(&self, is_wanted: impl Fn([f32; 2]) -> bool) -> Self {
        let mut result = Self::with_capacity(self.origin_m, self.len());
        self.iter().filter(|(point, _)| is_wanted(*point)).for_each(|(point, normal)| result.push(point, normal));
        result
    }

    /// The points that are marked, given a mark for each.
    #[must_use]
    pub fn selected(&self, marks: impl Iterator<Item = bool>) -> Self {
        let mut result = Self::with_capacity(self.origin_m, self.len());
        self.iter().zip(marks).filter(|(_, mark)| *mark).for_each(|((point, normal), _)| result.push(point, normal));
        result
    }

    /// The same points as seen from another frame, given that frame's pose in this one.
    #[must_use]
    pub fn seen_from(&self, pose: &Pose2) -> Self {
        let inverse = pose.inverse();
        let (sin, cos) = (inverse.theta.sin() as f32, inverse.theta.cos() as f32);
        let transform = inverse.point_transform();
        let mut result = Self::with_capacity(transform(self.origin_m), self.len());
        for (point, [nx, ny]) in self.iter() {
            let moved = transform(point.map(f64::from)).map(|v| v as f32);
            result.push(moved, [cos * nx - sin * ny, sin * nx + cos * ny]);
        }
        result
    }

    /// The points that another scan looked through: its rays end at least `behind_m` behind them; each scan with its pose.
    #[must_use]
    pub fn looked_through_by(&self, pose: &Pose2, other: &Self, other_pose: &Pose2, behind_m: f32) -> Self {
        let horizon = other.horizon(&Pose2::IDENTITY);
        let to_other = other_pose.between(pose).point_transform();
        self.filtered(|point| horizon.reaches(to_other(point.map(f64::from)).map(|v| v as f32), -behind_m))
    }

    /// How far it sees: three quarters of its points are nearer than this to where the LiDAR is, metres; 0 without points.
    #[must_use]
    pub fn view_m(&self) -> f64 {
        let [origin_x, origin_y] = self.origin_m.map(|coordinate| coordinate as f32);
        let mut ranges: Vec<f32> = self.iter().map(|([x, y], _)| length(x - origin_x, y - origin_y)).collect();
        let rank = 3 * ranges.len() / 4;
        if ranges.is_empty() { 0.0 } else { f64::from(*ranges.select_nth_unstable_by(rank, f32::total_cmp).1) }
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

/// The points of [`SurfaceScan::new`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn surfaces_of(scan: &BodyScan, thinning: &Thinning) -> SurfaceScan {
    let count = scan.hits.len();
    let (xs, ys) = (&scan.hits.x_m[..count], &scan.hits.y_m[..count]);
    let sums = RunningSums::new(xs, ys);
    let steps = steps(xs, ys);
    let spacing = spacing_for(&steps, thinning);
    let (origin_x, origin_y) = (scan.origin_m[0] as f32, scan.origin_m[1] as f32);
    // The usual neighbourhood is made for so much noise; only what is beyond it makes a difference.
    let usual_noise_m = NEIGHBOURHOOD_M / NEIGHBOURHOOD_SIGMAS;
    let noise_m = scan.range_noise_m.max(usual_noise_m);
    let least_reach = spacing.max((NEIGHBOURHOOD_SIGMAS * noise_m).min(WIDEST_M));
    let noise_m2 = Noise {
        of_normals: f64::from(noise_m * noise_m - usual_noise_m * usual_noise_m),
        of_points: if noise_m > MATCHED_NOISE_M { f64::from(noise_m * noise_m) } else { 0.0 },
    };
    let (mut kept, mut free): (Vec<Kept>, Vec<Kept>) = (Vec::with_capacity(count), Vec::new());
    let mut i = 0;
    while i < count {
        let (x, y) = (xs[i], ys[i]);
        let range = length(x - origin_x, y - origin_y);
        // To the nearer of the two neighbours in the scan, at most what a gap of a few degrees makes.
        let between_beams = steps[i].min(steps[i + 1]).min(0.05 * range);
        let reach = least_reach.max(NEIGHBOURHOOD_SPACINGS * between_beams);
        let is_within = |(other_x, other_y): (&f32, &f32)| {
            let (dx, dy) = (other_x - x, other_y - y);
            dx * dx + dy * dy <= reach * reach
        };
        let begin = i - xs[..i].iter().zip(&ys[..i]).rev().take_while(|other| is_within(*other)).count();
        let end = i + 1 + xs[i + 1..].iter().zip(&ys[i + 1..]).take_while(|other| is_within(*other)).count();
        if end - begin >= 3 {
            kept.push(Kept { point: i, begin, end });
        } else if let Some(far) = far_wall(&steps, i, range, &sums) {
            kept.push(far);
        } else if stands_free(&steps, i) {
            free.push(Kept { point: i, begin: i, end: i + 1 });
        }
        let extent = length(xs[end - 1] - xs[begin], ys[end - 1] - ys[begin]);
        let step = (spacing * (end - begin - 1) as f32 / extent.max(1e-3) + 0.5) as u32;
        i = (i + step.max(1) as usize).min(end);
    }
    if (kept.len() as f64) < FEW_SHARE * thinning.max_points as f64 {
        kept.append(&mut free);
    }
    let mut result = SurfaceScan::with_capacity(scan.origin_m, kept.len());
    for kept in kept.chunks(LANES) {
        let [x_m, y_m, normal_x, normal_y] = sums.surfaces(kept, scan, &noise_m2);
        result.x_m.extend_from_slice(&x_m[..kept.len()]);
        result.y_m.extend_from_slice(&y_m[..kept.len()]);
        result.normal_x.extend_from_slice(&normal_x[..kept.len()]);
        result.normal_y.extend_from_slice(&normal_y[..kept.len()]);
    }
    result
}

/// A point that is kept, and the run of points from which its normal follows.
#[derive(Clone, Copy)]
struct Kept {
    point: usize,
    begin: usize,
    end: usize,
}

/// Variances of the ranges, m².
struct Noise {
    /// By so much more than is usual runs of points are thicker than the surfaces they show.
    of_normals: f64,
    /// So much of what a point is off its surface is taken away.
    of_points: f64,
}

/// Normals that are computed side by side.
const LANES: usize = 8;

/// The distance of each point from the one before it, and after the last one: infinite where there is none.
fn steps(xs: &[f32], ys: &[f32]) -> Vec<f32> {
    let mut steps = vec![f32::INFINITY; xs.len() + 1];
    let before = xs.iter().zip(ys);
    for ((step, (x, y)), (x_before, y_before)) in steps.iter_mut().skip(1).zip(before.clone().skip(1)).zip(before) {
        *step = length(x - x_before, y - y_before);
    }
    steps
}

/// The distance between kept points that leaves about as many as asked for: `point_spacing_m`, or more in
/// scans that see so much surface that there would be too many.
fn spacing_for(steps: &[f32], thinning: &Thinning) -> f32 {
    let spacing_m = thinning.point_spacing_m as f32;
    // Steps longer than the spacing keep a point each, whatever their length.
    let surface_m: f32 = steps.iter().filter(|step| **step < spacing_m).sum();
    spacing_m.max(surface_m / thinning.max_points as f32)
}

/// A point that stands alone, where it lies on one line with the rays before and after it: a wall at a graze.
/// Without a normal such points would be taken for objects; as the robot moves each lies a little farther along the wall,
/// close to where the ray before it was, and so they would hold the robot back.
fn far_wall(steps: &[f32], point: usize, range: f32, sums: &RunningSums) -> Option<Kept> {
    let (begin, end) = (point.saturating_sub(WALL_RAYS), (point + WALL_RAYS + 1).min(steps.len() - 1));
    let longest = steps[begin + 1..end].iter().copied().fold(0.0, f32::max);
    if end - begin < WALL_RAYS + 2 || longest > (WALL_STEP_PER_RANGE * range).min(WALL_STEP_M) {
        return None;
    }
    (sums.thickness(begin, end) < WALL_THICKNESS_M + WALL_THICKNESS_PER_RANGE * f64::from(range)).then_some(Kept {
        point,
        begin,
        end,
    })
}

/// Whether a single ray hit something around which others hit nothing: a trunk, a post.
fn stands_free(steps: &[f32], point: usize) -> bool {
    steps[point].min(steps[point + 1]) > FREE_M
}

/// What is so far from everything before and after it stands alone, metres.
const FREE_M: f32 = 1.0;
/// Such points count where there are fewer others than this share of what a scan may have. Indoors they are legs of chairs and
/// of people, and walls say enough; among trees they are what there is.
const FEW_SHARE: f64 = 1.0 / 6.0;

/// Rays to either side that must lie on one line.
const WALL_RAYS: usize = 3;
/// Largest step from ray to ray on a wall at a graze, metres and as a share of the range.
const WALL_STEP_M: f32 = 3.0;
const WALL_STEP_PER_RANGE: f32 = 0.15;
/// Root mean square distance from that line, metres and as a share of the range.
const WALL_THICKNESS_M: f64 = 0.02;
const WALL_THICKNESS_PER_RANGE: f64 = 0.001;

/// Length of a vector. `hypot`, which is exact for lengths near the limits of floats, is a slow function call.
#[inline]
fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// The covariance (xx, xy, yy) that follows from the means of x, y, x², xy and y².
#[inline(always)]
fn covariance([x, y, xx, xy, yy]: [f64; 5]) -> (f64, f64, f64) {
    (xx - x * x, xy - x * y, yy - y * y)
}

/// Sums over the first k points, so that the spread of any run of points costs one subtraction.
struct RunningSums(Vec<[f64; 5]>);

impl RunningSums {
    fn new(xs: &[f32], ys: &[f32]) -> Self {
        let mut total = [0.0; 5];
        let mut sums = Vec::with_capacity(xs.len() + 1);
        sums.push(total);
        sums.extend(xs.iter().zip(ys).map(|(&x, &y)| {
            let (x, y) = (f64::from(x), f64::from(y));
            for (sum, term) in total.iter_mut().zip([x, y, x * x, x * y, y * y]) {
                *sum += term;
            }
            total
        }));
        Self(sums)
    }

    /// Root mean square distance of points `begin..end` from the line through them.
    fn thickness(&self, begin: usize, end: usize) -> f64 {
        let (low, high) = (&self.0[begin], &self.0[end]);
        let count = (end - begin) as f64;
        let (xx, xy, yy) = covariance([0, 1, 2, 3, 4].map(|k| (high[k] - low[k]) / count));
        (0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()).max(0.0).sqrt()
    }

    /// Up to [`LANES`] points, and the normals of the lines through the runs of points around them, all by coordinate. The normals
    /// are on the side of the scan's origin; their length is 1 for runs on a line and 0 for runs without direction. Each point is
    /// moved towards its line by the share of the run's thickness that noise alone explains (Wiener's filter).
    #[inline(always)]
    fn surfaces(&self, kept: &[Kept], scan: &BodyScan, noise_m2: &Noise) -> [[f32; LANES]; 4] {
        let (mut sums, mut counts, mut towards) = ([[0.0; LANES]; 5], [1.0; LANES], [[0.0_f32; LANES]; 2]);
        let mut points = [[0.0_f32; LANES]; 2];
        for (lane, kept) in kept.iter().enumerate().take(LANES) {
            let (low, high) = (&self.0[kept.begin], &self.0[kept.end]);
            for k in 0..5 {
                sums[k][lane] = high[k] - low[k];
            }
            counts[lane] = (kept.end - kept.begin) as f64;
            points[0][lane] = scan.hits.x_m[kept.point];
            points[1][lane] = scan.hits.y_m[kept.point];
            towards[0][lane] = scan.origin_m[0] as f32 - points[0][lane];
            towards[1][lane] = scan.origin_m[1] as f32 - points[1][lane];
        }
        let mut normals = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            let means = [0, 1, 2, 3, 4].map(|k| sums[k][lane] / counts[lane]);
            let (xx, xy, yy) = covariance(means);
            // Eigenvalues of the 2 × 2 covariance.
            let half_trace = 0.5 * (xx + yy);
            let root = (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
            let thickness_m2 = half_trace - root;
            let (small, large) = (thickness_m2 - noise_m2.of_normals, half_trace + root);
            // A line through n points takes two of their degrees of freedom.
            let explained_m2 = noise_m2.of_points * (1.0 - 2.0 / counts[lane]);
            let noise_share = if explained_m2 > 0.0 { explained_m2 / thickness_m2.max(explained_m2) } else { 0.0 };
            let (small, large) = (if small > 0.0 { small } else { 0.0 }, if large > 1e-12 { large } else { 1e-12 });
            let flatness = 1.0 - 4.0 * small / large;
            let flatness = if flatness > 0.0 && root > 0.0 { flatness } else { 0.0 };
            // Cosine and sine of the line's angle from those of twice the angle.
            let some_root = if root > 0.0 { root } else { 1.0 };
            let (cos_twice, sin_twice) = (0.5 * (xx - yy) / some_root, xy / some_root);
            let larger = (0.5 * (1.0 + cos_twice.abs())).sqrt();
            let smaller = 0.5 * sin_twice / larger;
            let (cos, sin) = if cos_twice >= 0.0 { (larger, smaller) } else { (smaller, larger) };
            let (nx, ny) = (-sin as f32, cos as f32);
            let faces_away = nx * towards[0][lane] + ny * towards[1][lane] < 0.0;
            let length = if faces_away { -flatness as f32 } else { flatness as f32 };
            normals[0][lane] = nx * length;
            normals[1][lane] = ny * length;
            let off = nx * (points[0][lane] - means[0] as f32) + ny * (points[1][lane] - means[1] as f32);
            let towards_line = off * noise_share as f32;
            points[0][lane] -= nx * towards_line;
            points[1][lane] -= ny * towards_line;
        }
        let [x_m, y_m] = points;
        let [normal_x, normal_y] = normals;
        [x_m, y_m, normal_x, normal_y]
    }
}
