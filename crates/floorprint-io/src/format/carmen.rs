//! CARMEN logs (`.clf`, `.log`, also gzipped): one message a line, in the order in which they are to be processed.
//!
//! `FLASER n r₁…rₙ laser_x laser_y laser_θ odom_x odom_y odom_θ ipc_stamp host logger_stamp`
//! and its successor `ROBOTLASER1` (with the laser's own angles and poses) carry the scans,
//! `RAWLASER1` the same without odometry, `ODOM` the odometry in between, `PARAM` settings.
//! Source: the CARMEN toolkit's logger.

use super::Format;
use crate::calibration;
use crate::data_set::{DataSet, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::lines::Lines;
use crate::number::Tokens;
use crate::source::{FileSource, Source};
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, Scan, ScanGeometry, StampedPose};
use std::f64::consts::PI;
use std::sync::Arc;

pub(super) const FORMAT: Format =
    Format { name: "carmen", description: "a CARMEN log (FLASER, ROBOTLASER1, ODOM … lines)", recognises, read };

/// Messages by which a log is recognised.
const MESSAGES: [&[u8]; 9] =
    [b"FLASER", b"RLASER", b"ROBOTLASER1", b"RAWLASER1", b"ODOM", b"PARAM", b"SYNC", b"TRUEPOS", b"ROBOTLASER2"];

fn recognises(source: &Source) -> bool {
    let Source::File(file) = source else { return false };
    file.head_lines().any(|line| {
        line.starts_with(b"# CARMEN") || Tokens::new(line).next().is_some_and(|name| MESSAGES.contains(&name))
    })
}

fn read(source: &Source, _options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Source::File(file) = source else {
        return Err(Problem::new(source.path(), "a folder").expected("a log file").into());
    };
    let mut log = Log::default();
    let mut lines = Lines::new(file.content());
    loop {
        match lines.next_line() {
            Ok(Some(line)) => log.take(line),
            Ok(None) => break,
            Err(error) => return Err(file.unreadable(lines.number(), &error)),
        }
    }
    log.finish(file)
}

/// What has been read of a log so far.
#[derive(Default)]
struct Log {
    records: Vec<Record>,
    /// Geometries by number of rays; their longest range is known when all is read.
    geometries: Vec<Arc<ScanGeometry>>,
    dropped: DropCounts,
}

impl Log {
    /// Takes one line.
    fn take(&mut self, line: &[u8]) {
        let mut tokens = Tokens::new(line);
        match tokens.next() {
            Some(b"FLASER") => match self.parse_flaser(&mut tokens) {
                Some(scan) if scan.ranges_m.is_empty() => self.dropped.add(DropReason::EmptyScan),
                Some(scan) => self.records.push(Record::Scan(scan)),
                None => self.dropped.add(DropReason::MalformedLine),
            },
            Some(b"ODOM") => match parse_odom(&mut tokens) {
                Some(odometry) => self.records.push(Record::Odometry(odometry)),
                None => self.dropped.add(DropReason::MalformedLine),
            },
            Some(b"RLASER") => self.dropped.add(DropReason::OtherLaser),
            _ => {}
        }
    }

    fn parse_flaser(&mut self, tokens: &mut Tokens) -> Option<Scan> {
        let count = tokens.count()?;
        // The capacity does not trust the stated count: the line may break off.
        let mut ranges_m = Vec::with_capacity(count.min(4096));
        for _ in 0..count {
            ranges_m.push(crate::number::parse_f64(tokens.next()?)? as f32);
        }
        let _laser = tokens.triple()?;
        let [x, y, theta] = tokens.triple()?;
        let stamp_s = tokens.finite()?;
        Some(Scan { stamp_s, geometry: self.geometry(count), ranges_m, odometry: Some(Pose2::new(x, y, theta)) })
    }

    fn geometry(&mut self, count: usize) -> Arc<ScanGeometry> {
        if let Some(geometry) = self.geometries.iter().find(|geometry| geometry.len() == count) {
            return Arc::clone(geometry);
        }
        let step = match count {
            180 | 360 => PI / count as f64,
            _ => PI / (count.max(2) - 1) as f64,
        };
        let geometry = Arc::new(ScanGeometry {
            angles_rad: (0..count).map(|ray| -PI / 2.0 + ray as f64 * step).collect(),
            time_offsets_s: vec![0.0; count],
            range_min_m: 0.01,
            range_max_m: f32::INFINITY,
            below_minimum_is_no_return: false,
        });
        self.geometries.push(Arc::clone(&geometry));
        geometry
    }

    fn finish(mut self, file: &FileSource) -> Result<DataSet, ReadError> {
        let range_max_m = longest_range(&self.records);
        let finished: Vec<Arc<ScanGeometry>> = self
            .geometries
            .iter()
            .map(|geometry| Arc::new(ScanGeometry { range_max_m, ..(**geometry).clone() }))
            .collect();
        for record in &mut self.records {
            if let Record::Scan(scan) = record
                && let Some(geometry) = finished.iter().find(|geometry| geometry.len() == scan.ranges_m.len())
            {
                scan.geometry = Arc::clone(geometry);
            }
        }
        Ok(DataSet {
            format: FORMAT,
            robot: calibration::carmen(),
            records: self.records,
            images: None,
            dropped: self.dropped,
            notes: Vec::new(),
            input_hash: file.hash(),
        })
    }
}

fn parse_odom(tokens: &mut Tokens) -> Option<StampedPose> {
    let [x, y, theta] = tokens.triple()?;
    let _velocities_and_acceleration = tokens.triple()?;
    Some(StampedPose { stamp_s: tokens.finite()?, pose: Pose2::new(x, y, theta) })
}

/// The range that stands for "nothing came back".
fn longest_range(records: &[Record]) -> f32 {
    let ranges = || {
        records.iter().flat_map(|record| match record {
            Record::Scan(scan) => &scan.ranges_m[..],
            _ => &[],
        })
    };
    ranges().copied().filter(|range_m| range_m.is_finite()).fold(0.0, f32::max)
}
