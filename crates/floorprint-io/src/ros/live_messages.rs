//! Messages of our own, by which a live session's recording says exactly what the engine got.
//!
//! Messages of ROS round: angles are 32 bits, stamps whole nanoseconds, headings quaternions. Before each of them lies a
//! `Record` with the numbers as they were, so that running the recording gives the bytes that the live session gave.

use super::cdr_writer::CdrWriter;
use super::messages::Message;
use floorprint::sensors::ScanGeometry;

/// Topic of the records.
pub(crate) const RECORD_TOPIC: &str = "/floorprint/record";
/// Topic of the scans' geometries.
pub(crate) const GEOMETRY_TOPIC: &str = "/floorprint/scan_geometry";
/// Topic of what holds for all of it.
pub(crate) const SESSION_TOPIC: &str = "/floorprint/session";
/// Type of the records, by which such a recording is recognised.
pub(crate) const RECORD_TYPE: &str = ExactRecord::TYPE;

/// What a record is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordKind {
    Scan = 0,
    Encoders = 1,
    Imu = 2,
    Odometry = 3,
}

impl RecordKind {
    /// By its number.
    pub(crate) fn of(number: u8) -> Option<Self> {
        [Self::Scan, Self::Encoders, Self::Imu, Self::Odometry].into_iter().find(|kind| *kind as u8 == number)
    }
}

/// A record's exact numbers; those of a scan but for its ranges, which are in the `LaserScan` that follows.
#[derive(Debug)]
pub(super) struct ExactRecord<'a> {
    pub(super) kind: RecordKind,
    pub(super) sensor: u8,
    pub(super) stamp_s: f64,
    pub(super) geometry: u32,
    pub(super) values: &'a [f64],
}

impl Message for ExactRecord<'_> {
    const TYPE: &'static str = "floorprint_msgs/msg/Record";
    const SCHEMA: &'static str = "# What a record of a sensor says exactly.
uint8 kind          # 0 scan (its ranges are in the LaserScan that follows), 1 encoders, 2 IMU, 3 odometry
uint8 sensor        # which of several LiDARs
float64 stamp       # seconds
uint32 geometry     # of a scan: which ScanGeometry
float64[] values    # scan: the pose that the log states for it (x y theta), or nothing; encoders: ticks left, right;
                    # IMU: angular velocity and acceleration; odometry: x y theta
";

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.u8(self.kind as u8);
        cdr.u8(self.sensor);
        cdr.f64(self.stamp_s);
        cdr.u32(self.geometry);
        cdr.f64_list(self.values);
        cdr.into_bytes()
    }
}

/// A geometry of scans and its number.
#[derive(Debug)]
pub(super) struct ExactGeometry<'a> {
    pub(super) number: u32,
    pub(super) geometry: &'a ScanGeometry,
}

impl Message for ExactGeometry<'_> {
    const TYPE: &'static str = "floorprint_msgs/msg/ScanGeometry";
    const SCHEMA: &'static str = "# What the rays of scans have in common.
uint32 number
float64[] angles          # radians
float32[] time_offsets    # from the scan's stamp, seconds
float32 range_min         # metres
float32 range_max         # metres
bool below_minimum_is_no_return
";

    fn to_cdr(&self) -> Vec<u8> {
        let mut cdr = CdrWriter::new();
        cdr.u32(self.number);
        cdr.f64_list(&self.geometry.angles_rad);
        cdr.f32_list(&self.geometry.time_offsets_s);
        cdr.f32(self.geometry.range_min_m);
        cdr.f32(self.geometry.range_max_m);
        cdr.u8(self.geometry.below_minimum_is_no_return.into());
        cdr.into_bytes()
    }
}
