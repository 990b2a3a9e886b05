//! How far a scan saw in each direction.

use super::packing::{push_marks, take_array, take_marks};
use std::sync::Arc;

/// The outline of what a scan saw.
#[derive(Debug, Clone)]
pub struct Horizon {
    origin_m: [f64; 2],
    /// For each sector the shortest range of the rays next to it, metres; 0 where none is near.
    range_m: Arc<[f32; SECTORS]>,
    farthest_m: f64,
}

/// Directions are told apart this finely.
const SECTORS: usize = 720;
/// Rays this many sectors apart leave no gap between them.
const LARGEST_GAP: usize = 6;

impl Horizon {
    /// The outline of rays from `origin_m` to their `ends`, metres.
    #[must_use]
    pub fn new(origin_m: [f64; 2], ends: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut seen = [f32::INFINITY; SECTORS];
        let mut farthest_m: f64 = 0.0;
        for end in ends {
            let (dx, dy) = (end[0] - origin_m[0], end[1] - origin_m[1]);
            let range = dx.hypot(dy);
            farthest_m = farthest_m.max(range);
            let sector = &mut seen[sector_of(dx as f32, dy as f32)];
            *sector = sector.min(range as f32);
        }
        // A sector between two rays saw at least as far as the nearer of them.
        let behind = last_seen(&seen, |sector| sector);
        let ahead = last_seen(&seen, |sector| SECTORS - 1 - sector);
        let mut range_m = [0.0; SECTORS];
        for (sector, range) in range_m.iter_mut().enumerate() {
            let nearer = behind[sector].min(ahead[SECTORS - 1 - sector]);
            if behind[sector].max(ahead[SECTORS - 1 - sector]).is_finite() {
                *range = nearer;
            }
        }
        Self { origin_m, range_m: Arc::new(range_m), farthest_m }
    }

    /// Appends it to bytes of which [`unpack`](Self::unpack) makes the same: sectors that saw as far as the one before
    /// take a bit.
    pub(crate) fn pack(&self, bytes: &mut Vec<u8>) {
        for number in [self.origin_m[0], self.origin_m[1], self.farthest_m] {
            bytes.extend(number.to_le_bytes());
        }
        let before = std::iter::once(&0.0).chain(self.range_m.iter());
        let is_other: Vec<bool> =
            before.zip(self.range_m.iter()).map(|(before, range)| before.to_bits() != range.to_bits()).collect();
        push_marks(bytes, &is_other);
        let others = self.range_m.iter().zip(is_other).filter(|(_, is_other)| *is_other);
        others.for_each(|(range, _)| bytes.extend(range.to_le_bytes()));
    }

    /// Takes a packed horizon from the front of bytes; `None` if they are none.
    pub(crate) fn unpack(bytes: &mut &[u8]) -> Option<Self> {
        let mut numbers = [0.0; 3];
        for number in &mut numbers {
            *number = f64::from_le_bytes(take_array(bytes)?);
        }
        let is_other = take_marks(bytes, SECTORS)?;
        let (mut range_m, mut last) = ([0.0; SECTORS], 0.0);
        for (range, is_other) in range_m.iter_mut().zip(is_other) {
            if is_other {
                last = f32::from_le_bytes(take_array(bytes)?);
            }
            *range = last;
        }
        let [x, y, farthest_m] = numbers;
        Some(Self { origin_m: [x, y], range_m: Arc::new(range_m), farthest_m })
    }

    /// Where the rays begin, metres.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// Length of the longest ray, metres.
    #[must_use]
    pub fn farthest_m(&self) -> f64 {
        self.farthest_m
    }

    /// The way to a point, and how far the scan saw in that direction; metres.
    #[inline]
    #[must_use]
    pub fn towards(&self, point_m: [f32; 2]) -> ([f32; 2], f32) {
        let [dx, dy] = [0, 1].map(|axis| point_m[axis] - self.origin_m[axis] as f32);
        ([dx, dy], self.range_m[sector_of(dx, dy)])
    }

    /// Whether the scan saw as far as a point, but for `tolerance_m`; where that is negative, so much farther.
    #[inline]
    #[must_use]
    pub fn reaches(&self, point_m: [f32; 2], tolerance_m: f32) -> bool {
        let ([dx, dy], range_m) = self.towards(point_m);
        let seen_m = range_m + tolerance_m;
        range_m > 0.0 && seen_m >= 0.0 && dx * dx + dy * dy <= seen_m * seen_m
    }
}

/// For each sector, in the order in which `nth` goes round, the range of the last one that saw something, at most
/// [`LARGEST_GAP`] before it; infinite where there is none.
fn last_seen(seen: &[f32; SECTORS], nth: impl Fn(usize) -> usize) -> [f32; SECTORS] {
    let mut result = [f32::INFINITY; SECTORS];
    let (mut range, mut gap) = (f32::INFINITY, 0);
    // What the first ones follow comes last.
    for step in SECTORS - LARGEST_GAP..2 * SECTORS {
        let here = seen[nth(step % SECTORS)];
        if here.is_finite() {
            (range, gap) = (here, 0);
        } else {
            gap += 1;
        }
        if step >= SECTORS && gap <= LARGEST_GAP {
            result[step - SECTORS] = range;
        }
    }
    result
}

/// The sector of a direction. Sectors are equal steps of the "diamond angle" |y| / (|x| + |y|):
/// as good as equal angles for telling directions apart, and without a trigonometric function.
fn sector_of(dx: f32, dy: f32) -> usize {
    let length = dx.abs() + dy.abs();
    if length == 0.0 {
        return 0;
    }
    let quarter_turns = if dx >= 0.0 { 1.0 + dy / length } else { 3.0 - dy / length };
    // Through a narrow number, which is converted with a third of the instructions.
    usize::from((quarter_turns * (SECTORS / 4) as f32) as u16).min(SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_scan_reaches_what_lies_before_its_ends_and_nothing_where_it_has_no_rays() {
        let ends = (-90..=90).map(|degree| {
            let angle = f64::from(degree).to_radians();
            [1.0 + 5.0 * angle.cos(), 2.0 + 5.0 * angle.sin()]
        });
        let horizon = Horizon::new([1.0, 2.0], ends);
        assert!((horizon.farthest_m() - 5.0).abs() < 1e-9);
        assert!(horizon.reaches([4.0, 3.0], 0.0) && horizon.reaches([6.1, 2.0], 0.2));
        assert!(!horizon.reaches([6.3, 2.0], 0.2) && !horizon.reaches([-1.0, 2.0], 0.2));
        assert!(horizon.reaches([5.6, 2.0], -0.3) && !horizon.reaches([5.8, 2.0], -0.3));
        // Of what ended right before the LiDAR nothing is seen half a metre farther.
        let close = Horizon::new([0.0, 0.0], (-20..=20).map(|step| [0.1, 0.0005 * f64::from(step)]));
        assert!(close.reaches([0.05, 0.0], 0.0) && !close.reaches([0.05, 0.0], -0.5));
    }

    proptest! {
        #[test]
        fn a_sector_sees_as_far_as_the_nearer_of_the_rays_around_it(
            rays in prop::collection::vec((0..SECTORS, 1.0..50.0_f32), 0..80)
        ) {
            let mut seen = [f32::INFINITY; SECTORS];
            let mut ends = Vec::new();
            for (sector, range) in rays {
                // The middle of the sector.
                let quarter_turns = (sector as f32 + 0.5) / (SECTORS / 4) as f32;
                let along = if quarter_turns < 2.0 { quarter_turns - 1.0 } else { 3.0 - quarter_turns };
                let across = if quarter_turns < 2.0 { 1.0 - along.abs() } else { along.abs() - 1.0 };
                let end = [f64::from(range * across), f64::from(range * along)];
                ends.push(end);
                seen[sector] = seen[sector].min(end[0].hypot(end[1]) as f32);
            }
            let horizon = Horizon::new([0.0, 0.0], ends.into_iter());
            let nearest = |begin: usize, step: usize| {
                (0..=LARGEST_GAP).map(|gap| seen[(begin + step * gap) % SECTORS]).find(|range| range.is_finite())
            };
            for (sector, &range) in horizon.range_m.iter().enumerate() {
                let around = nearest(sector, 1).zip(nearest(sector, SECTORS - 1));
                prop_assert_eq!(range, around.map_or(0.0, |(ahead, behind)| ahead.min(behind)));
            }
        }
    }
}
