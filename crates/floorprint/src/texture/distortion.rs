//! Distortion of lenses, and images freed of it: those that a pinhole of the same intrinsics would have made.
//!
//! The models `plumb_bob` and `rational_polynomial` of `sensor_msgs/CameraInfo` are one with fewer or more terms:
//! Brown (1971) for the tangential ones; <https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html>.

use super::camera::Pinhole;
use crate::sensors::{ColorImage, DepthImage};
use std::borrow::Cow;

/// k1, k2, p1, p2, k3, k4, k5, k6.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Distortion([f64; 8]);

impl Distortion {
    /// None when all terms are 0.
    pub(super) fn new(terms: &[f64]) -> Option<Self> {
        let mut all = [0.0; 8];
        for (to, from) in all.iter_mut().zip(terms) {
            *to = *from;
        }
        all.iter().any(|&term| term != 0.0).then_some(Self(all))
    }

    /// Where the lens puts a point of the plane at unit depth.
    pub(super) fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let Self([k1, k2, p1, p2, k3, k4, k5, k6]) = self;
        let r2 = x * x + y * y;
        let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }
}

impl Pinhole {
    /// Whether a pixel of the ideal image is one that the lens lets through.
    pub(super) fn shows(&self, column: f64, row: f64) -> bool {
        self.distortion.is_none() || self.is_inside(self.image_from_ideal(column, row))
    }

    fn is_inside(&self, (column, row): (f64, f64)) -> bool {
        let [columns, rows] = self.size_px.map(|pixels| pixels as f64 - 0.5);
        column > -0.5 && row > -0.5 && column < columns && row < rows
    }
}

/// A depth image as an ideal pinhole sees it: the nearest measurement of each pixel, for depths must not be mixed.
pub(super) fn ideal_depth<'a>(image: &'a DepthImage, camera: &Pinhole) -> Cow<'a, DepthImage> {
    let (width, height) = (image.width, image.height);
    if camera.distortion.is_none() {
        return Cow::Borrowed(image);
    }
    let value_at = |index: usize| {
        let (column, row) = camera.image_from_ideal((index % width) as f64, (index / width) as f64);
        // What is left of the first column is no column.
        let (column, row) = ((column + 0.5).floor(), (row + 0.5).floor());
        let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        if inside { image.values[row as usize * width + column as usize] } else { 0 }
    };
    Cow::Owned(DepthImage { values: (0..image.values.len()).map(value_at).collect(), ..*image })
}

/// A colour image as an ideal pinhole sees it, between the pixels by bilinear weights; beyond the border its nearest pixel.
pub(super) fn ideal_color<'a>(image: &'a ColorImage, camera: &Pinhole) -> Cow<'a, ColorImage> {
    let (width, height) = (image.width, image.height);
    if camera.distortion.is_none() {
        return Cow::Borrowed(image);
    }
    let color_at = |index: usize| {
        let (column, row) = camera.image_from_ideal((index % width) as f64, (index / width) as f64);
        let (column, row) = (column.clamp(0.0, (width - 1) as f64), row.clamp(0.0, (height - 1) as f64));
        let (left, top) = (column as usize, row as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (fx, fy) = ((column - left as f64) as f32, (row - top as f64) as f32);
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
        let corners = corners.map(|(x, y)| image.rgb[y * width + x].map(f32::from));
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        [0, 1, 2].map(|channel| {
            let sum: f32 = corners.iter().zip(weights).map(|(corner, weight)| weight * corner[channel]).sum();
            (sum + 0.5) as u8
        })
    };
    Cow::Owned(ColorImage { rgb: (0..image.rgb.len()).map(color_at).collect(), ..*image })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose3;

    fn camera(terms: &[f64]) -> Pinhole {
        Pinhole {
            size_px: [64, 48],
            focal_px: [40.0, 42.0],
            center_px: [31.0, 24.5],
            body_from_optical: Pose3::identity(),
            distortion: Distortion::new(terms),
        }
    }

    #[test]
    fn terms_are_those_of_opencv() {
        // cv2.projectPoints of (0.4, −0.3, 1) with a unit camera.
        let place = |terms: &[f64]| Distortion::new(terms).unwrap().apply([0.4, -0.3]);
        let near = |[x, y]: [f64; 2], expected: [f64; 2]| (x - expected[0]).abs() + (y - expected[1]).abs() < 1e-12;
        // By hand: r² = 0.25, radial = 1 − 0.2·0.25 + 0.1·0.0625 = 0.95625.
        let tangential = [2.0 * 0.01 * -0.12 + 0.02 * (0.25 + 0.32), 0.01 * (0.25 + 0.18) + 2.0 * 0.02 * -0.12];
        let expected = [0.4 * 0.95625 + tangential[0], -0.3 * 0.95625 + tangential[1]];
        assert!(near(place(&[-0.2, 0.1, 0.01, 0.02]), expected));
        // The rational part divides: 1 + 0.5·0.25.
        assert!(near(place(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.5]), [0.4 / 1.125, -0.3 / 1.125]));
        assert!(Distortion::new(&[0.0; 5]).is_none());
    }

    #[test]
    fn a_distorted_image_becomes_the_ideal_one() {
        // A smooth picture of the plane at unit depth, once through the lens and once without.
        let lens = camera(&[-0.12, 0.02, 0.004, -0.003]);
        let shade = |x: f64, y: f64| [128.0 + 90.0 * (3.0 * x).sin(), 128.0 + 80.0 * (2.5 * y).cos(), 100.0];
        let ideal: Vec<[f64; 3]> =
            (0..64 * 48).map(|i| shade((f64::from(i % 64) - 31.0) / 40.0, (f64::from(i / 64) - 24.5) / 42.0)).collect();
        // The lens' image: for each of its pixels the ray is found by iteration.
        let seen = |column: f64, row: f64| {
            let wanted = [(column - 31.0) / 40.0, (row - 24.5) / 42.0];
            let mut ray = wanted;
            for _ in 0..30 {
                let [x, y] = lens.distortion.unwrap().apply(ray);
                ray = [ray[0] + wanted[0] - x, ray[1] + wanted[1] - y];
            }
            shade(ray[0], ray[1])
        };
        let rgb = (0..64 * 48).map(|i| seen(f64::from(i % 64), f64::from(i / 64)).map(|v| v.round() as u8)).collect();
        let image = ColorImage { stamp_s: 1.0, width: 64, height: 48, rgb };
        let corrected = ideal_color(&image, &lens);
        let mut worst = 0.0_f64;
        for (index, (&got, wanted)) in corrected.rgb.iter().zip(&ideal).enumerate() {
            if lens.shows((index % 64) as f64, (index / 64) as f64) {
                worst = (0..3).fold(worst, |worst, c| worst.max((f64::from(got[c]) - wanted[c]).abs()));
            }
        }
        assert!(worst < 3.0, "{worst}");
        let plain = image.rgb.iter().zip(&ideal).map(|(got, wanted)| (f64::from(got[0]) - wanted[0]).abs());
        assert!(plain.fold(0.0, f64::max) > 15.0);
        assert!(matches!(ideal_color(&image, &camera(&[])), Cow::Borrowed(_)));
    }

    #[test]
    fn depths_are_moved_but_not_mixed() {
        let lens = camera(&[0.2]);
        let values = (0..64 * 48).map(|i| if i % 64 < 32 { 1000 } else { 3000 }).collect();
        let image = DepthImage { stamp_s: 0.0, width: 64, height: 48, values };
        let corrected = ideal_depth(&image, &lens);
        assert!(corrected.values.iter().all(|value| [0, 1000, 3000].contains(value)));
        // What is pressed outwards leaves the corners without a measurement.
        assert_eq!((corrected.values[0], corrected.values[24 * 64 + 10]), (0, 1000));
        assert!(!lens.shows(0.0, 0.0) && lens.shows(31.0, 24.0));
    }
}
