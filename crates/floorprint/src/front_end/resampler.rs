//! Drawing particles anew in proportion to their weights (Douc, Cappé & Moulines 2005).

use super::kld_sampling::particles_needed;
use super::{FilterConfig, ResamplerKind};
use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use rand::{Rng, RngExt};

/// The particles that go on from `step`: for each the index of the old one that it copies, ascending;
/// as many as before, or as many as the belief needs ([`particles_needed`]).
///
/// `poses` and `weights`, which sum to one, are those of the old particles.
pub(super) fn resample_poses(
    config: &FilterConfig,
    poses: &[Pose2],
    weights: &[f64],
    seed: u64,
    step: u64,
) -> Vec<usize> {
    let count = if config.adaptive.enabled {
        particles_needed(poses, weights, &config.adaptive, &mut generator(seed, Stage::Resampling, step, 1))
    } else {
        weights.len()
    };
    resample(config.resampler, weights, count, &mut generator(seed, Stage::Resampling, step, 0))
}

/// For each of `count` new particles the index of the old one that it copies, ascending.
///
/// `weights` sum to one.
#[must_use]
pub fn resample(kind: ResamplerKind, weights: &[f64], count: usize, random: &mut impl Rng) -> Vec<usize> {
    match kind {
        ResamplerKind::Stratified => {
            let points: Vec<f64> = (0..count).map(|k| (k as f64 + random.random::<f64>()) / count as f64).collect();
            select(weights, &points)
        }
        ResamplerKind::Systematic => {
            let offset: f64 = random.random();
            let points: Vec<f64> = (0..count).map(|k| (k as f64 + offset) / count as f64).collect();
            select(weights, &points)
        }
        ResamplerKind::Residual => residual(weights, count, random),
    }
}

/// Whole shares of N·w are copied; what remains is drawn by chance from the fractions.
fn residual(weights: &[f64], count: usize, random: &mut impl Rng) -> Vec<usize> {
    let shares: Vec<f64> = weights.iter().map(|weight| weight * count as f64).collect();
    let mut chosen: Vec<usize> =
        shares.iter().enumerate().flat_map(|(index, share)| vec![index; share.floor() as usize]).collect();
    chosen.truncate(count);
    let missing = count - chosen.len();
    let fractions: Vec<f64> = shares.iter().map(|share| share.fract()).collect();
    let total: f64 = fractions.iter().sum();
    if missing > 0 {
        let rest: Vec<f64> = fractions.iter().map(|fraction| fraction / total.max(f64::MIN_POSITIVE)).collect();
        let points: Vec<f64> = (0..missing).map(|k| (k as f64 + random.random::<f64>()) / missing as f64).collect();
        chosen.extend(select(&rest, &points));
        chosen.sort_unstable();
    }
    chosen
}

/// For each of the ascending `points` of [0, 1) the index of the weight in whose share it lies.
fn select(weights: &[f64], points: &[f64]) -> Vec<usize> {
    let mut index = 0;
    let mut covered = weights[0];
    points
        .iter()
        .map(|point| {
            while covered <= *point && index + 1 < weights.len() {
                index += 1;
                covered += weights[index];
            }
            index
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::front_end::weights::normalise;
    use proptest::prelude::*;

    const KINDS: [ResamplerKind; 3] = [ResamplerKind::Stratified, ResamplerKind::Systematic, ResamplerKind::Residual];

    proptest! {
        #[test]
        fn as_many_as_asked_for_in_order_and_near_their_share(
            mut log_weights in prop::collection::vec(-4.0..4.0_f64, 1..60), count in 1..90_usize, seed in 0..1000_u64
        ) {
            let weights = normalise(&mut log_weights);
            for kind in KINDS {
                let chosen = resample(kind, &weights, count, &mut generator(seed, Stage::Resampling, 0, 0));
                prop_assert_eq!(chosen.len(), count);
                prop_assert!(chosen.is_sorted());
                let mut copies = vec![0.0; weights.len()];
                chosen.iter().for_each(|&index| copies[index] += 1.0);
                for (copies, weight) in copies.iter().zip(&weights) {
                    let share = weight * count as f64;
                    // Systematic gives floor or ceil of the share, the other two stay within two of it.
                    let slack = if kind == ResamplerKind::Systematic { 1.0 } else { 2.0 };
                    prop_assert!((copies - share).abs() < slack + 1e-9);
                }
            }
        }
    }

    #[test]
    fn resampling_keeps_the_mean() {
        let mut log_weights: Vec<f64> = (0..20).map(|k| (1.0 + k as f64).ln()).collect();
        let weights = normalise(&mut log_weights);
        let mean: f64 = weights.iter().enumerate().map(|(index, weight)| index as f64 * weight).sum();
        for kind in KINDS {
            let runs = 2000;
            let total: f64 = (0..runs)
                .map(|run| {
                    let chosen = resample(kind, &weights, 20, &mut generator(run, Stage::Resampling, 1, 0));
                    chosen.iter().sum::<usize>() as f64 / 20.0
                })
                .sum();
            assert!((total / runs as f64 - mean).abs() < 0.05, "{kind:?}");
        }
    }

    #[test]
    fn a_particle_with_all_the_weight_takes_every_place() {
        for kind in KINDS {
            let chosen = resample(kind, &[0.0, 1.0, 0.0], 3, &mut generator(7, Stage::Resampling, 0, 0));
            assert_eq!(chosen, [1, 1, 1]);
        }
    }
}
