//! From records to poses, one by one as they come: the synchroniser and what works on its frames.

use floorprint::back_end::ClosureLoad;
use floorprint::geometry::Pose2;
use floorprint::localization::{Localizer, Start};
use floorprint::odometry::{OdometryCorrections, OdometryError, SynchronisationSummary, Synchronizer};
use floorprint::sensors::{Record, StampedPose};
use floorprint::session::{Session, SessionError};
use floorprint::storage::{StorageTrouble, Store};
use floorprint::{BodyScan, Config, Frame, Slam, SlamError};
use std::sync::Arc;
use thiserror::Error;

/// Why the engine cannot go on.
#[derive(Debug, Error)]
pub enum EngineError {
    /// No frames can be made of the records.
    #[error(transparent)]
    Odometry(#[from] OdometryError),
    /// The session cannot be gone on with.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// Where a robot is that goes on with a session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Whereabouts {
    /// Where the session ended.
    Last,
    /// Anywhere: it is placed when the evidence suffices.
    Unknown,
    /// Where the session ended, if the drive begins within so many seconds of it; else anywhere.
    LastIfWithin(f64),
    /// Where the session began: it is placed when the evidence suffices, and shown there until then.
    First,
    /// About here, `map_from_body`: as [`First`](Self::First).
    At(Pose2),
}

/// Goes on with a session; the drive's first scan has this stamp, seconds.
///
/// # Errors
/// When the configured filter cannot go on with it.
pub fn resume(
    session: Session,
    whereabouts: Whereabouts,
    first_stamp_s: f64,
    config: &Config,
) -> Result<Slam, SessionError> {
    let pause_s = session.last_pose().map(|last| first_stamp_s - last.stamp_s);
    let first = session.world_from_bodies().first().copied().unwrap_or(Pose2::IDENTITY);
    let mut slam = Slam::resume(session, config)?;
    match whereabouts {
        Whereabouts::Last => {}
        Whereabouts::LastIfWithin(most_s) if pause_s.is_some_and(|pause_s| (0.0..=most_s).contains(&pause_s)) => {}
        Whereabouts::LastIfWithin(_) | Whereabouts::Unknown => slam.interrupt(),
        Whereabouts::First => slam.interrupt_at(&first),
        Whereabouts::At(map_from_body) => slam.interrupt_at(&map_from_body),
    }
    Ok(slam)
}

/// What the frames are for.
enum Work {
    /// A session that is gone on with once the first scan is there.
    Resuming(Box<Session>, Whereabouts),
    Mapping(Box<Slam>),
    Localizing(Box<Localizer>),
}

/// What became of a scan.
#[derive(Debug, Clone)]
pub struct Step {
    /// The scan's stamp, seconds.
    pub stamp_s: f64,
    /// `map_from_body`; `None` as long as a localizer claims none.
    pub pose: Option<Pose2>,
    /// Where the odometry's own frame is in the map: what REP 105 calls map→odom. The last one known where no pose is claimed.
    pub map_from_odom: Pose2,
    /// Over (x, y, θ) in the map's axes, m² and rad².
    pub covariance: [[f64; 3]; 3],
    /// Whether the pose is not to be relied on.
    pub is_lost: bool,
    /// Share of the scan that lies on the map.
    pub inlier_share: f64,
    /// The scan in the body's frame.
    pub scan: Arc<BodyScan>,
    /// Poses that a localizer considers and their probabilities, the most probable first.
    pub modes: Vec<(Pose2, f64)>,
    /// Hypotheses about the drive.
    pub hypotheses: usize,
    /// What closing loops works with.
    pub load: Option<ClosureLoad>,
}

/// Takes records and says where the robot is.
///
/// The same records, configuration and corrections give the same steps and the same map, whenever they come.
pub struct Engine {
    config: Config,
    synchronizer: Synchronizer,
    work: Work,
    map_from_odom: Pose2,
    /// Scans that could not be used: not finite.
    refused: usize,
}

impl Engine {
    /// An engine that makes a new map. `corrections` are what a survey found out beforehand.
    ///
    /// # Errors
    /// When a setting of `[scan]`, `[odometry]` or `[robot]` cannot work.
    pub fn mapping(config: &Config, corrections: Option<&OdometryCorrections>) -> Result<Self, EngineError> {
        Self::new(Work::Mapping(Box::new(Slam::new(config))), config, corrections)
    }

    /// An engine that goes on with a session.
    ///
    /// # Errors
    /// As [`mapping`](Self::mapping); and when the configured filter cannot go on with the session.
    pub fn extending(
        session: Session,
        whereabouts: Whereabouts,
        config: &Config,
        corrections: Option<&OdometryCorrections>,
    ) -> Result<Self, EngineError> {
        Slam::resume(session.clone(), config)?;
        Self::new(Work::Resuming(Box::new(session), whereabouts), config, corrections)
    }

    /// An engine that follows the robot in a finished map.
    ///
    /// # Errors
    /// As [`mapping`](Self::mapping).
    pub fn localizing(
        localizer: Localizer,
        config: &Config,
        corrections: Option<&OdometryCorrections>,
    ) -> Result<Self, EngineError> {
        Self::new(Work::Localizing(Box::new(localizer)), config, corrections)
    }

    fn new(work: Work, config: &Config, corrections: Option<&OdometryCorrections>) -> Result<Self, EngineError> {
        let synchronizer = Synchronizer::new(config, corrections)?;
        Ok(Self { config: config.clone(), synchronizer, work, map_from_odom: Pose2::IDENTITY, refused: 0 })
    }

    /// Takes in a record; a step for each scan that is ready now.
    ///
    /// # Errors
    /// The record is the first that needs a calibration that is not there.
    pub fn push(&mut self, record: Record) -> Result<Vec<Step>, EngineError> {
        let frames = self.synchronizer.push(record)?;
        self.process(frames)
    }

    /// The steps of the scans that still wait; no record comes any more.
    ///
    /// # Errors
    /// As [`push`](Self::push); and when the odometry that was asked for never came.
    pub fn flush(&mut self) -> Result<Vec<Step>, EngineError> {
        let frames = self.synchronizer.finish()?;
        self.process(frames)
    }

    /// Somebody says where the robot is. A localizer begins anew there; false where a map is made, whose poses follow from
    /// the drive.
    pub fn set_start(&mut self, start: Start) -> bool {
        let Work::Localizing(localizer) = &mut self.work else { return false };
        **localizer = localizer.restarted(start, &self.config);
        true
    }

    /// Puts another session in the place of the one that there is, such as a part of it; the drive goes on at its end. Memory is
    /// bounded no more, see [`limit_memory`](Self::limit_memory). Nothing changes of a localizer.
    ///
    /// # Errors
    /// When the configured filter cannot go on with it; everything is as it was then.
    pub fn replace_session(&mut self, session: Session) -> Result<(), SessionError> {
        match &mut self.work {
            Work::Mapping(slam) => **slam = Slam::resume(session, &self.config)?,
            Work::Resuming(resuming, _) => **resuming = session,
            Work::Localizing(_) => {}
        }
        Ok(())
    }

    /// The newest pose of the robot's odometry, `odom_from_body`, where it states poses.
    #[must_use]
    pub fn odometry(&self) -> Option<StampedPose> {
        let path = self.synchronizer.dead_reckoning();
        let [_, stamp_s] = path.span_s()?;
        Some(StampedPose { stamp_s, pose: path.pose_at(stamp_s) })
    }

    /// All that outlives a step, as of now; `None` of a localizer, and before the first scan.
    #[must_use]
    pub fn session(&mut self) -> Option<&Session> {
        match &mut self.work {
            Work::Mapping(slam) => Some(slam.session()),
            Work::Resuming(session, _) => Some(session),
            Work::Localizing(_) => None,
        }
    }

    /// From now on at most about so many bytes of the map-maker's settled parts lie in memory, and the others in a store; see
    /// [`Session::limit_memory`]. Nothing changes of a localizer.
    pub fn limit_memory(&mut self, store: Box<dyn Store>, most_bytes: usize) {
        match &mut self.work {
            Work::Mapping(slam) => slam.limit_memory(store, most_bytes),
            Work::Resuming(session, _) => session.limit_memory(store, most_bytes),
            Work::Localizing(_) => {}
        }
    }

    /// What is wrong with that store, if anything is.
    #[must_use]
    pub fn storage_trouble(&self) -> Option<StorageTrouble> {
        match &self.work {
            Work::Mapping(slam) => slam.storage_trouble(),
            Work::Resuming(session, _) => session.storage_trouble(),
            Work::Localizing(_) => None,
        }
    }

    /// What was used, dropped and noticed so far.
    #[must_use]
    pub fn summary(&self) -> SynchronisationSummary {
        self.synchronizer.summary()
    }

    /// Scans that could not be used because a number in them or in the odometry to them was not finite.
    #[must_use]
    pub fn refused(&self) -> usize {
        self.refused
    }

    /// The map-maker, for the end of the drive; `None` of a localizer.
    ///
    /// # Errors
    /// No scan came, and the session cannot be gone on with.
    pub fn into_slam(self) -> Result<Option<Slam>, EngineError> {
        match self.work {
            Work::Mapping(slam) => Ok(Some(*slam)),
            Work::Resuming(session, _) => Ok(Some(Slam::resume(*session, &self.config)?)),
            Work::Localizing(_) => Ok(None),
        }
    }

    fn process(&mut self, frames: Vec<Frame>) -> Result<Vec<Step>, EngineError> {
        let mut steps = Vec::with_capacity(frames.len());
        for mut frame in frames {
            if let Work::Resuming(session, whereabouts) = &self.work {
                let slam = resume(Session::clone(session), *whereabouts, frame.stamp_s, &self.config)?;
                self.work = Work::Mapping(Box::new(slam));
                // Nothing measured the motion between the two drives.
                frame.motion = None;
            }
            match self.step(frame) {
                Ok(step) => steps.push(step),
                Err(_) => self.refused += 1,
            }
        }
        Ok(steps)
    }

    fn step(&mut self, frame: Frame) -> Result<Step, SlamError> {
        let odom_from_body = self.synchronizer.origin().compose(&frame.dead_reckoning);
        let mut step = Step {
            stamp_s: frame.stamp_s,
            pose: None,
            map_from_odom: self.map_from_odom,
            covariance: [[0.0; 3]; 3],
            is_lost: true,
            inlier_share: 0.0,
            scan: Arc::default(),
            modes: Vec::new(),
            hypotheses: 0,
            load: None,
        };
        match &mut self.work {
            Work::Resuming(..) => {}
            Work::Mapping(slam) => {
                let report = slam.process(&frame)?;
                let sigmas =
                    report.uncertainty.map_or([0.0; 2], |uncertainty| [uncertainty.sigma_m, uncertainty.sigma_rad]);
                let [xy, theta] = sigmas.map(|sigma| sigma * sigma);
                step.pose = Some(report.pose);
                step.covariance = [[xy, 0.0, 0.0], [0.0, xy, 0.0], [0.0, 0.0, theta]];
                step.is_lost = report.is_lost;
                step.inlier_share = report.filter.inlier_share;
                step.load = slam.closure_load();
                step.hypotheses = slam.hypotheses();
            }
            Work::Localizing(localizer) => {
                let report = localizer.process(&frame)?;
                step.pose = report.pose;
                let row = |row: usize| [0, 1, 2].map(|column| report.covariance[(row, column)]);
                step.covariance = [row(0), row(1), row(2)];
                step.is_lost = report.pose.is_none();
                step.inlier_share = report.explained.on_map;
                step.modes = report.modes.iter().map(|mode| (mode.pose, mode.weight)).collect();
                step.hypotheses = step.modes.len();
            }
        }
        if let Some(pose) = step.pose {
            self.map_from_odom = pose.compose(&odom_from_body.inverse());
        }
        step.map_from_odom = self.map_from_odom;
        step.scan = Arc::new(frame.scan);
        Ok(step)
    }
}
