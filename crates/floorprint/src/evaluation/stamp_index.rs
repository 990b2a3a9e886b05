//! Looks up the poses of a trajectory by their time.

use crate::geometry::Pose2;
use crate::sensors::StampedPose;

/// The poses of a trajectory in the order of their stamps.
///
/// The trajectory itself may be in any order: some logs hold stamps that run backwards.
#[derive(Debug, Clone)]
pub struct StampIndex {
    sorted: Vec<StampedPose>,
}

impl StampIndex {
    /// Indexes a trajectory; poses that are not finite are left out. Of poses with
    /// equal stamps the first in the trajectory comes first.
    #[must_use]
    pub fn new(trajectory: &[StampedPose]) -> Self {
        let mut sorted: Vec<_> =
            trajectory.iter().filter(|p| p.stamp_s.is_finite() && p.pose.is_finite()).copied().collect();
        sorted.sort_by(|a, b| a.stamp_s.total_cmp(&b.stamp_s));
        Self { sorted }
    }

    /// All poses, by stamp.
    #[must_use]
    pub fn poses(&self) -> &[StampedPose] {
        &self.sorted
    }

    /// First and last stamp, for people.
    pub(super) fn describe_span(&self) -> String {
        describe_span(self.sorted.iter().map(|pose| pose.stamp_s))
    }

    /// The pose whose stamp is nearest to `stamp_s`, unless it is more than
    /// `tolerance_s` seconds away. Ties go to the earlier one.
    #[must_use]
    pub fn nearest(&self, stamp_s: f64, tolerance_s: f64) -> Option<&StampedPose> {
        let after = self.first_at_or_after(stamp_s);
        let later = self.sorted.get(after);
        let earlier = after.checked_sub(1).map(|i| &self.sorted[i]);
        let distance_s = |p: &&StampedPose| (p.stamp_s - stamp_s).abs();
        earlier
            .into_iter()
            .chain(later)
            .min_by(|a, b| distance_s(a).total_cmp(&distance_s(b)))
            .filter(|p| distance_s(p) <= tolerance_s)
    }

    /// The pose at `stamp_s`: the one within `tolerance_s` seconds, else the
    /// interpolation between its two neighbours if these are at most `max_gap_s` seconds apart.
    #[must_use]
    pub fn interpolated(&self, stamp_s: f64, tolerance_s: f64, max_gap_s: f64) -> Option<Pose2> {
        if let Some(near) = self.nearest(stamp_s, tolerance_s) {
            return Some(near.pose);
        }
        let after = self.first_at_or_after(stamp_s);
        let (earlier, later) = (self.sorted.get(after.checked_sub(1)?)?, self.sorted.get(after)?);
        let gap_s = later.stamp_s - earlier.stamp_s;
        (gap_s <= max_gap_s).then(|| earlier.pose.interpolate(&later.pose, (stamp_s - earlier.stamp_s) / gap_s))
    }

    fn first_at_or_after(&self, stamp_s: f64) -> usize {
        self.sorted.partition_point(|p| p.stamp_s < stamp_s)
    }
}

/// The first and the last of some stamps in any order, for people.
pub(super) fn describe_span(stamps_s: impl Iterator<Item = f64>) -> String {
    let span = stamps_s.map(|stamp_s| (stamp_s, stamp_s)).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
    span.map_or("nothing".to_owned(), |(first_s, last_s)| format!("{first_s:.3} to {last_s:.3} s"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(stamps: &[f64]) -> StampIndex {
        let poses: Vec<_> = stamps.iter().map(|&s| StampedPose { stamp_s: s, pose: Pose2::new(s, 0.0, 0.0) }).collect();
        StampIndex::new(&poses)
    }

    #[test]
    fn finds_the_nearest_whatever_the_order() {
        let index = index(&[3.0, 1.0, 2.0, f64::NAN]);
        let at = |stamp| index.nearest(stamp, 0.625).map(|p| p.stamp_s);
        assert_eq!(at(0.5), Some(1.0));
        assert_eq!(at(1.4), Some(1.0));
        assert_eq!(at(1.5), Some(1.0));
        assert_eq!(at(1.6), Some(2.0));
        assert_eq!(at(3.625), Some(3.0));
        assert_eq!(at(3.7), None);
        assert_eq!(self::index(&[]).nearest(0.0, 1.0), None);
    }

    #[test]
    fn interpolates_only_across_short_gaps() {
        let index = index(&[0.0, 1.0, 3.0]);
        let at = |stamp| index.interpolated(stamp, 1e-4, 1.5).map(|p| p.x);
        assert_eq!(at(0.25), Some(0.25));
        assert_eq!(at(2.0), None);
        assert_eq!(at(3.00005), Some(3.0));
        assert_eq!(at(-0.1), None);
    }
}
