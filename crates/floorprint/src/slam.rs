//! The one function that everything calls: a frame goes in, the best pose comes out.

mod side_by_side;

use crate::back_end::{BackEnd, ClosureLoad, ClosureReport, Kidnapping, LoopClosureConfig, PlaceGraph, Uncertainty};
use crate::compact_scan::CompactScan;
use crate::config::Config;
use crate::frame::Frame;
use crate::front_end::{FilterStep, FrontEnd, FrontEndState, ParticleFilter};
use crate::geometry::Pose2;
use crate::key_scan::{Drift, Interruption, KeyScan};
use crate::map::OccupancyGrid;
use crate::pose_graph::PoseGraph;
use crate::profiler::{NoProfiler, Phase, Profiler};
use crate::scan_matcher::MatcherConfig;
use crate::sensors::StampedPose;
use crate::session::{Renderer, Session, SessionError, SessionMemory};
use crate::stop_signal::StopSignal;
use crate::storage::{StorageTrouble, Store};
use crate::surface::SurfaceScan;
use nalgebra::Matrix3;
use std::sync::Arc;
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
    /// How the loops that were closed so far move the front end's frame: `world_from_odom` (the transform that REP 105
    /// calls map→odom).
    pub world_from_odom: Pose2,
    /// The best estimate of the body's pose as of now, world from body: the front end's, put right by
    /// the loops that were closed so far.
    pub pose: Pose2,
    /// Whether the robot seems to have been kidnapped and has not been found again, or is suspected to have been and has seen too
    /// little since to tell: the pose is then not to be relied on.
    pub is_lost: bool,
    /// How uncertain `pose` is, unless the robot is lost; `None` where loops are not closed and nothing is known of it.
    pub uncertainty: Option<Uncertainty>,
    /// What the filter says.
    pub filter: FilterStep,
}

/// What a drive amounts to.
#[derive(Debug, Clone)]
pub struct SlamResult {
    /// The body's pose at every scan; the first is the identity.
    pub trajectory: Vec<StampedPose>,
    /// How uncertain each of these poses is; empty where loops are not closed and nothing is known of it.
    pub uncertainties: Vec<Uncertainty>,
    /// The occupancy grid.
    pub map: OccupancyGrid,
    /// Every comparison of two places, and what became of it.
    pub closures: Vec<ClosureReport>,
    /// Where the robot was kidnapped, and whether it was found again.
    pub kidnappings: Vec<Kidnapping>,
    /// The pose graph of the submaps, where loops are closed.
    pub graph: Option<PoseGraph>,
    /// All of it, to be gone on with.
    pub session: Session,
}

/// Simultaneous localisation and mapping.
///
/// The front end tracks the robot from scan to scan; what it writes into its map the session keeps; the back end
/// finds places that were passed before and puts the session right.
#[derive(Debug)]
pub struct Slam {
    front_end: FrontEnd,
    session: Session,
    back_end: Option<BackEnd>,
    renderer: Renderer,
    loop_closure: LoopClosureConfig,
    matcher: MatcherConfig,
    /// The session's poses are final up to this frame; from there on the front end may still change them.
    settled: usize,
    stop: StopSignal,
}

impl Slam {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let front_end = FrontEnd::new(config);
        let closes_loops = config.loop_closure.enabled && front_end.can_close_loops();
        let places = closes_loops.then(|| PlaceGraph::new(config.loop_closure.submap_length_m, config.matcher.cell_m));
        Self {
            front_end,
            session: Session::new(&config.map, places),
            back_end: closes_loops.then(|| BackEnd::new(&config.loop_closure, &config.matcher)),
            renderer: Renderer::new(&config.map),
            loop_closure: config.loop_closure.clone(),
            matcher: config.matcher.clone(),
            settled: 0,
            stop: StopSignal::default(),
        }
    }

    /// Goes on with a session, where it ended: the next frame is the one after its last, its odometry leads there from
    /// the last frame's pose.
    ///
    /// # Errors
    /// When the configured filter cannot go on, or the session holds no places or nothing of the front end.
    pub fn resume(session: Session, config: &Config) -> Result<Self, SessionError> {
        let fresh = Self::new(config);
        let missing = SessionError(
            "only filter.kind = \"rao_blackwellized\" with loop_closure.enabled can go on, with a session of its own",
        );
        let (Some(state), Some(places)) = (session.front_end(), session.places_so_far()) else { return Err(missing) };
        if fresh.back_end.is_none() {
            return Err(missing);
        }
        let settled = places.open_since().unwrap_or(0).min(session.frames());
        let scans = session.scans();
        let window: Vec<_> =
            scans[scans.len() - state.window_scans()..].iter().map(|scan| scan.points.clone()).collect();
        let filter = ParticleFilter::resume(config, state, &window, settled, &session.poses_since(settled));
        let mut slam = Self { front_end: FrontEnd::RaoBlackwellized(Box::new(filter)), session, settled, ..fresh };
        slam.session.reopen();
        Ok(slam)
    }

    /// Takes it that the next frame may be from anywhere: a new drive begins, or the robot was switched off and may have
    /// been moved. It is tracked in a map of its own, and placed on the old one when the evidence suffices.
    pub fn interrupt(&mut self) {
        self.front_end.interrupt();
    }

    /// The same of a robot that is said to be at `world_from_body`: its map begins there, and counts as lost until evidence
    /// has placed it.
    pub fn interrupt_at(&mut self, world_from_body: &Pose2) {
        self.front_end.interrupt_at(&self.session.world_from_odom().inverse().compose(world_from_body));
    }

    /// Appends another session, as a drive whose place on this one is open: it is placed when the evidence suffices, and
    /// else kept apart (see [`SlamResult::kidnappings`]). What comes after it is a drive of its own again.
    ///
    /// # Errors
    /// As [`resume`](Self::resume).
    pub fn append(mut self, other: &Session, config: &Config) -> Result<Self, SessionError> {
        let _ = self.session();
        let Self { front_end, mut session, back_end, .. } = self;
        let mut back_end = back_end.ok_or(SessionError("loops are not closed, so that nothing can be placed"))?;
        let offset = session.frames();
        let start = session.last_pose().map_or(Pose2::IDENTITY, |last| last.pose);
        let mut poses: Vec<Pose2> = session.poses().iter().map(|stamped| stamped.pose).collect();
        for (stamped, pose) in other.poses().iter().zip(other.world_from_bodies()) {
            poses.push(start.compose(&pose));
            session.push(StampedPose { stamp_s: stamped.stamp_s, pose: start.compose(&pose) });
        }
        let thinning = config.matcher.thinning();
        let mut interruption = Some(Interruption { frame: offset, is_certain: true, is_suspicion: false });
        for scan in other.scans() {
            let key_scan = KeyScan {
                frame: offset + scan.frame,
                pose: poses[offset + scan.frame],
                covariance: Matrix3::zeros(),
                drift: Drift::default(),
                scan: Arc::new(SurfaceScan::new(&scan.points.unpack(), &thinning)),
                points: scan.points.clone(),
                interruption: interruption.take(),
            };
            let newest = key_scan.frame;
            session.add_key_scan(key_scan, |frame| poses[frame..=newest].to_vec());
            while session.close_loops(&mut back_end) {}
        }
        session.set_front_end(front_end.state().map(FrontEndState::interrupted));
        Self::resume(session, config)
    }

    /// Takes in one frame.
    ///
    /// # Errors
    /// When the odometry or a point of the frame is not finite; nothing was changed then.
    pub fn process(&mut self, frame: &Frame) -> Result<StepReport, SlamError> {
        self.process_profiled(frame, &mut NoProfiler)
    }

    /// The same, telling `profiler` what it is at.
    ///
    /// # Errors
    /// As [`process`](Self::process).
    pub fn process_profiled(&mut self, frame: &Frame, profiler: &mut dyn Profiler) -> Result<StepReport, SlamError> {
        check(frame)?;
        // 1. Track: where does the scan fit what was seen lately?
        let step = self.front_end.process(frame, None, profiler);
        // 2. Remember, close loops, and place the front end's frame in the world.
        profiler.enter(Phase::LoopClosure);
        let Self { front_end, session, back_end, settled, stop, .. } = self;
        let tracked = Tracked::of(frame, step, front_end, back_end.is_some());
        let back_end = back_end.as_mut().filter(|_| !stop.is_given());
        let poses_since = |frame: usize| front_end.poses_since(frame);
        let settled_before = *settled;
        let report = remember(tracked, poses_since, session, back_end, settled);
        if *settled != settled_before {
            front_end.forget_poses_before(*settled);
        }
        Ok(report)
    }

    /// All that outlives a step, as of now.
    #[must_use]
    pub fn session(&mut self) -> &Session {
        self.session.set_poses(self.settled, &self.front_end.poses_since(self.settled));
        self.session.set_front_end(self.front_end.state());
        &self.session
    }

    /// Once the signal is given, no more loops are closed, and [`finish`](Self::finish) leaves out what is left of its work:
    /// the trajectory is as it is known then, and the map is drawn along it.
    pub fn stop_on(&mut self, signal: &StopSignal) {
        self.stop = signal.clone();
    }

    /// From now on at most about so many bytes of the session's settled parts lie in memory, and the others in a store; see
    /// [`Session::limit_memory`].
    pub fn limit_memory(&mut self, store: Box<dyn Store>, most_bytes: usize) {
        self.session.limit_memory(store, most_bytes);
    }

    /// What is wrong with that store, if anything is.
    #[must_use]
    pub fn storage_trouble(&self) -> Option<StorageTrouble> {
        self.session.storage_trouble()
    }

    /// Who holds the session's memory now.
    #[must_use]
    pub fn memory(&self) -> SessionMemory {
        self.session.memory()
    }

    /// What closing loops works with now, where loops are closed.
    #[must_use]
    pub fn closure_load(&self) -> Option<ClosureLoad> {
        self.session.places().map(PlaceGraph::load)
    }

    /// How many hypotheses about the drive are held for possible; 0 where loops are not closed.
    #[must_use]
    pub fn hypotheses(&self) -> usize {
        self.session.places().map_or(0, PlaceGraph::hypotheses)
    }

    /// The true length of what the odometry states as one, where the filter learns it; 1 as long as nothing is known.
    #[must_use]
    pub fn odometry_scale(&self) -> Option<f64> {
        self.front_end.odometry_scale()
    }

    /// The trajectory so far, of the particle that is the best now, put right by the loops that were closed so far.
    #[must_use]
    pub fn trajectory(&mut self) -> Vec<StampedPose> {
        self.session().trajectory()
    }

    /// The occupancy grid so far.
    ///
    /// The report's filter has drawn its map along the way; the other filters' maps are made for
    /// matching, so that the grid is drawn of the key scans along the trajectory that is the best now. Only what
    /// changed since the last time is drawn, and what moved by less than a quarter of a cell stays where it was.
    #[must_use]
    pub fn map(&mut self) -> &OccupancyGrid {
        self.session.set_poses(self.settled, &self.front_end.poses_since(self.settled));
        match self.front_end.drawn_map() {
            Some(map) => map,
            None => self.session.draw(&mut self.renderer),
        }
    }

    /// The final trajectory and map: the last loops are closed, all key scans are fitted to each other, and the grid is
    /// drawn along the result.
    #[must_use]
    pub fn finish(self) -> SlamResult {
        self.finish_profiled(&mut NoProfiler)
    }

    /// The same, telling `profiler` what it is at.
    #[must_use]
    pub fn finish_profiled(mut self, profiler: &mut dyn Profiler) -> SlamResult {
        profiler.enter(Phase::LoopClosure);
        let _ = self.session();
        if let Some(back_end) = self.back_end.take() {
            self.session.finish(back_end, self.loop_closure.refinements, &self.matcher, &self.stop);
        }
        profiler.enter(Phase::Map);
        let map = self.front_end.drawn_map().cloned().unwrap_or_else(|| self.session.map());
        let places = self.session.places();
        SlamResult {
            uncertainties: places.map(|places| places.uncertainties(self.session.frames())).unwrap_or_default(),
            trajectory: self.session.trajectory(),
            map,
            closures: places.map(PlaceGraph::reports).unwrap_or_default(),
            kidnappings: places.map(PlaceGraph::kidnappings).unwrap_or_default(),
            graph: self.session.graph(),
            session: self.session,
        }
    }
}

/// What the front end made of a frame.
struct Tracked {
    index: usize,
    stamp_s: f64,
    dead_reckoning: Pose2,
    step: FilterStep,
    key_scan: Option<KeyScan>,
    /// The points of a scan that is no key scan, where they are worth keeping.
    points: Option<CompactScan>,
    /// The front end's poses so far, from the first on that may still change; where they are not asked for at once.
    poses: Vec<Pose2>,
}

impl Tracked {
    /// What came of the last step.
    fn of(frame: &Frame, step: FilterStep, front_end: &mut FrontEnd, keeps_points: bool) -> Self {
        let key_scan = front_end.take_key_scan();
        let points = front_end.points().filter(|_| keeps_points && key_scan.is_none()).cloned();
        let Frame { index, stamp_s, dead_reckoning, .. } = *frame;
        Self { index, stamp_s, dead_reckoning, step, key_scan, points, poses: Vec::new() }
    }
}

/// Takes in what the front end made of a frame: remembers the pose and, where it shows something new, the scan; closes
/// loops, one bounded piece of the work with each frame; and says where in the world the front end's frame is.
///
/// `poses_since(frame)` are the front end's poses from that frame on, as of now; the session's are final up to `settled`.
fn remember(
    tracked: Tracked,
    poses_since: impl Fn(usize) -> Vec<Pose2>,
    session: &mut Session,
    back_end: Option<&mut BackEnd>,
    settled: &mut usize,
) -> StepReport {
    let Tracked { index, stamp_s, dead_reckoning, step, key_scan, points, .. } = tracked;
    session.push(StampedPose { stamp_s, pose: step.pose });
    if let Some(key_scan) = key_scan {
        if session.add_key_scan(key_scan, &poses_since) {
            // A submap has ended: from now on its poses are the session's.
            session.set_poses(*settled, &poses_since(*settled));
            *settled = session.places().and_then(PlaceGraph::open_since).unwrap_or(*settled);
        }
    } else if let Some(points) = points {
        session.add_scan_between(&points);
    }
    if let Some(back_end) = back_end {
        session.close_loops(back_end);
    }
    let places = session.places();
    let world_from_odom = session.world_from_odom();
    StepReport {
        index,
        stamp_s,
        dead_reckoning,
        world_from_odom,
        pose: world_from_odom.compose(&step.pose),
        is_lost: places.is_some_and(PlaceGraph::is_lost),
        uncertainty: places
            .map(|places| places.uncertainty().and(&Uncertainty::of(&step.covariance)).after(&step.drift)),
        filter: step,
    }
}

pub(crate) fn check(frame: &Frame) -> Result<(), SlamError> {
    let points = &frame.scan.hits;
    let times_s = frame.scan.skew.iter().flat_map(|skew| skew.hits_s.iter().chain(&skew.free_ends_s));
    let scan_is_finite = points.x_m.iter().chain(&points.y_m).chain(times_s).all(|number| number.is_finite());
    if !scan_is_finite || frame.motion.is_some_and(|motion| !motion.is_finite()) {
        return Err(SlamError::NotFinite { index: frame.index, stamp_s: frame.stamp_s });
    }
    Ok(())
}
