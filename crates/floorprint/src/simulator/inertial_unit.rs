//! A simulated inertial unit: a noisy gyro whose bias wanders, and an accelerometer.

use super::config::SimulationConfig;
use super::trajectory::Trajectory;
use crate::random::{Stage, generator};
use crate::sensors::ImuReading;
use rand::RngExt;
use rand_distr::StandardNormal;

/// Standard gravity, m/s².
pub(super) const GRAVITY_M_S2: f64 = 9.80665;

/// All readings of a drive.
pub(super) fn imu_readings(simulation: &SimulationConfig, seed: u64, trajectory: &Trajectory) -> Vec<ImuReading> {
    let config = &simulation.imu;
    if simulation.pose_odometry.is_some() || !config.is_there {
        return Vec::new();
    }
    let random = &mut generator(seed, Stage::Sensors, 0, super::SENSOR_IMU);
    let mut normal = |deviation: f64| -> f64 { deviation * random.sample::<f64, _>(StandardNormal) };
    let mut bias_rad_s: [f64; 3] = std::array::from_fn(|_| normal(config.gyro_bias_rad_s));
    let interval_s = 1.0 / config.rate_hz;
    let drift_rad_s = config.gyro_drift_rad_s * interval_s.sqrt();
    let count = (trajectory.duration_s() / interval_s) as usize + 1;
    (0..count)
        .map(|index| {
            let time_s = index as f64 * interval_s;
            let state = trajectory.at(time_s);
            let before = trajectory.at(time_s - interval_s);
            for bias in &mut bias_rad_s {
                *bias += normal(drift_rad_s);
            }
            let turn_rate_rad_s = [0.0, 0.0, state.turn_rate_rad_s];
            let force_m_s2 = [
                (state.speed_m_s - before.speed_m_s) / interval_s,
                state.speed_m_s * state.turn_rate_rad_s,
                GRAVITY_M_S2,
            ];
            ImuReading {
                stamp_s: simulation.stamp_s(time_s),
                angular_velocity_rad_s: std::array::from_fn(|axis| {
                    turn_rate_rad_s[axis] + bias_rad_s[axis] + normal(config.gyro_noise_rad_s)
                }),
                linear_acceleration_m_s2: force_m_s2.map(|force| force + normal(config.acceleration_noise_m_s2)),
            }
        })
        .collect()
}
