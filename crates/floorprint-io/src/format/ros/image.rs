//! Images in messages: `sensor_msgs/Image` and `CompressedImage`, as colours or as depths in millimetres.
//!
//! Sources: `sensor_msgs/image_encodings.hpp`; `compressed_depth_image_transport` for `compressedDepth`; REP 118 for
//! the units of depth images.

use super::cursor::Cursor;
use super::foxglove::ImageParts;
use super::messages::Kind;
use super::{Channel, Encoding};
use crate::budget::USUAL_EXPANSION;
use crate::images::IMAGE_BYTES;
use crate::picture::{Pixels, decode_within};
use floorprint::sensors::{ColorImage, DepthImage};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Bytes before the picture in `compressedDepth`: a format and two parameters of the inverse depth.
const COMPRESSED_DEPTH_HEAD: usize = 12;

/// How pixels became bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// So many bytes a pixel, of which these are red, green and blue.
    Bytes { per_pixel: usize, rgb: [usize; 3] },
    /// Two pixels in four bytes, of which these are brightness of both, and blue and red difference.
    Yuv { brightness: [usize; 2], blue: usize, red: usize },
    /// Depths in millimetres, 16 bits.
    Millimetres,
    /// Depths in metres, 32 bits.
    Metres,
    /// A JPEG or PNG picture of colours.
    ColorPicture,
    /// A PNG picture of depths in millimetres.
    DepthPicture,
    /// `compressedDepth` of depths in millimetres.
    CompressedMillimetres,
    /// `compressedDepth` of depths in metres: their inverse in steps.
    CompressedMetres,
}

impl Layout {
    /// By the name of a raw image's encoding.
    fn of_raw(encoding: &str) -> Option<Self> {
        let bytes = |per_pixel, rgb| Self::Bytes { per_pixel, rgb };
        Some(match encoding {
            "rgb8" => bytes(3, [0, 1, 2]),
            "bgr8" | "8UC3" => bytes(3, [2, 1, 0]),
            "rgba8" => bytes(4, [0, 1, 2]),
            "bgra8" | "8UC4" => bytes(4, [2, 1, 0]),
            "mono8" | "8UC1" => bytes(1, [0, 0, 0]),
            "yuv422" | "uyvy" => Self::Yuv { brightness: [1, 3], blue: 0, red: 2 },
            "yuv422_yuy2" | "yuyv" => Self::Yuv { brightness: [0, 2], blue: 1, red: 3 },
            "16UC1" | "mono16" => Self::Millimetres,
            "32FC1" => Self::Metres,
            _ => return None,
        })
    }

    /// By the format of a compressed image: `jpeg`, `rgb8; jpeg compressed bgr8`, `16UC1; compressedDepth png` …
    fn of_compressed(format: &str) -> Option<Self> {
        let encoding = format.split(';').next().unwrap_or_default().trim();
        let is_depth = matches!(encoding, "16UC1" | "mono16" | "32FC1");
        if format.contains("compressedDepth") {
            return match encoding {
                _ if format.contains("rvl") => None,
                "32FC1" => Some(Self::CompressedMetres),
                _ => Some(Self::CompressedMillimetres),
            };
        }
        let is_known = format.is_empty() || ["jpeg", "jpg", "png"].iter().any(|known| format.contains(known));
        is_known.then_some(if is_depth { Self::DepthPicture } else { Self::ColorPicture })
    }

    /// Whether it holds depths.
    pub(super) fn is_depth(self) -> bool {
        !matches!(self, Self::Bytes { .. } | Self::Yuv { .. } | Self::ColorPicture)
    }

    /// Whether it tells colours apart, as far as is known without looking at the picture.
    pub(super) fn has_hues(self) -> bool {
        !matches!(self, Self::Bytes { per_pixel: 1, .. })
    }

    /// Whether the pixels went through a compression that may have changed them.
    pub(super) fn is_packed(self) -> bool {
        matches!(self, Self::ColorPicture | Self::DepthPicture | Self::CompressedMillimetres | Self::CompressedMetres)
    }
}

/// What is known of an image without its pixels.
#[derive(Debug, Clone)]
pub(super) struct ImageHead {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    /// As the message names it.
    pub(super) encoding: String,
    /// None where it is not one that is read.
    pub(super) layout: Option<Layout>,
    /// Columns and rows, where the message says.
    pub(super) size_px: Option<[usize; 2]>,
}

/// A message with an image.
pub(super) struct ImageMessage<'a> {
    pub(super) head: ImageHead,
    /// Bytes from row to row of a raw image.
    row_bytes: usize,
    is_big_endian: bool,
    data: &'a [u8],
}

impl<'a> ImageMessage<'a> {
    /// Takes a message apart.
    pub(super) fn read(kind: Kind, channel: &Channel, bytes: &'a [u8]) -> Option<Self> {
        let cursor = &mut match channel.encoding {
            Encoding::Ros1 => Cursor::ros1(bytes),
            Encoding::Cdr => Cursor::cdr(bytes)?,
            Encoding::Protobuf => return Self::of_protobuf(kind, bytes),
            _ => return None,
        };
        let header = cursor.header()?;
        let (stamp_s, frame) = (header.stamp_s, header.frame.to_owned());
        if kind == Kind::CompressedImage {
            let encoding = cursor.text()?.to_owned();
            let layout = Layout::of_compressed(&encoding);
            let head = ImageHead { stamp_s, frame, encoding, layout, size_px: None };
            return Some(Self { head, row_bytes: 0, is_big_endian: false, data: cursor.byte_list()? });
        }
        let (rows, columns) = (cursor.u32()? as usize, cursor.u32()? as usize);
        let encoding = cursor.text()?.to_owned();
        let (is_big_endian, row_bytes) = (cursor.u8()? != 0, cursor.u32()? as usize);
        let layout = Layout::of_raw(&encoding);
        let head = ImageHead { stamp_s, frame, encoding, layout, size_px: Some([columns, rows]) };
        Some(Self { head, row_bytes, is_big_endian, data: cursor.byte_list()? })
    }

    /// The same in Foxglove's schemas.
    fn of_protobuf(kind: Kind, bytes: &'a [u8]) -> Option<Self> {
        let parts = ImageParts::read(bytes, kind == Kind::CompressedImage)?;
        let ImageParts { stamp_s, frame, encoding, size_px, row_bytes, data } = parts;
        let layout = if size_px.is_none() { Layout::of_compressed(&encoding) } else { Layout::of_raw(&encoding) };
        let head = ImageHead { stamp_s, frame, encoding, layout, size_px };
        Some(Self { head, row_bytes, is_big_endian: false, data })
    }

    /// The image as colours; the error says what was found instead.
    pub(super) fn color(&self, stamp_s: f64) -> Result<ColorImage, String> {
        match self.head.layout {
            Some(Layout::Bytes { per_pixel, rgb }) => {
                let pixels = self.rows(per_pixel)?.flat_map(|row| row.chunks_exact(per_pixel));
                self.raw_color(stamp_s, pixels.map(|pixel| rgb.map(|at| pixel[at])).collect())
            }
            Some(Layout::Yuv { brightness, blue, red }) => {
                let fours = self.rows(2)?.flat_map(|row| row.chunks_exact(4));
                let two = |four: &[u8]| brightness.map(|at| rgb_of_yuv(four[at], four[blue], four[red]));
                self.raw_color(stamp_s, fours.flat_map(two).collect())
            }
            Some(Layout::ColorPicture) if self.data.starts_with(&[0xff, 0xd8]) => jpeg(self.data, stamp_s),
            Some(Layout::ColorPicture) => {
                let picture = decode_within(self.data, IMAGE_BYTES, USUAL_EXPANSION)?;
                let rgb = picture.pixels.into_rgb()?;
                Ok(ColorImage { stamp_s, width: picture.width, height: picture.height, rgb })
            }
            _ => Err(format!("an image as {}", self.head.encoding)),
        }
    }

    /// The image as depths in millimetres; the error says what was found instead.
    pub(super) fn depth(&self, stamp_s: f64) -> Result<DepthImage, String> {
        let big_endian = self.is_big_endian;
        match self.head.layout {
            Some(Layout::Millimetres) => {
                let value =
                    |&pair: &[u8; 2]| if big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) };
                self.raw_depth(stamp_s, self.rows(2)?.flat_map(|row| row.as_chunks().0.iter().map(value)).collect())
            }
            Some(Layout::Metres) => {
                let metres =
                    |&four: &[u8; 4]| if big_endian { f32::from_be_bytes(four) } else { f32::from_le_bytes(four) };
                let value = |four: &[u8; 4]| millimetres(metres(four));
                self.raw_depth(stamp_s, self.rows(4)?.flat_map(|row| row.as_chunks().0.iter().map(value)).collect())
            }
            Some(Layout::DepthPicture) => depth_picture(self.data, stamp_s),
            Some(Layout::CompressedMillimetres) => {
                depth_picture(self.data.get(COMPRESSED_DEPTH_HEAD..).unwrap_or_default(), stamp_s)
            }
            Some(Layout::CompressedMetres) => {
                let (head, picture) = self.data.split_first_chunk::<COMPRESSED_DEPTH_HEAD>().ok_or("a few bytes")?;
                let parameter = |at: usize| f32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
                let (scale, offset) = (parameter(4), parameter(8));
                let mut image = depth_picture(picture, stamp_s)?;
                for value in image.values.iter_mut().filter(|value| **value != 0) {
                    *value = millimetres(scale / (f32::from(*value) - offset));
                }
                Ok(image)
            }
            _ => Err(format!("a depth image as {}", self.head.encoding)),
        }
    }

    /// The rows of a raw image with so many bytes a pixel.
    fn rows(&self, pixel_bytes: usize) -> Result<impl Iterator<Item = &'a [u8]>, String> {
        let [columns, rows] = self.head.size_px.unwrap_or_default();
        let wanted = columns.saturating_mul(pixel_bytes);
        let step = self.row_bytes.max(wanted);
        // The last row need not be padded.
        let needed = rows.saturating_sub(1).saturating_mul(step).saturating_add(wanted);
        if columns == 0 || rows == 0 || self.data.len() < needed {
            return Err(format!("{columns}×{rows} pixels announced in {} bytes", self.data.len()));
        }
        Ok(self.data.chunks(step).take(rows).map(move |row| &row[..wanted.min(row.len())]))
    }

    fn raw_color(&self, stamp_s: f64, rgb: Vec<[u8; 3]>) -> Result<ColorImage, String> {
        let [width, height] = self.head.size_px.unwrap_or_default();
        if width.checked_mul(height) != Some(rgb.len()) {
            // Half a pair of pixels at the end of each row.
            return Err(format!("{} pixels for {width}×{height}", rgb.len()));
        }
        Ok(ColorImage { stamp_s, width, height, rgb })
    }

    fn raw_depth(&self, stamp_s: f64, values: Vec<u16>) -> Result<DepthImage, String> {
        let [width, height] = self.head.size_px.unwrap_or_default();
        Ok(DepthImage { stamp_s, width, height, values })
    }
}

/// Millimetres of a depth in metres; 0, which means that nothing was measured, for what is no depth.
fn millimetres(depth_m: f32) -> u16 {
    let depth_mm = (depth_m * 1000.0).round();
    if depth_mm >= 1.0 && depth_mm <= f32::from(u16::MAX) { depth_mm as u16 } else { 0 }
}

fn depth_picture(bytes: &[u8], stamp_s: f64) -> Result<DepthImage, String> {
    let picture = decode_within(bytes, IMAGE_BYTES, USUAL_EXPANSION)?;
    match picture.pixels {
        Pixels::Gray16(values) => Ok(DepthImage { stamp_s, width: picture.width, height: picture.height, values }),
        pixels => Err(format!("a picture of {} for depths", pixels.kind())),
    }
}

/// ITU-R BT.601, with the range of television.
fn rgb_of_yuv(brightness: u8, blue: u8, red: u8) -> [u8; 3] {
    let y = 1.164 * (f32::from(brightness) - 16.0);
    let (blue, red) = (f32::from(blue) - 128.0, f32::from(red) - 128.0);
    [y + 1.596 * red, y - 0.813 * red - 0.391 * blue, y + 2.018 * blue].map(|value| value.round() as u8)
}

fn jpeg(bytes: &[u8], stamp_s: f64) -> Result<ColorImage, String> {
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let size = width.saturating_mul(height).saturating_mul(3);
    if size as f64 > IMAGE_BYTES + USUAL_EXPANSION * bytes.len() as f64 {
        return Err(format!("{width}×{height} pixels announced in {} bytes", bytes.len()));
    }
    let pixels = decoder.decode().map_err(|error| error.to_string())?;
    if pixels.len() != size {
        return Err(format!("{} bytes for {width}×{height} pixels", pixels.len()));
    }
    Ok(ColorImage { stamp_s, width, height, rgb: pixels.as_chunks().0.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{Picture, png_bytes};

    fn message<'a>(
        encoding: &str,
        layout: Option<Layout>,
        size_px: [usize; 2],
        row_bytes: usize,
        data: &'a [u8],
    ) -> ImageMessage<'a> {
        let head = ImageHead {
            stamp_s: 0.0,
            frame: String::new(),
            encoding: encoding.to_owned(),
            layout,
            size_px: Some(size_px),
        };
        ImageMessage { head, row_bytes, is_big_endian: false, data }
    }

    fn raw<'a>(encoding: &str, size_px: [usize; 2], row_bytes: usize, data: &'a [u8]) -> ImageMessage<'a> {
        message(encoding, Layout::of_raw(encoding), size_px, row_bytes, data)
    }

    #[test]
    fn colours_are_the_same_in_every_order_of_bytes() {
        let expected = vec![[10, 20, 30], [40, 50, 60]];
        let cases: [(&str, &[u8]); 4] = [
            ("rgb8", &[10, 20, 30, 40, 50, 60]),
            ("bgr8", &[30, 20, 10, 60, 50, 40]),
            ("rgba8", &[10, 20, 30, 0, 40, 50, 60, 0]),
            ("bgra8", &[30, 20, 10, 0, 60, 50, 40, 0]),
        ];
        for (encoding, data) in cases {
            assert_eq!(raw(encoding, [2, 1], data.len(), data).color(1.0).unwrap().rgb, expected, "{encoding}");
        }
        // Rows of one pixel each, padded to four bytes; the last one is not.
        let padded = raw("mono8", [1, 2], 4, &[7, 0, 0, 0, 9]).color(0.0).unwrap();
        assert_eq!(padded.rgb, [[7; 3], [9; 3]]);
        assert!(raw("rgb8", [2, 2], 6, &[0; 11]).color(0.0).unwrap_err().contains("2×2 pixels"));
        assert!(raw("bayer_rggb8", [2, 1], 2, &[0; 2]).color(0.0).unwrap_err().contains("bayer_rggb8"));
    }

    #[test]
    fn video_colours_are_those_of_their_standard() {
        // White, black, and red of BT.601 (81, 90, 240) within rounding.
        for (encoding, data) in [("yuv422", [128, 235, 128, 16]), ("yuyv", [235, 128, 16, 128])] {
            assert_eq!(raw(encoding, [2, 1], 4, &data).color(0.0).unwrap().rgb, [[255; 3], [0; 3]], "{encoding}");
        }
        let red = raw("uyvy", [2, 1], 4, &[90, 81, 240, 81]).color(0.0).unwrap().rgb[0];
        assert!(red[0] >= 253 && red[1] <= 2 && red[2] <= 2, "{red:?}");
    }

    #[test]
    fn depths_are_millimetres_whatever_they_were() {
        let metres: Vec<u8> = [1.2344_f32, f32::NAN, -1.0, 100.0].iter().flat_map(|m| m.to_le_bytes()).collect();
        assert_eq!(raw("32FC1", [4, 1], 16, &metres).depth(0.0).unwrap().values, [1234, 0, 0, 0]);
        let mut big = raw("16UC1", [2, 1], 4, &[4, 210, 0, 0]);
        big.is_big_endian = true;
        assert_eq!(big.depth(0.0).unwrap().values, [1234, 0]);

        let png =
            |values: Vec<u16>| png_bytes(&Picture { width: 2, height: 1, pixels: Pixels::Gray16(values) }).unwrap();
        let compressed = |format: &str, data: &[u8]| {
            message(format, Layout::of_compressed(format), [0; 2], 0, data).depth(0.0).map(|image| image.values)
        };
        let head = |a: f32, b: f32| [&[0; 4][..], &a.to_le_bytes(), &b.to_le_bytes()].concat();
        let whole = [head(0.0, 0.0), png(vec![1234, 0])].concat();
        assert_eq!(compressed("16UC1; compressedDepth png", &whole).unwrap(), [1234, 0]);
        assert_eq!(compressed("16UC1; compressedDepth", &whole).unwrap(), [1234, 0]);
        assert_eq!(compressed("16UC1; png compressed ", &png(vec![1234, 0])).unwrap(), [1234, 0]);
        // Depth = a / (value − b): 2000 / (1500 + 500) is a metre.
        let inverse = [head(2000.0, -500.0), png(vec![1500, 0])].concat();
        assert_eq!(compressed("32FC1; compressedDepth png", &inverse).unwrap(), [1000, 0]);
        assert!(compressed("16UC1; compressedDepth rvl", &whole).unwrap_err().contains("rvl"));
        assert!(compressed("16UC1; compressedDepth png", &whole[..9]).is_err());
    }

    #[test]
    fn a_jpeg_is_its_picture_and_a_lying_one_costs_no_memory() {
        // 8 × 8 pixels of one grey, as libjpeg writes them at the lowest quality.
        let mut bytes: Vec<u8> = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
        bytes.extend([255; 64]);
        bytes.extend([0xff, 0xc0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0]);
        // One code of one bit for "no difference", one for "no more".
        for class in [0x00, 0x10] {
            bytes.extend([0xff, 0xc4, 0, 20, class, 1]);
            bytes.extend([0; 15]);
            bytes.push(0);
        }
        bytes.extend([0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0, 0b0011_1111, 0xff, 0xd9]);
        let image = jpeg(&bytes, 2.0).unwrap();
        assert_eq!((image.width, image.height, image.stamp_s), (8, 8, 2.0));
        assert!(image.rgb.iter().all(|pixel| *pixel == [128; 3]), "{:?}", image.rgb);
        let size = bytes.iter().position(|&byte| byte == 0xc0).unwrap() + 4;
        bytes[size..size + 4].copy_from_slice(&[0x75, 0x30, 0x75, 0x30]);
        assert!(jpeg(&bytes, 0.0).is_err());
    }
}
