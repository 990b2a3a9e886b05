//! Recordings of live sessions: the records exactly as the engine got them, in the order in which it did.

use super::cursor::Cursor;
use super::messages::{Kind, Message, decode};
use super::recording::{Messages, Recording};
use super::{Channel, FORMAT, MessageSource as _};
use crate::data_set::{DataSet, DropCounts, DropReason};
use crate::error::{Problem, ReadError};
use crate::format::Format;
use crate::ros::LiveSession;
use crate::ros::live_messages::{GEOMETRY_TOPIC, RECORD_TOPIC, RECORD_TYPE, RecordKind, SESSION_TOPIC};
use floorprint::SensorId;
use floorprint::geometry::Pose2;
use floorprint::sensors::{EncoderReading, ImuReading, Record, Scan, ScanGeometry, StampedPose};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Whether a channel holds the records of a live session.
pub(super) fn is_record(topic: &str, type_name: &str) -> bool {
    topic == RECORD_TOPIC && type_name == RECORD_TYPE
}

/// Reads the recording of a live session.
pub(super) fn read(path: &Path, recording: &Recording<'_>, input_hash: String) -> Result<DataSet, ReadError> {
    let mut reader = Reader::default();
    let mut messages: Messages<'_> = recording.messages();
    while messages.advance() {
        if let Some(message) = messages.message() {
            reader.take(message.channel, message.bytes);
        }
    }
    let wrong = |found: String| ReadError::from(Problem::new(path, found).expected("a recording of floorprint live"));
    let session = reader.session.ok_or_else(|| wrong("what the session knew is missing".to_owned()))?;
    let session: LiveSession =
        toml::from_str(&session).map_err(|error| wrong(format!("what the session knew is damaged: {error}")))?;
    Ok(DataSet {
        format: Format { description: "a recording of floorprint live (MCAP)", ..FORMAT },
        robot: session.robot.clone(),
        records: reader.records,
        images: None,
        dropped: reader.dropped,
        notes: messages.damage().into_iter().collect(),
        input_hash,
        bag: None,
        live: Some(session),
        unpacked: None,
    })
}

/// What was read so far.
#[derive(Default)]
struct Reader {
    session: Option<String>,
    geometries: BTreeMap<u32, Arc<ScanGeometry>>,
    /// A scan that waits for its ranges.
    waiting: Option<Scan>,
    records: Vec<Record>,
    dropped: DropCounts,
}

impl Reader {
    fn take(&mut self, channel: &Channel, bytes: &[u8]) {
        let taken = match channel.topic.as_str() {
            SESSION_TOPIC => Cursor::cdr(bytes).and_then(|mut cursor| {
                self.session = Some(cursor.text()?.to_owned());
                Some(())
            }),
            GEOMETRY_TOPIC => Cursor::cdr(bytes).and_then(|mut cursor| self.take_geometry(&mut cursor)),
            RECORD_TOPIC => Cursor::cdr(bytes).and_then(|mut cursor| self.take_record(&mut cursor)),
            _ if self.waiting.is_some() && Kind::of(&channel.type_name) == Some(Kind::LaserScan) => {
                let decoded = decode(Kind::LaserScan, channel, bytes);
                if let (Some(Message::Scan(ranges)), Some(scan)) = (decoded, self.waiting.take()) {
                    self.records.push(Record::Scan(Scan { ranges_m: ranges.ranges_m, ..scan }));
                    Some(())
                } else {
                    None
                }
            }
            _ => Some(()),
        };
        if taken.is_none() {
            self.dropped.add(DropReason::Undecodable);
        }
    }

    fn take_geometry(&mut self, cursor: &mut Cursor<'_>) -> Option<()> {
        let number = cursor.u32()?;
        let geometry = ScanGeometry {
            angles_rad: cursor.list(Cursor::f64)?,
            time_offsets_s: cursor.f32_list()?,
            range_min_m: cursor.f32()?,
            range_max_m: cursor.f32()?,
            below_minimum_is_no_return: cursor.u8()? != 0,
        };
        let is_whole = geometry.angles_rad.len() == geometry.time_offsets_s.len();
        is_whole.then(|| self.geometries.insert(number, Arc::new(geometry)))?;
        Some(())
    }

    fn take_record(&mut self, cursor: &mut Cursor<'_>) -> Option<()> {
        let (kind, sensor) = (RecordKind::of(cursor.u8()?)?, SensorId(cursor.u8()?));
        let (stamp_s, geometry) = (cursor.f64()?, cursor.u32()?);
        let values = cursor.list(Cursor::f64)?;
        let record = match (kind, &values[..]) {
            (RecordKind::Scan, pose) => {
                let odometry = match *pose {
                    [x, y, theta] => Some(Pose2 { x, y, theta }),
                    _ => None,
                };
                let geometry = Arc::clone(self.geometries.get(&geometry)?);
                self.waiting = Some(Scan { sensor, stamp_s, ranges_m: Vec::new(), geometry, odometry });
                return Some(());
            }
            (RecordKind::Encoders, &[left_ticks, right_ticks]) => {
                Record::Encoders(EncoderReading { stamp_s, left_ticks, right_ticks })
            }
            (RecordKind::Imu, &[x, y, z, ahead, left, up]) => Record::Imu(ImuReading {
                stamp_s,
                angular_velocity_rad_s: [x, y, z],
                linear_acceleration_m_s2: [ahead, left, up],
            }),
            (RecordKind::Odometry, &[x, y, theta]) => {
                Record::Odometry(StampedPose { stamp_s, pose: Pose2 { x, y, theta } })
            }
            _ => return None,
        };
        self.records.push(record);
        Some(())
    }
}
