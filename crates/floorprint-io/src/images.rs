//! Images of a drive, read when they are asked for.

use crate::error::{Problem, ReadError};
use crate::picture;
use floorprint::sensors::{ColorImage, DisparityImage};
use std::path::PathBuf;

/// What any image of a camera may take in memory, bytes: 20 megapixels in colour.
const IMAGE_BYTES: f64 = 64e6;

/// Where the images of a drive lie and when they were taken.
///
/// Colour and disparity were not taken at the same moments: pair them by time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImageIndex {
    /// Disparity images by time.
    pub disparity: Vec<ImageEntry>,
    /// Colour images by time.
    pub color: Vec<ImageEntry>,
}

/// One image that has not been read yet.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageEntry {
    /// When it was taken, seconds.
    pub stamp_s: f64,
    /// Where it lies.
    pub path: PathBuf,
    /// How many times its size on disk it may take in memory, besides 64 MB.
    pub max_expansion: f64,
}

impl ImageEntry {
    /// Reads the image as raw disparities: a PNG with one channel of 16 bits.
    ///
    /// # Errors
    /// When the file is missing, damaged, or a picture of another kind.
    pub fn load_disparity(&self) -> Result<DisparityImage, ReadError> {
        let image = picture::read_png_within(&self.path, IMAGE_BYTES, self.max_expansion)?;
        let picture::Pixels::Gray16(disparity) = image.pixels else {
            return Err(Problem::new(&self.path, format!("a picture of {}", image.pixels.kind()))
                .expected("a disparity image: one channel of 16 bits")
                .into());
        };
        Ok(DisparityImage { stamp_s: self.stamp_s, width: image.width, height: image.height, disparity })
    }

    /// Reads the image as colours: a PNG with 8 bits a channel.
    ///
    /// # Errors
    /// When the file is missing, damaged, or a picture of another kind.
    pub fn load_color(&self) -> Result<ColorImage, ReadError> {
        let image = picture::read_png_within(&self.path, IMAGE_BYTES, self.max_expansion)?;
        let rgb = match image.pixels {
            picture::Pixels::Rgb8(rgb) => rgb,
            picture::Pixels::Gray8(gray) => gray.into_iter().map(|value| [value; 3]).collect(),
            picture::Pixels::Rgba8(rgba) => rgba.into_iter().map(|[r, g, b, _]| [r, g, b]).collect(),
            pixels @ picture::Pixels::Gray16(_) => {
                return Err(Problem::new(&self.path, format!("a picture of {}", pixels.kind()))
                    .expected("a colour image with 8 bits a channel")
                    .into());
            }
        };
        Ok(ColorImage { stamp_s: self.stamp_s, width: image.width, height: image.height, rgb })
    }
}
