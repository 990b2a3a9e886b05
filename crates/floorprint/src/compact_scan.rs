//! A scan's points in two bytes or so each, for everything that outlives a step.
//!
//! Coordinates are whole multiples of 2⁻¹⁰ m (0.98 mm, far below the noise of any scanner). Neighbouring rays mostly
//! end near each other, so that each point is stored as its difference from the one before, zigzag coded and in groups of
//! seven bits (the varints of Protocol Buffers).

use crate::frame::{BodyScan, Points};
use crate::storage::{Part, Shelf};
use std::ops::Range;
use std::sync::Arc;

/// Units of a coordinate per metre.
const UNITS_PER_M: f32 = 1024.0;
/// Points farther out than this are none that a scanner measures, metres.
const FARTHEST_M: f32 = 8192.0;

/// A packed [`BodyScan`]. Copies share the bytes.
#[derive(Debug, Clone, Default)]
pub struct CompactScan {
    part: Part,
    /// Which bytes of the part are this scan's.
    range: Range<u32>,
}

impl CompactScan {
    /// Packs a scan. Unpacked it is the scan with coordinates rounded to the unit.
    #[must_use]
    pub fn new(scan: &BodyScan) -> Self {
        let mut bytes = Vec::with_capacity(2 * (scan.hits.len() + scan.free_ends.len()) + 16);
        let [x, y] = scan.origin_m.map(|coordinate| units(coordinate as f32));
        push_number(&mut bytes, i64::from(x));
        push_number(&mut bytes, i64::from(y));
        for points in [&scan.hits, &scan.free_ends] {
            push_number(&mut bytes, points.len() as i64);
            let mut before = [0_i32; 2];
            for point in points.iter() {
                let here = point.map(units);
                push_number(&mut bytes, i64::from(here[0]) - i64::from(before[0]));
                push_number(&mut bytes, i64::from(here[1]) - i64::from(before[1]));
                before = here;
            }
        }
        push_number(&mut bytes, i64::from(units(scan.range_noise_m)));
        Self::of_part(bytes)
    }

    fn of_part(bytes: impl Into<Arc<[u8]>>) -> Self {
        let part = Part::new(bytes);
        let range = 0..part.len() as u32;
        Self { part, range }
    }

    /// Scans that are used together, as one part: lays it on a shelf, where there is one.
    pub(crate) fn join<'a>(scans: impl Iterator<Item = &'a mut Self>, shelf: Option<&Arc<Shelf>>) {
        let mut bytes = Vec::new();
        let mut joined: Vec<(&mut Self, Range<u32>)> = Vec::new();
        for scan in scans {
            let start = bytes.len() as u32;
            scan.with_bytes(|of_scan| bytes.extend_from_slice(of_scan));
            joined.push((scan, start..bytes.len() as u32));
        }
        let part = Part::new(bytes);
        joined.into_iter().for_each(|(scan, range)| *scan = Self { part: part.clone(), range });
        if let Some(shelf) = shelf {
            part.lay_on(shelf);
        }
    }

    /// Bytes that came from [`bytes`](Self::bytes); `None` if they are not the packed points of a scan.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        unpack(bytes)?;
        Some(Self::of_part(bytes))
    }

    /// The packed bytes.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        self.with_bytes(<[u8]>::to_vec)
    }

    /// How many bytes these are.
    #[must_use]
    pub fn packed_len(&self) -> usize {
        self.range.len()
    }

    /// Those of them that are in memory.
    pub(crate) fn held_bytes(&self) -> usize {
        if self.part.held_bytes() > 0 { self.range.len() } else { 0 }
    }

    /// The part of which it is a piece.
    pub(crate) fn part(&self) -> &Part {
        &self.part
    }

    fn with_bytes<T>(&self, take: impl FnOnce(&[u8]) -> T) -> T {
        let bytes = self.part.bytes();
        take(bytes.get(self.range.start as usize..self.range.end as usize).unwrap_or_default())
    }

    /// The points, in the body's frame, metres.
    #[must_use]
    pub fn unpack(&self) -> BodyScan {
        // The bytes were checked where they came from.
        self.with_bytes(unpack).unwrap_or_default()
    }
}

impl PartialEq for CompactScan {
    fn eq(&self, other: &Self) -> bool {
        self.with_bytes(|own| other.with_bytes(|others| own == others))
    }
}

impl Eq for CompactScan {}

/// The nearest whole number of units. Without SSE 4.1, which x86-64 does not promise, `f32::round` is a function call.
#[inline]
fn units(coordinate_m: f32) -> i32 {
    let units = f64::from(coordinate_m.clamp(-FARTHEST_M, FARTHEST_M) * UNITS_PER_M);
    (units + 0.5_f64.copysign(units)) as i32
}

fn push_number(bytes: &mut Vec<u8>, number: i64) {
    let mut rest = ((number << 1) ^ (number >> 63)) as u64;
    while rest >= 0x80 {
        bytes.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    bytes.push(rest as u8);
}

#[inline]
fn take_number(bytes: &mut &[u8]) -> Option<i64> {
    // Mostly it is short.
    if let [low, high, rest @ ..] = bytes
        && *high < 0x80
        && *low >= 0x80
    {
        let number = u32::from(low & 0x7f) | u32::from(*high) << 7;
        *bytes = rest;
        return Some(i64::from((number >> 1) as i32 ^ -((number & 1) as i32)));
    }
    let mut number = 0_u64;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some((number >> 1) as i64 ^ -((number & 1) as i64));
        }
    }
    None
}

fn unpack(bytes: &[u8]) -> Option<BodyScan> {
    let mut bytes = bytes;
    let metres = |units: i64| i32::try_from(units).ok().map(|units| units as f32 / UNITS_PER_M);
    let mut scan = BodyScan::default();
    for coordinate in &mut scan.origin_m {
        *coordinate = f64::from(metres(take_number(&mut bytes)?)?);
    }
    for points in [&mut scan.hits, &mut scan.free_ends] {
        let count = usize::try_from(take_number(&mut bytes)?).ok()?;
        // Each point takes two bytes at least: no count claims more memory than the bytes are worth.
        if count > bytes.len() / 2 {
            return None;
        }
        *points = Points { x_m: Vec::with_capacity(count), y_m: Vec::with_capacity(count) };
        let mut here = [0_i64; 2];
        for _ in 0..count {
            for coordinate in &mut here {
                *coordinate = coordinate.checked_add(take_number(&mut bytes)?)?;
            }
            points.push(metres(here[0])?, metres(here[1])?);
        }
    }
    // Scans that were packed before noise was told end here.
    if !bytes.is_empty() {
        scan.range_noise_m = metres(take_number(&mut bytes)?)?.max(0.0);
    }
    bytes.is_empty().then_some(scan)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(of: &[(f32, f32)]) -> Points {
        let mut points = Points::default();
        of.iter().for_each(|&(x, y)| points.push(x, y));
        points
    }

    proptest! {
        #[test]
        fn points_come_back_within_half_a_unit_and_a_second_time_exactly(
            hits in prop::collection::vec((-90.0..90.0_f32, -90.0..90.0_f32), 0..50),
            free in prop::collection::vec((-90.0..90.0_f32, -90.0..90.0_f32), 0..20),
            origin in (-1.0..1.0_f64, -1.0..1.0_f64),
            noise in 0.0..0.5_f32,
        ) {
            let scan = BodyScan { origin_m: [origin.0, origin.1], hits: points(&hits), free_ends: points(&free), range_noise_m: noise, ..BodyScan::default() };
            let once = CompactScan::new(&scan).unpack();
            for (a, b) in scan.hits.iter().chain(scan.free_ends.iter()).zip(once.hits.iter().chain(once.free_ends.iter())) {
                prop_assert!((a[0] - b[0]).abs() <= 0.51 / UNITS_PER_M && (a[1] - b[1]).abs() <= 0.51 / UNITS_PER_M);
            }
            prop_assert_eq!(once.hits.len() + once.free_ends.len(), hits.len() + free.len());
            prop_assert!((once.range_noise_m - noise).abs() <= 0.51 / UNITS_PER_M);
            let twice = CompactScan::new(&once);
            prop_assert_eq!(twice.unpack().hits, once.hits.clone());
            prop_assert_eq!(CompactScan::from_bytes(&twice.bytes()), Some(twice));
        }

        #[test]
        fn units_are_rounded_and_numbers_come_back(value in -9000.0..9000.0_f32, number in any::<i32>(), small in -9000..9000_i64) {
            prop_assert_eq!(units(value), (value.clamp(-FARTHEST_M, FARTHEST_M) * UNITS_PER_M).round() as i32);
            for number in [i64::from(number), small] {
                let mut bytes = Vec::new();
                push_number(&mut bytes, number);
                let mut rest = &bytes[..];
                prop_assert_eq!(take_number(&mut rest), Some(number));
                prop_assert!(rest.is_empty());
            }
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            if let Some(scan) = CompactScan::from_bytes(&bytes) {
                prop_assert!(scan.unpack().hits.len() <= bytes.len() / 2);
            }
        }
    }

    /// A room seen by 361 beams, with a centimetre of noise, takes less than a kilobyte.
    #[test]
    fn a_scan_of_a_room_is_small() {
        let mut hits = Points::default();
        for beam in 0..361 {
            let angle = (beam as f32 - 180.0).to_radians() * 0.5;
            let range = (4.0 / angle.cos().abs().max(0.01)).min(3.0 / angle.sin().abs().max(0.01));
            let range = range + 0.01 * ((beam * 7919 % 13) as f32 / 6.0 - 1.0);
            hits.push(range * angle.cos(), range * angle.sin());
        }
        let packed = CompactScan::new(&BodyScan { hits, ..BodyScan::default() });
        assert!(packed.bytes().len() <= 1000, "{} bytes", packed.bytes().len());
    }
}
