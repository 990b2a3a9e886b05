//! Time stamps that jump: which readings of a stream to keep.

/// Whether a number can be a stamp, seconds: a span of larger ones need not be finite, and no clock gives them.
pub(crate) fn is_stamp(number: f64) -> bool {
    number.abs() < 1e20
}

/// For each stamp whether it belongs to the largest set of stamps that rise.
///
/// Keeping the largest such set means that one stray stamp, however far ahead or behind,
/// costs one reading and not all that follow or precede it. With `strictly` equal stamps
/// are kept once (longest increasing subsequence by patience sorting, O(n log n)).
pub(crate) fn rising(stamps_s: &[f64], strictly: bool) -> Vec<bool> {
    let follows = |earlier: f64, later: f64| if strictly { earlier < later } else { earlier <= later };
    if stamps_s.iter().all(|&stamp_s| is_stamp(stamp_s)) && stamps_s.windows(2).all(|pair| follows(pair[0], pair[1])) {
        return vec![true; stamps_s.len()];
    }
    // tails[k] is the index of the smallest stamp that ends a rising run of k + 1 stamps.
    let mut tails: Vec<usize> = Vec::new();
    let mut previous: Vec<Option<usize>> = vec![None; stamps_s.len()];
    for (index, &stamp_s) in stamps_s.iter().enumerate().filter(|(_, stamp_s)| is_stamp(**stamp_s)) {
        let length = tails.partition_point(|&tail| follows(stamps_s[tail], stamp_s));
        previous[index] = length.checked_sub(1).map(|before| tails[before]);
        if length == tails.len() {
            tails.push(index);
        } else if stamp_s < stamps_s[tails[length]] {
            // Of equal stamps the first stays.
            tails[length] = index;
        }
    }
    let mut keep = vec![false; stamps_s.len()];
    let mut next = tails.last().copied();
    while let Some(index) = next {
        keep[index] = true;
        next = previous[index];
    }
    keep
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_stray_stamp_costs_one_reading() {
        let keep = rising(&[-1e308, 1.0, 2.0, 1e9, 3.0, 4.0, 0.0, f64::NAN, 4.0, 5.0, 1e308], true);
        assert_eq!(keep, [false, true, true, false, true, true, false, false, false, true, false]);
        assert!(rising(&[1.0, 1.0, 2.0], false).iter().all(|&keep| keep));
        assert!(rising(&[], true).is_empty());
    }

    proptest! {
        #[test]
        fn kept_stamps_rise_and_are_as_many_as_can_be(stamps in proptest::collection::vec(0..8_u8, 0..10), strictly in any::<bool>()) {
            let stamps: Vec<f64> = stamps.into_iter().map(f64::from).collect();
            let rises = |chosen: &[f64]| chosen.windows(2).all(|p| if strictly { p[0] < p[1] } else { p[0] <= p[1] });
            let chosen = |keep: &dyn Fn(usize) -> bool| -> Vec<f64> {
                (0..stamps.len()).filter(|&i| keep(i)).map(|i| stamps[i]).collect()
            };
            let keep = rising(&stamps, strictly);
            let kept = chosen(&|i| keep[i]);
            prop_assert!(rises(&kept));
            let most = (0..1_u32 << stamps.len())
                .map(|set| chosen(&|i| set >> i & 1 == 1))
                .filter(|chosen| rises(chosen))
                .map(|chosen| chosen.len())
                .max();
            prop_assert_eq!(Some(kept.len()), most);
        }
    }
}
