//! From raw ranges to points in the body's frame (report eqs. 8–11), with the LiDAR's full mount.
//!
//! Directions of the rays are turned into the body's frame once per geometry; a point is
//! then one multiplication away. A tilted or upside-down LiDAR is projected to the plane:
//! what its rays hit is kept where it stands above the floor.

use super::config::{NoReturn, ScanConfig};
use super::deskew::SweepMotion;
use super::finding::Finding;
use super::range_noise::{RangeBends, RangeNoise};
use crate::SensorId;
use crate::frame::{BodyScan, Points, Skew};
use crate::pace::Pace;
use crate::sensors::{LidarConfig, Ray, RobotConfig, Scan, ScanGeometry, StampAt};
use nalgebra::Vector3;
use std::sync::Arc;

/// Rays steeper than this (sine of their elevation, 30°) are not used: what they hit is a
/// ceiling or a floor rather than a wall.
const STEEPEST_SINE: f64 = 0.5;
/// A ray that is closer to the floor than this has hit the floor, metres.
const FLOOR_CLEARANCE_M: f64 = 0.05;

/// Tables are kept for this many scan geometries.
const KEPT: usize = 16;

/// The tables of all LiDARs, built as their scans come.
#[derive(Debug)]
pub(super) struct Projections {
    robot: RobotConfig,
    config: ScanConfig,
    kept: Vec<(SensorId, ScanProjection)>,
    learnt: Vec<(SensorId, Learnt)>,
    /// The longest sweep whose times are not used because scans come faster than that, and how fast, seconds.
    too_long_s: Option<[f64; 2]>,
}

/// What is learnt of a LiDAR from its scans.
#[derive(Debug, Default)]
struct Learnt {
    noise: RangeNoise,
    last_stamp_s: Option<f64>,
    pace: Pace,
}

/// A sweep that takes so many times as long as from one scan to the next is none.
const LONGEST_SWEEP: f64 = 1.5;

impl Learnt {
    fn note_stamp(&mut self, stamp_s: f64) {
        let elapsed_s = self.last_stamp_s.replace(stamp_s).map_or(0.0, |last_s| stamp_s - last_s);
        self.pace.steps(elapsed_s);
    }
}

impl Projections {
    /// No tables yet.
    pub(super) fn new(robot: &RobotConfig, config: &ScanConfig) -> Self {
        Self { robot: robot.clone(), config: config.clone(), kept: Vec::new(), learnt: Vec::new(), too_long_s: None }
    }

    /// The tables for a scan.
    pub(super) fn of(&mut self, scan: &Scan) -> &ScanProjection {
        let fits = |(sensor, projection): &(SensorId, ScanProjection)| {
            *sensor == scan.sensor && projection.fits(&scan.geometry)
        };
        let index = self.kept.iter().rposition(fits).unwrap_or_else(|| {
            if self.kept.len() == KEPT {
                self.kept.pop();
            }
            let projection = ScanProjection::new(&scan.geometry, self.robot.lidar_of(scan.sensor), &self.config);
            self.kept.push((scan.sensor, projection));
            self.kept.len() - 1
        });
        &self.kept[index].1
    }

    fn learnt(&mut self, sensor: SensorId) -> &mut Learnt {
        let index = self.learnt.iter().position(|(other, _)| *other == sensor).unwrap_or_else(|| {
            self.learnt.push((sensor, Learnt::default()));
            self.learnt.len() - 1
        });
        &mut self.learnt[index].1
    }

    /// Learns from a scan how noisy its LiDAR is: the standard deviation of the ranges, metres.
    pub(super) fn learn_noise_m(&mut self, scan: &Scan) -> f32 {
        let shown_m = self.of(scan).shown_noise_m(scan);
        let learnt = self.learnt(scan.sensor);
        learnt.note_stamp(scan.stamp_s);
        learnt.noise.learn(shown_m);
        learnt.noise.sigma_m()
    }

    /// When the points of a projected scan were seen; `None` when the rays' times are unknown, are not to be used or cannot
    /// be: a sweep that takes longer than until the next scan.
    pub(super) fn skew(&mut self, scan: &Scan) -> Option<Skew> {
        let [first_s, last_s] = self.of(scan).sweep_s()?;
        let usual_s = self.learnt(scan.sensor).pace.usual_s();
        let longest_s = [last_s - first_s, first_s.abs(), last_s.abs()].into_iter().fold(0.0, f64::max);
        if usual_s > 0.0 && longest_s > LONGEST_SWEEP * usual_s {
            if self.too_long_s.is_none_or(|[known_s, _]| longest_s > known_s) {
                self.too_long_s = Some([longest_s, usual_s]);
            }
            return None;
        }
        Some(self.of(scan).skew(scan))
    }

    /// What the user should know of rays that cannot be used.
    pub(super) fn findings(&self) -> impl Iterator<Item = Finding> + '_ {
        let steep_rays = self.kept.iter().filter_map(|(_, projection)| {
            let steep = projection.reach_m.iter().filter(|&&reach_m| reach_m == 0.0).count();
            (steep > 0).then_some(Finding::SteepRays { steep, rays: projection.reach_m.len() })
        });
        let long_sweep = self.too_long_s.map(|[sweep_s, interval_s]| Finding::LongSweep { sweep_s, interval_s });
        steep_rays.chain(long_sweep)
    }
}

/// Everything about a scanner's rays that stays the same from scan to scan.
#[derive(Debug, Clone)]
pub(crate) struct ScanProjection {
    geometry: Arc<ScanGeometry>,
    origin_m: [f32; 2],
    /// Each ray's direction in the body's frame, projected to the plane.
    direction_x: Vec<f32>,
    direction_y: Vec<f32>,
    /// Hits at or beyond this are not used, metres; 0 for rays that are too steep.
    reach_m: Vec<f32>,
    /// Hits nearer than this are not used, metres.
    nearest_m: f32,
    /// Up to where a ray without a return is free, metres; 0 when it means nothing.
    clear_m: f32,
    /// When each ray is taken relative to the stamp, seconds; empty when that is unknown.
    offset_s: Vec<f32>,
    /// The first and the last of these.
    sweep_s: Option<[f64; 2]>,
    bends: RangeBends,
}

impl ScanProjection {
    /// The tables for one geometry.
    pub(crate) fn new(geometry: &Arc<ScanGeometry>, lidar: &LidarConfig, config: &ScanConfig) -> Self {
        let body_from_lidar = lidar.mount.body_from_sensor();
        let height_m = lidar.mount.z_m;
        let farthest_m = config.range_max_m.min(f64::from(geometry.range_max_m));
        let offset_s = if config.deskew { ray_offsets_s(geometry, lidar) } else { Vec::new() };
        let first_s = offset_s.iter().copied().reduce(f32::min);
        let last_s = offset_s.iter().copied().reduce(f32::max);
        let mut projection = Self {
            geometry: Arc::clone(geometry),
            origin_m: [lidar.mount.x_m as f32, lidar.mount.y_m as f32],
            direction_x: Vec::with_capacity(geometry.len()),
            direction_y: Vec::with_capacity(geometry.len()),
            reach_m: Vec::with_capacity(geometry.len()),
            nearest_m: geometry.range_min_m.max(config.range_min_m as f32),
            clear_m: match config.no_return {
                NoReturn::Ignore => 0.0,
                NoReturn::Clear => config.no_return_clear_m as f32,
            },
            sweep_s: first_s.zip(last_s).map(|(first_s, last_s)| [f64::from(first_s), f64::from(last_s)]),
            offset_s,
            bends: RangeBends::new(geometry),
        };
        for angle_rad in &geometry.angles_rad {
            let (sin, cos) = angle_rad.sin_cos();
            let direction = body_from_lidar.rotation * Vector3::new(cos, sin, 0.0);
            projection.direction_x.push(direction.x as f32);
            projection.direction_y.push(direction.y as f32);
            let reach_m = if direction.z.abs() > STEEPEST_SINE {
                0.0
            } else if direction.z < 0.0 && height_m > FLOOR_CLEARANCE_M {
                farthest_m.min((height_m - FLOOR_CLEARANCE_M) / -direction.z)
            } else {
                farthest_m
            };
            projection.reach_m.push(reach_m as f32);
        }
        projection
    }

    /// Whether these tables are those of `geometry`.
    pub(super) fn fits(&self, geometry: &Arc<ScanGeometry>) -> bool {
        Arc::ptr_eq(&self.geometry, geometry) || self.geometry == *geometry
    }

    /// Offsets from the stamp of the first and the last ray, seconds; `None` when the rays'
    /// times are unknown or are not to be used.
    pub(super) fn sweep_s(&self) -> Option<[f64; 2]> {
        self.sweep_s
    }

    /// The standard deviation that the scan's ranges show, metres; `None` where they do not tell.
    fn shown_noise_m(&self, scan: &Scan) -> Option<f32> {
        let nearest_m = self.nearest_m;
        let is_hit =
            |(&range_m, &reach_m): (&f32, &f32)| (range_m > 0.0) & (range_m >= nearest_m) & (range_m < reach_m);
        let are_hits: Vec<bool> = scan.ranges_m.iter().zip(&self.reach_m).map(is_hit).collect();
        self.bends.noise_m(&scan.ranges_m, &are_hits)
    }

    /// The scan's points in the body's frame at its stamp.
    pub(crate) fn project(&self, scan: &Scan, motion: Option<SweepMotion>) -> BodyScan {
        let hits = self.endpoints(&scan.ranges_m, self.is_hit(), motion);
        let free_ends = if self.clear_m > 0.0 {
            self.endpoints(&self.free_lengths_m(scan), is_free, motion)
        } else {
            Points::default()
        };
        BodyScan { origin_m: self.origin_m.map(f64::from), hits, free_ends, ..BodyScan::default() }
    }

    /// When the points of a projected scan were seen.
    fn skew(&self, scan: &Scan) -> Skew {
        let free_ends_s =
            if self.clear_m > 0.0 { self.times_s(&self.free_lengths_m(scan), is_free) } else { Vec::new() };
        Skew { hits_s: self.times_s(&scan.ranges_m, self.is_hit()), free_ends_s }
    }

    /// Whether a ray of a length ended on something within its reach, metres.
    fn is_hit(&self) -> impl Fn(f32, f32) -> bool + use<> {
        let nearest_m = self.nearest_m;
        move |range_m, reach_m| range_m >= nearest_m && range_m < reach_m
    }

    /// When the rays are taken whose length and reach are wanted, seconds after the stamp.
    fn times_s(&self, lengths_m: &[f32], wanted: impl Fn(f32, f32) -> bool) -> Vec<f32> {
        let rays = lengths_m.iter().zip(&self.reach_m).zip(&self.offset_s);
        rays.filter(|((length_m, reach_m), _)| wanted(**length_m, **reach_m)).map(|(_, offset_s)| *offset_s).collect()
    }

    /// Where the rays end at these lengths (metres), for rays whose length and reach are wanted.
    fn endpoints(&self, lengths_m: &[f32], wanted: impl Fn(f32, f32) -> bool, motion: Option<SweepMotion>) -> Points {
        let along = |origin_m: f32, direction: &[f32]| -> Vec<f32> {
            lengths_m.iter().zip(direction).map(|(length_m, direction)| origin_m + length_m * direction).collect()
        };
        let [origin_x, origin_y] = self.origin_m;
        let mut points = Points { x_m: along(origin_x, &self.direction_x), y_m: along(origin_y, &self.direction_y) };
        if let Some(motion) = motion {
            motion.to_stamp(&self.offset_s, &mut points);
        }
        let mut count = 0;
        for (ray, (&length_m, &reach_m)) in lengths_m.iter().zip(&self.reach_m).enumerate() {
            if wanted(length_m, reach_m) {
                points.x_m[count] = points.x_m[ray];
                points.y_m[count] = points.y_m[ray];
                count += 1;
            }
        }
        points.x_m.truncate(count);
        points.y_m.truncate(count);
        points
    }

    /// Up to where each ray is free because nothing came back from within its reach, metres; 0 elsewhere.
    fn free_lengths_m(&self, scan: &Scan) -> Vec<f32> {
        let free_m = |(&range_m, &reach_m): (&f32, &f32)| match self.geometry.classify(range_m) {
            Ray::NoReturn => self.clear_m.min(reach_m),
            Ray::Hit(range_m) if range_m >= reach_m => self.clear_m.min(reach_m),
            Ray::Hit(_) | Ray::Invalid => 0.0,
        };
        scan.ranges_m.iter().zip(&self.reach_m).map(free_m).collect()
    }
}

/// Whether nothing came back from along a ray, up to its length (metres).
fn is_free(free_m: f32, _reach_m: f32) -> bool {
    free_m > 0.0
}

/// When each ray is taken relative to the stamp, seconds: the geometry's own times, else the
/// calibration's sweep spread evenly over the rays; empty when neither is known.
fn ray_offsets_s(geometry: &ScanGeometry, lidar: &LidarConfig) -> Vec<f32> {
    let stated = &geometry.time_offsets_s;
    let known = stated.iter().all(|offset_s| offset_s.is_finite()) && stated.iter().any(|&offset_s| offset_s != 0.0);
    if known && stated.len() == geometry.len() {
        return stated.clone();
    }
    if lidar.sweep_duration_s <= 0.0 || geometry.len() < 2 {
        return Vec::new();
    }
    let stamp_share = match lidar.stamp_at {
        StampAt::Start => 0.0,
        StampAt::Middle => 0.5,
        StampAt::End => 1.0,
    };
    let last = (geometry.len() - 1) as f64;
    (0..geometry.len()).map(|ray| ((ray as f64 / last - stamp_share) * lidar.sweep_duration_s) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorId;
    use crate::geometry::Mount;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn geometry(angles_rad: Vec<f64>) -> Arc<ScanGeometry> {
        Arc::new(ScanGeometry {
            time_offsets_s: vec![0.0; angles_rad.len()],
            angles_rad,
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return: false,
        })
    }

    fn scan(geometry: &Arc<ScanGeometry>, ranges_m: Vec<f32>) -> Scan {
        Scan { sensor: SensorId::default(), stamp_s: 0.0, ranges_m, geometry: Arc::clone(geometry), odometry: None }
    }

    fn lidar(mount: Mount) -> LidarConfig {
        LidarConfig { mount, ..LidarConfig::default() }
    }

    fn projected(angles_rad: Vec<f64>, ranges_m: Vec<f32>, mount: Mount, config: &ScanConfig) -> BodyScan {
        let geometry = geometry(angles_rad);
        ScanProjection::new(&geometry, &lidar(mount), config).project(&scan(&geometry, ranges_m), None)
    }

    #[test]
    fn only_returns_within_the_limits_become_hits() {
        let config = ScanConfig { range_min_m: 0.5, range_max_m: 20.0, ..ScanConfig::default() };
        let ranges = vec![0.2, 1.0, 25.0, 30.0, f32::INFINITY, f32::NAN, 0.001];
        let body = projected(vec![0.0; 7], ranges.clone(), Mount { x_m: 0.1, ..Mount::default() }, &config);
        assert_eq!(body.hits.x_m, [1.1]);
        assert!(body.free_ends.is_empty());
        let clear = ScanConfig { no_return: NoReturn::Clear, no_return_clear_m: 5.0, ..config };
        let body = projected(vec![0.0; 7], ranges, Mount::default(), &clear);
        assert_eq!(body.free_ends.x_m, [5.0; 3]);
    }

    #[test]
    fn a_lidar_that_looks_down_sees_walls_only_until_its_rays_meet_the_floor() {
        let mount = Mount { z_m: 0.65, pitch_rad: 0.2, ..Mount::default() };
        let floor_m = 0.65 / 0.2_f64.sin();
        let ranges = vec![(floor_m * 0.8) as f32, floor_m as f32];
        let body = projected(vec![0.0, 0.0], ranges, mount, &ScanConfig::default());
        assert_eq!(body.hits.len(), 1);
        assert!((f64::from(body.hits.x_m[0]) - floor_m * 0.8 * 0.2_f64.cos()).abs() < 1e-5);
        let steep = Mount { pitch_rad: 1.0, ..mount };
        let geometry = geometry(vec![0.0, FRAC_PI_2]);
        let robot = RobotConfig { lidar: lidar(steep), ..RobotConfig::default() };
        let mut projections = Projections::new(&robot, &ScanConfig::default());
        projections.of(&scan(&geometry, vec![1.0, 1.0]));
        assert_eq!(projections.findings().collect::<Vec<_>>(), [Finding::SteepRays { steep: 1, rays: 2 }]);
    }

    #[test]
    fn rays_are_spread_over_the_sweep_of_the_calibration() {
        let geometry = geometry(vec![0.0, 0.1, 0.2]);
        let swept = |stamp_at| LidarConfig { sweep_duration_s: 0.02, stamp_at, ..LidarConfig::default() };
        assert_eq!(ray_offsets_s(&geometry, &swept(StampAt::Middle)), [-0.01, 0.0, 0.01]);
        assert_eq!(ray_offsets_s(&geometry, &swept(StampAt::Start)), [0.0, 0.01, 0.02]);
        assert_eq!(ray_offsets_s(&geometry, &swept(StampAt::End)), [-0.02, -0.01, 0.0]);
        assert!(ray_offsets_s(&geometry, &lidar(Mount::default())).is_empty());
    }

    proptest! {
        #[test]
        fn an_upside_down_lidar_mirrors_left_and_right(
            rays in prop::collection::vec((-3.0..3.0_f64, 0.2..25.0_f32), 1..50),
            yaw_rad in -3.0..3.0_f64,
        ) {
            let (angles, ranges): (Vec<f64>, Vec<f32>) = rays.into_iter().unzip();
            let mirrored = angles.iter().map(|angle| -angle).collect();
            let upright = Mount { x_m: 0.2, y_m: 0.1, z_m: 0.5, yaw_rad, ..Mount::default() };
            let upside_down = Mount { roll_rad: PI, ..upright };
            let a = projected(mirrored, ranges.clone(), upright, &ScanConfig::default());
            let b = projected(angles, ranges, upside_down, &ScanConfig::default());
            prop_assert_eq!(a.hits.len(), b.hits.len());
            for (p, q) in a.hits.iter().zip(b.hits.iter()) {
                prop_assert!((p[0] - q[0]).abs() < 1e-4 && (p[1] - q[1]).abs() < 1e-4);
            }
        }
    }
}
