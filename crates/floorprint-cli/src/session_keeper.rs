//! Keeps the session of a run safe while the drive goes on.

use crate::terminal::Terminal;
use anyhow::Context as _;
use floorprint::Slam;
use floorprint::scan_matcher::MatcherConfig;
use floorprint::session::Session;
use floorprint_io::{ANNOTATIONS, Annotations, Layers, SessionFile, WriteError, copy_file};
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
    /// What sessions are called that are set aside, but for a number.
    aside: PathBuf,
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
        let mut aside = out.file_name().unwrap_or_default().to_os_string();
        aside.push(".gpkg");
        Self::new(path, out.with_file_name(aside), None, terminal, notes)
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
        let mut keeper = Self::new(path.to_path_buf(), path.to_path_buf(), file, terminal, notes);
        keeper.is_in_place = true;
        Ok(keeper)
    }

    fn new(
        path: PathBuf,
        aside: PathBuf,
        file: Option<SessionFile>,
        terminal: &Terminal,
        notes: Vec<(&'static str, String)>,
    ) -> Self {
        let (due, terminal) = (Instant::now() + PERIOD, terminal.clone());
        Self { path, is_in_place: false, aside, file, period: PERIOD, due, terminal, notes, has_failed: false }
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

    /// Saves a session and puts its file beside, under a name with a number, where it is left alone from now on: `next`
    /// takes its place, at once where something was seen in it. Gives its name; `None` where nothing was seen.
    ///
    /// # Errors
    /// One of them cannot be written; the earlier one is kept on with then.
    pub(crate) fn set_aside(
        &mut self,
        session: &Session,
        next: &Session,
        matcher: &MatcherConfig,
    ) -> anyhow::Result<Option<PathBuf>> {
        if session.frames() == 0 {
            return Ok(None);
        }
        self.save(session, matcher)?;
        let replaced = self.replace_with(next, matcher);
        // Whichever of the two lies there now is kept on with.
        self.file = SessionFile::open(&self.path).ok();
        replaced.map(Some)
    }

    fn replace_with(&mut self, next: &Session, matcher: &MatcherConfig) -> anyhow::Result<PathBuf> {
        if let Some(file) = self.file.take() {
            file.close()?;
        }
        if next.frames() == 0 {
            let aside = free_numbered(&self.aside);
            fs::rename(&self.path, &aside).with_context(|| format!("cannot write {}", aside.display()))?;
            return Ok(aside);
        }
        swap(&self.path, &self.aside, || Ok(SessionFile::write_with_notes(&self.path, next, matcher, &self.notes)?))
    }

    /// Keeps what people say of the map.
    pub(crate) fn annotate(&mut self, annotations: &Annotations) {
        self.notes.retain(|(key, _)| *key != ANNOTATIONS);
        self.notes.push((ANNOTATIONS, annotations.to_geojson()));
        if let Some(Err(error)) = self.file.as_ref().map(|file| file.annotate(annotations)) {
            self.terminal.warn(&format!("places and keep-out areas are not saved: {error}"));
        }
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

/// Gives the file at `path` a second name, the first free one after `aside`, and has another one take its place in one
/// step, so that a session lies there at any time; gives the second name.
///
/// # Errors
/// The file cannot be copied, or `replace` fails; it lies where it was then.
pub(crate) fn swap(path: &Path, aside: &Path, replace: impl FnOnce() -> anyhow::Result<()>) -> anyhow::Result<PathBuf> {
    let aside = free_numbered(aside);
    // File systems without a second name for a file take a copy.
    fs::hard_link(path, &aside).or_else(|_| copy_file(path, &aside))?;
    let replaced = replace();
    if replaced.is_err() {
        let _ = fs::remove_file(&aside);
    }
    replaced.map(|()| aside)
}

/// The first name `NAME-2.ENDING`, `NAME-3.ENDING`, … at which nothing stands, nor a recording that was not completed.
pub(crate) fn free_numbered(path: &Path) -> PathBuf {
    let named = |number: u64| {
        let mut name = path.file_stem().unwrap_or_default().to_os_string();
        name.push(format!("-{number}"));
        if let Some(ending) = path.extension() {
            name.push(".");
            name.push(ending);
        }
        path.with_file_name(name)
    };
    let mut number = 2;
    let is_taken = |path: &Path| fs::symlink_metadata(path).is_ok();
    while is_taken(&named(number)) || is_taken(&floorprint_io::ros::active_path(&named(number))) {
        number += 1;
    }
    named(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::config::Layer;
    use floorprint::simulator::{SimulationConfig, World, simulate};
    use floorprint::{Config, Frames};

    #[test]
    fn a_session_that_cannot_be_set_aside_is_kept_on_with() {
        let mut simulation = SimulationConfig::default();
        (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (181, 2.0, 0.0);
        let drive = simulate(World::named("rooms", 1).unwrap(), simulation, 1).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&drive.config().robot)]).unwrap();
        let records = drive.records();
        let mut slam = Slam::new(&config);
        let mut frames = Frames::new(&records, &config).unwrap().iter().collect::<Vec<_>>().into_iter();
        for frame in frames.by_ref().take(5) {
            slam.process(&frame).unwrap();
        }

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("site.gpkg");
        // There is no such folder, so that nothing can be put aside.
        let aside = folder.path().join("none").join("site.gpkg");
        let mut keeper = SessionKeeper::new(path.clone(), aside, None, &Terminal::new(true), Vec::new());
        let matcher = &config.matcher;
        let empty = Slam::new(&config).session().clone();
        for next in [empty.clone(), slam.session().clone()] {
            let refused = keeper.set_aside(slam.session(), &next, matcher).unwrap_err().to_string();
            assert!(refused.contains("none"), "{refused}");
            slam.process(&frames.next().unwrap()).unwrap();
            keeper.save_now(slam.session(), matcher);
            assert!(!keeper.has_failed);
            assert_eq!(SessionFile::read(&path).unwrap().frames(), slam.session().frames());
        }
        let aside = folder.path().join("site.gpkg");
        keeper.aside = aside.clone();
        let put = keeper.set_aside(slam.session(), &empty, matcher).unwrap();
        assert_eq!(put, Some(aside.with_file_name("site-2.gpkg")));
        assert!(!path.exists());
        keeper.save_now(slam.session(), matcher);
        assert!(!keeper.has_failed && path.exists());
    }
}
