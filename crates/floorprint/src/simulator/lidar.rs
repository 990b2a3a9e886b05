//! A simulated planar LiDAR: skewed by the motion within a sweep, noisy, and deceived by glass.

use super::config::SimulationConfig;
use super::drive::SimulatedDrive;
use super::fault::{Fault, within};
use super::moving_walls::crossing_m;
use super::trajectory::Sample;
use super::walker::leg_range_m;
use crate::SensorId;
use crate::random::{Stage, generator};
use crate::sensors::{Scan, ScanGeometry, StampAt};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::sync::Arc;

/// From this range on the noise is larger, metres (UTM-30LX data sheet).
const FAR_M: f64 = 10.0;
/// Ranges come in whole millimetres.
const UNITS_PER_M: f64 = 1000.0;
/// What the sensor writes for a ray without a return, metres: a range beyond its reach, at least so far …
const BEYOND_M: f64 = 60.0;
/// … or one below it.
const BELOW_M: f32 = 0.001;
/// What stands this much farther off than its neighbour is behind an edge, metres.
const EDGE_M: f64 = 0.2;

/// The sensor on its robot.
#[derive(Debug, Clone)]
pub(super) struct Lidar {
    pub(super) geometry: Arc<ScanGeometry>,
    rays: Vec<BodyRay>,
    origin_m: [f64; 2],
}

/// A ray seen from above in the body's frame.
#[derive(Debug, Clone, Copy)]
struct BodyRay {
    /// Direction of its horizontal part, length one.
    direction: [f64; 2],
    /// Range per metre of horizontal distance; 1 for a level ray.
    slant: f64,
    /// Range at which it meets the floor, metres; infinite for a ray that does not look down.
    floor_m: f64,
}

impl Lidar {
    pub(super) fn new(simulation: &SimulationConfig) -> Self {
        let config = &simulation.lidar;
        let robot = &simulation.robot.lidar;
        let last = (config.beams - 1) as f64;
        let share = |beam: usize| beam as f64 / last;
        let stamp_share = match robot.stamp_at {
            StampAt::Start => 0.0,
            StampAt::Middle => 0.5,
            StampAt::End => 1.0,
        };
        let angles_rad: Vec<f64> =
            (0..config.beams).map(|beam| (share(beam) - 0.5) * config.field_of_view_rad).collect();
        let body_from_lidar = robot.mount.body_from_sensor();
        let rays = angles_rad
            .iter()
            .map(|angle| {
                let direction = body_from_lidar.rotation * nalgebra::Vector3::new(angle.cos(), angle.sin(), 0.0);
                let level = direction.x.hypot(direction.y).max(1e-9);
                BodyRay {
                    direction: [direction.x / level, direction.y / level],
                    slant: 1.0 / level,
                    floor_m: if direction.z < 0.0 { -robot.mount.z_m / direction.z } else { f64::INFINITY },
                }
            })
            .collect();
        let geometry = ScanGeometry {
            time_offsets_s: (0..config.beams)
                .map(|beam| ((share(beam) - stamp_share) * robot.sweep_duration_s) as f32)
                .collect(),
            angles_rad,
            range_min_m: config.range_min_m as f32,
            range_max_m: config.range_max_m as f32,
            below_minimum_is_no_return: true,
        };
        Self { geometry: Arc::new(geometry), rays, origin_m: [robot.mount.x_m, robot.mount.y_m] }
    }

    /// The scan of number `index`, whose stamp is `time_s` after the start of the drive.
    pub(super) fn scan(&self, drive: &SimulatedDrive, index: usize, time_s: f64) -> Scan {
        let SimulatedDrive { world, caster, trajectory, config: simulation, seed, .. } = drive;
        let config = &simulation.lidar;
        let random = &mut generator(*seed, Stage::Sensors, index as u64, super::SENSOR_LIDAR);
        let legs_m = world.legs_m(time_s, &trajectory.at(time_s).pose(), &simulation.faults);
        let lost: f64 = simulation
            .faults
            .iter()
            .filter_map(|fault| match *fault {
                Fault::RaysLost { from_s, for_s, share } if within(time_s, from_s, for_s) => Some(share),
                _ => None,
            })
            .fold(config.dropout_share, f64::max);
        let no_return_m = [config.range_max_m.max(BEYOND_M) as f32, BELOW_M];
        let robot = trajectory.at(time_s).pose();
        let moving_walls_m = world.moving_walls_m(time_s, &robot, config.range_max_m, &simulation.faults);
        let mut last_level_m = f64::INFINITY;
        let cast = |(ray, &offset_s): (&BodyRay, &f32)| {
            let Sample { position_m, heading_rad, .. } = trajectory.at(time_s + f64::from(offset_s));
            let (sin, cos) = heading_rad.sin_cos();
            let rotate = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
            let (offset_m, direction) = (rotate(self.origin_m), rotate(ray.direction));
            let from_m = [position_m[0] + offset_m[0], position_m[1] + offset_m[1]];
            let reach_m = config.range_max_m / ray.slant;
            let wall_m = caster.cast(from_m, direction, reach_m, |share| random.random_bool(share));
            let fixed_m = wall_m.map_or(f64::INFINITY, |hit| hit.range_m);
            let legs = legs_m.iter().filter_map(|&leg| leg_range_m(leg, from_m, direction));
            let moving = moving_walls_m.iter().filter_map(|&ends| crossing_m(ends, from_m, direction));
            let mut level_m = legs.chain(moving).fold(fixed_m, f64::min);
            // Beside an edge a ray's light comes back from what is near and from what is behind.
            let beside_m = std::mem::replace(&mut last_level_m, level_m);
            if config.mixed_pixel_share > 0.0
                && beside_m < level_m.min(reach_m) - EDGE_M
                && random.random_bool(config.mixed_pixel_share)
            {
                level_m = random.random_range(beside_m..level_m.min(reach_m));
            }
            let intensity = match wall_m {
                Some(hit) if config.weak_return_noise > 0.0 => {
                    world.walls[hit.wall].intensity(direction) * (1.0 - level_m / reach_m).clamp(0.0, 1.0)
                }
                _ => 1.0,
            };
            let mut range_m = (level_m * ray.slant).min(ray.floor_m);
            if config.short_share > 0.0 && random.random_bool(config.short_share) {
                range_m = range_m.min(config.range_max_m) * random.random_range(0.05..1.0);
            }
            if lost > 0.0 && random.random_bool(lost) {
                return no_return_m[usize::from(random.random_bool(0.5))];
            }
            if config.sunlight_share > 0.0 {
                let share_of_reach = (range_m / config.range_max_m).min(1.0);
                if random.random_bool(config.sunlight_share * share_of_reach * share_of_reach) {
                    return no_return_m[usize::from(random.random_bool(0.5))];
                }
            }
            let mut noise_m = if range_m < FAR_M { config.near_noise_m } else { config.far_noise_m };
            if range_m.is_finite() {
                noise_m += config.noise_share * range_m;
            }
            noise_m *= 1.0 + config.weak_return_noise * (1.0 - intensity);
            let noise: f64 = random.sample(StandardNormal);
            range_m += noise_m * noise + config.range_bias_m;
            if range_m >= config.range_max_m {
                return no_return_m[0];
            }
            (((range_m * UNITS_PER_M + 0.5) as u32) as f64 / UNITS_PER_M) as f32
        };
        Scan {
            sensor: SensorId::default(),
            stamp_s: simulation.scan_stamp_s(time_s),
            ranges_m: self.rays.iter().zip(&self.geometry.time_offsets_s).map(cast).collect(),
            geometry: Arc::clone(&self.geometry),
            odometry: None,
        }
    }
}
