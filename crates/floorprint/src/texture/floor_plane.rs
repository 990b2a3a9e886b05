//! The floor's plane in a disparity image, by random sample consensus and least squares.
//!
//! The disparity term dd is proportional to the inverse depth (eq. 24), and the inverse
//! depth of a plane is affine in the pixel: `dd = a·u + b·v + c`. So the plane is fitted to
//! the raw disparities, whose noise is the same everywhere, and no pixel needs to be
//! turned into a point. Fischler & Bolles (1981) for the consensus.

use super::camera::RgbdCamera;
use super::config::TextureConfig;
use super::floor_patch::FloorPatch;
use crate::random::{Stage, generator};
use crate::sensors::DepthImage;
use nalgebra::{Matrix3, Vector3};
use rand::RngExt;

/// How the floor lies against the camera's stated mount.
///
/// The mount is right after turning the camera about its own centre by `roll_rad` about the
/// body's x axis, then by `pitch_rad` about its y axis (positive: it looks farther down than
/// stated), and raising it by `height_m`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FloorTilt {
    /// Roll of the camera beyond the stated one, radians.
    pub roll_rad: f64,
    /// Pitch of the camera beyond the stated one, radians.
    pub pitch_rad: f64,
    /// Height of the camera above the stated one, metres.
    pub height_m: f64,
}

/// A plane as an affine function of the depth camera's pixels: `dd = (u, v, 1) · coefficients`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisparityPlane {
    pub coefficients: Vector3<f64>,
}

/// What a disparity image says about the floor: least squares' normal equations of the
/// plane's deviation from the stated one, so that neighbouring images can be joined.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct FloorEvidence {
    pub information: Matrix3<f64>,
    pub vector: Vector3<f64>,
}

impl DisparityPlane {
    /// The body's plane z = 0 as `camera` sees it.
    pub(super) fn of_floor(camera: &RgbdCamera) -> Self {
        let depth = &camera.depth;
        let down = depth.body_from_optical.rotation.transpose() * Vector3::new(0.0, 0.0, -1.0);
        let scaled = down * (camera.depth_numerator_m / camera.height_m());
        let (a, b) = (scaled.x / depth.focal_px[0], scaled.y / depth.focal_px[1]);
        let c = scaled.z - a * depth.center_px[0] - b * depth.center_px[1];
        Self { coefficients: Vector3::new(a, b, c) }
    }

    /// The tilt that puts the body's floor into this plane; `camera` has the stated mount.
    /// Nothing when the plane does not lie below the camera.
    pub(super) fn tilt(&self, camera: &RgbdCamera) -> Option<FloorTilt> {
        let depth = &camera.depth;
        let [a, b, c] = self.coefficients.into();
        let scaled = Vector3::new(
            a * depth.focal_px[0],
            b * depth.focal_px[1],
            c + a * depth.center_px[0] + b * depth.center_px[1],
        );
        let up = depth.body_from_optical.rotation * -scaled.normalize();
        let roll_rad = up.y.atan2(up.z);
        let pitch_rad = (-up.x).atan2(up.y.hypot(up.z));
        let height_m = camera.depth_numerator_m / scaled.norm() - camera.height_m();
        let finite = roll_rad.is_finite() && pitch_rad.is_finite() && height_m.is_finite();
        (finite && up.z > 0.0).then_some(FloorTilt { roll_rad, pitch_rad, height_m })
    }

    /// `dd` of the plane at a pixel.
    pub(super) fn at(&self, column: f64, row: f64) -> f64 {
        self.coefficients.x * column + self.coefficients.y * row + self.coefficients.z
    }
}

/// Every this many pixels in both directions one takes part in the fit.
const STRIDE_PX: usize = 6;
/// Planes tried by the consensus.
const HYPOTHESES: usize = 60;
/// Pixels that a plane needs to be believed.
const SUPPORT_MIN: usize = 150;
/// Rounds of least squares on the consensus.
const REFINEMENTS: usize = 3;

/// Fits the floor's plane; nothing when too few pixels agree on a plane within the limits.
pub(super) fn fit_floor(
    image: &DepthImage,
    camera: &RgbdCamera,
    config: &TextureConfig,
    seed: u64,
) -> Option<(DisparityPlane, FloorEvidence)> {
    let stated = DisparityPlane::of_floor(camera);
    let height_m = camera.height_m();
    let candidates = candidates(image, camera, config, &stated);
    if candidates.len() < SUPPORT_MIN {
        return None;
    }
    let within = |tilt: FloorTilt| {
        tilt.roll_rad.abs() <= config.tilt_max_rad
            && tilt.pitch_rad.abs() <= config.tilt_max_rad
            && tilt.height_m.abs() <= config.height_error_max_m
    };
    let relative_tolerance = config.plane_tolerance_m / height_m;
    let agrees = |plane: &DisparityPlane, pixel: &Vector3<f64>| {
        let expected = plane.at(pixel.x, pixel.y);
        (pixel.z - expected).abs() <= relative_tolerance * expected
    };
    let mut random = generator(seed, Stage::FloorPlane, image.stamp_s.to_bits(), 0);
    let mut best: Option<(usize, DisparityPlane)> = None;
    for _ in 0..HYPOTHESES {
        let corners = [(); 3].map(|()| candidates[random.random_range(0..candidates.len())]);
        let Some(plane) = plane_through(&corners) else { continue };
        if !plane.tilt(camera).is_some_and(within) {
            continue;
        }
        let support = candidates.iter().step_by(4).filter(|pixel| agrees(&plane, pixel)).count();
        if best.is_none_or(|(most, _)| support > most) {
            best = Some((support, plane));
        }
    }
    let mut plane = best?.1;
    let mut evidence = None;
    for _ in 0..REFINEMENTS {
        let members: Vec<Vector3<f64>> = candidates.iter().filter(|pixel| agrees(&plane, pixel)).copied().collect();
        if members.len() < SUPPORT_MIN {
            return None;
        }
        let equations = FloorEvidence::of(&members, &stated);
        plane = equations.plane(&stated)?;
        evidence = Some(equations);
    }
    let tilt = plane.tilt(camera)?;
    within(tilt).then_some((plane, evidence?))
}

/// Pixels (column, row, dd) that may be floor within the limits of tilt and height.
fn candidates(
    image: &DepthImage,
    camera: &RgbdCamera,
    config: &TextureConfig,
    stated: &DisparityPlane,
) -> Vec<Vector3<f64>> {
    let height_m = camera.height_m();
    let mut pixels = Vec::new();
    for row in (0..image.height).step_by(STRIDE_PX) {
        for column in (0..image.width).step_by(STRIDE_PX) {
            let Some(dd) = camera.disparity_term(image.values[row * image.width + column]) else { continue };
            let (u, v) = (column as f64, row as f64);
            // A point at depth n/dd stands this far above the stated floor.
            let above_m = height_m * (1.0 - stated.at(u, v) / dd);
            let slack_m = config.height_error_max_m
                + config.plane_tolerance_m
                + config.tilt_max_rad * camera.depth_numerator_m / dd;
            if above_m.abs() <= slack_m {
                pixels.push(Vector3::new(u, v, dd));
            }
        }
    }
    pixels
}

/// The plane through three pixels (column, row, dd).
fn plane_through(corners: &[Vector3<f64>; 3]) -> Option<DisparityPlane> {
    let rows = Matrix3::from_rows(&corners.map(|pixel| Vector3::new(pixel.x, pixel.y, 1.0).transpose()));
    let values = Vector3::new(corners[0].z, corners[1].z, corners[2].z);
    rows.lu().solve(&values).map(|coefficients| DisparityPlane { coefficients })
}

impl FloorEvidence {
    /// The normal equations of `members` (column, row, dd) about the stated plane.
    fn of(members: &[Vector3<f64>], stated: &DisparityPlane) -> Self {
        let mut sum = Self::default();
        for pixel in members {
            let regressor = Vector3::new(pixel.x, pixel.y, 1.0);
            sum.information += regressor * regressor.transpose();
            sum.vector += regressor * (pixel.z - stated.at(pixel.x, pixel.y));
        }
        sum
    }

    /// The plane that fits best.
    fn plane(&self, stated: &DisparityPlane) -> Option<DisparityPlane> {
        let deviation = self.information.cholesky()?.solve(&self.vector);
        Some(DisparityPlane { coefficients: stated.coefficients + deviation })
    }
}

/// Part of every image's evidence that counts at any distance in time, so that an image far
/// from all others takes over what the drive as a whole says.
const TIMELESS_WEIGHT: f64 = 1e-3;

/// The floor's tilt at each patch: all images' evidence, weighted by exp(−|Δt| / `smoothing_s`).
///
/// One image that shows little floor says little about its tilt, while the mount does not
/// change and the body rocks only slowly. Without any evidence the mount is taken as stated.
pub(super) fn smoothed_tilts(patches: &[FloorPatch], camera: &RgbdCamera, smoothing_s: f64) -> Vec<FloorTilt> {
    let stated = DisparityPlane::of_floor(camera);
    let tilt_at = |stamp_s: f64| {
        let mut joined = FloorEvidence::default();
        for patch in patches {
            let Some(evidence) = &patch.evidence else { continue };
            let age = (patch.stamp_s - stamp_s).abs() / smoothing_s.max(f64::MIN_POSITIVE);
            let weight = (-age).exp() + TIMELESS_WEIGHT;
            joined.information += evidence.information * weight;
            joined.vector += evidence.vector * weight;
        }
        joined.plane(&stated).and_then(|plane| plane.tilt(camera)).unwrap_or_default()
    };
    patches.iter().map(|patch| tilt_at(patch.stamp_s)).collect()
}
