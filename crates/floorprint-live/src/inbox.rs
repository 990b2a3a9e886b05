//! What waits for the engine: a bounded queue in which scans may be lost, oldest first, and nothing else.

use floorprint::geometry::Pose2;
use floorprint::localization::Start;
use floorprint::sensors::Record;
use floorprint::session::Region;
use floorprint_io::Annotations;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use thiserror::Error;

/// So many scans may wait. An engine that keeps up has one; the rest bridges a pause of the machine (0.4 s at 40 Hz).
const MOST_SCANS: usize = 16;
/// So many other readings may wait: a second of the fastest IMU.
const MOST_READINGS: usize = 4096;

/// So many changes may wait.
const MOST_CHANGES: usize = 8;
/// What is asked for (saving or changing a session) takes no longer than this.
const LONGEST_WORK: Duration = Duration::from_secs(30);

/// Something for the engine.
#[derive(Debug)]
pub enum Event {
    /// A sensor's message, and when it came.
    Record(Record, Instant),
    /// Somebody says where the robot is; only a localizer listens.
    Start(Start),
    /// Somebody wants the session in a file, and is told whether it is there.
    Save(PathBuf, SyncSender<bool>),
    /// Somebody wants the session to be another one, and is told when it is, or why it is not.
    Change(Change, SyncSender<Result<(), Refusal>>),
    /// Nothing came for as long as was to be waited.
    Nothing,
}

/// What may be wanted of a session while it goes on.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// To begin anew. What there is of a session is set aside.
    Reset,
    /// To go on with the map of a file, where the robot is said to be; `None` is where that map began. What there is of a
    /// session is set aside.
    Load(PathBuf, Option<Pose2>),
    /// To hold nothing but what was seen of a region. What there was of the session is set aside.
    Restrict(Region),
    /// That places and keep-out areas are these. The number is the [`Overlay`](crate::Overlay)'s that they were made from.
    Annotate(u64, Annotations),
}

/// Why something that was asked for is not done.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It makes no sense in this mode.
    #[error("{0}")]
    Mode(&'static str),
    /// Somebody else was faster.
    #[error("somebody else changed it meanwhile")]
    Stale,
    /// The file that is named cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// It was tried.
    #[error("{0}")]
    Failed(String),
}

/// What was lost because the engine did not keep up, or was not wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Lost {
    /// Scans that newer ones pushed out.
    pub scans: usize,
    /// Other readings that newer ones pushed out.
    pub readings: usize,
    /// Scans that came while measurements were paused.
    pub paused: usize,
}

/// The queue between sources and the engine.
#[derive(Debug, Default)]
pub struct Inbox {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Event>,
    scans: usize,
    lost: Lost,
    is_paused: bool,
    is_closed: bool,
}

impl State {
    fn is_full(&self) -> bool {
        self.scans >= MOST_SCANS || self.waiting.len() - self.scans >= MOST_READINGS
    }

    fn push(&mut self, event: Event) {
        self.scans += usize::from(is_scan(&event));
        self.waiting.push_back(event);
    }

    /// Takes out the oldest scan, or the oldest of the rest.
    fn drop_oldest(&mut self, scans: bool) {
        let Some(oldest) = self.waiting.iter().position(|event| is_scan(event) == scans) else { return };
        self.waiting.remove(oldest);
        if scans {
            self.scans -= 1;
            self.lost.scans += 1;
        } else {
            self.lost.readings += 1;
        }
    }
}

fn is_scan(event: &Event) -> bool {
    matches!(event, Event::Record(Record::Scan(_), _))
}

impl Inbox {
    /// An empty queue.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Puts in what a sensor just delivered. Never waits: where there is no room the oldest of its kind is lost.
    pub fn offer(&self, record: Record) {
        let mut state = self.lock();
        if state.is_closed || skipped(&mut state, &record) {
            return;
        }
        let event = Event::Record(record, Instant::now());
        if is_scan(&event) && state.scans >= MOST_SCANS {
            state.drop_oldest(true);
        } else if !is_scan(&event) && state.waiting.len() - state.scans >= MOST_READINGS {
            state.drop_oldest(false);
        }
        state.push(event);
        self.changed.notify_all();
    }

    /// Puts in a record of a source that can wait, once there is room; false when nobody takes it any more.
    pub fn send(&self, record: Record) -> bool {
        let mut state = self.lock();
        while state.is_full() && !state.is_closed {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if !state.is_closed && !skipped(&mut state, &record) {
            state.push(Event::Record(record, Instant::now()));
            self.changed.notify_all();
        }
        !state.is_closed
    }

    /// Says where the robot is, in place of what was said before and not heard yet.
    pub fn set_start(&self, start: Start) {
        let mut state = self.lock();
        state.waiting.retain(|event| !matches!(event, Event::Start(_)));
        state.push(Event::Start(start));
        self.changed.notify_all();
    }

    /// Has the session saved, and waits until it is; tells whether that worked.
    pub fn save_session(&self, path: PathBuf) -> bool {
        let (done, wait) = sync_channel(1);
        let mut state = self.lock();
        state.push(Event::Save(path, done));
        drop(state);
        self.changed.notify_all();
        wait.recv_timeout(LONGEST_WORK).unwrap_or(false)
    }

    /// Has the session changed, and waits until it is.
    ///
    /// # Errors
    /// Why it is not.
    pub fn change(&self, change: Change) -> Result<(), Refusal> {
        let (done, wait) = sync_channel(1);
        let mut state = self.lock();
        if state.is_closed
            || state.waiting.iter().filter(|event| matches!(event, Event::Change(..))).count() >= MOST_CHANGES
        {
            return Err(Refusal::Failed("too much is asked for at once".to_owned()));
        }
        state.push(Event::Change(change, done));
        drop(state);
        self.changed.notify_all();
        wait.recv_timeout(LONGEST_WORK).unwrap_or_else(|_| Err(Refusal::Failed("nobody answers".to_owned())))
    }

    /// Whether scans are left out until further notice.
    pub fn pause(&self, is_paused: bool) {
        self.lock().is_paused = is_paused;
    }

    /// Whether scans are left out.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.lock().is_paused
    }

    /// What was lost so far.
    #[must_use]
    pub fn lost(&self) -> Lost {
        self.lock().lost
    }

    /// No record comes any more; what waits is still given out.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }

    /// The next event, as soon as there is one, or [`Event::Nothing`] after `patience`; `None` when the queue is closed and
    /// empty.
    pub fn next(&self, patience: Duration) -> Option<Event> {
        let end = Instant::now() + patience;
        let mut state = self.lock();
        loop {
            if let Some(event) = state.waiting.pop_front() {
                state.scans -= usize::from(is_scan(&event));
                self.changed.notify_all();
                return Some(event);
            }
            if state.is_closed {
                return None;
            }
            let Some(left) = end.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) else {
                return Some(Event::Nothing);
            };
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// A thread that panicked left nothing half done here.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether a record is left out because measurements are paused.
fn skipped(state: &mut State, record: &Record) -> bool {
    let is_skipped = state.is_paused && matches!(record, Record::Scan(_));
    state.lost.paused += usize::from(is_skipped);
    is_skipped
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::SensorId;
    use floorprint::geometry::Pose2;
    use floorprint::sensors::{Scan, ScanGeometry, StampedPose};
    use std::sync::Arc;
    use std::thread;

    const PATIENCE: Duration = Duration::from_secs(60);

    fn scan(stamp_s: f64) -> Record {
        let geometry = Arc::new(ScanGeometry {
            angles_rad: vec![0.0],
            time_offsets_s: vec![0.0],
            range_min_m: 0.1,
            range_max_m: 10.0,
            below_minimum_is_no_return: false,
        });
        Record::Scan(Scan { sensor: SensorId::default(), stamp_s, ranges_m: vec![1.0], geometry, odometry: None })
    }

    fn pose(stamp_s: f64) -> Record {
        Record::Odometry(StampedPose { stamp_s, pose: Pose2::IDENTITY })
    }

    fn stamps(inbox: &Inbox) -> Vec<f64> {
        inbox.close();
        std::iter::from_fn(|| inbox.next(PATIENCE))
            .filter_map(|event| match event {
                Event::Record(record, _) => Some(record.stamp_s()),
                Event::Start(_) | Event::Save(..) | Event::Change(..) | Event::Nothing => None,
            })
            .collect()
    }

    #[test]
    fn old_scans_are_lost_and_no_odometry() {
        let inbox = Inbox::new();
        for step in 0..40 {
            inbox.offer(scan(f64::from(step)));
            inbox.offer(pose(f64::from(step) + 0.5));
        }
        assert_eq!(inbox.lost(), Lost { scans: 24, ..Lost::default() });
        let stamps = stamps(&inbox);
        assert_eq!(stamps.iter().filter(|stamp_s| stamp_s.fract() == 0.5).count(), 40);
        assert_eq!(stamps.iter().find(|stamp_s| stamp_s.fract() == 0.0), Some(&24.0));
    }

    #[test]
    fn only_the_last_start_counts() {
        let inbox = Inbox::new();
        (0..1000).for_each(|_| inbox.set_start(Start::Unknown));
        inbox.set_start(Start::At(Pose2::IDENTITY));
        inbox.close();
        let events: Vec<Event> = std::iter::from_fn(|| inbox.next(PATIENCE)).collect();
        assert!(matches!(events[..], [Event::Start(Start::At(_))]), "{events:?}");
    }

    #[test]
    fn a_source_that_can_wait_loses_nothing() {
        let inbox = Inbox::new();
        let taken = thread::scope(|scope| {
            let taker = scope.spawn(|| {
                let mut taken = 0;
                while inbox.next(PATIENCE).is_some() {
                    taken += 1;
                    thread::sleep(Duration::from_micros(50));
                }
                taken
            });
            (0..200).for_each(|step| assert!(inbox.send(scan(f64::from(step)))));
            inbox.close();
            taker.join().unwrap()
        });
        assert_eq!((taken, inbox.lost()), (200, Lost::default()));
        assert!(!inbox.send(scan(0.0)));
    }

    #[test]
    fn who_wants_the_session_saved_is_told_whether_it_is() {
        let inbox = Inbox::new();
        thread::scope(|scope| {
            let asking = scope.spawn(|| inbox.save_session(PathBuf::from("site.gpkg")));
            let Some(Event::Save(path, done)) = inbox.next(PATIENCE) else { panic!("nothing was asked for") };
            assert_eq!(path, PathBuf::from("site.gpkg"));
            done.send(true).unwrap();
            assert!(asking.join().unwrap());
        });
        assert!(matches!(inbox.next(Duration::from_millis(1)), Some(Event::Nothing)));
    }

    #[test]
    fn while_measurements_are_paused_odometry_goes_on() {
        let inbox = Inbox::new();
        inbox.pause(true);
        inbox.offer(scan(1.0));
        inbox.offer(pose(2.0));
        assert_eq!(inbox.lost().paused, 1);
        assert_eq!(stamps(&inbox), [2.0]);
    }
}
