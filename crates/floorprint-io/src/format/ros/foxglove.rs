//! Messages in Foxglove's own schemas, as protobuf or JSON: `LaserScan`, `FrameTransform(s)` and `PoseInFrame`; as
//! protobuf also `RawImage`, `CompressedImage` and `CameraCalibration`.
//!
//! Source: <https://docs.foxglove.dev/docs/visualization/message-schemas>; the numbers of the protobuf fields are
//! those of `foxglove-sdk/schemas/proto`.

use super::camera::Calibration;
use super::cursor::frame_name;
use super::messages::{LaserScan, Message, Placed};
use floorprint::geometry::Pose3;
use serde::Deserialize;

/// Rays without a return: the schema has no longest range.
const LONGEST_RANGE_M: f32 = f32::INFINITY;

/// Takes a message in protobuf apart.
pub(super) fn decode_protobuf(type_name: &str, bytes: &[u8]) -> Option<Message> {
    let fields = Fields(bytes);
    match type_name {
        "foxglove.LaserScan" => {
            let ranges_m = fields.numbers(6)?;
            scan(Scan {
                timestamp: fields.time(1)?,
                frame_id: fields.text(2)?,
                pose: Some(fields.pose(3)?),
                start_angle: fields.number(4)?,
                end_angle: fields.number(5)?,
                ranges: ranges_m.into_iter().map(Some).collect(),
            })
        }
        "foxglove.PoseInFrame" => {
            Some(pose(PoseInFrame { timestamp: fields.time(1)?, frame_id: fields.text(2)?, pose: fields.pose(3)? }))
        }
        "foxglove.CameraCalibration" => {
            let size_px = [fields.integer(2)?, fields.integer(3)?].map(|pixels| pixels as usize);
            let (k, p) = (fields.numbers(6)?, fields.numbers(8)?);
            Some(Message::Calibration(Calibration::new(
                fields.time(1)?.seconds(),
                frame_name(&fields.text(9)?).to_owned(),
                size_px,
                fields.text(4)?,
                fields.numbers(5)?,
                &k.try_into().ok()?,
                // Not stated of cameras that nobody rectifies.
                &p.try_into().unwrap_or_default(),
            )))
        }
        "foxglove.FrameTransform" => Some(Message::Transforms(vec![placed(fields.transform()?)])),
        "foxglove.FrameTransforms" => {
            let transforms = fields.all(1).map(|bytes| Some(placed(Fields(bytes?).transform()?)));
            Some(Message::Transforms(transforms.collect::<Option<_>>()?))
        }
        _ => None,
    }
}

/// An image in protobuf.
pub(super) struct ImageParts<'a> {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    pub(super) encoding: String,
    /// Columns and rows; none of a compressed one.
    pub(super) size_px: Option<[usize; 2]>,
    pub(super) row_bytes: usize,
    pub(super) data: &'a [u8],
}

impl<'a> ImageParts<'a> {
    /// Takes a `RawImage` or `CompressedImage` apart.
    pub(super) fn read(bytes: &'a [u8], is_compressed: bool) -> Option<Self> {
        let fields = Fields(bytes);
        let [frame, encoding, data] = if is_compressed { [4, 3, 2] } else { [7, 4, 6] };
        let number = |field| Some(usize::try_from(fields.integer(field)?).unwrap_or(usize::MAX));
        let [size_px, row_bytes] = [(2, 3), (5, 5)].map(|(first, second)| Some([number(first)?, number(second)?]));
        Some(Self {
            stamp_s: fields.time(1)?.seconds(),
            frame: frame_name(&fields.text(frame)?).to_owned(),
            encoding: fields.text(encoding)?,
            size_px: size_px.filter(|_| !is_compressed),
            row_bytes: row_bytes.filter(|_| !is_compressed).map_or(0, |[bytes, _]| bytes),
            data: fields.bytes(data)?,
        })
    }
}

/// Takes a message in JSON apart.
pub(super) fn decode_json(type_name: &str, bytes: &[u8]) -> Option<Message> {
    match type_name {
        "foxglove.LaserScan" => {
            scan(serde_json::from_slice(bytes).or_else(|_| serde_json::from_slice(&without_infinities(bytes))).ok()?)
        }
        "foxglove.PoseInFrame" => Some(pose(serde_json::from_slice(bytes).ok()?)),
        "foxglove.FrameTransform" => Some(Message::Transforms(vec![placed(serde_json::from_slice(bytes).ok()?)])),
        "foxglove.FrameTransforms" => {
            let Transforms { transforms } = serde_json::from_slice(bytes).ok()?;
            Some(Message::Transforms(transforms.into_iter().map(placed).collect()))
        }
        _ => None,
    }
}

/// JSON in which `Infinity`, which some write though there is no such thing, is `null`, and what means that a ray does not count
/// (`-Infinity`, `NaN`) no range.
fn without_infinities(json: &[u8]) -> Vec<u8> {
    let text = String::from_utf8_lossy(json);
    text.replace("-Infinity", "-1").replace("Infinity", "null").replace("NaN", "-1").into_bytes()
}

#[derive(Deserialize)]
struct Scan {
    timestamp: Time,
    frame_id: String,
    /// Of its own rays in the frame; where they begin if it is not stated.
    #[serde(default)]
    pose: Option<Pose>,
    start_angle: f64,
    end_angle: f64,
    /// JSON has no infinity: `null` where nothing came back.
    ranges: Vec<Option<f64>>,
}

#[derive(Deserialize)]
struct PoseInFrame {
    timestamp: Time,
    frame_id: String,
    pose: Pose,
}

#[derive(Deserialize)]
struct Transforms {
    transforms: Vec<Transform>,
}

#[derive(Deserialize)]
struct Transform {
    timestamp: Time,
    parent_frame_id: String,
    child_frame_id: String,
    translation: Vector,
    rotation: Quaternion,
}

#[derive(Default, Deserialize)]
struct Time {
    sec: i64,
    #[serde(alias = "nanos")]
    nsec: u32,
}

#[derive(Default, Deserialize)]
struct Pose {
    position: Vector,
    orientation: Quaternion,
}

#[derive(Default, Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Default, Deserialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

impl Time {
    fn seconds(&self) -> f64 {
        self.sec as f64 + f64::from(self.nsec) * 1e-9
    }
}

fn pose3(Vector { x, y, z }: &Vector, rotation: &Quaternion) -> Pose3 {
    Pose3::from_quaternion([*x, *y, *z], [rotation.x, rotation.y, rotation.z, rotation.w])
}

/// A scan whose rays start elsewhere than in its frame's origin is not used: its mount would not be the frame's.
fn scan(scan: Scan) -> Option<Message> {
    let steps = scan.ranges.len().saturating_sub(1).max(1) as f64;
    let starts_there = |pose: &Pose| pose3(&pose.position, &pose.orientation) == Pose3::identity();
    scan.pose.as_ref().is_none_or(starts_there).then(|| {
        Message::Scan(LaserScan {
            stamp_s: scan.timestamp.seconds(),
            frame: frame_name(&scan.frame_id).to_owned(),
            angle_min_rad: scan.start_angle,
            angle_increment_rad: (scan.end_angle - scan.start_angle) / steps,
            angle_max_rad: scan.end_angle,
            time_increment_s: 0.0,
            scan_time_s: 0.0,
            range_min_m: 0.0,
            range_max_m: LONGEST_RANGE_M,
            ranges_m: scan.ranges.into_iter().map(|range_m| range_m.map_or(f32::INFINITY, |m| m as f32)).collect(),
        })
    })
}

fn pose(PoseInFrame { timestamp, frame_id, pose }: PoseInFrame) -> Message {
    Message::Pose(Placed {
        stamp_s: timestamp.seconds(),
        parent: frame_name(&frame_id).to_owned(),
        child: String::new(),
        pose: pose3(&pose.position, &pose.orientation),
    })
}

fn placed(transform: Transform) -> Placed {
    Placed {
        stamp_s: transform.timestamp.seconds(),
        parent: frame_name(&transform.parent_frame_id).to_owned(),
        child: frame_name(&transform.child_frame_id).to_owned(),
        pose: pose3(&transform.translation, &transform.rotation),
    }
}

/// A message in protobuf: fields of a number and a value each, absent where they are zero.
struct Fields<'a>(&'a [u8]);

/// A field's value.
enum Value<'a> {
    Varint(u64),
    Fixed(u64),
    Bytes(&'a [u8]),
}

impl<'a> Fields<'a> {
    /// The next field; `None` at the end, `Some(None)` when there is none.
    fn next(&mut self) -> Option<Option<(u64, Value<'a>)>> {
        (!self.0.is_empty()).then(|| self.field())
    }

    fn field(&mut self) -> Option<(u64, Value<'a>)> {
        let key = self.varint()?;
        let value = match key & 7 {
            0 => Value::Varint(self.varint()?),
            1 => Value::Fixed(u64::from_le_bytes(self.take(8)?.try_into().ok()?)),
            2 => {
                let length = usize::try_from(self.varint()?).ok()?;
                Value::Bytes(self.take(length)?)
            }
            5 => Value::Varint(u32::from_le_bytes(self.take(4)?.try_into().ok()?).into()),
            _ => return None,
        };
        Some((key >> 3, value))
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let &[byte] = self.take(1)? else { return None };
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    /// All values of a field that are bytes; an item is `None` where the message is garbled.
    fn all(&self, wanted: u64) -> impl Iterator<Item = Option<&'a [u8]>> {
        let mut rest = Fields(self.0);
        std::iter::from_fn(move || {
            loop {
                match rest.next()? {
                    Some((number, Value::Bytes(bytes))) if number == wanted => return Some(Some(bytes)),
                    Some(_) => {}
                    None => {
                        rest.0 = &[];
                        return Some(None);
                    }
                }
            }
        })
    }

    /// The last value of a field; `Some(None)` when it is absent.
    fn value(&self, wanted: u64) -> Option<Option<Value<'a>>> {
        let mut rest = Fields(self.0);
        let mut found = None;
        while let Some(field) = rest.next() {
            let (number, value) = field?;
            if number == wanted {
                found = Some(value);
            }
        }
        Some(found)
    }

    fn number(&self, wanted: u64) -> Option<f64> {
        match self.value(wanted)? {
            Some(Value::Fixed(bits)) => Some(f64::from_bits(bits)),
            None => Some(0.0),
            _ => None,
        }
    }

    fn integer(&self, wanted: u64) -> Option<u64> {
        match self.value(wanted)? {
            Some(Value::Varint(value)) => Some(value),
            None => Some(0),
            _ => None,
        }
    }

    fn bytes(&self, wanted: u64) -> Option<&'a [u8]> {
        match self.value(wanted)? {
            Some(Value::Bytes(bytes)) => Some(bytes),
            None => Some(&[]),
            _ => None,
        }
    }

    fn text(&self, wanted: u64) -> Option<String> {
        String::from_utf8(self.bytes(wanted)?.to_vec()).ok()
    }

    /// A list of numbers, packed or one by one.
    fn numbers(&self, wanted: u64) -> Option<Vec<f64>> {
        let mut rest = Fields(self.0);
        let mut numbers = Vec::new();
        while let Some(field) = rest.next() {
            match field? {
                (number, Value::Bytes(bytes)) if number == wanted => {
                    numbers.extend(bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)));
                }
                (number, Value::Fixed(bits)) if number == wanted => numbers.push(f64::from_bits(bits)),
                _ => {}
            }
        }
        Some(numbers)
    }

    fn time(&self, wanted: u64) -> Option<Time> {
        let time = Fields(self.bytes(wanted)?);
        Some(Time { sec: time.integer(1)?.cast_signed(), nsec: u32::try_from(time.integer(2)?).ok()? })
    }

    fn vector(&self, wanted: u64) -> Option<Vector> {
        let vector = Fields(self.bytes(wanted)?);
        Some(Vector { x: vector.number(1)?, y: vector.number(2)?, z: vector.number(3)? })
    }

    fn quaternion(&self, wanted: u64) -> Option<Quaternion> {
        let parts = Fields(self.bytes(wanted)?);
        Some(Quaternion { x: parts.number(1)?, y: parts.number(2)?, z: parts.number(3)?, w: parts.number(4)? })
    }

    fn pose(&self, wanted: u64) -> Option<Pose> {
        let pose = Fields(self.bytes(wanted)?);
        Some(Pose { position: pose.vector(1)?, orientation: pose.quaternion(2)? })
    }

    fn transform(&self) -> Option<Transform> {
        Some(Transform {
            timestamp: self.time(1)?,
            parent_frame_id: self.text(2)?,
            child_frame_id: self.text(3)?,
            translation: self.vector(4)?,
            rotation: self.quaternion(5)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field of bytes.
    fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[(number << 3) | 2, bytes.len() as u8][..], bytes].concat()
    }

    fn double(number: u8, value: f64) -> Vec<u8> {
        [&[(number << 3) | 1][..], &value.to_le_bytes()].concat()
    }

    fn fixed(number: u8, value: u32) -> Vec<u8> {
        [&[(number << 3) | 5][..], &value.to_le_bytes()].concat()
    }

    #[test]
    fn images_and_their_calibration_are_read() {
        let time = field(1, &[0x08, 0x96, 0x01]);
        let raw = [
            time.clone(),
            fixed(2, 2),
            fixed(3, 1),
            field(4, b"rgb8"),
            fixed(5, 6),
            field(6, &[1, 2, 3, 4, 5, 6]),
            field(7, b"/cam"),
        ];
        let parts_of = |bytes: &[u8], is_compressed| {
            let parts = ImageParts::read(bytes, is_compressed).unwrap();
            (parts.stamp_s, parts.frame, parts.encoding, parts.size_px, parts.row_bytes, parts.data.to_vec())
        };
        let expected = (150.0, "cam".to_owned(), "rgb8".to_owned(), Some([2, 1]), 6, vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(parts_of(&raw.concat(), false), expected);
        let packed = [time.clone(), field(2, &[9, 8]), field(3, b"jpeg"), field(4, b"cam")].concat();
        let expected = (150.0, "cam".to_owned(), "jpeg".to_owned(), None, 0, vec![9, 8]);
        assert_eq!(parts_of(&packed, true), expected);

        let numbers = |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        let k = numbers(&[500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]);
        let camera =
            [time, fixed(2, 640), fixed(3, 480), field(5, &numbers(&[0.0; 5])), field(6, &k), field(9, b"cam")];
        let Some(Message::Calibration(calibration)) = decode_protobuf("foxglove.CameraCalibration", &camera.concat())
        else {
            panic!("no calibration")
        };
        assert_eq!((calibration.stamp_s, calibration.frame.as_str()), (150.0, "cam"));
        assert!(decode_protobuf("foxglove.CameraCalibration", &camera[..4].concat()).is_none());
    }

    #[test]
    fn protobuf_and_json_say_the_same() {
        let time = [0x08, 0x96, 0x01, 0x10, 0x05];
        let ranges: Vec<u8> = [1.5_f64, 2.5].iter().flat_map(|range_m| range_m.to_le_bytes()).collect();
        let bytes = [field(1, &time), field(2, b"/laser"), double(4, -1.0), double(5, 1.0), field(6, &ranges)].concat();
        let json = br#"{"timestamp":{"sec":150,"nsec":5},"frame_id":"laser","pose":{"position":{"x":0,"y":0,"z":0},
            "orientation":{"x":0,"y":0,"z":0,"w":1}},"start_angle":-1,"end_angle":1,"ranges":[1.5,2.5],"intensities":[]}"#;
        for message in [decode_protobuf("foxglove.LaserScan", &bytes), decode_json("foxglove.LaserScan", json)] {
            let Some(Message::Scan(scan)) = message else { panic!("no scan") };
            assert_eq!((scan.stamp_s, scan.frame.as_str()), (150.000_000_005, "laser"));
            assert_eq!((scan.angle_min_rad, scan.angle_increment_rad, scan.ranges_m), (-1.0, 2.0, vec![1.5, 2.5]));
        }
        // Without a pose, and where nothing came back, which JSON has no number for.
        for (nothing, expected_m) in [("null", f32::INFINITY), ("Infinity", f32::INFINITY), ("NaN", -1.0)] {
            let json = format!(
                r#"{{"timestamp":{{"sec":1,"nsec":0}},"frame_id":"laser","start_angle":-1,"end_angle":1,"ranges":[{nothing},2.5]}}"#
            );
            let Some(Message::Scan(scan)) = decode_json("foxglove.LaserScan", json.as_bytes()) else {
                panic!("no scan: {json}")
            };
            assert_eq!(scan.ranges_m, [expected_m, 2.5]);
        }
        let transform = [field(1, &time), field(2, b"odom"), field(3, b"base"), field(4, &double(1, 3.0))].concat();
        let list = [field(1, &transform), field(1, &transform)].concat();
        let Some(Message::Transforms(placed)) = decode_protobuf("foxglove.FrameTransforms", &list) else {
            panic!("no transforms")
        };
        assert_eq!((placed.len(), placed[1].child.as_str(), placed[1].pose.translation_m.x), (2, "base", 3.0));
        assert!(decode_protobuf("foxglove.LaserScan", &bytes[..9]).is_none());
    }

    #[test]
    fn what_is_written_is_read() {
        use crate::foxglove::{FrameTransform, FrameTransforms, Message as _};
        let pose = crate::ros::SpacePose::from(&floorprint::geometry::Pose2::new(1.0, -2.0, 0.5));
        let transform = FrameTransform { stamp_s: 12.25, parent: "map", child: "odom", pose };
        let bytes = FrameTransforms(vec![transform]).to_protobuf();
        let Some(Message::Transforms(placed)) = decode_protobuf("foxglove.FrameTransforms", &bytes) else {
            panic!("no transforms")
        };
        let [Placed { stamp_s, parent, child, pose }] = &placed[..] else { panic!("not one") };
        assert_eq!((*stamp_s, parent.as_str(), child.as_str()), (12.25, "map", "odom"));
        assert_eq!(pose.translation_m.as_slice(), [1.0, -2.0, 0.0]);
    }
}
