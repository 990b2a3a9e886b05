//! What one image shows of the floor, small enough to keep and free of the trajectory.

use super::floor_plane::{FloorEvidence, FloorTilt};

/// The floor part of a colour image, shrunk where its pixels are finer than the map.
///
/// The patch stays in the image's own perspective: where a pixel lies on the floor follows
/// from the camera and the body's pose at `stamp_s`, and is worked out when the floor is
/// painted. So a corrected trajectory, or a better estimate of the floor's tilt, repaints
/// the floor without reading the image again.
#[derive(Debug, Clone)]
pub struct FloorPatch {
    /// Time of the colour image, seconds; the body's pose at this time places the patch.
    pub stamp_s: f64,
    /// The tilt of the floor found in this image alone; nothing when too little floor was seen.
    pub tilt: Option<FloorTilt>,
    pub(super) evidence: Option<FloorEvidence>,
    /// Red, green, blue and 255 where the pixel shows floor, else 0; row by row from the top left.
    pub(super) pixels: Vec<[u8; 4]>,
    pub(super) layout: RowLayout,
    /// Least and greatest x and y of the floor that is shown, metres in the body's frame.
    pub(super) bounds_m: [[f64; 2]; 2],
}

impl FloorPatch {
    /// Memory that the patch takes, bytes.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        size_of::<Self>() + self.pixels.len() * 4 + self.layout.row_of.len() * size_of::<f32>()
    }

    /// Colour at a pixel of the full image, between the patch's pixels by bilinear weights;
    /// nothing where less than half of these weights falls on floor.
    pub(super) fn sample(&self, column: f32, row: f32) -> Option<[f32; 3]> {
        let (x, y) = self.layout.patch_from_image(column, row)?;
        let (x, y) = (x.clamp(0.0, (self.layout.width - 1) as f32), y.clamp(0.0, (self.layout.height - 1) as f32));
        let (left, top) = ((x as usize).min(self.layout.width - 2), (y as usize).min(self.layout.height - 2));
        let (fx, fy) = (x - left as f32, y - top as f32);
        let first = top * self.layout.width + left;
        let corners = [first, first + 1, first + self.layout.width, first + self.layout.width + 1];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let mut sum = [0.0_f32; 4];
        for (corner, weight) in corners.into_iter().zip(weights) {
            let [r, g, b, seen] = self.pixels[corner].map(f32::from);
            let weight = weight * seen;
            sum = [sum[0] + weight * r, sum[1] + weight * g, sum[2] + weight * b, sum[3] + weight];
        }
        (sum[3] >= 127.5).then(|| [sum[0] / sum[3], sum[1] / sum[3], sum[2] / sum[3]])
    }
}

/// Which rows and columns of the image a patch's pixels stand for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RowLayout {
    /// Pixels of a patch's row.
    pub width: usize,
    /// Rows of the patch.
    pub height: usize,
    /// Columns of the image in one pixel.
    pub columns_per_pixel: usize,
    /// First image row of each patch row, and the end of the last.
    pub row_starts: Vec<usize>,
    /// Patch row (between its pixels' centres) of each image row from `row_starts[0]` on.
    row_of: Vec<f32>,
}

impl RowLayout {
    /// `row_starts` has at least three entries: two rows and the end.
    pub(super) fn new(image_width: usize, columns_per_pixel: usize, row_starts: Vec<usize>) -> Self {
        let height = row_starts.len() - 1;
        let center = |i: usize| (row_starts[i] + row_starts[i + 1] - 1) as f32 / 2.0;
        let mut lower = 0;
        let row_of = (row_starts[0]..row_starts[height])
            .map(|row| {
                while lower + 2 < height && row as f32 >= center(lower + 1) {
                    lower += 1;
                }
                lower as f32 + (row as f32 - center(lower)) / (center(lower + 1) - center(lower))
            })
            .collect();
        Self { width: image_width / columns_per_pixel, height, columns_per_pixel, row_starts, row_of }
    }

    /// Position in the patch of a pixel of the image; nothing outside.
    fn patch_from_image(&self, column: f32, row: f32) -> Option<(f32, f32)> {
        let step = self.columns_per_pixel as f32;
        let x = (column + 0.5) / step - 0.5;
        let above = row - self.row_starts[0] as f32;
        let inside =
            x >= -0.5 && x <= self.width as f32 - 0.5 && above >= -0.5 && above <= self.row_of.len() as f32 - 0.5;
        if !inside {
            return None;
        }
        let index = (above.max(0.0) as usize).min(self.row_of.len() - 2);
        let (here, next) = (self.row_of[index], self.row_of[index + 1]);
        Some((x, here + (next - here) * (above - index as f32)))
    }

    /// Column and row of the image at the centre of a patch's pixel.
    pub(super) fn image_from_patch(&self, x: usize, y: usize) -> (f64, f64) {
        let column = (x * self.columns_per_pixel) as f64 + (self.columns_per_pixel - 1) as f64 / 2.0;
        (column, (self.row_starts[y] + self.row_starts[y + 1] - 1) as f64 / 2.0)
    }

    /// The patch's pixel that an image pixel belongs to; nothing outside.
    pub(super) fn pixel_of(&self, column: f64, row: f64) -> Option<(usize, usize)> {
        let (x, y) = self.patch_from_image(column as f32, row as f32)?;
        Some(((x.round() as usize).min(self.width - 1), (y.round() as usize).min(self.height - 1)))
    }
}
