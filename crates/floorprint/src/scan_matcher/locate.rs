//! Where a scan fits a map: near the odometry's prediction, or, where that fails, anywhere around it.

use super::correlative::{SearchWindow, search};
use super::gauss_newton::{match_few, match_scan_against};
use super::{MatchResult, MatcherConfig, PoseBelief, inlier_share, match_scan};
use crate::geometry::Pose2;
use crate::surface::SurfaceMap;
use crate::surface::SurfaceScan;
use nalgebra::Matrix3;
use std::f64::consts::FRAC_PI_2;

/// Odometry that the scan contradicts by more than this many standard deviations is taken to be wrong.
const TRUSTED_SIGMAS: f64 = 3.0;
/// Candidates of a search that are matched finely.
const CANDIDATES: usize = 4;
/// Fewer points than this fit almost anywhere; they are no reason to doubt the odometry.
pub(crate) const POINTS_TO_SEARCH: usize = 30;
/// A search is widened only if less than this share of the points lies on the map at the prediction: the robot is lost
/// then. It never comes to where the robot has turned round between two scans: a corridor fits the other way round, too. Nor is
/// it widened for the first scan that does not fit while odometry tells the motion: where two corridors meet one of them fits the
/// other.
const LOST: f64 = 0.3;
/// Nor is it widened once this share of the points lies on the map.
const GOOD_ENOUGH: f64 = 0.6;
/// The scan overrules the odometry only if this much more of it fits elsewhere. Less is no proof:
/// where much of what is seen is new, a wrong pose along a corridor gains as much by chance.
const CLEARLY_BETTER: f64 = 0.2;
/// Of a wide search the best place has a third of the scan on the map by chance: so much has to lie there.
const LEAST_PROOF: f64 = 0.5;
/// Where the scan contradicts the odometry, the robot is believed to go on as before even if this much less of it fits there.
const SLIGHTLY: f64 = 0.05;
/// After a search the odometry is believed this much less (as a factor on its information).
const DISTRUST: f64 = 0.01;
/// A contradiction of the odometry is earned if it leaves less than this share of what does not fit where the odometry has the
/// robot …
const LEFT_UNEXPLAINED: f64 = 0.4;
/// … or if the robot has just gone on as before, within this many standard deviations.
const WENT_ON_SIGMAS: f64 = 1.0;

/// What is expected of the pose of a scan before it is looked at.
#[derive(Clone, Copy)]
pub struct Expectation<'a> {
    /// Where the odometry has the robot, or where it goes on as before if nothing measures the motion.
    pub prior: &'a PoseBelief,
    /// Where the robot is if it goes on as in the last step.
    pub continued: &'a PoseBelief,
    /// What of the scan the scans of the map had in view if it was taken at a pose; without it all counts as seen.
    pub seen_before: Option<&'a dyn Fn(&Pose2) -> SurfaceScan>,
    /// Whether the robot may have turned round since the last scan unnoticed.
    pub may_have_turned_round: bool,
}

/// What a scan says of the odometry that predicted its pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OdometryVerdict {
    /// They agree.
    Confirmed,
    /// The scan fits near the prediction, but farther from it than the odometry's noise explains.
    Contradicted,
    /// The scan fits somewhere else altogether.
    Abandoned,
}

/// Where a scan fits a map.
#[derive(Debug, Clone, Copy)]
pub struct Location {
    /// How it fits there.
    pub fit: MatchResult,
    /// What it says of the odometry.
    pub odometry: OdometryVerdict,
    /// Share of the scan that lies on the map; where it shows much that is new, of what had been seen before, 0 to 1.
    pub explained_share: f64,
    /// Whether the odometry is contradicted with little reason: what does not fit where it has the robot fits hardly better there.
    pub is_unearned: bool,
}

impl Location {
    /// A fit of which nothing is taken for new.
    fn new(fit: MatchResult, odometry: OdometryVerdict) -> Self {
        Self { fit, odometry, explained_share: fit.inlier_share, is_unearned: false }
    }
}

/// Fits `scan` to `map`; where scan and odometry contradict each other, the scan wins.
#[must_use]
pub fn locate(map: &SurfaceMap, scan: &SurfaceScan, expected: &Expectation<'_>, config: &MatcherConfig) -> Location {
    let Expectation { prior, continued, seen_before, may_have_turned_round } = *expected;
    let trusted_sigmas = if scan.len() < POINTS_TO_SEARCH { f64::INFINITY } else { TRUSTED_SIGMAS };
    let agrees = |belief: &PoseBelief, fit: &MatchResult| belief.sigmas_to(&fit.belief.pose) <= trusted_sigmas;
    let mut predicted = match_scan_against(map, scan, prior, trusted_sigmas, config);
    if !agrees(prior, &predicted) {
        // A contradiction has to be earned: doors that swing and people who walk along carry the
        // scan away with them, but no more of it fits there than where the odometry expects it. Where
        // the scan contradicts even who holds on to the odometry, that has been shown to be wrong.
        let held = match_scan(map, scan, prior, config);
        if agrees(prior, &held) && predicted.inlier_share <= held.inlier_share {
            predicted = held;
        }
    }
    let is_poor = |fit: &MatchResult| fit.inlier_share < config.search_below_inlier_share;
    // Odometry that comes late is wrong in one step and makes up for it in the next, while the robot just goes on. From
    // far off the scan may have come to lie anywhere along a corridor.
    if (!agrees(prior, &predicted) || is_poor(&predicted)) && !agrees(continued, &predicted) {
        let going_on = match_scan(map, scan, continued, config);
        let least_gain = if agrees(prior, &predicted) { CLEARLY_BETTER } else { -SLIGHTLY };
        if agrees(continued, &going_on) && going_on.inlier_share >= predicted.inlier_share + least_gain {
            predicted = going_on;
        }
    }
    let verdict = if agrees(prior, &predicted) { OdometryVerdict::Confirmed } else { OdometryVerdict::Contradicted };
    let mut location = Location::new(predicted, verdict);
    if verdict == OdometryVerdict::Contradicted && continued.sigmas_to(&predicted.belief.pose) > WENT_ON_SIGMAS {
        let unexplained_there = 1.0 - inlier_share(map, scan, &prior.pose, config);
        location.is_unearned = 1.0 - predicted.inlier_share > LEFT_UNEXPLAINED * unexplained_there;
    }
    if !is_poor(&predicted) || scan.len() < POINTS_TO_SEARCH {
        return location;
    }
    if let Some(seen) = seen_before.map(|seen_before| seen_before(&predicted.belief.pose)) {
        let share = share_of_seen(map, scan, &seen, &predicted, config);
        if seen.len() >= POINTS_TO_SEARCH {
            location.explained_share = share.max(predicted.inlier_share);
        }
        // Who sees new things has no reason to look for them elsewhere.
        if share >= config.search_below_inlier_share {
            return location;
        }
    }
    let near = SearchWindow { distance_m: config.search_distance_m, angle_rad: config.search_angle_rad };
    let wide = SearchWindow { distance_m: 1.6 * config.search_distance_m, angle_rad: FRAC_PI_2 };
    let mut best = predicted;
    for window in [near, wide] {
        for pose in search(map, scan, &prior.pose, window, CANDIDATES) {
            let start = PoseBelief { pose, information: prior.information * DISTRUST };
            let found = match_scan(map, scan, &start, config);
            if found.inlier_share > best.inlier_share {
                best = found;
            }
        }
        if predicted.inlier_share > LOST || best.inlier_share > GOOD_ENOUGH || !may_have_turned_round {
            break;
        }
    }
    if best.inlier_share > predicted.inlier_share + CLEARLY_BETTER {
        let is_proof = best.inlier_share > LEAST_PROOF;
        location = Location::new(if is_proof { best } else { unseen(predicted, prior) }, OdometryVerdict::Abandoned);
    }
    location
}

/// How much of what had been `seen` before lies on `map`: the share of those points, and no more than all points of the
/// scan that fit make up for.
fn share_of_seen(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    seen: &SurfaceScan,
    fit: &MatchResult,
    config: &MatcherConfig,
) -> f64 {
    let of_all = fit.inlier_share * scan.len() as f64 / seen.len().max(1) as f64;
    inlier_share(map, seen, &fit.belief.pose, config).min(of_all)
}

/// Fits a `scan` that shows too little to overrule the odometry to `map`.
#[must_use]
pub(crate) fn follow(map: &SurfaceMap, scan: &SurfaceScan, prior: &PoseBelief, config: &MatcherConfig) -> Location {
    let fit = match_few(map, scan, prior, config);
    // What hardly lies on the map shows new things; the few points that fit do so by chance and would lead astray.
    let is_seen = fit.inlier_share >= LOST;
    Location::new(if is_seen { fit } else { unseen(fit, prior) }, OdometryVerdict::Confirmed)
}

/// What is known of the pose of a scan that says nothing: what was believed before it was looked at.
fn unseen(fit: MatchResult, prior: &PoseBelief) -> MatchResult {
    MatchResult { belief: *prior, scan_information: Matrix3::zeros(), ..fit }
}
