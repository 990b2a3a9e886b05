//! Saves the session and draws the map beside the engine, so that neither makes a scan wait.

use crate::session_keeper::SessionKeeper;
use floorprint::Config;
use floorprint::back_end::{ClosureReport, Verdict};
use floorprint::session::{Renderer, Session};
use floorprint_live::{Board, Engine, Line, Picture};
use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// It looks at the session this often.
const PERIOD: Duration = Duration::from_secs(1);
/// Its work takes no more than about this share of the time.
const LARGEST_SHARE: u32 = 10;
/// Points of a trajectory that are shown: more cannot be told apart.
const MOST_POINTS: usize = 4000;

/// Works on copies of the session that the engine hands out when it is asked to.
pub(super) struct Housekeeper<'a> {
    config: &'a Config,
    board: &'a Board,
    state: Mutex<State>,
    changed: Condvar,
}

/// A session, the one that takes its place, and who is told where the first one went.
struct Ended {
    session: Session,
    next: Session,
    told: SyncSender<Result<Option<PathBuf>, String>>,
}

struct State {
    session: Option<Box<Session>>,
    /// A session that has ended: another one begins.
    ended: Option<Box<Ended>>,
    /// Whether what people say of the map is to be saved.
    is_annotated: bool,
    /// When the next copy is wanted; `None` while one is worked on.
    due: Option<Instant>,
    is_over: bool,
}

impl<'a> Housekeeper<'a> {
    pub(super) fn new(config: &'a Config, board: &'a Board) -> Self {
        let state =
            State { session: None, ended: None, is_annotated: false, due: Some(Instant::now()), is_over: false };
        Self { config, board, state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Takes a copy of the session when one is wanted.
    pub(super) fn look_at(&self, engine: &mut Engine) {
        if self.lock().due.is_none_or(|due| Instant::now() < due) {
            return;
        }
        let Some(session) = engine.session() else { return };
        let session = Box::new(session.clone());
        let mut state = self.lock();
        (state.session, state.due) = (Some(session), None);
        self.changed.notify_all();
    }

    /// Has a session saved and put aside, for another one takes its place; waits until that is done and gives its file's
    /// name, where there is one.
    pub(super) fn set_aside(&self, session: Session, next: Session) -> Result<Option<PathBuf>, String> {
        let (told, wait) = sync_channel(1);
        let mut state = self.lock();
        (state.session, state.ended) = (None, Some(Box::new(Ended { session, next, told })));
        drop(state);
        self.changed.notify_all();
        wait.recv().unwrap_or_else(|_| Err("the session ends".to_owned()))
    }

    /// Has what people say of the map saved.
    pub(super) fn look_at_annotations(&self) {
        self.lock().is_annotated = true;
        self.changed.notify_all();
    }

    /// No copy comes any more.
    pub(super) fn stop(&self) {
        self.lock().is_over = true;
        self.changed.notify_all();
    }

    /// Saves and draws until it is stopped; gives the keeper back.
    pub(super) fn keep(&self, mut keeper: Option<SessionKeeper>) -> Option<SessionKeeper> {
        let mut renderer = Renderer::new(&self.config.map);
        let mut picture = Picture::default();
        // Of the overlay that was saved last.
        let mut annotated = 0;
        loop {
            let mut state = self.lock();
            let is_idle = |state: &State| state.session.is_none() && state.ended.is_none() && !state.is_annotated;
            while is_idle(&state) && !state.is_over {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            if state.is_over {
                let overlay = self.board.overlay();
                if let Some(keeper) = keeper.as_mut().filter(|_| annotated != overlay.revision) {
                    keeper.annotate(&overlay.annotations);
                }
                return keeper;
            }
            let (session, ended) = (state.session.take(), state.ended.take());
            state.is_annotated = false;
            drop(state);
            let started = Instant::now();
            let mut session = session;
            if let Some(ended) = ended {
                let Ended { session: before, next, told } = *ended;
                let aside = keeper.as_mut().map(|keeper| keeper.set_aside(&before, &next, &self.config.matcher));
                let aside = aside.transpose().map(Option::flatten).map_err(|error| format!("{error:#}"));
                if aside.is_ok() {
                    // Its frames are not those that were drawn.
                    renderer = Renderer::new(&self.config.map);
                    session = Some(Box::new(next));
                }
                let _ = told.send(aside);
            }
            let overlay = self.board.overlay();
            if std::mem::replace(&mut annotated, overlay.revision) != overlay.revision
                && let Some(keeper) = &mut keeper
            {
                keeper.annotate(&overlay.annotations);
            }
            if let Some(session) = session {
                if let Some(keeper) = &mut keeper {
                    keeper.observe_session(&session, &self.config.matcher);
                }
                // Who wants an end does not wait for a picture.
                if self.lock().is_over {
                    continue;
                }
                picture = next_picture(&picture, &session, &mut renderer);
                self.board.show_picture(picture.clone());
            }
            self.lock().due = Some(Instant::now() + PERIOD.max(started.elapsed() * LARGEST_SHARE));
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What there is to see of a session, drawn after what was seen of it before.
pub(crate) fn next_picture(before: &Picture, session: &Session, renderer: &mut Renderer) -> Picture {
    let revision = before.revision + 1;
    let poses = session.world_from_bodies();
    let map = before.map.followed_by(session.draw_along(&poses, renderer), revision);
    let at = |frame: usize| poses.get(frame).map(|pose| [pose.x as f32, pose.y as f32]);
    let every = poses.len().div_ceil(MOST_POINTS).max(1);
    let mut trajectory: Line = (0..poses.len()).step_by(every).filter_map(at).collect();
    trajectory.extend(poses.len().checked_sub(1).and_then(at));
    let is_accepted = |closure: &ClosureReport| closure.verdict == Verdict::Accepted;
    let closures = session.places().map(|places| places.reports()).unwrap_or_default();
    let closures = closures.iter().filter(|closure| is_accepted(closure));
    let closures = closures.filter_map(|closure| Some([at(closure.frames[0])?, at(closure.frames[1])?])).collect();
    Picture { revision, map, trajectory, closures }
}
