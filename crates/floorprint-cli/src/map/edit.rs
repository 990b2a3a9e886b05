//! `floorprint map crop`, `erase` and `rotate`: the session stays, a changed copy is written.

use super::{Stored, ensure_free, map_path};
use crate::outcome::{BadArguments, Outcome};
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::Args;
use floorprint::geometry::{Polygon, Pose2};
use floorprint::map::Raster;
use floorprint::session::Region;
use floorprint::texture::TextureMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Arguments of `map crop`.
#[derive(Args)]
pub(crate) struct Crop {
    /// Session file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    session: PathBuf,
    /// Corners of the polygon in the map's frame, metres: "x,y x,y x,y"; two are opposite corners of a rectangle.
    #[arg(long, value_name = "CORNERS", value_parser = polygon, allow_hyphen_values = true)]
    polygon: Polygon,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

/// Arguments of `map erase`.
#[derive(Args)]
pub(crate) struct Erase {
    /// Session file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    session: PathBuf,
    /// Corners of a polygon in the map's frame, metres: "x,y x,y x,y"; two are opposite corners of a rectangle. May be
    /// given several times.
    #[arg(long = "polygon", value_name = "CORNERS", value_parser = polygon, allow_hyphen_values = true, required = true)]
    polygons: Vec<Polygon>,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

/// Arguments of `map rotate`.
#[derive(Args)]
pub(crate) struct Rotate {
    /// Session file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    session: PathBuf,
    /// Angle, degrees, counter-clockwise [default: the least one after which most walls run along the axes].
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    by: Option<f64>,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

/// Corners as they are written on the command line.
fn polygon(text: &str) -> Result<Polygon, String> {
    let corner = |pair: &str| -> Option<[f64; 2]> {
        let (x, y) = pair.split_once(',')?;
        Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
    };
    let corners: Option<Vec<[f64; 2]>> = text.split_whitespace().map(corner).collect();
    let corners = corners.ok_or("expected corners as \"x,y x,y x,y\", in metres")?;
    let corners = match corners[..] {
        [[x0, y0], [x1, y1]] => vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
        _ => corners,
    };
    Polygon::new(corners).map_err(|error| error.to_string())
}

impl Crop {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let region = Region::Inside(self.polygon.clone());
        restrict(&self.session, std::slice::from_ref(&region), &self.out, terminal)
    }
}

impl Erase {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let regions: Vec<Region> = self.polygons.iter().cloned().map(Region::Outside).collect();
        restrict(&self.session, &regions, &self.out, terminal)
    }
}

fn restrict(path: &Path, regions: &[Region], out: &Path, terminal: &Terminal) -> anyhow::Result<Outcome> {
    ensure_free(out)?;
    let (stored, gone) = Stored::load(path)?.restricted_to(regions, path)?;
    stored.save_as_new(out)?;
    writeln!(terminal.results(), "{}: {gone:.2} m² of what stood there are taken out", out.display())?;
    Ok(Outcome::Fine)
}

impl Rotate {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        ensure_free(&self.out)?;
        let mut stored = Stored::load(&self.session)?;
        let angle_rad = match self.by {
            Some(degrees) if degrees.is_finite() => degrees.to_radians(),
            Some(degrees) => return Err(BadArguments(format!("{degrees} is no angle")).into()),
            None => stored.session.angle_to_walls(&stored.config.matcher).with_context(|| {
                format!("{}: no wall was seen. Give an angle with --by DEGREES", self.session.display())
            })?,
        };
        let turn = Pose2::new(0.0, 0.0, angle_rad);
        stored.session = stored.session.moved(&turn);
        stored.annotations = stored.annotations.moved(&turn);
        stored.floor = stored.floor.map(|floor| turned(&floor, &turn));
        stored.save_as_new(&self.out)?;
        writeln!(terminal.results(), "{}: turned by {:.2}°", self.out.display(), angle_rad.to_degrees())?;
        Ok(Outcome::Fine)
    }
}

/// A floor after a turn of the axes, each cell after the one in which its centre lies.
fn turned(floor: &TextureMap, new_from_old: &Pose2) -> TextureMap {
    let [left, bottom] = floor.origin_m;
    let (width_m, height_m) = (floor.width as f64 * floor.resolution_m, floor.height as f64 * floor.resolution_m);
    let corners =
        [[left, bottom], [left + width_m, bottom], [left, bottom + height_m], [left + width_m, bottom + height_m]];
    let corners = corners.map(|corner| new_from_old.transform_point(corner));
    let least = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
    let most = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
    let side = |axis: usize| ((most(axis) - least(axis)) / floor.resolution_m).ceil() as usize;
    let (width, height) = (side(0), side(1));
    let empty: Raster<()> = Raster {
        width,
        height,
        resolution_m: floor.resolution_m,
        origin_m: [least(0), least(1)],
        cells: vec![(); width * height],
    };
    let old_from_new = new_from_old.inverse();
    empty.map(|_, center| floor.at(old_from_new.transform_point(center)).copied().flatten())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_corners_make_a_rectangle_and_one_makes_nothing() {
        assert_eq!(polygon("1,2 -3.5,4").unwrap().corners_m(), [[1.0, 2.0], [-3.5, 2.0], [-3.5, 4.0], [1.0, 4.0]]);
        assert_eq!(polygon("0,0 1,0 1,1").unwrap().corners_m().len(), 3);
        assert!(polygon("1,2").is_err() && polygon("").is_err() && polygon("1;2 3;4 5;6").is_err());
    }
}
