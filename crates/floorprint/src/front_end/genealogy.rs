//! The particles' trajectories as one family tree.
//!
//! Each particle holds the end of a branch; branches share their past. A branch that no
//! particle descends from any more is freed with its last reference, so memory holds the
//! surviving past once and the short time since the particles' last common ancestor N times.

use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use std::sync::Arc;

/// A particle's trajectory.
#[derive(Debug, Clone, Default)]
pub struct Trail {
    /// What is shared with other particles, up to the last resampling.
    past: Option<Arc<Branch>>,
    /// The particle's own poses since.
    recent: Vec<StampedPose>,
}

#[derive(Debug)]
struct Branch {
    past: Option<Arc<Branch>>,
    poses: Vec<StampedPose>,
}

impl Trail {
    /// Appends a pose.
    pub fn push(&mut self, pose: StampedPose) {
        self.recent.push(pose);
    }

    /// Gives the last `count` poses, none of which is shared yet, other values.
    pub fn correct_last(&mut self, count: usize, poses: impl Iterator<Item = Pose2>) {
        let first = self.recent.len().saturating_sub(count);
        self.recent[first..].iter_mut().zip(poses).for_each(|(stamped, pose)| stamped.pose = pose);
    }

    /// Makes what was walked so far sharable, so that copies of the trail cost nothing.
    pub fn fork(&mut self) {
        if !self.recent.is_empty() {
            let poses = std::mem::take(&mut self.recent);
            self.past = Some(Arc::new(Branch { past: self.past.take(), poses }));
        }
    }

    /// Forgets all but the last `count` poses.
    pub fn keep_last(&mut self, count: usize) {
        if self.past.is_some() {
            self.recent = self.last(count);
            self.past = None;
        } else {
            self.recent.drain(..self.recent.len().saturating_sub(count));
        }
    }

    /// All poses that are kept.
    #[must_use]
    pub fn poses(&self) -> Vec<StampedPose> {
        self.last(usize::MAX)
    }

    /// The last `count` poses, or all if there are fewer; in the order of time.
    #[must_use]
    pub fn last(&self, count: usize) -> Vec<StampedPose> {
        let mut parts = vec![self.recent.as_slice()];
        let mut length = self.recent.len();
        let mut branch = self.past.as_deref();
        while let Some(here) = branch.filter(|_| length < count) {
            parts.push(&here.poses);
            length += here.poses.len();
            branch = here.past.as_deref();
        }
        parts.into_iter().rev().flatten().skip(length.saturating_sub(count)).copied().collect()
    }
}

impl Drop for Branch {
    /// Frees a long past step by step: the derived recursion would overflow the stack.
    fn drop(&mut self) {
        let mut past = self.past.take();
        while let Some(branch) = past.and_then(Arc::into_inner) {
            let mut branch = branch;
            past = branch.past.take();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamped(k: usize) -> StampedPose {
        StampedPose { stamp_s: k as f64, pose: Pose2::new(k as f64, 0.0, 0.0) }
    }

    #[test]
    fn copies_share_their_past_and_walk_on_alone() {
        let mut first = Trail::default();
        (0..3).for_each(|k| first.push(stamped(k)));
        first.fork();
        let mut second = first.clone();
        first.push(stamped(3));
        second.push(stamped(30));
        second.push(stamped(40));
        assert_eq!(first.poses(), [0, 1, 2, 3].map(stamped));
        assert_eq!(second.poses(), [0, 1, 2, 30, 40].map(stamped));
        for count in 0..6 {
            assert_eq!(second.last(count), second.poses()[5 - count.min(5)..]);
        }
    }

    #[test]
    fn the_last_poses_can_be_corrected_but_not_what_is_shared() {
        let mut trail = Trail::default();
        trail.push(stamped(0));
        trail.fork();
        (1..4).for_each(|k| trail.push(stamped(k)));
        let corrected = Pose2::new(7.0, 0.0, 0.0);
        trail.correct_last(2, [corrected, corrected].into_iter());
        let poses: Vec<Pose2> = trail.poses().iter().map(|stamped| stamped.pose).collect();
        assert_eq!(poses, [stamped(0).pose, stamped(1).pose, corrected, corrected]);
        trail.correct_last(9, std::iter::repeat(corrected));
        assert_eq!(trail.poses()[0], stamped(0));
    }

    #[test]
    fn a_long_past_is_freed_without_deep_recursion() {
        let mut trail = Trail::default();
        for k in 0..300_000 {
            trail.push(stamped(k));
            trail.fork();
        }
        drop(trail);
    }

    #[test]
    fn dead_branches_are_freed() {
        let mut parent = Trail::default();
        parent.push(stamped(0));
        parent.fork();
        let past = Arc::downgrade(parent.past.as_ref().unwrap());
        let child = parent.clone();
        drop(parent);
        assert_eq!(past.strong_count(), 1);
        drop(child);
        assert_eq!(past.strong_count(), 0);
    }
}
