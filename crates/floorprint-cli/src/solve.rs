//! From a data set to a trajectory, a map and a floor: the work that `run` and `demo` share.

use crate::dead_reckon::{dead_reckon, is_without_lidar};
use crate::interrupt::Interrupt;
use crate::memory::StorageWatch;
use crate::session_keeper::SessionKeeper;
use crate::snapshots::Snapshots;
use crate::stopwatch::{Lane, ScanTimes, Stopwatch};
use crate::terminal::Terminal;
use anyhow::{anyhow, ensure};
use floorprint::back_end::{ClosureReport, Kidnapping, Uncertainty};
use floorprint::geometry::Pose2;
use floorprint::map::OccupancyGrid;
use floorprint::odometry::{DeadReckoning, OdometryError, OdometrySource, SynchronisationSummary, Trajectory};
use floorprint::pose_graph::PoseGraph;
use floorprint::sensors::StampedPose;
use floorprint::session::Session;
use floorprint::storage::Store;
use floorprint::texture::{
    FloorMapper, FloorPatch, RgbdCamera, RgbdFrame, SkipReason, TextureMap, pair_by_time, spaced,
};
use floorprint::{Config, Phase, Profiler, Slam, SlamError, StepReport};
use floorprint_io::{DataSet, ImageIndex, LoadedPair};
use floorprint_live::{Whereabouts, resume};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// What a drive amounts to.
pub struct Solution {
    /// What each step of the filter said.
    pub steps: Vec<StepReport>,
    /// The body's pose at every scan; the first is the identity. Without a LiDAR at every reading of the odometry.
    pub trajectory: Vec<StampedPose>,
    /// Dead reckoning at every scan; empty where nothing but scans tells the motion.
    pub odometry: Vec<StampedPose>,
    /// Every comparison of places that were passed more than once.
    pub closures: Vec<ClosureReport>,
    /// How uncertain each pose is; empty where nothing is known of it.
    pub uncertainties: Vec<Uncertainty>,
    /// Where the robot was carried elsewhere.
    pub kidnappings: Vec<Kidnapping>,
    /// The pose graph of the submaps, where loops were closed.
    pub graph: Option<PoseGraph>,
    /// The true length of what the odometry states as one, where that was learnt.
    pub odometry_scale: Option<f64>,
    /// All of it, to be gone on with.
    pub session: Session,
    /// The occupancy grid.
    pub map: OccupancyGrid,
    /// The painted floor, where there were images.
    pub floor: Option<Floor>,
    /// What became of the records.
    pub summary: SynchronisationSummary,
    /// Scans that the filter could not use, with the reason.
    pub refused: BTreeMap<String, usize>,
    /// How long each scan took.
    pub(crate) scan_times: ScanTimes,
    /// How long the end took, from the last scan to the final map, seconds.
    pub finish_s: f64,
    /// Whether the user stopped the work before its end.
    pub partial: bool,
}

/// The painted floor and what became of the images.
pub struct Floor {
    /// The colours.
    pub map: TextureMap,
    /// The body's pose at each image that shows floor.
    pub images: Vec<StampedPose>,
    /// Pairs of images left out because the robot had hardly moved since the one before.
    pub nothing_new: usize,
    /// Images that were not used, by reason.
    pub skipped: BTreeMap<String, usize>,
}

impl Solution {
    /// Whether there was no LiDAR: the trajectory is dead reckoning, and there is no map.
    #[must_use]
    pub fn is_dead_reckoning(&self) -> bool {
        self.summary.scans == 0
    }

    /// Whether dead reckoning is something to compare the trajectory with: not where it is the trajectory, nor where nothing
    /// tells the motion.
    #[must_use]
    pub fn has_odometry(&self) -> bool {
        !self.odometry.is_empty()
    }
}

impl Floor {
    /// Floor that has a colour, square metres.
    pub fn painted_m2(&self) -> f64 {
        self.map.cells.iter().flatten().count() as f64 * self.map.resolution_m * self.map.resolution_m
    }
}

/// Everything around the work: who watches it and who may end it.
pub(crate) struct Surroundings<'a> {
    /// Where progress is shown.
    pub(crate) terminal: &'a Terminal,
    /// Ctrl-C.
    pub(crate) interrupt: &'a Interrupt,
    /// Told which phase the work is in.
    pub(crate) profiler: &'a mut Stopwatch,
    /// Draws pictures on the way, where asked for.
    pub(crate) snapshots: Option<&'a mut Snapshots>,
    /// Keeps what was seen so far safe.
    pub(crate) session: Option<&'a mut SessionKeeper>,
    /// Where what is not needed now is put away, and how much lies in memory, bytes; `None` where that is not bounded.
    pub(crate) memory: Option<(Box<dyn Store>, usize)>,
    /// What the drive goes on from.
    pub(crate) earlier: Option<Earlier>,
}

/// A session that the drive goes on from.
pub(crate) struct Earlier {
    /// The session.
    pub(crate) session: Session,
    /// Where the robot is at the start of the drive.
    pub(crate) start: Start,
}

/// Where a robot is that goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Start {
    /// Where the session ended.
    Last,
    /// Anywhere: it is placed when the evidence suffices.
    Unknown,
    /// Where the session ended, if the drive begins within seconds of it; else anywhere.
    Auto,
}

/// A drive that begins so soon after another goes on where that ended, seconds.
const LONGEST_PAUSE_S: f64 = 10.0;

impl Start {
    /// The same, as the engine knows it.
    pub(crate) fn whereabouts(self) -> Whereabouts {
        match self {
            Self::Last => Whereabouts::Last,
            Self::Unknown => Whereabouts::Unknown,
            Self::Auto => Whereabouts::LastIfWithin(LONGEST_PAUSE_S),
        }
    }
}

impl Earlier {
    /// A SLAM that goes on with the session; the drive's first scan has this stamp, seconds.
    fn resume(self, first_stamp_s: f64, config: &Config) -> anyhow::Result<Slam> {
        Ok(resume(self.session, self.start.whereabouts(), first_stamp_s, config)?)
    }
}

/// Frames that are worked on side by side before a look is taken at who watches: as many as can be made in this time …
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// … and no more than this.
const AT_ONCE: usize = 2048;

/// Runs the filter over a drive and paints the floor. The records are pushed by their stamps, or `as_they_come`. Without
/// a LiDAR the drive is dead-reckoned.
///
/// # Errors
/// No frames can be made of the records; no scan shows anything; the camera's calibration cannot work.
pub(crate) fn solve(
    data_set: &DataSet,
    config: &Config,
    paints: bool,
    as_they_come: bool,
    around: &mut Surroundings<'_>,
) -> anyhow::Result<Solution> {
    if is_without_lidar(data_set) {
        return dead_reckon(data_set, config, paints, around);
    }
    around.profiler.enter(Phase::Synchronise);
    let mut frames = data_set.frames(config).map_err(|error| explain(error, data_set))?;
    if as_they_come {
        frames = frames.in_order_of_arrival();
    }
    let mut earlier = around.earlier.take();
    let mut slam = Slam::new(config);
    slam.stop_on(around.interrupt.signal());
    let (mut memory, mut storage) = (around.memory.take(), StorageWatch::default());
    let mut steps: Vec<StepReport> = Vec::with_capacity(frames.len());
    let mut refused = BTreeMap::new();
    let mut scan_times = ScanTimes::default();
    let progress = around.terminal.progress("solving", "scans", frames.len());
    around.interrupt.is_preparing(false);
    let mut something_seen = false;
    let mut partial;
    let mut pass = frames.iter();
    loop {
        partial = around.interrupt.requested();
        if partial {
            break;
        }
        if earlier.is_none()
            && let Some((store, most_bytes)) = memory.take()
        {
            slam.limit_memory(store, most_bytes);
        }
        // Pictures on the way are of one moment: nothing may be ahead of it.
        let is_side_by_side = rayon::current_num_threads() > 1 && earlier.is_none() && around.snapshots.is_none();
        let mut hit_something = Vec::new();
        let outcomes = if is_side_by_side {
            around.profiler.pause();
            let mut lanes = [Lane::default(), Lane::default(), Lane::default()];
            let (begun, interrupt) = (Instant::now(), around.interrupt);
            let goes_on = || begun.elapsed() < LOOK_EVERY && !interrupt.requested();
            let mut frames = std::iter::from_fn(|| {
                let frame = (hit_something.is_empty() || goes_on()).then(|| pass.next()).flatten()?;
                hit_something.push(!frame.scan.hits.is_empty());
                Some(frame)
            });
            let outcomes = slam.process_side_by_side(&mut frames, AT_ONCE, lanes.each_mut().map(|lane| lane as _));
            lanes.iter().for_each(|lane| around.profiler.add(lane));
            scan_times.add_all(&lanes);
            outcomes
        } else {
            around.profiler.enter(Phase::Synchronise);
            let started = Instant::now();
            let Some(mut frame) = pass.next() else { break };
            if let Some(earlier) = earlier.take() {
                slam = earlier.resume(frame.stamp_s, config)?;
                slam.stop_on(around.interrupt.signal());
                // Nothing measured the motion between the two drives.
                frame.motion = None;
            }
            hit_something.push(!frame.scan.hits.is_empty());
            let outcome = slam.process_profiled(&frame, around.profiler);
            scan_times.add(started.elapsed().as_secs_f64());
            vec![outcome]
        };
        if outcomes.is_empty() {
            break;
        }
        progress.inc(outcomes.len() as u64);
        for (outcome, hit_something) in outcomes.into_iter().zip(hit_something) {
            match outcome {
                Ok(step) => {
                    steps.push(step);
                    something_seen |= hit_something;
                }
                Err(error) => *refused.entry(reason_for_refusing(&error).to_owned()).or_default() += 1,
            }
        }
        storage.look(slam.storage_trouble(), around.terminal)?;
        if let Some(snapshots) = &mut around.snapshots {
            snapshots.observe(&mut slam, &steps);
        }
        if let Some(session) = &mut around.session {
            session.observe(&mut slam, &config.matcher);
        }
    }
    progress.finish_and_clear();
    if let Some(error) = pass.error() {
        return Err(explain(error.clone(), data_set));
    }
    ensure!(
        something_seen || partial,
        "no ray of any scan hit anything from {} to {} m away (scan.range_min_m, scan.range_max_m): are the ranges in metres?",
        config.scan.range_min_m,
        config.scan.range_max_m
    );

    let started = Instant::now();
    let odometry_scale = slam.odometry_scale();
    let result = slam.finish_profiled(around.profiler);
    let finish_s = started.elapsed().as_secs_f64();
    storage.look(result.session.storage_trouble(), around.terminal)?;
    let floor = match paints && !partial {
        true => paint_floor(data_set, config, &pass.dead_reckoning(), &result.trajectory, around)?,
        false => None,
    };
    partial |= around.interrupt.requested();
    let summary = pass.summary();
    let of_odometry = if summary.source == OdometrySource::ScanMatching { &steps[..0] } else { &steps[..] };
    let dead_reckoned = |step: &StepReport| StampedPose { stamp_s: step.stamp_s, pose: step.dead_reckoning };
    Ok(Solution {
        odometry: of_odometry.iter().map(dead_reckoned).collect(),
        // Scans that were not reached count, too.
        summary: SynchronisationSummary { scans: data_set.scans().count().max(summary.scans), ..summary },
        trajectory: result.trajectory,
        closures: result.closures,
        uncertainties: result.uncertainties,
        kidnappings: result.kidnappings,
        graph: result.graph,
        odometry_scale,
        session: result.session,
        map: result.map,
        steps,
        floor,
        refused,
        scan_times,
        finish_s,
        partial,
    })
}

/// Why nothing can be made of a data set, with what it would need.
pub(crate) fn explain(error: OdometryError, data_set: &DataSet) -> anyhow::Error {
    match error {
        OdometryError::NoScans { .. } => {
            let topics =
                data_set.bag.as_ref().map_or(String::new(), |bag| format!("; its topics: {}", bag.list_of_topics()));
            anyhow!("{error}: a map needs {}{topics}", data_set.format.scans)
        }
        error => error.into(),
    }
}

/// Paints the floor along a trajectory, where there are images and a camera that is calibrated.
///
/// # Errors
/// The camera's calibration cannot work.
pub(crate) fn paint_floor(
    data_set: &DataSet,
    config: &Config,
    dead_reckoning: &DeadReckoning,
    poses: &[StampedPose],
    around: &mut Surroundings<'_>,
) -> anyhow::Result<Option<Floor>> {
    let Some((images, camera)) = data_set.images.as_ref().zip(RgbdCamera::of(&config.robot)) else { return Ok(None) };
    around.profiler.enter(Phase::Texture);
    paint(images, camera, config, dead_reckoning, poses, around).map(Some)
}

/// Paints the floor from the images, read as they are needed.
fn paint(
    images: &ImageIndex,
    camera: RgbdCamera,
    config: &Config,
    dead_reckoning: &DeadReckoning,
    poses: &[StampedPose],
    around: &Surroundings<'_>,
) -> anyhow::Result<Floor> {
    let mapper = FloorMapper::new(&config.texture, camera, config.seed)?;
    let stamps = |entries: &[floorprint_io::ImageEntry]| entries.iter().map(|entry| entry.stamp_s).collect::<Vec<_>>();
    let pairing = pair_by_time(&stamps(&images.depth), &stamps(&images.color), config.texture.pairing_gap_max_s);
    let trajectory = Trajectory::new(poses);
    let pose_at = |stamp_s: f64| trajectory.pose_at(stamp_s, dead_reckoning);
    let places: Vec<Pose2> = pairing.pairs.iter().map(|pair| pose_at(images.color[pair.color].stamp_s)).collect();
    let kept = spaced(&places, config.texture.image_spacing_m, config.texture.image_spacing_rad);
    let pairs: Vec<_> = pairing.pairs.iter().zip(kept).filter(|(_, kept)| *kept).map(|(pair, _)| *pair).collect();
    let progress = around.terminal.progress("painting", "images", pairs.len());

    let patch = |pair: LoadedPair| -> Result<FloorPatch, String> {
        let (depth, color) = pair.map_err(|error| error.problem().found.clone())?;
        let motion = dead_reckoning.motion(depth.stamp_s, color.stamp_s);
        let frame = RgbdFrame { depth: &depth, color: &color, depth_body_from_color_body: motion };
        let patch = mapper.patch(&frame).map_err(|reason| reason_for_skipping(reason).to_owned());
        progress.inc(1);
        patch
    };
    let outcomes = images.for_each_pair(&pairs, &|| around.interrupt.requested(), &patch);
    progress.finish_and_clear();

    let mut skipped = BTreeMap::new();
    let mut count = |reason: String, images: usize| {
        if images > 0 {
            *skipped.entry(reason).or_insert(0) += images;
        }
    };
    count("depth images without a colour image near in time".to_owned(), pairing.unpaired_depth);
    count("colour images without a depth image near in time".to_owned(), pairing.unpaired_color);
    let mut patches = Vec::with_capacity(outcomes.len());
    for outcome in outcomes {
        match outcome {
            Ok(patch) => patches.push(patch),
            Err(reason) => count(reason, 1),
        }
    }
    let places: Vec<Pose2> = patches.iter().map(|patch| pose_at(patch.stamp_s)).collect();
    let stamped = patches.iter().zip(&places).map(|(patch, &pose)| StampedPose { stamp_s: patch.stamp_s, pose });
    let nothing_new = pairing.pairs.len() - pairs.len();
    Ok(Floor { map: mapper.paint(&patches, &places), images: stamped.collect(), nothing_new, skipped })
}

/// Why the filter does not take a scan, for people.
fn reason_for_refusing(error: &SlamError) -> &'static str {
    match error {
        SlamError::NotFinite { .. } => "scans that are not finite, or to which no finite odometry leads",
    }
}

/// Why an image pair shows no floor, for people.
fn reason_for_skipping(reason: SkipReason) -> &'static str {
    match reason {
        SkipReason::BrokenImage => "images without the pixels they announce",
        SkipReason::UnknownMotion => "images without odometry between them",
        SkipReason::NoDepth => "depth images without a measurement",
        SkipReason::NoFloor => "images without floor in view",
    }
}
