//! A simulated base that states its own pose, with errors that grow along the way.

use super::config::SimulationConfig;
use super::fault::{Fault, within};
use super::trajectory::Trajectory;
use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use crate::sensors::StampedPose;
use rand::RngExt;
use rand_distr::StandardNormal;

/// When the first pose is stated, seconds into the drive.
const FIRST_S: f64 = 0.1137;
/// Distance between the wheels of a base whose left ones slip, metres.
const TRACK_M: f64 = 0.5;

/// All poses of a drive, `odometry_from_body`; none where encoders are read.
pub(super) fn odometry_poses(simulation: &SimulationConfig, seed: u64, trajectory: &Trajectory) -> Vec<StampedPose> {
    let Some(config) = &simulation.pose_odometry else { return Vec::new() };
    let random = &mut generator(seed, Stage::Sensors, 0, super::SENSOR_ODOMETRY);
    let mut normal = || -> f64 { random.sample(StandardNormal) };
    let interval_s = 1.0 / config.rate_hz;
    let count = ((trajectory.duration_s() - FIRST_S) / interval_s).max(0.0) as usize + 1;
    let mut pose = Pose2::IDENTITY;
    let mut poses = Vec::with_capacity(count);
    for index in 0..count {
        let time_s = FIRST_S + index as f64 * interval_s;
        let true_motion = trajectory.motion(time_s - interval_s, time_s);
        let noise = [0; 3].map(|_| config.slip_noise * normal());
        let length_m = true_motion.distance();
        let mut motion = Pose2::new(
            true_motion.x * (1.0 + config.length_error + noise[0]) - noise[1] * true_motion.y,
            true_motion.y * (1.0 + config.length_error + noise[0]) + noise[1] * true_motion.x,
            true_motion.theta * (1.0 + config.turn_error + noise[2]) + config.drift_rad_per_m * length_m,
        );
        for fault in &simulation.faults {
            match *fault {
                Fault::WheelSlip { from_s, for_s, share } if within(time_s, from_s, for_s) => {
                    (motion.x, motion.y) = (motion.x * (1.0 + share), motion.y * (1.0 + share));
                }
                Fault::LeftWheelsSlip { from_s, for_s, share } if within(time_s, from_s, for_s) => {
                    (motion.x, motion.theta) =
                        (motion.x * (1.0 + 0.5 * share), motion.theta - share * length_m / TRACK_M);
                }
                Fault::EncodersSignLost { from_s, for_s } if within(time_s, from_s, for_s) => {
                    motion.x = motion.x.abs();
                }
                Fault::EncodersJump { from_s, for_s, jump_m }
                    if within(time_s, from_s, for_s) && time_s.fract() < interval_s =>
                {
                    motion.x += if (time_s as u64).is_multiple_of(2) { jump_m } else { -jump_m };
                }
                Fault::EncodersStuck { from_s, for_s } if within(time_s, from_s, for_s) => motion = Pose2::IDENTITY,
                _ => {}
            }
        }
        pose = pose.compose(&motion);
        poses.push(StampedPose { stamp_s: simulation.stamp_s(time_s), pose });
    }
    poses
}
