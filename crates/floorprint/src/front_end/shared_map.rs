//! The report's particle filter: many poses, one occupancy grid (§III.A.3–4).

use super::correlation::OccupiedCells;
use super::resampler::resample_poses;
use super::weights::{effective_number, heaviest, normalise};
use super::{FilterConfig, FilterStep};
use crate::Config;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::key_scan::Drift;
use crate::map::OccupancyGrid;
use crate::motion_model::MotionConfig;
use crate::profiler::{Phase, Profiler};
use crate::sensors::StampedPose;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// N weighted poses and the one map that the best of them draws.
///
/// What the report leaves open was decided so: the "random" initial poses are the origin, since
/// the map starts empty and the origin is where it starts; the noise of eq. 13 is
/// three-dimensional and of constant size; eq. 20's proportionality is taken at its word, weights
/// are multiplied by exp(corr), as logarithms.
#[derive(Debug)]
pub struct SharedMapFilter {
    seed: u64,
    config: FilterConfig,
    motion: MotionConfig,
    poses: Vec<Pose2>,
    log_weights: Vec<f64>,
    map: OccupancyGrid,
    occupied: OccupiedCells,
    /// The best particle of every step (the red dots of the report's figures).
    trail: Vec<StampedPose>,
    steps: u64,
}

impl SharedMapFilter {
    /// All particles at the origin, nothing mapped.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let count = config.filter.first_particles();
        let map = OccupancyGrid::new(&config.map);
        Self {
            seed: config.seed,
            config: config.filter.clone(),
            motion: config.motion.clone(),
            poses: vec![Pose2::IDENTITY; count],
            log_weights: vec![-(count as f64).ln(); count],
            occupied: OccupiedCells::new(&map),
            map,
            trail: Vec::new(),
            steps: 0,
        }
    }

    /// One step of the Bayes filter.
    pub fn process(&mut self, frame: &Frame, profiler: &mut dyn Profiler) -> FilterStep {
        profiler.enter(Phase::Predict);
        if self.steps > 0 {
            self.predict(&frame.motion.unwrap_or(Pose2::IDENTITY));
        }
        profiler.enter(Phase::Match);
        let correlations = self.correlate(frame);
        for (log_weight, correlation) in self.log_weights.iter_mut().zip(&correlations) {
            *log_weight += f64::from(*correlation);
        }
        let weights = normalise(&mut self.log_weights);
        let effective_particles = effective_number(&weights);
        let best = heaviest(&weights);
        let pose = self.poses[best];
        profiler.enter(Phase::Map);
        let mut flips = Vec::new();
        self.map.add_scan(&pose, &frame.scan, &mut flips);
        self.occupied.apply(&flips);
        self.trail.push(StampedPose { stamp_s: frame.stamp_s, pose });
        profiler.enter(Phase::Resample);
        let resampled = effective_particles < self.config.resample_below * self.poses.len() as f64;
        if resampled {
            self.resample(&weights);
        }
        self.steps += 1;
        let score = f64::from(correlations[best]) / frame.scan.hits.len().max(1) as f64;
        FilterStep {
            pose,
            effective_particles,
            inlier_share: score,
            score,
            resampled,
            odometry_rejected: false,
            covariance: Matrix3::zeros(),
            drift: Drift::default(),
        }
    }

    /// Eqs. 12–13: every particle moves by the odometry and noise of its own.
    fn predict(&mut self, motion: &Pose2) {
        for (particle, pose) in self.poses.iter_mut().enumerate() {
            *pose = self.motion.sample(pose, motion, self.seed, self.steps, particle as u64);
        }
    }

    /// Eq. 21 for every particle.
    fn correlate(&mut self, frame: &Frame) -> Vec<u32> {
        self.occupied.make_room(self.poses.iter().copied(), &frame.scan.hits);
        let (occupied, hits) = (&self.occupied, &frame.scan.hits);
        self.poses
            .par_iter()
            .with_min_len(16)
            .map_init(Vec::new, |scratch, pose| occupied.count(pose, hits, scratch))
            .collect()
    }

    fn resample(&mut self, weights: &[f64]) {
        let chosen = resample_poses(&self.config, &self.poses, weights, self.seed, self.steps);
        self.poses = chosen.into_iter().map(|index| self.poses[index]).collect();
        self.log_weights = vec![-(self.poses.len() as f64).ln(); self.poses.len()];
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &OccupancyGrid {
        &self.map
    }

    /// The best particle's pose at every scan.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        self.trail.clone()
    }
}
