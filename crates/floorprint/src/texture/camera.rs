//! The RGB-D camera as two pinhole cameras, depth and colour (report eqs. 23–28).
//!
//! Eqs. 25–26 give the colour pixel of a depth pixel (u, v) with disparity term dd. Put
//! u = f X/Z + c and dd = n/Z into them and the colour camera is itself a pinhole camera,
//! turned like the depth camera and shifted sideways: its column is
//! `color_focal·f/divisor · (X + t)/Z + (color_focal·c + offset)/divisor` with
//! `t = color_baseline · n / (color_focal · f)`. So the colour camera can be placed at the
//! body's pose of its own time.

use super::camera_error::CameraError;
use super::floor_plane::FloorTilt;
use crate::geometry::{Pose2, Pose3};
use crate::sensors::CameraConfig;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// A pinhole camera at a place of the body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pinhole {
    /// Focal lengths along columns and rows, pixels.
    pub focal_px: [f64; 2],
    /// Column and row of the principal point, pixels.
    pub center_px: [f64; 2],
    /// `body_from_optical`; the optical frame has x right, y down, z ahead.
    pub body_from_optical: Pose3,
}

impl Pinhole {
    /// The homography `pixel_from_floor`: (x, y, 1) on the body's plane z = 0, metres, to
    /// homogeneous pixels whose third coordinate is the depth along the optical axis, metres.
    pub(super) fn pixel_from_floor(&self) -> Matrix3<f64> {
        let (linear, offset) = self.pixel_from_body();
        Matrix3::from_columns(&[linear.column(0).into_owned(), linear.column(1).into_owned(), offset])
    }

    /// The projection of points of the body, metres, to homogeneous pixels: a matrix and an offset.
    pub(super) fn pixel_from_body(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let optical_from_body = self.body_from_optical.inverse();
        let intrinsics = self.intrinsics();
        (intrinsics * optical_from_body.rotation, intrinsics * optical_from_body.translation_m)
    }

    /// The matrix K of eq. 28.
    fn intrinsics(&self) -> Matrix3<f64> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.center_px);
        Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    }
}

/// Depth camera, colour camera and disparity model.
#[derive(Debug, Clone)]
pub(super) struct RgbdCamera {
    pub depth: Pinhole,
    pub color: Pinhole,
    /// `dd = scale · d + offset` (eq. 23).
    pub disparity_scale: f64,
    pub disparity_offset: f64,
    /// `depth = numerator / dd` (eq. 24), metres.
    pub depth_numerator_m: f64,
    /// Limits of dd between the farthest and the nearest depth that is used.
    pub dd_limits: [f64; 2],
}

impl RgbdCamera {
    pub(super) fn new(config: &CameraConfig, distance_max_m: f64) -> Self {
        let body_from_camera = config.mount.body_from_sensor();
        let camera_from_optical = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let body_from_optical = Pose3 { rotation: body_from_camera.rotation * camera_from_optical, ..body_from_camera };
        let depth = Pinhole {
            focal_px: [config.depth_focal_px; 2],
            center_px: [config.depth_center_column_px, config.depth_center_row_px],
            body_from_optical,
        };
        let scale = config.color_focal / config.color_divisor;
        let shift_m = config.color_baseline * config.depth_numerator_m / (config.color_focal * config.depth_focal_px);
        let color_in_optical = Vector3::new(-shift_m, 0.0, 0.0);
        let color = Pinhole {
            focal_px: [scale * config.depth_focal_px; 2],
            center_px: [
                scale * config.depth_center_column_px + config.color_column_offset / config.color_divisor,
                scale * config.depth_center_row_px + config.color_row_offset / config.color_divisor,
            ],
            body_from_optical: Pose3 {
                rotation: body_from_optical.rotation,
                translation_m: body_from_optical.transform_point(color_in_optical),
            },
        };
        let farthest_m = config.depth_max_m.min(distance_max_m);
        Self {
            depth,
            color,
            disparity_scale: config.disparity_scale,
            disparity_offset: config.disparity_offset,
            depth_numerator_m: config.depth_numerator_m,
            dd_limits: [config.depth_numerator_m / farthest_m, config.depth_numerator_m / config.depth_min_m],
        }
    }

    /// `dd` of a raw disparity, or nothing when it is no measurement within the limits.
    pub(super) fn disparity_term(&self, disparity: u16) -> Option<f64> {
        if disparity >= INVALID_DISPARITY {
            return None;
        }
        let dd = self.disparity_scale * f64::from(disparity) + self.disparity_offset;
        (dd >= self.dd_limits[0] && dd <= self.dd_limits[1]).then_some(dd)
    }

    /// The camera as it is mounted when the floor lies as `tilt` says.
    pub(super) fn tilted(&self, tilt: &FloorTilt) -> Self {
        let pivot_m = self.depth.body_from_optical.translation_m;
        let rotation = Rotation3::from_euler_angles(tilt.roll_rad, tilt.pitch_rad, 0.0).into_inner();
        let raised = Vector3::new(0.0, 0.0, tilt.height_m);
        let correction = Pose3 { rotation, translation_m: pivot_m - rotation * pivot_m + raised };
        let correct = |pinhole: &Pinhole| Pinhole {
            body_from_optical: correction.compose(&pinhole.body_from_optical),
            ..*pinhole
        };
        Self { depth: correct(&self.depth), color: correct(&self.color), ..self.clone() }
    }

    /// Whether the calibration can be that of a camera that sees the floor.
    pub(super) fn validate(&self) -> Result<(), CameraError> {
        let require = |right: bool, found: String, expected| {
            if right { Ok(()) } else { Err(CameraError { found, expected }) }
        };
        let focal = [self.depth.focal_px[0], self.color.focal_px[0]];
        let usable = |value: f64| value.is_finite() && value > 0.0;
        require(focal.into_iter().all(usable), format!("focal lengths {focal:?} px"), "positive numbers")?;
        let [farthest, nearest] = self.dd_limits;
        require(
            usable(farthest) && usable(nearest) && farthest < nearest,
            format!("depths from {} to {} m", self.depth_numerator_m / nearest, self.depth_numerator_m / farthest),
            "a nearest depth above 0 and below the farthest (`depth_max_m`, `texture.distance_max_m`)",
        )?;
        let scale = self.disparity_scale;
        require(scale.is_finite() && scale != 0.0, format!("disparity_scale {scale}"), "a number other than 0")?;
        let height_m = self.height_m();
        require(usable(height_m), format!("mount {height_m} m above the floor"), "a camera above the floor")
    }

    /// Height of the depth camera above the floor, metres.
    pub(super) fn height_m(&self) -> f64 {
        self.depth.body_from_optical.translation_m.z
    }
}

/// The driver's mark for a pixel without a measurement; disparities have 11 bits.
pub(super) const INVALID_DISPARITY: u16 = 2047;

/// `a_from_b` on the plane as a homography.
pub(super) fn plane_motion(a_from_b: &Pose2) -> Matrix3<f64> {
    let (sin, cos) = a_from_b.theta.sin_cos();
    Matrix3::new(cos, -sin, a_from_b.x, sin, cos, a_from_b.y, 0.0, 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Mount;

    #[test]
    fn the_colour_pinhole_is_the_reports_map_between_the_images() {
        let config = CameraConfig {
            mount: Mount { x_m: 0.18, y_m: 0.005, z_m: 0.487, pitch_rad: 0.36, yaw_rad: 0.021, roll_rad: 0.0 },
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
        };
        let camera = RgbdCamera::new(&config, 4.0);
        let (linear, offset) = camera.color.pixel_from_body();
        for (u, v, disparity) in [(10.0, 400.0, 600), (320.0, 240.0, 1000), (630.0, 20.0, 850)] {
            let dd = camera.disparity_term(disparity).unwrap();
            let depth_m = 1.03 / dd;
            let optical = Vector3::new((u - 315.838) / 585.051, (v - 242.941) / 585.051, 1.0) * depth_m;
            let pixel = linear * camera.depth.body_from_optical.transform_point(optical) + offset;
            let column = (526.37 * u - 4.5 * 1750.46 * dd + 19276.0) / 585.051;
            let row = (526.37 * v + 16662.0) / 585.051;
            assert!((pixel.x / pixel.z - column).abs() < 1e-9 && (pixel.y / pixel.z - row).abs() < 1e-9);
        }
    }
}
