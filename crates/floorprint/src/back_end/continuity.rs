//! Whether a drive goes on after an interruption as if nothing had happened.
//!
//! A robot that was not carried sees on the way on what it saw before. How much of it looks the same then depends on the place
//! and on the LiDAR: less among trees, in crowds and with noise than in an empty building. The drive itself tells what is
//! ordinary: by the submaps before, which follow each other without an interruption.

use super::submap::Submap;
use super::view_cache::ViewCache;
use crate::geometry::Pose2;
use crate::scan_matcher::MatcherConfig;
use std::sync::Arc;

/// So many of the newest pairs of submaps tell what is ordinary here.
const PAIRS: usize = 4;
/// … of so many at most that are looked at: some have too little in common.
const PAIRS_LOOKED_AT: usize = 8;
/// How the likeness of such pairs scatters before any is known, standard deviation, and how many pairs that counts for.
const PRIOR_SIGMA: f64 = 0.05;
const PRIOR_PAIRS: f64 = 4.0;

/// By how many standard deviations less than is ordinary for the drive a submap that lies as `previous_from_submap` says on the
/// one before it looks like it: infinitely many where nothing is in view that was so before. `None` where nothing is known to be
/// ordinary.
pub(super) fn discontinuity(
    newer: usize,
    previous_from_submap: &Pose2,
    submaps: &[Arc<Submap>],
    views: &mut ViewCache,
    matcher: &MatcherConfig,
) -> Option<f64> {
    let follows = |number: usize| {
        let [before, here] = [&submaps[number - 1], &submaps[number]];
        here.interruption.is_none() && !here.is_forgotten() && !before.is_forgotten()
    };
    let pairs = (1..newer).rev().filter(|&number| follows(number));
    let links = pairs.filter_map(|number| submaps[number].link.map(|link| (number, link.previous_from_submap)));
    let mut likeness = |number: usize, pose: &Pose2| views.likeness(submaps, [number - 1, number], pose, matcher);
    let ordinary = links.take(PAIRS_LOOKED_AT).filter_map(|(number, pose)| likeness(number, &pose));
    let ordinary: Vec<f64> = ordinary.take(PAIRS).collect();
    let [mean, sigma] = mean_and_sigma(&ordinary)?;
    Some(likeness(newer, previous_from_submap).map_or(f64::INFINITY, |here| (mean - here) / sigma))
}

/// Mean and standard deviation of what is ordinary; `None` where there is nothing to go by.
fn mean_and_sigma(ordinary: &[f64]) -> Option<[f64; 2]> {
    let count = ordinary.len() as f64;
    let mean = ordinary.iter().sum::<f64>() / count;
    let squares: f64 = ordinary.iter().map(|share| (share - mean).powi(2)).sum();
    let variance = (squares + PRIOR_PAIRS * PRIOR_SIGMA.powi(2)) / (count + PRIOR_PAIRS);
    (!ordinary.is_empty()).then(|| [mean, variance.sqrt()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ordinary_is_what_the_drive_was_like() {
        assert_eq!(mean_and_sigma(&[]), None);
        let [few, even] = [[0.97; 1].as_slice(), &[0.97; 12]].map(|shares| mean_and_sigma(shares).unwrap());
        assert!(few[1] > 0.04 && even[1] < 0.03 && few[1] < PRIOR_SIGMA, "{few:?} {even:?}");
        let uneven = mean_and_sigma(&[0.6, 0.8, 0.7, 0.7, 0.6, 0.8]).unwrap();
        assert!((uneven[0] - 0.7).abs() < 1e-9 && uneven[1] > 2.0 * even[1], "{uneven:?}");
    }
}
