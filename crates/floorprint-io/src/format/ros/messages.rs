//! The messages that matter, taken out of either serialisation.

use super::camera::Calibration;
use super::cursor::{Cursor, frame_name};
use super::image::{ImageHead, ImageMessage};
use super::{Channel, Encoding, foxglove};
use floorprint::geometry::Pose3;

/// A message that matters, by what it says rather than by its type.
pub(super) enum Message {
    /// Ranges in a plane.
    Scan(LaserScan),
    /// Points in space.
    Cloud(PointCloud),
    /// A pose of a frame in another: `frame_from_child`.
    Odometry(Placed),
    /// A pose of something that is not named.
    Pose(Placed),
    /// Poses of frames in their parents.
    Transforms(Vec<Placed>),
    /// Turning and acceleration.
    Imu(Inertial),
    /// An image, of which only the beginning was looked at.
    Image(ImageHead),
    /// A camera's intrinsics.
    Calibration(Calibration),
    /// Angles of joints.
    Joints(Joints),
}

/// Which of them a topic holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    LaserScan,
    MultiEchoLaserScan,
    PointCloud2,
    Odometry,
    PoseStamped,
    PoseWithCovarianceStamped,
    Transforms,
    Imu,
    Image,
    CompressedImage,
    CameraInfo,
    JointState,
}

/// `sensor_msgs/LaserScan`.
pub(super) struct LaserScan {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    /// Angle of the first ray, radians, counter-clockwise from the x axis.
    pub(super) angle_min_rad: f64,
    /// From ray to ray, radians; negative when they go clockwise.
    pub(super) angle_increment_rad: f64,
    /// Angle of the last ray as it is stated, radians.
    pub(super) angle_max_rad: f64,
    /// From ray to ray, seconds; 0 when it is not stated.
    pub(super) time_increment_s: f64,
    /// From scan to scan, seconds; 0 when it is not stated.
    pub(super) scan_time_s: f64,
    pub(super) range_min_m: f32,
    pub(super) range_max_m: f32,
    pub(super) ranges_m: Vec<f32>,
}

/// `sensor_msgs/PointCloud2`: the coordinates only.
pub(super) struct PointCloud {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    /// Points in the cloud's frame, metres; those that are no numbers are left out.
    pub(super) points_m: Vec<[f32; 3]>,
}

/// A frame's pose in its parent.
pub(super) struct Placed {
    pub(super) stamp_s: f64,
    /// The frame in which the pose is.
    pub(super) parent: String,
    /// The frame whose pose it is; empty when it is not named.
    pub(super) child: String,
    /// `parent_from_child`.
    pub(super) pose: Pose3,
}

/// `sensor_msgs/Imu`: the measurements only.
pub(super) struct Inertial {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    pub(super) angular_velocity_rad_s: [f64; 3],
    pub(super) linear_acceleration_m_s2: [f64; 3],
}

/// `sensor_msgs/JointState`: names and positions only.
pub(super) struct Joints {
    pub(super) stamp_s: f64,
    pub(super) names: Vec<String>,
    /// Radians, for joints that turn.
    pub(super) positions: Vec<f64>,
}

impl Kind {
    /// Whether a LiDAR's messages are of this kind.
    pub(super) fn is_scan(self) -> bool {
        matches!(self, Self::LaserScan | Self::MultiEchoLaserScan | Self::PointCloud2)
    }

    /// By the name of a type: `package/Type`, `package/msg/Type` or `foxglove.Type`.
    pub(super) fn of(type_name: &str) -> Option<Self> {
        let (package, name) = type_name.rsplit_once(['/', '.'])?;
        Some(match (package.strip_suffix("/msg").unwrap_or(package), name) {
            ("sensor_msgs" | "foxglove", "LaserScan") => Self::LaserScan,
            ("sensor_msgs", "MultiEchoLaserScan") => Self::MultiEchoLaserScan,
            ("sensor_msgs", "PointCloud2") => Self::PointCloud2,
            ("nav_msgs", "Odometry") => Self::Odometry,
            ("geometry_msgs", "PoseStamped") | ("foxglove", "PoseInFrame") => Self::PoseStamped,
            ("geometry_msgs", "PoseWithCovarianceStamped") => Self::PoseWithCovarianceStamped,
            ("tf2_msgs", "TFMessage") | ("tf", "tfMessage") | ("foxglove", "FrameTransform" | "FrameTransforms") => {
                Self::Transforms
            }
            ("sensor_msgs", "Imu") => Self::Imu,
            ("sensor_msgs", "Image") | ("foxglove", "RawImage") => Self::Image,
            ("sensor_msgs" | "foxglove", "CompressedImage") => Self::CompressedImage,
            ("sensor_msgs", "CameraInfo") | ("foxglove", "CameraCalibration") => Self::CameraInfo,
            ("sensor_msgs", "JointState") => Self::JointState,
            _ => return None,
        })
    }
}

/// Takes a message apart; `None` when its bytes are no such message.
pub(super) fn decode(kind: Kind, channel: &Channel, bytes: &[u8]) -> Option<Message> {
    if matches!(kind, Kind::Image | Kind::CompressedImage) {
        return Some(Message::Image(ImageMessage::read(kind, channel, bytes)?.head));
    }
    let Channel { type_name, encoding, .. } = channel;
    let mut cursor = match encoding {
        Encoding::Ros1 => Cursor::ros1(bytes),
        Encoding::Cdr => Cursor::cdr(bytes)?,
        Encoding::Protobuf => return foxglove::decode_protobuf(type_name, bytes),
        Encoding::Json => return foxglove::decode_json(type_name, bytes),
        Encoding::Other(_) => return None,
    };
    let cursor = &mut cursor;
    Some(match kind {
        Kind::LaserScan => Message::Scan(scan(cursor, Cursor::f32_list)?),
        Kind::MultiEchoLaserScan => Message::Scan(scan(cursor, first_echoes)?),
        Kind::PointCloud2 => Message::Cloud(cloud(cursor)?),
        Kind::Odometry => {
            let header = cursor.header()?;
            // No frame has a pose in itself: who writes its name twice has left out what moves.
            let child = Some(frame_name(cursor.text()?)).filter(|child| *child != header.frame).unwrap_or_default();
            Message::Odometry(Placed {
                stamp_s: header.stamp_s,
                parent: header.frame.to_owned(),
                child: child.to_owned(),
                pose: pose(cursor)?,
            })
        }
        Kind::PoseStamped | Kind::PoseWithCovarianceStamped => {
            let header = cursor.header()?;
            Message::Pose(Placed {
                stamp_s: header.stamp_s,
                parent: header.frame.to_owned(),
                child: String::new(),
                pose: pose(cursor)?,
            })
        }
        Kind::Transforms => Message::Transforms(cursor.list(|cursor| {
            let header = cursor.header()?;
            let child = frame_name(cursor.text()?).to_owned();
            let parent = header.frame.to_owned();
            Some(Placed { stamp_s: header.stamp_s, parent, child, pose: pose(cursor)? })
        })?),
        Kind::CameraInfo => Message::Calibration(Calibration::read(cursor)?),
        Kind::JointState => {
            let stamp_s = cursor.header()?.stamp_s;
            let names = cursor.list(|cursor| Some(cursor.text()?.to_owned()))?;
            Message::Joints(Joints { stamp_s, names, positions: cursor.list(Cursor::f64)? })
        }
        // Taken apart above.
        Kind::Image | Kind::CompressedImage => return None,
        Kind::Imu => {
            let header = cursor.header()?;
            let _orientation_with_covariance: [f64; 4 + 9] = cursor.f64s()?;
            let angular_velocity_rad_s = cursor.f64s()?;
            let _covariance: [f64; 9] = cursor.f64s()?;
            Message::Imu(Inertial {
                stamp_s: header.stamp_s,
                frame: header.frame.to_owned(),
                angular_velocity_rad_s,
                linear_acceleration_m_s2: cursor.f64s()?,
            })
        }
    })
}

fn scan<'a>(cursor: &mut Cursor<'a>, ranges: impl FnOnce(&mut Cursor<'a>) -> Option<Vec<f32>>) -> Option<LaserScan> {
    let header = cursor.header()?;
    let [angle_min_rad, angle_max_rad, angle_increment_rad] =
        [cursor.f32()?, cursor.f32()?, cursor.f32()?].map(f64::from);
    let (time_increment_s, scan_time_s) = (cursor.f32()?, cursor.f32()?);
    let (range_min_m, range_max_m) = (cursor.f32()?, cursor.f32()?);
    let ranges_m = ranges(cursor)?;
    // Who does not state how far apart rays are still states between which angles they lie.
    let steps = ranges_m.len().saturating_sub(1).max(1) as f64;
    let is_stated = angle_increment_rad != 0.0;
    Some(LaserScan {
        stamp_s: header.stamp_s,
        frame: header.frame.to_owned(),
        angle_min_rad,
        angle_increment_rad: if is_stated { angle_increment_rad } else { (angle_max_rad - angle_min_rad) / steps },
        angle_max_rad,
        time_increment_s: time_increment_s.into(),
        scan_time_s: scan_time_s.into(),
        range_min_m,
        range_max_m,
        ranges_m,
    })
}

/// The first echo of each ray: the nearest thing that sent anything back. Rays without an echo saw nothing.
fn first_echoes(cursor: &mut Cursor<'_>) -> Option<Vec<f32>> {
    cursor.list(|cursor| Some(cursor.f32_list()?.first().copied().unwrap_or(f32::INFINITY)))
}

fn pose(cursor: &mut Cursor<'_>) -> Option<Pose3> {
    let [x, y, z, qx, qy, qz, qw] = cursor.f64s()?;
    Some(Pose3::from_quaternion([x, y, z], [qx, qy, qz, qw]))
}

/// A field of a point's bytes: `sensor_msgs/PointField` of 32 or 64 bits.
#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    is_double: bool,
}

fn cloud(cursor: &mut Cursor<'_>) -> Option<PointCloud> {
    const FLOAT32: u8 = 7;
    const FLOAT64: u8 = 8;
    let header = cursor.header()?;
    let (_height, _width) = (cursor.u32()?, cursor.u32()?);
    let mut fields = [None; 3];
    cursor.list(|cursor| {
        let name = cursor.text()?;
        let offset = cursor.u32()? as usize;
        let datatype = cursor.u8()?;
        let _count = cursor.u32()?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name)
            && (datatype == FLOAT32 || datatype == FLOAT64)
        {
            fields[axis] = Some(Field { offset, is_double: datatype == FLOAT64 });
        }
        Some(())
    })?;
    let big_endian = cursor.u8()? != 0;
    let (point_bytes, _row_bytes) = (cursor.u32()? as usize, cursor.u32()?);
    let data = cursor.byte_list()?;
    let [Some(x), Some(y), Some(z)] = fields else { return None };
    let coordinate = |point: &[u8], field: Field| -> Option<f32> {
        let bytes = point.get(field.offset..)?;
        Some(match (field.is_double, big_endian) {
            (false, false) => f32::from_le_bytes(*bytes.first_chunk()?),
            (false, true) => f32::from_be_bytes(*bytes.first_chunk()?),
            (true, false) => f64::from_le_bytes(*bytes.first_chunk()?) as f32,
            (true, true) => f64::from_be_bytes(*bytes.first_chunk()?) as f32,
        })
    };
    let mut points_m = Vec::new();
    for point in data.chunks_exact(point_bytes.max(1)) {
        let point_m = [coordinate(point, x)?, coordinate(point, y)?, coordinate(point, z)?];
        if point_m.iter().all(|value| value.is_finite()) {
            points_m.push(point_m);
        }
    }
    Some(PointCloud { stamp_s: header.stamp_s, frame: header.frame.to_owned(), points_m })
}
