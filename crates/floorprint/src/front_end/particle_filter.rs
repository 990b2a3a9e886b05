//! The Rao-Blackwellised particle filter: a map for every particle, poses drawn from the
//! measurement (Grisetti, Stachniss & Burgard 2007; FastSLAM 2, Montemerlo et al. 2003).

use super::local_map::LocalMap;
use super::loss::{LossDetector, Sighting};
use super::odometry_model::OdometryModel;
use super::resampler::resample_poses;
use super::seen_velocity::SeenVelocity;
use super::tracker::{Fit, Tracker, blunder};
use super::unseen_motion::{Step, UnseenMotion};
use super::weights::{effective_number, heaviest, normalise};
use super::{FilterConfig, FilterStep, PreparedScan};
use crate::Config;
use crate::compact_scan::CompactScan;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::key_scan::{Interruption, KeyScan};
use crate::motion_model::MotionConfig;
use crate::pace::{Pace, is_gap};
use crate::profiler::{Phase, Profiler};
use crate::random::{Stage, generator};
use crate::scan_matcher::{Location, MatchResult, MatcherConfig, OdometryVerdict, POINTS_TO_SEARCH};
use crate::sensors::StampedPose;
use crate::surface::{SurfaceScan, Thinning};
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One in this many written scans is used to clear away what is no longer there.
const CARVE_EVERY: usize = 3;

/// N particles, each with a map of its own.
#[derive(Debug, Clone)]
pub struct ParticleFilter {
    seed: u64,
    config: FilterConfig,
    motion: MotionConfig,
    matcher: MatcherConfig,
    particles: Vec<Tracker>,
    /// What is learnt of the odometry.
    odometry: OdometryModel,
    /// Notices a robot that is lost; only where a back end can find it again.
    loss: Option<LossDetector>,
    /// The scan that the last step wrote into the maps, if it wrote one; all particles write the same ones.
    key_scan: Option<KeyScan>,
    /// The last scan.
    scan: PreparedScan,
    /// How many scans were written.
    written: usize,
    /// Covariance of the best particle's motion since the last of them.
    covariance: Matrix3<f64>,
    /// Whether one of the matches since may have been wrong.
    is_doubtful: bool,
    /// What the best particle's scans do not show of its motion.
    unseen: UnseenMotion,
    /// How fast scans follow each other.
    pace: Pace,
    /// How the best particle moves, to undo sweeps with where there is no odometry.
    velocity: SeenVelocity,
    /// Whether a new drive begins with the next scan.
    is_interrupted: bool,
    steps: usize,
}

/// What a [`ParticleFilter`] knows beside the session's key scans and poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrontEndState {
    /// `odom_from_body`.
    pose: Pose2,
    /// Its motion in the usual time between two scans.
    #[serde(rename = "last_motion")]
    going: Pose2,
    /// Where the scans were written that the local map is made of: the newest key scans.
    window: Vec<Pose2>,
    unconfirmed: Vec<Pose2>,
    #[serde(default)]
    was_contradicted: bool,
    odometry: OdometryModel,
    loss: Option<LossDetector>,
    written: usize,
    covariance: Matrix3<f64>,
    is_doubtful: bool,
    is_interrupted: bool,
    #[serde(default)]
    unseen: UnseenMotion,
    pace: Pace,
    #[serde(default)]
    velocity: SeenVelocity,
}

impl FrontEndState {
    /// The same with nothing in the local map: the next scan may have been taken anywhere.
    #[must_use]
    pub fn interrupted(mut self) -> Self {
        self.window.clear();
        self.unconfirmed.clear();
        self.velocity.forget();
        self.is_interrupted = true;
        self
    }

    /// How many of the newest key scans the local map is made of.
    #[must_use]
    pub fn window_scans(&self) -> usize {
        self.window.len()
    }
}

impl ParticleFilter {
    /// All particles at the origin, nothing mapped.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let count = config.filter.first_particles();
        let closes_loops = config.loop_closure.enabled;
        let window_m = if closes_loops { config.loop_closure.window_m } else { f64::INFINITY };
        let particle =
            Tracker::new(Pose2::IDENTITY, -(count as f64).ln(), LocalMap::new(config.matcher.cell_m, window_m));
        Self {
            seed: config.seed,
            config: config.filter.clone(),
            motion: config.motion.clone(),
            matcher: config.matcher.clone(),
            particles: vec![particle; count],
            odometry: OdometryModel::default(),
            loss: closes_loops.then(LossDetector::default),
            key_scan: None,
            scan: PreparedScan::default(),
            written: 0,
            covariance: Matrix3::zeros(),
            is_doubtful: false,
            is_interrupted: false,
            unseen: UnseenMotion::default(),
            pace: Pace::default(),
            velocity: SeenVelocity::default(),
            steps: 0,
        }
    }

    /// How scans are thinned.
    #[must_use]
    pub fn thinning(&self) -> Thinning {
        self.matcher.thinning()
    }

    /// One step of the filter: predict, match, weigh, resample, map.
    pub fn process(&mut self, frame: &Frame, profiler: &mut dyn Profiler) -> FilterStep {
        profiler.enter(Phase::Match);
        let prepared = self.prepare(frame);
        self.process_prepared(frame, prepared, profiler)
    }

    /// Prepares a scan. Where the body's motion is not undone yet, the scan is first undone as if the body went on as it did:
    /// where it then fits tells how the body moves now.
    fn prepare(&mut self, frame: &Frame) -> PreparedScan {
        let (scan, thinning) = (&frame.scan, self.thinning());
        let Some(skew) = &scan.skew else { return PreparedScan::of(scan, &thinning) };
        let gone_on = PreparedScan::of(&self.velocity.undone_in(scan), &thinning);
        let mut pace = self.pace;
        let steps = pace.steps(frame.elapsed_s).max(1.0);
        let motion = frame.motion.as_ref().map(|measured| self.odometry.correct(measured));
        let best = self.best_particle();
        let prediction = best.predict(motion.as_ref(), steps, &self.odometry, &self.motion);
        let Some(Location { fit, .. }) = best.locate(&prediction, &gone_on.surfaces, &self.matcher) else {
            return gone_on;
        };
        let before = self.velocity;
        if self.is_clear(&fit, gone_on.surfaces.len()) {
            self.velocity.foresee(&fit.belief.pose, skew, frame.elapsed_s, pace.usual_s());
        }
        if self.velocity.undoes_as_much_as(&before, skew) {
            self.velocity = before;
            return gone_on;
        }
        PreparedScan::of(&self.velocity.undone_in(scan), &thinning)
    }

    /// Whether a scan of so many points shows the motion beyond doubt.
    fn is_clear(&self, fit: &MatchResult, points: usize) -> bool {
        points >= POINTS_TO_SEARCH && fit.inlier_share >= self.matcher.search_below_inlier_share
    }

    /// The same of a frame whose scan was prepared ahead; none may be whose motion is [not undone](crate::BodyScan::skew).
    pub fn process_prepared(
        &mut self,
        frame: &Frame,
        prepared: PreparedScan,
        profiler: &mut dyn Profiler,
    ) -> FilterStep {
        profiler.enter(Phase::Match);
        let scan = Arc::clone(&prepared.surfaces);
        // A new drive begins with a map of its own; how it lies to the old one is for the back end to find out.
        let begins = !scan.is_empty() && std::mem::take(&mut self.is_interrupted);
        if begins {
            self.particles.iter_mut().for_each(|particle| particle.map.clear());
        }
        self.scan = prepared;
        let motion = frame.motion.as_ref().map(|measured| self.odometry.correct(measured));
        let steps = self.pace.steps(frame.elapsed_s);
        let fits = self.predict_and_match(motion.as_ref(), steps.max(1.0), &scan);
        let sighting = self.notice_loss(&scan, &fits, steps);
        // Particles moved alike but for noise: the scan is due for all of them or for none.
        let is_suspicion = matches!(sighting, Sighting::Suspicious { .. });
        let is_due = sighting != Sighting::Misfits && !scan.is_empty() && (is_suspicion || self.is_due());
        let is_believed = is_suspicion || matches!(sighting, Sighting::Fits { .. });
        if is_due && is_believed {
            self.draw_and_weigh(&fits, &scan);
        }
        let weights = self.normalised_weights();
        let effective_particles = effective_number(&weights);
        let best = self.best();
        self.learn(frame.motion.as_ref(), &fits[best], scan.len(), is_believed, is_gap(steps));
        if let Some(fit) = &fits[best] {
            let Tracker { last_motion, map, .. } = &self.particles[best];
            let step = Step {
                measured: motion.as_ref(),
                proven_shares: self.odometry.proven_shares(),
                matched: last_motion,
                elapsed_s: frame.elapsed_s,
                paces: steps,
                is_gap: is_gap(steps),
                is_believed,
                is_tested: is_due,
            };
            self.unseen.observe(&step, fit, &scan, map.surfaces(), &self.matcher);
        }
        let pose = self.particles[best].pose;
        if begins || !is_believed || self.unseen.is_in_the_dark() {
            self.velocity.forget();
        } else {
            self.velocity.observe(&pose, frame.scan.skew.as_ref(), frame.elapsed_s, self.pace.usual_s());
        }
        profiler.enter(Phase::Map);
        let interruption = match sighting {
            Sighting::Lost { scans, is_certain } => {
                let frame = (self.steps + 1).saturating_sub(scans);
                Some(Interruption { frame, is_certain, is_suspicion: false })
            }
            Sighting::Suspicious { misfits_before } => {
                let frame = self.steps.saturating_sub(misfits_before);
                Some(Interruption { frame, is_certain: false, is_suspicion: true })
            }
            Sighting::Fits { .. } | Sighting::Misfits => {
                begins.then_some(Interruption { frame: self.steps, is_certain: false, is_suspicion: false })
            }
        };
        self.key_scan = is_due.then(|| self.write(&scan, interruption));
        for particle in &mut self.particles {
            particle.trail.push(StampedPose { stamp_s: frame.stamp_s, pose: particle.pose });
        }
        profiler.enter(Phase::Resample);
        let resampled = is_due && effective_particles < self.config.resample_below * self.particles.len() as f64;
        if resampled {
            self.resample(&weights);
        }
        self.steps += 1;
        let fit = fits[best];
        FilterStep {
            pose,
            effective_particles,
            inlier_share: fit.map_or(1.0, |fit| fit.result.inlier_share),
            score: fit.map_or(0.0, |fit| fit.result.score),
            resampled,
            odometry_rejected: motion.is_some() && fit.is_some_and(|fit| fit.odometry != OdometryVerdict::Confirmed),
            // Where scan and odometry contradict each other the robot may be where either has it.
            covariance: self.covariance + fit.map_or_else(Matrix3::zeros, |fit| fit.contradiction()),
            drift: self.unseen.drift(),
        }
    }

    /// Moves every particle with the odometry, and on to where the scan fits its map.
    fn predict_and_match(&mut self, motion: Option<&Pose2>, steps: f64, scan: &SurfaceScan) -> Vec<Option<Fit>> {
        let (odometry, noise, matcher) = (&self.odometry, &self.motion, &self.matcher);
        let follow = |particle: &mut Tracker| {
            let prediction = particle.predict(motion, steps, odometry, noise);
            particle.match_scan(&prediction, scan, matcher)
        };
        self.particles.par_iter_mut().map(follow).collect()
    }

    /// Asks whether the scan contradicts the map; a robot that is lost begins its maps anew.
    fn notice_loss(&mut self, scan: &SurfaceScan, fits: &[Option<Fit>], steps: f64) -> Sighting {
        let best = self.best();
        let fit = fits[best].as_ref();
        let sighting = match &mut self.loss {
            // A scan that fits badly somewhere else than the odometry has it does not tell where the robot came to while
            // nothing was seen.
            Some(loss) if is_gap(steps) && fit.is_some_and(Fit::is_far_off_and_bad) => loss.lose(),
            Some(loss) => {
                let map = &self.particles[best].map;
                let contradicts_odometry = fit.is_some_and(|fit| fit.odometry != OdometryVerdict::Confirmed);
                loss.observe(scan, fit.map(|fit| &fit.result), contradicts_odometry, map, &self.matcher)
            }
            None => Sighting::Fits { misfits_before: 0 },
        };
        for particle in &mut self.particles {
            match sighting {
                Sighting::Fits { misfits_before } | Sighting::Suspicious { misfits_before } => {
                    if misfits_before > 0 {
                        particle.correct_misfits();
                    }
                    particle.confirm();
                }
                Sighting::Misfits => {}
                Sighting::Lost { .. } => particle.begin_anew(steps),
            }
        }
        sighting
    }

    fn is_due(&self) -> bool {
        self.particles.iter().any(|particle| particle.map.is_due(&particle.pose, &self.matcher))
    }

    /// Draws each pose from the Gaussian around its optimum and multiplies each weight by the
    /// evidence of the scan. With one particle both would only add noise.
    fn draw_and_weigh(&mut self, fits: &[Option<Fit>], scan: &SurfaceScan) {
        if self.particles.len() == 1 {
            return;
        }
        let points = (scan.len() as f64).min(self.matcher.independent_points);
        for (index, (particle, fit)) in self.particles.iter_mut().zip(fits).enumerate() {
            let Some(fit) = fit else { continue };
            let log_evidence = self.config.evidence_share * fit.log_evidence(points);
            particle.log_weight += log_evidence;
            particle.log_evidence += log_evidence;
            let mut random = generator(self.seed, Stage::Proposal, self.steps as u64, index as u64);
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

    /// Learns from the best particle's step how uncertain the motion is, and what the odometry is worth; `points` are those
    /// of the scan.
    fn learn(
        &mut self,
        measured: Option<&Pose2>,
        fit: &Option<Fit>,
        points: usize,
        is_believed: bool,
        after_gap: bool,
    ) {
        let Some(fit) = fit else { return self.odometry.note_nothing() };
        // One scan after a gap does not decide where along it the robot has come to: places look alike.
        self.covariance = if is_believed && !after_gap {
            fit.covariance_after(&self.covariance)
        } else {
            fit.covariance_without_scan(&self.covariance)
        };
        self.is_doubtful |= fit.is_doubtful();
        let Some(measured) = measured.filter(|_| is_believed) else { return self.odometry.note_nothing() };
        let Tracker { pose, last_motion, .. } = self.best_particle();
        let (last_motion, heading_rad) = (*last_motion, pose.theta - last_motion.theta);
        let sigmas: [f64; 2] = self.motion.sigmas(measured).into();
        let is_confirmed = fit.odometry == OdometryVerdict::Confirmed;
        let is_clear = self.is_clear(&fit.result, points);
        let scan = &fit.result.scan_information;
        self.odometry.learn(measured, &last_motion, heading_rad, sigmas[0], scan, is_confirmed);
        if is_clear {
            self.odometry.note(measured, &last_motion, sigmas, scan);
        } else {
            self.odometry.note_nothing();
        }
    }

    /// Writes the scan into all maps; gives what the session is to keep of it.
    fn write(&mut self, scan: &Arc<SurfaceScan>, interruption: Option<Interruption>) -> KeyScan {
        let pose = self.best_particle().pose;
        let carve = self.written.is_multiple_of(CARVE_EVERY);
        let view_m = scan.view_m();
        self.particles.par_iter_mut().for_each(|particle| particle.map.write(&particle.pose, scan, view_m, carve));
        self.written += 1;
        let doubt = if std::mem::take(&mut self.is_doubtful) { blunder() } else { Matrix3::zeros() };
        KeyScan {
            frame: self.steps,
            pose,
            drift: self.unseen.take_drift(&self.covariance),
            covariance: std::mem::take(&mut self.covariance) + doubt,
            scan: Arc::clone(scan),
            points: self.scan.points.clone(),
            interruption,
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
        let chosen = resample_poses(&self.config, &poses, weights, self.seed, self.steps as u64);
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

    /// The points of the last scan, where it was believed.
    #[must_use]
    pub fn points(&self) -> &CompactScan {
        &self.scan.points
    }

    /// The surfaces of the last scan.
    pub(crate) fn surfaces(&self) -> &Arc<SurfaceScan> {
        &self.scan.surfaces
    }

    /// By how much true lengths are longer than those that the odometry states, as a ratio, learnt where scans can tell.
    #[must_use]
    pub fn odometry_scale(&self) -> f64 {
        self.odometry.scale()
    }

    /// The poses of the best particle from a frame on, counted from 0.
    #[must_use]
    pub fn poses_since(&self, frame: usize) -> Vec<Pose2> {
        let recent = self.best_particle().trail.last(self.steps.saturating_sub(frame));
        recent.into_iter().map(|stamped| stamped.pose).collect()
    }

    /// Forgets the poses before a frame: they are the session's from now on.
    pub fn forget_poses_before(&mut self, frame: usize) {
        let kept = self.steps.saturating_sub(frame);
        self.particles.iter_mut().for_each(|particle| particle.trail.keep_last(kept));
    }

    /// What is needed to go on later, beside the key scans and the poses.
    #[must_use]
    pub fn state(&self) -> FrontEndState {
        let best = self.best_particle();
        FrontEndState {
            pose: best.pose,
            going: best.going,
            window: best.map.poses().collect(),
            unconfirmed: best.unconfirmed().to_vec(),
            was_contradicted: best.was_contradicted,
            odometry: self.odometry,
            loss: self.loss,
            written: self.written,
            covariance: self.covariance,
            is_doubtful: self.is_doubtful,
            is_interrupted: self.is_interrupted,
            unseen: self.unseen,
            pace: self.pace,
            velocity: self.velocity,
        }
    }

    /// A filter that goes on where another ended. `scans` are the newest key scans, the last one last, as many as the
    /// state's window has poses; `poses` are those of all frames that the session may still correct, the first of which
    /// is `first`. All particles begin as copies of the best one.
    #[must_use]
    pub fn resume(
        config: &Config,
        state: &FrontEndState,
        scans: &[CompactScan],
        first: usize,
        poses: &[StampedPose],
    ) -> Self {
        let mut filter = Self::new(config);
        let thinning = config.matcher.thinning();
        let surfaces = scans.iter().map(|scan| Arc::new(SurfaceScan::new(&scan.unpack(), &thinning)));
        let window_m = if config.loop_closure.enabled { config.loop_closure.window_m } else { f64::INFINITY };
        let map = LocalMap::of(config.matcher.cell_m, window_m, state.window.iter().copied().zip(surfaces));
        for particle in &mut filter.particles {
            particle.map = map.clone();
            (particle.pose, particle.going) = (state.pose, state.going);
            particle.set_unconfirmed(&state.unconfirmed);
            particle.was_contradicted = state.was_contradicted;
            poses.iter().for_each(|pose| particle.trail.push(*pose));
        }
        filter.odometry = state.odometry;
        filter.loss = filter.loss.and(state.loss.or(Some(LossDetector::default())));
        (filter.written, filter.covariance, filter.is_doubtful) = (state.written, state.covariance, state.is_doubtful);
        filter.is_interrupted = state.is_interrupted;
        (filter.unseen, filter.pace, filter.velocity) = (state.unseen, state.pace, state.velocity);
        filter.steps = first + poses.len();
        filter
    }

    /// Takes it that the next scan may have been taken anywhere: the robot was switched off, or another one drives on.
    /// What it learnt of the odometry stays.
    pub fn interrupt(&mut self) {
        self.velocity.forget();
        self.is_interrupted = true;
    }

    /// The same of a robot that is said to be at `odom_from_body`: there its new map begins.
    pub fn interrupt_at(&mut self, odom_from_body: &Pose2) {
        self.interrupt();
        for particle in &mut self.particles {
            (particle.pose, particle.going) = (*odom_from_body, Pose2::IDENTITY);
        }
    }

    fn best_particle(&self) -> &Tracker {
        &self.particles[self.best()]
    }

    /// The particle whose trajectory explains all scans best.
    fn best(&self) -> usize {
        let evidence: Vec<f64> = self.particles.iter().map(|particle| particle.log_evidence).collect();
        heaviest(&evidence)
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

    fn drive(filter: &mut ParticleFilter, truth: &[Pose2]) -> Vec<FilterStep> {
        let room = Walls::room();
        let step = |k: usize| frame(k, Some(odometry(truth, k)), room.scan_from(&truth[k], 181));
        (0..truth.len()).map(|k| filter.process(&step(k), &mut NoProfiler)).collect()
    }

    /// Drives and gathers the key scans.
    fn key_scans_of(filter: &mut ParticleFilter, truth: &[Pose2]) -> Vec<KeyScan> {
        let room = Walls::room();
        let step = |k: usize| {
            filter.process(&frame(k, Some(odometry(truth, k)), room.scan_from(&truth[k], 181)), &mut NoProfiler);
            filter.take_key_scan()
        };
        (0..truth.len()).filter_map(step).collect()
    }

    fn largest_error_m(filter: &ParticleFilter, truth: &[Pose2]) -> f64 {
        let error = |(truth_here, pose): (&Pose2, &Pose2)| truth[0].between(truth_here).between(pose).distance();
        truth.iter().zip(&filter.poses_since(0)).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn who_is_interrupted_does_not_go_on_as_before() {
        let truth = laps(1);
        let driven = || {
            let mut filter = ParticleFilter::new(&config(1));
            drive(&mut filter, &truth[..10]);
            assert_ne!(filter.velocity, SeenVelocity::default());
            filter
        };
        let (mut interrupted, mut moved) = (driven(), driven());
        interrupted.interrupt();
        moved.interrupt_at(&Pose2::IDENTITY);
        assert_eq!([interrupted.velocity, moved.velocity], [SeenVelocity::default(); 2]);
        assert_eq!(driven().state().interrupted().velocity, SeenVelocity::default());
    }

    #[test]
    fn a_lap_through_a_room_is_followed_by_one_particle_and_by_many() {
        let truth = laps(1);
        for (particles, tolerance_m) in [(1, 0.02), (8, 0.04)] {
            let mut filter = ParticleFilter::new(&config(particles));
            let steps = drive(&mut filter, &truth);
            let error_m = largest_error_m(&filter, &truth);
            assert!(error_m < tolerance_m, "{particles} particles: {error_m} m");
            let all = particles as f64;
            assert!(steps.iter().all(|step| (1.0 - 1e-9..=all + 1e-9).contains(&step.effective_particles)));
            assert!(particles > 1 || steps.iter().all(|step| !step.resampled));
            assert_eq!(filter.poses_since(0).len(), truth.len());
        }
    }

    #[test]
    fn particles_are_drawn_anew_when_few_are_effective() {
        let truth = laps(1);
        for (share, least, most) in [(0.0, 0, 0), (0.5, 1, truth.len()), (1.0, truth.len() / 3, truth.len())] {
            let mut config = config(6);
            (config.filter.resample_below, config.filter.evidence_share) = (share, 1.0);
            let steps = drive(&mut ParticleFilter::new(&config), &truth);
            let resampled = steps.iter().filter(|step| step.resampled).count();
            assert!((least..=most).contains(&resampled), "below {share}: {resampled} times");
            for step in steps.iter().filter(|step| step.resampled) {
                assert!(step.effective_particles < share * 6.0);
            }
        }
    }

    /// Between 3 and 40 particles, resampled at every scan that is written.
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
            let mut filter = ParticleFilter::new(&adaptive_config(bin_m));
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
                    let mut filter = ParticleFilter::new(&config);
                    drive(&mut filter, truth);
                    (filter.particles.len(), filter.poses_since(0))
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
        let mut filter = ParticleFilter::new(&config);
        let mut survivals = 0;
        for k in 0..truth.len() {
            let scan = Walls::room().scan_from(&truth[k], 181);
            let step = filter.process(&frame(k, Some(odometry(&truth, k)), scan), &mut NoProfiler);
            if step.resampled && filter.particles.iter().any(|particle| particle.pose == step.pose) {
                assert_eq!(*filter.poses_since(0).last().unwrap(), step.pose);
                survivals += 1;
            }
        }
        assert!(survivals > 5, "{survivals}");
    }

    #[test]
    fn key_scans_are_taken_after_every_step_of_the_robot_and_lie_on_the_trajectory() {
        let mut truth = vec![laps(1)[0]; 20];
        truth.extend(laps(1));
        let mut filter = ParticleFilter::new(&config(1));
        let key_scans = key_scans_of(&mut filter, &truth);
        let trajectory = filter.poses_since(0);
        assert_eq!(key_scans[0].frame, 0);
        assert!(key_scans[1].frame >= 20, "a robot that stands still sees nothing new");
        assert!(key_scans.len() > truth.len() / 2);
        for key_scan in &key_scans {
            assert_eq!(key_scan.pose, trajectory[key_scan.frame]);
            assert!(key_scan.covariance.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn a_drive_that_begins_in_the_dark_goes_by_odometry_until_it_sees() {
        let truth = laps(1);
        let room = Walls::room();
        let mut filter = ParticleFilter::new(&config(2));
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
        let mut filter = ParticleFilter::new(&config(1));
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
        let mut filter = ParticleFilter::new(&config(2));
        let room = Walls::room();
        let (mut tiles, mut surfaces, mut written) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..laps.len() {
            filter.process(&frame(k, Some(odometry(&laps, k)), room.scan_from(&laps[k], 181)), &mut NoProfiler);
            let particle = &filter.particles[0];
            let (path_m, tile_count, surface_count, scan_count) = particle.map.size();
            assert!(path_m <= Config::default().loop_closure.window_m + 0.2);
            tiles.push(tile_count);
            surfaces.push(surface_count);
            written.push(scan_count);
        }
        let most = |counts: &[usize]| counts.iter().copied().max().unwrap_or(0) as f64;
        let (early, late) = (..laps.len() / 3, laps.len() * 2 / 3..);
        assert!(most(&tiles[late.clone()]) <= most(&tiles[early]));
        assert!(most(&surfaces[late.clone()]) <= 1.1 * most(&surfaces[early]), "{}", most(&surfaces[late.clone()]));
        assert!(most(&written[late]) <= 1.05 * most(&written[early]));
        assert!(largest_error_m(&filter, &laps) < 0.05, "{} m", largest_error_m(&filter, &laps));
    }
}
