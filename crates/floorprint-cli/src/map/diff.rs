//! `floorprint map diff`.

use super::{Stored, is_session, map_path};
use crate::figure::{Color, Figure};
use crate::number::number;
use crate::outcome::{BadArguments, Outcome};
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::Args;
use floorprint::map::{Change, ChangedPatch, Occupancy, Raster, difference};
use floorprint_io::{read_map, write_file, write_png};
use serde_json::json;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Arguments of `map diff`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// The earlier map: a session or the folder of a run, or the YAML file of a map whose axes lie as the other's do.
    #[arg(value_parser = map_path())]
    before: PathBuf,
    /// The later map. A session that goes on from the earlier one is compared by what its new drives saw; another session is
    /// first looked for on the earlier one.
    #[arg(value_parser = map_path())]
    after: PathBuf,
    /// Folder for diff.geojson and diff.png, which is made.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Walls that moved by no more than this did not change, metres.
    #[arg(long, value_name = "METRES", default_value_t = TOLERANCE_M, value_parser = number(0.0, 10.0))]
    tolerance: f64,
    /// Patches smaller than this are left out, square metres [default: 8 cells of the coarser map].
    #[arg(long, value_name = "AREA", value_parser = number(0.0, 1e6))]
    least_area: Option<f64>,
    /// Print GeoJSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// Walls that moved by no more than this did not change, metres.
pub(crate) const TOLERANCE_M: f64 = 0.15;

const NEW: Color = [22, 163, 74];
const GONE: Color = [220, 38, 38];

impl Arguments {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let [before, after] = maps(&self.before, &self.after)?;
        let least_area_m2 = self.least_area.unwrap_or_else(|| least_area_m2(&before, &after));
        let patches = difference(&before, &after, self.tolerance, least_area_m2);
        let document = geojson(patches.iter().map(|patch| (patch, None))).to_string() + "\n";
        if let Some(folder) = &self.out {
            fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
            write_file(&folder.join("diff.geojson"), document.as_bytes())?;
            write_png(&folder.join("diff.png"), &figure(&before, patches.iter()).into_picture())?;
        }
        let mut out = terminal.results();
        if self.json {
            out.write_all(document.as_bytes())?;
            return Ok(Outcome::Fine);
        }
        print(&mut out, patches.iter().map(|patch| (patch, None)))?;
        Ok(Outcome::Fine)
    }
}

/// Both maps, in the frame of the earlier one.
///
/// # Errors
/// One cannot be read, or two sessions have nothing in common.
pub(crate) fn maps(before: &Path, after: &Path) -> anyhow::Result<[Raster<Occupancy>; 2]> {
    match [before, after].map(is_session) {
        [true, true] => maps_of_sessions(before, after),
        [false, false] => Ok([read_map(before)?, read_map(after)?]),
        [true, false] => Ok([Stored::load(before)?.map(before)?, read_map(after)?]),
        [false, true] => Ok([read_map(before)?, Stored::load(after)?.map(after)?]),
    }
}

/// Of how many cells of the coarser map a patch is at least. What is smaller may be what two drives made of one edge that
/// lies between two cells.
const LEAST_CELLS: f64 = 8.0;

/// Smaller patches are left out, square metres.
pub(crate) fn least_area_m2(before: &Raster<Occupancy>, after: &Raster<Occupancy>) -> f64 {
    LEAST_CELLS * before.resolution_m.max(after.resolution_m).powi(2)
}

fn maps_of_sessions(before: &Path, after: &Path) -> anyhow::Result<[Raster<Occupancy>; 2]> {
    let both = [before, after].map(Path::display);
    let maps = Stored::load(before)?
        .maps_with(Stored::load(after)?.session)
        .with_context(|| format!("cannot compare {} and {}", both[0], both[1]))?;
    let unknown = || {
        BadArguments(format!("{} was not recognised on {}: how they lie to each other is not known", both[1], both[0]))
    };
    maps.ok_or_else(|| unknown().into())
}

/// First and last time at which a patch was seen, seconds.
type Seen = Option<[f64; 2]>;

/// Prints what changed: the areas, then patch by patch.
///
/// # Errors
/// It cannot be written.
pub(crate) fn print<'a>(
    out: &mut impl Write,
    patches: impl Iterator<Item = (&'a ChangedPatch, Seen)> + Clone,
) -> io::Result<()> {
    for change in [Change::New, Change::Gone] {
        let of_kind = patches.clone().filter(|(patch, _)| patch.change == change);
        let area_m2 = of_kind.clone().fold(0.0, |sum, (patch, _)| sum + patch.area_m2);
        writeln!(out, "{:<5} {:>4} patches  {area_m2:>8.2} m²", word(change), of_kind.count())?;
    }
    for (patch, seen) in patches {
        let [x, y] = middle(patch);
        let seen = seen.map_or(String::new(), |[first_s, last_s]| format!(", seen from {first_s:.1} to {last_s:.1} s"));
        writeln!(out, "  {:<5} {:>8.2} m²  around ({x:.2}, {y:.2}){seen}", word(patch.change), patch.area_m2)?;
    }
    Ok(())
}

/// A change in a word.
pub(crate) fn word(change: Change) -> &'static str {
    match change {
        Change::New => "new",
        Change::Gone => "gone",
    }
}

/// The middle of the rectangle around a patch, metres.
fn middle(patch: &ChangedPatch) -> [f64; 2] {
    [0, 1].map(|axis| {
        let values = || patch.outlines_m.iter().flatten().map(|corner| corner[axis]);
        0.5 * (values().fold(f64::INFINITY, f64::min) + values().fold(f64::NEG_INFINITY, f64::max))
    })
}

/// The patches, with the times at which they were seen where these are known, as a feature collection; coordinates are
/// metres in the map's frame. Each outline that runs counter-clockwise begins a polygon, those of holes follow the polygon
/// that they lie in.
pub(crate) fn geojson<'a>(patches: impl Iterator<Item = (&'a ChangedPatch, Seen)>) -> serde_json::Value {
    let features: Vec<_> = patches
        .map(|(patch, seen)| {
            let polygons: Vec<_> = polygons(&patch.outlines_m);
            let mut properties = json!({ "change": word(patch.change), "area_m2": patch.area_m2 });
            if let Some([first_s, last_s]) = seen {
                (properties["first_seen_s"], properties["last_seen_s"]) = (first_s.into(), last_s.into());
            }
            json!({
                "type": "Feature",
                "properties": properties,
                "geometry": { "type": "MultiPolygon", "coordinates": polygons },
            })
        })
        .collect();
    json!({ "type": "FeatureCollection", "features": features })
}

/// Outlines put together to polygons: an outer ring and its holes, each ring closed.
fn polygons(outlines: &[Vec<[f64; 2]>]) -> Vec<Vec<Vec<[f64; 2]>>> {
    let closed = |outline: &Vec<[f64; 2]>| outline.iter().chain(outline.first()).copied().collect::<Vec<_>>();
    let area = |outline: &[[f64; 2]]| {
        outline.iter().zip(outline.iter().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>()
    };
    let mut polygons: Vec<Vec<Vec<[f64; 2]>>> =
        outlines.iter().filter(|outline| area(outline) > 0.0).map(|outline| vec![closed(outline)]).collect();
    for hole in outlines.iter().filter(|outline| area(outline) < 0.0) {
        let lies_in = |polygon: &&mut Vec<Vec<[f64; 2]>>| {
            let outer = floorprint::geometry::Polygon::new(polygon[0].clone());
            // A little beside the corner: inside of the patch, to the left of the way along its edge.
            let [start, end] = [hole[0], hole[1]];
            let beside = [0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])];
            outer.is_ok_and(|outer| outer.contains(beside))
        };
        if let Some(polygon) = polygons.iter_mut().find(lies_in) {
            polygon.push(closed(hole));
        }
    }
    polygons
}

/// The earlier map with what is new in green and what is gone in red.
pub(crate) fn figure<'a>(before: &Raster<Occupancy>, patches: impl Iterator<Item = &'a ChangedPatch>) -> Figure {
    let mut figure = Figure::of_map(before);
    for patch in patches {
        let color = if patch.change == Change::New { NEW } else { GONE };
        for outline in &patch.outlines_m {
            figure.draw_line(outline.iter().chain(outline.first()).copied(), color, 3.0);
        }
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_is_so_many_cells_of_the_coarser_map() {
        let map = |resolution_m: f64| Raster {
            width: 1,
            height: 1,
            resolution_m,
            origin_m: [0.0; 2],
            cells: vec![Occupancy::Unknown],
        };
        assert!((least_area_m2(&map(0.05), &map(0.05)) - 0.02).abs() < 1e-12);
        assert!((least_area_m2(&map(0.05), &map(0.1)) - 0.08).abs() < 1e-12);
    }
}
