//! Pictures and animated pictures as PNG files.

use crate::budget::USUAL_EXPANSION;
use crate::error::{Problem, ReadError, WriteError};
use crate::regular_file::read_regular;
use crate::replace::replace_file;
use png::{BitDepth, ColorType, Transformations};
use std::io::{self, Cursor, Write};
use std::path::Path;

/// What any picture that the user names may take in memory, bytes: a floor or a map of some hundred megapixels.
const PICTURE_BYTES: f64 = 512e6;

/// A picture, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One value per pixel.
    pub pixels: Pixels,
}

/// The pixels of a picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pixels {
    /// Grey levels.
    Gray8(Vec<u8>),
    /// Grey levels, or measurements, of 16 bits.
    Gray16(Vec<u16>),
    /// Red, green and blue.
    Rgb8(Vec<[u8; 3]>),
    /// Red, green, blue and opacity.
    Rgba8(Vec<[u8; 4]>),
}

impl Pixels {
    /// Number of pixels.
    fn len(&self) -> usize {
        match self {
            Self::Gray8(gray) => gray.len(),
            Self::Gray16(gray) => gray.len(),
            Self::Rgb8(rgb) => rgb.len(),
            Self::Rgba8(rgba) => rgba.len(),
        }
    }

    /// What they are, for messages.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Gray8(_) => "grey levels of 8 bits",
            Self::Gray16(_) => "grey levels of 16 bits",
            Self::Rgb8(_) => "colours with 8 bits a channel",
            Self::Rgba8(_) => "colours with opacity",
        }
    }

    /// As colours without opacity; the error says what pixels of 16 bits are.
    pub(crate) fn into_rgb(self) -> Result<Vec<[u8; 3]>, &'static str> {
        Ok(match self {
            Self::Rgb8(rgb) => rgb,
            Self::Gray8(gray) => gray.into_iter().map(|value| [value; 3]).collect(),
            Self::Rgba8(rgba) => rgba.into_iter().map(|[r, g, b, _]| [r, g, b]).collect(),
            Self::Gray16(_) => return Err(self.kind()),
        })
    }

    fn color_type(&self) -> (ColorType, BitDepth) {
        match self {
            Self::Gray8(_) => (ColorType::Grayscale, BitDepth::Eight),
            Self::Gray16(_) => (ColorType::Grayscale, BitDepth::Sixteen),
            Self::Rgb8(_) => (ColorType::Rgb, BitDepth::Eight),
            Self::Rgba8(_) => (ColorType::Rgba, BitDepth::Eight),
        }
    }

    fn bytes(&self) -> std::borrow::Cow<'_, [u8]> {
        match self {
            Self::Gray8(gray) => gray.into(),
            Self::Gray16(gray) => gray.iter().flat_map(|value| value.to_be_bytes()).collect(),
            Self::Rgb8(rgb) => rgb.as_flattened().into(),
            Self::Rgba8(rgba) => rgba.as_flattened().into(),
        }
    }
}

/// Reads a PNG file; palettes and small bit depths are unfolded.
///
/// # Errors
/// When the file cannot be read or is no whole PNG picture.
pub fn read_png(path: &Path) -> Result<Picture, ReadError> {
    read_png_within(path, PICTURE_BYTES, USUAL_EXPANSION)
}

/// Reads a PNG file that takes at most `free_bytes` and `max_expansion` times its size in memory.
pub(crate) fn read_png_within(path: &Path, free_bytes: f64, max_expansion: f64) -> Result<Picture, ReadError> {
    let bytes = read_regular(path)?;
    decode_within(&bytes, free_bytes, max_expansion)
        .map_err(|found| Problem::new(path, found).expected("a whole PNG picture").into())
}

/// Decodes a PNG file's bytes; the error says what was found instead.
pub(crate) fn decode_png(bytes: &[u8]) -> Result<Picture, String> {
    decode_within(bytes, PICTURE_BYTES, USUAL_EXPANSION)
}

pub(crate) fn decode_within(bytes: &[u8], free_bytes: f64, max_expansion: f64) -> Result<Picture, String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let size = reader
        .output_buffer_size()
        .filter(|&size| size as f64 <= free_bytes + max_expansion * bytes.len() as f64)
        .ok_or_else(|| format!("{width}×{height} pixels announced in {} bytes", bytes.len()))?;
    let mut buffer = vec![0; size];
    let info = reader.next_frame(&mut buffer).map_err(|error| error.to_string())?;
    let pixels = match (info.color_type, info.bit_depth) {
        (ColorType::Grayscale, BitDepth::Eight) => Pixels::Gray8(buffer),
        (ColorType::Grayscale, BitDepth::Sixteen) => {
            Pixels::Gray16(buffer.as_chunks().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect())
        }
        (ColorType::GrayscaleAlpha, BitDepth::Eight) => {
            Pixels::Rgba8(buffer.as_chunks().0.iter().map(|&[gray, opacity]| [gray, gray, gray, opacity]).collect())
        }
        (ColorType::Rgb, BitDepth::Eight) => Pixels::Rgb8(buffer.as_chunks().0.to_vec()),
        (ColorType::Rgba, BitDepth::Eight) => Pixels::Rgba8(buffer.as_chunks().0.to_vec()),
        (color, depth) => return Err(format!("{color:?} with {} bits a channel", depth as u8)),
    };
    Ok(Picture { width, height, pixels })
}

/// A picture as the bytes of a PNG file.
///
/// # Errors
/// It has no pixels, or more than a PNG file can hold.
pub fn png_bytes(picture: &Picture) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    encode_png(&mut bytes, picture, std::slice::from_ref(picture), 0.0)?;
    Ok(bytes)
}

/// Writes a picture as a PNG file.
///
/// # Errors
/// When the file cannot be written, or the picture has no pixels.
pub fn write_png(path: &Path, picture: &Picture) -> Result<(), WriteError> {
    write_animated_png(path, std::slice::from_ref(picture), 0.0)
}

/// Writes pictures of the same size and kind as an animated PNG file that shows each for
/// `frame_s` seconds and starts over at the end.
///
/// # Errors
/// When the file cannot be written, there is no picture, or they differ in size or kind.
pub fn write_animated_png(path: &Path, frames: &[Picture], frame_s: f64) -> Result<(), WriteError> {
    let Some(first) = frames.first() else {
        return Err(Problem::new(path, "no picture to write").into());
    };
    let alike = |frame: &Picture| {
        (frame.width, frame.height) == (first.width, first.height)
            && frame.pixels.color_type() == first.pixels.color_type()
            && frame.pixels.len() == frame.width * frame.height
    };
    if !frames.iter().all(alike) {
        return Err(Problem::new(path, "pictures that differ in size or kind").into());
    }
    replace_file(path, |file| encode_png(file, first, frames, frame_s).map_err(io::Error::from))
}

fn encode_png(
    file: &mut dyn Write,
    first: &Picture,
    frames: &[Picture],
    frame_s: f64,
) -> Result<(), png::EncodingError> {
    // A size beyond 32 bits becomes zero, which the encoder refuses.
    let length = |length: usize| u32::try_from(length).unwrap_or(0);
    let mut encoder = png::Encoder::new(file, length(first.width), length(first.height));
    let (color, depth) = first.pixels.color_type();
    encoder.set_color(color);
    encoder.set_depth(depth);
    if frames.len() > 1 {
        encoder.set_animated(length(frames.len()), 0)?;
        encoder.set_frame_delay((frame_s.clamp(0.0, 60.0) * 1000.0) as u16, 1000)?;
    }
    let mut writer = encoder.write_header()?;
    for frame in frames {
        writer.write_image_data(&frame.pixels.bytes())?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn encoded(frames: &[Picture]) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode_png(&mut bytes, &frames[0], frames, 0.5).unwrap();
        bytes
    }

    fn gradient() -> Picture {
        Picture { width: 7, height: 5, pixels: Pixels::Rgb8((0..35).map(|i| [i, 2 * i, 255 - i]).collect()) }
    }

    #[test]
    fn every_kind_of_picture_is_read_as_written() {
        let kinds = [
            Pixels::Gray8((0..35).collect()),
            Pixels::Gray16((0..35).map(|i| 2047 - i).collect()),
            Pixels::Rgba8((0..35).map(|i| [i, 1, 2, 255 - i]).collect()),
            gradient().pixels,
        ];
        for pixels in kinds {
            let picture = Picture { pixels, ..gradient() };
            assert_eq!(decode_png(&encoded(std::slice::from_ref(&picture))).unwrap(), picture);
        }
    }

    #[test]
    fn an_animation_begins_with_its_first_picture() {
        let second = Picture { pixels: Pixels::Rgb8(vec![[9; 3]; 35]), ..gradient() };
        let bytes = encoded(&[gradient(), second]);
        assert!(bytes.windows(4).any(|name| name == b"acTL"));
        assert_eq!(decode_png(&bytes).unwrap(), gradient());
    }

    #[test]
    fn a_header_that_lies_about_the_size_costs_no_memory() {
        let mut bytes = encoded(&[gradient()]);
        bytes[16..24].copy_from_slice(&[0, 1, 0x80, 0, 0, 1, 0x80, 0]);
        assert!(decode_png(&bytes).is_err());
        // As large as the file is small: nothing but its rows of zeros.
        bytes[16..24].copy_from_slice(&[0, 0, 0x75, 0x30, 0, 0, 0x75, 0x30]);
        let mut checksum = flate2::Crc::new();
        checksum.update(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.sum().to_be_bytes());
        assert!(decode_within(&bytes, 64e6, USUAL_EXPANSION).unwrap_err().contains("30000×30000 pixels"));
    }

    proptest! {
        #[test]
        fn damaged_pictures_are_errors_or_pictures(position in 0..120_usize, byte in any::<u8>(), cut in 0..120_usize) {
            let mut bytes = encoded(&[gradient()]);
            let position = position % bytes.len();
            bytes[position] = byte;
            bytes.truncate(bytes.len() - cut % 3 * cut % bytes.len());
            let _ = decode_png(&bytes);
        }
    }
}
