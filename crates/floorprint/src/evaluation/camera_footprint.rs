//! Which cells of the floor a camera could see on a drive.

use crate::geometry::Pose2;
use crate::map::{Occupancy, Raster};
use crate::texture::RgbdCamera;
use nalgebra::Vector3;

/// The cells of the true map on whose floor the camera had both a depth and a colour pixel.
///
/// `world_from_body` are the body's poses when images were taken. A cell counts when a
/// depth pixel of valid depth looks at it, the colour pixel that belongs to it
/// (report eqs. 25–26) is inside the colour image, and no cell that is not free lies
/// between it and the nearest floor that the same image column shows.
#[must_use]
pub fn camera_footprint(world_from_body: &[Pose2], camera: &RgbdCamera, truth: &Raster<Occupancy>) -> Raster<bool> {
    let columns: Vec<_> = (0..camera.depth.size_px[0]).map(|column| floor_along_column(camera, column)).collect();
    let mut seen = truth.map(|_, _| false);
    for pose in world_from_body {
        let (sin, cos) = pose.theta.sin_cos();
        for points_m in &columns {
            for [x_m, y_m] in points_m {
                let point_m = [pose.x + cos * x_m - sin * y_m, pose.y + sin * x_m + cos * y_m];
                let (row, column) = truth.row_and_column_at(point_m);
                match truth.index(row, column) {
                    Some(index) if truth.cells[index] == Occupancy::Free => seen.cells[index] = true,
                    _ => break,
                }
            }
        }
    }
    seen
}

/// The points of the floor (body's frame, metres) that an image column sees with a
/// valid depth and a colour, from the nearest, which is the lowest in the image, outwards.
fn floor_along_column(camera: &RgbdCamera, column: usize) -> Vec<[f64; 2]> {
    let (depth, [nearest_m, farthest_m]) = (&camera.depth, camera.depth_limits_m);
    let (linear, offset) = camera.color.pixel_from_body();
    let [columns, rows] = camera.color.size_px.map(|pixels| (pixels - 1) as f64);
    (0..depth.size_px[1])
        .rev()
        .filter_map(|row| {
            // The ray with unit depth.
            let ray = Vector3::new(
                (column as f64 - depth.center_px[0]) / depth.focal_px[0],
                (row as f64 - depth.center_px[1]) / depth.focal_px[1],
                1.0,
            );
            let direction = depth.body_from_optical.rotation * ray;
            let depth_m = -depth.body_from_optical.translation_m.z / direction.z;
            let has_depth = direction.z < 0.0 && (nearest_m..=farthest_m).contains(&depth_m);
            let point = depth.body_from_optical.transform_point(ray * depth_m);
            let pixel = linear * point + offset;
            let has_color = pixel.z > 0.0
                && (0.0..=columns).contains(&(pixel.x / pixel.z))
                && (0.0..=rows).contains(&(pixel.y / pixel.z));
            (has_depth && has_color).then_some([point.x, point.y])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Mount;
    use crate::sensors::CameraConfig;

    fn camera() -> RgbdCamera {
        RgbdCamera::from(&CameraConfig {
            mount: Mount { x_m: 0.18, z_m: 0.487, pitch_rad: 0.36, ..Mount::default() },
            depth_focal_px: 585.051,
            depth_center_column_px: 315.838,
            depth_center_row_px: 242.941,
            disparity_scale: -0.00304,
            disparity_offset: 3.31,
            depth_numerator_m: 1.03,
            color_focal: 526.37,
            color_baseline: -4.5 * 1750.46,
            color_column_offset: 19276.0,
            color_row_offset: 16662.0,
            color_divisor: 585.051,
            depth_min_m: 0.5,
            depth_max_m: 4.0,
        })
    }

    /// 12 m × 12 m of free floor around the origin, but for a wall across x = 2 m.
    fn hall(wall: bool) -> Raster<Occupancy> {
        let blank =
            Raster { width: 240, height: 240, resolution_m: 0.05, origin_m: [-6.0; 2], cells: vec![(); 57_600] };
        blank.map(|_, [x, _]| if wall && (x - 2.0).abs() < 0.05 { Occupancy::Occupied } else { Occupancy::Free })
    }

    #[test]
    fn sees_a_wedge_ahead_within_the_depth_limits() {
        let seen = camera_footprint(&[Pose2::IDENTITY], &camera(), &hall(false));
        let at = |x, y| *seen.at([x, y]).unwrap();
        assert!(at(1.5, 0.0) && at(3.0, 0.5) && at(3.0, -0.5));
        assert!(!at(-1.0, 0.0) && !at(0.3, 0.0) && !at(5.0, 0.0) && !at(1.5, 1.5));
        // Lowest pixel: 0.36 rad + atan((479 − 242.9)/585) below the horizon from 0.487 m up, 0.18 m ahead.
        let nearest_m = 0.18 + 0.487 / (0.36 + (236.06_f64 / 585.051).atan()).tan();
        assert!(!at(nearest_m - 0.06, 0.0) && at(nearest_m + 0.06, 0.0));
    }

    #[test]
    fn turns_with_the_body_and_is_blocked_by_walls() {
        let left = camera_footprint(&[Pose2::new(0.0, 0.0, std::f64::consts::FRAC_PI_2)], &camera(), &hall(false));
        assert!(*left.at([0.0, 1.5]).unwrap() && !*left.at([1.5, 0.0]).unwrap());
        let blocked = camera_footprint(&[Pose2::IDENTITY], &camera(), &hall(true));
        assert!(*blocked.at([1.5, 0.0]).unwrap() && !*blocked.at([2.5, 0.0]).unwrap());
    }
}
