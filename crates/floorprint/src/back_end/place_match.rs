//! Whether two submaps show the same place, and how they then lie to each other.
//!
//! Within the region that the drift allows the newer submap is searched for on the older one by
//! branch and bound; what is found is fitted finely and checked both ways: of all that each shows
//! of the region that the other had in view, most must be there. Several places apart from each
//! other may pass: which of them is right is not decided here.

use super::submap::Submap;
use super::uncertainty::Uncertainty;
use super::view_cache::View;
use super::{LoopClosureConfig, Verdict};
use crate::geometry::covariance::in_frame_of;
use crate::geometry::{Pose2, wrap_angle};
use crate::scan_matcher::{MatchResult, MatcherConfig, PoseBelief, match_scan, without_hearsay};
use crate::surface::SurfaceScan;
use nalgebra::{Matrix3, Vector2};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A newer submap compared with an older one.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Comparison {
    /// The older submap.
    pub older: usize,
    /// The newer submap.
    pub newer: usize,
    /// Where the newer one was thought to lie: older from newer.
    pub expected: Pose2,
    /// How sure that was.
    pub uncertainty: Uncertainty,
    /// Where it may lie, the best fit first; at least one.
    pub placements: Vec<Placement>,
    /// Of a submap after an interruption, compared with the one right before it: by how many standard deviations it looks less
    /// like it, at the best placement, than is ordinary for the drive. `None` of others, and where nothing is known to be ordinary.
    #[serde(default)]
    pub discontinuity: Option<f64>,
}

/// Where a newer submap may lie on an older one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// Older from newer.
    pub older_from_newer: Pose2,
    /// Covariance of that in the axes of the newer one, m² and rad².
    pub covariance: Matrix3<f64>,
    /// Share of the newer one's surfaces that the older one had in view, and the other way round.
    pub overlap_shares: [f64; 2],
    /// Share of those that lie on surfaces of the other.
    pub inlier_shares: [f64; 2],
    /// How much more of the newer one fits here than at any place a little farther on: along a bare corridor every
    /// place fits, so that a fit says nothing about where along it the robot is.
    pub distinctness: f64,
    /// What is wrong with it; [`Verdict::Accepted`] where nothing is.
    pub verdict: Verdict,
}

impl Placement {
    /// How much fits, both ways, from 0 to 1.
    #[must_use]
    pub fn quality(&self) -> f64 {
        0.5 * (self.inlier_shares[0] + self.inlier_shares[1])
    }

    /// Standard deviation of the position in the direction in which it is the least certain, metres.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.least_certain().0.sqrt()
    }

    /// The direction in which the position is the least certain, in the axes of the newer one, with the variance, m².
    fn least_certain(&self) -> (f64, Vector2<f64>) {
        let eigen = self.covariance.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
        let largest = eigen.eigenvalues.imax();
        (eigen.eigenvalues[largest], eigen.eigenvectors.column(largest).into_owned())
    }

    /// Whether it passed all tests.
    #[must_use]
    pub fn fits(&self) -> bool {
        self.verdict == Verdict::Accepted
    }
}

/// The two ways round must agree to this, metres and radians.
const AGREEMENT_M: f64 = 0.2;
const AGREEMENT_RAD: f64 = 0.05;
/// Places of which each had less than this share of the other's surfaces in view have too little in common to judge.
const MIN_OVERLAP_SHARE: f64 = 0.25;
/// So far from a place are those from which it must differ to mean anything, metres.
const FARTHER_ON_M: [f64; 6] = [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];

impl Placement {
    pub(super) fn of(fit: &MatchResult, matcher: &MatcherConfig) -> Self {
        let weak = Matrix3::identity() * 1e-3;
        // A second time: the errors of all closures along a corridor point the same way, so that none may say much.
        let scale = without_hearsay(&fit.scan_information, matcher);
        let covariance = (scale * fit.scan_information * scale + weak).try_inverse().unwrap_or_else(Matrix3::identity);
        Self {
            older_from_newer: fit.belief.pose,
            covariance: in_frame_of(&covariance, &fit.belief.pose),
            overlap_shares: [0.0; 2],
            inlier_shares: [0.0; 2],
            distinctness: 0.0,
            verdict: Verdict::DoesNotFit,
        }
    }

    /// Puts the placement to its tests. `views` and `probes`: the older's, the newer's.
    pub(super) fn verify(
        &mut self,
        views: [&View; 2],
        probes: [&SurfaceScan; 2],
        submaps: &[Arc<Submap>],
        config: &LoopClosureConfig,
        matcher: &MatcherConfig,
    ) {
        let newer_from_older = self.older_from_newer.inverse();
        (self.overlap_shares[0], self.inlier_shares[0]) =
            views[0].agreement(probes[1], &self.older_from_newer, submaps, matcher);
        self.verdict = if self.overlap_shares[0] < MIN_OVERLAP_SHARE {
            Verdict::TooLittleInCommon
        } else if self.inlier_shares[0] < config.min_inlier_share {
            Verdict::DoesNotFit
        } else {
            let belief = PoseBelief { pose: newer_from_older, information: Matrix3::zeros() };
            let back = match_scan(&views[1].map, probes[0], &belief, matcher).belief.pose;
            (self.overlap_shares[1], self.inlier_shares[1]) = views[1].agreement(probes[0], &back, submaps, matcher);
            let disagreement = self.older_from_newer.compose(&back);
            if self.overlap_shares[1] < MIN_OVERLAP_SHARE {
                Verdict::TooLittleInCommon
            } else if self.inlier_shares[1] < config.min_inlier_share
                || disagreement.distance() > AGREEMENT_M
                || wrap_angle(disagreement.theta).abs() > AGREEMENT_RAD
            {
                Verdict::DoesNotFitBack
            } else {
                self.distinctness =
                    self.inlier_shares[0] - self.share_farther_on(views[0], probes[1], submaps, matcher);
                Verdict::Accepted
            }
        };
    }

    /// What share of the newer one's surfaces lies on the older one's when it is moved on in the direction in which
    /// the fit is the least certain, at the best of several distances.
    fn share_farther_on(
        &self,
        older: &View,
        newer: &SurfaceScan,
        submaps: &[Arc<Submap>],
        matcher: &MatcherConfig,
    ) -> f64 {
        let (_, direction) = self.least_certain();
        let shares = FARTHER_ON_M.map(|distance_m| {
            let moved = Pose2::new(distance_m * direction[0], distance_m * direction[1], 0.0);
            older.agreement(newer, &self.older_from_newer.compose(&moved), submaps, matcher).1
        });
        shares.into_iter().fold(0.0, f64::max)
    }
}
