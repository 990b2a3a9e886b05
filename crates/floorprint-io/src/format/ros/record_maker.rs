//! From the messages that play a role to records.

use super::camera::Camera;
use super::messages::{Inertial, Kind, LaserScan, Message, Placed, decode};
use super::roles::{Lidar, Odometry, Roles};
use super::survey::namespace_of;
use super::wheels::Wheels;
use super::{RawMessage, slice};
use crate::data_set::{DropCounts, DropReason};
use crate::images::{ImageEntry, ImagePlace};
use floorprint::SensorId;
use floorprint::geometry::{Pose2, Pose3};
use floorprint::sensors::{EncoderReading, ImuReading, Record, Scan, ScanGeometry, StampedPose};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Most geometries of scans that are remembered; what changes more often is made anew.
const KEPT_GEOMETRIES: usize = 16;

/// No LiDAR measures nearer than this, whatever its messages state, metres: a range of 0 is none.
const NEAREST_M: f32 = 1e-3;

/// Makes records of messages, one by one as they come.
pub(super) struct RecordMaker {
    geometries: VecDeque<(GeometryKey, Arc<ScanGeometry>)>,
    slice_geometry: Arc<ScanGeometry>,
    /// The stamp of the last odometry: TF repeats its poses.
    odometry_stamp_s: Option<f64>,
    /// The last angles of the wheels, left and right, radians.
    wheels_rad: Option<[f64; 2]>,
    /// Angles of wheels that wait for those of the others, radians: some drivers send a message for each.
    joints_rad: BTreeMap<String, f64>,
    /// Depth and colour images so far.
    pub(super) images: [Vec<ImageEntry>; 2],
    /// Messages on the topics of depth and colour images so far.
    image_messages: [usize; 2],
    /// The true poses so far.
    pub(super) truth: Vec<StampedPose>,
    /// What could not be used.
    pub(super) dropped: DropCounts,
}

/// What a scan's geometry follows from: the LiDAR, its rays, and the bits of the numbers.
type GeometryKey = (usize, usize, [u64; 4]);

impl RecordMaker {
    pub(super) fn new() -> Self {
        Self {
            geometries: VecDeque::new(),
            slice_geometry: Arc::new(slice::geometry()),
            odometry_stamp_s: None,
            wheels_rad: None,
            joints_rad: BTreeMap::new(),
            images: [Vec::new(), Vec::new()],
            image_messages: [0; 2],
            truth: Vec::new(),
            dropped: DropCounts::default(),
        }
    }

    /// Takes a message, if it plays a role, and appends its records.
    pub(super) fn take(&mut self, roles: &Roles, message: &RawMessage<'_>, records: &mut Vec<Record>) {
        let topic = message.channel.topic.as_str();
        let lidar = roles.lidars.iter().enumerate().find(|(_, lidar)| lidar.topic == topic);
        let is_odometry =
            matches!(&roles.odometry, Some(Odometry::Topic(name, _) | Odometry::Wheels(name, _)) if name == topic);
        let edge = match &roles.odometry {
            Some(Odometry::Edge(edge, child_from_base)) => Some((edge, child_from_base)),
            _ => None,
        };
        let imu = roles.imu.as_ref().filter(|(name, _)| name == topic);
        let is_truth = roles.truth.as_deref() == Some(topic);
        let Some(kind) = Kind::of(&message.channel.type_name) else { return };
        if let Some(camera) = &roles.camera
            && matches!(kind, Kind::Image | Kind::CompressedImage)
        {
            return self.take_image(camera, kind, message, roles.by_log_time);
        }
        let plays = lidar.is_some() || is_odometry || imu.is_some() || is_truth;
        let is_of_another = || roles.other_robots.iter().any(|robot| robot == namespace_of(topic));
        if !plays && (edge.is_none() || kind != Kind::Transforms || is_of_another()) {
            return;
        }
        let log_time_s = roles.by_log_time.then_some(message.log_time_s);
        let decoded = decode(kind, message.channel, message.bytes);
        match (decoded, lidar) {
            (Some(Message::Scan(scan)), Some((sensor, lidar))) => {
                if !lidar.is_of(&scan.frame) {
                    return;
                }
                let stamp_s = log_time_s.unwrap_or(scan.stamp_s);
                let geometry = self.geometry(sensor, lidar, &scan);
                let mut ranges_m = scan.ranges_m;
                let mark_m = lidar.no_return_mark_m.unwrap_or(f32::INFINITY);
                let is_none = |range_m: f32| range_m >= mark_m || (lidar.zero_means_no_return && range_m == 0.0);
                for range_m in ranges_m.iter_mut().filter(|range_m| is_none(**range_m)) {
                    *range_m = f32::INFINITY;
                }
                records.extend(self.scan(sensor, stamp_s, ranges_m, geometry));
            }
            (Some(Message::Cloud(cloud)), Some((sensor, lidar))) => {
                if !lidar.is_of(&cloud.frame) {
                    return;
                }
                let ranges_m = slice::ranges_m(&cloud, &lidar.base_from_lidar);
                let geometry = Arc::clone(&self.slice_geometry);
                records.extend(self.scan(sensor, log_time_s.unwrap_or(cloud.stamp_s), ranges_m, geometry));
            }
            (Some(Message::Odometry(placed) | Message::Pose(placed)), _) => {
                if is_truth {
                    let stamp_s = log_time_s.unwrap_or(placed.stamp_s);
                    self.truth.push(StampedPose { stamp_s, pose: placed.pose.in_plane() });
                }
                if let (true, Some(Odometry::Topic(_, child_from_base))) = (is_odometry, &roles.odometry) {
                    records.extend(self.odometry(&placed, child_from_base, log_time_s));
                }
            }
            (Some(Message::Transforms(samples)), _) => {
                let Some((edge, child_from_base)) = edge else { return };
                let is_edge = |sample: &&Placed| sample.parent == edge.parent && sample.child == edge.child;
                for sample in samples.iter().filter(is_edge) {
                    records.extend(self.odometry(sample, child_from_base, log_time_s));
                }
            }
            (Some(Message::Imu(reading)), _) => {
                if let Some((_, base_from_imu)) = imu {
                    records.push(Record::Imu(in_base(&reading, base_from_imu, log_time_s)));
                }
            }
            (Some(Message::Joints(joints)), _) => {
                let Some(Odometry::Wheels(_, wheels)) = &roles.odometry else { return };
                let Some([left, right]) = wheels.angles_rad(&joints, &mut self.joints_rad) else { return };
                let [left_before, right_before] = self.wheels_rad.replace([left, right]).unwrap_or([left, right]);
                records.push(Record::Encoders(EncoderReading {
                    stamp_s: log_time_s.unwrap_or(joints.stamp_s),
                    left_ticks: Wheels::turned_rad(left_before, left),
                    right_ticks: Wheels::turned_rad(right_before, right),
                }));
            }
            // Counted by the survey.
            (None | Some(Message::Image(_) | Message::Calibration(_)), _)
            | (Some(Message::Scan(_) | Message::Cloud(_)), None) => {}
        }
    }

    /// Notes where an image of the camera is.
    fn take_image(&mut self, camera: &Camera, kind: Kind, message: &RawMessage<'_>, by_log_time: bool) {
        let topic = &message.channel.topic;
        let Some(which) = [&camera.depth_topic, &camera.color_topic].iter().position(|name| *name == topic) else {
            return;
        };
        let number = self.image_messages[which];
        self.image_messages[which] += 1;
        if let Some(Message::Image(head)) = decode(kind, message.channel, message.bytes) {
            let stamp_s = if by_log_time { message.log_time_s } else { head.stamp_s };
            self.images[which].push(ImageEntry { stamp_s, place: ImagePlace::Message(number) });
        }
    }

    fn scan(&mut self, sensor: usize, stamp_s: f64, ranges_m: Vec<f32>, geometry: Arc<ScanGeometry>) -> Option<Record> {
        if ranges_m.is_empty() {
            self.dropped.add(DropReason::EmptyScan);
            return None;
        }
        let sensor = SensorId(u8::try_from(sensor).unwrap_or(u8::MAX));
        Some(Record::Scan(Scan { sensor, stamp_s, ranges_m, geometry, odometry: None }))
    }

    /// The geometry of a scan's rays: made once while it stays the same.
    fn geometry(&mut self, sensor: usize, lidar: &Lidar, scan: &LaserScan) -> Arc<ScanGeometry> {
        let numbers = [
            scan.angle_min_rad.to_bits(),
            scan.angle_increment_rad.to_bits(),
            scan.range_min_m.to_bits().into(),
            scan.range_max_m.to_bits().into(),
        ];
        let rays = scan.ranges_m.len();
        let key = (sensor, rays, numbers);
        if let Some((_, geometry)) = self.geometries.iter().find(|(known, _)| *known == key) {
            return Arc::clone(geometry);
        }
        // The time from ray to ray is the usual one of the LiDAR: some drivers measure it anew for each scan.
        let step_s = lidar.sweep_s / rays.saturating_sub(1).max(1) as f64;
        let geometry = Arc::new(ScanGeometry {
            angles_rad: (0..rays).map(|ray| scan.angle_min_rad + ray as f64 * scan.angle_increment_rad).collect(),
            time_offsets_s: (0..rays).map(|ray| (ray as f64 * step_s) as f32).collect(),
            range_min_m: if scan.range_min_m > 0.0 { scan.range_min_m } else { NEAREST_M },
            range_max_m: if scan.range_max_m > 0.0 { scan.range_max_m } else { f32::INFINITY },
            below_minimum_is_no_return: false,
        });
        if self.geometries.len() == KEPT_GEOMETRIES {
            self.geometries.pop_front();
        }
        self.geometries.push_back((key, Arc::clone(&geometry)));
        geometry
    }

    fn odometry(&mut self, placed: &Placed, child_from_base: &Pose3, log_time_s: Option<f64>) -> Option<Record> {
        let stamp_s = log_time_s.unwrap_or(placed.stamp_s);
        let is_new = self.odometry_stamp_s.replace(stamp_s) != Some(stamp_s);
        is_new.then(|| Record::Odometry(StampedPose { stamp_s, pose: base_pose(placed, child_from_base) }))
    }
}

/// The base's pose in the plane.
fn base_pose(placed: &Placed, child_from_base: &Pose3) -> Pose2 {
    if *child_from_base == Pose3::identity() {
        return placed.pose.in_plane();
    }
    placed.pose.compose(child_from_base).in_plane()
}

/// A reading in the base's axes.
fn in_base(reading: &Inertial, base_from_imu: &Pose3, log_time_s: Option<f64>) -> ImuReading {
    let turned = |vector: [f64; 3]| -> [f64; 3] {
        (base_from_imu.transform_point(vector.into()) - base_from_imu.translation_m).into()
    };
    ImuReading {
        stamp_s: log_time_s.unwrap_or(reading.stamp_s),
        angular_velocity_rad_s: turned(reading.angular_velocity_rad_s),
        linear_acceleration_m_s2: turned(reading.linear_acceleration_m_s2),
    }
}
