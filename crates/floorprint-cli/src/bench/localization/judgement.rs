//! What a localizer says, held against the truth.

use floorprint::evaluation::PoseError;
use floorprint::geometry::Pose2;
use serde::{Deserialize, Serialize};

/// A claimed pose is right within this: metres and degrees …
const RIGHT_M: f64 = 0.1;
const RIGHT_DEG: f64 = 2.0;
/// … and wrong from this on, for longer than this where it was right before, seconds.
pub(super) const WRONG_M: f64 = 0.5;
pub(super) const WRONG_DEG: f64 = 10.0;
pub(super) const WRONG_S: f64 = 2.0;

/// What a localizer says at a scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Said {
    /// Since the beginning, seconds.
    pub(super) time_s: f64,
    /// Driven since the beginning, metres.
    pub(super) driven_m: f64,
    /// Where the robot truly is.
    pub(super) truth: Pose2,
    /// The pose that is claimed.
    pub(super) claimed: Option<Pose2>,
    /// The heaviest mode, and how probable it is said to be that the robot is not there.
    pub(super) heaviest: Option<Pose2>,
    pub(super) lost_probability: f64,
}

/// Upper ends of the bins of what is said to be the probability of being lost.
pub(super) const BINS: [f64; 7] = [0.001, 0.01, 0.05, 0.2, 0.5, 0.8, 1.0];

/// Moments of which about the same probability of being lost is said.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Bin {
    /// How many.
    pub(super) moments: usize,
    /// Sum of the probabilities.
    pub(super) said: f64,
    /// At how many of them the robot was not at the heaviest mode.
    pub(super) lost: usize,
}

impl Bin {
    pub(super) fn add(&mut self, other: &Self) {
        self.moments += other.moments;
        self.said += other.said;
        self.lost += other.lost;
    }
}

/// A pose was claimed where none was before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Decision {
    /// Driven since the search began, metres, and its time, seconds.
    pub(super) after_m: f64,
    pub(super) after_s: f64,
    /// How far it is off, metres and degrees.
    pub(super) off_m: f64,
    pub(super) off_deg: f64,
}

impl Decision {
    pub(super) fn is_right(&self) -> bool {
        self.off_m <= RIGHT_M && self.off_deg <= RIGHT_DEG
    }

    pub(super) fn is_wrong(&self) -> bool {
        self.off_m > WRONG_M || self.off_deg > WRONG_DEG
    }
}

/// All that was said on a drive against the truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Judgement {
    /// Poses that were claimed after a search.
    pub(super) decisions: Vec<Decision>,
    /// Longest time on end for which a wrong pose was claimed, but for what a kidnapping takes to be noticed, seconds.
    pub(super) wrong_s: f64,
    /// Mean and largest error of the claimed poses that are not wrong, metres.
    pub(super) tracking_mean_m: Option<f64>,
    pub(super) tracking_max_m: f64,
    /// Share of the scans with a claimed pose, and with one that is not wrong.
    pub(super) claimed_share: f64,
    pub(super) good_share: f64,
    /// How long after the kidnapping the pose was no longer claimed, seconds; absent where it never was given up, and where
    /// no right pose was claimed at the kidnapping.
    pub(super) noticed_after_s: Option<f64>,
    /// Whether a right pose was claimed when the robot was kidnapped.
    pub(super) was_tracked_at_kidnapping: bool,
    /// How often a pose that was not wrong was given up.
    pub(super) false_alarms: usize,
    /// Calibration of the probability of being lost.
    pub(super) calibration: [Bin; BINS.len()],
}

impl Judgement {
    /// Of what was said scan by scan; the robot was kidnapped at a time.
    pub(super) fn new(said: &[Said], kidnapped_s: Option<f64>, start_is_known: bool) -> Self {
        let mut judgement = Self::default();
        let mut was_claimed = start_is_known;
        let mut was_wrong = false;
        let mut wrong_since_s: Option<f64> = None;
        // Until it is noticed that the robot was kidnapped.
        let mut is_unnoticed = false;
        let mut search_began = [0.0; 2];
        let (mut sum_m, mut good, mut claims) = (0.0, 0_usize, 0_usize);
        let mut before_s = f64::NEG_INFINITY;
        for moment in said {
            let is_off = |pose: &Pose2| {
                let error = PoseError::between(&moment.truth, pose);
                (error.translation_m > WRONG_M || error.rotation_deg.abs() > WRONG_DEG, error)
            };
            if let Some(at_s) = kidnapped_s.filter(|at_s| before_s < *at_s && moment.time_s >= *at_s) {
                (is_unnoticed, judgement.was_tracked_at_kidnapping) =
                    (was_claimed, was_claimed && !was_wrong && at_s > 0.0);
            }
            let heaviest_is_off = moment.heaviest.is_none_or(|pose| is_off(&pose).0);
            let bin = BINS.iter().position(|end| moment.lost_probability <= *end).unwrap_or(BINS.len() - 1);
            let moments = Bin { moments: 1, said: moment.lost_probability, lost: usize::from(heaviest_is_off) };
            judgement.calibration[bin].add(&moments);
            let Some(pose) = moment.claimed else {
                if was_claimed {
                    search_began = [moment.driven_m, moment.time_s];
                    if is_unnoticed {
                        let after_s = moment.time_s - kidnapped_s.unwrap_or(moment.time_s);
                        judgement.noticed_after_s = Some(after_s).filter(|_| judgement.was_tracked_at_kidnapping);
                    } else if !was_wrong && before_s.is_finite() {
                        judgement.false_alarms += 1;
                    }
                }
                (was_claimed, is_unnoticed, wrong_since_s, before_s) = (false, false, None, moment.time_s);
                continue;
            };
            claims += 1;
            let (is_wrong, error) = is_off(&pose);
            if !was_claimed {
                judgement.decisions.push(Decision {
                    after_m: moment.driven_m - search_began[0],
                    after_s: moment.time_s - search_began[1],
                    off_m: error.translation_m,
                    off_deg: error.rotation_deg.abs(),
                });
            }
            if is_wrong && !is_unnoticed {
                let since_s = *wrong_since_s.get_or_insert(moment.time_s);
                judgement.wrong_s = judgement.wrong_s.max(moment.time_s - since_s);
            } else if !is_wrong {
                wrong_since_s = None;
                good += 1;
                sum_m += error.translation_m;
                judgement.tracking_max_m = judgement.tracking_max_m.max(error.translation_m);
            }
            (was_claimed, was_wrong, before_s) = (true, is_wrong, moment.time_s);
        }
        let scans = said.len().max(1) as f64;
        (judgement.claimed_share, judgement.good_share) = (claims as f64 / scans, good as f64 / scans);
        judgement.tracking_mean_m = (good > 0).then(|| sum_m / good as f64);
        judgement
    }

    /// Whether something wrong was claimed with confidence.
    pub(super) fn is_wrong(&self) -> bool {
        self.wrong_s > WRONG_S || self.decisions.iter().any(Decision::is_wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds, ten scans a second: what is claimed in each (how far off, or nothing).
    fn judged(claims: impl Fn(f64) -> Option<f64>, kidnapped_s: Option<f64>, start_is_known: bool) -> Judgement {
        let said: Vec<Said> = (0..100)
            .map(|scan| {
                let time_s = 0.1 * f64::from(scan);
                let claimed = claims(time_s).map(|off_m| Pose2::new(off_m, 0.0, 0.0));
                let lost_probability = if claimed.is_some() { 0.0 } else { 0.9 };
                let truth = Pose2::IDENTITY;
                Said { time_s, driven_m: time_s, truth, claimed, heaviest: claimed, lost_probability }
            })
            .collect();
        Judgement::new(&said, kidnapped_s, start_is_known)
    }

    #[test]
    fn a_start_that_is_found_is_a_decision() {
        let right = judged(|time_s| (time_s > 3.05).then_some(0.05), None, false);
        let &[decision] = right.decisions.as_slice() else { panic!("{right:?}") };
        assert!(decision.is_right() && (decision.after_m - 3.1).abs() < 1e-9, "{decision:?}");
        assert!(!right.is_wrong() && right.false_alarms == 0 && (right.claimed_share - 0.69).abs() < 1e-9);
        assert_eq!((right.calibration[0].moments, right.calibration[0].lost, right.calibration[6].lost), (69, 0, 31));
        let wrong = judged(|time_s| (time_s > 9.75).then_some(3.0), None, false);
        assert!(wrong.is_wrong(), "however short: it was claimed");
        let undecided = judged(|_| None, None, false);
        assert!(undecided.decisions.is_empty() && !undecided.is_wrong() && undecided.false_alarms == 0);
    }

    #[test]
    fn tracking_is_wrong_once_it_is_off_for_long() {
        let off = |for_s: f64| {
            judged(move |time_s| Some(if time_s > 3.0 && time_s < 3.0 + for_s { 0.7 } else { 0.02 }), None, true)
        };
        assert!(!off(1.5).is_wrong() && off(3.0).is_wrong());
        assert!((off(1.5).tracking_mean_m.unwrap() - 0.02).abs() < 1e-9);
    }

    #[test]
    fn a_kidnapping_has_to_be_noticed_and_a_right_pose_not_given_up() {
        let noticed =
            judged(|time_s| if time_s < 5.0 { Some(0.0) } else { (time_s < 6.45).then_some(4.0) }, Some(5.0), true);
        assert!(!noticed.is_wrong() && noticed.false_alarms == 0 && noticed.was_tracked_at_kidnapping);
        assert!((noticed.noticed_after_s.unwrap() - 1.5).abs() < 0.01, "{noticed:?}");
        let unnoticed = judged(|time_s| Some(if time_s < 5.0 { 0.0 } else { 4.0 }), Some(5.0), true);
        assert_eq!((unnoticed.noticed_after_s, unnoticed.was_tracked_at_kidnapping), (None, true));
        let alarm = judged(|time_s| (time_s < 5.0).then_some(0.1), None, true);
        assert_eq!(alarm.false_alarms, 1);
    }
}
