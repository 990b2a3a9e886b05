//! The second pass over a recording: from the messages that play a role to records.

use super::messages::{Inertial, Kind, LaserScan, Message, Placed, decode};
use super::recording::{Messages, Recording};
use super::roles::{Lidar, Odometry, Roles, Unfulfilled};
use super::survey::{Survey, Topic};
use super::{FORMAT, MessageSource as _, slice};
use crate::data_set::{
    BagContents, DataSet, DropCounts, DropReason, OpenOptions, RecordedTruth, RoleChoice, TopicSummary,
};
use crate::error::{Problem, ReadError};
use crate::source::Source;
use floorprint::SensorId;
use floorprint::geometry::{Pose2, Pose3};
use floorprint::sensors::{ImuReading, LidarConfig, Record, RobotConfig, Scan, ScanGeometry, StampAt, StampedPose};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

/// Most geometries of scans that are remembered; what changes more often is made anew.
const KEPT_GEOMETRIES: usize = 16;

/// No LiDAR measures nearer than this, whatever its messages state, metres: a range of 0 is none.
const NEAREST_M: f32 = 1e-3;

/// Reads a recording.
pub(super) fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let path = source.path();
    let recording = Recording::open(source)?;
    // The hash needs a pass of its own, beside the first one.
    let (hash, (survey, damage)) = std::thread::scope(|scope| {
        let hash = scope.spawn(|| recording.hash());
        let mut messages = recording.messages();
        let survey = Survey::of(&mut messages);
        (hash.join(), (survey, messages.damage()))
    });
    let input_hash = match hash {
        Ok(hash) => hash.map_err(|error| ReadError::io(path, &error))?,
        Err(panic) => std::panic::resume_unwind(panic),
    };
    if survey.topics.is_empty() {
        let found =
            damage.map_or("it holds no message".to_owned(), |damage| format!("no message can be read: {damage}"));
        return Err(Problem::new(path, found).expected(FORMAT.description).into());
    }
    let roles = Roles::choose(&survey, &options.topics).map_err(|unfulfilled| unfulfilled.at(path))?;

    let mut stream = Records::new(&recording, &roles);
    let records = stream.by_ref().collect::<Result<Vec<Record>, ReadError>>()?;
    let (truth, mut dropped) = (std::mem::take(&mut stream.truth), std::mem::take(&mut stream.dropped));
    drop(stream);
    let undecodable: usize = survey.topics.values().map(|topic| topic.undecodable).sum();
    for _ in 0..undecodable {
        dropped.add(DropReason::Undecodable);
    }
    let mut notes = roles.notes.clone();
    notes.extend(damage);
    Ok(DataSet {
        format: FORMAT,
        robot: robot(&roles),
        records,
        images: None,
        dropped,
        notes,
        input_hash,
        bag: Some(contents(&survey, roles, truth)),
    })
}

impl Unfulfilled {
    fn at(self, path: &Path) -> ReadError {
        let Self { option, wanted, why, candidates } = self;
        let problem = Problem::new(path, format!("{option} {wanted}: {why}"));
        let closest = candidates.iter().max_by(|a, b| {
            strsim::jaro_winkler(&wanted, a).total_cmp(&strsim::jaro_winkler(&wanted, b)).then(b.cmp(a))
        });
        match closest {
            Some(closest) => {
                let all = candidates.join(", ");
                problem.expected(format!("one of: {all}")).advice(format!("Did you mean {closest}?")).into()
            }
            None => problem.advice(format!("Leave {option} out; `floorprint info` lists what is there")).into(),
        }
    }
}

/// The calibration that the recording itself states.
fn robot(roles: &Roles) -> RobotConfig {
    let mut lidars = roles.lidars.iter().map(|lidar| LidarConfig {
        mount: lidar.mount,
        // Each ray has a time of its own.
        sweep_duration_s: 0.0,
        stamp_at: StampAt::Start,
    });
    RobotConfig {
        name: FORMAT.name.to_owned(),
        lidar: lidars.next().unwrap_or_default(),
        further_lidars: lidars.collect(),
        ..RobotConfig::default()
    }
}

fn contents(survey: &Survey, roles: Roles, truth: Vec<StampedPose>) -> BagContents {
    let summary = |(name, topic): (&String, &Topic)| TopicSummary {
        name: name.clone(),
        type_name: topic.type_name.clone(),
        encoding: topic.encoding.clone(),
        messages: topic.messages,
        rate_hz: topic.rate_hz(),
        frames: topic.frames.iter().chain(&topic.children).filter(|frame| !frame.is_empty()).cloned().collect(),
    };
    BagContents {
        topics: survey.topics.iter().map(summary).collect(),
        roles: roles
            .reasons
            .into_iter()
            .map(|reason| RoleChoice { role: reason.role, what: reason.what, reason: reason.why })
            .collect(),
        truth: roles.truth.filter(|_| !truth.is_empty()).map(|topic| RecordedTruth { topic, poses: truth }),
    }
}

/// The records of a recording in the order in which its messages were recorded.
struct Records<'a> {
    messages: Messages<'a>,
    roles: &'a Roles,
    /// Of one message that became several.
    waiting: VecDeque<Record>,
    geometries: VecDeque<(GeometryKey, Arc<ScanGeometry>)>,
    slice_geometry: Arc<ScanGeometry>,
    /// The stamp of the last odometry: TF repeats its poses.
    odometry_stamp_s: Option<f64>,
    truth: Vec<StampedPose>,
    dropped: DropCounts,
}

/// What a scan's geometry follows from: the LiDAR, its rays, and the bits of the numbers.
type GeometryKey = (usize, usize, [u64; 4]);

impl<'a> Records<'a> {
    fn new(recording: &'a Recording<'a>, roles: &'a Roles) -> Self {
        Self {
            messages: recording.messages(),
            roles,
            waiting: VecDeque::new(),
            geometries: VecDeque::new(),
            slice_geometry: Arc::new(slice::geometry()),
            odometry_stamp_s: None,
            truth: Vec::new(),
            dropped: DropCounts::default(),
        }
    }

    /// Takes the message at hand, if it plays a role.
    fn take(&mut self) {
        let Some(message) = self.messages.message() else { return };
        let topic = message.channel.topic.as_str();
        let roles = self.roles;
        let lidar = roles.lidars.iter().position(|lidar| lidar.topic == topic);
        let is_odometry = matches!(&roles.odometry, Some(Odometry::Topic(name, _)) if name == topic);
        let edge = match &roles.odometry {
            Some(Odometry::Edge(edge, child_from_base)) => Some((edge, child_from_base)),
            _ => None,
        };
        let imu = roles.imu.as_ref().filter(|(name, _)| name == topic);
        let is_truth = roles.truth.as_deref() == Some(topic);
        let Some(kind) = Kind::of(&message.channel.type_name) else { return };
        let plays = lidar.is_some() || is_odometry || imu.is_some() || is_truth;
        if !plays && (edge.is_none() || kind != Kind::Transforms) {
            return;
        }
        let log_time_s = roles.by_log_time.then_some(message.log_time_s);
        let decoded = decode(kind, message.channel, message.bytes);
        match (decoded, lidar) {
            (Some(Message::Scan(scan)), Some(sensor)) => self.take_scan(sensor, scan, log_time_s),
            (Some(Message::Cloud(cloud)), Some(sensor)) => {
                let ranges_m = slice::ranges_m(&cloud, &roles.lidars[sensor].base_from_lidar);
                let geometry = Arc::clone(&self.slice_geometry);
                self.push_scan(sensor, log_time_s.unwrap_or(cloud.stamp_s), ranges_m, geometry);
            }
            (Some(Message::Odometry(placed) | Message::Pose(placed)), _) => {
                if is_truth {
                    let stamp_s = log_time_s.unwrap_or(placed.stamp_s);
                    self.truth.push(StampedPose { stamp_s, pose: placed.pose.in_plane() });
                }
                if let (true, Some(Odometry::Topic(_, child_from_base))) = (is_odometry, &roles.odometry) {
                    self.push_odometry(&placed, child_from_base, log_time_s);
                }
            }
            (Some(Message::Transforms(samples)), _) => {
                let Some((edge, child_from_base)) = edge else { return };
                for sample in samples.iter().filter(|sample| sample.parent == edge.parent && sample.child == edge.child)
                {
                    self.push_odometry(sample, child_from_base, log_time_s);
                }
            }
            (Some(Message::Imu(reading)), _) => {
                if let Some((_, base_from_imu)) = imu {
                    self.waiting.push_back(Record::Imu(in_base(&reading, base_from_imu, log_time_s)));
                }
            }
            // Counted by the survey.
            (None, _) | (Some(Message::Scan(_) | Message::Cloud(_)), None) => {}
        }
    }

    fn take_scan(&mut self, sensor: usize, scan: LaserScan, log_time_s: Option<f64>) {
        let Some(lidar) = self.roles.lidars.get(sensor) else { return };
        let geometry = self.geometry(sensor, lidar, &scan);
        let mut ranges_m = scan.ranges_m;
        if lidar.zero_means_no_return {
            for range_m in ranges_m.iter_mut().filter(|range_m| **range_m == 0.0) {
                *range_m = f32::INFINITY;
            }
        }
        self.push_scan(sensor, log_time_s.unwrap_or(scan.stamp_s), ranges_m, geometry);
    }

    fn push_scan(&mut self, sensor: usize, stamp_s: f64, ranges_m: Vec<f32>, geometry: Arc<ScanGeometry>) {
        if ranges_m.is_empty() {
            return self.dropped.add(DropReason::EmptyScan);
        }
        let sensor = SensorId(u8::try_from(sensor).unwrap_or(u8::MAX));
        self.waiting.push_back(Record::Scan(Scan { sensor, stamp_s, ranges_m, geometry, odometry: None }));
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

    fn push_odometry(&mut self, placed: &Placed, child_from_base: &Pose3, log_time_s: Option<f64>) {
        let stamp_s = log_time_s.unwrap_or(placed.stamp_s);
        if self.odometry_stamp_s.replace(stamp_s) == Some(stamp_s) {
            return;
        }
        self.waiting.push_back(Record::Odometry(StampedPose { stamp_s, pose: base_pose(placed, child_from_base) }));
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

impl Iterator for Records<'_> {
    type Item = Result<Record, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(record) = self.waiting.pop_front() {
                return Some(Ok(record));
            }
            if !self.messages.advance() {
                return None;
            }
            self.take();
        }
    }
}
