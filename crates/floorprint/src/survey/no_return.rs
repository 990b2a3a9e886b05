//! Finds the range that a scanner writes where nothing came back.
//!
//! Drivers write a range of their own for such rays: 81.83 or 81.91 m for one, 50 m for another.
//! It shows in the data as a value that occurs again and again while hardly any measurement
//! comes near it.

use std::collections::BTreeMap;

/// A range counts as a mark when it occurs this many times as often as any other just below it.
const PROMINENCE: usize = 10;

/// A mark's least share of all readings.
const LEAST_SHARE: f64 = 1e-4;

/// No scanner gives up before this range, metres: a nearer one is a wall before a robot at rest.
const NEAREST_MARK_M: f32 = 3.0;

/// Readings from this share of a mark upwards are compared with it.
const NEIGHBOURHOOD: f32 = 0.8;

/// Marks lie together within this share of the longest: scanners have several, for "too far", "dazzled" and so on.
const FAMILY: f32 = 0.99;

/// A second mark occurs at least at this share of the first one's occurrences.
const LEAST_SECOND_SHARE: f64 = 0.05;

/// The least of the ranges that stand for "nothing came back"; none when no range stands out.
///
/// `ranges_m` gives all readings, metres, each time it is called.
#[must_use]
pub fn no_return_mark_m<I: Iterator<Item = f32>>(ranges_m: impl Fn() -> I) -> Option<f32> {
    let least = ((ranges_m().count() as f64 * LEAST_SHARE) as usize).max(PROMINENCE);
    // A few garbled readings must not hide the rest: begin where enough readings lie in the octave below.
    let longest_up_to = |limit_m: f32| ranges_m().filter(|&range_m| range_m <= limit_m).fold(0.0, f32::max);
    let mut longest_m = longest_up_to(f32::MAX);
    while longest_m > 0.0 && ranges_m().filter(|&range_m| range_m > 0.5 * longest_m).count() < least {
        longest_m = longest_up_to(0.5 * longest_m);
    }
    // How often each range in that octave and beyond occurs; positive floats sort like their bits.
    let mut occurrences: BTreeMap<u32, usize> = BTreeMap::new();
    for range_m in ranges_m().filter(|&range_m| range_m > 0.5 * longest_m && range_m.is_finite()) {
        *occurrences.entry(range_m.to_bits()).or_default() += 1;
    }
    let from = |range_m: f32| range_m.to_bits();
    let stands_out = |mark: u32, count: usize| {
        let range_m = f32::from_bits(mark);
        let below = occurrences.range(from(range_m * NEIGHBOURHOOD)..from(range_m * FAMILY));
        let busiest = below.map(|(_, &count)| count).max().unwrap_or(0);
        range_m >= NEAREST_MARK_M && count >= least && count >= PROMINENCE * busiest
    };
    let mut beyond = 0;
    let (&mark, &count) = occurrences.iter().rev().find(|&(&mark, &count)| {
        // What outnumbers all beyond it at least doubles their number: few do, and only these are looked at.
        let outnumbers = count >= beyond;
        beyond += count;
        outnumbers && stands_out(mark, count)
    })?;
    let family = occurrences.range(from(f32::from_bits(mark) * FAMILY)..=mark);
    let members = family.filter(|&(_, &other)| other as f64 >= LEAST_SECOND_SHARE * count as f64);
    members.map(|(&member, _)| f32::from_bits(member)).next()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mark(ranges_m: &[f32]) -> Option<f32> {
        no_return_mark_m(|| ranges_m.iter().copied())
    }

    /// Walls up to `reach_m`, in centimetres, without two readings in the same place.
    fn walls(reach_m: f32) -> Vec<f32> {
        (50..(reach_m * 100.0) as u32).map(|centimetre| centimetre as f32 / 100.0).collect()
    }

    #[test]
    fn a_range_that_stands_apart_means_nothing_came_back() {
        let mut ranges_m = walls(26.0);
        ranges_m.extend([81.83; 300]);
        assert_eq!(mark(&ranges_m), Some(81.83));
        // Other codes of the same scanner, and a single garbled reading beyond.
        ranges_m.extend([81.91; 200]);
        ranges_m.push(655.35);
        assert_eq!(mark(&ranges_m), Some(81.83));
    }

    #[test]
    fn measurements_near_the_mark_stay_measurements() {
        let mut ranges_m = walls(50.0);
        ranges_m.extend([50.0; 3000]);
        ranges_m.extend([49.76; 98]);
        assert_eq!(mark(&ranges_m), Some(50.0));
    }

    #[test]
    fn a_far_wall_is_no_mark() {
        let mut ranges_m = walls(7.0);
        ranges_m.extend((0..900).map(|reading| 7.0 + (reading % 30) as f32 / 100.0));
        assert_eq!(mark(&ranges_m), None);
        assert_eq!(mark(&[1.25; 1000]), None);
        assert_eq!(mark(&[]), None);
        assert_eq!(mark(&[f32::NAN, f32::INFINITY, -1.0, 0.0]), None);
    }

    proptest! {
        #[test]
        fn readings_of_any_kind_are_survived(bits in proptest::collection::vec(any::<u32>(), 0..200)) {
            let ranges_m: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            if let Some(mark_m) = mark(&ranges_m) {
                prop_assert!(ranges_m.contains(&mark_m));
            }
        }
    }
}
