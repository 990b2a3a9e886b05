//! One mode of the belief: a pose with its covariance, followed by particles and scan matching together.
//!
//! The belief is a sum of Gaussians, each of which is followed by a particle filter whose particles are drawn from the
//! measurement (Gaussian sum particle filter, Kotecha & Djurić 2003; proposals as in Grisetti et al. 2007): where the pose
//! is certain matching alone decides, where it is not particles look for where the scan fits best.

use super::localization_map::LocalizationMap;
use super::sensing::{Explanation, Fit, Sensing};
use crate::back_end::Uncertainty;
use crate::front_end::samples_for_bins;
use crate::geometry::Pose2;
use crate::geometry::covariance::{inverse, isotropic, symmetric};
use crate::key_scan::Drift;
use crate::random::{Stage, generator};
use crate::scan_matcher::PoseBelief;
use crate::surface::SurfaceScan;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;

/// A hypothesis of where the robot is.
#[derive(Debug, Clone)]
pub(super) struct Hypothesis {
    /// Told apart by this.
    pub(super) id: u64,
    /// In the grid's frame.
    pub(super) pose: Pose2,
    /// Over (x, y, θ) in the grid's axes.
    pub(super) covariance: Matrix3<f64>,
    /// Log-likelihood of each key scan of the history, tempered.
    pub(super) evidence: VecDeque<f64>,
    /// The last scan's explanation.
    pub(super) explanation: Explanation,
    /// The mean of the last scans' explanations.
    pub(super) usual: Option<Explanation>,
    /// The share of the rays on the map that it is accustomed to: what falls short of it is doubtful. Follows slowly where
    /// it falls, so that a pose that drifts away from the robot does not become the usual one.
    pub(super) accustomed: Option<f64>,
    /// How far the last fit lay from where the motion leads, standard deviations.
    pub(super) innovation_sigmas: f64,
    /// The same, metres.
    pub(super) innovation_m: f64,
    /// Motion of the last step.
    pub(super) last_motion: Pose2,
    /// The last fit.
    pub(super) scan_information: Matrix3<f64>,
}

/// Around a pose that fits scans prevail from so many standard deviations of the motion on.
const TRUSTED_SIGMAS: f64 = 3.0;
/// Mean log-likelihood of a ray that any map leaves; how fast a scan's information falls with what is left beyond that, and
/// how far.
const UNEXPLAINED_BY_ANY: f64 = 0.5;
const DOUBT_PER_UNEXPLAINED: f64 = 3.0;
const LEAST_SCALE: f64 = 0.003;
/// Bins by which poses are told apart, metres and radians (KLD sampling, Fox 2003) …
const BIN_M: f64 = 0.5;
const BIN_RAD: f64 = 0.25;
/// … the divergence that is allowed, and how sure it is that it is no larger.
const DIVERGENCE: f64 = 0.05;
const QUANTILE_SIGMAS: f64 = 2.33;
/// A hypothesis has no more particles than this.
const MOST_PARTICLES: usize = 500;
/// So many of the best particles are fitted.
const FITTED: usize = 6;
/// Points by which particles are weighed, and how many of these are independent.
const WEIGHED_POINTS: usize = 40;
const INDEPENDENT_POINTS: f64 = 20.0;
/// Share of the rays on the map below which a fit is looked at again with particles, against what is usual.
const DOUBTFUL: f64 = 0.85;
/// How many times the prior's standard deviation particles are spread then, and by how much beyond that, metres and
/// radians: what has drifted away is more certain than right.
const WIDENED: f64 = 3.0;
const DOUBTFUL_SIGMA_M: f64 = 0.3;
const DOUBTFUL_SIGMA_RAD: f64 = 0.15;
/// What the map explains less than before becomes the usual over this time, seconds.
const ACCUSTOMED_S: f64 = 10.0;
/// Weight of the newest scan in the mean of explanations.
const NEWEST: f64 = 0.15;

impl Hypothesis {
    pub(super) fn new(id: u64, pose: Pose2, covariance: Matrix3<f64>) -> Self {
        Self {
            id,
            pose,
            covariance,
            evidence: VecDeque::new(),
            explanation: Explanation::default(),
            usual: None,
            accustomed: None,
            innovation_sigmas: 0.0,
            innovation_m: 0.0,
            last_motion: Pose2::IDENTITY,
            scan_information: Matrix3::zeros(),
        }
    }

    /// Sum of the evidence.
    pub(super) fn log_evidence(&self) -> f64 {
        self.evidence.iter().sum()
    }

    /// Moves along, with the motion's covariance (in the grid's axes), and by how much it may be off always the same way.
    pub(super) fn predict(&mut self, motion: &Pose2, noise: &Matrix3<f64>, drift: &Drift) {
        let moved = self.pose.compose(motion);
        let mut jacobian = Matrix3::identity();
        jacobian[(0, 2)] = -(moved.y - self.pose.y);
        jacobian[(1, 2)] = moved.x - self.pose.x;
        self.covariance = symmetric(&(jacobian * self.covariance * jacobian.transpose() + noise));
        // Standard deviations of errors that do not average out add up as they are.
        let grown = |sigma: f64, by: f64| by * (2.0 * sigma + by);
        let of_drift =
            [grown(self.sigma_m(), drift.sigma_m), grown(self.covariance[(2, 2)].max(0.0).sqrt(), drift.sigma_rad)];
        self.covariance += Matrix3::from_diagonal(&Vector3::new(of_drift[0], of_drift[0], of_drift[1]));
        self.pose = moved;
        self.last_motion = *motion;
    }

    /// Standard deviation of the position along the direction in which it is known worst, metres.
    pub(super) fn sigma_m(&self) -> f64 {
        Uncertainty::of(&self.covariance).sigma_m
    }

    /// Moves to where the scan fits; the number of particles that it took. `key` makes the draws its own.
    pub(super) fn correct(
        &mut self,
        map: &LocalizationMap,
        sensing: &Sensing,
        scan: &SurfaceScan,
        elapsed_s: f64,
        [seed, step]: [u64; 2],
        most_particles: usize,
    ) -> usize {
        // Where the map is wrong in many places its errors last for longer than a scan: each counts for less then.
        let usual = -self.usual.unwrap_or_else(|| sensing.explain(map, scan, &self.pose)).log_likelihood;
        let scale = (-DOUBT_PER_UNEXPLAINED * (usual - UNEXPLAINED_BY_ANY)).exp().clamp(LEAST_SCALE, 1.0);
        let scale = if self.usual.is_some() { scale * sensing.independence(&self.last_motion) } else { scale };
        let own = PoseBelief { pose: self.pose, information: inverse(&self.covariance) };
        let prior = PoseBelief { information: own.information / scale, ..own };
        let trusted_sigmas = TRUSTED_SIGMAS / scale.sqrt();
        let mut fit = sensing.fit(map, scan, &prior, trusted_sigmas);
        let mut explanation = sensing.explain(map, scan, &fit.belief.pose);
        let is_doubtful = self.accustomed.is_some_and(|usual| explanation.on_map < DOUBTFUL * usual);
        let spread = if is_doubtful {
            WIDENED * WIDENED * self.covariance + isotropic(DOUBTFUL_SIGMA_M, DOUBTFUL_SIGMA_RAD)
        } else {
            self.covariance
        };
        let particles = particles_needed(&spread).min(most_particles);
        if particles > 1 {
            let value = |fit: &Fit, explanation: &Explanation| {
                INDEPENDENT_POINTS * explanation.log_likelihood
                    - (0.5 * own.sigmas_to(&fit.belief.pose).powi(2)).ln_1p()
            };
            for start in self.best_particles(map, sensing, scan, particles, &spread, [seed, step]) {
                let other = sensing.fit_from(map, scan, &start, &prior, trusted_sigmas);
                let its = sensing.explain(map, scan, &other.belief.pose);
                let least = SWITCH - SWITCH_UNEXPLAINED * INDEPENDENT_POINTS * explanation.log_likelihood;
                if value(&other, &its) > value(&fit, &explanation) + least {
                    (fit, explanation) = (other, its);
                }
            }
        }
        let sharing = if self.usual.is_some() { sensing.sharing(&self.last_motion).mul_add(0.5, 0.5) } else { 1.0 };
        let (pose, scan_information) = tested(map, sensing, scan, &fit, &prior, sharing);
        self.innovation_sigmas = own.sigmas_to(&pose);
        let moved = self.pose.between(&pose);
        self.innovation_m = moved.distance();
        self.last_motion = self.last_motion.compose(&moved);
        self.pose = pose;
        self.scan_information = scale * scan_information;
        self.covariance = symmetric(&inverse(&(own.information + self.scan_information)));
        self.explanation = explanation;
        let follows = |accustomed: f64| {
            let share = if explanation.on_map > accustomed { NEWEST } else { (elapsed_s / ACCUSTOMED_S).min(NEWEST) };
            accustomed + share * (explanation.on_map - accustomed)
        };
        self.accustomed = Some(self.accustomed.map_or(explanation.on_map, follows));
        self.usual = Some(self.usual.map_or(explanation, |usual| usual.towards(&explanation, NEWEST)));
        particles
    }

    /// The best of particles drawn from the prior, apart from each other.
    fn best_particles(
        &self,
        map: &LocalizationMap,
        sensing: &Sensing,
        scan: &SurfaceScan,
        count: usize,
        spread: &Matrix3<f64>,
        [seed, step]: [u64; 2],
    ) -> Vec<Pose2> {
        let Some(root) = spread.cholesky().map(|factor| factor.l()) else { return Vec::new() };
        let mut random = generator(seed, Stage::Proposal, step, self.id);
        let mut weighed: Vec<(f64, Pose2)> = (0..count)
            .map(|_| {
                let draw = Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
                let offset: Vector3<f64> = root * draw;
                let pose = Pose2::new(self.pose.x + offset.x, self.pose.y + offset.y, self.pose.theta + offset.z);
                (sensing.weigh(map, scan, &pose, WEIGHED_POINTS), pose)
            })
            .collect();
        weighed.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Vec<Pose2> = Vec::new();
        for (_, pose) in weighed {
            let is_near = |other: &Pose2| {
                let between = other.between(&pose);
                between.distance() < BIN_M && between.theta.abs() < BIN_RAD
            };
            if best.len() < FITTED && !best.iter().any(is_near) {
                best.push(pose);
            }
        }
        best
    }
}

/// How many particles a spread of poses needs.
fn particles_needed(spread: &Matrix3<f64>) -> usize {
    let bins = |axis: usize, bin: f64| 1.0 + (2.0 * spread[(axis, axis)].max(0.0).sqrt() / bin).floor();
    let bins = bins(0, BIN_M) * bins(1, BIN_M) * bins(2, BIN_RAD);
    if bins < 2.0 {
        return 1;
    }
    (samples_for_bins(bins, DIVERGENCE, QUANTILE_SIGMAS) as usize).clamp(2, MOST_PARTICLES)
}

/// Puts the direction of which a scan knows the least to the test: moved along it the scan must fit worse, since noise alone
/// bends the sum that is minimised, also along a bare wall. Gives the pose and the information of the scan as they are if it
/// knows of that direction only what the test shows. `sharing` scans show the same.
fn tested(
    map: &LocalizationMap,
    sensing: &Sensing,
    scan: &SurfaceScan,
    fit: &Fit,
    prior: &PoseBelief,
    sharing: f64,
) -> (Pose2, Matrix3<f64>) {
    let position = fit.scan_information.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
    let weaker = position.eigenvalues.imin();
    let [weak, strong] = [position.eigenvalues[weaker], position.eigenvalues[1 - weaker]];
    let pose = fit.belief.pose;
    if weak <= 0.0 || weak * ALIKE * ALIKE > strong {
        return (pose, fit.scan_information);
    }
    let direction = position.eigenvectors.column(weaker).into_owned();
    let moved = |by_m: f64| Pose2 { x: pose.x + by_m * direction[0], y: pose.y + by_m * direction[1], ..pose };
    let fits = |by_m: f64| INDEPENDENT_POINTS * sensing.weigh(map, scan, &moved(by_m), TESTED_POINTS);
    let worse = (fits(0.0) - fits(MOVED_M).max(fits(-MOVED_M))).max(0.0);
    let shown = (2.0 * worse / (MOVED_M * MOVED_M * sharing)).min(weak);
    let whole = Matrix2::identity() - (1.0 - (shown / weak).sqrt()) * direction * direction.transpose();
    let mut scale = Matrix3::identity();
    scale.fixed_view_mut::<2, 2>(0, 0).copy_from(&whole);
    // The prior holds the pose back by as much more as the scan knows less.
    let of_prior = (direction.transpose() * prior.information.fixed_view::<2, 2>(0, 0) * direction)[(0, 0)];
    let kept = shown * (weak + of_prior) / (weak * (shown + of_prior)).max(f64::MIN_POSITIVE);
    let along_m = direction.dot(&Vector2::new(pose.x - prior.pose.x, pose.y - prior.pose.y));
    (moved((kept - 1.0) * along_m), scale * fit.scan_information * scale)
}

/// Directions of which a scan knows alike are both seen; else the weaker one is put to the test: ratio of standard deviations.
const ALIKE: f64 = 1.5;
/// How far the scan is moved for that, metres, and how many of its points are looked at.
const MOVED_M: f64 = 0.3;
const TESTED_POINTS: usize = 100;

/// By how much another pose has to be better than the one that follows from the motion, beside this share of what that
/// leaves unexplained: in a map that is wrong in many places something else always fits a little better.
const SWITCH: f64 = 1.0;
const SWITCH_UNEXPLAINED: f64 = 0.2;
