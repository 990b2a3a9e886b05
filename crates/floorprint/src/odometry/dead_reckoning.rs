//! Dead reckoning: the pose that odometry alone gives, as a continuous function of time.
//!
//! The trajectory is a list of knots with a constant body twist between them. Because the
//! motion between two times is always the difference of two values of one function, every
//! encoder count is used exactly once whatever the scans' stamps are; pairing each scan
//! with the nearest reading loses some counts and uses others twice.
//!
//! On a live robot it is a window: knots are added at its end and forgotten at its beginning.

use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use std::collections::VecDeque;

/// No window holds more knots than this, whatever the stamps say: sixteen seconds of a gyro at 1 kHz.
const MOST_KNOTS: usize = 16_384;

/// The odometry trajectory `start_from_body` over time, or a window of it.
#[derive(Debug, Clone, Default)]
pub struct DeadReckoning {
    /// Knots in order; stamps never decrease. Two knots at one stamp are a jump.
    knots: VecDeque<Knot>,
    /// How many knots before these were forgotten.
    forgotten: usize,
    /// Pose of the very first knot.
    first: Option<Pose2>,
}

#[derive(Debug, Clone, Copy)]
struct Knot {
    stamp_s: f64,
    pose: Pose2,
    /// Stamp of the record that made it known, seconds; never decreases from knot to knot.
    known_s: f64,
}

impl Knot {
    fn stamped(&self) -> StampedPose {
        StampedPose { stamp_s: self.stamp_s, pose: self.pose }
    }
}

impl DeadReckoning {
    /// A trajectory through `knots`. A knot whose stamp lies before its predecessor's is
    /// taken to be as late as that one, so that no motion is lost.
    #[must_use]
    pub fn new(knots: impl IntoIterator<Item = StampedPose>) -> Self {
        let mut path = Self::default();
        for knot in knots {
            path.add(knot, knot.stamp_s);
        }
        path
    }

    /// A trajectory without a knot.
    pub(super) const fn nowhere() -> Self {
        Self { knots: VecDeque::new(), forgotten: 0, first: None }
    }

    /// Pose of the very first knot, forgotten or not.
    pub(super) fn first(&self) -> Option<Pose2> {
        self.first
    }

    /// Adds a knot that was made known by a record of stamp `known_s` (seconds).
    fn add(&mut self, StampedPose { mut stamp_s, pose }: StampedPose, mut known_s: f64) {
        if let Some(last) = self.knots.back() {
            stamp_s = stamp_s.max(last.stamp_s);
            known_s = known_s.max(last.known_s);
        }
        self.first.get_or_insert(pose);
        self.knots.push_back(Knot { stamp_s, pose, known_s });
    }

    /// Adds a knot to a window of bounded size.
    pub(super) fn push(&mut self, knot: StampedPose, known_s: f64) {
        self.add(knot, known_s);
        if self.knots.len() > MOST_KNOTS {
            self.knots.pop_front();
            self.forgotten += 1;
        }
    }

    /// Forgets the knots before `stamp_s` but for the last of them.
    pub(super) fn forget_before(&mut self, stamp_s: f64) {
        while self.knots.get(1).is_some_and(|knot| knot.stamp_s < stamp_s) {
            self.knots.pop_front();
            self.forgotten += 1;
        }
    }

    /// The pose at a time (seconds), along the constant twist between the knots around it.
    /// Before the first knot and after the last the pose is theirs; without knots it is the identity.
    #[must_use]
    pub fn pose_at(&self, stamp_s: f64) -> Pose2 {
        self.pose_among(self.knots.len(), stamp_s)
    }

    /// The same by the knots alone that were known at `known_s` (seconds).
    pub(super) fn pose_at_known(&self, stamp_s: f64, known_s: f64) -> Pose2 {
        self.pose_among(self.known(known_s), stamp_s)
    }

    /// The pose by the first `count` knots.
    fn pose_among(&self, count: usize, stamp_s: f64) -> Pose2 {
        let next = self.knots.partition_point(|knot| knot.stamp_s <= stamp_s).min(count);
        match (next.checked_sub(1).map(|index| &self.knots[index]), self.knots.get(next).filter(|_| next < count)) {
            (Some(before), Some(after)) => {
                let share = (stamp_s - before.stamp_s) / (after.stamp_s - before.stamp_s);
                before.pose.interpolate(&after.pose, share)
            }
            (Some(knot), None) | (None, Some(knot)) => knot.pose,
            (None, None) => Pose2::IDENTITY,
        }
    }

    /// How many of the knots were known at `known_s` (seconds).
    fn known(&self, known_s: f64) -> usize {
        self.knots.partition_point(|knot| knot.known_s <= known_s)
    }

    /// The motion from one time to another, `body_at_from_from_body_at_to`, seconds.
    #[must_use]
    pub fn motion(&self, from_s: f64, to_s: f64) -> Pose2 {
        self.pose_at(from_s).between(&self.pose_at(to_s))
    }

    /// First and last time at which the motion is known, seconds; `None` without odometry.
    #[must_use]
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.knots.front()?.stamp_s, self.knots.back()?.stamp_s])
    }

    /// The same of the knots that were known at `known_s` (seconds).
    pub(super) fn span_known_s(&self, known_s: f64) -> Option<[f64; 2]> {
        let last = self.known(known_s).checked_sub(1)?;
        Some([self.knots.front()?.stamp_s, self.knots[last].stamp_s])
    }

    /// The knots in order of time.
    pub fn knots(&self) -> impl Iterator<Item = StampedPose> + '_ {
        self.knots.iter().map(Knot::stamped)
    }

    /// The knots from number `first` on, counted from the beginning of the drive, those that are not yet forgotten;
    /// with the number of the knot after the last. A caller who asks after every record misses none.
    pub fn knots_from(&self, first: usize) -> (impl Iterator<Item = StampedPose> + '_, usize) {
        let skipped = first.saturating_sub(self.forgotten).min(self.knots.len());
        (self.knots.range(skipped..).map(Knot::stamped), self.forgotten + self.knots.len())
    }

    /// The same trajectory seen from `origin`, a pose of its own frame.
    #[must_use]
    pub fn seen_from(mut self, origin: &Pose2) -> Self {
        for knot in &mut self.knots {
            knot.pose = origin.between(&knot.pose);
        }
        self.first = self.first.map(|first| origin.between(&first));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn knot(stamp_s: f64, x: f64, theta: f64) -> StampedPose {
        StampedPose { stamp_s, pose: Pose2::new(x, 0.0, theta) }
    }

    #[test]
    fn holds_the_pose_outside_its_span() {
        let path = DeadReckoning::new(vec![knot(1.0, 0.0, 0.0), knot(2.0, 1.0, 0.0)]);
        assert_eq!(path.pose_at(0.0).x, 0.0);
        assert!((path.pose_at(1.25).x - 0.25).abs() < 1e-12);
        assert_eq!(path.pose_at(9.0).x, 1.0);
        assert_eq!(DeadReckoning::default().pose_at(1.0), Pose2::IDENTITY);
    }

    #[test]
    fn stamps_that_run_backwards_lose_no_motion() {
        let path = DeadReckoning::new(vec![knot(1.0, 0.0, 0.0), knot(0.5, 1.0, 0.0), knot(2.0, 3.0, 0.0)]);
        assert_eq!(path.motion(0.9, 2.5).x, 3.0);
    }

    #[test]
    fn a_window_forgets_its_beginning_and_counts_on() {
        let mut path = DeadReckoning::default();
        for k in 0..100 {
            path.push(knot(f64::from(k), f64::from(k), 0.0), f64::from(k) + 0.5);
        }
        path.forget_before(90.0);
        assert_eq!(path.span_s(), Some([89.0, 99.0]));
        let (knots, next) = path.knots_from(95);
        assert_eq!(
            (knots.map(|knot| knot.stamp_s).collect::<Vec<_>>(), next),
            (vec![95.0, 96.0, 97.0, 98.0, 99.0], 100)
        );
        assert_eq!(path.knots_from(0).0.count(), 11);
        for k in 0..2 * MOST_KNOTS {
            path.push(knot(100.0, k as f64, 0.0), 100.0);
        }
        assert_eq!(path.knots().count(), MOST_KNOTS);
    }

    #[test]
    fn what_was_not_known_yet_is_not_used() {
        let mut path = DeadReckoning::default();
        path.push(knot(1.0, 1.0, 0.0), 1.0);
        path.push(knot(2.0, 2.0, 0.0), 2.6);
        assert_eq!((path.pose_at_known(1.5, 2.6).x, path.pose_at_known(1.5, 2.5).x), (1.5, 1.0));
        assert_eq!((path.span_known_s(2.5), path.span_known_s(0.5)), (Some([1.0, 1.0]), None));
    }

    proptest! {
        #[test]
        fn motions_between_any_times_add_up_to_the_whole(
            steps in prop::collection::vec((0.0..0.2_f64, -0.2..0.2_f64, -0.3..0.3_f64), 2..40),
            mut cuts in prop::collection::vec(-1.0..10.0_f64, 0..40),
        ) {
            let mut knots = vec![knot(0.0, 0.0, 0.0)];
            for (dt, ds, turn) in steps {
                let last = knots[knots.len() - 1];
                let pose = last.pose.compose(&Pose2::exp([ds, 0.0, turn]));
                knots.push(StampedPose { stamp_s: last.stamp_s + dt, pose });
            }
            let end = knots[knots.len() - 1].pose;
            let path = DeadReckoning::new(knots);
            cuts.extend([-1.0, 10.0]);
            cuts.sort_by(f64::total_cmp);
            let sum = cuts.windows(2).fold(Pose2::IDENTITY, |sum, cut| sum.compose(&path.motion(cut[0], cut[1])));
            prop_assert!(sum.between(&end).distance() < 1e-9);
        }
    }
}
