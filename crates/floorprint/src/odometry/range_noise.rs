//! How noisy a LiDAR's ranges are, learnt from its scans.

use crate::sensors::ScanGeometry;
use multiversion::multiversion;
use std::collections::VecDeque;

/// Returns that are farther from each other than this do not lie on one surface, metres …
const NEXT_M: f32 = 0.5;
/// … and fewer triples of neighbouring returns than this do not tell noise from shape.
const LEAST_TRIPLES: usize = 20;
/// The noise is what it was in this many scans: rain and dirt come and go, a hedge is passed in a few seconds.
const SCANS: usize = 400;
/// Fewer scans than this may all show the same hedge.
const LEAST_SCANS: usize = 10;

/// What each triple of neighbouring rays says of the noise: on a wall the inverse of the range is a sinusoid over the angle,
/// `1/r = a cos θ + b sin θ`, so that `sin(θ₂−θ₁)/r₀ − sin(θ₂−θ₀)/r₁ + sin(θ₁−θ₀)/r₂ = 0` whatever its direction and distance.
#[derive(Debug, Clone)]
pub(super) struct RangeBends {
    /// The three factors of each triple, scaled so that independent errors of a standard deviation of 1 make one of 1; by
    /// factor.
    factors: [Vec<f32>; 3],
    /// The angle from each ray to the next.
    steps_rad: Vec<f32>,
}

impl RangeBends {
    pub(super) fn new(geometry: &ScanGeometry) -> Self {
        let angles = &geometry.angles_rad;
        let factor = |which: usize| {
            let of_triple = |angles: &[f64]| {
                let sines = [angles[2] - angles[1], angles[0] - angles[2], angles[1] - angles[0]].map(f64::sin);
                let norm = sines.iter().map(|sine| sine * sine).sum::<f64>().sqrt().max(1e-9);
                (sines[which] / norm) as f32
            };
            angles.windows(3).map(of_triple).collect()
        };
        let steps_rad = angles.windows(2).map(|angles| (angles[1] - angles[0]) as f32).collect();
        Self { factors: [0, 1, 2].map(factor), steps_rad }
    }

    /// The standard deviation that one scan's ranges show, metres, given which of them are hits; `None` where too few rays end
    /// next to each other. A quarter of the triples decides, so that edges and clutter say nothing as long as a part of what is
    /// seen is smooth.
    pub(super) fn noise_m(&self, ranges_m: &[f32], are_hits: &[bool]) -> Option<f32> {
        let mut bends = bends_of(self, ranges_m, are_hits);
        if bends.len() < LEAST_TRIPLES {
            return None;
        }
        let quarter = bends.len() / 4;
        Some(f32::from_bits(*bends.select_nth_unstable(quarter).1) * SIGMAS_PER_QUARTILE)
    }
}

/// By how much each ray on a surface differs from what the rays beside it make of that surface: metres, as bits, which are in
/// the order of the numbers where none is negative. In passes over all rays that the compiler turns into vectors' instructions.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn bends_of(bends: &RangeBends, ranges_m: &[f32], are_hits: &[bool]) -> Vec<u32> {
    let rays = ranges_m.len().min(are_hits.len()).min(bends.steps_rad.len() + 1);
    if rays < 3 {
        return Vec::new();
    }
    let (ranges_m, are_hits) = (&ranges_m[..rays], &are_hits[..rays]);
    let pairs = ranges_m[..rays - 1].iter().zip(&ranges_m[1..]);
    let are_next: Vec<bool> = pairs
        .zip(are_hits[..rays - 1].iter().zip(&are_hits[1..]))
        .zip(&bends.steps_rad[..rays - 1])
        .map(|(((&here, &there), (&is_hit_here, &is_hit_there)), &step_rad)| {
            let across = here * there * step_rad * step_rad;
            is_hit_here & is_hit_there & ((here - there) * (here - there) + across < NEXT_M * NEXT_M)
        })
        .collect();
    let [a, b, c] = bends.factors.each_ref().map(|factors| &factors[..rays - 2]);
    let triples = ranges_m[..rays - 2].iter().zip(&ranges_m[1..rays - 1]).zip(&ranges_m[2..]);
    let mut result: Vec<u32> = triples
        .zip(a.iter().zip(b).zip(c))
        .map(|(((last_m, middle_m), next_m), ((a, b), c))| {
            let bend_m = (a / last_m + b / middle_m + c / next_m) * middle_m * middle_m;
            bend_m.abs().to_bits()
        })
        .collect();
    // Those of three rays on one surface, moved to the front.
    let mut count = 0;
    for triple in 0..rays - 2 {
        result[count] = result[triple];
        count += usize::from(are_next[triple] & are_next[triple + 1]);
    }
    result.truncate(count);
    result
}

/// A standard deviation as a multiple of the lower quartile of absolute values, if they are those of Gaussian numbers.
const SIGMAS_PER_QUARTILE: f32 = 3.138;

/// The noise of one LiDAR.
#[derive(Debug, Clone, Default)]
pub(super) struct RangeNoise {
    /// What the newest scans showed, metres …
    shown_m: VecDeque<f32>,
    /// … and the same in ascending order.
    ascending_m: Vec<f32>,
}

impl RangeNoise {
    /// Learns what a scan shows, if anything.
    pub(super) fn learn(&mut self, shown_m: Option<f32>) {
        let Some(shown_m) = shown_m else { return };
        if self.shown_m.len() == SCANS
            && let Some(oldest_m) = self.shown_m.pop_front()
        {
            self.ascending_m.remove(self.rank(oldest_m));
        }
        self.ascending_m.insert(self.rank(shown_m), shown_m);
        self.shown_m.push_back(shown_m);
    }

    /// How many of the newest scans showed less.
    fn rank(&self, shown_m: f32) -> usize {
        self.ascending_m.partition_point(|other_m| other_m.total_cmp(&shown_m).is_lt())
    }

    /// The standard deviation of the ranges, metres: what the smoothest quarter of the scans stays below; 0 before some told.
    pub(super) fn sigma_m(&self) -> f32 {
        if self.ascending_m.len() < LEAST_SCANS { 0.0 } else { self.ascending_m[self.ascending_m.len() / 4] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stage, generator};
    use proptest::prelude::*;
    use rand_distr::{Distribution, StandardNormal};

    fn geometry(rays: usize, field_of_view_rad: f64) -> ScanGeometry {
        let angle = |ray: usize| (ray as f64 / (rays - 1) as f64 - 0.5) * field_of_view_rad;
        ScanGeometry {
            angles_rad: (0..rays).map(angle).collect(),
            time_offsets_s: vec![0.0; rays],
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return: false,
        }
    }

    /// Ranges to a wall whose normal has a direction, every one noisy.
    fn ranges_m(geometry: &ScanGeometry, distance_m: f64, normal_rad: f64, noise_m: f64, seed: u64) -> Vec<f32> {
        let mut random = generator(seed, Stage::Sensors, 0, 0);
        let angles = geometry.angles_rad.iter();
        angles
            .map(|angle| {
                let error: f64 = StandardNormal.sample(&mut random);
                let cos = (angle - normal_rad).cos();
                if cos < 0.1 { f32::INFINITY } else { (distance_m / cos + noise_m * error) as f32 }
            })
            .collect()
    }

    fn within(ranges_m: &[f32], limits_m: std::ops::Range<f32>) -> Vec<bool> {
        ranges_m.iter().map(|range_m| limits_m.contains(range_m)).collect()
    }

    proptest! {
        #[test]
        fn the_noise_shows_on_walls_of_any_direction_and_distance(
            rays in 150..1500_usize,
            distance_m in 0.5..8.0_f64,
            normal_rad in -1.0..1.0_f64,
            noise_m in 0.002..0.1_f64,
            seed in any::<u64>(),
        ) {
            let geometry = geometry(rays, 3.0);
            let bends = RangeBends::new(&geometry);
            let mut noise = RangeNoise::default();
            for scan in 0..20 {
                let ranges = ranges_m(&geometry, distance_m, normal_rad, noise_m, seed ^ scan);
                noise.learn(bends.noise_m(&ranges, &within(&ranges, 0.0..30.0)));
                prop_assert!((scan as usize + 1 >= LEAST_SCANS) == (noise.sigma_m() > 0.0));
            }
            let sigma_m = f64::from(noise.sigma_m());
            prop_assert!((0.6..1.2).contains(&(sigma_m / noise_m)), "{} for {}", sigma_m, noise_m);
        }
    }

    /// Half of what is seen is a hedge, and for half of the time nothing else.
    #[test]
    fn hedges_are_no_noise() {
        let geometry = geometry(361, 3.0);
        let bends = RangeBends::new(&geometry);
        let mut noise = RangeNoise::default();
        for scan in 0..40 {
            let hedge = if scan < 20 { 0..361 } else { 0..180 };
            let mut ranges = ranges_m(&geometry, 3.0, 0.0, 0.01, scan);
            hedge.for_each(|ray| ranges[ray] += ((ray * 7919) % 40) as f32 * 0.01);
            noise.learn(bends.noise_m(&ranges, &within(&ranges, 0.0..30.0)));
        }
        assert!(noise.sigma_m() < 0.03, "{} m", noise.sigma_m());
    }

    #[test]
    fn a_lidar_that_becomes_noisy_is_found_out() {
        let mut noise = RangeNoise::default();
        (0..5 * SCANS).for_each(|_| noise.learn(Some(0.01)));
        assert_eq!(noise.sigma_m(), 0.01);
        (0..SCANS).for_each(|_| noise.learn(Some(0.05)));
        assert_eq!(noise.sigma_m(), 0.05);
    }

    #[test]
    fn few_rays_and_none_tell_nothing() {
        let few = geometry(12, 3.0);
        assert_eq!(RangeBends::new(&few).noise_m(&[1.0; 12], &[true; 12]), None);
        let many = geometry(361, 3.0);
        for ranges in [vec![], vec![1.0; 5], vec![f32::NAN; 361], vec![f32::INFINITY; 361], vec![0.0; 400]] {
            assert_eq!(RangeBends::new(&many).noise_m(&ranges, &within(&ranges, 0.1..30.0)), None);
        }
    }
}
