//! A level slice of a cloud of points as a planar scan.
//!
//! Of the points near the sensor's height the nearest in each direction is what a planar LiDAR at its place would
//! have seen. Directions without a point say nothing: a cloud does not tell where nothing came back.

use super::messages::PointCloud;
use floorprint::geometry::Pose3;
use floorprint::sensors::ScanGeometry;
use std::f64::consts::{PI, TAU};

/// Points this far above or below the sensor belong to the slice, metres.
const HALF_HEIGHT_M: f64 = 0.2;
/// Points this near above the base's ground are the floor, metres.
const FLOOR_M: f64 = 0.1;
/// Directions of a scan.
const DIRECTIONS: usize = 720;

/// The rays of all slices, in the base's axes around the sensor.
pub(super) fn geometry() -> ScanGeometry {
    let direction = |index: usize| (index as f64 + 0.5) / DIRECTIONS as f64 * TAU - PI;
    ScanGeometry {
        angles_rad: (0..DIRECTIONS).map(direction).collect(),
        time_offsets_s: vec![0.0; DIRECTIONS],
        range_min_m: 0.05,
        range_max_m: f32::INFINITY,
        below_minimum_is_no_return: false,
    }
}

/// The nearest point of the slice in each direction, metres.
pub(super) fn ranges_m(cloud: &PointCloud, base_from_cloud: &Pose3) -> Vec<f32> {
    let mut ranges_m = vec![f32::NAN; DIRECTIONS];
    let sensor_m = base_from_cloud.translation_m;
    for point_m in &cloud.points_m {
        let from_sensor_m = base_from_cloud.transform_point(point_m.map(f64::from).into()) - sensor_m;
        let height_m = sensor_m.z + from_sensor_m.z;
        // A sensor whose height is not known is at 0: then the floor cannot be told either.
        if from_sensor_m.z.abs() > HALF_HEIGHT_M || (sensor_m.z > FLOOR_M && height_m < FLOOR_M) {
            continue;
        }
        let share = (from_sensor_m.y.atan2(from_sensor_m.x) + PI) / TAU;
        let direction = ((share * DIRECTIONS as f64) as usize).min(DIRECTIONS - 1);
        ranges_m[direction] = ranges_m[direction].min(from_sensor_m.x.hypot(from_sensor_m.y) as f32);
    }
    ranges_m
}
