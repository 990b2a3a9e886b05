//! `floorprint map`: what to do with the sessions of drives.

pub(crate) mod diff;
mod edit;
mod export;
mod info;
mod merge;

use crate::outcome::{BadArguments, Outcome};
use crate::terminal::Terminal;
use anyhow::{Context as _, anyhow, ensure};
use clap::Subcommand;
use clap::builder::{PathBufValueParser, TypedValueParser};
use floorprint::Slam;
use floorprint::config::{Config, Layer};
use floorprint::map::{Occupancy, OccupancyGrid, Raster};
use floorprint::session::{Region, Session, SessionError};
use floorprint::texture::TextureMap;
use floorprint_io::{ANNOTATIONS, Annotations, Layers, SessionFile};
use std::fs;
use std::path::{Path, PathBuf};

/// Look into session files, take maps out of them, change them, put them together, compare them.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Say what a session holds.
    Info(info::Arguments),
    /// Write map, floor, trajectory and pose graph of a session into a folder, in formats that other programs open.
    Export(export::Arguments),
    /// Put a session onto another one, without knowing how they lie to each other.
    Merge(merge::Arguments),
    /// Keep only what was seen inside a polygon.
    Crop(edit::Crop),
    /// Take out what was seen inside polygons: people who stood there, furniture that is gone.
    Erase(edit::Erase),
    /// Turn a session, so that walls run along the axes or by an angle.
    Rotate(edit::Rotate),
    /// Say what is new and what is gone in a later map.
    Diff(diff::Arguments),
}

/// Runs `floorprint map`.
pub(crate) fn execute(command: &Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    match command {
        Command::Info(arguments) => arguments.execute(terminal),
        Command::Export(arguments) => arguments.execute(terminal),
        Command::Merge(arguments) => arguments.execute(terminal),
        Command::Crop(arguments) => arguments.execute(terminal),
        Command::Erase(arguments) => arguments.execute(terminal),
        Command::Rotate(arguments) => arguments.execute(terminal),
        Command::Diff(arguments) => arguments.execute(terminal),
    }
}

/// A session as it lies on the disk.
#[derive(Clone)]
pub struct Stored {
    /// Poses, key scans, places.
    pub session: Session,
    /// The configuration it was made with.
    pub config: Config,
    /// The colours of its floor, where it was painted.
    pub floor: Option<TextureMap>,
    /// What people said of the map.
    pub annotations: Annotations,
}

/// Whether a session was recognised on another one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placement {
    /// It was: both are in one frame.
    Placed,
    /// It was not: how the two lie to each other is not known.
    Apart,
}

impl Stored {
    /// A session of which nobody said anything yet.
    #[must_use]
    pub fn new(session: Session, config: Config, floor: Option<TextureMap>) -> Self {
        Self { session, config, floor, annotations: Annotations::default() }
    }

    /// Reads a session's file.
    ///
    /// # Errors
    /// There is none, or it is damaged.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let file = SessionFile::open(path)?;
        let session = file.load()?;
        let notes = file.notes()?;
        let config = match notes.get("config") {
            Some(text) => {
                let name = format!("the configuration in {}", path.display());
                let layer = Layer::from_toml(&name, text);
                // It was written by the program: that it is wrong is not to be mended by the user's options.
                layer.and_then(|layer| Config::resolve(&[layer])).map_err(|error| {
                    anyhow!("{error}: the session is damaged, or of a later version. Take an earlier copy of it")
                })?
            }
            None => Config::default(),
        };
        Ok(Self { session, config, floor: file.floor()?, annotations: file.annotations()? })
    }

    /// This session with `other` looked for on it, without knowing how they lie to each other.
    ///
    /// What people said of the other's map is true of this one where it was placed; else it is left out.
    ///
    /// # Errors
    /// One of them cannot be gone on with, or people said too much of both.
    pub fn merged(self, other: &Self) -> anyhow::Result<(Self, Placement)> {
        let offset = self.session.frames();
        let (session, placement) = put_together(self.session, &other.session, &self.config)?;
        let first_of = |session: &Session, frame: usize| session.world_from_bodies().get(frame).copied();
        let annotations = match first_of(&session, offset).zip(first_of(&other.session, 0)) {
            Some((here, there)) if placement == Placement::Placed => {
                self.annotations.joined(other.annotations.moved(&here.compose(&there.inverse())))?
            }
            _ => self.annotations,
        };
        Ok((Self { session, annotations, ..self }, placement))
    }

    /// The maps of this session and of a later one, both in this one's frame. Of a later one that goes on from this one
    /// it is what the new drives saw; another one is first looked for on this one: `None` if it is not recognised.
    ///
    /// # Errors
    /// One of them cannot be gone on with, or nothing was seen in it.
    pub fn maps_with(self, later: Session) -> anyhow::Result<Option<[Raster<Occupancy>; 2]>> {
        let earlier_frames = self.session.frames();
        let config = self.config.clone();
        let stamps = |session: &Session| session.poses().iter().map(|pose| pose.stamp_s.to_bits()).collect::<Vec<_>>();
        let goes_on = stamps(&later).starts_with(&stamps(&self.session)) && later.frames() > earlier_frames;
        let both = if goes_on {
            later
        } else {
            match put_together(self.session, &later, &config)? {
                (both, Placement::Placed) => both,
                (_, Placement::Apart) => return Ok(None),
            }
        };
        let drawn = |earlier: bool| {
            drawn_of(&both, &config, |frame| (frame < earlier_frames) == earlier)
                .to_raster()
                .context("nothing was seen in one of the sessions")
        };
        Ok(Some([drawn(true)?, drawn(false)?]))
    }

    /// The occupancy map.
    pub(crate) fn map(&self, path: &Path) -> anyhow::Result<Raster<Occupancy>> {
        let map = self.session.map().to_raster();
        map.with_context(|| format!("{}: nothing was seen in this session", path.display()))
    }

    /// Writes it as a new file where none stands.
    ///
    /// # Errors
    /// A file stands there; nothing was seen in it; the file cannot be written.
    pub fn save_as_new(&self, path: &Path) -> anyhow::Result<()> {
        let map = self.map(path)?;
        Ok(SessionFile::write_new(path, &self.layers(&map), &self.config.matcher, &self.notes())?)
    }

    /// Writes it in place of the file at `path`, in one step.
    ///
    /// # Errors
    /// The file cannot be written; it is as it was then.
    pub(crate) fn save_over(&self, path: &Path) -> anyhow::Result<()> {
        let map = self.map(path)?;
        Ok(SessionFile::write_over(path, &self.layers(&map), &self.config.matcher, &self.notes())?)
    }

    fn layers<'a>(&'a self, map: &'a Raster<Occupancy>) -> Layers<'a> {
        Layers { session: &self.session, map, floor: self.floor.as_ref() }
    }

    fn notes(&self) -> Vec<(&'static str, String)> {
        let annotations = (!self.annotations.is_empty()).then(|| (ANNOTATIONS, self.annotations.to_geojson()));
        std::iter::once(("config", self.config.to_toml())).chain(annotations).collect()
    }

    /// Leaves nothing but what was seen of regions.
    ///
    /// # Errors
    /// Nothing would be left of it, or nothing changes.
    pub(crate) fn restricted_to(mut self, regions: &[Region], path: &Path) -> anyhow::Result<(Self, f64)> {
        let before = occupied_m2(&self.map(path)?);
        for region in regions {
            self.session = self
                .session
                .restricted_to(region, &self.config.matcher)
                .with_context(|| format!("cannot change {}", path.display()))?;
        }
        let Some(left) = self.session.map().to_raster() else {
            let message = format!("nothing of {} is left: is the polygon in metres?", path.display());
            return Err(BadArguments(message).into());
        };
        let gone = before - occupied_m2(&left);
        ensure!(gone != 0.0, "{}: nothing stands in the polygon, so that nothing changed", path.display());
        if let (Some(floor), [Region::Inside(polygon)]) = (&mut self.floor, regions) {
            *floor = floor.map(|index, center| floor.cells[index].filter(|_| polygon.contains(center)));
        }
        Ok((self, gone))
    }
}

/// A session with another one looked for on it.
fn put_together(first: Session, second: &Session, config: &Config) -> Result<(Session, Placement), SessionError> {
    let offset = first.frames();
    let result = Slam::resume(first, config)?.append(second, config)?.finish();
    let place = result.kidnappings.iter().find(|kidnapping| kidnapping.frame == offset);
    let is_placed = place.is_none_or(|kidnapping| kidnapping.found.is_some());
    Ok((result.session, if is_placed { Placement::Placed } else { Placement::Apart }))
}

fn occupied_m2(map: &Raster<Occupancy>) -> f64 {
    map.cells.iter().filter(|&&cell| cell == Occupancy::Occupied).count() as f64 * map.resolution_m.powi(2)
}

/// Takes the path of a map from the command line: a run's folder stands for what lies in it.
pub(crate) fn map_path() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| file_of(&path))
}

/// The session of a run's folder, or its map where it left no session; a file is itself.
pub(crate) fn file_of(path: &Path) -> PathBuf {
    if !path.is_dir() {
        return path.to_path_buf();
    }
    let [session, map] = ["session.gpkg", "map.yaml"].map(|name| path.join(name));
    if map.is_file() && !session.is_file() { map } else { session }
}

/// Whether a file is called as sessions are.
pub(crate) fn is_session(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "gpkg")
}

/// The map of some of a session's scans.
fn drawn_of(session: &Session, config: &Config, is_wanted: impl Fn(usize) -> bool) -> OccupancyGrid {
    let world_from_bodies = session.world_from_bodies();
    let mut grid = OccupancyGrid::new(&config.map);
    for scan in session.scans().iter().filter(|scan| scan.is_drawn && is_wanted(scan.frame)) {
        grid.draw_scan(&world_from_bodies[scan.frame], &scan.points.unpack());
    }
    grid
}

/// That nothing stands where a result is to be.
fn ensure_free(out: &Path) -> anyhow::Result<()> {
    let is_free = fs::symlink_metadata(out).is_err();
    ensure!(is_free, "{}: a file stands there. Choose another name, or remove it", out.display());
    Ok(())
}
