//! `floorprint map export`.

use super::{Stored, map_path};
use crate::figure::Figure;
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use floorprint_io::{
    write_file, write_floor, write_floor_geotiff, write_g2o, write_map, write_map_geotiff, write_png, write_raw_map,
    write_scaled_map, write_trajectory,
};
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

/// Arguments of `map export`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Session file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    session: PathBuf,
    /// Folder for the files, which is made.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How map.yaml and its picture say what is occupied (see map_server): free, occupied or unknown; or how likely, as
    /// shades with unknown cells transparent; or how likely, in percent.
    #[arg(long, value_name = "MODE", default_value = "trinary")]
    mode: Mode,
}

/// Modes of map_server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Mode {
    Trinary,
    Scale,
    Raw,
}

impl Arguments {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let stored = Stored::load(&self.session)?;
        let map = stored.map(&self.session)?;
        fs::create_dir_all(&self.out).with_context(|| format!("cannot make the folder {}", self.out.display()))?;
        let yaml = self.out.join("map.yaml");
        let probabilities = || stored.session.map().to_probabilities().context("nothing was seen in this session");
        match self.mode {
            Mode::Trinary => write_map(&yaml, &map)?,
            Mode::Scale => write_scaled_map(&yaml, &probabilities()?)?,
            Mode::Raw => write_raw_map(&yaml, &probabilities()?)?,
        }
        // In the mode `scale` the picture that the YAML file names is a PNG, too.
        write_png(&self.out.join("figure.png"), &Figure::of_map(&map).into_picture())?;
        write_map_geotiff(&self.out.join("map.tif"), &map)?;
        if let Some(floor) = &stored.floor {
            write_floor(&self.out.join("floor.png"), floor)?;
            write_floor_geotiff(&self.out.join("floor.tif"), floor)?;
        }
        write_trajectory(&self.out.join("trajectory.tum"), &stored.session.trajectory())?;
        if let Some(graph) = stored.session.graph() {
            write_g2o(&self.out.join("graph.g2o"), &graph.into())?;
        }
        if !stored.annotations.is_empty() {
            write_file(&self.out.join("annotations.geojson"), stored.annotations.to_geojson().as_bytes())?;
            write_map(&self.out.join("keepout.yaml"), &stored.annotations.keep_out_mask(&map))?;
        }
        let mut names: Vec<String> = fs::read_dir(&self.out)?
            .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
            .collect();
        names.sort();
        writeln!(terminal.results(), "{}: {}", self.out.display(), names.join(", "))?;
        Ok(Outcome::Fine)
    }
}
