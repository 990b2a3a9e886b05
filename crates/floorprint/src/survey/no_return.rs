//! Finds the range that a scanner writes where nothing came back.
//!
//! Drivers write a range of their own for such rays: 81.83 or 81.91 m for one, 50 m for another.
//! It shows in the data as a value that occurs again and again while hardly any measurement
//! comes near it.

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
    let far = ranges_m().filter(|&range_m| range_m > 0.5 * longest_m && range_m.is_finite());
    let occurrences = occurrences(far);
    let from = |least_m: f32| &occurrences[occurrences.partition_point(|&(range_m, _)| range_m < least_m)..];
    let stands_out = |range_m: f32, count: usize| {
        let below = from(range_m * NEIGHBOURHOOD).iter().take_while(|&&(other_m, _)| other_m < range_m * FAMILY);
        let busiest = below.map(|&(_, count)| count).max().unwrap_or(0);
        range_m >= NEAREST_MARK_M && count >= least && count >= PROMINENCE * busiest
    };
    let mut beyond = 0;
    let &(mark_m, count) = occurrences.iter().rev().find(|&&(mark_m, count)| {
        // What outnumbers all beyond it at least doubles their number: few do, and only these are looked at.
        let outnumbers = count >= beyond;
        beyond += count;
        outnumbers && stands_out(mark_m, count)
    })?;
    let family = from(mark_m * FAMILY).iter().take_while(|&&(other_m, _)| other_m <= mark_m);
    let mut members = family.filter(|&&(_, other)| other as f64 >= LEAST_SECOND_SHARE * count as f64);
    members.next().map(|&(member_m, _)| member_m)
}

/// Readings that are counted at once, at least.
const AT_ONCE: usize = 1 << 16;

/// How often each range occurs, in order of the ranges. Takes memory for twice the ranges that differ, not for all, and reads
/// it in order: a tree of millions of ranges that all differ would wait for memory at each.
fn occurrences(ranges_m: impl Iterator<Item = f32>) -> Vec<(f32, usize)> {
    let mut counted: Vec<(f32, usize)> = Vec::new();
    let count = |counted: &mut Vec<(f32, usize)>| {
        // Stable, for what was counted before is in order already: that sort only merges it with what has come since.
        counted.sort_by(|a, b| a.0.total_cmp(&b.0));
        counted.dedup_by(|next, kept| {
            let is_same = next.0 == kept.0;
            kept.1 += if is_same { next.1 } else { 0 };
            is_same
        });
    };
    let mut most = AT_ONCE;
    for range_m in ranges_m {
        counted.push((range_m, 1));
        if counted.len() >= most {
            count(&mut counted);
            most = AT_ONCE.max(2 * counted.len());
        }
    }
    count(&mut counted);
    counted
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
        #![proptest_config(ProptestConfig::with_cases(20))]
        #[test]
        fn ranges_are_counted(kinds in 1..200_u32, count in 0..200_000_usize) {
            let ranges_m = (0..count).map(|k| (k as u32).wrapping_mul(2_654_435_761) % kinds).map(|kind| 1.0 + kind as f32);
            let mut truth = std::collections::BTreeMap::new();
            ranges_m.clone().for_each(|range_m| *truth.entry(range_m as u32).or_insert(0) += 1);
            let found: Vec<(u32, usize)> = occurrences(ranges_m).iter().map(|&(range_m, n)| (range_m as u32, n)).collect();
            prop_assert_eq!(found, truth.into_iter().collect::<Vec<_>>());
        }
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
