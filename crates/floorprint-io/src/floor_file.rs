//! The floor's colours: a PNG picture and a JSON file that says where it lies.
//!
//! As with maps, the origin is the world's x and y of the lower left corner of the lower left pixel.

use crate::error::{Problem, ReadError, WriteError};
use crate::picture::{Picture, Pixels, read_png, write_png};
use crate::regular_file::read_regular;
use crate::replace::write_file;
use floorprint::evaluation::FloorImage;
use floorprint::map::Raster;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// In opaque pictures this colour means that there is no floor.
const NO_FLOOR: [u8; 3] = [110; 3];

/// What the JSON file says.
#[derive(Serialize, Deserialize)]
struct Description {
    /// The picture's file name.
    image: String,
    /// Side of a pixel, metres.
    resolution: f64,
    /// x and y in metres, and a yaw that must be zero.
    origin: [f64; 3],
}

/// Writes `floor` as the PNG picture at `path`, transparent where the floor was not seen, and the
/// JSON file of the same name beside it.
///
/// # Errors
/// When a file cannot be written, or the floor has no cells.
pub fn write_floor(path: &Path, floor: &FloorImage) -> Result<(), WriteError> {
    write_png(path, &floor_picture(floor))?;
    let description = Description {
        image: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        resolution: floor.resolution_m,
        origin: [floor.origin_m[0], floor.origin_m[1], 0.0],
    };
    let text = serde_json::to_string_pretty(&description).map_err(|error| Problem::new(path, error.to_string()))?;
    write_file(&path.with_extension("json"), (text + "\n").as_bytes())
}

/// The floor as a picture, transparent where it was not seen.
#[must_use]
pub fn floor_picture(floor: &FloorImage) -> Picture {
    let rgba = floor.cells.iter().map(|cell| cell.map_or([0; 4], |[r, g, b]| [r, g, b, 255])).collect();
    Picture { width: floor.width, height: floor.height, pixels: Pixels::Rgba8(rgba) }
}

/// Reads a floor from its JSON file, or from its picture when the JSON file lies beside it under the same name.
///
/// There is no floor where the picture is transparent, or, in a picture without opacity, where it is
/// grey with a level of 110.
///
/// # Errors
/// When a file cannot be read or does not hold what it should.
pub fn read_floor(path: &Path) -> Result<FloorImage, ReadError> {
    let path = path.with_extension("json");
    let text = read_regular(&path)?;
    let description: Description = serde_json::from_slice(&text).map_err(|error| {
        Problem::new(&path, error.to_string()).expected("the image, resolution and origin of a floor's picture")
    })?;
    let Description { image, resolution, origin: [x_m, y_m, yaw] } = description;
    if !(resolution > 0.0 && resolution.is_finite() && yaw == 0.0) {
        return Err(Problem::new(&path, format!("a resolution of {resolution} m and a yaw of {yaw}"))
            .expected("metres per pixel, more than 0, and yaw 0")
            .into());
    }
    let picture_path = path.with_file_name(image);
    let picture = read_png(&picture_path)?;
    let cells = match picture.pixels {
        Pixels::Rgba8(rgba) => rgba.into_iter().map(|[r, g, b, opacity]| (opacity > 0).then_some([r, g, b])).collect(),
        Pixels::Rgb8(rgb) => rgb.into_iter().map(|rgb| (rgb != NO_FLOOR).then_some(rgb)).collect(),
        pixels => {
            return Err(Problem::new(&picture_path, format!("a picture of {}", pixels.kind()))
                .expected("a colour picture")
                .into());
        }
    };
    Ok(Raster { width: picture.width, height: picture.height, resolution_m: resolution, origin_m: [x_m, y_m], cells })
}
