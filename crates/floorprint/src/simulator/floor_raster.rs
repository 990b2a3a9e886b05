//! The painted floor as pixels, painted block by block as cameras come to see it.

use super::floor::Floor;
use std::sync::OnceLock;

/// Side of a pixel, metres.
pub(super) const PIXEL_M: f64 = 0.005;
/// Pixels along a block's side.
const BLOCK: usize = 256;
const BLOCK_M: f64 = BLOCK as f64 * PIXEL_M;

/// A raster over the building. What a block shows does not depend on who asks first.
#[derive(Debug, Clone)]
pub(super) struct FloorRaster {
    origin_m: [f64; 2],
    columns: usize,
    rows: usize,
    blocks: Vec<OnceLock<Box<[[u8; 3]]>>>,
}

impl FloorRaster {
    /// An unpainted raster between two corners, metres.
    pub(super) fn new([low_m, high_m]: [[f64; 2]; 2]) -> Self {
        let blocks = |axis: usize| ((high_m[axis] - low_m[axis]) / BLOCK_M).max(0.0) as usize + 1;
        let (columns, rows) = (blocks(0), blocks(1));
        Self { origin_m: low_m, columns, rows, blocks: (0..columns * rows).map(|_| OnceLock::new()).collect() }
    }

    /// The colour of the pixel at a point, metres; black outside of the building.
    pub(super) fn color(&self, floor: &Floor, point_m: [f64; 2]) -> [u8; 3] {
        let [x, y] = [0, 1].map(|axis| (point_m[axis] - self.origin_m[axis]) / PIXEL_M);
        let (column, row) = (x as usize, y as usize);
        if x < 0.0 || y < 0.0 || column / BLOCK >= self.columns || row / BLOCK >= self.rows {
            return [0; 3];
        }
        let index = row / BLOCK * self.columns + column / BLOCK;
        let block = self.blocks[index].get_or_init(|| self.paint(floor, [column / BLOCK, row / BLOCK]));
        block[row % BLOCK * BLOCK + column % BLOCK]
    }

    fn paint(&self, floor: &Floor, block: [usize; 2]) -> Box<[[u8; 3]]> {
        let corner_m: [f64; 2] = std::array::from_fn(|axis| self.origin_m[axis] + block[axis] as f64 * BLOCK_M);
        let painter = floor.painter(corner_m.map(|m| m + 0.5 * BLOCK_M), std::f64::consts::FRAC_1_SQRT_2 * BLOCK_M);
        let center_m = |axis: usize, pixel: usize| corner_m[axis] + (pixel as f64 + 0.5) * PIXEL_M;
        (0..BLOCK * BLOCK)
            .map(|pixel| painter.color([center_m(0, pixel % BLOCK), center_m(1, pixel / BLOCK)]))
            .collect()
    }
}
