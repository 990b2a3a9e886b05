//! Small writers of recordings: messages in both serialisations, and the containers that hold them.
#![allow(dead_code, reason = "not every test needs every writer")]

use rusqlite::{Connection, params};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// A message in both serialisations.
#[derive(Clone)]
pub struct Message {
    pub topic: String,
    /// `package/Type`.
    pub type_name: &'static str,
    pub log_ns: u64,
    pub ros1: Vec<u8>,
    pub cdr: Vec<u8>,
}

/// Writes the fields of a message in one serialisation.
pub struct Fields {
    bytes: Vec<u8>,
    is_cdr: bool,
}

impl Fields {
    fn align(&mut self, size: usize) {
        while self.is_cdr && !(self.bytes.len() - 4).is_multiple_of(size) {
            self.bytes.push(0);
        }
    }

    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    pub fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    pub fn f64(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + u32::from(self.is_cdr));
        self.bytes.extend(text.as_bytes());
        if self.is_cdr {
            self.bytes.push(0);
        }
    }

    pub fn f32s(&mut self, values: &[f32]) {
        self.u32(values.len() as u32);
        for &value in values {
            self.f32(value);
        }
    }

    pub fn f64s(&mut self, values: &[f64]) {
        self.u32(values.len() as u32);
        for &value in values {
            self.f64(value);
        }
    }

    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.bytes.extend(bytes);
    }

    pub fn header(&mut self, stamp_ns: u64, frame: &str) {
        if !self.is_cdr {
            self.u32(0);
        }
        self.u32((stamp_ns / 1_000_000_000) as u32);
        self.u32((stamp_ns % 1_000_000_000) as u32);
        self.text(frame);
    }

    /// A place in metres and a turn about z in radians.
    pub fn pose(&mut self, [x, y, z]: [f64; 3], [roll, yaw]: [f64; 2]) {
        let ((sr, cr), (sy, cy)) = ((roll / 2.0).sin_cos(), (yaw / 2.0).sin_cos());
        for value in [x, y, z, sr * cy, sr * sy, cr * sy, cr * cy] {
            self.f64(value);
        }
    }
}

/// A message whose fields are written by `write`.
pub fn message(topic: &str, type_name: &'static str, log_ns: u64, write: impl Fn(&mut Fields)) -> Message {
    let serialised = |is_cdr: bool| {
        let mut fields = Fields { bytes: if is_cdr { vec![0, 1, 0, 0] } else { Vec::new() }, is_cdr };
        write(&mut fields);
        fields.bytes
    };
    Message { topic: topic.to_owned(), type_name, log_ns, ros1: serialised(false), cdr: serialised(true) }
}

/// Rays of a planar LiDAR.
pub struct Rays {
    pub angle_min_rad: f32,
    pub angle_increment_rad: f32,
    pub time_increment_s: f32,
    pub scan_time_s: f32,
    pub range_min_m: f32,
    pub range_max_m: f32,
}

pub fn scan(topic: &str, stamp_ns: u64, frame: &str, rays: &Rays, ranges_m: &[f32]) -> Message {
    let angle_max_rad = rays.angle_min_rad + rays.angle_increment_rad * ranges_m.len().saturating_sub(1) as f32;
    scan_up_to(topic, stamp_ns, frame, rays, angle_max_rad, ranges_m)
}

/// A scan that states an angle of the last ray of its own.
pub fn scan_up_to(
    topic: &str,
    stamp_ns: u64,
    frame: &str,
    rays: &Rays,
    angle_max_rad: f32,
    ranges_m: &[f32],
) -> Message {
    message(topic, "sensor_msgs/LaserScan", stamp_ns + 3_000_000, |fields| {
        fields.header(stamp_ns, frame);
        fields.f32(rays.angle_min_rad);
        fields.f32(angle_max_rad);
        fields.f32(rays.angle_increment_rad);
        fields.f32(rays.time_increment_s);
        fields.f32(rays.scan_time_s);
        fields.f32(rays.range_min_m);
        fields.f32(rays.range_max_m);
        fields.f32s(ranges_m);
        fields.f32s(&[]);
    })
}

pub fn odometry(topic: &str, stamp_ns: u64, child: &str, [x, y, theta]: [f64; 3]) -> Message {
    message(topic, "nav_msgs/Odometry", stamp_ns + 1_000_000, |fields| {
        fields.header(stamp_ns, "odom");
        fields.text(child);
        fields.pose([x, y, 0.0], [0.0, theta]);
        for _ in 0..36 + 6 + 36 {
            fields.f64(0.0);
        }
    })
}

pub fn pose(topic: &str, stamp_ns: u64, [x, y, theta]: [f64; 3]) -> Message {
    message(topic, "geometry_msgs/PoseStamped", stamp_ns + 1_000_000, |fields| {
        fields.header(stamp_ns, "map");
        fields.pose([x, y, 0.0], [0.0, theta]);
    })
}

/// A `sensor_msgs/Imu` that turns about the vertical.
pub fn imu(topic: &str, stamp_ns: u64, frame: &str, yaw_rate_rad_s: f64) -> Message {
    message(topic, "sensor_msgs/Imu", stamp_ns + 1_000_000, |fields| {
        fields.header(stamp_ns, frame);
        let zeros = [0.0; 9];
        [&[0.0, 0.0, 0.0, 1.0][..], &zeros, &[0.0, 0.0, yaw_rate_rad_s], &zeros, &[0.0, 0.0, 9.81], &zeros]
            .concat()
            .into_iter()
            .for_each(|number| fields.f64(number));
    })
}

/// `parent → child` at a place, with roll and yaw.
pub fn transform(topic: &str, stamp_ns: u64, parent: &str, child: &str, place: [f64; 3], turn: [f64; 2]) -> Message {
    message(topic, "tf2_msgs/TFMessage", stamp_ns + 1_000_000, |fields| {
        fields.u32(1);
        fields.header(stamp_ns, parent);
        fields.text(child);
        fields.pose(place, turn);
    })
}

/// `sensor_msgs/JointState`: names with angles in radians.
pub fn joints(topic: &str, stamp_ns: u64, angles: &[(&str, f64)]) -> Message {
    message(topic, "sensor_msgs/JointState", stamp_ns + 1_000_000, |fields| {
        fields.header(stamp_ns, "");
        fields.u32(angles.len() as u32);
        for (name, _) in angles {
            fields.text(name);
        }
        fields.f64s(&angles.iter().map(|(_, angle_rad)| *angle_rad).collect::<Vec<_>>());
        fields.f64s(&[]);
        fields.f64s(&[]);
    })
}

/// `parent → child` at a place in metres, with a turn as x, y, z, w.
pub fn placed(topic: &str, stamp_ns: u64, parent: &str, child: &str, place: [f64; 3], turn: [f64; 4]) -> Message {
    message(topic, "tf2_msgs/TFMessage", stamp_ns + 1_000_000, |fields| {
        fields.u32(1);
        fields.header(stamp_ns, parent);
        fields.text(child);
        for value in place.into_iter().chain(turn) {
            fields.f64(value);
        }
    })
}

/// `sensor_msgs/Image` with rows that follow each other.
pub fn image(
    topic: &str,
    stamp_ns: u64,
    frame: &str,
    [columns, rows]: [u32; 2],
    encoding: &str,
    data: &[u8],
) -> Message {
    message(topic, "sensor_msgs/Image", stamp_ns + 2_000_000, |fields| {
        fields.header(stamp_ns, frame);
        fields.u32(rows);
        fields.u32(columns);
        fields.text(encoding);
        fields.u8(0);
        fields.u32(data.len() as u32 / rows);
        fields.bytes(data);
    })
}

pub fn compressed_image(topic: &str, stamp_ns: u64, frame: &str, format: &str, data: &[u8]) -> Message {
    message(topic, "sensor_msgs/CompressedImage", stamp_ns + 2_000_000, |fields| {
        fields.header(stamp_ns, frame);
        fields.text(format);
        fields.bytes(data);
    })
}

/// `sensor_msgs/CameraInfo` of a camera with these focal lengths and this principal point, both as it is and rectified.
pub fn camera_info(
    topic: &str,
    stamp_ns: u64,
    frame: &str,
    [columns, rows]: [u32; 2],
    [fx, fy, cx, cy]: [f64; 4],
    distortion: &[f64],
) -> Message {
    message(topic, "sensor_msgs/CameraInfo", stamp_ns + 2_000_000, |fields| {
        fields.header(stamp_ns, frame);
        fields.u32(rows);
        fields.u32(columns);
        fields.text("plumb_bob");
        fields.f64s(distortion);
        for value in [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0] {
            fields.f64(value);
        }
        for value in [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
            fields.f64(value);
        }
        for value in [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0] {
            fields.f64(value);
        }
        // No binning, no region of interest.
        for _ in 0..6 {
            fields.u32(0);
        }
        fields.u8(0);
    })
}

/// Channels in the order of their first message, numbered from 1.
fn channels(messages: &[Message]) -> BTreeMap<(String, &'static str), u16> {
    let mut channels = BTreeMap::new();
    for message in messages {
        let next = channels.len() as u16 + 1;
        channels.entry((message.topic.clone(), message.type_name)).or_insert(next);
    }
    channels
}

fn packed(compression: &str, bytes: &[u8]) -> Vec<u8> {
    match compression {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        }
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        }
        "zstd" => zstd(bytes),
        _ => bytes.to_vec(),
    }
}

pub fn zstd(bytes: &[u8]) -> Vec<u8> {
    ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
}

fn bag_record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        header.extend(name.as_bytes());
        header.push(b'=');
        header.extend(*value);
    }
    [&(header.len() as u32).to_le_bytes(), &header[..], &(data.len() as u32).to_le_bytes(), data].concat()
}

/// A ROS 1 bag with chunks of so many messages. Like a real one it ends with the connections and an index.
pub fn ros1_bag(messages: &[Message], compression: &str, per_chunk: usize) -> Vec<u8> {
    let channels = channels(messages);
    let connection = |(topic, type_name): &(String, &str), id: u16| {
        let data = bag_fields(&[("topic", topic), ("type", type_name), ("md5sum", "*"), ("message_definition", "")]);
        bag_record(&[("op", &[7]), ("conn", &u32::from(id).to_le_bytes()), ("topic", topic.as_bytes())], &data)
    };
    let mut body = Vec::new();
    let mut chunks = 0_u32;
    for (number, chunk) in messages.chunks(per_chunk).enumerate() {
        let mut records = Vec::new();
        if number == 0 {
            channels.iter().for_each(|(key, &id)| records.extend(connection(key, id)));
        }
        for message in chunk {
            let id = u32::from(channels[&(message.topic.clone(), message.type_name)]);
            let mut time = ((message.log_ns / 1_000_000_000) as u32).to_le_bytes().to_vec();
            time.extend(((message.log_ns % 1_000_000_000) as u32).to_le_bytes());
            records.extend(bag_record(&[("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &time)], &message.ros1));
        }
        let size = (records.len() as u32).to_le_bytes();
        let fields = [("compression", compression.as_bytes()), ("op", &[5]), ("size", &size)];
        body.extend(bag_record(&fields, &packed(compression, &records)));
        chunks += 1;
    }
    let head = |index: u64| {
        let fields = [
            ("chunk_count", &chunks.to_le_bytes()[..]),
            ("conn_count", &(channels.len() as u32).to_le_bytes()),
            ("index_pos", &index.to_le_bytes()),
            ("op", &[3]),
        ];
        // The record of a bag's header is padded to 4096 bytes.
        let empty = bag_record(&fields, &[]).len();
        bag_record(&fields, &vec![b' '; 4096 - empty])
    };
    let index = 13 + 4096 + body.len() as u64;
    let connections: Vec<u8> = channels.iter().flat_map(|(key, &id)| connection(key, id)).collect();
    [b"#ROSBAG V2.0\n", &head(index)[..], &body, &connections].concat()
}

fn bag_fields(fields: &[(&str, &str)]) -> Vec<u8> {
    let field = |(name, value): &(&str, &str)| {
        let text = format!("{name}={value}");
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    };
    fields.iter().flat_map(field).collect()
}

/// The name of a type in ROS 2.
fn ros2_name(type_name: &str) -> String {
    type_name.replace('/', "/msg/")
}

/// A database as rosbag2 writes it; `each` packs single messages.
pub fn sqlite(path: &Path, messages: &[Message], each: impl Fn(&[u8]) -> Vec<u8>) {
    let database = Connection::open(path).unwrap();
    database
        .execute_batch(
            "PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF; BEGIN;
             CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
             INSERT INTO schema VALUES (4, 'jazzy');
             CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                 serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
             CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
        )
        .unwrap();
    let channels = channels(messages);
    for ((topic, type_name), id) in &channels {
        let row = params![id, topic, ros2_name(type_name)];
        database.execute("INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr', '', '')", row).unwrap();
    }
    for message in messages {
        let id = channels[&(message.topic.clone(), message.type_name)];
        let row = params![id, message.log_ns as i64, each(&message.cdr)];
        database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)", row).unwrap();
    }
    database.execute_batch("COMMIT").unwrap();
}

fn mcap_record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

fn mcap_text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// An MCAP file with chunks of so many messages in ROS 2's serialisation, or in that of ROS 1.
pub fn mcap(messages: &[Message], compression: &str, per_chunk: usize, is_ros1: bool) -> Vec<u8> {
    const MAGIC: &[u8] = b"\x89MCAP0\r\n";
    let mut file =
        [MAGIC, &mcap_record(1, &[mcap_text(if is_ros1 { "ros1" } else { "ros2" }), mcap_text("test")].concat())]
            .concat();
    let channels = channels(messages);
    for (number, chunk) in messages.chunks(per_chunk).enumerate() {
        let mut records = Vec::new();
        for ((topic, type_name), id) in channels.iter().filter(|_| number == 0) {
            let (name, schema, encoding) = if is_ros1 {
                ((*type_name).to_owned(), "ros1msg", "ros1")
            } else {
                (ros2_name(type_name), "ros2msg", "cdr")
            };
            let schema = [&id.to_le_bytes()[..], &mcap_text(&name), &mcap_text(schema), &mcap_text("")].concat();
            records.extend(mcap_record(3, &schema));
            let ids = [id.to_le_bytes(), id.to_le_bytes()].concat();
            records.extend(mcap_record(4, &[ids, mcap_text(topic), mcap_text(encoding), vec![0; 4]].concat()));
        }
        for message in chunk {
            let id = channels[&(message.topic.clone(), message.type_name)];
            let time = message.log_ns.to_le_bytes();
            let data = if is_ros1 { &message.ros1 } else { &message.cdr };
            records.extend(mcap_record(5, &[&id.to_le_bytes()[..], &[0; 4], &time, &time, data].concat()));
        }
        let packed = packed(compression, &records);
        let [first, last] = [chunk.first(), chunk.last()].map(|message| message.unwrap().log_ns.to_le_bytes());
        let sizes = [&(records.len() as u64).to_le_bytes()[..], &[0; 4]].concat();
        let head = [&first[..], &last, &sizes, &mcap_text(compression), &(packed.len() as u64).to_le_bytes()].concat();
        file.extend(mcap_record(6, &[head, packed].concat()));
    }
    file.extend(mcap_record(15, &[0; 4]));
    file.extend(mcap_record(2, &[0; 20]));
    file.extend(MAGIC);
    file
}
