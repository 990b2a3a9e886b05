//! Occupancy maps as ROS's `map_server` keeps them: a picture and a YAML file that says what it shows.
//!
//! Source: the ROS wiki, `map_server`, "Map format".

use crate::error::{Problem, ReadError, WriteError};
use crate::number::parse_f64;
use crate::pgm::{parse_pgm, write_pgm};
use crate::picture::{Pixels, decode_png};
use crate::replace::replace_file;
use floorprint::map::{Occupancy, Raster};
use std::fs;
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
    let levels: Vec<u8> = map
        .cells
        .iter()
        .map(|cell| match cell {
            Occupancy::Occupied => 0,
            Occupancy::Unknown => 205,
            Occupancy::Free => 254,
        })
        .collect();
    let picture = path.with_extension("pgm");
    replace_file(&picture, |file| write_pgm(file, map.width, map.height, &levels))?;
    let [x_m, y_m] = map.origin_m;
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    replace_file(path, |file| {
        writeln!(file, "image: {name}\nmode: trinary\nresolution: {}", map.resolution_m)?;
        writeln!(file, "origin: [{x_m}, {y_m}, 0]\nnegate: 0")?;
        writeln!(file, "occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}")
    })
}

/// Reads a map from its YAML file, or from its picture when the YAML file lies beside it under the same name.
///
/// The modes `trinary` and `scale` tell occupied and free cells by the file's thresholds, `raw` takes
/// the pixels for percentages; what lies between the thresholds is unknown. Pictures may be PGM or PNG.
///
/// # Errors
/// When a file cannot be read or does not hold what it should, and for maps that are turned against the world's axes.
pub fn read_map(path: &Path) -> Result<Raster<Occupancy>, ReadError> {
    let is_picture = path.extension().is_some_and(|ending| ending == "pgm" || ending == "png");
    let path = if is_picture { path.with_extension("yaml") } else { path.to_path_buf() };
    let text = fs::read_to_string(&path).map_err(|error| ReadError::io(&path, &error))?;
    let description = Description::parse(&path, &text)?;
    let picture_path = path.with_file_name(&description.image);
    let bytes = fs::read(&picture_path).map_err(|error| ReadError::io(&picture_path, &error))?;
    let picture =
        decode(&bytes).map_err(|found| Problem::new(&picture_path, found).expected("a whole picture (PGM or PNG)"))?;
    Ok(Raster {
        width: picture.width,
        height: picture.height,
        resolution_m: description.resolution_m,
        origin_m: description.origin_m,
        cells: picture.brightness.iter().map(|&brightness| description.occupancy(brightness)).collect(),
    })
}

/// A picture's pixels: what share of white and how opaque each is.
struct Brightness {
    width: usize,
    height: usize,
    /// From 0 (black) to 1 (white); none where the picture is transparent.
    brightness: Vec<Option<f64>>,
}

fn decode(bytes: &[u8]) -> Result<Brightness, String> {
    if !bytes.starts_with(b"\x89PNG") {
        let picture = parse_pgm(bytes)?;
        let white = f64::from(picture.white);
        let brightness = picture.levels.iter().map(|&level| Some(f64::from(level) / white)).collect();
        return Ok(Brightness { width: picture.width, height: picture.height, brightness });
    }
    let picture = decode_png(bytes)?;
    let mean = |rgb: &[u8]| rgb.iter().map(|&channel| f64::from(channel)).sum::<f64>() / (rgb.len() as f64 * 255.0);
    let brightness = match &picture.pixels {
        Pixels::Gray8(gray) => gray.iter().map(|&level| Some(f64::from(level) / 255.0)).collect(),
        Pixels::Gray16(gray) => gray.iter().map(|&level| Some(f64::from(level) / 65535.0)).collect(),
        Pixels::Rgb8(rgb) => rgb.iter().map(|rgb| Some(mean(rgb))).collect(),
        Pixels::Rgba8(rgba) => rgba.iter().map(|[rgb @ .., opacity]| (*opacity > 0).then(|| mean(rgb))).collect(),
    };
    Ok(Brightness { width: picture.width, height: picture.height, brightness })
}

/// What a map's YAML file says.
#[derive(Debug, PartialEq)]
struct Description {
    image: String,
    resolution_m: f64,
    origin_m: [f64; 2],
    /// Whether white is occupied.
    negate: bool,
    /// Whether pixels are percentages.
    raw: bool,
    occupied_threshold: f64,
    free_threshold: f64,
}

impl Description {
    fn parse(path: &Path, text: &str) -> Result<Self, ReadError> {
        let value = |key: &str| {
            text.lines().enumerate().find_map(|(index, line)| {
                let value = line.strip_prefix(key)?.trim_start().strip_prefix(':')?;
                let value = value.split(" #").next().unwrap_or_default().trim();
                Some((index, value.trim_matches(|quote| quote == '"' || quote == '\'')))
            })
        };
        let required = |key: &str| {
            value(key)
                .ok_or_else(|| Problem::new(path, format!("no {key}")).expected("a map's YAML file (ROS map_server)"))
        };
        let wrong = |key: &str, (index, found): (usize, &str), expected: &str| {
            Problem::new(path, format!("\"{found}\"")).at(format!("line {}, {key}", index + 1)).expected(expected)
        };
        let number = |key: &str, entry: (usize, &str)| {
            parse_f64(entry.1.as_bytes()).filter(|value| value.is_finite()).ok_or_else(|| wrong(key, entry, "a number"))
        };
        let optional = |key: &str, otherwise: f64| value(key).map_or(Ok(otherwise), |entry| number(key, entry));

        let resolution = required("resolution")?;
        let resolution_m = number("resolution", resolution)?;
        if resolution_m <= 0.0 {
            return Err(wrong("resolution", resolution, "metres per cell, more than 0").into());
        }
        let origin = required("origin")?;
        let numbers: Option<Vec<f64>> =
            flow_list(text, origin).map(|item| parse_f64(item.as_bytes()).filter(|value| value.is_finite())).collect();
        let origin_m = match numbers.as_deref() {
            Some(&[x_m, y_m, 0.0]) => [x_m, y_m],
            Some(&[_, _, _]) => return Err(wrong("origin", origin, "a map along the world's axes (yaw 0)").into()),
            _ => return Err(wrong("origin", origin, "[x, y, yaw] in metres and radians").into()),
        };
        Ok(Self {
            image: required("image")?.1.to_owned(),
            resolution_m,
            origin_m,
            negate: value("negate").is_some_and(|(_, value)| value == "1" || value == "true"),
            raw: value("mode").is_some_and(|(_, mode)| mode == "raw"),
            occupied_threshold: optional("occupied_thresh", OCCUPIED_THRESHOLD)?,
            free_threshold: optional("free_thresh", FREE_THRESHOLD)?,
        })
    }

    fn occupancy(&self, brightness: Option<f64>) -> Occupancy {
        let Some(brightness) = brightness else { return Occupancy::Unknown };
        let probability = match (self.raw, self.negate) {
            (true, _) => brightness * 255.0 / 100.0,
            (false, true) => brightness,
            (false, false) => 1.0 - brightness,
        };
        if probability > 1.0 {
            // Beyond 100 per cent, raw maps mean "unknown".
            Occupancy::Unknown
        } else if probability > self.occupied_threshold {
            Occupancy::Occupied
        } else if probability < self.free_threshold {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }
}

/// The items of a YAML list, whether it stands in brackets behind its key or with dashes below it.
fn flow_list<'a>(text: &'a str, (index, value): (usize, &'a str)) -> impl Iterator<Item = &'a str> {
    let inline = value.strip_prefix('[').and_then(|value| value.strip_suffix(']'));
    let below = text.lines().skip(index + 1).map_while(|line| line.trim_start().strip_prefix("- ")).map(str::trim);
    inline
        .into_iter()
        .flat_map(|list| list.split(',').map(str::trim))
        .chain(inline.is_none().then_some(below).into_iter().flatten())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "image: \"a.pgm\" # picture\nresolution: 0.05\norigin: [-7.5, 2, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";

    fn parse(text: &str) -> Result<Description, ReadError> {
        Description::parse(Path::new("map.yaml"), text)
    }

    #[test]
    fn a_description_is_understood() {
        let description = parse(TEXT).unwrap();
        assert_eq!((description.image.as_str(), description.resolution_m), ("a.pgm", 0.05));
        assert_eq!(description.origin_m, [-7.5, 2.0]);
        assert_eq!(parse(&TEXT.replace("[-7.5, 2, 0.0]", "\n- -7.5\n  - 2\n- 0\n")).unwrap(), description);
        let levels = |level: f64| description.occupancy(Some(level / 255.0));
        assert_eq!(
            [levels(0.0), levels(205.0), levels(254.0)],
            [Occupancy::Occupied, Occupancy::Unknown, Occupancy::Free]
        );
        assert_eq!(description.occupancy(None), Occupancy::Unknown);
    }

    #[test]
    fn negated_and_raw_maps_are_understood() {
        let negated = parse(&TEXT.replace("negate: 0", "negate: 1")).unwrap();
        assert_eq!(negated.occupancy(Some(1.0)), Occupancy::Occupied);
        let raw = parse(&format!("{TEXT}mode: raw\n")).unwrap();
        let levels = [0.0, 100.0, 255.0].map(|level| raw.occupancy(Some(level / 255.0)));
        assert_eq!(levels, [Occupancy::Free, Occupancy::Occupied, Occupancy::Unknown]);
    }

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        for (from, to, place) in [
            ("resolution: 0.05", "resolution: 0", "line 2, resolution"),
            ("resolution: 0.05", "resolution: fine", "line 2, resolution"),
            ("[-7.5, 2, 0.0]", "[-7.5, 2, 1.0]", "line 3, origin"),
            ("[-7.5, 2, 0.0]", "[nan, 2, 1.0]", "line 3, origin"),
            ("[-7.5, 2, 0.0]", "", "line 3, origin"),
            ("image", "picture", ""),
        ] {
            assert_eq!(parse(&TEXT.replace(from, to)).unwrap_err().problem().place, place, "{to}");
        }
    }
}
