//! Images of a drive, read when they are asked for.

use crate::error::{Problem, ReadError};
use crate::format::RecordedImages;
use crate::picture;
use floorprint::sensors::{ColorImage, DepthImage};
use floorprint::texture::ImagePair;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What any image of a camera may take in memory, bytes: 20 megapixels in colour.
pub(crate) const IMAGE_BYTES: f64 = 64e6;

/// Where the images of a drive lie and when they were taken.
///
/// Colour and depth were not taken at the same moments: pair them by time.
#[derive(Debug, Clone, Default)]
pub struct ImageIndex {
    /// Depth images by time.
    pub depth: Vec<ImageEntry>,
    /// Colour images by time.
    pub color: Vec<ImageEntry>,
    /// Where those of a recording are.
    pub(crate) recorded: Option<RecordedImages>,
}

/// One image that has not been read yet.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageEntry {
    /// When it was taken, seconds.
    pub stamp_s: f64,
    /// Where it is.
    pub(crate) place: ImagePlace,
}

/// Where an image is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ImagePlace {
    /// In a file, which may take so many times its size in memory, besides 64 MB.
    File { path: PathBuf, max_expansion: f64 },
    /// A message of its topic, counted from 0.
    Message(usize),
}

/// A depth and a colour image, or why there are none.
pub type LoadedPair = Result<(DepthImage, ColorImage), ReadError>;

impl ImageIndex {
    /// Reads pairs of images and gives each to `take`, on all threads; what comes of them stands in the pairs' order.
    ///
    /// Only a few images are in memory at a time. Once `stop` says so, no more are read.
    pub fn for_each_pair<T: Send>(
        &self,
        pairs: &[ImagePair],
        stop: &(dyn Fn() -> bool + Sync),
        take: &(dyn Fn(LoadedPair) -> T + Sync),
    ) -> Vec<T> {
        if let Some(recorded) = &self.recorded {
            return recorded.for_each_pair(self, pairs, stop, take);
        }
        let load = |pair: &ImagePair| Ok((self.depth[pair.depth].load_depth()?, self.color[pair.color].load_color()?));
        pairs.par_iter().filter(|_| !stop()).map(|pair| take(load(pair))).collect()
    }
}

impl ImageEntry {
    /// The image in a file.
    pub(crate) fn in_file(stamp_s: f64, path: PathBuf, max_expansion: f64) -> Self {
        Self { stamp_s, place: ImagePlace::File { path, max_expansion } }
    }

    fn load(&self) -> Result<(&Path, picture::Picture), ReadError> {
        match &self.place {
            ImagePlace::File { path, max_expansion } => {
                Ok((path, picture::read_png_within(path, IMAGE_BYTES, *max_expansion)?))
            }
            ImagePlace::Message(_) => {
                Err(Problem::new(Path::new("recording"), "an image among its messages, which are read in order").into())
            }
        }
    }

    /// Reads the image as raw depths or disparities: a PNG with one channel of 16 bits.
    ///
    /// # Errors
    /// When it is no file of its own, or the file is missing, damaged, or a picture of another kind.
    pub fn load_depth(&self) -> Result<DepthImage, ReadError> {
        let (path, image) = self.load()?;
        let picture::Pixels::Gray16(values) = image.pixels else {
            return Err(Problem::new(path, format!("a picture of {}", image.pixels.kind()))
                .expected("a disparity image: one channel of 16 bits")
                .into());
        };
        Ok(DepthImage { stamp_s: self.stamp_s, width: image.width, height: image.height, values })
    }

    /// Reads the image as colours: a PNG with 8 bits a channel.
    ///
    /// # Errors
    /// When it is no file of its own, or the file is missing, damaged, or a picture of another kind.
    pub fn load_color(&self) -> Result<ColorImage, ReadError> {
        let (path, image) = self.load()?;
        let (width, height) = (image.width, image.height);
        let rgb = image.pixels.into_rgb().map_err(|kind| {
            Problem::new(path, format!("a picture of {kind}")).expected("a colour image with 8 bits a channel")
        })?;
        Ok(ColorImage { stamp_s: self.stamp_s, width, height, rgb })
    }
}
