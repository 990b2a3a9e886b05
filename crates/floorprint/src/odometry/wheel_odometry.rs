//! Wheel odometry, with the gyro's turn where there is one (report eqs. 14–19).
//!
//! The step of eq. 14 is taken along the arc of a constant twist instead of along its
//! chord, and the heading is followed at the gyro's own rate between the readings of the
//! wheels.

use super::differential_drive::WheelStep;
use super::gyro_heading::GyroHeading;
use crate::geometry::Pose2;
use crate::sensors::StampedPose;

/// The knots of the trajectory, and for how long the wheels had to give the yaw while they moved.
#[derive(Debug, Clone, Default)]
pub(super) struct WheelOdometry {
    pub(super) knots: Vec<StampedPose>,
    /// Time in motion during which the gyro was silent, seconds.
    pub(super) moved_without_gyro_s: f64,
}

/// Integrates the steps from the identity; the wheels give the yaw where the gyro is silent.
pub(super) fn integrate(steps: &[WheelStep], gyro: &GyroHeading, track_width_m: f64) -> WheelOdometry {
    let mut odometry = WheelOdometry::default();
    let Some(first) = steps.first() else { return odometry };
    let mut pose = Pose2::IDENTITY;
    odometry.knots.push(StampedPose { stamp_s: first.from_s, pose });
    for step in steps {
        let mut from_s = step.from_s;
        for &to_s in gyro.stamps_within(step.from_s, step.to_s).iter().chain(&[step.to_s]) {
            let share = if step.to_s > step.from_s { (to_s - from_s) / (step.to_s - step.from_s) } else { 1.0 };
            let turn_rad = gyro.turn_rad(from_s, to_s).unwrap_or_else(|| {
                if step.distance_m != 0.0 || step.difference_m != 0.0 {
                    odometry.moved_without_gyro_s += to_s - from_s;
                }
                share * step.yaw_rad(track_width_m)
            });
            pose = pose.compose(&Pose2::exp([share * step.distance_m, 0.0, turn_rad]));
            odometry.knots.push(StampedPose { stamp_s: to_s, pose });
            from_s = to_s;
        }
    }
    odometry
}
