//! Records as lines of JSON: what anybody can write into a pipe.
//!
//! One object a line, of one of three kinds; unknown keys are errors, so that a misspelt one is noticed.
//!
//! | `type` | fields |
//! |---|---|
//! | `scan` | `stamp` (s), `ranges` (m; `null` says nothing, a range at or beyond `range_max` that nothing came back), `angle_min` (rad), `angle_increment` (rad) or `angles` (rad, one a ray); optional: `time_increment` (s, from ray to ray), `range_min` (0.05 m), `range_max` (m; none), `sensor` (0) |
//! | `odometry` | `stamp` (s), `x` (m), `y` (m), `theta` (rad): the robot's pose by its own odometry |
//! | `imu` | `stamp` (s), `angular_velocity` ([x, y, z], rad/s); optional: `linear_acceleration` ([x, y, z], m/s²) |

use floorprint::SensorId;
use floorprint::geometry::Pose2;
use floorprint::sensors::{ImuReading, Record, Scan, ScanGeometry, StampedPose};
use serde::Deserialize;
use std::sync::Arc;

/// No LiDAR measures nearer than this where nothing is stated, metres.
const NEAREST_M: f32 = 0.05;
/// No scan has more rays.
const MOST_RAYS: usize = 1 << 16;

#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum Line {
    Scan {
        stamp: f64,
        ranges: Vec<Option<f32>>,
        angle_min: Option<f64>,
        angle_increment: Option<f64>,
        angles: Option<Vec<f64>>,
        #[serde(default)]
        time_increment: f32,
        range_min: Option<f32>,
        range_max: Option<f32>,
        #[serde(default)]
        sensor: u8,
    },
    Odometry {
        stamp: f64,
        x: f64,
        y: f64,
        theta: f64,
    },
    Imu {
        stamp: f64,
        angular_velocity: [f64; 3],
        #[serde(default)]
        linear_acceleration: [f64; 3],
    },
}

/// Reads lines one by one.
#[derive(Debug, Default)]
pub struct JsonLines {
    /// That of the last scan: most scans have the same.
    geometry: Option<Arc<ScanGeometry>>,
}

impl JsonLines {
    /// The record of a line; `None` of an empty one.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn parse(&mut self, line: &str) -> Result<Option<Record>, String> {
        if line.trim().is_empty() {
            return Ok(None);
        }
        let line: Line = serde_json::from_str(line).map_err(|error| error.to_string())?;
        Ok(Some(match line {
            Line::Odometry { stamp, x, y, theta } => {
                Record::Odometry(StampedPose { stamp_s: stamp, pose: Pose2::new(x, y, theta) })
            }
            Line::Imu { stamp, angular_velocity, linear_acceleration } => Record::Imu(ImuReading {
                stamp_s: stamp,
                angular_velocity_rad_s: angular_velocity,
                linear_acceleration_m_s2: linear_acceleration,
            }),
            Line::Scan {
                stamp,
                ranges,
                angle_min,
                angle_increment,
                angles,
                time_increment,
                range_min,
                range_max,
                sensor,
            } => {
                if ranges.len() > MOST_RAYS {
                    return Err(format!("{} ranges; no scan has more than {MOST_RAYS}", ranges.len()));
                }
                let angles_rad: Vec<f64> = match (angles, angle_min, angle_increment) {
                    (Some(angles), None, None) if angles.len() == ranges.len() => angles,
                    (Some(angles), None, None) => {
                        return Err(format!("{} angles for {} ranges", angles.len(), ranges.len()));
                    }
                    (None, Some(first), Some(step)) => (0..ranges.len()).map(|ray| first + ray as f64 * step).collect(),
                    _ => return Err("a scan needs angle_min and angle_increment, or angles".to_owned()),
                };
                let geometry = ScanGeometry {
                    time_offsets_s: (0..angles_rad.len()).map(|ray| ray as f32 * time_increment).collect(),
                    angles_rad,
                    range_min_m: range_min.unwrap_or(NEAREST_M),
                    range_max_m: range_max.unwrap_or(f32::INFINITY),
                    below_minimum_is_no_return: false,
                };
                let geometry = match &self.geometry {
                    Some(known) if **known == geometry => Arc::clone(known),
                    _ => Arc::clone(self.geometry.insert(Arc::new(geometry))),
                };
                let ranges_m = ranges.into_iter().map(|range| range.unwrap_or(f32::NAN)).collect();
                Record::Scan(Scan { sensor: SensorId(sensor), stamp_s: stamp, ranges_m, geometry, odometry: None })
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_records() {
        let mut lines = JsonLines::default();
        let scan = r#"{"type":"scan","stamp":1.5,"angle_min":-1,"angle_increment":0.5,"ranges":[1,null,3.5]}"#;
        let (Some(Record::Scan(first)), Some(Record::Scan(second))) =
            (lines.parse(scan).unwrap(), lines.parse(scan).unwrap())
        else {
            panic!("no scans")
        };
        assert_eq!(first.geometry.angles_rad, [-1.0, -0.5, 0.0]);
        assert!(first.ranges_m[1].is_nan() && first.ranges_m[2] == 3.5 && first.stamp_s == 1.5);
        assert!(Arc::ptr_eq(&first.geometry, &second.geometry));
        assert!(lines.parse("  ").unwrap().is_none());
        let imu = lines.parse(r#"{"type":"imu","stamp":2,"angular_velocity":[0,0,0.1]}"#).unwrap();
        assert!(matches!(imu, Some(Record::Imu(reading)) if reading.angular_velocity_rad_s[2] == 0.1));
    }

    #[test]
    fn what_is_wrong_is_said() {
        let mut lines = JsonLines::default();
        for (line, found) in [
            (r#"{"type":"lidar","stamp":1}"#, "unknown variant `lidar`"),
            (r#"{"type":"odometry","stamp":1,"x":0,"y":0}"#, "missing field `theta`"),
            (r#"{"type":"odometry","stamp":1,"x":0,"y":0,"yaw":0}"#, "unknown field `yaw`"),
            (r#"{"type":"scan","stamp":1,"ranges":[1]}"#, "angle_min and angle_increment"),
            (r#"{"type":"scan","stamp":1,"ranges":[1],"angles":[0,1]}"#, "2 angles for 1 ranges"),
            ("{", "EOF"),
        ] {
            let error = lines.parse(line).unwrap_err();
            assert!(error.contains(found), "{line}: {error}");
        }
    }
}
