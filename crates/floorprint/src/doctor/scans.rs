//! What the numbers of the scans say by themselves.

use super::Symptom;
use crate::sensors::{Ray, Record, Scan};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// No planar LiDAR has its middle range beyond this, metres.
const FARTHEST_MEDIAN_M: f64 = 200.0;
/// Half of the ranges of a building lie within these, metres.
const ROOMS_M: std::ops::Range<f64> = 0.5..60.0;
/// Ranges of one scan in so many, and one ray in so many, are looked at for their middle one.
const SCAN_STEP: usize = 5;
const RAY_STEP: usize = 7;
/// A full turn may overlap by about a ray, radians.
const OVERLAP_RAD: f64 = 0.12;
/// Below this share of rays that hit something the LiDAR sees nearly nothing.
const FEW_RETURNS: f64 = 0.03;
/// Robots that stand still in silence repeat scans; a LiDAR with any noise does not.
const FROZEN_SHARE: f64 = 0.2;
/// Fewer rays than this repeat themselves by chance.
const LEAST_RAYS: usize = 20;

pub(super) fn examine(records: &[Record]) -> Vec<Symptom> {
    let scans: Vec<&Scan> = records
        .iter()
        .filter_map(|record| match record {
            Record::Scan(scan) => Some(scan),
            _ => None,
        })
        .collect();
    let found = [units(&scans), span(&scans), returns(&scans), ray_counts(&scans), frozen(&scans)];
    let mut found: Vec<Symptom> = found.into_iter().flatten().collect();
    // Where the numbers are in other units, that little comes back is no news.
    if found.iter().any(|symptom| matches!(symptom, Symptom::RangeUnits { .. })) {
        found.retain(|symptom| !matches!(symptom, Symptom::FewReturns { .. }));
    }
    found
}

fn units(scans: &[&Scan]) -> Option<Symptom> {
    let rays = scans.iter().step_by(SCAN_STEP).flat_map(|scan| scan.ranges_m.iter().step_by(RAY_STEP));
    let mut ranges: Vec<f64> =
        rays.map(|&range| f64::from(range)).filter(|range| range.is_finite() && *range > 0.0).collect();
    let middle = ranges.len() / 2;
    if ranges.is_empty() {
        return None;
    }
    // Marks for rays without a return, as 81.91 or 65.533, say nothing of units: what lies at the largest value is left out.
    let largest = ranges.iter().copied().fold(0.0, f64::max);
    let without_marks: Vec<f64> = ranges.iter().copied().filter(|range| *range < 0.999 * largest).collect();
    if without_marks.len() > middle / 4 {
        ranges = without_marks;
    }
    let middle = ranges.len() / 2;
    let (_, &mut median, _) = ranges.select_nth_unstable_by(middle, f64::total_cmp);
    let per_metre = [1000.0, 100.0].into_iter().find(|factor| ROOMS_M.contains(&(median / factor)));
    (median > FARTHEST_MEDIAN_M).then_some(Symptom::RangeUnits { median, per_metre: per_metre.unwrap_or(0.0) })
}

fn span(scans: &[&Scan]) -> Option<Symptom> {
    let angles = &scans.iter().find(|scan| scan.geometry.len() > 1)?.geometry.angles_rad;
    let span = (angles.last()? - angles.first()?).abs();
    if span > 2.0 * TAU {
        Some(Symptom::AngleUnits { span })
    } else if span > TAU + OVERLAP_RAD {
        Some(Symptom::MoreThanATurn { span_deg: span * 180.0 / PI })
    } else {
        None
    }
}

fn returns(scans: &[&Scan]) -> Option<Symptom> {
    let (mut hits, mut rays) = (0_usize, 0_usize);
    for scan in scans {
        rays += scan.ranges_m.len();
        hits += scan.ranges_m.iter().filter(|range| matches!(scan.geometry.classify(**range), Ray::Hit(_))).count();
    }
    let share = hits as f64 / rays.max(1) as f64;
    (rays > 0 && share < FEW_RETURNS).then_some(Symptom::FewReturns { share })
}

fn ray_counts(scans: &[&Scan]) -> Option<Symptom> {
    let mut counts = BTreeMap::new();
    for scan in scans {
        *counts.entry((scan.sensor, scan.ranges_m.len())).or_insert(0_usize) += 1;
    }
    let sensors: std::collections::BTreeSet<_> = counts.keys().map(|(sensor, _)| *sensor).collect();
    let usual = |sensor| {
        let of_sensor = counts.iter().filter(|((of, _), _)| *of == sensor);
        of_sensor.max_by_key(|(_, count)| **count).map(|((_, rays), count)| (*rays, *count))
    };
    let differing: Vec<(usize, usize)> = sensors
        .into_iter()
        .filter_map(|sensor| {
            let (rays, count) = usual(sensor)?;
            let all: usize = counts.iter().filter(|((of, _), _)| *of == sensor).map(|(_, count)| count).sum();
            (count < all).then_some((rays, all - count))
        })
        .collect();
    let &(rays, _) = differing.first()?;
    Some(Symptom::RayCounts { scans: differing.iter().map(|(_, count)| count).sum(), of: scans.len(), usual: rays })
}

fn frozen(scans: &[&Scan]) -> Option<Symptom> {
    let is_repeated = |pair: &&[&Scan]| {
        let [before, after] = [pair[0], pair[1]];
        let hits =
            after.ranges_m.iter().filter(|range| matches!(after.geometry.classify(**range), Ray::Hit(_))).count();
        hits >= LEAST_RAYS && after.stamp_s != before.stamp_s && before.ranges_m == after.ranges_m
    };
    let repeated = scans.windows(2).filter(is_repeated).count();
    (repeated as f64 > FROZEN_SHARE * scans.len() as f64)
        .then_some(Symptom::FrozenScans { scans: repeated, of: scans.len() })
}
