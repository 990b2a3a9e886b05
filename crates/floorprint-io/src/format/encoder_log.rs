//! Logs of raw wheel encoders with a Hokuyo URG-04LX: a line of numbers per scan (`.dat`, also gzipped).
//!
//! Field 0 is the time in microseconds, fields 2 and 3 are the left and right encoders' running
//! counts, and the last 682 fields are ranges in millimetres. The URG-04LX measures 1024 steps a
//! turn counter-clockwise; ray 340 looks ahead, so that 682 rays cover 240°. Ranges below 20 mm are
//! the device's codes for "no measurement".

use super::Format;
use crate::calibration;
use crate::data_set::{DataSet, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::lines::Lines;
use crate::number::{Tokens, parse_f64};
use crate::source::{FileSource, Source};
use crate::stamps::rising;
use floorprint::SensorId;
use floorprint::sensors::{EncoderReading, Record, Scan, ScanGeometry};
use std::f64::consts::TAU;
use std::sync::Arc;

pub(super) const FORMAT: Format = Format {
    name: "encoder_log",
    description: "an encoder log (lines of time, counts and 682 ranges)",
    scans: "lines with 682 ranges",
    has_topics: false,
    recognises,
    read,
};

/// Rays of a scan.
const RAYS: usize = 682;

/// Fields of a line that come before the ranges at the least.
const FIRST_FIELDS: usize = 4;

/// The ray that looks ahead.
const AHEAD: f64 = 340.0;

/// Angle from ray to ray, radians.
const STEP_RAD: f64 = TAU / 1024.0;

fn recognises(source: &Source) -> bool {
    let Source::File(file) = source else { return false };
    file.head_lines().any(|line| parse_line(line).is_some())
}

fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Source::File(file) = source else {
        return Err(Problem::new(source.path(), "a folder").expected("a log file").into());
    };
    let mut dropped = DropCounts::default();
    let mut readings = Vec::new();
    let mut notes = vec!["no IMU: yaw comes from the wheels".to_owned()];
    let mut budget = file.budget(options);
    let mut lines = Lines::new(file.content());
    loop {
        match lines.next_line() {
            Ok(Some(line)) if line.is_empty() || line.starts_with(b"#") => {}
            Ok(Some(line)) => match parse_line(line) {
                Some(reading) => {
                    let taken = budget.take::<f32>(RAYS).and_then(|()| budget.take::<(Reading, [Record; 2])>(1));
                    taken.ok_or_else(|| budget.exceeded(&file.path))?;
                    readings.push(reading);
                }
                None => dropped.add(DropReason::MalformedLine),
            },
            Ok(None) => break,
            Err(error) => {
                dropped.add(DropReason::MalformedLine);
                notes.insert(0, file.cut_off_note(lines.number(), &error));
                break;
            }
        }
    }
    if readings.is_empty() {
        return Err(Problem::new(&file.path, "no line with time, counts and ranges")
            .expected("lines of numbers that end in 682 ranges")
            .into());
    }
    Ok(data_set(file, readings, dropped, notes))
}

/// What a line holds.
struct Reading {
    stamp_s: f64,
    /// Running counts, left and right.
    counts: [f64; 2],
    ranges_m: Vec<f32>,
}

fn parse_line(line: &[u8]) -> Option<Reading> {
    let fields: Vec<f64> =
        Tokens::new(line).map(|token| parse_f64(token).filter(|value| value.is_finite())).collect::<Option<_>>()?;
    let first_range = fields.len().checked_sub(RAYS).filter(|&first| first >= FIRST_FIELDS)?;
    Some(Reading {
        stamp_s: fields[0] / 1e6,
        counts: [fields[2], fields[3]],
        ranges_m: fields[first_range..].iter().map(|millimetres| (millimetres / 1e3) as f32).collect(),
    })
}

fn data_set(file: &FileSource, readings: Vec<Reading>, mut dropped: DropCounts, notes: Vec<String>) -> DataSet {
    let geometry = Arc::new(ScanGeometry {
        angles_rad: (0..RAYS).map(|ray| (ray as f64 - AHEAD) * STEP_RAD).collect(),
        time_offsets_s: vec![0.0; RAYS],
        range_min_m: 0.02,
        range_max_m: 5.6,
        below_minimum_is_no_return: true,
    });
    let stamps_s: Vec<f64> = readings.iter().map(|reading| reading.stamp_s).collect();
    let keep = rising(&stamps_s, true);
    let counters = [0, 1].map(|side| Counter::new(readings.iter().map(|reading| reading.counts[side])));
    let mut records = Vec::with_capacity(2 * readings.len());
    let mut previous: Option<[f64; 2]> = None;
    for (reading, keep) in readings.into_iter().zip(keep) {
        if !keep {
            dropped.add(DropReason::StampJump);
            continue;
        }
        let Reading { stamp_s, counts, ranges_m } = reading;
        let before = previous.replace(counts).unwrap_or(counts);
        let [left_ticks, right_ticks] = [0, 1].map(|side| counters[side].ticks(before[side], counts[side]));
        records.push(Record::Encoders(EncoderReading { stamp_s, left_ticks, right_ticks }));
        records.push(Record::Scan(Scan {
            sensor: SensorId::default(),
            stamp_s,
            ranges_m,
            geometry: Arc::clone(&geometry),
            odometry: None,
        }));
    }
    DataSet {
        format: FORMAT,
        robot: calibration::encoder_log(),
        records,
        images: None,
        dropped,
        notes,
        input_hash: file.hash(),
        bag: None,
        live: None,
        unpacked: None,
    }
}

/// A running counter that may wrap around.
struct Counter {
    /// How many different counts it has.
    period: f64,
}

impl Counter {
    /// The narrowest usual counter (16 or 32 bits) that holds all `counts`.
    fn new(counts: impl Iterator<Item = f64>) -> Self {
        let (least, most) =
            counts.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), count| (a.min(count), b.max(count)));
        let period = if most - least < 65536.0 { 65536.0 } else { 4_294_967_296.0 };
        Self { period }
    }

    /// Ticks from one count to the next, the shorter way round.
    fn ticks(&self, before: f64, after: f64) -> f64 {
        let ticks = after - before;
        ticks - (ticks / self.period).round() * self.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::Path;

    fn line(stamp_us: i64, left: i64, right: i64) -> String {
        format!("{stamp_us} 7 {left} {right} 0 0 0 170.1  {}\n", "1500 ".repeat(RAYS))
    }

    fn read_bytes(bytes: Vec<u8>) -> Result<DataSet, ReadError> {
        read(&Source::File(FileSource::new(Path::new("drive.dat"), bytes)?), &OpenOptions::default())
    }

    #[test]
    fn bad_lines_are_counted_and_cost_no_ticks() {
        let text = "# a comment\n".to_owned()
            + &line(0, 100, 200)
            + "1 2 3\nnonsense\n"
            + &line(5_000_000_000, 110, 220)
            + &line(100_000, 120, 240)
            + &line(200_000, 130, 260);
        let log = read_bytes(text.into_bytes()).unwrap();
        assert_eq!((log.dropped.count(DropReason::MalformedLine), log.dropped.count(DropReason::StampJump)), (2, 1));
        let Record::Encoders(reading) = log.records[2] else { panic!("{:?}", log.records[2]) };
        assert_eq!((reading.stamp_s, reading.left_ticks, reading.right_ticks), (0.1, 20.0, 40.0));
        let scan = log.scans().next().unwrap();
        assert_eq!((scan.ranges_m[681], scan.geometry.angles_rad[340]), (1.5, 0.0));
    }

    #[test]
    fn a_log_without_a_single_whole_line_is_an_error() {
        assert!(read_bytes(b"1 2 3\n".to_vec()).is_err());
    }

    proptest! {
        #[test]
        fn counters_that_wrap_give_the_same_ticks(
            start in 0..65536_i64, ticks in proptest::collection::vec(-3000..3000_i64, 1..50)
        ) {
            let mut count = start;
            let counts: Vec<f64> = std::iter::once(0)
                .chain(ticks.iter().copied())
                .map(|ticks| {
                    count += ticks;
                    count.rem_euclid(65536) as f64
                })
                .collect();
            let counter = Counter::new(counts.iter().copied());
            for (pair, &expected) in counts.windows(2).zip(&ticks) {
                prop_assert_eq!(counter.ticks(pair[0], pair[1]), expected as f64);
            }
        }

        #[test]
        fn any_bytes_are_a_log_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 1..300), after_a_line in any::<bool>()) {
            let mut text = if after_a_line { line(0, 1, 2).into_bytes() } else { Vec::new() };
            text.extend(bytes);
            prop_assert_eq!(read_bytes(text).is_ok(), after_a_line);
        }
    }
}
