//! The key scans since the search began, which every hypothesis has to explain.
//!
//! Hypotheses are only comparable if they speak of the same scans: a place that is proposed late is followed back along
//! the odometry through all that was seen before.

use super::hypothesis::Hypothesis;
use super::localization_map::LocalizationMap;
use super::sensing::Sensing;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic};
use crate::scan_matcher::PoseBelief;
use crate::surface::SurfaceScan;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// A scan that every hypothesis has to explain.
#[derive(Debug, Clone)]
pub(super) struct KeyScan {
    pub(super) scan: Arc<SurfaceScan>,
    /// `odom_from_body`.
    pub(super) odom: Pose2,
    /// Standard deviations of the way since the key scan before, metres and radians.
    pub(super) sigmas: [f64; 2],
}

/// The newest key scans.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    scans: VecDeque<KeyScan>,
}

/// So many are kept.
const MOST: usize = 40;
/// Key scans are this far apart, metres and radians.
pub(super) const SPACING_M: f64 = 0.5;
pub(super) const SPACING_RAD: f64 = 0.35;
/// Rays of a key scan that are independent of each other and of the next key scan.
pub(super) const INDEPENDENT_RAYS: f64 = 6.0;
/// A proposal is within this of the place that it means (standard deviations), metres and radians.
const PROPOSAL_SIGMA_M: f64 = 0.15;
const PROPOSAL_SIGMA_RAD: f64 = 0.05;
/// Fits trust the way from key scan to key scan up to so many standard deviations.
const TRUSTED_SIGMAS: f64 = 3.0;
/// Points of the cloud are thinned to this distance and reach so far, metres.
const CLOUD_SPACING_M: f32 = 0.1;
const CLOUD_REACH_M: f32 = 15.0;

/// Hypotheses with less than this share of the weight of the best are given up (logarithm).
pub(super) const GIVEN_UP: f64 = -20.0;
/// Evidence counts for less by as much as the best hypothesis leaves unexplained itself: the temperature rises by one for
/// each so much of log-likelihood. What differs by less than what is wrong with the map anyway decides nothing.
const UNEXPLAINED: f64 = 30.0;

/// The temperature at which evidence is compared, given the best log-evidence.
pub(super) fn temperature(best: f64) -> f64 {
    1.0 + best.abs() / UNEXPLAINED
}

impl History {
    pub(super) fn len(&self) -> usize {
        self.scans.len()
    }

    pub(super) fn clear(&mut self) {
        self.scans.clear();
    }

    /// Forgets the older half; how many that were.
    pub(super) fn forget_half(&mut self) -> usize {
        let half = self.scans.len() / 2;
        self.scans.drain(..half);
        half
    }

    /// Adds the newest scan; whether the oldest had to go for it.
    pub(super) fn push(&mut self, scan: KeyScan) -> bool {
        self.scans.push_back(scan);
        let is_full = self.scans.len() > MOST;
        if is_full {
            self.scans.pop_front();
        }
        is_full
    }

    /// Where a body at `odom` is seen from the newest key scan.
    pub(super) fn since_newest(&self, odom: &Pose2) -> Option<Pose2> {
        self.scans.back().map(|newest| newest.odom.between(odom))
    }

    /// All that was seen, in the body's frame at the newest key scan.
    pub(super) fn cloud(&self) -> SurfaceScan {
        let Some(newest) = self.scans.back() else { return SurfaceScan::default() };
        let mut cloud = SurfaceScan { origin_m: newest.scan.origin_m, ..SurfaceScan::default() };
        let mut taken = std::collections::BTreeSet::new();
        for key_scan in self.scans.iter().rev() {
            let seen = key_scan.scan.seen_from(&key_scan.odom.between(&newest.odom));
            for ([x, y], [normal_x, normal_y]) in seen.iter() {
                let voxel = [x, y].map(|v| (v / CLOUD_SPACING_M).floor() as i32);
                if x.hypot(y) < CLOUD_REACH_M && taken.insert(voxel) {
                    cloud.x_m.push(x);
                    cloud.y_m.push(y);
                    cloud.normal_x.push(normal_x);
                    cloud.normal_y.push(normal_y);
                }
            }
        }
        cloud
    }

    /// Hypotheses that explain the history, from poses of the body at the newest key scan: each followed back through
    /// it, as long as it does not fall too far behind the best. `ids` are given in order.
    pub(super) fn weigh(
        &self,
        map: &LocalizationMap,
        sensing: &Sensing,
        cloud: &SurfaceScan,
        poses: &[Pose2],
        first_id: u64,
    ) -> Vec<Hypothesis> {
        let Some(newest) = self.scans.back() else { return Vec::new() };
        let near = inverse(&isotropic(PROPOSAL_SIGMA_M, PROPOSAL_SIGMA_RAD));
        let mut followed: Vec<(Hypothesis, Pose2)> = poses
            .par_iter()
            .enumerate()
            .map(|(number, pose)| {
                let prior = PoseBelief { pose: *pose, information: near };
                let of_cloud = sensing.fit(map, cloud, &prior, f64::INFINITY).belief;
                let fit = sensing.fit(map, &newest.scan, &of_cloud, TRUSTED_SIGMAS);
                let covariance = inverse(&fit.belief.information);
                let mut hypothesis = Hypothesis::new(first_id + number as u64, fit.belief.pose, covariance);
                hypothesis.explanation = sensing.explain(map, &newest.scan, &fit.belief.pose);
                hypothesis.usual = Some(hypothesis.explanation);
                hypothesis.scan_information = fit.scan_information;
                hypothesis.evidence.push_front(INDEPENDENT_RAYS * hypothesis.explanation.log_likelihood);
                (hypothesis, fit.belief.pose)
            })
            .collect();
        for number in (1..self.scans.len()).rev() {
            let (later, key_scan) = (&self.scans[number], &self.scans[number - 1]);
            let best = followed.iter().map(|(hypothesis, _)| hypothesis.log_evidence()).fold(f64::MIN, f64::max);
            followed.retain(|(hypothesis, _)| hypothesis.log_evidence() > best + GIVEN_UP * temperature(best));
            let back = later.odom.between(&key_scan.odom);
            let information = inverse(&isotropic(later.sigmas[0], later.sigmas[1]));
            followed.par_iter_mut().for_each(|(hypothesis, pose)| {
                let prior = PoseBelief { pose: pose.compose(&back), information };
                let fit = sensing.fit(map, &key_scan.scan, &prior, TRUSTED_SIGMAS).belief.pose;
                let explanation = sensing.explain(map, &key_scan.scan, &fit);
                let bent = (0.5 * prior.sigmas_to(&fit).powi(2)).ln_1p();
                hypothesis.evidence.push_front(INDEPENDENT_RAYS * explanation.log_likelihood - bent);
                *pose = fit;
            });
        }
        followed.into_iter().map(|(hypothesis, _)| hypothesis).collect()
    }
}
