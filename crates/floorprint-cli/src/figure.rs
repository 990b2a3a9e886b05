//! Drawings of the map: `map.png` and the snapshots, after the report's figures 1 and 2.
//!
//! White is free, grey unknown, black occupied, as in ROS; dead reckoning is blue, the
//! filter's trajectory red. A bar in the lower left corner gives the scale.

use floorprint::map::{Occupancy, Raster};
use floorprint_io::{Picture, Pixels};

/// A colour: red, green, blue.
pub(crate) type Color = [u8; 3];

/// Cells of which nothing is known.
pub(crate) const UNKNOWN: Color = [205, 205, 205];
/// Free cells.
pub(crate) const FREE: Color = [255, 255, 255];
/// Occupied cells.
pub(crate) const OCCUPIED: Color = [0, 0, 0];
/// Dead reckoning.
pub(crate) const DEAD_RECKONING: Color = [37, 99, 235];
/// The filter's trajectory.
pub(crate) const TRAJECTORY: Color = [220, 38, 38];
/// The true trajectory.
pub(crate) const TRUTH: Color = [21, 128, 61];
/// Loop closures.
pub(crate) const LOOPS: Color = [162, 28, 175];

/// Pixels around the map.
const MARGIN_PX: usize = 24;
/// Figures are enlarged by whole factors as long as their longer side stays below this.
const LONGEST_SIDE_PX: usize = 1600;

/// The map as colours, one pixel a cell.
pub(crate) fn map_colors(map: &Raster<Occupancy>) -> Vec<Color> {
    let color = |cell: &Occupancy| match cell {
        Occupancy::Unknown => UNKNOWN,
        Occupancy::Free => FREE,
        Occupancy::Occupied => OCCUPIED,
    };
    map.cells.iter().map(color).collect()
}

/// The map as a picture with a margin and a scale bar.
#[must_use]
pub fn map_picture(map: &Raster<Occupancy>) -> Picture {
    Figure::of_map(map).into_picture()
}

/// A drawing of a part of the world.
pub(crate) struct Figure {
    width: usize,
    height: usize,
    pixels: Vec<Color>,
    /// Position of the lower left corner, metres.
    origin_m: [f64; 2],
    px_per_m: f64,
}

impl Figure {
    /// A figure of the map with a margin and a scale bar.
    pub(crate) fn of_map(map: &Raster<Occupancy>) -> Self {
        let longest = map.width.max(map.height).max(1);
        let scale = (LONGEST_SIDE_PX.saturating_sub(2 * MARGIN_PX) / longest).clamp(1, 8);
        let (width, height) = (map.width * scale + 2 * MARGIN_PX, map.height * scale + 2 * MARGIN_PX);
        let mut pixels = vec![UNKNOWN; width * height];
        let colors = map_colors(map);
        for row in 0..map.height * scale {
            let cells = &colors[row / scale * map.width..][..map.width];
            let line = &mut pixels[(row + MARGIN_PX) * width + MARGIN_PX..][..map.width * scale];
            for (pixel, color) in line.iter_mut().zip(cells.iter().flat_map(|color| std::iter::repeat_n(color, scale)))
            {
                *pixel = *color;
            }
        }
        let px_per_m = scale as f64 / map.resolution_m;
        let margin_m = MARGIN_PX as f64 / px_per_m;
        let origin_m = [map.origin_m[0] - margin_m, map.origin_m[1] - margin_m];
        let mut figure = Self { width, height, pixels, origin_m, px_per_m };
        figure.draw_scale_bar();
        figure
    }

    /// The picture.
    pub(crate) fn into_picture(self) -> Picture {
        Picture { width: self.width, height: self.height, pixels: Pixels::Rgb8(self.pixels) }
    }

    /// Draws a smooth line through points of the world, metres.
    pub(crate) fn draw_line(&mut self, points_m: impl Iterator<Item = [f64; 2]>, color: Color, width_px: f64) {
        let mut coverage = vec![0_u8; self.pixels.len()];
        let mut last: Option<[f64; 2]> = None;
        for point_m in points_m {
            let point = self.to_px(point_m);
            let Some(from) = last else {
                last = Some(point);
                continue;
            };
            // Steps of less than a pixel add nothing but work.
            if (point[0] - from[0]).hypot(point[1] - from[1]) >= 1.0 {
                self.cover_segment(&mut coverage, from, point, width_px / 2.0);
                last = Some(point);
            }
        }
        self.blend(&coverage, color);
    }

    /// Draws straight lines, each between two points of the world, metres.
    pub(crate) fn draw_segments(&mut self, ends_m: impl Iterator<Item = [[f64; 2]; 2]>, color: Color, width_px: f64) {
        let mut coverage = vec![0_u8; self.pixels.len()];
        for [from, to] in ends_m.map(|ends| ends.map(|end_m| self.to_px(end_m))) {
            self.cover_segment(&mut coverage, from, to, width_px / 2.0);
        }
        self.blend(&coverage, color);
    }

    /// Draws a filled disc at a point of the world, metres.
    pub(crate) fn draw_disc(&mut self, center_m: [f64; 2], color: Color, radius_px: f64) {
        let mut coverage = vec![0_u8; self.pixels.len()];
        let center = self.to_px(center_m);
        self.cover_segment(&mut coverage, center, center, radius_px);
        self.blend(&coverage, color);
    }

    fn to_px(&self, [x_m, y_m]: [f64; 2]) -> [f64; 2] {
        [(x_m - self.origin_m[0]) * self.px_per_m, self.height as f64 - (y_m - self.origin_m[1]) * self.px_per_m]
    }

    /// Raises the coverage of every pixel by how much of it lies within `radius` of a segment.
    fn cover_segment(&self, coverage: &mut [u8], from: [f64; 2], to: [f64; 2], radius: f64) {
        let reach = radius + 1.0;
        let limits = |a: f64, b: f64, size: usize| {
            let low = (a.min(b) - reach).floor().max(0.0) as usize;
            let high = (a.max(b) + reach).ceil().clamp(0.0, size as f64) as usize;
            low..high
        };
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length_squared = dx * dx + dy * dy;
        for row in limits(from[1], to[1], self.height) {
            for column in limits(from[0], to[0], self.width) {
                let (x, y) = (column as f64 + 0.5 - from[0], row as f64 + 0.5 - from[1]);
                let along =
                    if length_squared > 0.0 { ((x * dx + y * dy) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
                let distance = (x - along * dx).hypot(y - along * dy);
                let covered = ((radius + 0.5 - distance).clamp(0.0, 1.0) * 255.0) as u8;
                let pixel = &mut coverage[row * self.width + column];
                *pixel = (*pixel).max(covered);
            }
        }
    }

    fn blend(&mut self, coverage: &[u8], color: Color) {
        for (pixel, &covered) in self.pixels.iter_mut().zip(coverage).filter(|(_, covered)| **covered > 0) {
            for (channel, wanted) in pixel.iter_mut().zip(color) {
                let (old, new, share) = (u32::from(*channel), u32::from(wanted), u32::from(covered));
                *channel = ((old * (255 - share) + new * share + 127) / 255) as u8;
            }
        }
    }

    fn fill(&mut self, left: usize, top: usize, width: usize, height: usize, color: Color) {
        for row in top..(top + height).min(self.height) {
            let end = (left + width).min(self.width);
            self.pixels[row * self.width + left.min(end)..row * self.width + end].fill(color);
        }
    }

    /// Size of a dot of the scale bar's letters: they can be read when the figure is shown at half its size.
    fn dot_px(&self) -> usize {
        (self.width.max(self.height) / 240).max(2)
    }

    fn draw_scale_bar(&mut self) {
        let dot_px = self.dot_px();
        let length_m = scale_bar_length_m(self.width as f64 / self.px_per_m);
        let length_px = (length_m * self.px_per_m).round() as usize;
        let label = format!("{length_m} m");
        // On ground of its own, whatever the map shows there.
        let height_px = 9 * dot_px;
        let top = self.height.saturating_sub(height_px);
        self.fill(0, top, length_px + (6 + 4 * label.chars().count()) * dot_px, height_px, FREE);
        self.fill(2 * dot_px, top + 4 * dot_px, length_px, dot_px, OCCUPIED);
        for end in [2 * dot_px, dot_px + length_px] {
            self.fill(end, top + 2 * dot_px, dot_px, 5 * dot_px, OCCUPIED);
        }
        for (index, character) in label.chars().enumerate() {
            for (row, bits) in glyph(character).iter().enumerate() {
                for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                    let left = 4 * dot_px + length_px + (index * 4 + column) * dot_px;
                    self.fill(left, top + (2 + row) * dot_px, dot_px, dot_px, OCCUPIED);
                }
            }
        }
    }
}

/// A round length of at most a quarter of the width, metres.
pub(crate) fn scale_bar_length_m(width_m: f64) -> f64 {
    const ROUND_M: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];
    ROUND_M.into_iter().rev().find(|&length_m| length_m <= width_m / 4.0).unwrap_or(ROUND_M[0])
}

/// Five rows of three pixels: what a scale bar's label needs.
fn glyph(character: char) -> [u8; 5] {
    match character {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '5' => [7, 4, 7, 1, 7],
        '.' => [0, 0, 0, 0, 2],
        'm' => [0, 7, 7, 5, 5],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small_map() -> Raster<Occupancy> {
        let mut cells = vec![Occupancy::Free; 12];
        cells[0] = Occupancy::Occupied;
        Raster { width: 4, height: 3, resolution_m: 0.5, origin_m: [-1.0, -1.0], cells }
    }

    #[test]
    fn a_cell_is_drawn_where_it_lies_in_the_world() {
        let figure = Figure::of_map(&small_map());
        let [x, y] = figure.to_px([-0.75, 0.25]);
        assert_eq!(figure.pixels[y as usize * figure.width + x as usize], OCCUPIED);
        let [x, y] = figure.to_px([0.75, -0.75]);
        assert_eq!(figure.pixels[y as usize * figure.width + x as usize], FREE);
    }

    #[test]
    fn a_line_colours_the_pixels_on_it_and_no_others() {
        let mut figure = Figure::of_map(&small_map());
        figure.draw_line([[-0.9, -0.5], [0.9, -0.5]].into_iter(), TRAJECTORY, 2.0);
        let at = |figure: &Figure, point| {
            let [x, y] = figure.to_px(point);
            figure.pixels[y as usize * figure.width + x as usize]
        };
        assert_eq!(at(&figure, [0.0, -0.5]), TRAJECTORY);
        assert_eq!(at(&figure, [0.0, -0.1]), FREE);
    }

    #[test]
    fn scale_bars_are_round_and_fit() {
        assert_eq!(scale_bar_length_m(30.0), 5.0);
        assert_eq!(scale_bar_length_m(90.0), 20.0);
        assert_eq!(scale_bar_length_m(0.1), 0.1);
    }
}
