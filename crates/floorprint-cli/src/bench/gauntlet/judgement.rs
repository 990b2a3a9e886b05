//! What the program claims about a drive, held against the truth. All that is known here of the program is what its
//! reports and its result say.

use floorprint::back_end::Uncertainty;
use floorprint::evaluation::PoseError;
use floorprint::geometry::Pose2;
use floorprint::{SlamResult, StepReport};
use serde::{Deserialize, Serialize};

/// What is claimed may be off the truth by this much beyond what it states, metres …
const TOLERANCE_M: f64 = 0.5;
/// … and degrees …
const TOLERANCE_DEG: f64 = 5.0;
/// … and by more for no longer than this, seconds.
const TOLERANCE_S: f64 = 2.0;

/// Who states a larger region than this knows no place: as good as lost, metres. A drive that is right all along says so of
/// no more than this share of its scans.
const VAGUE_M: f64 = 5.0;
const MOST_VAGUE: f64 = 0.05;

/// A circle of so many standard deviations holds 95 % of a Gaussian of the plane, an interval of so many 95 % of one on a
/// line.
const CIRCLE_95: f64 = 2.448;
const INTERVAL_95: f64 = 1.96;

/// Where the robot is said to be at a scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Claim {
    /// Its pose in the frame of the first scan's.
    pub(super) pose: Pose2,
    /// Whether it is said that this pose is not to be relied on.
    pub(super) is_lost: bool,
    /// Radius of the region that is said to hold the position with 95 %, metres; 0 where nothing is said.
    pub(super) radius_m: f64,
    /// The same of the heading, degrees.
    pub(super) radius_deg: f64,
}

impl Claim {
    /// What a step of the live program claims.
    pub(super) fn of_step(step: &StepReport) -> Self {
        Self::stating(step.pose, step.is_lost, step.uncertainty.unwrap_or_default())
    }

    /// What the final result claims of each scan that was taken in.
    pub(super) fn of_result(result: &SlamResult) -> Vec<Self> {
        let mut kidnappings = result.kidnappings.clone();
        kidnappings.sort_by_key(|kidnapping| kidnapping.frame);
        let mut is_lost = vec![false; result.trajectory.len()];
        for (index, kidnapping) in kidnappings.iter().enumerate() {
            let until = kidnappings.get(index + 1).map_or(is_lost.len(), |next| next.frame).min(is_lost.len());
            // Who was found on what was never placed itself is not placed either.
            let lost = kidnapping.found.is_none_or(|found| is_lost.get(found.earlier) == Some(&true));
            is_lost[kidnapping.frame.min(until)..until].fill(lost);
        }
        let poses = result.trajectory.iter().zip(is_lost).enumerate();
        let stated = |index: usize| result.uncertainties.get(index).copied().unwrap_or_default();
        poses.map(|(index, (stamped, is_lost))| Self::stating(stamped.pose, is_lost, stated(index))).collect()
    }

    fn stating(pose: Pose2, is_lost: bool, uncertainty: Uncertainty) -> Self {
        Self {
            pose,
            is_lost,
            radius_m: CIRCLE_95 * uncertainty.sigma_m,
            radius_deg: INTERVAL_95 * uncertainty.sigma_rad.to_degrees(),
        }
    }
}

/// What a drive amounts to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    /// Right all along; a robot that was lost has found itself.
    Right,
    /// Not right, but whatever is wrong was said to be uncertain or lost.
    Told,
    /// Something wrong was claimed.
    SilentlyWrong,
    /// There is no result.
    Failed,
}

/// Claims over a drive against the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Judgement {
    /// The longest time on end for which something wrong was claimed, seconds.
    pub(super) wrong_s: f64,
    /// Largest error of what was claimed, that is, where the robot was not said to be lost: metres, degrees.
    pub(super) claimed_max_m: f64,
    pub(super) claimed_max_deg: f64,
    /// Largest error of all poses, metres, degrees.
    pub(super) max_m: f64,
    pub(super) max_deg: f64,
    /// RMSE of all poses, metres.
    pub(super) rmse_m: f64,
    /// Share of the scans at which the robot is said to be lost.
    pub(super) lost_share: f64,
    /// Share of the scans that are not lost whose position lies within the stated region; 1 where none is stated.
    pub(super) covered_share: f64,
    /// Share of the scans of which a region is stated that is too large to be of use.
    #[serde(default)]
    pub(super) vague_share: f64,
    /// Whether the last of them is.
    pub(super) is_lost_at_end: bool,
    /// Whether every pose that is not lost is right by the tolerance, however sure.
    pub(super) is_right: bool,
}

impl Judgement {
    /// Holds claims against the truth: time in seconds and pose of each.
    pub(super) fn new<'a>(claims: impl Iterator<Item = (&'a Claim, f64, Pose2)>) -> Self {
        let mut judgement = Self { is_right: true, ..Self::default() };
        let mut wrong_since_s: Option<f64> = None;
        let (mut count, mut lost, mut squares, mut covered, mut vague) = (0_usize, 0_usize, 0.0, 0_usize, 0_usize);
        let mut off_since_s: Option<f64> = None;
        for (claim, time_s, truth) in claims {
            let error = PoseError::between(&truth, &claim.pose);
            let (off_m, off_deg) = (error.translation_m, error.rotation_deg.abs());
            count += 1;
            squares += off_m * off_m;
            judgement.max_m = judgement.max_m.max(off_m);
            judgement.max_deg = judgement.max_deg.max(off_deg);
            judgement.is_lost_at_end = claim.is_lost;
            vague += usize::from(claim.radius_m > VAGUE_M);
            if claim.is_lost {
                lost += 1;
            } else {
                judgement.claimed_max_m = judgement.claimed_max_m.max(off_m);
                judgement.claimed_max_deg = judgement.claimed_max_deg.max(off_deg);
                covered += usize::from(claim.radius_m == 0.0 || off_m <= claim.radius_m);
            }
            let is_off = !claim.is_lost && (off_m > TOLERANCE_M || off_deg > TOLERANCE_DEG);
            let is_wrong =
                !claim.is_lost && (off_m > TOLERANCE_M + claim.radius_m || off_deg > TOLERANCE_DEG + claim.radius_deg);
            for (holds, since_s) in [(is_wrong, &mut wrong_since_s), (is_off, &mut off_since_s)] {
                if !holds {
                    *since_s = None;
                }
            }
            if is_wrong {
                let since_s = *wrong_since_s.get_or_insert(time_s);
                judgement.wrong_s = judgement.wrong_s.max(time_s - since_s);
            }
            if is_off {
                let since_s = *off_since_s.get_or_insert(time_s);
                judgement.is_right &= time_s - since_s <= TOLERANCE_S;
            }
        }
        let scans = count.max(1) as f64;
        judgement.rmse_m = (squares / scans).sqrt();
        judgement.lost_share = lost as f64 / scans;
        judgement.vague_share = vague as f64 / scans;
        judgement.covered_share = if count == lost { 1.0 } else { covered as f64 / (count - lost) as f64 };
        judgement
    }
}

impl Verdict {
    /// The verdict on what was claimed live and on what is claimed in the end.
    pub(super) fn of(live: &Judgement, result: &Judgement) -> Self {
        if live.wrong_s > TOLERANCE_S || result.wrong_s > TOLERANCE_S {
            Self::SilentlyWrong
        } else if live.is_right
            && result.is_right
            && result.lost_share == 0.0
            && result.vague_share <= MOST_VAGUE
            && !live.is_lost_at_end
        {
            Self::Right
        } else {
            Self::Told
        }
    }

    /// In words.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Told => "told",
            Self::SilentlyWrong => "silently wrong",
            Self::Failed => "failed",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive of ten seconds, ten scans a second, with these errors from the fourth second on for so long.
    fn judged(off_m: f64, for_s: f64, is_lost: bool, radius_m: f64) -> Judgement {
        let claims: Vec<Claim> = (0..100)
            .map(|scan| {
                let is_off = (40..40 + (for_s * 10.0) as usize).contains(&scan);
                let pose = Pose2::new(if is_off { off_m } else { 0.0 }, 0.0, 0.0);
                Claim { pose, is_lost: is_off && is_lost, radius_m, radius_deg: 0.0 }
            })
            .collect();
        Judgement::new(claims.iter().enumerate().map(|(scan, claim)| (claim, 0.1 * scan as f64, Pose2::IDENTITY)))
    }

    #[test]
    fn errors_are_wrong_unless_they_are_told_or_short() {
        let right = judged(0.1, 5.0, false, 0.0);
        for (judgement, expected) in [
            (right, Verdict::Right),
            (judged(3.0, 1.5, false, 0.0), Verdict::Right),
            (judged(3.0, 5.0, false, 0.0), Verdict::SilentlyWrong),
            (judged(3.0, 5.0, true, 0.0), Verdict::Right),
            (judged(3.0, 60.0, true, 0.0), Verdict::Told),
            (judged(3.0, 5.0, false, 2.8), Verdict::Told),
            (judged(0.1, 5.0, false, 4.0), Verdict::Right),
            (judged(3.0, 5.0, false, 2.0), Verdict::SilentlyWrong),
        ] {
            assert_eq!(Verdict::of(&judgement, &right), expected, "{judgement:?}");
        }
        assert_eq!(Verdict::of(&right, &judged(3.0, 5.0, false, 0.0)), Verdict::SilentlyWrong);
        assert_eq!(Verdict::of(&right, &judged(3.0, 5.0, true, 0.0)), Verdict::Told);
        assert_eq!(Verdict::of(&right, &judged(0.1, 5.0, false, 6.0)), Verdict::Told, "who says nothing is not right");
    }
}
