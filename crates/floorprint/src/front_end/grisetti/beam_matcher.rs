//! GMapping's scan matcher: each ray's end is compared with the fronts of walls near it, and
//! the pose climbs to where most ends fit (Grisetti, Stachniss & Burgard 2007, §III).

use super::GrisettiConfig;
use crate::frame::BodyScan;
use crate::geometry::{Pose2, wrap_angle};
use crate::map::HitGrid;
use nalgebra::{Matrix3, Vector3};

/// How far before a ray's end the cell lies that has to be free, cells (freeCellRatio in GMapping).
const FREE_BEFORE_CELLS: f64 = std::f64::consts::SQRT_2;

/// A ray in the body's frame.
#[derive(Debug, Clone, Copy)]
struct Beam {
    /// Where it ends, metres.
    end_m: [f64; 2],
    /// From there back to the cell that has to be free, metres.
    back_m: [f64; 2],
}

/// A scan, ready to be compared with maps.
#[derive(Debug)]
pub(super) struct BeamMatcher<'a> {
    config: &'a GrisettiConfig,
    beams: Vec<Beam>,
}

/// A Gaussian over poses and what it integrates to.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseGaussian {
    pub(super) mean: Pose2,
    pub(super) covariance: Matrix3<f64>,
    /// Logarithm of the sum of the densities that it was made from.
    pub(super) log_evidence: f64,
}

impl<'a> BeamMatcher<'a> {
    pub(super) fn new(scan: &BodyScan, config: &'a GrisettiConfig) -> Self {
        let [origin_x, origin_y] = scan.origin_m;
        let beam = |[x, y]: [f32; 2]| {
            let (x, y) = (f64::from(x), f64::from(y));
            let back = -FREE_BEFORE_CELLS * config.cell_m / (x - origin_x).hypot(y - origin_y).max(f64::MIN_POSITIVE);
            Beam { end_m: [x, y], back_m: [(x - origin_x) * back, (y - origin_y) * back] }
        };
        Self { config, beams: scan.hits.iter().map(beam).collect() }
    }

    /// For each ray, seen from `pose`, the squared distance to the map's nearest front, m².
    fn squared_distances(&self, map: &HitGrid, pose: &Pose2) -> impl Iterator<Item = Option<f32>> {
        let (sin, cos) = pose.theta.sin_cos();
        let rotate = move |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        self.beams.iter().map(move |beam| {
            let ([x, y], [back_x, back_y]) = (rotate(beam.end_m), rotate(beam.back_m));
            let (x, y) = (pose.x + x, pose.y + y);
            map.squared_distance([x, y], [x + back_x, y + back_y])
        })
    }

    /// The hill climb's measure: the sum over rays of exp(−d²/σ).
    fn score(&self, map: &HitGrid, pose: &Pose2) -> f64 {
        let scale = -1.0 / self.config.score_square_m2 as f32;
        self.squared_distances(map, pose).flatten().map(|square| f64::from((scale * square).exp())).sum()
    }

    /// Logarithm of p(scan | map, pose), up to a constant.
    pub(super) fn log_likelihood(&self, map: &HitGrid, pose: &Pose2) -> f64 {
        let missed = self.config.missed_square_m2;
        let total: f64 = self.squared_distances(map, pose).map(|square| square.map_or(missed, f64::from)).sum();
        -total / self.config.likelihood_square_m2
    }

    /// Share of the rays that end near something in the map, and the mean score of all.
    pub(super) fn fit(&self, map: &HitGrid, pose: &Pose2) -> (f64, f64) {
        let count = self.beams.len().max(1) as f64;
        let near = self.squared_distances(map, pose).flatten().count();
        (near as f64 / count, self.score(map, pose) / count)
    }

    /// The pose that steps uphill from `start` lead to; `None` where too little of the scan fits.
    ///
    /// The best of six steps (each way along x, y and θ) is taken while it leads up; else the
    /// steps are halved.
    pub(super) fn climb(&self, map: &HitGrid, start: &Pose2) -> Option<Pose2> {
        let (mut step_m, mut step_rad) = (self.config.step_m, self.config.step_rad);
        let mut best = (*start, self.score(map, start));
        let mut halvings = 0;
        loop {
            let Pose2 { x, y, theta } = best.0;
            let before = best.1;
            for [dx, dy, turn] in [
                [step_m, 0.0, 0.0],
                [-step_m, 0.0, 0.0],
                [0.0, -step_m, 0.0],
                [0.0, step_m, 0.0],
                [0.0, 0.0, step_rad],
                [0.0, 0.0, -step_rad],
            ] {
                let pose = Pose2::new(x + dx, y + dy, theta + turn);
                let score = self.score(map, &pose);
                if score > best.1 {
                    best = (pose, score);
                }
            }
            if best.1 <= before {
                if halvings == self.config.halvings {
                    break;
                }
                halvings += 1;
                step_m *= 0.5;
                step_rad *= 0.5;
            }
        }
        (best.1 > self.config.minimum_score).then_some(best.0)
    }

    /// The Gaussian that samples around `optimum` make (the paper's eqs. 15–17): p(scan | map, pose)
    /// times `log_prior`, at the optimum and to either side of it in x, y and θ.
    pub(super) fn proposal(&self, map: &HitGrid, optimum: &Pose2, log_prior: impl Fn(&Pose2) -> f64) -> PoseGaussian {
        let (m, rad) = (self.config.sample_m, self.config.sample_rad);
        let mut samples = Vec::with_capacity(27);
        for x in [-m, 0.0, m] {
            for y in [-m, 0.0, m] {
                for theta in [-rad, 0.0, rad] {
                    let pose = Pose2::new(optimum.x + x, optimum.y + y, optimum.theta + theta);
                    samples.push((Vector3::new(x, y, theta), self.log_likelihood(map, &pose) + log_prior(&pose)));
                }
            }
        }
        let largest = samples.iter().map(|(_, log_density)| *log_density).fold(f64::NEG_INFINITY, f64::max);
        let densities = || samples.iter().map(|(offset, log_density)| (offset, (log_density - largest).exp()));
        let total: f64 = densities().map(|(_, density)| density).sum();
        let mean = densities().fold(Vector3::zeros(), |sum, (offset, density)| sum + offset * (density / total));
        let covariance = densities().fold(Matrix3::zeros(), |sum, (offset, density)| {
            let off = offset - mean;
            sum + off * off.transpose() * (density / total)
        });
        PoseGaussian {
            mean: Pose2 { x: optimum.x + mean.x, y: optimum.y + mean.y, theta: wrap_angle(optimum.theta + mean.z) },
            covariance,
            log_evidence: total.ln() + largest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Two walls at right angles, seen from the origin.
    fn corner() -> BodyScan {
        let mut scan = BodyScan::default();
        for k in 0..120 {
            let along = -1.5 + 0.03 * k as f32;
            scan.hits.push(2.03, along);
            scan.hits.push(along, 2.03);
        }
        scan
    }

    /// One long wall.
    fn wall() -> BodyScan {
        let mut scan = BodyScan::default();
        (0..300).for_each(|k| scan.hits.push(-3.0 + 0.02 * k as f32, 1.02));
        scan
    }

    fn map_of(scan: &BodyScan, config: &GrisettiConfig) -> HitGrid {
        let mut map = HitGrid::new(config.cell_m, config.full_share);
        map.add_scan(&Pose2::IDENTITY, scan, false);
        map
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_climb_finds_back_to_where_the_scan_was_taken(
            x in -0.1..0.1_f64, y in -0.1..0.1_f64, theta in -0.04..0.04_f64
        ) {
            let (config, scan) = (GrisettiConfig::default(), corner());
            let (map, matcher) = (map_of(&scan, &config), BeamMatcher::new(&scan, &config));
            let start = Pose2::new(x, y, theta);
            let found = matcher.climb(&map, &start).unwrap();
            prop_assert!(matcher.score(&map, &found) >= matcher.score(&map, &start));
            prop_assert!(found.distance() < 0.02 && found.theta.abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn nothing_to_match_is_a_failure() {
        let config = GrisettiConfig::default();
        let map = HitGrid::new(config.cell_m, config.full_share);
        assert_eq!(BeamMatcher::new(&corner(), &config).climb(&map, &Pose2::IDENTITY), None);
        let map = map_of(&corner(), &config);
        assert_eq!(BeamMatcher::new(&BodyScan::default(), &config).climb(&map, &Pose2::IDENTITY), None);
    }

    #[test]
    fn along_a_wall_the_proposal_is_as_wide_as_its_samples() {
        let (config, scan) = (GrisettiConfig::default(), wall());
        let (map, matcher) = (map_of(&scan, &config), BeamMatcher::new(&scan, &config));
        let gaussian = matcher.proposal(&map, &Pose2::IDENTITY, |_| 0.0);
        // Three equal samples at −s, 0, s have the variance 2/3 s².
        let widest = 2.0 / 3.0 * config.sample_m.powi(2);
        assert!(gaussian.covariance[(0, 0)] > 0.9 * widest);
        assert!(gaussian.covariance[(1, 1)] < gaussian.covariance[(0, 0)]);
        let pulled = matcher.proposal(&map, &Pose2::IDENTITY, |pose| 1000.0 * pose.x);
        assert!(pulled.mean.x > 0.009 && pulled.log_evidence > gaussian.log_evidence);
    }
}
