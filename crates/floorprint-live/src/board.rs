//! What everybody may see of a live session: the newest step, and the picture of map and trajectory.

use crate::delays::DelaySummary;
use crate::engine::Step;
use crate::inbox::{Inbox, Lost};
use crate::map_picture::MapPicture;
use floorprint::geometry::Pose2;
use floorprint::map::ChangedPatch;
use floorprint_io::Annotations;
use std::sync::Arc;
use tokio::sync::watch;

/// What a session does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A map is made, or gone on with.
    Mapping,
    /// The robot is followed in a finished map.
    Localization,
    /// A finished session is shown.
    Viewing,
}

/// The newest of all that changes with each scan.
#[derive(Debug, Clone, Default)]
pub struct Situation {
    /// What became of the newest scan; `None` before the first.
    pub step: Option<Arc<Step>>,
    /// The newest pose of the odometry, `odom_from_body`, with its stamp (seconds).
    pub odometry: Option<(f64, Pose2)>,
    /// What time it is by the sensors, seconds; `None` before anything came.
    pub now_s: Option<f64>,
    /// What is counted.
    pub counts: Counts,
    /// How long scans take to their pose.
    pub delays: DelaySummary,
}

impl Situation {
    /// What time it is by the sensors, seconds: no earlier than the newest scan's stamp, where a clock was not set since.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        let step_s = self.step.as_ref().map_or(0.0, |step| step.stamp_s);
        self.now_s.unwrap_or(step_s)
    }
}

/// What is counted in a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Records that the engine took.
    pub records: usize,
    /// Scans that became steps.
    pub steps: usize,
    /// Lost before the engine.
    pub lost: Lost,
    /// Scans that the filter refused.
    pub refused: usize,
}

/// A line over the map, metres.
pub type Line = Vec<[f32; 2]>;

/// What changes more slowly, and costs more: map and trajectory.
#[derive(Debug, Clone, Default)]
pub struct Picture {
    /// Counts the pictures.
    pub revision: u64,
    /// The map.
    pub map: MapPicture,
    /// Where the body was.
    pub trajectory: Line,
    /// Places that were found to be the same: from where to where.
    pub closures: Vec<[[f32; 2]; 2]>,
}

/// What lies over the map: what people say of it, and how it differs from an earlier one.
#[derive(Debug, Clone, Default)]
pub struct Overlay {
    /// Counts its states: who changes it says from which one.
    pub revision: u64,
    /// Names of places and keep-out areas.
    pub annotations: Annotations,
    /// What is new and what is gone since the map that it is compared with.
    pub changes: Vec<ChangedPatch>,
}

/// A board that one thread writes and any number look at: each sees the newest, whenever it looks.
#[derive(Debug)]
pub struct Board {
    /// What the session does.
    pub mode: Mode,
    /// Of what the map is.
    pub name: String,
    /// Where commands go.
    pub inbox: Arc<Inbox>,
    /// Whether viewers may change the map and what is said of it.
    pub is_editable: bool,
    situation: watch::Sender<Arc<Situation>>,
    picture: watch::Sender<Arc<Picture>>,
    overlay: watch::Sender<Arc<Overlay>>,
}

impl Board {
    /// Nothing on it yet.
    #[must_use]
    pub fn new(mode: Mode, name: &str, inbox: Arc<Inbox>) -> Self {
        Self {
            mode,
            name: name.to_owned(),
            inbox,
            is_editable: mode == Mode::Mapping,
            situation: watch::Sender::default(),
            picture: watch::Sender::default(),
            overlay: watch::Sender::default(),
        }
    }

    /// Shows what is new.
    pub fn show(&self, situation: Situation) {
        self.situation.send_replace(Arc::new(situation));
    }

    /// Shows a new picture.
    pub fn show_picture(&self, picture: Picture) {
        self.picture.send_replace(Arc::new(picture));
    }

    /// Shows other annotations.
    pub fn annotate(&self, annotations: Annotations) {
        let before = self.overlay();
        self.overlay.send_replace(Arc::new(Overlay {
            revision: before.revision + 1,
            annotations,
            changes: before.changes.clone(),
        }));
    }

    /// Shows how the map differs from an earlier one.
    pub fn show_changes(&self, changes: Vec<ChangedPatch>) {
        let before = self.overlay();
        let annotations = before.annotations.clone();
        self.overlay.send_replace(Arc::new(Overlay { revision: before.revision + 1, annotations, changes }));
    }

    /// The newest situation.
    #[must_use]
    pub fn situation(&self) -> Arc<Situation> {
        self.situation.borrow().clone()
    }

    /// The newest picture.
    #[must_use]
    pub fn picture(&self) -> Arc<Picture> {
        self.picture.borrow().clone()
    }

    /// What lies over the map.
    #[must_use]
    pub fn overlay(&self) -> Arc<Overlay> {
        self.overlay.borrow().clone()
    }

    /// To wait for what lies over the map.
    #[must_use]
    pub fn watch_overlay(&self) -> watch::Receiver<Arc<Overlay>> {
        self.overlay.subscribe()
    }

    /// To wait for what is new.
    #[must_use]
    pub fn watch(&self) -> (watch::Receiver<Arc<Situation>>, watch::Receiver<Arc<Picture>>) {
        (self.situation.subscribe(), self.picture.subscribe())
    }
}
