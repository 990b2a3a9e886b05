//! How far the robot may have come without its scans showing it.
//!
//! Along a bare corridor, in the dark, or where a scan fits somewhere else altogether, the pose is what wheels say or how
//! the robot went on before. Wheels slip and encoders stop, for seconds and always the same way, so that such errors do not
//! average out as those of scans do. What the curvature of a match says of a direction is no proof either: noise alone
//! bends it. Moved along the direction of which it says the least the scan must fit clearly worse.

use super::tracker::Fit;
use crate::geometry::Pose2;
use crate::key_scan::Drift;
use crate::scan_matcher::{MatcherConfig, OUTLIER_LOG_LIKELIHOOD, OdometryVerdict, inlier_share};
use crate::surface::{SurfaceMap, SurfaceScan};
use nalgebra::{Matrix3, Vector2};
use serde::{Deserialize, Serialize};

/// Fewer points than this tell nothing, nor does a scan of which less than this share lies on the map.
const LEAST_POINTS: usize = 30;
const LEAST_SHARE: f64 = 0.4;
/// A direction is not seen where the match leaves more than this in doubt, metres.
const SEEN_SIGMA_M: f64 = 0.05;
/// Directions of which a scan knows alike are both seen; else the weaker one is put to the test: standard deviations.
const ALIKE: f64 = 1.5;
/// Moved by so much the scan has to fit worse by this share of its points; metres.
const MOVED_M: f64 = 0.3;
const LEAST_DISTINCTNESS: f64 = 0.15;
/// Without odometry a scan has to show the motion alone, so that it must fit that much worse.
const LEAST_DISTINCTNESS_ALONE: f64 = 0.2;
/// What is faster than usual by this factor without odometry that says so is doubtful.
const HASTE: f64 = 1.5;
/// Wheels err by this share of what is not seen of their motion in length, by this share in heading, and by so much for each
/// metre.
const WHEELS_ERR: f64 = 0.05;
const WHEELS_TURN_ERR: f64 = 0.1;
const WHEELS_ERR_RAD_PER_M: f64 = 0.05;
/// Odometry that has turned out to be better than it is stated errs the less, down to this share: wheels may slip yet.
const LEAST_PROVEN: f64 = 0.1;
/// Wheels that report less than this share of the motion that was last seen may be stuck.
const STUCK_SHARE: f64 = 0.1;
/// A gyro reports more than this of a robot that stands, radians: what reports less does not see that wheels are stuck.
const STILL_RAD: f64 = 1e-6;
/// Who is not reported to move for longer than this stands, seconds: wheels that were stuck for a while are felt to be.
const LONGEST_STUCK_S: f64 = 30.0;
/// Slower than this the robot stands, m/s.
const STANDING_M_S: f64 = 0.05;
/// A robot of which nothing is known moves like this, m/s and rad/s.
const USUAL_M_S: f64 = 0.3;
const USUAL_RAD_S: f64 = 0.3;
/// The usual speed is the mean over so many steps.
const MOVES_REMEMBERED: f64 = 100.0;
/// Share of the newest step in what is learnt else.
const NEWEST: f64 = 0.1;
const NEWEST_VELOCITY: f64 = 0.3;
/// Where scan and odometry disagree the robot may be where either has it, as far as the scan itself does not fit: this
/// factor on the squared share of points that do not, up to half of the way.
const DISAGREEMENT: f64 = 2.0;
const HALF: f64 = 0.5;
/// Of contradictions that are not earned the odometry is right in so many (in 210 simulated drives with faults of all kinds).
const UNEARNED: f64 = 0.9;

/// A key scan adds this share of what its points scatter too much: about as much as the square root of a submap's key scans.
const SCATTER_SHARE: f64 = 0.2;

/// What of its motion a robot's scans do not show.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct UnseenMotion {
    /// Velocity in the body's axes as scans last showed it, m/s.
    seen_m_s: [f64; 2],
    /// The usual speed of the robot while it moves, m/s.
    usual_m_s: f64,
    /// In how many steps it was learnt, up to what is remembered.
    moves: f64,
    /// Mean squared distance of points from the surfaces that they lie on, against what is taken for granted.
    scatter: f64,
    /// What the last scan that was tested did not show.
    blind: Blind,
    /// By how much the motion since the last key scan may be off.
    drift: Drift,
}

/// What a scan does not show of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Blind {
    /// It shows all.
    No,
    /// Nothing along a direction, a unit vector in the axes of the front end's frame.
    Along([f64; 2]),
    /// Nothing at all.
    Altogether,
}

/// A step of the robot.
pub(super) struct Step<'a> {
    /// What the odometry says of it, if anything.
    pub(super) measured: Option<&'a Pose2>,
    /// Errors of the odometry on this drive as shares of what is stated of it: of a translation and of a turn.
    pub(super) proven_shares: [f64; 2],
    /// What scan and odometry together say of it.
    pub(super) matched: &'a Pose2,
    /// Time that it took, seconds.
    pub(super) elapsed_s: f64,
    /// The same in usual intervals between scans.
    pub(super) paces: f64,
    /// Whether scans are missing from that time.
    pub(super) is_gap: bool,
    /// Whether the scan was believed.
    pub(super) is_believed: bool,
    /// Whether it is to be tested what the scan shows; else it is what the last one did.
    pub(super) is_tested: bool,
}

impl Default for UnseenMotion {
    fn default() -> Self {
        Self {
            seen_m_s: [0.0; 2],
            usual_m_s: USUAL_M_S,
            moves: 0.0,
            scatter: 1.0,
            blind: Blind::No,
            drift: Drift::default(),
        }
    }
}

impl UnseenMotion {
    /// By how much the motion since the last key scan may be off.
    pub(super) fn drift(&self) -> Drift {
        self.drift
    }

    /// Whether the last scan did not show the motion at all.
    pub(super) fn is_in_the_dark(&self) -> bool {
        self.blind == Blind::Altogether
    }

    /// The same for a motion that ends here with this covariance of what scans say of it; what follows begins anew. Where
    /// points scatter more than is taken for granted, walls come out askew, and the next scans along with them.
    pub(super) fn take_drift(&mut self, covariance: &Matrix3<f64>) -> Drift {
        let mut drift = std::mem::take(&mut self.drift);
        let share = SCATTER_SHARE * (self.scatter.sqrt() - 1.0).max(0.0);
        let [variance_m2, variance_rad2] = [covariance[(0, 0)].max(covariance[(1, 1)]), covariance[(2, 2)]];
        drift.add(&Drift {
            sigma_m: share * variance_m2.max(0.0).sqrt(),
            sigma_rad: share * variance_rad2.max(0.0).sqrt(),
        });
        drift
    }

    /// Hears of a step and how its scan was fitted to the map.
    pub(super) fn observe(
        &mut self,
        step: &Step<'_>,
        fit: &Fit,
        scan: &SurfaceScan,
        map: &SurfaceMap,
        matcher: &MatcherConfig,
    ) {
        let dt_s = step.elapsed_s.max(0.0);
        let heading_rad = fit.result.belief.pose.theta - step.matched.theta;
        let [seen_x, seen_y] = self.seen_m_s;
        let went_on = Vector2::new(seen_x, seen_y) * dt_s.min(LONGEST_STUCK_S);
        let measured = step.measured.map(|motion| Vector2::new(motion.x, motion.y));
        let is_stuck = measured
            .is_some_and(|motion| seen_x.hypot(seen_y) > STANDING_M_S && motion.norm() < STUCK_SHARE * went_on.norm());
        if step.is_tested || is_stuck || measured.is_none() || self.blind != Blind::No || scan.len() < LEAST_POINTS {
            let least = if measured.is_some() { LEAST_DISTINCTNESS } else { LEAST_DISTINCTNESS_ALONE };
            self.blind = Blind::of(fit, scan, map, least, matcher);
        }
        let blind = if step.is_believed { self.blind } else { Blind::Altogether };
        let is_dark = blind == Blind::Altogether;
        let [share_m, share_rad] = step.proven_shares.map(|share| share.max(LEAST_PROVEN));
        self.drift.add(&match measured {
            Some(motion) => Drift {
                sigma_m: share_m * WHEELS_ERR * blind.hidden_m(&motion, heading_rad)
                    + if is_stuck { blind.hidden_m(&went_on, heading_rad) } else { 0.0 },
                sigma_rad: if !is_dark {
                    0.0
                } else if is_stuck && step.measured.is_some_and(|motion| motion.theta.abs() < STILL_RAD) {
                    USUAL_RAD_S * dt_s.min(LONGEST_STUCK_S)
                } else {
                    share_rad * (WHEELS_TURN_ERR * step.matched.theta.abs() + WHEELS_ERR_RAD_PER_M * motion.norm())
                },
            },
            None => Drift {
                sigma_m: if blind == Blind::No {
                    (step.matched.distance() - HASTE * self.usual_m_s * dt_s).max(0.0)
                } else {
                    self.usual_m_s * dt_s
                },
                sigma_rad: if is_dark { USUAL_RAD_S * dt_s } else { 0.0 },
            },
        });
        if fit.odometry != OdometryVerdict::Confirmed || step.is_gap {
            let misfit_share = 1.0 - fit.result.inlier_share;
            let may_be_wrong = if fit.is_unearned { UNEARNED } else { (DISAGREEMENT * misfit_share.powi(2)).min(HALF) };
            let off = fit.prior.pose.between(&fit.result.belief.pose);
            let stuck_m = if step.is_gap && is_stuck { went_on.norm() } else { 0.0 };
            self.drift.add(&Drift {
                sigma_m: may_be_wrong * (off.distance() + stuck_m),
                sigma_rad: may_be_wrong * off.theta.abs(),
            });
        }
        let share = fit.result.inlier_share;
        if share > LEAST_SHARE && scan.len() >= LEAST_POINTS {
            let of_inliers = (fit.result.score - (1.0 - share) * OUTLIER_LOG_LIKELIHOOD) / share;
            self.scatter += NEWEST * ((-2.0 * of_inliers).max(0.0) - self.scatter);
        }
        if blind == Blind::No && !step.is_gap && dt_s > 0.0 {
            // A step counts by its time: stamps that jitter make a millimetre in a millisecond of one, and what is too
            // short of one is too long of the next.
            let now = [step.matched.x / dt_s, step.matched.y / dt_s];
            let newest = (NEWEST_VELOCITY * step.paces).min(1.0);
            for (seen, now) in self.seen_m_s.iter_mut().zip(now) {
                *seen += newest * (now - *seen);
            }
            let speed_m_s = now[0].hypot(now[1]);
            if speed_m_s > STANDING_M_S {
                self.moves = (self.moves + step.paces).min(MOVES_REMEMBERED);
                self.usual_m_s += step.paces * (speed_m_s - self.usual_m_s) / self.moves.max(1.0);
            }
        }
    }
}

impl Blind {
    /// What a scan that was fitted to a map does not show.
    fn of(fit: &Fit, scan: &SurfaceScan, map: &SurfaceMap, least_distinctness: f64, matcher: &MatcherConfig) -> Self {
        let share = fit.result.inlier_share;
        if scan.len() < LEAST_POINTS || fit.explained_share < LEAST_SHARE {
            return Self::Altogether;
        }
        let position = fit.result.scan_information.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
        let weaker = position.eigenvalues.imin();
        let [weak, strong] = [position.eigenvalues[weaker], position.eigenvalues[1 - weaker]];
        if strong * SEEN_SIGMA_M * SEEN_SIGMA_M < 1.0 {
            return Self::Altogether;
        }
        let direction = [position.eigenvectors[(0, weaker)], position.eigenvectors[(1, weaker)]];
        if weak * SEEN_SIGMA_M * SEEN_SIGMA_M < 1.0 {
            return Self::Along(direction);
        }
        if weak * ALIKE * ALIKE > strong {
            return Self::No;
        }
        let pose = fit.result.belief.pose;
        let is_worse = |moved_m: f64| {
            let there = Pose2 { x: pose.x + moved_m * direction[0], y: pose.y + moved_m * direction[1], ..pose };
            inlier_share(map, scan, &there, matcher) < share - least_distinctness
        };
        if is_worse(MOVED_M) && is_worse(-MOVED_M) { Self::No } else { Self::Along(direction) }
    }

    /// How much of a motion in the axes of a body with this heading is not seen, metres.
    fn hidden_m(self, motion: &Vector2<f64>, heading_rad: f64) -> f64 {
        match self {
            Self::No => 0.0,
            Self::Along([x, y]) => {
                let (sin, cos) = heading_rad.sin_cos();
                (motion.x * (cos * x + sin * y) + motion.y * (cos * y - sin * x)).abs()
            }
            Self::Altogether => motion.norm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use crate::scan_matcher::{PoseBelief, match_scan};
    use crate::surface::Thinning;
    use nalgebra::Matrix3;

    /// A robot that sees walls of which it has a map, drawn from where it started.
    struct Robot {
        walls: Walls,
        map: SurfaceMap,
        unseen: UnseenMotion,
        proven_shares: [f64; 2],
    }

    impl Robot {
        fn new(walls: Walls, start: &Pose2, unseen: UnseenMotion) -> Self {
            let mut map = SurfaceMap::new(MatcherConfig::default().cell_m);
            map.add_scan(start, &seen(&walls, start));
            Self { walls, map, unseen, proven_shares: [1.0; 2] }
        }

        /// Comes to `pose` by a step along x of so many metres, of which the odometry reports `measured`; scans usually
        /// follow each other in 0.2 s.
        fn observe(&mut self, pose: &Pose2, step_m: f64, measured: Option<&Pose2>, elapsed_s: f64) {
            self.observe_so(pose, step_m, measured, elapsed_s, |_| {});
        }

        /// The same with a fit that is changed before.
        fn observe_so(
            &mut self,
            pose: &Pose2,
            step_m: f64,
            measured: Option<&Pose2>,
            elapsed_s: f64,
            change: impl Fn(&mut Fit),
        ) {
            let (matcher, scan) = (MatcherConfig::default(), seen(&self.walls, pose));
            let prior = PoseBelief { pose: *pose, information: Matrix3::identity() * 400.0 };
            let result = match_scan(&self.map, &scan, &prior, &matcher);
            let step = Step {
                measured,
                proven_shares: self.proven_shares,
                matched: &Pose2::new(step_m, 0.0, 0.0),
                elapsed_s,
                paces: elapsed_s / 0.2,
                is_gap: false,
                is_believed: true,
                is_tested: true,
            };
            let explained_share = result.inlier_share;
            let mut fit =
                Fit { result, explained_share, prior, odometry: OdometryVerdict::Confirmed, is_unearned: false };
            change(&mut fit);
            self.unseen.observe(&step, &fit, &scan, &self.map, &matcher);
        }
    }

    fn seen(walls: &Walls, pose: &Pose2) -> SurfaceScan {
        SurfaceScan::new(&walls.scan_from(pose, 361), &Thinning::default())
    }

    /// Drives 20 steps of 10 cm along x in a world that the robot knows, and reports `measured` of each step.
    fn drift_over_two_metres(walls: &Walls, start: Pose2, measured: Option<Pose2>) -> Drift {
        let unseen = UnseenMotion { seen_m_s: [0.5, 0.0], ..UnseenMotion::default() };
        let mut robot = Robot::new(walls.clone(), &start, unseen);
        for k in 1..=20 {
            let pose = start.compose(&Pose2::new(0.1 * f64::from(k), 0.0, 0.0));
            robot.observe(&pose, 0.1, measured.as_ref(), 0.2);
        }
        robot.unseen.drift()
    }

    /// A scan that fits 0.2 m from where the odometry has the robot, and whether there is reason to.
    #[test]
    fn who_contradicts_the_odometry_with_little_reason_may_be_where_it_says() {
        let room = Walls::room();
        let (there, here) = (Pose2::IDENTITY, Pose2::new(0.2, 0.0, 0.0));
        let sigma_m = |is_unearned: bool| {
            let mut robot = Robot::new(room.clone(), &there, UnseenMotion::default());
            robot.observe_so(&here, 0.2, Some(&Pose2::IDENTITY), 0.2, |fit| {
                fit.prior.pose = there;
                (fit.odometry, fit.is_unearned) = (OdometryVerdict::Contradicted, is_unearned);
            });
            robot.unseen.drift().sigma_m
        };
        let (earned_m, unearned_m) = (sigma_m(false), sigma_m(true));
        assert!(earned_m < 0.02 && (unearned_m - UNEARNED * 0.2).abs() < 0.02, "{earned_m} m, {unearned_m} m");
    }

    #[test]
    fn along_a_bare_corridor_it_is_the_wheels_that_are_believed_and_stuck_ones_are_not() {
        let corridor = Walls::default().with_box([0.0, 0.0], [60.0, 1.0]);
        let start = Pose2::new(-1.0, 0.0, 0.0);
        let good = drift_over_two_metres(&corridor, start, Some(Pose2::new(0.1, 0.0, 0.0)));
        assert!((0.05..0.2).contains(&good.sigma_m), "{good:?}");
        let stuck = drift_over_two_metres(&corridor, start, Some(Pose2::IDENTITY));
        assert!((1.5..2.5).contains(&stuck.sigma_m), "{stuck:?}");
        let none = drift_over_two_metres(&corridor, start, None);
        assert!(none.sigma_m > 0.8, "{none:?}");
    }

    #[test]
    fn in_the_dark_stuck_encoders_hide_turns_unless_a_gyro_reports_them() {
        let turned = |theta: f64| {
            drift_over_two_metres(&Walls::default(), Pose2::IDENTITY, Some(Pose2::new(0.0, 0.0, theta))).sigma_rad
        };
        let (stuck_rad, with_gyro_rad) = (turned(0.0), turned(1e-4));
        assert!((stuck_rad - 4.0 * USUAL_RAD_S).abs() < 1e-9 && with_gyro_rad < 0.01, "{stuck_rad} {with_gyro_rad}");
    }

    /// It drove at 0.5 m/s, and then nothing came for 200 s; since then the wheels report nothing.
    #[test]
    fn who_stands_for_long_is_not_stuck_all_the_time() {
        let corridor = Walls::default().with_box([0.0, 0.0], [60.0, 1.0]);
        let unseen = UnseenMotion { seen_m_s: [0.5, 0.0], ..UnseenMotion::default() };
        let mut robot = Robot::new(corridor, &Pose2::IDENTITY, unseen);
        robot.observe(&Pose2::IDENTITY, 0.0, Some(&Pose2::IDENTITY), 200.0);
        let drift = robot.unseen.drift();
        assert!((10.0..20.0).contains(&drift.sigma_m), "{drift:?}");
    }

    #[test]
    fn wheels_that_have_proven_good_are_believed_along_a_corridor_but_not_for_ever() {
        let corridor = Walls::default().with_box([0.0, 0.0], [60.0, 1.0]);
        let drift_with = |share: f64| {
            let start = Pose2::new(-1.0, 0.0, 0.0);
            let unseen = UnseenMotion { seen_m_s: [0.5, 0.0], ..UnseenMotion::default() };
            let mut robot = Robot::new(corridor.clone(), &start, unseen);
            robot.proven_shares = [share; 2];
            for k in 1..=20 {
                let pose = start.compose(&Pose2::new(0.1 * f64::from(k), 0.0, 0.0));
                robot.observe(&pose, 0.1, Some(&Pose2::new(0.1, 0.0, 0.0)), 0.2);
            }
            robot.unseen.drift().sigma_m
        };
        let [stated, proven, perfect] = [1.0, 0.3, 0.0].map(drift_with);
        assert!((proven - 0.3 * stated).abs() < 1e-9 && perfect > 0.0, "{stated} {proven} {perfect}");
    }

    /// 0.25 m/s, where every third scan comes a millisecond after the one before and the next one late.
    #[test]
    fn stamps_that_jitter_make_no_speed() {
        let mut robot = Robot::new(Walls::room(), &Pose2::IDENTITY, UnseenMotion::default());
        let step = Pose2::new(0.05, 0.0, 0.0);
        for k in 1..=60 {
            robot.observe(&Pose2::new(0.01 * k as f64, 0.0, 0.0), 0.05, Some(&step), [0.2, 0.001, 0.399][k % 3]);
            let UnseenMotion { usual_m_s, seen_m_s: [seen_m_s, _], .. } = robot.unseen;
            assert!(usual_m_s < 1.0 && seen_m_s < 0.5, "{k}: {usual_m_s} m/s, {seen_m_s} m/s");
        }
    }

    #[test]
    fn in_a_room_everything_is_seen_whatever_the_wheels_say() {
        for measured in [Some(Pose2::new(0.1, 0.0, 0.0)), Some(Pose2::IDENTITY)] {
            let drift = drift_over_two_metres(&Walls::room(), Pose2::new(-1.0, 0.0, 0.0), measured);
            assert!(drift.sigma_m < 0.05, "{measured:?}: {drift:?}");
        }
    }
}
