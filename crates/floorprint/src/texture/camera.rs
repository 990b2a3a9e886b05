//! An RGB-D camera as two pinhole cameras, depth and colour (report eqs. 23–28).
//!
//! Any such camera is described by two pinhole cameras and by what its depth images' values mean. The course's Kinect
//! is one of them: its eqs. 25–26 give the colour pixel of a depth pixel (u, v) with disparity term dd. Put
//! u = f X/Z + c and dd = n/Z into them and the colour camera is itself a pinhole camera,
//! turned like the depth camera and shifted sideways: its column is
//! `color_focal·f/divisor · (X + t)/Z + (color_focal·c + offset)/divisor` with
//! `t = color_baseline · n / (color_focal · f)`. So the colour camera can be placed at the
//! body's pose of its own time.

use super::camera_error::CameraError;
use super::distortion::Distortion;
use super::floor_plane::FloorTilt;
use crate::geometry::{Mount, Pose2, Pose3};
use crate::sensors::{CameraConfig, DepthCameraConfig, PinholeConfig, RobotConfig};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Columns and rows of the Kinect's images, pixels.
const KINECT_SIZE_PX: [usize; 2] = [640, 480];

/// A pinhole camera at a place of the body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pinhole {
    /// Columns and rows of its images, pixels.
    pub size_px: [usize; 2],
    /// Focal lengths along columns and rows, pixels.
    pub focal_px: [f64; 2],
    /// Column and row of the principal point, pixels.
    pub center_px: [f64; 2],
    /// `body_from_optical`; the optical frame has x right, y down, z ahead.
    pub body_from_optical: Pose3,
    /// What the lens does to the images; none of images that are as a pinhole's.
    pub distortion: Option<Distortion>,
}

impl Pinhole {
    fn new(config: &PinholeConfig) -> Self {
        Self {
            size_px: [config.columns_px as usize, config.rows_px as usize],
            focal_px: [config.focal_columns_px, config.focal_rows_px],
            center_px: [config.center_column_px, config.center_row_px],
            body_from_optical: body_from_optical(&config.mount),
            distortion: Distortion::new(&config.distortion),
        }
    }

    /// The pixel of the image, as the lens makes it, for a pixel of the ideal image.
    pub(super) fn image_from_ideal(&self, column: f64, row: f64) -> (f64, f64) {
        let Some(distortion) = &self.distortion else { return (column, row) };
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.center_px);
        let [x, y] = distortion.apply([(column - cx) / fx, (row - cy) / fy]);
        (fx * x + cx, fy * y + cy)
    }
    /// The homography `pixel_from_floor`: (x, y, 1) on the body's plane z = 0, metres, to
    /// homogeneous pixels whose third coordinate is the depth along the optical axis, metres.
    pub(super) fn pixel_from_floor(&self) -> Matrix3<f64> {
        let (linear, offset) = self.pixel_from_body();
        Matrix3::from_columns(&[linear.column(0).into_owned(), linear.column(1).into_owned(), offset])
    }

    /// The projection of points of the body, metres, to homogeneous pixels: a matrix and an offset.
    pub(crate) fn pixel_from_body(&self) -> (Matrix3<f64>, Vector3<f64>) {
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

/// What the values of a depth image mean: each is a term dd that is proportional to the inverse depth.
#[derive(Debug, Clone, Copy)]
pub(super) enum DepthValue {
    /// `dd = scale · d + offset` (eq. 23).
    Disparity { scale: f64, offset: f64 },
    /// Depths in millimetres.
    Millimetres,
}

/// An RGB-D camera: depth camera, colour camera and what depth images hold.
#[derive(Debug, Clone)]
pub struct RgbdCamera {
    pub(crate) depth: Pinhole,
    pub(crate) color: Pinhole,
    pub(super) value: DepthValue,
    /// `depth = numerator / dd` (eq. 24), metres.
    pub(super) depth_numerator_m: f64,
    /// How much dd scatters from pixel to pixel.
    pub(super) dd_noise: f64,
    /// The nearest and the farthest depth that is used, metres.
    pub(crate) depth_limits_m: [f64; 2],
    /// The same as dd: that of the farthest and that of the nearest depth.
    dd_limits: [f64; 2],
    /// Its section of the robot's calibration.
    section: &'static str,
}

/// `body_from_optical` of a camera that looks along its mount's x axis.
fn body_from_optical(mount: &Mount) -> Pose3 {
    let body_from_camera = mount.body_from_sensor();
    let camera_from_optical = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    Pose3 { rotation: body_from_camera.rotation * camera_from_optical, ..body_from_camera }
}

impl From<&DepthCameraConfig> for RgbdCamera {
    fn from(config: &DepthCameraConfig) -> Self {
        Self {
            depth: Pinhole::new(&config.depth),
            color: Pinhole::new(&config.color),
            value: DepthValue::Millimetres,
            // dd is the inverse depth itself.
            depth_numerator_m: 1.0,
            dd_noise: config.inverse_depth_noise_per_m,
            depth_limits_m: [config.depth_min_m, config.depth_max_m],
            dd_limits: [1.0 / config.depth_max_m, 1.0 / config.depth_min_m],
            section: "depth_camera",
        }
    }
}

impl From<&CameraConfig> for RgbdCamera {
    fn from(config: &CameraConfig) -> Self {
        let body_from_optical = body_from_optical(&config.mount);
        let depth = Pinhole {
            size_px: KINECT_SIZE_PX,
            focal_px: [config.depth_focal_px; 2],
            center_px: [config.depth_center_column_px, config.depth_center_row_px],
            body_from_optical,
            distortion: None,
        };
        let scale = config.color_focal / config.color_divisor;
        let shift_m = config.color_baseline * config.depth_numerator_m / (config.color_focal * config.depth_focal_px);
        let color_in_optical = Vector3::new(-shift_m, 0.0, 0.0);
        let color = Pinhole {
            size_px: KINECT_SIZE_PX,
            distortion: None,
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
        Self {
            depth,
            color,
            value: DepthValue::Disparity { scale: config.disparity_scale, offset: config.disparity_offset },
            depth_numerator_m: config.depth_numerator_m,
            dd_noise: config.disparity_scale.abs(),
            depth_limits_m: [config.depth_min_m, config.depth_max_m],
            dd_limits: [config.depth_numerator_m / config.depth_max_m, config.depth_numerator_m / config.depth_min_m],
            section: "camera",
        }
    }
}

impl RgbdCamera {
    /// The camera of a robot; none when it has none. The Kinect of the course goes before another.
    #[must_use]
    pub fn of(robot: &RobotConfig) -> Option<Self> {
        let kinect = robot.camera.as_ref().map(Self::from);
        kinect.or_else(|| robot.depth_camera.as_ref().map(Self::from))
    }

    /// The same camera, of which nothing farther away is used, metres.
    #[must_use]
    pub fn up_to(mut self, distance_max_m: f64) -> Self {
        self.depth_limits_m[1] = self.depth_limits_m[1].min(distance_max_m);
        self.dd_limits[0] = self.depth_numerator_m / self.depth_limits_m[1];
        self
    }

    /// `dd` of a depth image's raw value, or nothing when it is no measurement within the limits.
    pub(super) fn disparity_term(&self, value: u16) -> Option<f64> {
        let dd = match self.value {
            DepthValue::Disparity { .. } if value >= INVALID_DISPARITY => return None,
            DepthValue::Disparity { scale, offset } => scale * f64::from(value) + offset,
            // Nothing is at an infinite distance.
            DepthValue::Millimetres => self.depth_numerator_m * 1000.0 / f64::from(value),
        };
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
            if right { Ok(()) } else { Err(CameraError { section: self.section, found, expected }) }
        };
        let focal = [self.depth.focal_px, self.color.focal_px].concat();
        let usable = |value: f64| value.is_finite() && value > 0.0;
        require(focal.iter().copied().all(usable), format!("focal lengths {focal:?} px"), "positive numbers")?;
        let [nearest_m, farthest_m] = self.depth_limits_m;
        require(
            usable(nearest_m) && usable(farthest_m) && nearest_m < farthest_m,
            format!("depths from {nearest_m} to {farthest_m} m"),
            "a nearest depth above 0 and below the farthest (`depth_max_m`, `texture.distance_max_m`)",
        )?;
        if let DepthValue::Disparity { scale, .. } = self.value {
            require(scale.is_finite() && scale != 0.0, format!("disparity_scale {scale}"), "a number other than 0")?;
        }
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
        let camera = RgbdCamera::from(&config);
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
