//! Keeps the session of a run safe while the drive goes on.

use crate::terminal::Terminal;
use floorprint::Slam;
use floorprint::scan_matcher::MatcherConfig;
use floorprint::session::Session;
use floorprint_io::{Layers, SessionFile, WriteError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What was seen is saved this often.
const PERIOD: Duration = Duration::from_secs(1);
/// Saving takes no more than about this share of the time.
const LARGEST_SHARE: u32 = 20;

/// A session's file beside the run's folder, until the run is complete. A run that is over before the first save makes none.
pub(crate) struct SessionKeeper {
    path: PathBuf,
    file: Option<SessionFile>,
    due: Instant,
    terminal: Terminal,
    /// What is noted in the file.
    notes: Vec<(&'static str, String)>,
    /// Whether saving failed: it is not tried again.
    has_failed: bool,
}

impl SessionKeeper {
    /// For a run whose results will be the folder `out`.
    pub(crate) fn beside(out: &Path, terminal: &Terminal, notes: Vec<(&'static str, String)>) -> Self {
        let mut name = out.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".session-{}.gpkg", std::process::id()));
        let path = out.with_file_name(name);
        Self { path, file: None, due: Instant::now() + PERIOD, terminal: terminal.clone(), notes, has_failed: false }
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
        let (path, terminal) = (path.to_path_buf(), terminal.clone());
        Ok(Self { path, file, due: Instant::now() + PERIOD, terminal, notes, has_failed: false })
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
        self.due = Instant::now() + PERIOD.max(started.elapsed() * LARGEST_SHARE);
    }

    /// The same for a live session, whose pictures may not have been drawn (`None`); without a `target` the file stays where
    /// it is.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn finish_live(
        mut self,
        layers: Option<&Layers<'_>>,
        matcher: &MatcherConfig,
        target: Option<&Path>,
    ) -> Result<(), WriteError> {
        let target = target.map_or_else(|| self.path.clone(), Path::to_path_buf);
        if let Some(layers) = layers {
            return self.finish(layers, matcher, &target);
        }
        self.file.take().map_or(Ok(()), |file| file.move_to(&target))
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

    /// Saves the end of the drive with its pictures and moves the file into place.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn finish(
        mut self,
        layers: &Layers<'_>,
        matcher: &MatcherConfig,
        target: &Path,
    ) -> Result<(), WriteError> {
        self.save(layers.session, matcher)?;
        let Some(mut file) = self.file.take() else { return Ok(()) };
        file.draw(layers)?;
        file.move_to(target)
    }
}
