//! How the scans themselves say that the robot moved, without any odometry.

use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::scan_matcher::{MatcherConfig, SearchWindow};
use crate::slam::StepReport;
use crate::survey::motion_between;
use rayon::prelude::*;

/// The motion between two scans, by the scans alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct EgoMotion {
    /// Stamps of the two scans, seconds.
    pub(super) stamps_s: [f64; 2],
    /// `earlier_body_from_later_body`.
    pub(super) motion: Pose2,
    /// Standard deviation of the position in its least certain direction, metres.
    pub(super) sigma_m: f64,
}

/// So many moments are looked at.
const MOMENTS: usize = 150;
/// At each of them two scans at least this far apart are compared, seconds …
const APART_S: f64 = 0.25;
/// … and no farther apart than this.
const FARTHEST_APART_S: f64 = 3.0;
/// Robots are taken to be no faster than this, m/s and rad/s; what is faster is not seen.
const SPEED_M_S: f64 = 1.6;
const TURN_RAD_S: f64 = 1.6;
/// The largest window that is searched, metres and radians.
const WINDOW_M: f64 = 1.6;
const WINDOW_RAD: f64 = 1.2;
/// Scan and map must show this much of the same.
const LEAST_INLIER_SHARE: f64 = 0.7;

/// Moments spread over the drive at which two scans fit each other in one way only.
pub(super) fn ego_motions(frames: &[Frame], matcher: &MatcherConfig) -> Vec<EgoMotion> {
    let moments = MOMENTS.min(frames.len());
    let firsts: Vec<usize> = (0..moments).map(|moment| moment * frames.len() / moments.max(1)).collect();
    let motions: Vec<Option<EgoMotion>> =
        firsts.par_iter().map(|&first| ego_motion(&frames[first..], matcher)).collect();
    motions.into_iter().flatten().collect()
}

fn ego_motion(frames: &[Frame], matcher: &MatcherConfig) -> Option<EgoMotion> {
    let earlier = frames.first()?;
    let later = frames.iter().find(|frame| frame.stamp_s - earlier.stamp_s >= APART_S)?;
    let elapsed_s = later.stamp_s - earlier.stamp_s;
    if elapsed_s > FARTHEST_APART_S {
        return None;
    }
    let window = SearchWindow {
        distance_m: (SPEED_M_S * elapsed_s + 0.1).min(WINDOW_M),
        angle_rad: (TURN_RAD_S * elapsed_s + 0.1).min(WINDOW_RAD),
    };
    let (motion, covariance) = motion_between(&earlier.scan, &later.scan, &Pose2::IDENTITY, window, matcher)?;
    let uncertainty = crate::back_end::Uncertainty::of(&covariance);
    Some(EgoMotion { stamps_s: [earlier.stamp_s, later.stamp_s], motion, sigma_m: uncertainty.sigma_m })
}

/// The same of a drive that was solved: how the tracked pose moved where scans and map fit.
pub(super) fn tracked_motions(steps: &[StepReport]) -> Vec<EgoMotion> {
    let moments = MOMENTS.min(steps.len());
    let motion = |moment: usize| {
        let steps = &steps[moment * steps.len() / moments.max(1)..];
        let earlier = steps.first()?;
        let position = steps.iter().position(|step| step.stamp_s - earlier.stamp_s >= APART_S)?;
        let passed = &steps[..=position];
        let later = &steps[position];
        let fits = passed.iter().all(|step| step.filter.inlier_share >= LEAST_INLIER_SHARE && !step.is_lost);
        (fits && later.stamp_s - earlier.stamp_s <= FARTHEST_APART_S).then(|| EgoMotion {
            stamps_s: [earlier.stamp_s, later.stamp_s],
            motion: earlier.filter.pose.between(&later.filter.pose),
            sigma_m: 0.0,
        })
    };
    (0..moments).filter_map(motion).collect()
}
