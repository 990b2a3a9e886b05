//! Messages of ROS 2 as Floorprint sends and records them: one encoder for files, DDS and viewers.
//!
//! Sources: the packages `common_interfaces`, `geometry2` and `rcl_interfaces` of ROS 2.

use super::cdr_writer::CdrWriter;
use super::schemas;
use floorprint::geometry::Pose2;

/// A message that can be sent.
pub trait Message {
    /// The name of its type: `package/msg/Type`.
    const TYPE: &'static str;
    /// Its definition with those of all types in it, in the form that MCAP calls `ros2msg`.
    const SCHEMA: &'static str;

    /// Its bytes in CDR, the header included.
    fn to_cdr(&self) -> Vec<u8>;
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq)]
pub struct Header<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which the numbers are.
    pub frame: &'a str,
}

/// Seconds and nanoseconds of a stamp in seconds, to the nanosecond.
#[must_use]
pub fn seconds_and_nanoseconds(stamp_s: f64) -> (i32, u32) {
    let seconds = stamp_s.floor();
    let nanoseconds = ((stamp_s - seconds) * 1e9).round();
    // Rounding up may complete the second; what is no number is 0.
    if nanoseconds >= 1e9 { (seconds as i32 + 1, 0) } else { (seconds as i32, nanoseconds as u32) }
}

/// A stamp in seconds as nanoseconds, as files and viewers have times; 0 of what lies before 1970.
#[must_use]
pub fn nanoseconds(stamp_s: f64) -> u64 {
    let (seconds, nanoseconds) = seconds_and_nanoseconds(stamp_s);
    u64::try_from(i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds)).unwrap_or(0)
}

impl CdrWriter {
    fn header(&mut self, header: &Header<'_>) {
        let (seconds, nanoseconds) = seconds_and_nanoseconds(header.stamp_s);
        self.i32(seconds);
        self.u32(nanoseconds);
        self.text(header.frame);
    }

    /// A position in metres and a quaternion x, y, z, w.
    fn pose(&mut self, pose: &SpacePose) {
        self.f64s(&pose.position_m);
        self.f64s(&pose.quaternion);
    }
}

/// A pose in space as messages state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacePose {
    /// Metres.
    pub position_m: [f64; 3],
    /// x, y, z, w.
    pub quaternion: [f64; 4],
}

impl From<&Pose2> for SpacePose {
    fn from(pose: &Pose2) -> Self {
        let (sin, cos) = (0.5 * pose.theta).sin_cos();
        Self { position_m: [pose.x, pose.y, 0.0], quaternion: [0.0, 0.0, sin, cos] }
    }
}

impl From<&floorprint::geometry::Mount> for SpacePose {
    fn from(mount: &floorprint::geometry::Mount) -> Self {
        let [(sr, cr), (sp, cp), (sy, cy)] =
            [mount.roll_rad, mount.pitch_rad, mount.yaw_rad].map(|angle_rad| (0.5 * angle_rad).sin_cos());
        Self {
            position_m: [mount.x_m, mount.y_m, mount.z_m],
            quaternion: [
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
                cr * cp * cy + sr * sp * sy,
            ],
        }
    }
}

/// Puts a covariance over (x, y, θ) where ROS has it: 6×6 over position and rotation.
fn covariance_6x6(covariance: &[[f64; 3]; 3]) -> [f64; 36] {
    const AXES: [usize; 3] = [0, 1, 5];
    let mut all = [0.0; 36];
    for (row, values) in covariance.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            all[6 * AXES[row] + AXES[column]] = *value;
        }
    }
    all
}

/// `sensor_msgs/LaserScan`.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan<'a> {
    /// Stamp of the first ray, and the LiDAR's frame.
    pub header: Header<'a>,
    /// Angles of the first and the last ray, radians.
    pub angles_rad: [f32; 2],
    /// From ray to ray, radians.
    pub angle_increment_rad: f32,
    /// From ray to ray, seconds.
    pub time_increment_s: f32,
    /// From scan to scan, seconds; 0 when it is not known.
    pub scan_time_s: f32,
    /// Shortest and longest range, metres.
    pub range_m: [f32; 2],
    /// A range for each ray, metres.
    pub ranges_m: &'a [f32],
}

impl Message for LaserScan<'_> {
    const TYPE: &'static str = "sensor_msgs/msg/LaserScan";
    const SCHEMA: &'static str = schemas::LASER_SCAN;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        let [first, last] = self.angles_rad;
        let [shortest, longest] = self.range_m;
        for value in [first, last, self.angle_increment_rad, self.time_increment_s, self.scan_time_s, shortest, longest]
        {
            cdr.f32(value);
        }
        cdr.f32_list(self.ranges_m);
        cdr.f32_list(&[]);
        cdr.into_bytes()
    }
}

/// `sensor_msgs/Imu` without an orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Imu<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// rad/s.
    pub angular_velocity_rad_s: [f64; 3],
    /// m/s².
    pub linear_acceleration_m_s2: [f64; 3],
}

impl Message for Imu<'_> {
    const TYPE: &'static str = "sensor_msgs/msg/Imu";
    const SCHEMA: &'static str = schemas::IMU;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.f64s(&[0.0, 0.0, 0.0, 1.0]);
        // A first entry of −1 says that there is no orientation.
        let mut no_orientation = [0.0; 9];
        no_orientation[0] = -1.0;
        cdr.f64s(&no_orientation);
        cdr.f64s(&self.angular_velocity_rad_s);
        cdr.f64s(&[0.0; 9]);
        cdr.f64s(&self.linear_acceleration_m_s2);
        cdr.f64s(&[0.0; 9]);
        cdr.into_bytes()
    }
}

/// `nav_msgs/Odometry` without velocities.
#[derive(Debug, Clone, PartialEq)]
pub struct Odometry<'a> {
    /// Stamp and the frame in which the pose is.
    pub header: Header<'a>,
    /// The frame whose pose it is.
    pub child: &'a str,
    /// The pose.
    pub pose: Pose2,
}

impl Message for Odometry<'_> {
    const TYPE: &'static str = "nav_msgs/msg/Odometry";
    const SCHEMA: &'static str = schemas::ODOMETRY;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.text(self.child);
        cdr.pose(&(&self.pose).into());
        cdr.f64s(&[0.0; 36]);
        cdr.f64s(&[0.0; 6]);
        cdr.f64s(&[0.0; 36]);
        cdr.into_bytes()
    }
}

/// `tf2_msgs/TFMessage` of any number of transforms.
#[derive(Debug, Clone, PartialEq)]
pub struct Transforms<'a>(pub Vec<Transform<'a>>);

/// A frame's pose in its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Transform<'a> {
    /// Stamp and parent.
    pub header: Header<'a>,
    /// The frame whose pose it is.
    pub child: &'a str,
    /// `parent_from_child`.
    pub pose: SpacePose,
}

impl Message for Transforms<'_> {
    const TYPE: &'static str = "tf2_msgs/msg/TFMessage";
    const SCHEMA: &'static str = schemas::TF_MESSAGE;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.count(self.0.len());
        for transform in &self.0 {
            cdr.header(&transform.header);
            cdr.text(transform.child);
            cdr.pose(&transform.pose);
        }
        cdr.into_bytes()
    }
}

/// `geometry_msgs/PoseWithCovarianceStamped`.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseWithCovariance<'a> {
    /// Stamp and the frame in which the pose is.
    pub header: Header<'a>,
    /// The pose.
    pub pose: Pose2,
    /// Over (x, y, θ), m² and rad².
    pub covariance: [[f64; 3]; 3],
}

impl Message for PoseWithCovariance<'_> {
    const TYPE: &'static str = "geometry_msgs/msg/PoseWithCovarianceStamped";
    const SCHEMA: &'static str = schemas::POSE_WITH_COVARIANCE;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.pose(&(&self.pose).into());
        cdr.f64s(&covariance_6x6(&self.covariance));
        cdr.into_bytes()
    }
}

/// `nav2_msgs/ParticleCloud`: poses with their weights.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticleCloud<'a> {
    /// Stamp and the frame in which the poses are.
    pub header: Header<'a>,
    /// Poses and weights.
    pub particles: &'a [(Pose2, f64)],
}

impl Message for ParticleCloud<'_> {
    const TYPE: &'static str = "nav2_msgs/msg/ParticleCloud";
    const SCHEMA: &'static str = schemas::PARTICLE_CLOUD;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.count(self.particles.len());
        for (pose, weight) in self.particles {
            cdr.pose(&pose.into());
            cdr.f64(*weight);
        }
        cdr.into_bytes()
    }
}

/// `nav_msgs/OccupancyGrid`.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid<'a> {
    /// Stamp and the map's frame.
    pub header: Header<'a>,
    /// Where it lies.
    pub info: MapMetaData,
    /// Row by row from the least y: −1 unknown, 0 free, 100 occupied; as bytes.
    pub cells: &'a [u8],
}

/// `nav_msgs/MapMetaData`: where an [`OccupancyGrid`] lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapMetaData {
    /// Side of a cell, metres.
    pub resolution_m: f32,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Lower left corner of the first cell, metres.
    pub origin_m: [f64; 2],
}

impl MapMetaData {
    fn write(&self, cdr: &mut CdrWriter) {
        // The time at which the map was loaded.
        cdr.i32(0);
        cdr.u32(0);
        cdr.f32(self.resolution_m);
        cdr.u32(self.size[0]);
        cdr.u32(self.size[1]);
        cdr.pose(&(&Pose2::new(self.origin_m[0], self.origin_m[1], 0.0)).into());
    }
}

impl Message for MapMetaData {
    const TYPE: &'static str = "nav_msgs/msg/MapMetaData";
    const SCHEMA: &'static str = schemas::MAP_META_DATA;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        self.write(&mut cdr);
        cdr.into_bytes()
    }
}

impl Message for OccupancyGrid<'_> {
    const TYPE: &'static str = "nav_msgs/msg/OccupancyGrid";
    const SCHEMA: &'static str = schemas::OCCUPANCY_GRID;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        self.info.write(&mut cdr);
        cdr.byte_list(self.cells);
        cdr.into_bytes()
    }
}

/// `map_msgs/OccupancyGridUpdate`: a patch of the last `OccupancyGrid`.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGridUpdate<'a> {
    /// Stamp and the map's frame.
    pub header: Header<'a>,
    /// Column and row of its first cell in the grid.
    pub corner: [i32; 2],
    /// Columns and rows.
    pub size: [u32; 2],
    /// As in [`OccupancyGrid`].
    pub cells: &'a [u8],
}

impl Message for OccupancyGridUpdate<'_> {
    const TYPE: &'static str = "map_msgs/msg/OccupancyGridUpdate";
    const SCHEMA: &'static str = schemas::OCCUPANCY_GRID_UPDATE;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.i32(self.corner[0]);
        cdr.i32(self.corner[1]);
        cdr.u32(self.size[0]);
        cdr.u32(self.size[1]);
        cdr.byte_list(self.cells);
        cdr.into_bytes()
    }
}

/// `diagnostic_msgs/DiagnosticArray` of one status.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnostics<'a> {
    /// Stamp; the frame is empty.
    pub header: Header<'a>,
    /// 0 fine, 1 warning, 2 error.
    pub level: u8,
    /// What it is about.
    pub name: &'a str,
    /// What there is to say.
    pub message: &'a str,
    /// Names and values.
    pub values: &'a [(&'a str, String)],
}

impl Message for Diagnostics<'_> {
    const TYPE: &'static str = "diagnostic_msgs/msg/DiagnosticArray";
    const SCHEMA: &'static str = schemas::DIAGNOSTICS;

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.header(&self.header);
        cdr.count(1);
        cdr.u8(self.level);
        cdr.text(self.name);
        cdr.text(self.message);
        cdr.text("floorprint");
        cdr.count(self.values.len());
        for (key, value) in self.values {
            cdr.text(key);
            cdr.text(value);
        }
        cdr.into_bytes()
    }
}

/// `std_msgs/String`.
#[derive(Debug, Clone, PartialEq)]
pub struct Text<'a>(pub &'a str);

impl Message for Text<'_> {
    const TYPE: &'static str = "std_msgs/msg/String";
    const SCHEMA: &'static str = "string data\n";

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.text(self.0);
        cdr.into_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_keep_their_nanoseconds() {
        assert_eq!(seconds_and_nanoseconds(1.5), (1, 500_000_000));
        assert_eq!(seconds_and_nanoseconds(-0.25), (-1, 750_000_000));
        assert_eq!(seconds_and_nanoseconds(2.999_999_999_9), (3, 0));
        assert_eq!(seconds_and_nanoseconds(f64::NAN), (0, 0));
        let stamp_s = 1_700_000_000.123_456_7_f64;
        let (seconds, nanoseconds) = seconds_and_nanoseconds(stamp_s);
        assert_eq!(f64::from(seconds) + f64::from(nanoseconds) * 1e-9, stamp_s);
    }

    #[test]
    fn fields_lie_where_their_alignment_puts_them() {
        let update = OccupancyGridUpdate {
            header: Header { stamp_s: 1.0, frame: "map" },
            corner: [1, 2],
            size: [2, 1],
            cells: &[0, 255],
        };
        let expected: Vec<u8> = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0],
            b"map\0",
            &[1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0],
            &[2, 0, 0, 0, 0, 255],
        ]
        .concat();
        assert_eq!(update.to_cdr(), expected);
    }

    #[test]
    fn quaternions_of_mounts_are_their_rotations() {
        use floorprint::geometry::{Mount, Pose3};
        let mount = Mount { x_m: 0.1, y_m: 0.2, z_m: 0.3, roll_rad: 3.0, pitch_rad: 0.4, yaw_rad: -1.0 };
        let SpacePose { position_m, quaternion } = (&mount).into();
        let difference = Pose3::from_quaternion(position_m, quaternion).rotation - mount.body_from_sensor().rotation;
        assert!(difference.norm() < 1e-12);
    }
}
