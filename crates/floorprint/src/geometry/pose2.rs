//! Rigid motions of the plane, SE(2).
//!
//! Names follow the usual reading: `world_from_body` maps a point given in the
//! body's frame into the world, and `a_from_b.compose(b_from_c)` is `a_from_c`.
//! The tangent space is ordered (x, y, θ). Source: Solà, Deray & Atchuthan,
//! "A micro Lie theory for state estimation in robotics" (2018), appendix A.

use super::angle::wrap_angle;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A pose in the plane: a translation in metres and a heading in radians.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose2 {
    /// Position along the parent frame's x axis, metres.
    pub x: f64,
    /// Position along the parent frame's y axis, metres.
    pub y: f64,
    /// Heading, radians, counter-clockwise from the parent frame's x axis.
    pub theta: f64,
}

impl Pose2 {
    /// The motion that changes nothing.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, theta: 0.0 };

    /// A pose from metres and radians; the heading is wrapped to (−π, π].
    #[must_use]
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta: wrap_angle(theta) }
    }

    /// `a_from_b.compose(b_from_c)` = `a_from_c`.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        let [x, y] = self.transform_point([other.x, other.y]);
        Self::new(x, y, self.theta + other.theta)
    }

    /// `a_from_b.inverse()` = `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (sin, cos) = self.theta.sin_cos();
        Self::new(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.theta)
    }

    /// The pose of `other` seen from `self`: `self.inverse().compose(other)`.
    #[must_use]
    pub fn between(&self, other: &Self) -> Self {
        let (sin, cos) = self.theta.sin_cos();
        let (dx, dy) = (other.x - self.x, other.y - self.y);
        Self::new(cos * dx + sin * dy, cos * dy - sin * dx, other.theta - self.theta)
    }

    /// Maps a point (metres) from the child frame into the parent frame.
    #[must_use]
    pub fn transform_point(&self, point_m: [f64; 2]) -> [f64; 2] {
        self.point_transform()(point_m)
    }

    /// The map of [`transform_point`](Self::transform_point) for many points: sine and cosine are computed once.
    pub fn point_transform(&self) -> impl Fn([f64; 2]) -> [f64; 2] + use<> {
        let Self { x: x_m, y: y_m, theta } = *self;
        let (sin, cos) = theta.sin_cos();
        move |[x, y]| [x_m + cos * x - sin * y, y_m + sin * x + cos * y]
    }

    /// The pose reached by moving for one unit of time with a constant body twist
    /// (x, y in metres, θ in radians).
    #[must_use]
    pub fn exp(twist: [f64; 3]) -> Self {
        let [x, y, theta] = twist;
        let (a, b) = sinc_and_versine(theta);
        Self::new(a * x - b * y, b * x + a * y, theta)
    }

    /// The constant body twist that reaches this pose in one unit of time; inverse of [`exp`](Self::exp).
    #[must_use]
    pub fn log(&self) -> [f64; 3] {
        let (a, b) = sinc_and_versine(self.theta);
        let scale = 1.0 / (a * a + b * b);
        [(a * self.x + b * self.y) * scale, (a * self.y - b * self.x) * scale, self.theta]
    }

    /// The adjoint: `exp(adjoint · τ) = self ∘ exp(τ) ∘ self⁻¹`.
    #[must_use]
    pub fn adjoint(&self) -> Matrix3<f64> {
        let (sin, cos) = self.theta.sin_cos();
        Matrix3::new(cos, -sin, self.y, sin, cos, -self.x, 0.0, 0.0, 1.0)
    }

    /// The inverse of the right Jacobian at a twist: how `exp(twist).compose(exp(δ)).log()`
    /// changes with δ at zero (Solà et al. 2018, eqs. 163–164, inverted in closed form).
    #[must_use]
    pub fn right_jacobian_inverse(twist: [f64; 3]) -> Matrix3<f64> {
        let [x, y, theta] = twist;
        let (a, b) = sinc_and_versine(theta);
        let (c, d) = jacobian_coefficients(theta);
        let (u, v) = (c * x - d * y, d * x + c * y);
        let scale = 1.0 / (a * a + b * b);
        Matrix3::new(
            a * scale,
            -b * scale,
            (b * v - a * u) * scale,
            b * scale,
            a * scale,
            -(b * u + a * v) * scale,
            0.0,
            0.0,
            1.0,
        )
    }

    /// The pose a fraction `t` of the way to `other` along the constant twist between them.
    #[must_use]
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        let [x, y, theta] = self.between(other).log();
        self.compose(&Self::exp([x * t, y * t, theta * t]))
    }

    /// Length of the translation, metres.
    #[must_use]
    pub fn distance(&self) -> f64 {
        self.x.hypot(self.y)
    }

    /// Whether all three numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }

    /// (x, y, θ) as a vector.
    #[must_use]
    pub fn to_vector(&self) -> Vector3<f64> {
        Vector3::new(self.x, self.y, self.theta)
    }
}

/// sin θ / θ and (1 − cos θ) / θ, by their series near zero.
fn sinc_and_versine(theta: f64) -> (f64, f64) {
    if theta.abs() < 1e-2 {
        let square = theta * theta;
        (1.0 - square / 6.0 * (1.0 - square / 20.0), theta / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0)))
    } else {
        (theta.sin() / theta, (1.0 - theta.cos()) / theta)
    }
}

/// (θ − sin θ) / θ² and (1 − cos θ) / θ², by their series near zero.
fn jacobian_coefficients(theta: f64) -> (f64, f64) {
    if theta.abs() < 1e-2 {
        let square = theta * theta;
        (theta / 6.0 * (1.0 - square / 20.0), 0.5 - square / 24.0 * (1.0 - square / 30.0))
    } else {
        ((theta - theta.sin()) / (theta * theta), (1.0 - theta.cos()) / (theta * theta))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0_f64, -50.0..50.0_f64, -3.1..3.1_f64).prop_map(|(x, y, t)| Pose2::new(x, y, t))
    }

    fn close(a: &Pose2, b: &Pose2) -> bool {
        (a.x - b.x).abs() < 1e-9 && (a.y - b.y).abs() < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-9
    }

    proptest! {
        #[test]
        fn a_pose_and_its_inverse_cancel(p in pose()) {
            prop_assert!(close(&p.compose(&p.inverse()), &Pose2::IDENTITY));
            prop_assert!(close(&p.inverse().compose(&p), &Pose2::IDENTITY));
        }

        #[test]
        fn composition_is_associative(a in pose(), b in pose(), c in pose()) {
            prop_assert!(close(&a.compose(&b).compose(&c), &a.compose(&b.compose(&c))));
        }

        #[test]
        fn between_undoes_compose(a in pose(), b in pose()) {
            prop_assert!(close(&a.compose(&a.between(&b)), &b));
        }

        #[test]
        fn the_right_jacobian_agrees_with_differences(
            x in -3.0..3.0_f64, y in -3.0..3.0_f64, theta in -3.0..3.0_f64, small in prop::bool::ANY
        ) {
            let twist = [x, y, if small { theta * 1e-3 } else { theta }];
            let jacobian = Pose2::right_jacobian_inverse(twist);
            let step = 1e-5;
            for column in 0..3 {
                let log_at = |sign: f64| {
                    let mut delta = [0.0; 3];
                    delta[column] = sign * step;
                    Pose2::exp(twist).compose(&Pose2::exp(delta)).log()
                };
                let (ahead, behind) = (log_at(1.0), log_at(-1.0));
                for row in 0..3 {
                    let difference = (ahead[row] - behind[row]) / (2.0 * step);
                    prop_assert!((difference - jacobian[(row, column)]).abs() < 1e-7);
                }
            }
        }

        #[test]
        fn exp_and_log_are_inverse(p in pose()) {
            prop_assert!(close(&Pose2::exp(p.log()), &p));
        }

        #[test]
        fn adjoint_moves_a_twist_across(p in pose(), x in -1.0..1.0_f64, y in -1.0..1.0_f64, t in -1.0..1.0_f64) {
            let moved = p.adjoint() * Vector3::new(x, y, t);
            let left = Pose2::exp([moved.x, moved.y, moved.z]).compose(&p);
            let right = p.compose(&Pose2::exp([x, y, t]));
            prop_assert!(close(&left, &right));
        }

        #[test]
        fn interpolation_meets_both_ends(a in pose(), b in pose()) {
            prop_assert!(close(&a.interpolate(&b, 0.0), &a));
            prop_assert!(close(&a.interpolate(&b, 1.0), &b));
        }
    }
}
