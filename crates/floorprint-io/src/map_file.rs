//! Occupancy maps as ROS's `map_server` keeps them: a picture and a YAML file that says what it shows.
//!
//! Source: the ROS wiki, `map_server`, "Map format".

use crate::error::{Problem, ReadError, WriteError};
use crate::pgm::{parse_pgm, write_pgm};
use crate::picture::{Picture, Pixels, decode_png, write_png};
use crate::regular_file::{read_regular, read_text};
use crate::replace::replace_file;
use floorprint::map::{Occupancy, Raster};
use serde::Deserialize;
use std::path::Path;

/// Above this probability a cell is written and, unless the file says otherwise, read as occupied.
const OCCUPIED_THRESHOLD: f64 = 0.65;

/// Below this probability a cell is written and, unless the file says otherwise, read as free.
/// The grey of unknown cells, 205, stands for just more.
const FREE_THRESHOLD: f64 = 0.196;

/// Writes `map` as the YAML file at `path` and the PGM picture of the same name beside it.
///
/// # Errors
/// When a file cannot be written.
pub fn write_map(path: &Path, map: &Raster<Occupancy>) -> Result<(), WriteError> {
    let picture = path.with_extension("pgm");
    replace_file(&picture, |file| write_pgm(file, map.width, map.height, &levels(map)))?;
    describe(path, &picture, "trinary", map)
}

/// The same in memory: the YAML file and the picture, whose name is to be `picture`.
#[must_use]
pub fn map_bytes(picture: &str, map: &Raster<Occupancy>) -> [Vec<u8>; 2] {
    let mut pgm = Vec::new();
    // Memory takes all that is written.
    let _ = write_pgm(&mut pgm, map.width, map.height, &levels(map));
    [description(picture, "trinary", map).into_bytes(), pgm]
}

fn levels(map: &Raster<Occupancy>) -> Vec<u8> {
    let level = |cell: &Occupancy| match cell {
        Occupancy::Occupied => 0,
        Occupancy::Unknown => 205,
        Occupancy::Free => 254,
    };
    map.cells.iter().map(level).collect()
}

/// Writes the YAML file that says what a picture of a map shows.
fn describe<T>(path: &Path, picture: &Path, mode: &str, map: &Raster<T>) -> Result<(), WriteError> {
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    replace_file(path, |file| file.write_all(description(&name, mode, map).as_bytes()))
}

/// What a picture of a map shows, as YAML.
fn description<T>(picture: &str, mode: &str, map: &Raster<T>) -> String {
    let ([x_m, y_m], resolution_m) = (map.origin_m, map.resolution_m);
    format!(
        "image: {picture}\nmode: {mode}\nresolution: {resolution_m}\norigin: [{x_m}, {y_m}, 0]\nnegate: 0\n\
         occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
    )
}

/// Writes how likely each cell is occupied (`None`: unknown), as the YAML file at `path` and a PNG picture of the same
/// name beside it, in map_server's mode `scale`: the darker, the likelier; transparent where nothing is known.
///
/// # Errors
/// When a file cannot be written.
pub fn write_scaled_map(path: &Path, map: &Raster<Option<f64>>) -> Result<(), WriteError> {
    let pixel = |probability: &Option<f64>| {
        let level = |probability: f64| (255.0 * (1.0 - probability)).round() as u8;
        probability.map_or([0; 4], |probability| [level(probability), level(probability), level(probability), 255])
    };
    let pixels = Pixels::Rgba8(map.cells.iter().map(pixel).collect());
    let picture = path.with_extension("png");
    write_png(&picture, &Picture { width: map.width, height: map.height, pixels })?;
    describe(path, &picture, "scale", map)
}

/// The same as a PGM picture in map_server's mode `raw`: percentages, and 255 where nothing is known.
///
/// # Errors
/// When a file cannot be written.
pub fn write_raw_map(path: &Path, map: &Raster<Option<f64>>) -> Result<(), WriteError> {
    let level = |probability: &Option<f64>| probability.map_or(255, |probability| (100.0 * probability).round() as u8);
    let levels: Vec<u8> = map.cells.iter().map(level).collect();
    let picture = path.with_extension("pgm");
    replace_file(&picture, |file| write_pgm(file, map.width, map.height, &levels))?;
    describe(path, &picture, "raw", map)
}

/// Reads a map from its YAML file, or from its picture when the YAML file lies beside it under the same name.
///
/// Pictures may be PGM or PNG. As in `map_server`, a pixel's darkness (or, with `negate`, its brightness) is
/// the probability that the cell is occupied: above `occupied_thresh` it is, below `free_thresh` it is free,
/// all others are unknown. In the mode `trinary` opacity counts as one more channel; in the mode `scale`
/// what is not opaque is unknown; in the mode `raw` a pixel's level is a percentage, and beyond 100 unknown.
/// A map that is turned against the world's axes is drawn anew along them, each cell after the pixel in
/// which its centre lies.
///
/// # Errors
/// When a file cannot be read or does not hold what it should.
pub fn read_map(path: &Path) -> Result<Raster<Occupancy>, ReadError> {
    let is_picture = path.extension().is_some_and(|ending| ending == "pgm" || ending == "png");
    let path = if is_picture { path.with_extension("yaml") } else { path.to_path_buf() };
    let text = read_text(&path)?;
    parse_map(&path, &text, read_regular)
}

/// A map out of its description, the text of the YAML file at `path`; `picture` gives the bytes of the picture that it names.
///
/// # Errors
/// As [`read_map`]; whatever `picture` says.
pub fn parse_map(
    path: &Path,
    description: &str,
    picture: impl FnOnce(&Path) -> Result<Vec<u8>, ReadError>,
) -> Result<Raster<Occupancy>, ReadError> {
    let description = Description::parse(path, description)?;
    let picture_path = path.with_file_name(&description.image);
    let bytes = picture(&picture_path)?;
    let (width, height, cells) = description
        .cells(&bytes)
        .map_err(|found| Problem::new(&picture_path, found).expected("a whole picture (PGM or PNG)"))?;
    let [x_m, y_m, yaw_rad] = description.origin;
    let map = Raster { width, height, resolution_m: description.resolution, origin_m: [x_m, y_m], cells };
    if yaw_rad == 0.0 { Ok(map) } else { Ok(turned(&map, yaw_rad)) }
}

/// What a map's YAML file says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Description {
    /// File name of the picture.
    image: String,
    /// Side of a pixel, metres.
    resolution: f64,
    /// Place of the lower left corner and direction of the rows, metres and radians.
    origin: [f64; 3],
    /// Whether white is occupied.
    #[serde(default)]
    negate: Negate,
    #[serde(default)]
    mode: Mode,
    #[serde(default = "usual_occupied")]
    occupied_thresh: f64,
    #[serde(default = "usual_free")]
    free_thresh: f64,
}

fn usual_occupied() -> f64 {
    OCCUPIED_THRESHOLD
}

fn usual_free() -> f64 {
    FREE_THRESHOLD
}

/// 0 or 1 in older files, false or true in newer ones.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(untagged)]
enum Negate {
    Word(bool),
    Number(u8),
}

impl Default for Negate {
    fn default() -> Self {
        Self::Word(false)
    }
}

/// What pixels mean.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Mode {
    #[default]
    Trinary,
    Scale,
    Raw,
}

impl Description {
    fn parse(path: &Path, text: &str) -> Result<Self, ReadError> {
        let description: Self = serde_saphyr::from_str(text).map_err(|error| {
            let error = error.without_snippet();
            let problem = Problem::new(path, error.to_string()).expected("a map's YAML file (ROS map_server)");
            match error.location() {
                Some(location) => problem.at(format!("line {}", location.line())),
                None => problem,
            }
        })?;
        let wrong = |key: &str, found: String, expected: &str| Problem::new(path, found).at(key).expected(expected);
        if !(description.resolution > 0.0 && description.resolution.is_finite()) {
            let found = description.resolution.to_string();
            return Err(wrong("resolution", found, "metres per cell, more than 0").into());
        }
        if !description.origin.iter().all(|value| value.is_finite()) {
            let found = format!("{:?}", description.origin);
            return Err(wrong("origin", found, "[x, y, yaw] in metres and radians").into());
        }
        Ok(description)
    }

    /// Width, height and cells of the map that the bytes of a picture show.
    fn cells(&self, bytes: &[u8]) -> Result<(usize, usize, Vec<Occupancy>), String> {
        if !bytes.starts_with(b"\x89PNG") {
            let picture = parse_pgm(bytes)?;
            let white = f64::from(picture.white);
            let cells = picture.levels.iter().map(|&level| self.occupancy(f64::from(level), white, true)).collect();
            return Ok((picture.width, picture.height, cells));
        }
        let picture = decode_png(bytes)?;
        let mean = |levels: &[u8]| levels.iter().map(|&level| f64::from(level)).sum::<f64>() / levels.len() as f64;
        let cells = match &picture.pixels {
            Pixels::Gray8(gray) => gray.iter().map(|&level| self.occupancy(f64::from(level), 255.0, true)).collect(),
            Pixels::Gray16(gray) => gray.iter().map(|&level| self.occupancy(f64::from(level), 65535.0, true)).collect(),
            Pixels::Rgb8(rgb) => rgb.iter().map(|rgb| self.occupancy(mean(rgb), 255.0, true)).collect(),
            Pixels::Rgba8(rgba) if self.mode == Mode::Trinary => {
                rgba.iter().map(|rgba| self.occupancy(mean(rgba), 255.0, true)).collect()
            }
            Pixels::Rgba8(rgba) => {
                rgba.iter().map(|[rgb @ .., opacity]| self.occupancy(mean(rgb), 255.0, *opacity == 255)).collect()
            }
        };
        Ok((picture.width, picture.height, cells))
    }

    /// What a pixel of a level from 0 (black) to `white` says.
    fn occupancy(&self, level: f64, white: f64, is_opaque: bool) -> Occupancy {
        let negate = matches!(self.negate, Negate::Word(true) | Negate::Number(1..));
        // Divided last, as `map_server` does it: what is at a threshold must not be off by a last digit.
        let dark = if negate { level } else { white - level };
        let probability = match self.mode {
            Mode::Raw => ((white - dark) / white * 255.0).round() / 100.0,
            _ => dark / white,
        };
        let is_unknown = match self.mode {
            Mode::Trinary => false,
            Mode::Scale => !is_opaque,
            Mode::Raw => probability > 1.0,
        };
        if is_unknown {
            Occupancy::Unknown
        } else if probability > self.occupied_thresh {
            Occupancy::Occupied
        } else if probability < self.free_thresh {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }
}

/// The map along the world's axes of one whose rows point in the direction `yaw_rad` from its origin.
fn turned(map: &Raster<Occupancy>, yaw_rad: f64) -> Raster<Occupancy> {
    let Raster { width, height, resolution_m, origin_m, cells } = map;
    let (sin, cos) = yaw_rad.sin_cos();
    let size_m = [*width as f64 * resolution_m, *height as f64 * resolution_m];
    let corners_m =
        [[0.0, 0.0], [size_m[0], 0.0], [0.0, size_m[1]], size_m].map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]);
    let low_m = [0, 1].map(|axis| corners_m.iter().map(|corner_m| corner_m[axis]).fold(f64::INFINITY, f64::min));
    let high_m = [0, 1].map(|axis| corners_m.iter().map(|corner_m| corner_m[axis]).fold(f64::NEG_INFINITY, f64::max));
    // A turn by a right angle must not add a row for the last digit.
    let [columns, rows] =
        [0, 1].map(|axis| ((high_m[axis] - low_m[axis]) / resolution_m - 1e-6).ceil().max(1.0) as usize);
    let cell = |row: usize, column: usize| {
        let (x_m, y_m) = (
            low_m[0] + (column as f64 + 0.5) * resolution_m,
            low_m[1] + ((rows - 1 - row) as f64 + 0.5) * resolution_m,
        );
        let (along, up) = ((cos * x_m + sin * y_m) / resolution_m, (cos * y_m - sin * x_m) / resolution_m);
        let is_inside = (0.0..*width as f64).contains(&along) && (0.0..*height as f64).contains(&up);
        if is_inside { cells[(height - 1 - up as usize) * width + along as usize] } else { Occupancy::Unknown }
    };
    Raster {
        width: columns,
        height: rows,
        resolution_m: *resolution_m,
        origin_m: [origin_m[0] + low_m[0], origin_m[1] + low_m[1]],
        cells: (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (row, column)))
            .map(|(row, column)| cell(row, column))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const TEXT: &str = "image: \"a.pgm\" # picture\nresolution: 0.05\norigin: [-7.5, 2, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";

    fn parse(text: &str) -> Result<Description, ReadError> {
        Description::parse(Path::new("map.yaml"), text)
    }

    #[test]
    fn a_description_may_be_written_in_any_way_that_yaml_knows() {
        let description = parse(TEXT).unwrap();
        assert_eq!((description.image.as_str(), description.resolution), ("a.pgm", 0.05));
        assert_eq!(description.origin, [-7.5, 2.0, 0.0]);
        for (from, to) in [
            ("[-7.5, 2, 0.0]", "\n- -7.5\n- 2\n- 0\n"),
            ("[-7.5, 2, 0.0]", "[-7.5, # x\n  2,\n  0.0] # yaw"),
            ("origin", "\"origin\""),
            ("image", "'image'"),
            ("0.05", "5e-2"),
            ("negate: 0\n", "negate: 0\nmode: trinary\nauthor: {name: someone, year: 2020}\n"),
        ] {
            assert_eq!(parse(&TEXT.replace(from, to)).unwrap(), description, "{to}");
        }
        let flow = "{image: a.pgm, resolution: 0.05, origin: [-7.5, 2, 0], negate: 0}";
        assert_eq!(parse(flow).unwrap(), description);
        assert_eq!(
            parse(&TEXT.replace("negate: 0", "negate: false")).unwrap().occupancy(255.0, 255.0, true),
            Occupancy::Free
        );
    }

    #[test]
    fn pixels_mean_what_map_server_takes_them_for() {
        use Occupancy::{Free, Occupied, Unknown};
        let levels = |text: &str, levels: [f64; 3]| {
            let description = parse(text).unwrap();
            levels.map(|level| description.occupancy(level, 255.0, true))
        };
        assert_eq!(levels(TEXT, [0.0, 205.0, 254.0]), [Occupied, Unknown, Free]);
        assert_eq!(levels(&TEXT.replace("negate: 0", "negate: 1"), [0.0, 50.0, 255.0]), [Free, Unknown, Occupied]);
        assert_eq!(levels(&TEXT.replace("negate: 0", "negate: true"), [0.0, 50.0, 255.0]), [Free, Unknown, Occupied]);
        let raw = format!("{TEXT}mode: raw\n");
        assert_eq!(levels(&raw, [0.0, 100.0, 255.0]), [Free, Occupied, Unknown]);
        assert_eq!(levels(&raw, [19.0, 65.0, 101.0]), [Free, Unknown, Unknown]);
        // At a threshold a cell is neither.
        let at = TEXT.replace("0.65", "0.8").replace("0.196", "0.2");
        assert_eq!(levels(&at, [51.0, 50.0, 204.0]), [Unknown, Occupied, Unknown]);
        let scale = parse(&format!("{TEXT}mode: scale\n")).unwrap();
        assert_eq!([true, false].map(|is_opaque| scale.occupancy(0.0, 255.0, is_opaque)), [Occupied, Unknown]);
    }

    #[test]
    fn opacity_counts_as_a_channel_in_trinary_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.yaml");
        let rgba = vec![[0, 0, 0, 255], [255, 255, 255, 0], [255; 4]];
        let picture = crate::Picture { width: 3, height: 1, pixels: Pixels::Rgba8(rgba) };
        crate::write_png(&folder.path().join("map.png"), &picture).unwrap();
        let cells = |mode: &str| {
            fs::write(&path, format!("image: map.png\nresolution: 1\norigin: [0, 0, 0]\nmode: {mode}\n")).unwrap();
            read_map(&path).unwrap().cells
        };
        assert_eq!(cells("trinary"), [Occupancy::Occupied, Occupancy::Unknown, Occupancy::Free]);
        assert_eq!(cells("scale"), [Occupancy::Occupied, Occupancy::Unknown, Occupancy::Free]);
    }

    #[test]
    fn a_turned_map_is_drawn_along_the_axes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.yaml");
        // Free left of occupied; a quarter turn puts the occupied one above.
        fs::write(folder.path().join("a.pgm"), b"P5\n2 1\n255\n\xfe\x00").unwrap();
        fs::write(&path, "image: a.pgm\nresolution: 0.5\norigin: [1, 2, 1.5707963267948966]\n").unwrap();
        let map = read_map(&path).unwrap();
        assert_eq!((map.width, map.height), (1, 2));
        assert_eq!(map.cells, [Occupancy::Occupied, Occupancy::Free]);
        assert!((map.origin_m[0] - 0.5).abs() < 1e-9 && (map.origin_m[1] - 2.0).abs() < 1e-9, "{:?}", map.origin_m);
        // What lies where does not depend on how far the map is turned.
        fs::write(&path, "image: a.pgm\nresolution: 0.5\norigin: [1, 2, 0.6]\n").unwrap();
        let map = read_map(&path).unwrap();
        let at = |x_m: f64, y_m: f64| {
            let (column, up) = ((x_m - map.origin_m[0]) / 0.5, (y_m - map.origin_m[1]) / 0.5);
            map.cells[(map.height - 1 - up as usize) * map.width + column as usize]
        };
        let (sin, cos) = 0.6_f64.sin_cos();
        assert_eq!(at(1.0 + 0.75 * cos - 0.25 * sin, 2.0 + 0.75 * sin + 0.25 * cos), Occupancy::Occupied);
        assert_eq!(at(1.0 + 0.25 * cos - 0.25 * sin, 2.0 + 0.25 * sin + 0.25 * cos), Occupancy::Free);
    }

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        for (from, to, found) in [
            ("resolution: 0.05", "resolution: 0", "resolution"),
            ("resolution: 0.05", "resolution: fine", "line 2"),
            ("[-7.5, 2, 0.0]", "[.nan, 2, 1.0]", "origin"),
            ("[-7.5, 2, 0.0]", "[2, 1.0]", "line 3"),
            ("[-7.5, 2, 0.0]", "", "line 3"),
            ("image", "picture", "image"),
            ("negate: 0", "mode: dim", "dim"),
            ("negate: 0", "negate: [", "line"),
        ] {
            let message = parse(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(found), "{to}: {message}");
        }
    }
}
