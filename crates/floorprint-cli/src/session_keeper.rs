//! Keeps the session of a run safe while the drive goes on.

use crate::terminal::Terminal;
use floorprint::Slam;
use floorprint::scan_matcher::MatcherConfig;
use floorprint::session::Session;
use floorprint_io::{Layers, SessionFile, WriteError, copy_file};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What was seen is saved this often, unless the user says otherwise.
pub(crate) const PERIOD: Duration = Duration::from_secs(1);
/// Saving takes no more than about this share of the time.
const LARGEST_SHARE: u32 = 20;

/// A session's file beside the run's folder, until the run is complete. A run that is over before the first save makes none.
pub(crate) struct SessionKeeper {
    path: PathBuf,
    /// Whether the file is the user's own, and stays.
    is_in_place: bool,
    file: Option<SessionFile>,
    period: Duration,
    due: Instant,
    terminal: Terminal,
    /// What is noted in the file.
    notes: Vec<(&'static str, String)>,
    /// Whether saving failed: it is not tried again.
    has_failed: bool,
}

impl SessionKeeper {
    /// For a run whose results will be the folder `out`, which no other process fills meanwhile. Sessions of runs that were
    /// stopped stay, and are told.
    pub(crate) fn beside(out: &Path, terminal: &Terminal, notes: Vec<(&'static str, String)>) -> Self {
        let mut number = 1_u64;
        let path = loop {
            let mut name = out.file_name().unwrap_or_default().to_os_string();
            name.push(format!(".session-{number}.gpkg"));
            let path = out.with_file_name(name);
            if fs::symlink_metadata(&path).is_err() {
                break path;
            }
            terminal.note(&format!("{}: what a run saw that was stopped; --continue goes on from it", path.display()));
            number += 1;
        };
        Self::new(path, None, terminal, notes)
    }

    /// For a session that is kept up to date where it lies: a new file, or one that is gone on with.
    ///
    /// # Errors
    /// The file is there, and is no session.
    pub(crate) fn in_place(
        path: &Path,
        terminal: &Terminal,
        notes: Vec<(&'static str, String)>,
    ) -> anyhow::Result<Self> {
        let file = if path.exists() { Some(SessionFile::open(path)?) } else { None };
        let mut keeper = Self::new(path.to_path_buf(), file, terminal, notes);
        keeper.is_in_place = true;
        Ok(keeper)
    }

    fn new(path: PathBuf, file: Option<SessionFile>, terminal: &Terminal, notes: Vec<(&'static str, String)>) -> Self {
        let (due, terminal) = (Instant::now() + PERIOD, terminal.clone());
        Self { path, is_in_place: false, file, period: PERIOD, due, terminal, notes, has_failed: false }
    }

    /// The same, saving this often.
    pub(crate) fn every(mut self, period: Duration) -> Self {
        (self.period, self.due) = (period, Instant::now() + period);
        self
    }

    /// Saves when it is time to.
    pub(crate) fn observe(&mut self, slam: &mut Slam, matcher: &MatcherConfig) {
        if !self.has_failed && Instant::now() >= self.due {
            self.observe_session(slam.session(), matcher);
        }
    }

    /// Saves a session when it is time to.
    pub(crate) fn observe_session(&mut self, session: &Session, matcher: &MatcherConfig) {
        if !self.has_failed && Instant::now() >= self.due {
            self.save_now(session, matcher);
        }
    }

    /// Saves a session at once; tells, and does not try again, when that fails.
    pub(crate) fn save_now(&mut self, session: &Session, matcher: &MatcherConfig) {
        if session.frames() == 0 {
            return;
        }
        let started = Instant::now();
        let is_first = self.file.is_none();
        match self.save(session, matcher) {
            Ok(()) if is_first => {
                self.terminal.note(&format!("what was seen so far is kept in {} until the end", self.path.display()));
            }
            Ok(()) => {}
            Err(error) => {
                self.has_failed = true;
                self.terminal.warn(&format!("the session cannot be kept while the drive goes on: {error}"));
            }
        }
        self.due = Instant::now() + self.period.max(started.elapsed() * LARGEST_SHARE);
    }

    /// The same as [`finish`](Self::finish) for a live session, whose pictures may not have been drawn (`None`).
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn finish_live(
        &mut self,
        layers: Option<&Layers<'_>>,
        matcher: &MatcherConfig,
        copy: Option<&Path>,
    ) -> Result<(), WriteError> {
        if let Some(layers) = layers {
            return self.finish(layers, matcher, copy);
        }
        self.close(copy)
    }

    /// Saves the end of the drive with its pictures. The file stays where it is, and is in `copy`, too: a folder that is not
    /// in place yet may come to nothing.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn finish(
        &mut self,
        layers: &Layers<'_>,
        matcher: &MatcherConfig,
        copy: Option<&Path>,
    ) -> Result<(), WriteError> {
        self.save(layers.session, matcher)?;
        if let Some(file) = &mut self.file {
            file.draw(layers)?;
        }
        self.close(copy)
    }

    fn close(&mut self, copy: Option<&Path>) -> Result<(), WriteError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let path = file.close()?;
        let Some(copy) = copy else { return Ok(()) };
        // A second name needs no room, but what is gone on with needs a file of its own.
        if !self.is_in_place && fs::hard_link(&path, copy).is_ok() {
            return Ok(());
        }
        copy_file(&path, copy)
    }

    /// Takes the file away, unless it is the user's own, now that the folder with the copy of it is in place.
    pub(crate) fn remove(self) {
        if !self.is_in_place {
            let _ = fs::remove_file(&self.path);
        }
    }

    fn save(&mut self, session: &Session, matcher: &MatcherConfig) -> Result<(), WriteError> {
        let file = match self.file.take() {
            Some(file) => file,
            None => {
                let file = SessionFile::create(&self.path)?;
                self.notes.iter().try_for_each(|(key, value)| file.note(key, value))?;
                file
            }
        };
        self.file.insert(file).save(session, matcher)
    }
}

impl Drop for SessionKeeper {
    /// Says where the session is of a run that came to nothing.
    fn drop(&mut self) {
        if !self.is_in_place && self.path.exists() {
            self.terminal
                .warn(&format!("what was seen is kept in {}; --continue goes on from it", self.path.display()));
        }
    }
}
