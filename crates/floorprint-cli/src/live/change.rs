//! What others may want of a session while it goes on: to begin anew, to go on with another map, to leave out what is not
//! wanted in it, and to say something about it.

use super::Session;
use super::housekeeper::Housekeeper;
use crate::localize::read_any_map;
use crate::session_keeper::free_numbered;
use floorprint::geometry::Pose2;
use floorprint::localization::{Localizer, Start};
use floorprint::session::{Region, Session as Drive};
use floorprint_io::ros::Recorder;
use floorprint_io::{Annotations, SessionFile};
use floorprint_live::{Change, Engine, Mode, Picture, Refusal, Whereabouts};
use std::path::Path;
use std::sync::Arc;

impl Session<'_> {
    /// Does what is wanted.
    ///
    /// # Errors
    /// Why it is not done; everything is as it was then.
    pub(super) fn change(
        &self,
        change: &Change,
        engine: &mut Engine,
        recorder: &mut Option<Recorder>,
        housekeeper: &Housekeeper<'_>,
    ) -> Result<(), Refusal> {
        match (change, self.board.mode) {
            (Change::Annotate(revision, _), Mode::Mapping) if *revision != self.board.overlay().revision => {
                Err(Refusal::Stale)
            }
            (Change::Annotate(_, annotations), Mode::Mapping) => {
                self.board.annotate(annotations.clone());
                housekeeper.look_at_annotations();
                Ok(())
            }
            (Change::Restrict(region), Mode::Mapping) => self.restrict(region, engine, housekeeper),
            (Change::Reset, Mode::Mapping) => {
                let next = Engine::mapping(self.config, self.recorded.corrections.as_ref()).map_err(failed)?;
                self.replace(next, Annotations::default(), engine, recorder, housekeeper)
            }
            (Change::Load(path, at), Mode::Mapping) => {
                let annotations = read_annotations(path)?;
                self.replace(self.extending(path, *at)?, annotations, engine, recorder, housekeeper)
            }
            (Change::Load(path, at), Mode::Localization) => {
                let annotations = read_annotations(path)?;
                *engine = self.localizing(path, *at)?;
                self.board.annotate(annotations);
                Ok(())
            }
            _ => Err(Refusal::Mode("a finished map is used, which is not changed")),
        }
    }

    /// Says what became of it.
    pub(super) fn tell_change(&self, change: &Change, changed: &Result<(), Refusal>) {
        let what = match change {
            Change::Reset => "a new session begins".to_owned(),
            Change::Load(path, _) => format!("the map of {} is gone on with", path.display()),
            Change::Restrict(Region::Inside(_)) => "all but a part of the map is left out".to_owned(),
            Change::Restrict(Region::Outside(_)) => "a part of the map is left out".to_owned(),
            Change::Annotate(..) => "places and keep-out areas are others".to_owned(),
        };
        match changed {
            Ok(()) => self.terminal.say(&format!("as was asked for, {what}")),
            Err(error) => self.terminal.warn(&format!("it was asked for that {what}, but {error}")),
        }
    }

    fn extending(&self, path: &Path, at: Option<Pose2>) -> Result<Engine, Refusal> {
        let session = SessionFile::read(path).map_err(|error| Refusal::Unreadable(error.to_string()))?;
        let whereabouts = at.map_or(Whereabouts::First, Whereabouts::At);
        Engine::extending(session, whereabouts, self.config, self.recorded.corrections.as_ref()).map_err(failed)
    }

    fn localizing(&self, path: &Path, at: Option<Pose2>) -> Result<Engine, Refusal> {
        let (map, raster) = read_any_map(path).map_err(|error| Refusal::Unreadable(format!("{error:#}")))?;
        if map.is_empty() {
            return Err(Refusal::Unreadable(format!("{} shows no wall next to free space", path.display())));
        }
        let start = at.map_or(Start::Unknown, Start::At);
        let localizer = Localizer::new(Arc::new(map), start, self.config);
        let engine = Engine::localizing(localizer, self.config, self.recorded.corrections.as_ref()).map_err(failed)?;
        let before = self.board.picture();
        let revision = before.revision + 1;
        let map = before.map.replaced_by(raster, revision);
        self.board.show_picture(Picture { revision, map, ..Picture::default() });
        Ok(engine)
    }

    /// Leaves nothing but what was seen of a region. The session as it was is set aside.
    fn restrict(&self, region: &Region, engine: &mut Engine, housekeeper: &Housekeeper<'_>) -> Result<(), Refusal> {
        let Some(before) = engine.session().cloned() else {
            return Err(Refusal::Mode("nothing was mapped yet"));
        };
        let next = before.restricted_to(region, &self.config.matcher).map_err(failed)?;
        if before.map().to_raster().is_some() && next.map().to_raster().is_none() {
            return Err(Refusal::Failed("nothing of the map would be left".to_owned()));
        }
        engine.replace_session(next).map_err(failed)?;
        let done = self.set_aside(Some(before.clone()), engine, housekeeper);
        if done.is_err() {
            engine.replace_session(before).map_err(failed)?;
        }
        self.arguments.limit_memory(engine, self.out, self.config).map_err(failed)?;
        done
    }

    /// Puts another engine in the place of one whose session is set aside with its recording, if there is one.
    fn replace(
        &self,
        mut next: Engine,
        annotations: Annotations,
        engine: &mut Engine,
        recorder: &mut Option<Recorder>,
        housekeeper: &Housekeeper<'_>,
    ) -> Result<(), Refusal> {
        self.arguments.limit_memory(&mut next, self.out, self.config).map_err(failed)?;
        self.set_aside(engine.session().cloned(), &mut next, housekeeper)?;
        *engine = next;
        self.board.annotate(annotations);
        housekeeper.look_at_annotations();
        if let (Some(ended), Some(path)) = (recorder.take(), &self.arguments.record) {
            let begun = ended.finish().and_then(|()| {
                let path = free_numbered(path);
                Ok((Recorder::create(&path, &self.recorded)?, path))
            });
            match begun {
                Ok((begun, path)) => {
                    self.terminal.say(&format!("what comes from now on is recorded in {}", path.display()));
                    *recorder = Some(begun);
                }
                Err(error) => self.terminal.warn(&format!("nothing is recorded any more: {error}")),
            }
        }
        Ok(())
    }

    fn set_aside(
        &self,
        before: Option<Drive>,
        next: &mut Engine,
        housekeeper: &Housekeeper<'_>,
    ) -> Result<(), Refusal> {
        let Some((before, next)) = before.zip(next.session().cloned()) else { return Ok(()) };
        if let Some(path) = housekeeper.set_aside(before, next).map_err(Refusal::Failed)? {
            self.terminal.say(&format!("what was mapped until now is in {}", path.display()));
        }
        Ok(())
    }
}

fn read_annotations(path: &Path) -> Result<Annotations, Refusal> {
    SessionFile::read_annotations(path).map_err(|error| Refusal::Unreadable(error.to_string()))
}

fn failed(error: impl std::fmt::Display) -> Refusal {
    Refusal::Failed(error.to_string())
}
