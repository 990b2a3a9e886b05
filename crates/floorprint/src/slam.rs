//! The one function that everything calls: a frame goes in, the best pose comes out.

use crate::Config;
use crate::filter::{FilterKind, FilterStep, GrisettiFilter, RaoBlackwellizedFilter, SharedMapFilter};
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::loop_closure::{ClosureLoad, ClosureReport, Kidnapping, LoopCloser, corrected_poses, map_of, refine};
use crate::map::OccupancyGrid;
use crate::pose_graph::PoseGraph;
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
    /// The best estimate of the body's pose as of now, world from body: the filter's, put right by
    /// the loops that were closed so far.
    pub pose: Pose2,
    /// Whether the robot seems to have been carried elsewhere and has not been found again: the pose is then not to
    /// be relied on.
    pub is_lost: bool,
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
    RaoBlackwellized(RaoBlackwellizedFilter, Option<Box<LoopClosing>>),
    Grisetti2007(GrisettiFilter),
}

/// Closing loops, and what the final map is made of.
#[derive(Debug)]
struct LoopClosing {
    closer: LoopCloser,
    /// Which frames' scans went into the filter's maps.
    key_frames: Vec<usize>,
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
    /// Where the robot was carried elsewhere, and whether it was found again.
    pub kidnappings: Vec<Kidnapping>,
    /// The pose graph of the submaps, where loops are closed.
    pub graph: Option<PoseGraph>,
}

impl Slam {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let filter = match config.filter.kind {
            FilterKind::SharedMap => Filter::SharedMap(SharedMapFilter::new(config)),
            FilterKind::RaoBlackwellized => {
                let closing = config.loop_closure.enabled.then(|| LoopClosing {
                    closer: LoopCloser::new(&config.loop_closure, &config.matcher),
                    key_frames: Vec::new(),
                });
                Filter::RaoBlackwellized(RaoBlackwellizedFilter::new(config), closing.map(Box::new))
            }
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
        let (step, correction, is_lost) = match &mut self.filter {
            Filter::SharedMap(filter) => (filter.process(frame, profiler), None, false),
            Filter::Grisetti2007(filter) => (filter.process(frame, profiler), None, false),
            Filter::RaoBlackwellized(filter, closing) => {
                let step = filter.process(frame, profiler);
                let correction = closing.as_mut().map(|closing| {
                    profiler.enter(Phase::LoopClosure);
                    if let Some(key_scan) = filter.take_key_scan() {
                        closing.key_frames.push(key_scan.frame);
                        closing.closer.add(key_scan, |frame| filter.poses_since(frame));
                    }
                    closing.closer.work();
                    closing.closer.correction()
                });
                let is_lost = closing.as_ref().is_some_and(|closing| closing.closer.is_lost());
                (step, correction, is_lost)
            }
        };
        Ok(StepReport {
            index: frame.index,
            stamp_s: frame.stamp_s,
            dead_reckoning: frame.dead_reckoning,
            pose: correction.map_or(step.pose, |correction| correction.compose(&step.pose)),
            is_lost,
            filter: step,
        })
    }

    /// What closing loops works with now, where loops are closed.
    #[must_use]
    pub fn closure_load(&self) -> Option<ClosureLoad> {
        match &self.filter {
            Filter::RaoBlackwellized(_, Some(closing)) => Some(closing.closer.load()),
            _ => None,
        }
    }

    /// The true length of what the odometry states as one, where the filter learns it; 1 as long as nothing is known.
    #[must_use]
    pub fn odometry_scale(&self) -> Option<f64> {
        match &self.filter {
            Filter::RaoBlackwellized(filter, _) => Some(filter.odometry_scale()),
            _ => None,
        }
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
            Filter::RaoBlackwellized(..) => OccupancyGrid::along(&self.trajectory(), frames, &self.config.map),
            Filter::Grisetti2007(filter) => {
                let trajectory = filter.trajectory();
                let poses: Vec<StampedPose> = filter.matched().iter().map(|&position| trajectory[position]).collect();
                let mut due = filter.matched().iter().peekable();
                let frames = frames.enumerate().filter(|(position, _)| due.next_if_eq(&position).is_some());
                OccupancyGrid::along(&poses, frames.map(|(_, frame)| frame), &self.config.map)
            }
        }
    }

    /// The trajectory so far, of the particle that is the best now, put right by the loops that were closed so far.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        match &self.filter {
            Filter::SharedMap(filter) => filter.trajectory(),
            Filter::Grisetti2007(filter) => filter.trajectory(),
            Filter::RaoBlackwellized(filter, None) => filter.trajectory(),
            Filter::RaoBlackwellized(filter, Some(closing)) => {
                let mut trajectory = filter.trajectory();
                let poses = corrected_poses(&poses_of(&trajectory), &closing.closer.anchors());
                set_poses(&mut trajectory, &poses);
                trajectory
            }
        }
    }

    /// The final trajectory and map. `frames` are the frames that were processed, once more.
    ///
    /// Here the last loops are closed: the drive is put right by places recognised again, every scan is
    /// fitted to the map of all of them, and the grid is drawn along the result.
    #[must_use]
    pub fn finish<I: Iterator<Item = Frame>>(self, frames: impl Fn() -> I, profiler: &mut dyn Profiler) -> SlamResult {
        let (filter, LoopClosing { closer, key_frames }) = match self.filter {
            Filter::RaoBlackwellized(filter, Some(closing)) => (filter, *closing),
            _ => {
                profiler.enter(Phase::Map);
                let (map, trajectory) = (self.map(frames()), self.trajectory());
                return SlamResult { map, trajectory, closures: Vec::new(), kidnappings: Vec::new(), graph: None };
            }
        };
        profiler.enter(Phase::LoopClosure);
        let mut trajectory = filter.trajectory();
        drop(filter);
        let closed = closer.finish();
        let mut poses = corrected_poses(&poses_of(&trajectory), &closed.anchors);
        let matcher = &self.config.matcher;
        for _ in 0..self.config.loop_closure.refinements {
            poses = refine(&map_of(&key_frames, frames(), &poses, matcher), frames(), &poses, matcher);
        }
        set_poses(&mut trajectory, &poses);
        profiler.enter(Phase::Map);
        let map = OccupancyGrid::along(&trajectory, frames(), &self.config.map);
        SlamResult {
            trajectory,
            map,
            closures: closed.closures,
            kidnappings: closed.kidnappings,
            graph: Some(closed.graph),
        }
    }
}

fn poses_of(trajectory: &[StampedPose]) -> Vec<Pose2> {
    trajectory.iter().map(|stamped| stamped.pose).collect()
}

/// Sets a trajectory's poses, moved so that the first is the identity.
fn set_poses(trajectory: &mut [StampedPose], poses: &[Pose2]) {
    let start = poses.first().copied().unwrap_or(Pose2::IDENTITY);
    for (stamped, pose) in trajectory.iter_mut().zip(poses) {
        stamped.pose = start.between(pose);
    }
}
