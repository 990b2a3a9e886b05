//! What the stamps say: clocks that have nothing to do with each other, that were set back or do not count seconds, and messages that came twice.

use super::Symptom;
use crate::sensors::{Record, Stream};
use std::collections::BTreeMap;

/// Stamps of a log may run back by less where messages overtake each other, seconds.
const SET_BACK_S: f64 = 10.0;
/// Sensors start one after the other; a pause of so many seconds between two of them is still one drive.
const APART_S: f64 = 5.0;

/// No LiDAR makes a scan as seldom as this, seconds …
const SELDOM_S: f64 = 20.0;
/// … and none more often, or so seldom, in the unit in which it states its stamps, seconds.
const USUAL_S: [f64; 2] = [0.004, 4.0];
/// Fewer scans than this say nothing of the usual one.
const FEW_SCANS: usize = 10;

pub(super) fn examine(records: &[Record]) -> Vec<Symptom> {
    let mut streams: BTreeMap<Stream, Vec<&Record>> = BTreeMap::new();
    for record in records.iter().filter(|record| record.stamp_s().is_finite()) {
        streams.entry(record.sensor().0).or_default().push(record);
    }
    let mut found = Vec::new();
    for (&sensor, of_sensor) in &streams {
        found.extend(doubled(sensor, of_sensor));
        found.extend(set_back(sensor, of_sensor));
    }
    found.extend(streams.get(&Stream::Scans).and_then(|scans| units(scans)));
    let spans: BTreeMap<Stream, [f64; 2]> = streams.iter().map(|(sensor, records)| (*sensor, span(records))).collect();
    if let Some([first_s, last_s]) = spans.get(&Stream::Scans) {
        for (&sensor, [from_s, to_s]) in spans.iter().filter(|(sensor, _)| **sensor != Stream::Scans) {
            if *from_s > last_s + APART_S || *to_s < first_s - APART_S {
                found.push(Symptom::ClocksApart { sensor, later_s: from_s - first_s });
            }
        }
    }
    found
}

/// From the first to the last stamp but for one in a hundred at either end, which may be wild, seconds.
fn span(records: &[&Record]) -> [f64; 2] {
    let mut stamps: Vec<f64> = records.iter().map(|record| record.stamp_s()).collect();
    stamps.sort_by(f64::total_cmp);
    let margin = stamps.len() / 100;
    [stamps[margin], stamps[stamps.len() - 1 - margin]]
}

fn units(scans: &[&Record]) -> Option<Symptom> {
    let mut steps: Vec<f64> = scans.windows(2).map(|pair| pair[1].stamp_s() - pair[0].stamp_s()).collect();
    steps.sort_by(f64::total_cmp);
    let interval = *steps.get(steps.len() / 2).filter(|step| steps.len() >= FEW_SCANS && **step > SELDOM_S)?;
    let is_usual = |per_second: &f64| (USUAL_S[0]..USUAL_S[1]).contains(&(interval / per_second));
    let per_second = [1e3, 1e6, 1e9].into_iter().find(is_usual)?;
    Some(Symptom::StampUnits { interval, per_second })
}

fn set_back(sensor: Stream, records: &[&Record]) -> Option<Symptom> {
    let steps = records.windows(2).map(|pair| pair[0].stamp_s() - pair[1].stamp_s());
    let back: Vec<f64> = steps.filter(|step_s| *step_s > SET_BACK_S).collect();
    let by_s = back.iter().copied().fold(0.0, f64::max);
    (!back.is_empty()).then_some(Symptom::ClockSetBack { sensor, times: back.len(), by_s })
}

fn doubled(sensor: Stream, records: &[&Record]) -> Option<Symptom> {
    let is_same = |a: &Record, b: &Record| match (a, b) {
        (Record::Scan(a), Record::Scan(b)) => {
            a.sensor == b.sensor && a.ranges_m == b.ranges_m && !a.ranges_m.is_empty()
        }
        (Record::Encoders(a), Record::Encoders(b)) => a == b,
        (Record::Imu(a), Record::Imu(b)) => a == b,
        (Record::Odometry(a), Record::Odometry(b)) => a == b,
        _ => false,
    };
    let pairs = records.windows(2).filter(|pair| pair[0].stamp_s() == pair[1].stamp_s() && is_same(pair[0], pair[1]));
    let messages = pairs.count();
    (messages > 0).then_some(Symptom::Doubled { sensor, messages })
}
