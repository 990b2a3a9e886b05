//! What a submap looks like.

use crate::geometry::Pose2;
use crate::surface::packing::{push_marks, take_marks};
use crate::surface::{Horizon, SurfaceMap, SurfaceScan};

/// Points by which a submap is fitted.
const PROBE_POINTS: usize = 400;
/// A surface on which rays end is in view although they end a little before it, metres.
const VIEW_TOLERANCE_M: f32 = 0.2;

/// What a submap looks like, in its frame. It is needed where submaps are compared, and is packed as long as it is not:
/// [`pack`](Self::pack) and [`unpack`](Self::unpack) lose nothing.
#[derive(Debug, Clone, Default)]
pub struct Look {
    /// All surfaces, as if seen from the middle.
    pub surfaces: SurfaceScan,
    /// A choice of them by which the submap is looked for and fitted.
    pub probe: SurfaceScan,
    /// Which of them these are.
    is_probe: Vec<bool>,
    /// What the first, the middle and the last key scan had in view.
    horizons: Vec<Horizon>,
}

impl Look {
    /// What key scans show, each from its pose in the submap's frame; as if seen from `middle_m`. Surfaces are kept in
    /// cells of `cell_m`; metres.
    #[must_use]
    pub fn of(key_scans: &[(Pose2, &SurfaceScan)], middle_m: [f64; 2], cell_m: f64) -> Self {
        let mut map = SurfaceMap::new(cell_m);
        for (pose, scan) in key_scans {
            map.add_scan(pose, scan);
        }
        let surfaces = SurfaceScan::from_surfaces(middle_m, map.surfaces());
        let count = key_scans.len();
        let seen_from = [0, count / 2, count.saturating_sub(1)].map(|position| key_scans.get(position));
        let horizons = seen_from.into_iter().flatten().map(|(pose, scan)| scan.horizon(pose)).collect();
        let is_probe = surfaces.balance(PROBE_POINTS);
        Self { probe: surfaces.selected(is_probe.iter().copied()), surfaces, is_probe, horizons }
    }

    /// Whether a point of the submap's frame (metres) was in view.
    #[must_use]
    pub fn had_in_view(&self, point_m: [f32; 2]) -> bool {
        self.horizons.iter().any(|horizon| horizon.reaches(point_m, VIEW_TOLERANCE_M))
    }

    /// As bytes.
    #[must_use]
    pub fn pack(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(16 * self.surfaces.len());
        self.surfaces.pack(&mut bytes);
        push_marks(&mut bytes, &self.is_probe);
        self.horizons.iter().for_each(|horizon| horizon.pack(&mut bytes));
        bytes
    }

    /// What was packed; `None` if the bytes are no look.
    #[must_use]
    pub fn unpack(mut bytes: &[u8]) -> Option<Self> {
        let surfaces = SurfaceScan::unpack(&mut bytes)?;
        let is_probe: Vec<bool> = take_marks(&mut bytes, surfaces.len())?.collect();
        let mut horizons = Vec::with_capacity(3);
        while !bytes.is_empty() {
            horizons.push(Horizon::unpack(&mut bytes)?);
        }
        Some(Self { probe: surfaces.selected(is_probe.iter().copied()), surfaces, is_probe, horizons })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scan(ends: &[[f32; 2]]) -> SurfaceScan {
        let mut scan = crate::BodyScan::default();
        ends.iter().for_each(|end| scan.hits.push(end[0], end[1]));
        SurfaceScan::new(&scan, &crate::surface::Thinning::default())
    }

    proptest! {
        #[test]
        fn what_was_packed_is_the_same(
            ends in prop::collection::vec(prop::array::uniform2(-9.0..9.0_f32), 0..200),
            [x, y, theta] in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let (here, there) = (scan(&ends), scan(&ends[..ends.len() / 2]));
            let poses = [Pose2::IDENTITY, Pose2::new(x, y, theta)];
            let look = Look::of(&[(poses[0], &here), (poses[1], &there)], [0.5 * x, y], 0.05);
            let back = Look::unpack(&look.pack()).unwrap();
            prop_assert_eq!(format!("{back:?}"), format!("{look:?}"));
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = Look::unpack(&bytes);
        }
    }
}
