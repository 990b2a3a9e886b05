//! Small covariance and information matrices over (x, y, θ).

use super::Pose2;
use nalgebra::Matrix3;

/// The inverse of a covariance or of an information matrix; the identity where it has none.
pub(crate) fn inverse(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    matrix.try_inverse().unwrap_or_else(Matrix3::identity)
}

/// The symmetric part: rounding makes products of symmetric matrices lean a little.
pub(crate) fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (matrix + matrix.transpose())
}

/// A covariance over (x, y, θ) in the world's axes, turned into the axes of a pose.
pub(crate) fn in_frame_of(covariance: &Matrix3<f64>, pose: &Pose2) -> Matrix3<f64> {
    let (sin, cos) = pose.theta.sin_cos();
    let turn = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
    turn * covariance * turn.transpose()
}

/// A diagonal covariance: variances of position (m²) and heading (rad²) from their standard deviations.
pub(crate) fn isotropic(sigma_m: f64, sigma_rad: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&[sigma_m * sigma_m, sigma_m * sigma_m, sigma_rad * sigma_rad].into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn turning_into_a_frame_and_back_changes_nothing(theta in -3.0..3.0_f64, x in 0.1..2.0_f64, y in 0.1..2.0_f64) {
            let covariance = Matrix3::new(x, 0.01, 0.02, 0.01, y, 0.0, 0.02, 0.0, 0.3);
            let there = in_frame_of(&covariance, &Pose2::new(1.0, 2.0, theta));
            prop_assert!((in_frame_of(&there, &Pose2::new(0.0, 0.0, -theta)) - covariance).amax() < 1e-12);
            // What is uncertain ahead of a robot that looks along y is uncertain along the world's y.
            let ahead = in_frame_of(&covariance, &Pose2::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
            prop_assert!((ahead[(0, 0)] - y).abs() < 1e-12 && (ahead[(1, 1)] - x).abs() < 1e-12);
        }

        #[test]
        fn the_inverse_of_the_inverse_is_the_matrix(x in 0.1..2.0_f64, y in 0.1..2.0_f64) {
            let covariance = isotropic(x, y);
            prop_assert!((inverse(&inverse(&covariance)) - covariance).amax() < 1e-9);
        }
    }
}
