//! Depth and colour images paired by their stamps.

/// The pairs of two lists of stamps, and how many images stay alone.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ImagePairing {
    /// The pairs in the order of the colour images' stamps.
    pub pairs: Vec<ImagePair>,
    /// Depth images without a colour image near enough in time.
    pub unpaired_depth: usize,
    /// Colour images without a depth image near enough in time.
    pub unpaired_color: usize,
}

/// Indices of a depth image and the colour image that belongs to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagePair {
    /// Index into the depth images.
    pub depth: usize,
    /// Index into the colour images.
    pub color: usize,
}

/// Pairs images that are each other's nearest in time and at most `gap_max_s` apart.
///
/// Neither list needs to be sorted; the lists may differ in length, since either camera
/// loses images. Stamps that are not finite stay unpaired. No image is used twice.
#[must_use]
pub fn pair_by_time(depth_stamps_s: &[f64], color_stamps_s: &[f64], gap_max_s: f64) -> ImagePairing {
    let depths = in_time_order(depth_stamps_s);
    let colors = in_time_order(color_stamps_s);
    let pairs: Vec<ImagePair> = colors
        .iter()
        .filter_map(|&color| {
            let stamp_s = color_stamps_s[color];
            let depth = nearest(&depths, depth_stamps_s, stamp_s)?;
            let mutual = nearest(&colors, color_stamps_s, depth_stamps_s[depth])? == color;
            let near = (depth_stamps_s[depth] - stamp_s).abs() <= gap_max_s;
            (mutual && near).then_some(ImagePair { depth, color })
        })
        .collect();
    ImagePairing {
        unpaired_depth: depth_stamps_s.len() - pairs.len(),
        unpaired_color: color_stamps_s.len() - pairs.len(),
        pairs,
    }
}

/// Indices of the finite stamps, earliest first; equal stamps keep their order.
fn in_time_order(stamps_s: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..stamps_s.len()).filter(|&i| stamps_s[i].is_finite()).collect();
    order.sort_by(|&a, &b| stamps_s[a].total_cmp(&stamps_s[b]));
    order
}

/// The index whose stamp is nearest to `stamp_s`; the first of equally near ones.
fn nearest(order: &[usize], stamps_s: &[f64], stamp_s: f64) -> Option<usize> {
    let after = order.partition_point(|&i| stamps_s[i] < stamp_s);
    let first_of_equals = |position: usize| order.partition_point(|&i| stamps_s[i] < stamps_s[order[position]]);
    let before = after.checked_sub(1).map(first_of_equals);
    let candidates = [before, (after < order.len()).then_some(after)];
    candidates
        .into_iter()
        .flatten()
        .map(|position| order[position])
        .min_by(|&a, &b| (stamps_s[a] - stamp_s).abs().total_cmp(&(stamps_s[b] - stamp_s).abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_missing_first_image_does_not_shift_the_pairs() {
        let pairing = pair_by_time(&[0.0, 1.0, 2.0, 3.0], &[1.01, 2.02, 2.97], 0.1);
        let expected = [(1, 0), (2, 1), (3, 2)].map(|(depth, color)| ImagePair { depth, color });
        assert_eq!(pairing.pairs, expected);
        assert_eq!((pairing.unpaired_depth, pairing.unpaired_color), (1, 0));
    }

    #[test]
    fn an_image_far_in_time_or_without_a_finite_stamp_stays_alone() {
        let pairing = pair_by_time(&[0.0, f64::NAN, 5.0], &[0.2, 5.0, f64::INFINITY], 0.1);
        assert_eq!(pairing.pairs, [ImagePair { depth: 2, color: 1 }]);
        assert_eq!((pairing.unpaired_depth, pairing.unpaired_color), (2, 2));
        assert_eq!(pair_by_time(&[], &[], 0.1), ImagePairing::default());
    }

    proptest! {
        #[test]
        fn no_image_is_used_twice_and_none_is_lost(
            depth in prop::collection::vec(0.0..10.0_f64, 0..40),
            color in prop::collection::vec(0.0..10.0_f64, 0..40),
        ) {
            let pairing = pair_by_time(&depth, &color, 0.3);
            let mut used: Vec<usize> = pairing.pairs.iter().map(|pair| pair.depth).collect();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), pairing.pairs.len());
            prop_assert_eq!(pairing.pairs.len() + pairing.unpaired_depth, depth.len());
            prop_assert_eq!(pairing.pairs.len() + pairing.unpaired_color, color.len());
            prop_assert!(pairing.pairs.iter().all(|pair| (depth[pair.depth] - color[pair.color]).abs() <= 0.3));
        }
    }
}
