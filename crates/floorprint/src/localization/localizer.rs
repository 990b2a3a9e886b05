//! The localizer: a robot is found in a finished map, followed, and said to be lost where it is.

use super::config::LocalizationConfig;
use super::global_search::{GlobalSearch, SearchPyramid};
use super::health::Health;
use super::history::{self, GIVEN_UP, History, INDEPENDENT_RAYS, KeyScan};
use super::hypothesis::Hypothesis;
use super::localization_map::LocalizationMap;
use super::report::{Explained, LocalizationReport, Mode};
use super::scan_odometry::ScanOdometry;
use super::sensing::Sensing;
use crate::config::Config;
use crate::frame::Frame;
use crate::front_end::OdometryModel;
use crate::geometry::Pose2;
use crate::geometry::covariance::isotropic;
use crate::key_scan::Drift;
use crate::motion_model::MotionConfig;
use crate::slam::SlamError;
use crate::surface::SurfaceScan;
use nalgebra::Matrix3;
use rayon::prelude::*;
use std::sync::Arc;

/// What is known of where the robot starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// Nothing: it may be anywhere in the map.
    Unknown,
    /// About here, `map_from_body`, as exactly as the configuration says.
    At(Pose2),
}

/// Finds a robot in a finished map and follows it. The map is never changed.
#[derive(Debug, Clone)]
pub struct Localizer {
    map: Arc<LocalizationMap>,
    pyramid: Arc<SearchPyramid>,
    config: LocalizationConfig,
    motion: MotionConfig,
    seed: u64,
    sensing: Sensing,
    odometry: OdometryModel,
    scan_odometry: ScanOdometry,
    /// The most probable first.
    hypotheses: Vec<Hypothesis>,
    next_id: u64,
    /// Whether the pose of the first hypothesis is claimed.
    is_claimed: bool,
    health: Health,
    history: History,
    search: Option<Search>,
    /// What the last search that ended says of places that it did not propose.
    searched: Option<Searched>,
    /// Since when a claimed pose is looked at with suspicion: metres and seconds since.
    suspicion: Option<[f64; 2]>,
    /// `odom_from_body`.
    odom: Pose2,
    last_motion: Pose2,
    /// Whether the last scan follows from those before.
    follows: bool,
    /// Since the last key scan: metres, radians and their standard deviations.
    since_key: SinceKey,
    /// Driven since the search for the robot began, metres.
    searched_m: f64,
    /// Driven when the last search began, metres.
    last_search_m: f64,
    step: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct SinceKey {
    path_m: f64,
    turn_rad: f64,
    variances: [f64; 2],
    drift: Drift,
}

/// A search that is under way, for what was seen up to a key scan.
#[derive(Debug, Clone)]
struct Search {
    search: GlobalSearch,
    odom: Pose2,
    key_scans: usize,
}

/// What a search that has ended says.
#[derive(Debug, Clone, Copy)]
struct Searched {
    /// By how much the best place that was not proposed can score less than the best of all.
    gap: f64,
    key_scans: usize,
    /// How many searches have ended since.
    count: usize,
}

/// While there are no more than so many hypotheses each scan corrects them; else key scans do.
const FEW: usize = 6;
/// Hypotheses nearer to each other than these are one, metres and radians.
const SAME_M: f64 = 0.3;
const SAME_RAD: f64 = 0.15;
/// A new search begins after so far a drive, metres.
const SEARCH_EVERY_M: f64 = 1.0;
/// Blocks that are looked at with each scan while a pose is claimed, at most.
const CALM_BLOCKS: usize = 2_000;
/// Hypotheses at most.
const MOST_HYPOTHESES: usize = 128;
/// Key scans that a pose must explain before it is claimed.
const LEAST_KEY_SCANS: usize = 3;
/// A pose is this uncertain at most when it is claimed, and from when on it is withdrawn, metres.
const LARGEST_SIGMA_M: f64 = 0.4;
const WITHDRAWN_SIGMA_M: f64 = 0.5;
/// A robot that is farther than this from where it is said to be is lost, metres.
const LOST_M: f64 = 0.5;
/// Mean log-likelihood of a ray where the robot is in a place that nobody proposed: half of what it sees fits by chance.
const ELSEWHERE: f64 = -3.2;
/// What a share of the points that do not score costs in log-likelihood.
const SCORE_TO_LOG_LIKELIHOOD: f64 = 3.5;
/// Each further search that ends before all is looked at misses the robot's place with this probability (logarithm).
const MISSED: f64 = -2.0;
/// Before it is looked at it is this improbable that the robot was kidnapped to any one place (log-odds).
const NOT_KIDNAPPED: f64 = 20.0;
/// A jump of so many standard deviations and metres is suspicious.
const JUMP_SIGMAS: f64 = 5.0;
const JUMP_M: f64 = 0.15;
/// A suspicion that is not confirmed within these is dropped, metres and seconds.
const SUSPICION_M: f64 = 4.0;
const SUSPICION_S: f64 = 10.0;
/// What came before is dropped where nothing explains it after so many key scans.
const HOPELESS_KEY_SCANS: usize = 12;
/// Where nothing measures the motion the robot is taken to go on as it did, this uncertainly: metres and radians, and per
/// second.
const UNMEASURED_M: f64 = 0.05;
const UNMEASURED_RAD: f64 = 0.05;
const UNMEASURED_M_PER_S: f64 = 0.5;
const UNMEASURED_RAD_PER_S: f64 = 0.3;
/// Scans that were matched to those before know the heading by this much better than the odometry.
const SEEN_HEADING: f64 = 0.3;

impl Localizer {
    /// A localizer that has seen nothing yet.
    #[must_use]
    pub fn new(map: Arc<LocalizationMap>, start: Start, config: &Config) -> Self {
        let pyramid = Arc::new(SearchPyramid::new(&map));
        Self::with_pyramid(map, pyramid, start, config)
    }

    /// Another localizer in the same map, which is shared.
    #[must_use]
    pub fn restarted(&self, start: Start, config: &Config) -> Self {
        Self::with_pyramid(self.map.clone(), self.pyramid.clone(), start, config)
    }

    fn with_pyramid(map: Arc<LocalizationMap>, pyramid: Arc<SearchPyramid>, start: Start, config: &Config) -> Self {
        let of_start = isotropic(config.localization.start_sigma_m, config.localization.start_sigma_rad);
        let hypotheses = match start {
            Start::Unknown => Vec::new(),
            Start::At(pose) => vec![Hypothesis::new(0, map.grid_from_map(&pose), of_start)],
        };
        Self {
            sensing: Sensing::new(&config.matcher, &map),
            map,
            pyramid,
            config: config.localization.clone(),
            motion: config.motion.clone(),
            seed: config.seed,
            odometry: OdometryModel::default(),
            scan_odometry: ScanOdometry::new(config),
            is_claimed: !hypotheses.is_empty(),
            hypotheses,
            next_id: 1,
            health: Health::new(0.05),
            history: History::default(),
            search: None,
            searched: None,
            suspicion: None,
            odom: Pose2::IDENTITY,
            last_motion: Pose2::IDENTITY,
            follows: true,
            since_key: SinceKey::default(),
            searched_m: 0.0,
            last_search_m: 0.0,
            step: 0,
        }
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &LocalizationMap {
        &self.map
    }

    /// Takes in one frame.
    ///
    /// # Errors
    /// When the odometry or a point of the frame is not finite; nothing was changed then.
    pub fn process(&mut self, frame: &Frame) -> Result<LocalizationReport, SlamError> {
        crate::slam::check(frame)?;
        self.step += 1;
        // 1. Move along.
        let sigmas = self.predict(frame);
        let scan = Arc::clone(self.scan_odometry.scan());
        // 2. Fit: each hypothesis to what was seen.
        let is_key_scan = !scan.is_empty() && self.is_key_scan();
        let mut particles = 0;
        if !scan.is_empty() {
            let all = self.hypotheses.len();
            let corrected = if is_key_scan || all <= FEW { all } else { usize::from(self.is_claimed) };
            particles = self.correct(&scan, frame, sigmas, corrected);
        }
        // 3. Is the pose that is claimed still the robot's?
        if self.is_claimed && !scan.is_empty() {
            self.look_after(frame.elapsed_s);
        }
        // 4. Remember what every hypothesis has to explain.
        if is_key_scan {
            self.remember(&scan);
        }
        // 5. Search the whole map, a slice with each scan.
        self.search();
        // 6. Decide.
        self.decide();
        Ok(self.report(frame, particles))
    }

    /// Moves all hypotheses along; the standard deviations of the motion, metres and radians.
    fn predict(&mut self, frame: &Frame) -> [f64; 2] {
        let stated = frame.motion.as_ref().map(|measured| {
            let motion = self.odometry.correct(measured);
            let (sigma_m, sigma_rad) = self.motion.sigmas(&motion);
            (motion, [self.odometry.noise() * sigma_m, sigma_rad])
        });
        let seen = self.scan_odometry.step(frame, stated.as_ref().map(|(motion, sigmas)| (motion, *sigmas)));
        let elapsed_s = frame.elapsed_s;
        let (motion, sigmas) = match stated {
            _ if self.step == 1 => (Pose2::IDENTITY, [0.0; 2]),
            Some((_, [sigma_m, sigma_rad])) if seen.is_seen => {
                (seen.motion, [sigma_m, if seen.contradicts { sigma_rad } else { SEEN_HEADING * sigma_rad }])
            }
            Some((motion, sigmas)) => (motion, sigmas),
            None if seen.is_seen => {
                let (sigma_m, sigma_rad) = self.motion.sigmas(&seen.motion);
                (seen.motion, [sigma_m, sigma_rad])
            }
            None => {
                let unmeasured =
                    [UNMEASURED_M + UNMEASURED_M_PER_S * elapsed_s, UNMEASURED_RAD + UNMEASURED_RAD_PER_S * elapsed_s];
                (self.hypotheses.first().map_or(self.last_motion, |first| first.last_motion), unmeasured)
            }
        };
        self.follows = seen.is_seen;
        let noise = isotropic(sigmas[0], sigmas[1]);
        let drift = if self.step == 1 { Drift::default() } else { seen.drift };
        self.hypotheses.iter_mut().for_each(|hypothesis| hypothesis.predict(&motion, &noise, &drift));
        self.odom = self.odom.compose(&motion);
        self.last_motion = motion;
        let since = &mut self.since_key;
        since.path_m += motion.distance();
        since.turn_rad += motion.theta.abs();
        (0..2).for_each(|axis| since.variances[axis] += sigmas[axis] * sigmas[axis]);
        since.drift.add(&drift);
        if !self.is_claimed || self.suspicion.is_some() {
            self.searched_m += motion.distance();
        }
        if let Some([path_m, time_s]) = &mut self.suspicion {
            *path_m += motion.distance();
            *time_s += frame.elapsed_s;
        }
        sigmas
    }

    fn is_key_scan(&self) -> bool {
        let is_wanted = !self.is_claimed || self.suspicion.is_some();
        let is_apart = self.since_key.path_m >= history::SPACING_M || self.since_key.turn_rad >= history::SPACING_RAD;
        is_wanted && (is_apart || self.history.len() == 0)
    }

    /// Fits so many hypotheses to the scan; the number of particles that it took.
    fn correct(&mut self, scan: &SurfaceScan, frame: &Frame, sigmas: [f64; 2], count: usize) -> usize {
        let (map, sensing, seed, step) = (&self.map, &self.sensing, self.seed, self.step);
        let before = self.hypotheses.first().map(|first| (first.pose, first.last_motion));
        // While there are many, each is told apart from the others before any is looked at more closely.
        let all = self.hypotheses.len().max(1);
        let most = if all > FEW { 1 } else { self.config.particles / all.pow(2) };
        let particles = match &mut self.hypotheses[..count] {
            // A single one is not worth a thread.
            [only] => only.correct(map, sensing, scan, frame.elapsed_s, [seed, step], most),
            all => all
                .par_iter_mut()
                .map(|each| each.correct(map, sensing, scan, frame.elapsed_s, [seed, step], most))
                .sum(),
        };
        if let (true, Some(measured), Some((predicted, motion)), Some(first)) =
            (self.is_claimed && self.suspicion.is_none(), &frame.motion, before, self.hypotheses.first())
        {
            let heading_rad = predicted.theta - motion.theta;
            let confirmed = first.innovation_sigmas < 2.0;
            self.odometry.learn(
                measured,
                &first.last_motion,
                heading_rad,
                sigmas[0],
                &first.scan_information,
                confirmed,
            );
        }
        particles
    }

    /// Watches over the pose that is claimed.
    fn look_after(&mut self, elapsed_s: f64) {
        let Some(first) = self.hypotheses.first() else { return };
        self.health.observe(&first.explanation, elapsed_s, first.last_motion.distance(), self.follows);
        let sigma_m = first.sigma_m();
        let jumped = first.innovation_sigmas > JUMP_SIGMAS && first.innovation_m > JUMP_M;
        if self.suspicion.is_none() && (self.health.is_suspicious() || jumped) && self.step > 1 {
            self.suspicion = Some([0.0; 2]);
            self.begin_again();
        } else if let Some([path_m, time_s]) = self.suspicion
            && self.health.is_well()
            && (path_m > SUSPICION_M || time_s > SUSPICION_S)
            && self.search.is_none()
        {
            self.suspicion = None;
            self.hypotheses.truncate(1);
            self.begin_again();
        }
        if self.health.lost_probability() > self.config.lost_probability || sigma_m > WITHDRAWN_SIGMA_M {
            self.is_claimed = false;
            if self.suspicion.take().is_none() {
                self.begin_again();
            }
        }
    }

    /// Forgets what was seen: the way from there to here is not known.
    fn begin_again(&mut self) {
        self.history.clear();
        self.hypotheses.iter_mut().for_each(|hypothesis| hypothesis.evidence.clear());
        (self.search, self.searched) = (None, None);
        (self.searched_m, self.last_search_m) = (0.0, f64::NEG_INFINITY);
    }

    /// Takes a scan into the history, and what it says of each hypothesis.
    fn remember(&mut self, scan: &Arc<SurfaceScan>) {
        let since = std::mem::take(&mut self.since_key);
        let sigmas = [
            since.variances[0].sqrt().max(1e-3) + since.drift.sigma_m,
            since.variances[1].sqrt().max(1e-3) + since.drift.sigma_rad,
        ];
        let is_full = self.history.push(KeyScan { scan: scan.clone(), odom: self.odom, sigmas });
        for hypothesis in &mut self.hypotheses {
            let bent = (0.5 * hypothesis.innovation_sigmas.powi(2)).ln_1p();
            hypothesis.evidence.push_back(INDEPENDENT_RAYS * hypothesis.explanation.log_likelihood - bent);
            if is_full {
                hypothesis.evidence.pop_front();
            }
        }
        if self.search.is_none() && (self.searched.is_none() || self.searched_m >= self.last_search_m + SEARCH_EVERY_M)
        {
            let points: Vec<[f32; 2]> =
                self.history.cloud().balanced(self.config.search_points).iter().map(|(point, _)| point).collect();
            let LocalizationConfig { search_margin, search_most, search_blocks, .. } = self.config;
            let search = GlobalSearch::new(&self.pyramid, &points, search_margin, search_most, search_blocks);
            self.search = Some(Search { search, odom: self.odom, key_scans: self.history.len() });
            self.last_search_m = self.searched_m;
        }
    }

    /// One slice of the search; what it found joins the hypotheses once it is over.
    fn search(&mut self) {
        let Some(search) = &mut self.search else { return };
        // A robot that is most probably where it is said to be can wait.
        let blocks = if self.is_claimed {
            CALM_BLOCKS.min(self.config.search_blocks_per_scan)
        } else {
            self.config.search_blocks_per_scan
        };
        if !search.search.work(&self.pyramid, blocks) {
            return;
        }
        let Some(Search { search, odom, key_scans }) = self.search.take() else { return };
        let best = search.found().first().map_or(0.0, |best| best.score);
        let count = 1 + self.searched.map_or(0, |searched| searched.count);
        self.searched = Some(Searched { gap: (best - search.open_bound()).max(0.0), key_scans, count });
        // Where the body of each proposal was at the newest key scan.
        let Some(since_newest) = self.history.since_newest(&self.odom) else { return };
        let to_newest = odom.between(&self.odom).compose(&since_newest.inverse());
        let is_new = |pose: &Pose2| {
            let now = pose.compose(&since_newest);
            !self.hypotheses.iter().any(|known| is_same(&known.pose, &now))
        };
        let proposals = search.found().iter().map(|place| place.pose.compose(&to_newest));
        let poses: Vec<Pose2> = proposals.filter(is_new).collect();
        let mut weighed = self.history.weigh(&self.map, &self.sensing, &self.history.cloud(), &poses, self.next_id);
        self.next_id += poses.len() as u64;
        let noise = isotropic(self.since_key.variances[0].sqrt(), self.since_key.variances[1].sqrt());
        let drift = self.since_key.drift;
        weighed.iter_mut().for_each(|hypothesis| hypothesis.predict(&since_newest, &noise, &drift));
        self.hypotheses.extend(weighed);
    }

    /// Orders the hypotheses by their weights, gives up hopeless ones, and claims or withdraws.
    fn decide(&mut self) {
        let claimed = if self.is_claimed { self.hypotheses.first().map(|first| first.id) } else { None };
        self.hypotheses.sort_by(|a, b| b.log_evidence().total_cmp(&a.log_evidence()).then(a.id.cmp(&b.id)));
        let mut kept: Vec<Hypothesis> = Vec::with_capacity(self.hypotheses.len());
        for hypothesis in self.hypotheses.drain(..) {
            let is_claimed = Some(hypothesis.id) == claimed;
            match kept.iter_mut().find(|other| is_same(&other.pose, &hypothesis.pose)) {
                Some(other) if is_claimed => *other = Hypothesis { evidence: other.evidence.clone(), ..hypothesis },
                Some(_) => {}
                None => kept.push(hypothesis),
            }
        }
        self.hypotheses = kept;
        if self.history.len() == 0 {
            return;
        }
        let weights = self.weights(claimed);
        if let Some(claimed) = claimed {
            let Some(at) = self.hypotheses.iter().position(|hypothesis| hypothesis.id == claimed) else { return };
            if self.suspicion.is_some() && self.searched.is_some() && 1.0 - weights[at] > self.config.lost_probability {
                self.is_claimed = false;
                self.suspicion = None;
            } else {
                self.hypotheses[..=at].rotate_right(1);
            }
        }
        let least = self.hypotheses.first().map_or(0.0, Hypothesis::log_evidence) + GIVEN_UP * self.temperature(None);
        let claimed_id = claimed.filter(|_| self.is_claimed);
        self.hypotheses.retain(|hypothesis| hypothesis.log_evidence() > least || Some(hypothesis.id) == claimed_id);
        self.hypotheses.truncate(MOST_HYPOTHESES);
        if !self.is_claimed {
            self.claim();
        }
    }

    /// Claims the best pose if it stands alone.
    fn claim(&mut self) {
        let weights = self.weights(None);
        let Some((first, weight)) = self.hypotheses.first().zip(weights.first()) else {
            self.give_up_if_hopeless(1.0);
            return;
        };
        let usual = first.usual.unwrap_or_default();
        let sigma_m = first.sigma_m();
        let stands_alone = *weight >= self.config.claim_probability && self.history.len() >= LEAST_KEY_SCANS;
        let LocalizationConfig { claim_on_map, claim_in_view, .. } = self.config;
        // Whoever walks in front hides the map, but does not speak against it.
        let explains = [&usual, &first.explanation].iter().all(|shares| {
            shares.on_map >= claim_on_map
                || (shares.on_map >= 0.5 * claim_on_map && shares.on_map >= claim_in_view * (1.0 - shares.in_front))
        });
        if stands_alone && explains && sigma_m < LARGEST_SIGMA_M {
            self.health = Health::new(1.0 - weight);
            self.is_claimed = true;
            self.suspicion = None;
            self.hypotheses.truncate(1);
            self.begin_again();
        } else {
            self.give_up_if_hopeless(1.0 - weights.iter().sum::<f64>());
        }
    }

    /// Where nothing explains what was seen the way between may have been broken: what came first is dropped.
    fn give_up_if_hopeless(&mut self, elsewhere: f64) {
        if self.history.len() >= HOPELESS_KEY_SCANS && elsewhere > 0.5 && self.search.is_none() {
            let dropped = self.history.forget_half();
            for hypothesis in &mut self.hypotheses {
                hypothesis.evidence.drain(..dropped.min(hypothesis.evidence.len()));
            }
            self.searched = None;
        }
    }

    /// The temperature that the best hypothesis sets; while a pose is claimed that one: in a map that is wrong in many
    /// places it takes more to give it up.
    fn temperature(&self, claimed: Option<u64>) -> f64 {
        let sets_it = |hypothesis: &&Hypothesis| claimed.is_none_or(|claimed| hypothesis.id == claimed);
        let best = self.hypotheses.iter().filter(sets_it).map(Hypothesis::log_evidence).fold(f64::MIN, f64::max);
        if best == f64::MIN { 1.0 } else { history::temperature(best) }
    }

    /// The probability of each hypothesis; what is missing to one is that the robot is where nothing was proposed.
    fn weights(&self, claimed: Option<u64>) -> Vec<f64> {
        let temperature = self.temperature(claimed);
        let log_weight = |hypothesis: &Hypothesis| {
            let known = if Some(hypothesis.id) == claimed { NOT_KIDNAPPED } else { 0.0 };
            hypothesis.log_evidence() / temperature + known
        };
        let mut log_weights: Vec<f64> = self.hypotheses.iter().map(log_weight).collect();
        let key_scans = self.history.len() as f64;
        // Somewhere that looks like none of them, or somewhere that no search has come to.
        log_weights.push(INDEPENDENT_RAYS * ELSEWHERE * key_scans / temperature);
        let best = self.hypotheses.iter().map(Hypothesis::log_evidence).fold(f64::MIN, f64::max);
        if best > f64::MIN && claimed.is_none() {
            let behind = self.searched.map_or(0.0, |searched| {
                INDEPENDENT_RAYS * SCORE_TO_LOG_LIKELIHOOD * searched.key_scans as f64 * searched.gap
            });
            let missed = self.searched.map_or(0.0, |searched| MISSED * (searched.count - 1) as f64);
            log_weights.push((best - behind) / temperature + missed);
        }
        let largest = log_weights.iter().copied().fold(f64::MIN, f64::max);
        let weights: Vec<f64> = log_weights.iter().map(|weight| (weight - largest).exp()).collect();
        let total: f64 = weights.iter().sum();
        weights[..self.hypotheses.len()].iter().map(|weight| weight / total).collect()
    }

    fn report(&self, frame: &Frame, particles: usize) -> LocalizationReport {
        let claimed = self.hypotheses.first().filter(|_| self.is_claimed);
        let weights = if self.history.len() == 0 && self.is_claimed {
            vec![1.0 - self.health.lost_probability()]
        } else {
            self.weights(claimed.map(|claimed| claimed.id))
        };
        let modes: Vec<Mode> = self
            .hypotheses
            .iter()
            .zip(&weights)
            .map(|(hypothesis, &weight)| Mode { pose: self.map.map_from_grid(&hypothesis.pose), weight })
            .collect();
        let first = weights.first().copied().unwrap_or(0.0);
        let elsewhere = if self.is_claimed { self.health.lost_probability().max(1.0 - first) } else { 1.0 - first };
        let astray = self.hypotheses.first().map_or(0.0, |first| beyond(LOST_M / first.sigma_m().max(1e-6)));
        let lost_probability = 1.0 - (1.0 - elsewhere) * (1.0 - astray);
        LocalizationReport {
            index: frame.index,
            stamp_s: frame.stamp_s,
            pose: claimed.map(|claimed| self.map.map_from_grid(&claimed.pose)),
            covariance: self.hypotheses.first().map_or_else(Matrix3::zeros, |first| first.covariance),
            lost_probability,
            explained: self.hypotheses.first().map_or_else(Explained::default, |first| first.explanation.into()),
            elsewhere_probability: (1.0 - weights.iter().sum::<f64>()).max(0.0),
            modes,
            is_searching: self.search.is_some(),
            searched_m: self.searched_m,
            particles,
        }
    }
}

/// How probable it is that a normal variable is more than so many standard deviations off (Abramowitz & Stegun 1964, 7.1.26).
fn beyond(sigmas: f64) -> f64 {
    let x = sigmas * std::f64::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let factors = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    (factors.iter().fold(0.0, |sum, factor| (sum + factor) * t) * (-x * x).exp()).clamp(0.0, 1.0)
}

fn is_same(a: &Pose2, b: &Pose2) -> bool {
    let between = a.between(b);
    between.distance() < SAME_M && between.theta.abs() < SAME_RAD
}
