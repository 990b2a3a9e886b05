//! Records what a live session receives, as an MCAP file with messages of ROS 2.

use super::live_messages::{ExactGeometry, ExactRecord, GEOMETRY_TOPIC, RECORD_TOPIC, RecordKind, SESSION_TOPIC};
use super::messages::{Header, Imu, LaserScan, Message, Odometry, Text, Transform, Transforms, nanoseconds};
use crate::error::{Problem, WriteError};
use crate::foxglove::Schema;
use crate::mcap_writer::{McapWriter, Purpose};
use crate::replace::sync_folder;
use floorprint::odometry::OdometryCorrections;
use floorprint::sensors::{LidarConfig, Record, RobotConfig, Scan, ScanGeometry};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What was recorded is on the disk after so long.
const FLUSHED_AFTER: Duration = Duration::from_secs(1);

/// What holds for a whole recording of a live session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LiveSession {
    /// The robot's calibration.
    pub robot: RobotConfig,
    /// What the synchroniser knew beforehand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrections: Option<OdometryCorrections>,
}

/// Writes the records of a live session while they come in.
///
/// The file is called `NAME.active` until [`finish`](Self::finish), so that a recording that has ended is told from one
/// that goes on or was cut off. Either can be read; of a process that was killed all but the last second is there.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    active: PathBuf,
    writer: McapWriter<File>,
    channels: BTreeMap<String, u16>,
    /// What stands before the first record, at its time.
    beginning: Option<(String, Transforms<'static>)>,
    geometries: Vec<Arc<ScanGeometry>>,
    flushed: Instant,
    /// Nanoseconds; the file's times do not run back.
    latest_ns: u64,
}

/// Most geometries that are remembered; what changes more often is written again.
const KEPT_GEOMETRIES: usize = 16;

impl Recorder {
    /// Begins a recording.
    ///
    /// # Errors
    /// When there is a file already, or it cannot be written.
    pub fn create(path: &Path, session: &LiveSession) -> Result<Self, WriteError> {
        let active = active_path(path);
        for taken in [path, &active] {
            if fs::symlink_metadata(taken).is_ok() {
                return Err(Problem::new(taken, "a file stands there")
                    .advice("Choose another name, or remove it")
                    .into());
            }
        }
        let refused = |error: io::Error| WriteError::io(&active, &error);
        let file = File::create_new(&active).map_err(refused)?;
        let text = toml::to_string(session).map_err(|error| refused(io::Error::other(error)))?;
        Ok(Self {
            path: path.to_path_buf(),
            writer: McapWriter::new(file, Purpose::Ros2).map_err(refused)?,
            active: active.clone(),
            channels: BTreeMap::new(),
            beginning: Some((text, mounts(&session.robot))),
            geometries: Vec::new(),
            flushed: Instant::now(),
            latest_ns: 0,
        })
    }

    /// Appends a record.
    ///
    /// # Errors
    /// When it cannot be written; what was written before can still be read.
    pub fn write(&mut self, record: &Record) -> Result<(), WriteError> {
        let write = |recorder: &mut Self| {
            recorder.latest_ns = recorder.latest_ns.max(nanoseconds(record.stamp_s()));
            recorder.begin()?;
            match record {
                Record::Scan(scan) => recorder.scan(scan)?,
                Record::Encoders(reading) => {
                    let values = [reading.left_ticks, reading.right_ticks];
                    recorder.exact(RecordKind::Encoders, reading.stamp_s, &values)?;
                }
                Record::Imu(reading) => {
                    let (turn, push) = (reading.angular_velocity_rad_s, reading.linear_acceleration_m_s2);
                    let values = [turn[0], turn[1], turn[2], push[0], push[1], push[2]];
                    recorder.exact(RecordKind::Imu, reading.stamp_s, &values)?;
                    let header = Header { stamp_s: reading.stamp_s, frame: "base_link" };
                    let message = Imu { header, angular_velocity_rad_s: turn, linear_acceleration_m_s2: push };
                    recorder.put("/imu", &message, false)?;
                }
                Record::Odometry(stamped) => {
                    let pose = stamped.pose;
                    recorder.exact(RecordKind::Odometry, stamped.stamp_s, &[pose.x, pose.y, pose.theta])?;
                    let header = Header { stamp_s: stamped.stamp_s, frame: "odom" };
                    recorder.put("/odom", &Odometry { header: header.clone(), child: "base_link", pose }, false)?;
                    let moved = Transform { header, child: "base_link", pose: (&pose).into() };
                    recorder.put("/tf", &Transforms(vec![moved]), false)?;
                }
            }
            if recorder.flushed.elapsed() > FLUSHED_AFTER {
                recorder.flushed = Instant::now();
                recorder.writer.flush()?;
            }
            Ok(())
        };
        write(self).map_err(|error| WriteError::io(&self.active, &error))
    }

    /// Ends the recording and gives it its name.
    ///
    /// # Errors
    /// When it cannot be written or named.
    pub fn finish(mut self) -> Result<(), WriteError> {
        let begun = self.begin();
        let Self { path, active, writer, .. } = self;
        let refused = |error: io::Error| WriteError::io(&path, &error);
        begun.map_err(refused)?;
        writer.finish().and_then(|file| file.sync_all()).map_err(refused)?;
        fs::rename(&active, &path).map_err(refused)?;
        sync_folder(path.parent().unwrap_or(Path::new(""))).map_err(refused)
    }

    fn begin(&mut self) -> io::Result<()> {
        let Some((session, transforms)) = self.beginning.take() else { return Ok(()) };
        self.put(SESSION_TOPIC, &Text(&session), true)?;
        self.put("/tf_static", &transforms, true)
    }

    fn scan(&mut self, scan: &Scan) -> io::Result<()> {
        let geometry = self.geometry(&scan.geometry)?;
        let pose: Vec<f64> = scan.odometry.iter().flat_map(|pose| [pose.x, pose.y, pose.theta]).collect();
        let exact = ExactRecord {
            kind: RecordKind::Scan,
            sensor: scan.sensor.0,
            stamp_s: scan.stamp_s,
            geometry,
            values: &pose,
        };
        self.put(RECORD_TOPIC, &exact, false)?;
        let (topic, frame) = lidar_names(scan.sensor.0.into());
        self.put(&topic, &laser_scan(scan, &frame), false)
    }

    /// The number of a geometry; a new one is written first.
    fn geometry(&mut self, geometry: &Arc<ScanGeometry>) -> io::Result<u32> {
        let is_same = |known: &Arc<ScanGeometry>| Arc::ptr_eq(known, geometry) || known == geometry;
        let number = match self.geometries.iter().position(is_same) {
            Some(number) => return Ok(number as u32),
            None if self.geometries.len() < KEPT_GEOMETRIES => self.geometries.len(),
            None => {
                self.geometries.clear();
                0
            }
        };
        self.geometries.push(Arc::clone(geometry));
        self.put(GEOMETRY_TOPIC, &ExactGeometry { number: number as u32, geometry }, true)?;
        Ok(number as u32)
    }

    fn exact(&mut self, kind: RecordKind, stamp_s: f64, values: &[f64]) -> io::Result<()> {
        self.put(RECORD_TOPIC, &ExactRecord { kind, sensor: 0, stamp_s, geometry: 0, values }, false)
    }

    fn put<M: Message>(&mut self, topic: &str, message: &M, is_latched: bool) -> io::Result<()> {
        let channel = match self.channels.get(topic) {
            Some(&channel) => channel,
            None => {
                let channel = self.writer.add_channel(topic, &Schema::of_ros::<M>(), is_latched);
                self.channels.insert(topic.to_owned(), channel);
                channel
            }
        };
        self.writer.write(channel, self.latest_ns, &message.to_cdr())
    }
}

/// What a recording is called while it goes on.
#[must_use]
pub fn active_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".active");
    name.into()
}

/// What the frame of a LiDAR is called: `laser`, `laser_1` and so on.
#[must_use]
pub fn lidar_frame(sensor: usize) -> String {
    if sensor == 0 { "laser".to_owned() } else { format!("laser_{sensor}") }
}

/// Topic and frame of a LiDAR.
fn lidar_names(sensor: usize) -> (String, String) {
    let topic = if sensor == 0 { "/scan".to_owned() } else { format!("/scan_{sensor}") };
    (topic, lidar_frame(sensor))
}

/// Where the LiDARs sit.
fn mounts(robot: &RobotConfig) -> Transforms<'static> {
    const FRAMES: [&str; 4] = ["laser", "laser_1", "laser_2", "laser_3"];
    let lidar = |(frame, lidar): (&'static str, &LidarConfig)| Transform {
        header: Header { stamp_s: 0.0, frame: "base_link" },
        child: frame,
        pose: (&lidar.mount).into(),
    };
    let all = std::iter::once(&robot.lidar).chain(&robot.further_lidars);
    Transforms(FRAMES.into_iter().zip(all).map(lidar).collect())
}

/// A scan as ROS has it.
fn laser_scan<'a>(scan: &'a Scan, frame: &'a str) -> LaserScan<'a> {
    let ScanGeometry { angles_rad, time_offsets_s, range_min_m, range_max_m, .. } = &*scan.geometry;
    let steps = angles_rad.len().saturating_sub(1).max(1);
    let ends = |values: Option<(&f64, &f64)>| values.map_or([0.0; 2], |(first, last)| [*first, *last]);
    let [first_rad, last_rad] = ends(angles_rad.first().zip(angles_rad.last()));
    let offsets = time_offsets_s.first().zip(time_offsets_s.last());
    let sweep_s = offsets.map_or(0.0, |(first, last)| last - first);
    LaserScan {
        header: Header { stamp_s: scan.stamp_s + f64::from(*time_offsets_s.first().unwrap_or(&0.0)), frame },
        angles_rad: [first_rad as f32, last_rad as f32],
        angle_increment_rad: ((last_rad - first_rad) / steps as f64) as f32,
        time_increment_s: sweep_s / steps as f32,
        scan_time_s: 0.0,
        range_m: [*range_min_m, *range_max_m],
        ranges_m: &scan.ranges_m,
    }
}
