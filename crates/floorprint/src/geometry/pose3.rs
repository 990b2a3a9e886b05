//! Rigid motions of space, for sensor mounts: upside-down and tilted ones too.

use super::Pose2;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
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

    /// The mount of a sensor at the pose `body_from_sensor`.
    #[must_use]
    pub fn of(body_from_sensor: &Pose3) -> Self {
        let rotation = Rotation3::from_matrix_unchecked(body_from_sensor.rotation);
        // No zero has a sign: a pitch of -0.0 puzzles whoever reads it.
        let (roll_rad, pitch_rad, yaw_rad) = rotation.euler_angles();
        let [roll_rad, pitch_rad, yaw_rad] = [roll_rad, pitch_rad, yaw_rad].map(|angle_rad| angle_rad + 0.0);
        let [x_m, y_m, z_m] = body_from_sensor.translation_m.map(|metres| metres + 0.0).into();
        Self { x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad }
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

    /// The motion of a translation in metres and a quaternion x, y, z, w of any length. Of length zero, which
    /// stands for an orientation that is not known, it turns nothing.
    #[must_use]
    pub fn from_quaternion(translation_m: [f64; 3], [x, y, z, w]: [f64; 4]) -> Self {
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9).unwrap_or_default();
        Self { rotation: rotation.to_rotation_matrix().into_inner(), translation_m: translation_m.into() }
    }

    /// The motion in the plane: height, roll and pitch are left out.
    #[must_use]
    pub fn in_plane(&self) -> Pose2 {
        let yaw = self.rotation[(1, 0)].atan2(self.rotation[(0, 0)]);
        Pose2::new(self.translation_m.x, self.translation_m.y, yaw)
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
    fn no_zero_of_a_mount_has_a_sign() {
        let level = Mount::of(&Pose3 { translation_m: Vector3::new(-0.0, 0.0, 0.0), ..Pose3::identity() });
        let Mount { x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad } = level;
        assert!(
            [x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad].iter().all(|number| number.is_sign_positive()),
            "{level:?}"
        );
    }

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
    fn a_mount_is_its_poses_mount() {
        let mount = Mount { x_m: 0.3, y_m: -0.2, z_m: 1.0, roll_rad: 3.0, pitch_rad: 0.5, yaw_rad: -1.0 };
        let again = Mount::of(&mount.body_from_sensor());
        let difference = again.body_from_sensor().rotation - mount.body_from_sensor().rotation;
        assert!(difference.norm() < 1e-12 && (again.roll_rad - 3.0).abs() < 1e-12 && again.z_m == 1.0);
    }

    #[test]
    fn quaternions_of_any_length_turn() {
        let half = 0.4_f64;
        let pose = Pose3::from_quaternion([1.0, 2.0, 3.0], [0.0, 0.0, 5.0 * half.sin(), 5.0 * half.cos()]).in_plane();
        assert!((pose.x, pose.y) == (1.0, 2.0) && (pose.theta - 0.8).abs() < 1e-12);
        assert_eq!(Pose3::from_quaternion([0.0; 3], [0.0; 4]), Pose3::identity());
    }

    #[test]
    fn inverse_undoes() {
        let mount = Mount { x_m: 0.3, y_m: -0.2, z_m: 1.0, roll_rad: 0.1, pitch_rad: 0.5, yaw_rad: -1.0 };
        let pose = mount.body_from_sensor();
        let round = pose.compose(&pose.inverse());
        assert!((round.rotation - Matrix3::identity()).norm() < 1e-12 && round.translation_m.norm() < 1e-12);
    }
}
