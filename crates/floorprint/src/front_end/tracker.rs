//! One hypothesis: where the robot is, how it got there, and what the world then looks like.

use super::genealogy::Trail;
use super::local_map::LocalMap;
use super::odometry_model::OdometryModel;
use crate::geometry::covariance::{inverse, isotropic};
use crate::geometry::{Pose2, wrap_angle};
use crate::motion_model::MotionConfig;
use crate::pace::is_gap;
use crate::scan_matcher::{
    Expectation, Location, MatchResult, MatcherConfig, OdometryVerdict, POINTS_TO_SEARCH, PoseBelief, follow, locate,
};
use crate::surface::SurfaceScan;
use nalgebra::{Matrix3, Vector3};

/// How much the last motion is believed to go on, as a factor on the information that odometry would
/// give. With a quarter of it a door that swings carries the robot along (intel without odometry: 0.173 m
/// instead of 0.013 m); twice as much or half of it make no difference.
const PREDICTION_TRUST: f64 = 0.2;
/// A scan of less than this share of the points that it may have overrules no odometry that has the robot go on …
const SPARSE_SHARE: f64 = 1.0 / 6.0;
/// … as before, within this many standard deviations.
const GOING_ON_SIGMAS: f64 = 3.0;
/// Without odometry, and while scans show nothing, a robot goes on by this share of the step before.
const UNSEEN_GOES_ON: f64 = 0.95;
/// A match is doubtful where less than this share of its scan lies on the map.
const DOUBTFUL_INLIER_SHARE: f64 = 0.6;
/// How far a doubtful pose may be off: standard deviations, metres and radians.
const BLUNDER_SIGMA_M: f64 = 0.3;
const BLUNDER_SIGMA_RAD: f64 = 0.08;

/// A particle: a pose with a map of its own, and how it got there.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    /// `odom_from_body`.
    pub(super) pose: Pose2,
    /// Logarithm of the evidence since the last resampling.
    pub(super) log_weight: f64,
    /// Logarithm of the evidence of the whole trajectory: after a resampling the weights say nothing.
    pub(super) log_evidence: f64,
    pub(super) map: LocalMap,
    pub(super) trail: Trail,
    /// Motion of the last step.
    pub(super) last_motion: Pose2,
    /// The same in the usual time between two scans, for when nothing measures the next.
    pub(super) going: Pose2,
    /// What the odometry says of each step since the last scan that fitted.
    unconfirmed: Vec<Pose2>,
    /// Whether the last scan contradicted the odometry.
    pub(super) was_contradicted: bool,
}

/// What is believed of a pose before its scan is looked at.
pub(super) struct Prediction {
    /// The odometry's belief, or that the robot goes on where nothing measures the motion.
    prior: PoseBelief,
    /// The odometry's with errors as they have turned out to be so far; none where it says nothing, or over a gap.
    proven: Option<PoseBelief>,
    /// That the robot goes on as it did.
    continued: PoseBelief,
    step: Pose2,
    /// Whether the odometry tells the step.
    is_measured: bool,
    /// The usual times between two scans that it takes.
    steps: f64,
}

impl Tracker {
    pub(super) fn new(pose: Pose2, log_weight: f64, map: LocalMap) -> Self {
        Self {
            pose,
            log_weight,
            log_evidence: 0.0,
            map,
            trail: Trail::default(),
            last_motion: Pose2::IDENTITY,
            going: Pose2::IDENTITY,
            unconfirmed: Vec::new(),
            was_contradicted: false,
        }
    }

    /// The steps since the last scan that fitted, as the odometry has them.
    pub(super) fn unconfirmed(&self) -> &[Pose2] {
        &self.unconfirmed
    }

    pub(super) fn set_unconfirmed(&mut self, steps: &[Pose2]) {
        self.unconfirmed = steps.to_vec();
    }

    /// Where the robot is before the scan is looked at: `measured` is the motion since the last scan, at its true
    /// length, where odometry tells it; as long a time has passed as is usual for so many `steps`.
    pub(super) fn predict(
        &self,
        measured: Option<&Pose2>,
        steps: f64,
        odometry: &OdometryModel,
        motion: &MotionConfig,
    ) -> Prediction {
        // Without odometry the robot is taken to go on as it did, with room for change.
        let going_on = if is_gap(steps) { times(&self.going, steps) } else { self.going };
        let mut continued = PoseBelief {
            pose: self.pose.compose(&going_on),
            information: motion.information(&going_on) * PREDICTION_TRUST,
        };
        // While scans come they show the heading; turns that the odometry misses count where there is no more than it.
        let straightened = measured.map(|measured| odometry.straightened(measured));
        let measured = if steps >= LONG_GAP_STEPS { straightened } else { measured.copied() };
        let prior = measured.map_or(continued, |measured| PoseBelief {
            pose: self.pose.compose(&measured),
            information: information_over(steps, &measured, motion, odometry.noise()),
        });
        if measured.is_some() && is_gap(steps) {
            // How the robot went on before a gap says nothing about where it is after it.
            continued.information = Matrix3::zeros();
        }
        let proven = straightened.filter(|_| !is_gap(steps)).map(|straightened| PoseBelief {
            pose: self.pose.compose(&straightened),
            information: odometry.proven(&prior.information),
        });
        Prediction {
            prior,
            proven,
            continued,
            step: measured.unwrap_or(going_on),
            is_measured: measured.is_some(),
            steps,
        }
    }

    /// Moves to where the scan fits the map, once there is one.
    pub(super) fn match_scan(
        &mut self,
        prediction: &Prediction,
        scan: &SurfaceScan,
        matcher: &MatcherConfig,
    ) -> Option<Fit> {
        let Prediction { prior, step, is_measured, steps, .. } = prediction;
        self.unconfirmed.push(*step);
        let Some(Location { fit: result, odometry, explained_share, is_unearned }) =
            self.locate(prediction, scan, matcher)
        else {
            (self.pose, self.last_motion, self.going) = (prior.pose, *step, in_a_step(step, *steps));
            return None;
        };
        self.was_contradicted = odometry != OdometryVerdict::Confirmed;
        self.last_motion = self.pose.between(&result.belief.pose);
        self.pose = result.belief.pose;
        self.going = in_a_step(&self.last_motion, *steps);
        if !is_measured && result.scan_information == Matrix3::zeros() {
            // Nobody goes on for ever.
            self.going = times(&self.going, UNSEEN_GOES_ON);
        }
        Some(Fit { result, explained_share, prior: *prior, odometry, is_unearned })
    }

    /// Where the scan fits the map; nothing as long as there is none.
    pub(super) fn locate(
        &self,
        prediction: &Prediction,
        scan: &SurfaceScan,
        matcher: &MatcherConfig,
    ) -> Option<Location> {
        let Prediction { prior, proven, continued, is_measured, steps, .. } = prediction;
        if self.map.surfaces().is_empty() {
            return None;
        }
        let goes_on = continued.sigmas_to(&prior.pose) <= GOING_ON_SIGMAS;
        let sparse_points = SPARSE_SHARE * matcher.max_points as f64;
        let is_sparse =
            (scan.len() as f64) < if goes_on { sparse_points } else { sparse_points.min(POINTS_TO_SEARCH as f64) };
        Some(match proven.filter(|_| is_sparse) {
            Some(proven) => follow(self.map.surfaces(), scan, &proven, matcher),
            None => {
                let seen_before = |pose: &Pose2| self.map.had_in_view(pose, scan);
                // Where nothing tells the motion, or not all of it, new things may be known ones seen from elsewhere.
                let tells_motion = *is_measured && !is_gap(*steps);
                let seen_before = tells_motion.then_some(&seen_before as &dyn Fn(&Pose2) -> SurfaceScan);
                let may_have_turned_round = !tells_motion || self.was_contradicted;
                let expected = Expectation { prior, continued, seen_before, may_have_turned_round };
                locate(self.map.surfaces(), scan, &expected, matcher)
            }
        })
    }

    /// The scans up to here are where they were matched.
    pub(super) fn confirm(&mut self) {
        self.unconfirmed.clear();
    }

    /// Gives the scans that did not fit poses that lead to where the robot is now, as the odometry has it: they may
    /// have been matched to what they do not show.
    pub(super) fn correct_misfits(&mut self) {
        let mut pose = self.pose;
        let mut poses: Vec<Pose2> = self
            .unconfirmed
            .iter()
            .rev()
            .map(|step| {
                pose = pose.compose(&step.inverse());
                pose
            })
            .collect();
        // The last of them is that of the scan that fitted before.
        poses.pop();
        self.trail.correct_last(poses.len(), poses.into_iter().rev());
    }

    /// Forgets the map of a robot that is lost. The scans since then were matched to a map that does not
    /// show where they were taken: for their poses the odometry is asked instead. The last step took the usual time
    /// between two scans so many times.
    pub(super) fn begin_anew(&mut self, last_steps: f64) {
        self.map.clear();
        let steps = std::mem::take(&mut self.unconfirmed);
        let Some(mut pose) = self.trail.last(steps.len()).first().map(|last_fit| last_fit.pose) else { return };
        let mut poses = steps.iter().map(|step| {
            pose = pose.compose(step);
            pose
        });
        self.trail.correct_last(steps.len() - 1, &mut poses);
        self.pose = poses.next().unwrap_or(self.pose);
        self.last_motion = steps[steps.len() - 1];
        self.going = in_a_step(&self.last_motion, last_steps);
    }
}

/// So much of a motion.
fn times(motion: &Pose2, factor: f64) -> Pose2 {
    Pose2::exp(motion.log().map(|part| factor * part))
}

/// What of a motion is made in the usual time between two scans, if scans are missing from it.
fn in_a_step(motion: &Pose2, steps: f64) -> Pose2 {
    if is_gap(steps) { times(motion, 1.0 / steps) } else { *motion }
}

/// How a particle's scan fitted its map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) result: MatchResult,
    /// Share of the scan that lies on the map; of a scan that shows much that is new, of what had been seen before.
    pub(super) explained_share: f64,
    /// The odometry's belief before the scan.
    pub(super) prior: PoseBelief,
    pub(super) odometry: OdometryVerdict,
    /// Whether the odometry is contradicted with little reason.
    pub(super) is_unearned: bool,
}

/// Over fewer steps than this the errors of odometry are of one kind rather than by chance: wheels that slip, a scale
/// that is not known yet.
const LONG_GAP_STEPS: f64 = 20.0;

/// Information of a motion over (x, y, θ). The errors of many steps add up by their squares, so that a motion over a gap
/// is known better than a single step of its length.
fn information_over(steps: f64, measured: &Pose2, motion: &MotionConfig, noise: f64) -> Matrix3<f64> {
    let at_once = motion.scaled_information(measured, noise);
    if steps < LONG_GAP_STEPS {
        return at_once;
    }
    let step = times(measured, 1.0 / steps);
    let in_steps = motion.scaled_information(&step, noise) / steps;
    Matrix3::from_diagonal(&at_once.diagonal().sup(&in_steps.diagonal()))
}

impl Fit {
    /// Covariance of what cannot be decided where scan and odometry contradict each other: the robot is where either
    /// has it.
    pub(super) fn contradiction(&self) -> Matrix3<f64> {
        if self.odometry == OdometryVerdict::Confirmed {
            return Matrix3::zeros();
        }
        let (here, there) = (&self.result.belief.pose, &self.prior.pose);
        let offset = Vector3::new(there.x - here.x, there.y - here.y, wrap_angle(there.theta - here.theta));
        0.25 * offset * offset.transpose()
    }

    /// How uncertain the motion since the last written scan is, given how uncertain it was one scan
    /// ago: the odometry adds to it, and what the scan tells takes away.
    pub(super) fn covariance_after(&self, before: &Matrix3<f64>) -> Matrix3<f64> {
        let moved = self.covariance_without_scan(before);
        inverse(&(inverse(&moved) + self.result.scan_information))
    }

    /// The same where the scan says nothing.
    pub(super) fn covariance_without_scan(&self, before: &Matrix3<f64>) -> Matrix3<f64> {
        before + inverse(&self.prior.information)
    }

    /// Whether the optimum may be a wrong one, of which the curvature says nothing: scan and
    /// odometry disagreed altogether, or little of the scan lay on the map.
    pub(super) fn is_doubtful(&self) -> bool {
        self.odometry == OdometryVerdict::Abandoned || self.explained_share < DOUBTFUL_INLIER_SHARE
    }

    /// Whether the scan lies somewhere else than the odometry has it, and fits badly even there.
    pub(super) fn is_far_off_and_bad(&self) -> bool {
        self.odometry == OdometryVerdict::Abandoned && self.result.inlier_share < DOUBTFUL_INLIER_SHARE
    }

    /// Logarithm of ∫ p(scan | pose) p(pose | odometry) dpose, by Laplace's method around the optimum.
    pub(super) fn log_evidence(&self, points: f64) -> f64 {
        let offset = Vector3::new(
            self.result.belief.pose.x - self.prior.pose.x,
            self.result.belief.pose.y - self.prior.pose.y,
            wrap_angle(self.result.belief.pose.theta - self.prior.pose.theta),
        );
        let misfit = if self.odometry == OdometryVerdict::Abandoned {
            0.0
        } else {
            (offset.transpose() * self.prior.information * offset).x
        };
        let volume = self.prior.information.determinant() / self.result.belief.information.determinant().max(1e-300);
        points * self.result.score - 0.5 * misfit + 0.5 * volume.max(1e-300).ln()
    }
}

/// Covariance of a doubtful pose.
pub(super) fn blunder() -> Matrix3<f64> {
    isotropic(BLUNDER_SIGMA_M, BLUNDER_SIGMA_RAD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use std::sync::Arc;

    /// Odometry that misses 0.05 rad of every metre.
    fn bent_odometry() -> OdometryModel {
        let mut odometry = OdometryModel::default();
        for _ in 0..2000 {
            let (measured, matched) = (Pose2::new(1.0, 0.0, 0.0), Pose2::new(1.0, 0.025, 0.05));
            odometry.note(&measured, &matched, [0.16, 0.06], &(Matrix3::identity() * 1e6));
        }
        odometry
    }

    #[test]
    fn turns_that_the_odometry_misses_count_where_scans_say_little_and_over_long_gaps() {
        let tracker = Tracker::new(Pose2::IDENTITY, 0.0, LocalMap::new(0.05, 20.0));
        let measured = Pose2::new(2.0, 0.0, 0.0);
        let predicted = |steps: f64| {
            let Prediction { prior, proven, .. } =
                tracker.predict(Some(&measured), steps, &bent_odometry(), &MotionConfig::default());
            (prior, proven)
        };
        let (prior, proven) = predicted(1.0);
        let proven = proven.unwrap();
        assert_eq!(prior.pose, measured);
        assert!((proven.pose.theta - 0.1).abs() < 0.01 && proven.pose.y > 0.05, "{:?}", proven.pose);
        assert!(proven.information[(2, 2)] > 10.0 * prior.information[(2, 2)]);
        assert_eq!(predicted(LONG_GAP_STEPS - 1.0).0.pose, measured);
        let (after_a_gap, proven) = predicted(LONG_GAP_STEPS);
        assert!(proven.is_none() && (after_a_gap.pose.theta - 0.1).abs() < 0.01, "{:?}", after_a_gap.pose);
    }

    /// Nothing measures how a robot goes on that goes 10 cm in each step, misses 30 scans, and then sees nothing.
    #[test]
    fn the_way_over_a_gap_is_no_step_and_nobody_goes_on_for_ever() {
        let (walls, matcher) = (Walls::room(), MatcherConfig::default());
        let scan = Arc::new(SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 361), &matcher.thinning()));
        let mut map = LocalMap::new(matcher.cell_m, 20.0);
        map.write(&Pose2::IDENTITY, &scan, scan.view_m(), false);
        let mut tracker = Tracker::new(Pose2::IDENTITY, 0.0, map);
        tracker.going = Pose2::new(0.1, 0.0, 0.0);
        let mut go_on = |steps: f64| {
            let prediction = tracker.predict(None, steps, &OdometryModel::default(), &MotionConfig::default());
            let _ = tracker.match_scan(&prediction, &SurfaceScan::default(), &matcher);
            tracker.last_motion.distance()
        };
        assert!((go_on(30.0) - 3.0).abs() < 1e-9);
        let next_m = go_on(1.0);
        assert!((0.05..=0.1).contains(&next_m), "{next_m} m");
        let blindly_m: f64 = (0..1000).map(|_| go_on(1.0)).sum();
        assert!(blindly_m < 3.0, "{blindly_m} m");
    }

    /// The robot knows one wall of a room, and now sees all of it.
    #[test]
    fn what_is_new_is_no_reason_for_doubt_where_the_odometry_tells_the_motion() {
        let (walls, matcher) = (Walls::room(), MatcherConfig::default());
        let scan = SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 361), &matcher.thinning());
        let fit = |measured: Option<&Pose2>| {
            let mut map = LocalMap::new(matcher.cell_m, 20.0);
            for pose in [Pose2::new(-0.3, -0.3, 0.0), Pose2::new(0.3, -0.2, 0.0), Pose2::new(0.0, -0.1, 0.0)] {
                let seen = SurfaceScan::new(&walls.scan_from(&pose, 361), &matcher.thinning());
                let known = Arc::new(seen.filtered(|[_, y]| f64::from(y) + pose.y > 0.5));
                map.write(&pose, &known, known.view_m(), false);
            }
            let mut tracker = Tracker::new(Pose2::IDENTITY, 0.0, map);
            let prediction = tracker.predict(measured, 1.0, &OdometryModel::default(), &MotionConfig::default());
            tracker.match_scan(&prediction, &scan, &matcher).unwrap()
        };
        let (told, untold) = (fit(Some(&Pose2::new(0.01, 0.0, 0.0))), fit(None));
        assert!(told.result.inlier_share < DOUBTFUL_INLIER_SHARE, "the test needs something new: {told:?}");
        assert!(told.explained_share > 0.8 && !told.is_doubtful(), "{told:?}");
        assert!(untold.is_doubtful(), "{untold:?}");
    }
}
