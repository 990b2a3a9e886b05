//! All that outlives a step.

use super::Renderer;
use super::pose_log::PoseLog;
use super::refinement::Refinement;
use super::trajectory::correct_poses;
use crate::StopSignal;
use crate::back_end::{Anchor, BackEnd, PlaceGraph, Submap};
use crate::compact_scan::CompactScan;
use crate::front_end::FrontEndState;
use crate::geometry::Pose2;
use crate::key_scan::KeyScan;
use crate::map::{MapConfig, OccupancyGrid};
use crate::pose_graph::PoseGraph;
use crate::scan_matcher::MatcherConfig;
use crate::sensors::StampedPose;
use crate::storage::{Shelf, StorageTrouble, Store};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use thiserror::Error;

/// A key scan as it is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredScan {
    /// Which frame it was, counted from 0.
    pub frame: usize,
    /// Its points, in the body's frame.
    pub points: CompactScan,
    /// Whether the occupancy grid is drawn of it: a robot that turns slowly shows nothing new with each scan.
    pub is_drawn: bool,
}

/// The drive so far: the front end's poses, the key scans, and the places that hold them together.
///
/// Two frames: the front end drifts in `odom`; the places put it right in `world`, whose origin is the body's pose at
/// the first scan unless the session was [moved](Self::moved).
#[derive(Debug, Clone)]
pub struct Session {
    map: MapConfig,
    /// The front end's poses, `odom_from_body`, one for each frame.
    poses: PoseLog,
    scans: Vec<StoredScan>,
    /// Scans between the key scans, the newest: they have no say in the map, but are fitted to it in the end.
    between: ScansBetween,
    /// Where the last drawn scan was taken, `odom_from_body`.
    last_drawn: Option<Pose2>,
    /// How places lie to each other; `None` where loops are not closed.
    places: Option<PlaceGraph>,
    /// What the front end needs to go on, as of the last time it was asked.
    front_end: Option<FrontEndState>,
    /// What the drive amounts to once it has ended; `None` before.
    finished: Option<Finished>,
    /// The first scan's pose, world from body.
    world_from_start: Pose2,
    /// How many of the submaps have their parts where they are to lie.
    laid: usize,
    /// Where those are, if memory is bounded.
    shelf: Option<Arc<Shelf>>,
}

/// The newest scans between the key scans.
#[derive(Debug, Clone, Default)]
struct ScansBetween {
    /// Frames, ascending, and their points.
    scans: VecDeque<(usize, CompactScan)>,
    bytes: usize,
    last: Option<Pose2>,
}

/// Scans between key scans are kept up to so many bytes: that of an hour with most LiDARs. Fitting every scan to the
/// final map makes poses between key scans a little more exact (aces 0.0360 → 0.0350 m).
const BYTES_BETWEEN: usize = 32 << 20;
/// A robot that moves by less than these from scan to scan stands still, metres and radians.
const STANDSTILL_M: f64 = 0.005;
const STANDSTILL_RAD: f64 = 0.002;

impl ScansBetween {
    fn add(&mut self, frame: usize, pose: &Pose2, points: &CompactScan) {
        let stands_still = self.last.is_some_and(|last| {
            let step = last.between(pose);
            step.distance() < STANDSTILL_M && step.theta.abs() < STANDSTILL_RAD
        });
        if stands_still {
            return;
        }
        self.last = Some(*pose);
        self.bytes += points.packed_len();
        self.scans.push_back((frame, points.clone()));
        while self.bytes > BYTES_BETWEEN {
            let Some((_, oldest)) = self.scans.pop_front() else { break };
            self.bytes -= oldest.packed_len();
        }
    }
}

/// A drive that has ended. The places as they were before stay beside it: a drive that goes on goes on from those.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Finished {
    places: PlaceGraph,
    /// Frames whose scans were fitted to the map of all key scans, ascending, with their poses, world from body.
    refined: Vec<(usize, Pose2)>,
}

impl Finished {
    /// Adds poses that were fitted to all scans, with their frames.
    fn add_refined(&mut self, refined: impl Iterator<Item = (usize, Pose2)>) {
        self.refined.extend(refined);
        self.refined.sort_by_key(|&(frame, _)| frame);
    }
}

/// What is stored of a session beside the frames' poses and the key scans, which only grow.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SessionState {
    map: MapConfig,
    matcher: MatcherConfig,
    last_drawn: Option<Pose2>,
    places: Option<PlaceGraph>,
    finished: Option<Finished>,
    front_end: Option<FrontEndState>,
    #[serde(default)]
    world_from_start: Pose2,
    /// Submaps that the end of the drive left other than they were before, with their numbers.
    #[serde(default)]
    finished_submaps: Vec<(usize, Submap)>,
}

impl SessionState {
    /// What was stored of the submaps one by one. Files of the first version hold them in the state itself.
    pub fn set_submaps(&mut self, submaps: Vec<Submap>) {
        let submaps: Vec<Arc<Submap>> = submaps.into_iter().map(Arc::new).collect();
        if let Some(finished) = &mut self.finished {
            let others = std::mem::take(&mut self.finished_submaps).into_iter();
            finished.places.replace_submaps(submaps.iter().cloned().enumerate());
            finished.places.replace_submaps(others.map(|(number, submap)| (number, Arc::new(submap))));
        }
        if let Some(places) = &mut self.places {
            places.replace_submaps(submaps.into_iter().enumerate());
        }
    }
}

/// Why what was stored is no session.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct SessionError(pub(crate) &'static str);

impl Session {
    /// Nothing seen yet; with `places` where loops are closed.
    #[must_use]
    pub fn new(map: &MapConfig, places: Option<PlaceGraph>) -> Self {
        Self {
            map: map.clone(),
            poses: PoseLog::default(),
            scans: Vec::new(),
            between: ScansBetween::default(),
            last_drawn: None,
            places,
            front_end: None,
            finished: None,
            world_from_start: Pose2::IDENTITY,
            laid: 0,
            shelf: None,
        }
    }

    /// From now on at most about so many bytes of what grows with new ground lie in memory: key scans, what submaps look
    /// like, packed poses. What was not used for the longest time is put away in the store, and comes back when it is
    /// needed: results are the same bytes as without. Copies made from now on share the store.
    ///
    /// Nothing happens if this was asked for before.
    pub fn limit_memory(&mut self, store: Box<dyn Store>, most_bytes: usize) {
        if self.shelf.is_some() {
            return;
        }
        let shelf = Arc::new(Shelf::new(store, most_bytes));
        self.poses.lay_on(&shelf);
        self.scans[..self.open_scans()].iter().for_each(|scan| scan.points.part().lay_on(&shelf));
        let finished = self.finished.iter().flat_map(|finished| finished.places.submaps());
        self.submaps().iter().chain(finished).for_each(|submap| submap.lay_on(&shelf));
        self.shelf = Some(shelf);
    }

    /// What is wrong with the store of [`limit_memory`](Self::limit_memory), if anything is.
    #[must_use]
    pub fn storage_trouble(&self) -> Option<StorageTrouble> {
        self.shelf.as_ref().and_then(|shelf| shelf.trouble())
    }

    /// Bytes that were put away.
    pub(super) fn bytes_put_away(&self) -> usize {
        self.shelf.as_ref().map_or(0, |shelf| shelf.away_bytes())
    }

    /// The first key scan of the submap in the making.
    fn open_scans(&self) -> usize {
        let first = self.places_so_far().and_then(PlaceGraph::open_since).unwrap_or(usize::MAX);
        self.scans.partition_point(|scan| scan.frame < first)
    }

    /// Joins the key scans of each submap that has ended since this was done last, and lays them where they are to be.
    fn lay_ended_submaps(&mut self) {
        let Some(places) = &self.places else { return };
        let firsts: Vec<usize> = places.submaps()[self.laid..].iter().map(|submap| submap.first).collect();
        for (number, &first) in firsts.iter().enumerate() {
            let end = firsts.get(number + 1).copied().or_else(|| places.open_since()).unwrap_or(usize::MAX);
            let at = |frame: usize| self.scans.partition_point(|scan| scan.frame < frame);
            let scans = at(first)..at(end);
            CompactScan::join(self.scans[scans].iter_mut().map(|scan| &mut scan.points), self.shelf.as_ref());
            if let Some(shelf) = &self.shelf {
                places.submaps()[self.laid].lay_on(shelf);
            }
            self.laid += 1;
        }
    }

    /// How its map is drawn.
    #[must_use]
    pub fn map_config(&self) -> &MapConfig {
        &self.map
    }

    /// Number of frames.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.poses.len()
    }

    /// Number of frames whose pose in the front end's frame does not change any more.
    #[must_use]
    pub fn settled_frames(&self) -> usize {
        self.places_so_far().and_then(PlaceGraph::open_since).unwrap_or(0)
    }

    /// The key scans, in the order of the drive.
    #[must_use]
    pub fn scans(&self) -> &[StoredScan] {
        &self.scans
    }

    /// How places lie to each other, at the end of the drive where that has come; `None` where loops are not closed.
    #[must_use]
    pub fn places(&self) -> Option<&PlaceGraph> {
        self.finished.as_ref().map(|finished| &finished.places).or(self.places.as_ref())
    }

    /// The front end's poses, `odom_from_body`, one for each frame.
    #[must_use]
    pub fn poses(&self) -> Vec<StampedPose> {
        self.poses.since(0)
    }

    /// Those from a frame on.
    #[must_use]
    pub fn poses_since(&self, frame: usize) -> Vec<StampedPose> {
        self.poses.since(frame)
    }

    /// The newest of them.
    #[must_use]
    pub fn last_pose(&self) -> Option<StampedPose> {
        self.poses.last()
    }

    /// Those of a block of [`POSES_PER_BLOCK`](super::POSES_PER_BLOCK) frames, as [`pack_poses`](super::pack_poses) packs
    /// them; the last block may be short.
    #[must_use]
    pub fn packed_poses(&self, block: usize) -> Arc<[u8]> {
        self.poses.block(block)
    }

    /// Bytes that the poses take.
    pub(super) fn bytes_of_poses(&self) -> usize {
        self.poses.held_bytes()
    }

    /// Bytes that scans between key scans take.
    pub(super) fn bytes_between(&self) -> usize {
        self.between.bytes + self.between.scans.len() * size_of::<(usize, CompactScan)>()
    }

    pub(crate) fn front_end(&self) -> Option<&FrontEndState> {
        self.front_end.as_ref()
    }

    pub(crate) fn set_front_end(&mut self, state: Option<FrontEndState>) {
        self.front_end = state;
    }

    /// The drive goes on: what it amounted to as yet is no end.
    pub(crate) fn reopen(&mut self) {
        self.finished = None;
    }

    /// What is to be stored beside [`poses`](Self::poses) and [`scans`](Self::scans). `matcher` is how scans were
    /// matched.
    #[must_use]
    pub fn state(&self, matcher: &MatcherConfig) -> SessionState {
        SessionState {
            map: self.map.clone(),
            matcher: matcher.clone(),
            last_drawn: self.last_drawn,
            places: self.places.clone(),
            finished: self.finished.clone(),
            front_end: self.front_end.clone(),
            world_from_start: self.world_from_start,
            finished_submaps: self.finished_submaps(),
        }
    }

    /// The submaps as far as the drive has come, to be stored one by one: those that did not change are the same ones as
    /// before. Empty where loops are not closed.
    #[must_use]
    pub fn submaps(&self) -> &[Arc<Submap>] {
        self.places_so_far().map_or(&[], PlaceGraph::submaps)
    }

    /// Those that the end of the drive left other than they were before.
    fn finished_submaps(&self) -> Vec<(usize, Submap)> {
        let finished = self.finished.iter().flat_map(|finished| finished.places.submaps()).enumerate();
        let changed = finished
            .filter(|(number, submap)| !self.submaps().get(*number).is_some_and(|before| Arc::ptr_eq(before, submap)));
        changed.map(|(number, submap)| (number, Submap::clone(submap))).collect()
    }

    /// A session as it was stored; poses and scans may be newer than the rest.
    ///
    /// # Errors
    /// When the parts do not belong together.
    pub fn restore(state: SessionState, poses: Vec<StampedPose>, scans: Vec<StoredScan>) -> Result<Self, SessionError> {
        let holds = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(SessionError(what)) };
        let are_finite = poses.iter().all(|stamped| stamped.pose.is_finite() && stamped.stamp_s.is_finite());
        holds(are_finite && state.world_from_start.is_finite(), "a pose is not finite")?;
        holds(scans.iter().all(|scan| scan.frame < poses.len()), "a key scan is of a frame that is not there")?;
        holds(scans.is_sorted_by(|a, b| a.frame < b.frame), "key scans are out of order")?;
        let window = state.front_end.as_ref().map_or(0, FrontEndState::window_scans);
        holds(window <= scans.len(), "the front end's map is made of more key scans than there are")?;
        let odom_from_bodies: Vec<Pose2> = poses.iter().map(|stamped| stamped.pose).collect();
        let mut session = Self {
            map: state.map,
            poses: poses.into_iter().collect(),
            scans,
            between: ScansBetween::default(),
            last_drawn: state.last_drawn,
            places: state.places,
            front_end: state.front_end,
            finished: state.finished,
            world_from_start: state.world_from_start,
            laid: 0,
            shelf: None,
        };
        let frames: Vec<usize> = session.scans.iter().map(|scan| scan.frame).collect();
        let points: Vec<CompactScan> = session.scans.iter().map(|scan| scan.points.clone()).collect();
        let thinning = state.matcher.thinning();
        let is_shared = |(number, submap): (usize, &Arc<Submap>)| {
            session.submaps().get(number).is_some_and(|other| Arc::ptr_eq(other, submap))
        };
        let finished = session.finished.iter().flat_map(|finished| finished.places.submaps());
        let shared: Vec<bool> = finished.enumerate().map(is_shared).collect();
        if let Some(places) = &mut session.places {
            places.restore(&odom_from_bodies, &frames, &points, &thinning).map_err(SessionError)?;
        }
        if let Some(finished) = &mut session.finished {
            // Most submaps are as they were before the drive ended: they are made once.
            let so_far = session.places.as_ref().map_or(&[][..], PlaceGraph::submaps).iter().enumerate();
            let same: Vec<_> = so_far.filter(|(number, _)| shared.get(*number) == Some(&true)).collect();
            finished.places.replace_submaps(same.into_iter().map(|(number, submap)| (number, Arc::clone(submap))));
            finished.places.restore(&odom_from_bodies, &frames, &points, &thinning).map_err(SessionError)?;
            let frames: Vec<usize> = finished.refined.iter().map(|(frame, _)| *frame).collect();
            let are_frames =
                frames.is_sorted_by(|a, b| a < b) && frames.last().is_none_or(|&last| last < session.poses.len());
            let are_finite = finished.refined.iter().all(|(_, pose)| pose.is_finite());
            holds(are_frames && are_finite, "the refined poses are not those of frames")?;
        }
        session.poses.pack(session.settled_frames());
        session.lay_ended_submaps();
        Ok(session)
    }

    /// How places lie to each other as far as the drive has come; `None` where loops are not closed.
    pub(crate) fn places_so_far(&self) -> Option<&PlaceGraph> {
        self.places.as_ref()
    }

    /// Appends a frame's pose, `odom_from_body`.
    pub fn push(&mut self, pose: StampedPose) {
        self.poses.push(pose);
    }

    /// Gives the frames from `first` on other poses, `odom_from_body`: which of several particles is the best may
    /// change, and what seemed to fit may turn out not to.
    pub fn set_poses(&mut self, first: usize, poses: &[Pose2]) {
        self.poses.set(first, poses);
        self.poses.pack(self.settled_frames());
    }

    /// Keeps the points of the scan of a frame, the newest so far.
    pub fn add_scan(&mut self, frame: usize, points: CompactScan) {
        let Some(StampedPose { pose, .. }) = self.poses.get(frame) else { return };
        let is_drawn = self.last_drawn.is_none_or(|last| {
            let step = last.between(&pose);
            step.distance() > self.map.redraw_distance_m || step.theta.abs() > self.map.redraw_angle_rad
        });
        if is_drawn {
            self.last_drawn = Some(pose);
        }
        self.scans.push(StoredScan { frame, points, is_drawn });
    }

    /// Keeps the points of the newest frame's scan, which is no key scan, as long as there is room.
    pub(crate) fn add_scan_between(&mut self, points: &CompactScan) {
        if let Some(newest) = self.poses.last() {
            self.between.add(self.poses.len() - 1, &newest.pose, points);
        }
    }

    /// Takes in a key scan; tells whether it ended a submap. `poses_since(frame)` are the front end's poses from
    /// that frame on.
    pub fn add_key_scan(&mut self, key_scan: KeyScan, poses_since: impl FnOnce(usize) -> Vec<Pose2>) -> bool {
        self.add_scan(key_scan.frame, key_scan.points.clone());
        let has_ended = self.places.as_mut().is_some_and(|places| places.add(key_scan, poses_since));
        if has_ended {
            self.lay_ended_submaps();
        }
        has_ended
    }

    /// Lets the back end do one piece of its work, and forgets the key scans that it has no use for any more; tells
    /// whether there was any work.
    pub(crate) fn close_loops(&mut self, back_end: &mut BackEnd) -> bool {
        let Some(places) = &mut self.places else { return false };
        let has_worked = back_end.work(places);
        for frames in places.take_outdated() {
            let at = |frame: usize| self.scans.partition_point(|scan| scan.frame < frame);
            self.scans.drain(at(frames.start)..at(frames.end));
        }
        has_worked
    }

    /// Where the frames' poses are known in the world.
    fn anchors(&self) -> Vec<Anchor> {
        let submaps = self.places().map(PlaceGraph::anchors).unwrap_or_default();
        let refined = self.finished.as_ref().map_or(&[][..], |finished| &finished.refined);
        if refined.is_empty() {
            return submaps;
        }
        // Submaps whose key scans were forgotten have no refined poses.
        let mut submaps = submaps.into_iter().peekable();
        let mut anchors = Vec::with_capacity(refined.len());
        for &(frame, pose) in refined {
            anchors.extend(std::iter::from_fn(|| submaps.next_if(|submap| submap.frame < frame)));
            let interruption = submaps.next_if(|submap| submap.frame == frame).and_then(|submap| submap.interruption);
            anchors.push(Anchor { frame, pose, interruption });
        }
        anchors.extend(submaps);
        anchors
    }

    /// The poses of all frames, world from body; the first is the identity unless the session was moved.
    #[must_use]
    pub fn world_from_bodies(&self) -> Vec<Pose2> {
        self.trajectory().iter().map(|stamped| stamped.pose).collect()
    }

    /// Where the front end's frame is in the world: the transform that REP 105 calls map→odom.
    #[must_use]
    pub fn world_from_odom(&self) -> Pose2 {
        self.world_from_start.compose(&self.places().map_or(Pose2::IDENTITY, PlaceGraph::correction))
    }

    /// The same session in a world whose axes lie elsewhere.
    #[must_use]
    pub fn moved(mut self, new_world_from_world: &Pose2) -> Self {
        self.world_from_start = new_world_from_world.compose(&self.world_from_start);
        self
    }

    /// The pose graph of the submaps in the world; `None` where loops are not closed.
    #[must_use]
    pub fn graph(&self) -> Option<PoseGraph> {
        let mut graph = self.places()?.graph();
        graph.poses_mut().iter_mut().for_each(|pose| *pose = self.world_from_start.compose(pose));
        Some(graph)
    }

    /// The trajectory: the body's pose in the world at each frame's stamp.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        let mut poses = self.corrected_poses();
        let start = poses.first().map_or(Pose2::IDENTITY, |first| first.pose);
        poses
            .iter_mut()
            .for_each(|stamped| stamped.pose = self.world_from_start.compose(&start.between(&stamped.pose)));
        poses
    }

    /// The poses of all frames where the places have them.
    fn corrected_poses(&self) -> Vec<StampedPose> {
        let mut poses = self.poses();
        correct_poses(&mut poses, &self.anchors());
        poses
    }

    /// The occupancy grid, drawn with what `renderer` drew before.
    pub fn draw<'a>(&self, renderer: &'a mut Renderer) -> &'a OccupancyGrid {
        self.draw_along(&self.world_from_bodies(), renderer)
    }

    /// The same along other poses of the frames, world from body.
    pub fn draw_along<'a>(&self, world_from_bodies: &[Pose2], renderer: &'a mut Renderer) -> &'a OccupancyGrid {
        let drawn = self.scans.iter().filter(|scan| scan.is_drawn && scan.frame < world_from_bodies.len());
        let drawn: Vec<_> = drawn.map(|scan| (scan.frame, &scan.points, world_from_bodies[scan.frame])).collect();
        renderer.draw(&drawn)
    }

    /// The occupancy grid, drawn from nothing.
    #[must_use]
    pub fn map(&self) -> OccupancyGrid {
        let mut renderer = Renderer::new(&self.map);
        self.draw(&mut renderer);
        renderer.into_grid()
    }

    /// Ends the drive: the last loops are closed, and all scans are fitted to each other, so many times. Once the signal is
    /// given, what is not done is left out.
    pub(crate) fn finish(&mut self, back_end: BackEnd, refinements: usize, matcher: &MatcherConfig, stop: &StopSignal) {
        let Some(places) = &self.places else { return };
        let mut places = places.clone();
        back_end.finish(&mut places, stop);
        // The drive may go on from before: its end forgets no key scans.
        let _ = places.take_outdated();
        self.finished = Some(Finished { places, refined: Vec::new() });
        if refinements == 0 || stop.is_given() {
            return;
        }
        let poses = self.corrected_poses();
        let mut refinement = Refinement::new(&self.scans, matcher, stop);
        let mut of_key_scans: Vec<Pose2> = self.scans.iter().map(|scan| poses[scan.frame].pose).collect();
        for _ in 1..refinements {
            of_key_scans = refinement.fitted(&of_key_scans);
        }
        let of_map = of_key_scans;
        let of_key_scans = refinement.fitted(&of_map);
        if stop.is_given() {
            // Not all of them were fitted.
            return;
        }
        let frames = self.scans.iter().map(|scan| scan.frame);
        self.finished
            .iter_mut()
            .for_each(|finished| finished.add_refined(frames.clone().zip(of_key_scans.iter().copied())));
        // Moved along with the key scans around them the others nearly fit, so that half of their points will do.
        let poses = self.corrected_poses();
        let between: Vec<(&CompactScan, Pose2)> =
            self.between.scans.iter().map(|(frame, points)| (points, poses[*frame].pose)).collect();
        let of_between = refinement.fitted_between(&of_map, &between);
        if stop.is_given() {
            return;
        }
        let frames = self.between.scans.iter().map(|(frame, _)| *frame);
        self.finished
            .iter_mut()
            .for_each(|finished| finished.add_refined(frames.clone().zip(of_between.iter().copied())));
    }
}
