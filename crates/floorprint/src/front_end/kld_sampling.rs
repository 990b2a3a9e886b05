//! How many particles a belief needs: KLD sampling (Fox 2003, "Adapting the sample size in
//! particle filters through KLD-sampling").
//!
//! Enough are drawn that, with the probability of the quantile, the sampled belief lies within the
//! allowed Kullback–Leibler divergence of the true one, both seen as histograms over bins of poses.

use super::AdaptiveConfig;
use crate::geometry::{Pose2, wrap_angle};
use rand::{Rng, RngExt};
use std::collections::BTreeSet;

/// A bin of poses: column, row and sector.
type Bin = [i64; 3];

/// The bin of a pose. Bins lie around the mean: on a grid with fixed edges a belief of a few
/// millimetres could take up eight bins, and would seem to need as many particles.
fn bin_of(pose: &Pose2, mean: &Pose2, config: &AdaptiveConfig) -> Bin {
    let sector = wrap_angle(pose.theta - mean.theta) / config.bin_rad;
    [(pose.x - mean.x) / config.bin_m, (pose.y - mean.y) / config.bin_m, sector].map(|bins| bins.round() as i64)
}

/// The weighted mean of poses; headings are averaged as directions.
fn mean_pose(poses: &[Pose2], weights: &[f64]) -> Pose2 {
    let mean = |value: fn(&Pose2) -> f64| -> f64 {
        poses.iter().zip(weights).map(|(pose, weight)| weight * value(pose)).sum()
    };
    let heading = mean(|pose| pose.theta.sin()).atan2(mean(|pose| pose.theta.cos()));
    Pose2::new(mean(|pose| pose.x), mean(|pose| pose.y), heading)
}

/// The number of particles that the belief of `poses` with `weights` (which sum to one) needs.
///
/// Poses are drawn until there are enough for the bins that they fell into.
#[must_use]
pub fn particles_needed(poses: &[Pose2], weights: &[f64], config: &AdaptiveConfig, random: &mut impl Rng) -> usize {
    let (least, most) = (config.least.max(1), config.most.max(config.least).max(1));
    let mut ends = Vec::with_capacity(weights.len());
    let mut covered = 0.0;
    for weight in weights {
        covered += weight;
        ends.push(covered);
    }
    let mean = mean_pose(poses, weights);
    let mut bins = BTreeSet::new();
    let (mut drawn, mut needed) = (0, least);
    while drawn < needed {
        let point = random.random::<f64>() * covered;
        let chosen = ends.partition_point(|end| *end <= point).min(poses.len().saturating_sub(1));
        let Some(pose) = poses.get(chosen) else { break };
        drawn += 1;
        if bins.insert(bin_of(pose, &mean, config)) {
            needed = for_bins(bins.len(), config).clamp(least, most);
        }
    }
    needed
}

fn for_bins(bins: usize, config: &AdaptiveConfig) -> usize {
    if bins < 2 {
        return 1;
    }
    samples_for_bins(bins as f64, config.error, config.quantile_sigmas).ceil().max(1.0) as usize
}

/// Fox's eq. 7: the number of samples for as many `bins`, two or more, so that the Kullback–Leibler divergence is at most
/// `error` with the probability of a quantile, in standard deviations (by Wilson and Hilferty's approximation of χ²).
#[must_use]
pub(crate) fn samples_for_bins(bins: f64, error: f64, quantile_sigmas: f64) -> f64 {
    let freedom = bins - 1.0;
    let spread = 2.0 / (9.0 * freedom);
    let root = 1.0 - spread + spread.sqrt() * quantile_sigmas;
    freedom / (2.0 * error) * root.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stage, generator};
    use proptest::prelude::*;

    fn needed(poses: &[Pose2], config: &AdaptiveConfig) -> usize {
        let weights = vec![1.0 / poses.len() as f64; poses.len()];
        particles_needed(poses, &weights, config, &mut generator(1, Stage::Resampling, 0, 1))
    }

    fn spread_over(metres: f64, count: usize) -> Vec<Pose2> {
        (0..count).map(|k| Pose2::new(metres * k as f64 / count as f64, 0.0, 0.0)).collect()
    }

    #[test]
    fn two_bins_need_what_the_paper_s_formula_says() {
        // χ²(1 degree of freedom, 99 %) = 6.635: 6.635 / (2 · 0.05) = 66; the approximation is good to 2 %.
        let config = AdaptiveConfig { error: 0.05, quantile_sigmas: 2.326, ..AdaptiveConfig::default() };
        assert!((64..=68).contains(&for_bins(2, &config)), "{}", for_bins(2, &config));
        // χ²(50, 99 %) = 76.15.
        assert!((758..=765).contains(&for_bins(51, &config)), "{}", for_bins(51, &config));
    }

    #[test]
    fn a_certain_belief_needs_few_and_a_wide_one_many() {
        let config = AdaptiveConfig { least: 3, most: 500, ..AdaptiveConfig::default() };
        assert_eq!(needed(&vec![Pose2::new(0.01, 0.01, 0.001); 100], &config), 3);
        let counts: Vec<usize> = [0.3, 1.0, 5.0].map(|metres| needed(&spread_over(metres, 200), &config)).to_vec();
        assert!(3 < counts[0] && counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    }

    #[test]
    fn a_narrow_belief_takes_up_one_bin_wherever_it_lies() {
        let config = AdaptiveConfig { least: 2, most: 500, ..AdaptiveConfig::default() };
        for corner in [-0.05, 0.0, 0.05, 0.1] {
            let around =
                |k: usize| Pose2::new(corner + 0.002 * k as f64, corner, std::f64::consts::PI + 0.001 * k as f64);
            let poses: Vec<Pose2> = (0..10).map(|k| around(k).compose(&Pose2::new(0.0, -0.01, -0.005))).collect();
            assert_eq!(needed(&poses, &config), 2, "around {corner}");
        }
    }

    proptest! {
        #[test]
        fn bounds_hold_whatever_the_belief(
            poses in prop::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64, -3.0..3.0_f64), 1..80),
            least in 1..40_usize, more in 0..60_usize, error in 0.005..0.5_f64
        ) {
            let poses: Vec<Pose2> = poses.into_iter().map(|(x, y, theta)| Pose2::new(x, y, theta)).collect();
            let config = AdaptiveConfig { least, most: least + more, error, ..AdaptiveConfig::default() };
            prop_assert!((least..=least + more).contains(&needed(&poses, &config)));
        }
    }
}
