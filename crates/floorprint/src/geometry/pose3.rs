//! Rigid motions of space, for sensor mounts: upside-down and tilted ones too.

use nalgebra::{Matrix3, Rotation3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a sensor is mounted: its pose in the body's frame.
///
/// The body's frame has its origin on the floor midway between the axles, x ahead,
/// y left, z up. The rotation is `Rz(yaw) · Ry(pitch) · Rx(roll)`; a positive pitch
/// looks down, a roll of π is an upside-down mount.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// Metres ahead of the body's origin.
    pub x_m: f64,
    /// Metres to the left of the body's origin.
    pub y_m: f64,
    /// Metres above the floor.
    pub z_m: f64,
    /// Rotation about x, radians.
    pub roll_rad: f64,
    /// Rotation about y, radians; positive looks down.
    pub pitch_rad: f64,
    /// Rotation about z, radians, counter-clockwise.
    pub yaw_rad: f64,
}

impl Mount {
    /// The rigid motion `body_from_sensor`.
    #[must_use]
    pub fn body_from_sensor(&self) -> Pose3 {
        let rotation = Rotation3::from_euler_angles(self.roll_rad, self.pitch_rad, self.yaw_rad);
        Pose3 { rotation: rotation.into_inner(), translation_m: Vector3::new(self.x_m, self.y_m, self.z_m) }
    }
}

/// A rigid motion of space: a rotation matrix and a translation in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose3 {
    /// Orthonormal rotation matrix.
    pub rotation: Matrix3<f64>,
    /// Translation, metres.
    pub translation_m: Vector3<f64>,
}

impl Pose3 {
    /// The motion that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation_m: Vector3::zeros() }
    }

    /// `a_from_b.compose(b_from_c)` = `a_from_c`.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation_m: self.rotation * other.translation_m + self.translation_m,
        }
    }

    /// `a_from_b.inverse()` = `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let transposed = self.rotation.transpose();
        Self { rotation: transposed, translation_m: -(transposed * self.translation_m) }
    }

    /// Maps a point (metres) from the child frame into the parent frame.
    #[must_use]
    pub fn transform_point(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn an_upside_down_lidar_sees_left_as_right() {
        let mount = Mount { roll_rad: PI, ..Mount::default() };
        let point = mount.body_from_sensor().transform_point(Vector3::new(1.0, 2.0, 0.0));
        assert!((point - Vector3::new(1.0, -2.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_positive_pitch_looks_down() {
        let mount = Mount { z_m: 1.0, pitch_rad: 0.5, ..Mount::default() };
        let point = mount.body_from_sensor().transform_point(Vector3::new(1.0, 0.0, 0.0));
        assert!(point.z < 1.0 && point.x > 0.0);
    }

    #[test]
    fn inverse_undoes() {
        let mount = Mount { x_m: 0.3, y_m: -0.2, z_m: 1.0, roll_rad: 0.1, pitch_rad: 0.5, yaw_rad: -1.0 };
        let pose = mount.body_from_sensor();
        let round = pose.compose(&pose.inverse());
        assert!((round.rotation - Matrix3::identity()).norm() < 1e-12 && round.translation_m.norm() < 1e-12);
    }
}
