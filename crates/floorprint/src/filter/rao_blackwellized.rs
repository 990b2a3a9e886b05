//! The Rao-Blackwellised particle filter: a map for every particle, poses drawn from the
//! measurement (Grisetti, Stachniss & Burgard 2007; FastSLAM 2, Montemerlo et al. 2003).

use super::genealogy::Trail;
use super::odometry_scale::OdometryScale;
use super::odometry_trust::OdometryTrust;
use super::resampler::draw_anew;
use super::weights::{effective_number, heaviest, normalise};
use super::{FilterConfig, FilterStep};
use crate::Config;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::loop_closure::{Interruption, KeyScan};
use crate::map::SurfaceMap;
use crate::motion_model::MotionConfig;
use crate::profiler::{Phase, Profiler};
use crate::random::{Stage, generator};
use crate::scan_matcher::{MatchResult, MatcherConfig, OdometryVerdict, PoseBelief, SurfaceScan, inlier_share, locate};
use crate::sensors::StampedPose;
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// One hypothesis: where the robot is, how it got there, and what the world then looks like.
#[derive(Debug, Clone)]
struct Particle {
    pose: Pose2,
    /// Logarithm of the evidence since the last resampling.
    log_weight: f64,
    /// Logarithm of the evidence of the whole trajectory: after a resampling the weights say nothing.
    log_evidence: f64,
    map: SurfaceMap,
    trail: Trail,
    /// Motion of the last step, for when nothing measures the next.
    last_motion: Pose2,
    /// Where the last scan was written into the map.
    last_written: Option<Pose2>,
    /// The scans that the map is made of, where the map is to forget older ones.
    written: VecDeque<(Pose2, Arc<SurfaceScan>)>,
    /// Path since the oldest scan in the map, metres.
    mapped_m: f64,
    /// What the odometry says of each step since the last scan that fitted.
    unconfirmed: Vec<Pose2>,
}

/// N particles, each with a map of its own.
#[derive(Debug)]
pub struct RaoBlackwellizedFilter {
    seed: u64,
    config: FilterConfig,
    motion: MotionConfig,
    matcher: MatcherConfig,
    particles: Vec<Particle>,
    /// How good the odometry has turned out to be.
    odometry: OdometryTrust,
    /// By how much it reads long or short.
    scale: OdometryScale,
    /// Length of the path that the maps remember, metres; unlimited where loops are not closed later.
    window_m: f64,
    /// The scan that the last step wrote into the maps, if it wrote one; all particles write the same ones.
    key_scan: Option<KeyScan>,
    /// How many scans were written.
    written: usize,
    /// Covariance of the best particle's motion since the last of them.
    doubt: Matrix3<f64>,
    /// Whether one of the matches since may have been wrong.
    is_doubtful: bool,
    /// How many scans in a row did not fit the map.
    misfits: usize,
    /// Whether each of them contradicts it beyond doubt.
    is_certainly_lost: bool,
    /// Share of the last scan that fitted which lay on the map.
    usual_inlier_share: f64,
    steps: u64,
}

impl RaoBlackwellizedFilter {
    /// All particles at the origin, nothing mapped.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let count = config.filter.first_particles();
        let particle = Particle {
            pose: Pose2::IDENTITY,
            log_weight: -(count as f64).ln(),
            log_evidence: 0.0,
            map: SurfaceMap::new(config.matcher.cell_m),
            trail: Trail::default(),
            last_motion: Pose2::IDENTITY,
            last_written: None,
            written: VecDeque::new(),
            mapped_m: 0.0,
            unconfirmed: Vec::new(),
        };
        Self {
            seed: config.seed,
            config: config.filter.clone(),
            motion: config.motion.clone(),
            matcher: config.matcher.clone(),
            particles: vec![particle; count],
            odometry: OdometryTrust::default(),
            scale: OdometryScale::default(),
            window_m: if config.loop_closure.enabled { config.loop_closure.window_m } else { f64::INFINITY },
            key_scan: None,
            written: 0,
            doubt: Matrix3::zeros(),
            is_doubtful: false,
            misfits: 0,
            is_certainly_lost: false,
            usual_inlier_share: 0.0,
            steps: 0,
        }
    }

    /// One step: predict, match, weigh, resample, map.
    pub fn process(&mut self, frame: &Frame, profiler: &mut dyn Profiler) -> FilterStep {
        profiler.enter(Phase::Match);
        let scan = Arc::new(SurfaceScan::new(&frame.scan, &self.matcher));
        let motion = frame.motion.as_ref().map(|measured| self.scale.correct(measured));
        let matches: Vec<Option<Fit>> = self
            .particles
            .par_iter_mut()
            .map(|particle| particle.follow(motion.as_ref(), &scan, &self.odometry, &self.motion, &self.matcher))
            .collect();

        let starts_anew = self.notice_loss(&scan, &matches);
        // All particles moved alike but for noise: the scan is due for all of them or for none.
        let due = self.misfits == 0
            && !scan.is_empty()
            && self.particles.iter().any(|particle| particle.is_due(&self.matcher));
        // What does not fit was matched to a map that does not show it.
        let fits = self.misfits == 0 && starts_anew.is_none();
        if due && fits {
            self.draw_and_weigh(&matches, &scan);
        }
        profiler.enter(Phase::Resample);
        let weights = self.normalised_weights();
        let effective_particles = effective_number(&weights);
        let best = self.best();
        let resampled = due && effective_particles < self.config.resample_below * self.particles.len() as f64;

        if let Some(fit) = &matches[best] {
            self.doubt =
                if fits { fit.covariance_after(&self.doubt) } else { fit.covariance_without_scan(&self.doubt) };
            self.is_doubtful |= fit.is_doubtful();
            if let Some((measured, corrected)) = frame.motion.as_ref().zip(motion.as_ref()).filter(|_| fits) {
                let (sigma_m, _) = self.motion.sigmas(measured);
                let Particle { pose, last_motion, .. } = &self.particles[best];
                let information = &fit.result.scan_information;
                self.odometry.learn(corrected, last_motion, sigma_m, information);
                if fit.odometry == OdometryVerdict::Confirmed {
                    self.scale.learn(measured, last_motion, pose.theta - last_motion.theta, information);
                }
            }
        }
        profiler.enter(Phase::Map);
        let pose = self.particles[best].pose;
        if due {
            let (window_m, cell_m) = (self.window_m, self.matcher.cell_m);
            let carve = self.written.is_multiple_of(CARVE_EVERY);
            self.particles.par_iter_mut().for_each(|particle| particle.write(&scan, carve, window_m, cell_m));
            self.written += 1;
        }
        self.key_scan = due.then(|| KeyScan {
            frame: self.steps as usize,
            pose,
            covariance: std::mem::take(&mut self.doubt)
                + if std::mem::take(&mut self.is_doubtful) { blunder() } else { Matrix3::zeros() },
            scan: Arc::clone(&scan),
            starts_anew,
        });
        for particle in &mut self.particles {
            particle.trail.push(StampedPose { stamp_s: frame.stamp_s, pose: particle.pose });
        }
        profiler.enter(Phase::Resample);
        if resampled {
            self.resample(&weights);
        }
        self.steps += 1;
        let fit = matches[best];
        FilterStep {
            pose,
            effective_particles,
            inlier_share: fit.map_or(1.0, |fit| fit.result.inlier_share),
            score: fit.map_or(0.0, |fit| fit.result.score),
            resampled,
            odometry_rejected: fit.is_some_and(|fit| fit.odometry != OdometryVerdict::Confirmed),
        }
    }

    /// Counts scans that contradict the map. They are not written; when they do not cease the robot was carried
    /// elsewhere, and the maps begin anew. Where that is on the old map is for the loop closure to find out; without
    /// it there is no beginning anew.
    fn notice_loss(&mut self, scan: &SurfaceScan, matches: &[Option<Fit>]) -> Option<Interruption> {
        let fit = matches[self.best()].filter(|_| scan.len() >= LEAST_POINTS && self.window_m.is_finite());
        let is_contradicted = fit.map_or(Some(false), |fit| self.is_contradicted_by(scan, &fit.result));
        // Scans of which nothing can be told leave it at what those before said.
        let Some(fit) = fit.filter(|_| is_contradicted.unwrap_or(self.misfits > 0)) else {
            if std::mem::take(&mut self.misfits) > 0 {
                self.particles.iter_mut().for_each(Particle::correct_misfits);
            }
            self.usual_inlier_share = fit.map_or(0.0, |fit| fit.result.inlier_share);
            self.particles.iter_mut().for_each(|particle| particle.unconfirmed.clear());
            return None;
        };
        let is_certain = is_contradicted.is_some() && fit.result.inlier_share < LOST_INLIER_SHARE;
        self.is_certainly_lost = is_certain && (self.misfits == 0 || self.is_certainly_lost);
        self.misfits += 1;
        if self.misfits < MISFITS_BEFORE_LOSS {
            return None;
        }
        let frame = (self.steps as usize + 1).saturating_sub(std::mem::take(&mut self.misfits));
        self.usual_inlier_share = 0.0;
        self.particles.iter_mut().for_each(|particle| particle.begin_anew(self.matcher.cell_m));
        Some(Interruption { frame, is_certain: self.is_certainly_lost })
    }

    /// Whether a scan shows that the robot is not where it was matched: little of it lies on the map there, or
    /// suddenly less than before, and of what it and the last scan in the map both had in view much is missing. A
    /// robot that turns to what it has not seen yet contradicts nothing; and in a corridor much fits that is
    /// somewhere else. `None` where too little was in view of both.
    fn is_contradicted_by(&self, scan: &SurfaceScan, fit: &MatchResult) -> Option<bool> {
        let is_usual = fit.inlier_share >= LOST_INLIER_SHARE.max(self.usual_inlier_share - SUDDEN_LOSS);
        let particle = self.best_particle();
        let Some((last_pose, last)) = particle.written.back().filter(|_| !is_usual) else { return Some(false) };
        let pose = &fit.belief.pose;
        let here = scan.in_view_of(pose, last, last_pose);
        let there = last.in_view_of(last_pose, scan, pose);
        let points = here.len() + there.len();
        if points < 2 * LEAST_POINTS {
            return None;
        }
        let mut map = SurfaceMap::new(self.matcher.cell_m);
        map.add_scan(pose, scan);
        let found = here.len() as f64 * inlier_share(&particle.map, &here, pose, &self.matcher)
            + there.len() as f64 * inlier_share(&map, &there, last_pose, &self.matcher);
        Some(found < (1.0 - MISSING_SHARE) * points as f64)
    }

    /// Draws each pose from the Gaussian around its optimum and multiplies each weight by the
    /// evidence of the scan. With one particle both would only add noise.
    fn draw_and_weigh(&mut self, matches: &[Option<Fit>], scan: &SurfaceScan) {
        if self.particles.len() == 1 {
            return;
        }
        let points = (scan.len() as f64).min(self.matcher.independent_points);
        for (index, (particle, fit)) in self.particles.iter_mut().zip(matches).enumerate() {
            let Some(fit) = fit else { continue };
            let log_evidence = self.config.evidence_share * fit.log_evidence(points);
            particle.log_weight += log_evidence;
            particle.log_evidence += log_evidence;
            let mut random = generator(self.seed, Stage::Proposal, self.steps, index as u64);
            let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
            // Information = L Lᵀ, so L⁻ᵀ noise has the covariance information⁻¹.
            if let Some(offset) =
                fit.result.belief.information.cholesky().and_then(|l| l.l().transpose().solve_upper_triangular(&noise))
            {
                let pose = particle.pose;
                particle.pose = Pose2::new(pose.x + offset.x, pose.y + offset.y, pose.theta + offset.z);
            }
        }
    }

    fn normalised_weights(&mut self) -> Vec<f64> {
        let mut log_weights: Vec<f64> = self.particles.iter().map(|particle| particle.log_weight).collect();
        let weights = normalise(&mut log_weights);
        for (particle, log_weight) in self.particles.iter_mut().zip(log_weights) {
            particle.log_weight = log_weight;
        }
        weights
    }

    fn resample(&mut self, weights: &[f64]) {
        let poses: Vec<Pose2> = self.particles.iter().map(|particle| particle.pose).collect();
        let chosen = draw_anew(&self.config, &poses, weights, self.seed, self.steps);
        for particle in &mut self.particles {
            particle.trail.fork();
            particle.log_weight = -(chosen.len() as f64).ln();
        }
        self.particles = chosen.into_iter().map(|index| self.particles[index].clone()).collect();
    }

    /// The scan that the last step wrote into the maps, if it wrote one, at the pose of the best particle.
    pub fn take_key_scan(&mut self) -> Option<KeyScan> {
        self.key_scan.take()
    }

    /// By how much true lengths are longer than those that the odometry states, as a ratio, learnt where scans can tell.
    #[must_use]
    pub fn odometry_scale(&self) -> f64 {
        self.scale.ratio()
    }

    /// The trajectory of the best particle.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        self.best_particle().trail.poses()
    }

    /// The poses of the best particle from a frame on, counted from 0.
    #[must_use]
    pub fn poses_since(&self, frame: usize) -> Vec<Pose2> {
        let recent = self.best_particle().trail.last((self.steps as usize).saturating_sub(frame));
        recent.into_iter().map(|stamped| stamped.pose).collect()
    }

    fn best_particle(&self) -> &Particle {
        &self.particles[self.best()]
    }

    /// The particle whose trajectory explains all scans best.
    fn best(&self) -> usize {
        let evidence: Vec<f64> = self.particles.iter().map(|particle| particle.log_evidence).collect();
        heaviest(&evidence)
    }
}

/// One in this many written scans is used to clear away what is no longer there.
const CARVE_EVERY: usize = 3;
/// A pose is in doubt where less than this share of its scan lies on the map.
const DOUBTFUL_INLIER_SHARE: f64 = 0.6;
/// How far a pose in doubt may be off: standard deviations, metres and radians.
const BLUNDER_SIGMA_M: f64 = 0.3;
const BLUNDER_SIGMA_RAD: f64 = 0.08;

/// A scan of which less than this share lies on the map does not fit it …
const LOST_INLIER_SHARE: f64 = 0.55;
/// … if it has at least this many points; the robot is lost when so many scans in a row do not fit. On
/// recorded drives single scans fit by 0.52 at the least.
const LEAST_POINTS: usize = 30;
const MISFITS_BEFORE_LOSS: usize = 3;
/// Nor does one that suddenly lies on the map by this much less. Either contradicts the map only if, of what it and the
/// last scan in the map both had in view, this share is missing: people and doors come to less, or come little by
/// little, and who turns sees new things.
const SUDDEN_LOSS: f64 = 0.28;
const MISSING_SHARE: f64 = 0.25;

/// Covariance of a pose in doubt.
fn blunder() -> Matrix3<f64> {
    Matrix3::from_diagonal(&[BLUNDER_SIGMA_M.powi(2), BLUNDER_SIGMA_M.powi(2), BLUNDER_SIGMA_RAD.powi(2)].into())
}

/// How much the last motion is believed to go on, as a factor on the information that odometry would
/// give. With a quarter of it a door that swings carries the robot along (intel without odometry: 0.173 m
/// instead of 0.013 m); twice as much or half of it make no difference.
const PREDICTION_TRUST: f64 = 0.2;

/// How a particle's scan fitted its map.
#[derive(Debug, Clone, Copy)]
struct Fit {
    result: MatchResult,
    /// The odometry's belief before the scan.
    prior: PoseBelief,
    odometry: OdometryVerdict,
}

impl Fit {
    /// How uncertain the motion since the last written scan is, given how uncertain it was one scan
    /// ago: the odometry adds to it, and what the scan tells takes away.
    fn covariance_after(&self, before: &Matrix3<f64>) -> Matrix3<f64> {
        let moved = self.covariance_without_scan(before);
        let information = moved.try_inverse().unwrap_or_else(Matrix3::identity) + self.result.scan_information;
        information.try_inverse().unwrap_or_else(Matrix3::identity)
    }

    /// The same where the scan says nothing.
    fn covariance_without_scan(&self, before: &Matrix3<f64>) -> Matrix3<f64> {
        before + self.prior.information.try_inverse().unwrap_or_else(Matrix3::identity)
    }

    /// Whether the optimum may be a wrong one, of which the curvature says nothing: scan and
    /// odometry disagreed altogether, or little of the scan lay on the map.
    fn is_doubtful(&self) -> bool {
        self.odometry == OdometryVerdict::Abandoned || self.result.inlier_share < DOUBTFUL_INLIER_SHARE
    }

    /// Logarithm of ∫ p(scan | pose) p(pose | odometry) dpose, by Laplace's method around the optimum.
    fn log_evidence(&self, points: f64) -> f64 {
        let offset = Vector3::new(
            self.result.belief.pose.x - self.prior.pose.x,
            self.result.belief.pose.y - self.prior.pose.y,
            crate::geometry::wrap_angle(self.result.belief.pose.theta - self.prior.pose.theta),
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

impl Particle {
    /// Moves with the odometry, then to where the scan fits the particle's map, once there is one.
    fn follow(
        &mut self,
        measured: Option<&Pose2>,
        scan: &SurfaceScan,
        trust: &OdometryTrust,
        motion: &MotionConfig,
        matcher: &MatcherConfig,
    ) -> Option<Fit> {
        // Without odometry the robot is taken to go on as it did, with room for change.
        let continued = PoseBelief {
            pose: self.pose.compose(&self.last_motion),
            information: motion.information(&self.last_motion) * PREDICTION_TRUST,
        };
        let step = measured.copied().unwrap_or(self.last_motion);
        let prior = measured.map_or(continued, |measured| PoseBelief {
            pose: self.pose.compose(measured),
            information: motion.scaled_information(measured, trust.noise()),
        });
        self.unconfirmed.push(step);
        if self.map.is_empty() {
            (self.pose, self.last_motion) = (prior.pose, step);
            return None;
        }
        let (result, odometry) = locate(&self.map, scan, &prior, &continued, matcher);
        self.last_motion = self.pose.between(&result.belief.pose);
        self.pose = result.belief.pose;
        Some(Fit { result, prior, odometry })
    }

    /// Whether the robot moved far enough since the last scan that went into the map.
    fn is_due(&self, matcher: &MatcherConfig) -> bool {
        self.last_written.is_none_or(|last| {
            let moved = last.between(&self.pose);
            moved.distance() > matcher.insert_distance_m || moved.theta.abs() > matcher.insert_angle_rad
        })
    }

    /// Gives the scans that did not fit poses that lead to where the robot is now, as the odometry has it: they may
    /// have been matched to what they do not show.
    fn correct_misfits(&mut self) {
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

    /// Forgets the map of a robot that was carried elsewhere. The scans since then were matched to a map that does not
    /// show where they were taken: for their poses the odometry is asked instead.
    fn begin_anew(&mut self, cell_m: f64) {
        self.map = SurfaceMap::new(cell_m);
        self.written.clear();
        (self.mapped_m, self.last_written) = (0.0, None);
        let steps = std::mem::take(&mut self.unconfirmed);
        let Some(mut pose) = self.trail.last(steps.len()).first().map(|last_fit| last_fit.pose) else { return };
        let mut poses = steps.iter().map(|step| {
            pose = pose.compose(step);
            pose
        });
        self.trail.correct_last(steps.len() - 1, &mut poses);
        self.pose = poses.next().unwrap_or(self.pose);
        self.last_motion = steps[steps.len() - 1];
    }

    /// Writes the scan into the map. A map that has grown too long a past is made anew from the younger half of it.
    fn write(&mut self, scan: &Arc<SurfaceScan>, carve: bool, window_m: f64, cell_m: f64) {
        if carve {
            self.map.carve(&self.pose, scan);
        }
        self.map.add_scan(&self.pose, scan);
        self.mapped_m += self.last_written.map_or(0.0, |last| last.between(&self.pose).distance());
        self.last_written = Some(self.pose);
        if window_m.is_infinite() {
            return;
        }
        self.written.push_back((self.pose, Arc::clone(scan)));
        if self.mapped_m > window_m {
            while self.mapped_m > 0.5 * window_m && self.written.len() > 1 {
                let Some((oldest, _)) = self.written.pop_front() else { break };
                self.mapped_m -= oldest.between(&self.written[0].0).distance();
            }
            self.map = SurfaceMap::new(cell_m);
            for (pose, scan) in &self.written {
                self.map.add_scan(pose, scan);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::AdaptiveConfig;
    use super::*;
    use crate::frame::BodyScan;
    use crate::profiler::NoProfiler;
    use crate::scan_matcher::synthetic::{Walls, frame, poses_along};

    fn config(particles: usize) -> Config {
        let mut config = Config::default();
        config.filter.particles = particles;
        config
    }

    /// Odometry of a step, off by a little that changes from step to step.
    fn odometry(truth: &[Pose2], k: usize) -> Pose2 {
        let step = if k == 0 { Pose2::IDENTITY } else { truth[k - 1].between(&truth[k]) };
        let wobble = [0.004, -0.003, 0.005, -0.006][k % 4];
        if k == 0 { step } else { step.compose(&Pose2::new(wobble, -wobble, wobble)) }
    }

    /// Laps of 10 m in the room.
    fn laps(count: usize) -> Vec<Pose2> {
        let corners: Vec<[f64; 2]> =
            (0..=4 * count).map(|k| [[-1.5, -1.0], [1.5, -1.0], [1.5, 1.0], [-1.5, 1.0]][k % 4]).collect();
        poses_along(&corners, 0.12)
    }

    fn drive(filter: &mut RaoBlackwellizedFilter, truth: &[Pose2]) -> Vec<FilterStep> {
        let room = Walls::room();
        let step = |k: usize| frame(k, Some(odometry(truth, k)), room.scan_from(&truth[k], 181));
        (0..truth.len()).map(|k| filter.process(&step(k), &mut NoProfiler)).collect()
    }

    /// Drives and gathers the key scans.
    fn key_scans_of(filter: &mut RaoBlackwellizedFilter, truth: &[Pose2]) -> Vec<KeyScan> {
        let room = Walls::room();
        let step = |k: usize| {
            filter.process(&frame(k, Some(odometry(truth, k)), room.scan_from(&truth[k], 181)), &mut NoProfiler);
            filter.take_key_scan()
        };
        (0..truth.len()).filter_map(step).collect()
    }

    fn largest_error_m(filter: &RaoBlackwellizedFilter, truth: &[Pose2]) -> f64 {
        let error = |(truth_here, stamped): (&Pose2, &StampedPose)| {
            truth[0].between(truth_here).between(&stamped.pose).distance()
        };
        truth.iter().zip(&filter.trajectory()).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn a_lap_through_a_room_is_followed_by_one_particle_and_by_many() {
        let truth = laps(1);
        for (particles, tolerance_m) in [(1, 0.02), (8, 0.04)] {
            let mut filter = RaoBlackwellizedFilter::new(&config(particles));
            let steps = drive(&mut filter, &truth);
            let error_m = largest_error_m(&filter, &truth);
            assert!(error_m < tolerance_m, "{particles} particles: {error_m} m");
            let all = particles as f64;
            assert!(steps.iter().all(|step| (1.0 - 1e-9..=all + 1e-9).contains(&step.effective_particles)));
            assert!(particles > 1 || steps.iter().all(|step| !step.resampled));
            assert_eq!(filter.trajectory().len(), truth.len());
        }
    }

    #[test]
    fn particles_are_drawn_anew_when_few_are_effective() {
        let truth = laps(1);
        for (share, least, most) in [(0.0, 0, 0), (0.5, 1, truth.len()), (1.0, truth.len() / 3, truth.len())] {
            let mut config = config(6);
            (config.filter.resample_below, config.filter.evidence_share) = (share, 1.0);
            let steps = drive(&mut RaoBlackwellizedFilter::new(&config), &truth);
            let resampled = steps.iter().filter(|step| step.resampled).count();
            assert!((least..=most).contains(&resampled), "below {share}: {resampled} times");
            for step in steps.iter().filter(|step| step.resampled) {
                assert!(step.effective_particles < share * 6.0);
            }
        }
    }

    /// Between 3 and 40 particles, drawn anew at every scan that is written.
    fn adaptive_config(bin_m: f64) -> Config {
        let mut config = config(20);
        config.filter.resample_below = 1.0;
        config.filter.adaptive =
            AdaptiveConfig { enabled: true, least: 3, most: 40, bin_m, bin_rad: 0.1, ..AdaptiveConfig::default() };
        config
    }

    #[test]
    fn few_particles_are_kept_where_the_pose_is_certain_and_more_where_bins_tell_it_finer() {
        let truth = laps(1);
        let count_with_bins_of = |bin_m| {
            let mut filter = RaoBlackwellizedFilter::new(&adaptive_config(bin_m));
            let mut counts = Vec::new();
            for k in 0..truth.len() {
                let scan = Walls::room().scan_from(&truth[k], 181);
                filter.process(&frame(k, Some(odometry(&truth, k)), scan), &mut NoProfiler);
                counts.push(filter.particles.len());
            }
            assert!(largest_error_m(&filter, &truth) < 0.05);
            assert!(counts.iter().all(|count| (3..=40).contains(count)), "{counts:?}");
            counts.iter().sum::<usize>() as f64 / counts.len() as f64
        };
        let (coarse, fine) = (count_with_bins_of(0.5), count_with_bins_of(0.002));
        assert!(coarse < 8.0 && fine > 2.0 * coarse, "{coarse} and {fine} particles");
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let truth = &laps(1)[..40];
        for config in [config(5), adaptive_config(0.002)] {
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut filter = RaoBlackwellizedFilter::new(&config);
                    drive(&mut filter, truth);
                    (filter.particles.len(), filter.trajectory())
                })
            };
            assert_eq!(run(1), run(3));
        }
    }

    /// A resampling makes all weights equal; the pose that is reported does not jump to some other particle for that.
    #[test]
    fn the_best_particle_stays_the_best_if_it_survives() {
        let truth = laps(1);
        let mut config = config(8);
        config.filter.resample_below = 1.0;
        let mut filter = RaoBlackwellizedFilter::new(&config);
        let mut survivals = 0;
        for k in 0..truth.len() {
            let scan = Walls::room().scan_from(&truth[k], 181);
            let step = filter.process(&frame(k, Some(odometry(&truth, k)), scan), &mut NoProfiler);
            if step.resampled && filter.particles.iter().any(|particle| particle.pose == step.pose) {
                assert_eq!(filter.trajectory().last().unwrap().pose, step.pose);
                survivals += 1;
            }
        }
        assert!(survivals > 5, "{survivals}");
    }

    #[test]
    fn key_scans_are_taken_after_every_step_of_the_robot_and_lie_on_the_trajectory() {
        let mut truth = vec![laps(1)[0]; 20];
        truth.extend(laps(1));
        let mut filter = RaoBlackwellizedFilter::new(&config(3));
        let key_scans = key_scans_of(&mut filter, &truth);
        let trajectory = filter.trajectory();
        assert_eq!(key_scans[0].frame, 0);
        assert!(key_scans[1].frame >= 20, "a robot that stands still sees nothing new");
        assert!(key_scans.len() > truth.len() / 2);
        for key_scan in &key_scans {
            assert_eq!(key_scan.pose, trajectory[key_scan.frame].pose);
            assert!(key_scan.covariance.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn a_drive_that_begins_in_the_dark_goes_by_odometry_until_it_sees() {
        let truth = laps(1);
        let room = Walls::room();
        let mut filter = RaoBlackwellizedFilter::new(&config(2));
        let mut key_frames = Vec::new();
        for k in 0..60 {
            let scan = if k < 30 { BodyScan::default() } else { room.scan_from(&truth[k], 181) };
            let step = filter.process(&frame(k, Some(odometry(&truth, k)), scan), &mut NoProfiler);
            let error = truth[0].between(&truth[k]).between(&step.pose);
            assert!(error.distance() < 0.1, "scan {k}: {} m", error.distance());
            key_frames.extend(filter.take_key_scan().map(|key_scan| key_scan.frame));
        }
        assert!(key_frames.len() > 10 && key_frames[0] == 30);
    }

    #[test]
    fn a_blackout_in_the_middle_is_bridged() {
        let truth = laps(1);
        let room = Walls::room();
        let mut filter = RaoBlackwellizedFilter::new(&config(1));
        for k in 0..truth.len() {
            let scan = if (30..45).contains(&k) { BodyScan::default() } else { room.scan_from(&truth[k], 181) };
            let step = filter.process(&frame(k, Some(odometry(&truth, k)), scan), &mut NoProfiler);
            assert!(truth[0].between(&truth[k]).between(&step.pose).distance() < 0.1, "scan {k}");
        }
    }

    /// Lap after lap only the trail and the key scans grow; the maps remember the window alone.
    #[test]
    fn memory_of_the_maps_stays_flat_lap_after_lap() {
        let laps = laps(12);
        let mut filter = RaoBlackwellizedFilter::new(&config(2));
        let room = Walls::room();
        let (mut tiles, mut surfaces, mut written) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..laps.len() {
            filter.process(&frame(k, Some(odometry(&laps, k)), room.scan_from(&laps[k], 181)), &mut NoProfiler);
            let particle = &filter.particles[0];
            assert!(particle.mapped_m <= filter.window_m + 0.2);
            tiles.push(particle.map.tile_counts().0);
            surfaces.push(particle.map.surfaces().count());
            written.push(particle.written.len());
        }
        let most = |counts: &[usize]| counts.iter().copied().max().unwrap_or(0) as f64;
        let (early, late) = (..laps.len() / 3, laps.len() * 2 / 3..);
        assert!(most(&tiles[late.clone()]) <= most(&tiles[early]));
        assert!(most(&surfaces[late.clone()]) <= 1.1 * most(&surfaces[early]), "{}", most(&surfaces[late.clone()]));
        assert!(most(&written[late]) <= 1.05 * most(&written[early]));
        assert!(largest_error_m(&filter, &laps) < 0.05, "{} m", largest_error_m(&filter, &laps));
    }
}
