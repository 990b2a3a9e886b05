//! The one function that everything calls: a frame goes in, the best pose comes out.

use crate::Config;
use crate::filter::{FilterKind, FilterStep, GrisettiFilter, RaoBlackwellizedFilter, SharedMapFilter};
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::loop_closure::{ClosureReport, close_loops, corrected_poses, map_of, refine};
use crate::map::OccupancyGrid;
use crate::profiler::{Phase, Profiler};
use crate::sensors::StampedPose;
use thiserror::Error;

/// Why a frame could not be processed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SlamError {
    /// The motion or a point is no number; going on would spoil the map.
    #[error("scan {index} (stamp {stamp_s:.6} s) or the odometry that leads to it is not finite; leave this scan out")]
    NotFinite {
        /// Number of the scan.
        index: usize,
        /// Its stamp, seconds.
        stamp_s: f64,
    },
}

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Number of the scan.
    pub index: usize,
    /// The scan's stamp, seconds.
    pub stamp_s: f64,
    /// Dead reckoning, start from body.
    pub dead_reckoning: Pose2,
    /// What the filter says.
    pub filter: FilterStep,
}

/// Simultaneous localisation and mapping.
#[derive(Debug)]
pub struct Slam {
    config: Config,
    filter: Filter,
}

#[derive(Debug)]
enum Filter {
    SharedMap(SharedMapFilter),
    RaoBlackwellized(RaoBlackwellizedFilter),
    Grisetti2007(GrisettiFilter),
}

/// What a drive amounts to.
#[derive(Debug, Clone)]
pub struct SlamResult {
    /// The body's pose at every scan; the first is the identity.
    pub trajectory: Vec<StampedPose>,
    /// The occupancy grid.
    pub map: OccupancyGrid,
    /// Every comparison of two places, and what became of it.
    pub closures: Vec<ClosureReport>,
}

impl Slam {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let filter = match config.filter.kind {
            FilterKind::SharedMap => Filter::SharedMap(SharedMapFilter::new(config)),
            FilterKind::RaoBlackwellized => Filter::RaoBlackwellized(RaoBlackwellizedFilter::new(config)),
            FilterKind::Grisetti2007 => Filter::Grisetti2007(GrisettiFilter::new(config)),
        };
        Self { config: config.clone(), filter }
    }

    /// Takes in one frame.
    ///
    /// # Errors
    /// When the odometry or a point of the frame is not finite; nothing was changed then.
    pub fn process(&mut self, frame: &Frame, profiler: &mut dyn Profiler) -> Result<StepReport, SlamError> {
        let points = &frame.scan.hits;
        let scan_is_finite = points.x_m.iter().chain(&points.y_m).all(|coordinate| coordinate.is_finite());
        if !scan_is_finite || frame.motion.is_some_and(|motion| !motion.is_finite()) {
            return Err(SlamError::NotFinite { index: frame.index, stamp_s: frame.stamp_s });
        }
        let step = match &mut self.filter {
            Filter::SharedMap(filter) => filter.process(frame, profiler),
            Filter::RaoBlackwellized(filter) => filter.process(frame, profiler),
            Filter::Grisetti2007(filter) => filter.process(frame, profiler),
        };
        Ok(StepReport {
            index: frame.index,
            stamp_s: frame.stamp_s,
            dead_reckoning: frame.dead_reckoning,
            filter: step,
        })
    }

    /// The occupancy grid so far. `frames` are the frames that were processed, once more.
    ///
    /// The report's filter has drawn its map along the way; the other filters' maps are made for
    /// matching, so that the grid is drawn along the trajectory that is the best now (of the
    /// scans that were matched, where a filter does not match all).
    #[must_use]
    pub fn map(&self, frames: impl Iterator<Item = Frame>) -> OccupancyGrid {
        match &self.filter {
            Filter::SharedMap(filter) => filter.map().clone(),
            Filter::RaoBlackwellized(filter) => OccupancyGrid::along(&filter.trajectory(), frames, &self.config.map),
            Filter::Grisetti2007(filter) => {
                let trajectory = filter.trajectory();
                let poses: Vec<StampedPose> = filter.matched().iter().map(|&position| trajectory[position]).collect();
                let mut due = filter.matched().iter().peekable();
                let frames = frames.enumerate().filter(|(position, _)| due.next_if_eq(&position).is_some());
                OccupancyGrid::along(&poses, frames.map(|(_, frame)| frame), &self.config.map)
            }
        }
    }

    /// The trajectory so far, of the particle that is the best now.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        match &self.filter {
            Filter::SharedMap(filter) => filter.trajectory(),
            Filter::RaoBlackwellized(filter) => filter.trajectory(),
            Filter::Grisetti2007(filter) => filter.trajectory(),
        }
    }

    /// The final trajectory and map. `frames` are the frames that were processed, once more.
    ///
    /// Here loops are closed: the drive is put right by places recognised again, every scan is
    /// fitted to the map of all of them, and the grid is drawn along the result.
    #[must_use]
    pub fn finish<I: Iterator<Item = Frame>>(self, frames: impl Fn() -> I, profiler: &mut dyn Profiler) -> SlamResult {
        let (mut trajectory, mut closures) = (self.trajectory(), Vec::new());
        let filter = match self.filter {
            Filter::RaoBlackwellized(filter) if self.config.loop_closure.enabled => filter,
            _ => {
                profiler.enter(Phase::Map);
                return SlamResult { map: self.map(frames()), trajectory, closures };
            }
        };
        profiler.enter(Phase::LoopClosure);
        let key_scans = filter.key_scans();
        drop(filter);
        let (options, matcher) = (&self.config.loop_closure, &self.config.matcher);
        let closed = close_loops(&key_scans, options, matcher);
        let poses: Vec<Pose2> = trajectory.iter().map(|stamped| stamped.pose).collect();
        let mut poses = corrected_poses(&poses, &key_scans, &closed);
        for _ in 0..options.refinements {
            poses = refine(&map_of(&key_scans, &poses, matcher.cell_m), frames(), &poses, matcher);
        }
        let start = poses.first().copied().unwrap_or(Pose2::IDENTITY);
        for (stamped, pose) in trajectory.iter_mut().zip(&poses) {
            stamped.pose = start.between(pose);
        }
        closures.extend(closed.closures);
        profiler.enter(Phase::Map);
        let map = OccupancyGrid::along(&trajectory, frames(), &self.config.map);
        SlamResult { trajectory, map, closures }
    }
}
