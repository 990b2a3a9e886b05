//! `floorprint map`: what to do with the sessions of drives.

mod diff;
mod edit;
mod export;
mod info;
mod merge;

use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::{Context as _, ensure};
use clap::Subcommand;
use floorprint::config::{Config, Layer};
use floorprint::map::{Occupancy, Raster};
use floorprint::session::Session;
use floorprint::texture::TextureMap;
use floorprint_io::{Layers, SessionFile};
use std::fs;
use std::path::Path;

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
struct Stored {
    session: Session,
    /// The configuration it was made with.
    config: Config,
    /// The colours of its floor, where it was painted.
    floor: Option<TextureMap>,
}

impl Stored {
    fn load(path: &Path) -> anyhow::Result<Self> {
        let file = SessionFile::open(path)?;
        let session = file.load()?;
        let notes = file.notes()?;
        let config = match notes.get("config") {
            Some(text) => {
                Config::resolve(&[Layer::from_toml(&format!("the configuration in {}", path.display()), text)?])?
            }
            None => Config::default(),
        };
        Ok(Self { session, config, floor: file.floor()? })
    }

    /// The occupancy map.
    fn map(&self, path: &Path) -> anyhow::Result<Raster<Occupancy>> {
        let map = self.session.map().to_raster();
        map.with_context(|| format!("{}: nothing was seen in this session", path.display()))
    }

    /// Writes it as a new file.
    fn save(&self, path: &Path) -> anyhow::Result<()> {
        let map = self.map(path)?;
        let mut file = SessionFile::create(path)?;
        let mut write = || -> anyhow::Result<()> {
            file.note("config", &self.config.to_toml())?;
            file.save(&self.session, &self.config.matcher)?;
            file.draw(&Layers { session: &self.session, map: &map, floor: self.floor.as_ref() })?;
            Ok(())
        };
        let written = write().and_then(|()| Ok(file.move_to(path)?));
        if written.is_err() {
            // The failure that is reported is the first one.
            let _ = fs::remove_file(path);
        }
        written
    }
}

/// That nothing stands where a result is to be.
fn ensure_free(out: &Path) -> anyhow::Result<()> {
    let is_free = fs::symlink_metadata(out).is_err();
    ensure!(is_free, "{}: a file stands there. Choose another name, or remove it", out.display());
    Ok(())
}
