//! Simulated wheel encoders: whole ticks of four wheels, with scale errors, slip and faults.

use super::config::SimulationConfig;
use super::fault::{Fault, within};
use super::trajectory::Trajectory;
use crate::random::{Stage, generator};
use crate::sensors::EncoderReading;
use rand::RngExt;
use rand_distr::StandardNormal;

/// When the first reading is taken, seconds into the drive.
const FIRST_S: f64 = 0.2637;

/// A reading of the four wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelCounts {
    /// Time of the reading, seconds.
    pub stamp_s: f64,
    /// Ticks since the previous reading: front right, front left, rear right, rear left.
    pub ticks: [i16; 4],
}

impl WheelCounts {
    /// The mean of each side.
    #[must_use]
    pub fn reading(&self) -> EncoderReading {
        let [front_right, front_left, rear_right, rear_left] = self.ticks.map(f64::from);
        EncoderReading {
            stamp_s: self.stamp_s,
            left_ticks: 0.5 * (front_left + rear_left),
            right_ticks: 0.5 * (front_right + rear_right),
        }
    }
}

/// All readings of a drive; none without wheels.
pub(super) fn wheel_counts(simulation: &SimulationConfig, seed: u64, trajectory: &Trajectory) -> Vec<WheelCounts> {
    let Some(calibration) = simulation.robot.wheels.as_ref().filter(|_| simulation.pose_odometry.is_none()) else {
        return Vec::new();
    };
    let config = &simulation.wheels;
    let random = &mut generator(seed, Stage::Sensors, 0, super::SENSOR_WHEELS);
    let mut normal = || -> f64 { random.sample(StandardNormal) };
    // A side's tyres wear alike; where in a tick each of the four wheels starts is left to chance.
    let scales: [f64; 2] = std::array::from_fn(|_| 1.0 + config.scale_error * normal());
    let mut turned_ticks: [f64; 4] = std::array::from_fn(|_| normal().abs().fract());
    let interval_s = 1.0 / config.rate_hz;
    let count = ((trajectory.duration_s() - FIRST_S) / interval_s).max(0.0) as usize + 1;
    let mut counts = Vec::with_capacity(count);
    for index in 0..count {
        let time_s = FIRST_S + index as f64 * interval_s;
        let track_width_m = calibration.track_width_m * (1.0 + config.track_error);
        let rolled_m = rolled_m(track_width_m, trajectory, time_s - interval_s, time_s);
        let mut lost = false;
        let mut ticks = [0; 4];
        for (side, per_tick_m) in [calibration.right_m_per_tick, calibration.left_m_per_tick].into_iter().enumerate() {
            let mut distance_m = rolled_m[side] * scales[side] * (1.0 + config.slip_noise * normal());
            for fault in &simulation.faults {
                match *fault {
                    Fault::WheelSlip { from_s, for_s, share } if within(time_s, from_s, for_s) => {
                        distance_m *= 1.0 + share;
                    }
                    Fault::LeftWheelsSlip { from_s, for_s, share } if side == 1 && within(time_s, from_s, for_s) => {
                        distance_m *= 1.0 + share;
                    }
                    Fault::EncodersSignLost { from_s, for_s } if within(time_s, from_s, for_s) => {
                        distance_m = distance_m.abs();
                    }
                    Fault::EncodersJump { from_s, for_s, jump_m }
                        if within(time_s, from_s, for_s) && time_s.fract() < interval_s =>
                    {
                        distance_m += if (time_s as u64).is_multiple_of(2) { jump_m } else { -jump_m };
                    }
                    Fault::EncodersStuck { from_s, for_s } if within(time_s, from_s, for_s) => lost = true,
                    _ => {}
                }
            }
            for wheel in [side, side + 2] {
                let before = turned_ticks[wheel].floor();
                turned_ticks[wheel] += distance_m / per_tick_m;
                ticks[wheel] = (turned_ticks[wheel].floor() - before) as i16;
            }
        }
        if lost {
            ticks = [0; 4];
        }
        counts.push(WheelCounts { stamp_s: simulation.stamp_s(time_s), ticks });
    }
    counts
}

/// How far the right and the left wheels roll between two times, metres.
fn rolled_m(track_width_m: f64, trajectory: &Trajectory, from_s: f64, to_s: f64) -> [f64; 2] {
    let (from, to) = (trajectory.at(from_s), trajectory.at(to_s));
    let (travelled_m, turned_rad) = (to.travelled_m - from.travelled_m, to.turned_rad - from.turned_rad);
    let arc_m = 0.5 * track_width_m * turned_rad;
    [travelled_m + arc_m, travelled_m - arc_m]
}
