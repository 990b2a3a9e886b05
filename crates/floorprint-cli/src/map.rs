//! `floorprint map`: what to do with the sessions of drives.

use crate::figure::Figure;
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::{Context as _, ensure};
use clap::{Args, Subcommand};
use floorprint::Slam;
use floorprint::config::{Config, Layer};
use floorprint::map::{Occupancy, Raster};
use floorprint::session::Session;
use floorprint_io::{Layers, SessionFile, write_g2o, write_map, write_png, write_trajectory};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Look into session files, take maps out of them, put them together.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Say what a session holds.
    Info(Info),
    /// Write map (PGM and YAML, PNG), trajectory (TUM) and pose graph (g2o) of a session into a folder.
    Export(Export),
    /// Put a session onto another one, without knowing how they lie to each other.
    Merge(Merge),
}

/// Arguments of `map info`.
#[derive(Args)]
pub(crate) struct Info {
    /// Session file.
    session: PathBuf,
}

/// Arguments of `map export`.
#[derive(Args)]
pub(crate) struct Export {
    /// Session file.
    session: PathBuf,
    /// Folder for the files, which is made.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Arguments of `map merge`.
#[derive(Args)]
pub(crate) struct Merge {
    /// Session that stays where it is.
    first: PathBuf,
    /// Session that is looked for on it.
    second: PathBuf,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

/// Runs `floorprint map`.
pub(crate) fn execute(command: &Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    match command {
        Command::Info(arguments) => arguments.execute(terminal),
        Command::Export(arguments) => arguments.execute(),
        Command::Merge(arguments) => arguments.execute(terminal),
    }
}

/// A session and the configuration it was made with.
fn load(path: &Path) -> anyhow::Result<(Session, Config)> {
    let file = SessionFile::open(path)?;
    let session = file.load()?;
    let notes = file.notes()?;
    let config = match notes.get("config") {
        Some(text) => Config::resolve(&[Layer::from_toml(&format!("the configuration in {}", path.display()), text)?])?,
        None => Config::default(),
    };
    Ok((session, config))
}

fn raster_of(session: &Session, path: &Path) -> anyhow::Result<Raster<Occupancy>> {
    session.map().to_raster().with_context(|| format!("{}: nothing was seen in this session", path.display()))
}

impl Info {
    fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let (session, config) = load(&self.session)?;
        let trajectory = session.trajectory();
        let steps = trajectory.windows(2).map(|pair| pair[0].pose.between(&pair[1].pose).distance());
        let (length_m, bytes) = (steps.sum::<f64>(), fs::metadata(&self.session)?.len());
        let scans = session.scans();
        let scan_bytes: usize = scans.iter().map(|scan| scan.points.bytes().len()).sum();
        let mut out = terminal.results();
        writeln!(out, "session     {} ({:.1} MB)", self.session.display(), bytes as f64 * 1e-6)?;
        if let (Some(first), Some(last)) = (trajectory.first(), trajectory.last()) {
            writeln!(
                out,
                "trajectory  {length_m:.1} m, {} frames, stamps {:.3} to {:.3} s",
                trajectory.len(),
                first.stamp_s,
                last.stamp_s
            )?;
        }
        let mean = scan_bytes as f64 / scans.len().max(1) as f64;
        writeln!(out, "key scans   {} ({mean:.0} bytes each)", scans.len())?;
        if let Some(places) = session.places() {
            let closures = places.reports();
            let closed = closures.iter().filter(|closure| closure.verdict == floorprint::back_end::Verdict::Accepted);
            writeln!(out, "submaps     {}, {} loops closed", places.submaps().len(), closed.count())?;
            for kidnapping in places.kidnappings() {
                let state =
                    if kidnapping.found.is_some() { "placed on what was seen before" } else { "not placed yet" };
                writeln!(out, "break       before frame {}: {state}", kidnapping.frame)?;
            }
        }
        let map = raster_of(&session, &self.session)?;
        let free_m2 =
            map.cells.iter().filter(|&&cell| cell == Occupancy::Free).count() as f64 * config.map.resolution_m.powi(2);
        writeln!(
            out,
            "map         {}×{} cells of {} m, {free_m2:.1} m² free",
            map.width, map.height, map.resolution_m
        )?;
        Ok(Outcome::Fine)
    }
}

impl Export {
    fn execute(&self) -> anyhow::Result<Outcome> {
        let (session, _) = load(&self.session)?;
        let map = raster_of(&session, &self.session)?;
        fs::create_dir_all(&self.out).with_context(|| format!("cannot make the folder {}", self.out.display()))?;
        write_map(&self.out.join("map.yaml"), &map)?;
        write_png(&self.out.join("map.png"), &Figure::of_map(&map).into_picture())?;
        write_trajectory(&self.out.join("trajectory.tum"), &session.trajectory())?;
        if let Some(places) = session.places() {
            write_g2o(&self.out.join("graph.g2o"), &places.graph().into())?;
        }
        Ok(Outcome::Fine)
    }
}

impl Merge {
    fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        ensure!(
            fs::symlink_metadata(&self.out).is_err(),
            "{}: a file stands there. Choose another name, or remove it",
            self.out.display()
        );
        let ((first, config), (second, _)) = (load(&self.first)?, load(&self.second)?);
        let offset = first.frames();
        let merged = Slam::resume(first, &config)
            .and_then(|slam| slam.append(&second, &config))
            .with_context(|| format!("cannot merge {} and {}", self.first.display(), self.second.display()))?;
        let result = merged.finish();
        let map = result.map.to_raster().context("nothing was seen in these sessions")?;
        let mut file = SessionFile::create(&self.out)?;
        file.note("config", &config.to_toml())?;
        file.save(&result.session, &config.matcher)?;
        file.draw(&Layers { session: &result.session, map: &map, floor: None })?;
        let path = file.path().to_path_buf();
        file.move_to(&path)?;
        let place = result.kidnappings.iter().find(|kidnapping| kidnapping.frame == offset);
        let is_placed = place.is_none_or(|kidnapping| kidnapping.found.is_some());
        let mut out = terminal.results();
        if is_placed {
            writeln!(out, "{} was placed on {}", self.second.display(), self.first.display())?;
            Ok(Outcome::Fine)
        } else {
            writeln!(
                out,
                "{} was not recognised on {}: both are in {}, how they lie to each other is not known",
                self.second.display(),
                self.first.display(),
                self.out.display()
            )?;
            Ok(Outcome::Fine)
        }
    }
}
