//! What a viewer is told: events with what is new, never faster than it takes them.

use crate::board::{Board, Mode, Overlay, Picture, Situation};
use bytes::Bytes;
use floorprint::map::Change;
use hyper::body::{Body, Frame};
use serde_json::{Value, json};
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, mpsc, watch};
use tokio::time::{sleep, timeout};

/// Viewers are told what is new this often at most.
const PACE: Duration = Duration::from_millis(100);
/// A viewer that hears nothing for so long could not tell that from a lost connection.
const SIGN_OF_LIFE: Duration = Duration::from_secs(10);
/// A viewer that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(30);
/// Points of a scan that are shown at most.
const MOST_POINTS: usize = 720;
/// Poses of a localizer that are shown at most.
const MOST_MODES: usize = 32;

/// Events for one viewer, as the body of a response.
pub(super) struct Feed(mpsc::Receiver<Bytes>);

impl Body for Feed {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.0.poll_recv(context).map(|event| event.map(|event| Ok(Frame::data(event))))
    }
}

impl Feed {
    /// Begins to tell a viewer what happens on the board.
    pub(super) fn new(board: &Arc<Board>, permit: OwnedSemaphorePermit) -> Self {
        // One event waits; what would wait behind it is told newer.
        let (events, receiver) = mpsc::channel(1);
        let (situation, picture) = board.watch();
        let teller = Teller { board: Arc::clone(board), events, shown: 0, _permit: permit };
        tokio::spawn(teller.tell(situation, picture, board.watch_overlay()));
        Self(receiver)
    }
}

struct Teller {
    board: Arc<Board>,
    events: mpsc::Sender<Bytes>,
    /// Revision of the picture that was told last.
    shown: u64,
    _permit: OwnedSemaphorePermit,
}

impl Teller {
    async fn tell(
        mut self,
        mut situation: watch::Receiver<Arc<Situation>>,
        mut picture: watch::Receiver<Arc<Picture>>,
        mut overlay: watch::Receiver<Arc<Overlay>>,
    ) {
        situation.mark_changed();
        picture.mark_changed();
        overlay.mark_changed();
        loop {
            let event = tokio::select! {
                changed = picture.changed() => match changed {
                    Ok(()) => {
                        let newest = picture.borrow_and_update().clone();
                        self.of_picture(&newest)
                    }
                    Err(_) => return,
                },
                changed = situation.changed() => match changed {
                    Ok(()) => {
                        let newest = situation.borrow_and_update().clone();
                        self.of_situation(&newest)
                    }
                    Err(_) => return,
                },
                changed = overlay.changed() => match changed {
                    Ok(()) => {
                        let newest = overlay.borrow_and_update().clone();
                        self.of_overlay(&newest)
                    }
                    Err(_) => return,
                },
                () = sleep(SIGN_OF_LIFE) => Bytes::from_static(b": still here\n\n"),
            };
            if !matches!(timeout(PATIENCE, self.events.send(event)).await, Ok(Ok(()))) {
                return;
            }
            sleep(PACE).await;
        }
    }

    fn of_picture(&mut self, picture: &Picture) -> Bytes {
        let since = std::mem::replace(&mut self.shown, picture.revision);
        let new = picture.map.changed.iter().filter(|(_, revision)| **revision > since);
        let tiles: Vec<Value> = new.map(|((column, row), revision)| json!([column, row, revision])).collect();
        event(
            "picture",
            &json!({
                "name": self.board.name,
                "mode": mode(self.board.mode),
                "resolution": picture.map.resolution_m(),
                "origin": picture.map.origin_m(),
                "tiles": tiles,
                "trajectory": picture.trajectory.iter().flat_map(|point| centimetres(*point)).collect::<Vec<_>>(),
                "closures": picture.closures.iter().map(|ends| [centimetres(ends[0]), centimetres(ends[1])].concat()).collect::<Vec<_>>(),
            }),
        )
    }

    fn of_overlay(&self, overlay: &Overlay) -> Bytes {
        let annotations = &overlay.annotations;
        let changes = overlay.changes.iter().map(
            |patch| json!({"isNew": patch.change == Change::New, "area": patch.area_m2, "outlines": patch.outlines_m}),
        );
        event(
            "overlay",
            &json!({
                "revision": overlay.revision,
                "isEditable": self.board.is_editable,
                "places": annotations.places(),
                "keepOut": annotations.keep_out().iter().map(|area| area.corners_m()).collect::<Vec<_>>(),
                "changes": changes.collect::<Vec<_>>(),
            }),
        )
    }

    fn of_situation(&self, situation: &Situation) -> Bytes {
        let counts = situation.counts;
        let mut all = json!({
            "mode": mode(self.board.mode),
            "paused": self.board.inbox.is_paused(),
            "records": counts.records,
            "scans": counts.steps,
            "lost": counts.lost,
            "refused": counts.refused,
            "delay": situation.delays.newest_ms,
        });
        if let (Some(step), Some(all)) = (&situation.step, all.as_object_mut()) {
            let [sigma_m, sigma_rad] =
                [step.covariance[0][0].max(step.covariance[1][1]), step.covariance[2][2]].map(f64::sqrt);
            let every = step.scan.hits.len().div_ceil(MOST_POINTS).max(1);
            let scan: Vec<i32> = step.scan.hits.iter().step_by(every).flat_map(centimetres).collect();
            all.insert("stamp".to_owned(), json!(step.stamp_s));
            all.insert("pose".to_owned(), json!(step.pose.map(|pose| [pose.x, pose.y, pose.theta])));
            all.insert("sigma".to_owned(), json!([sigma_m, sigma_rad]));
            all.insert("isLost".to_owned(), json!(step.is_lost));
            all.insert("fits".to_owned(), json!(step.inlier_share));
            all.insert("hypotheses".to_owned(), json!(step.hypotheses));
            all.insert("submaps".to_owned(), json!(step.load.map(|load| load.submaps)));
            all.insert("scan".to_owned(), json!(scan));
            let modes = step.modes.iter().take(MOST_MODES);
            let modes: Vec<_> = modes.map(|(pose, weight)| json!([pose.x, pose.y, pose.theta, weight])).collect();
            all.insert("modes".to_owned(), json!(modes));
        }
        event("situation", &all)
    }
}

fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Mapping => "mapping",
        Mode::Localization => "localization",
        Mode::Viewing => "viewing",
    }
}

fn centimetres(point_m: [f32; 2]) -> [i32; 2] {
    point_m.map(|coordinate| (100.0 * coordinate).round() as i32)
}

/// An event of the kind that browsers take apart themselves.
fn event(name: &str, data: &Value) -> Bytes {
    format!("event: {name}\ndata: {data}\n\n").into()
}
