//! The front end's poses, packed once they are settled.
//!
//! Nothing is lost: a pose is stored as what its four numbers differ by, in units in the last place, from where the two
//! before it lead. That takes about 22 bytes instead of 32 (what a millimetre of noise does to 52 bits cannot be packed), and
//! 3 where the robot stands still.

use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use crate::storage::{Part, Shelf};
use std::sync::Arc;

/// Poses are packed in blocks of so many.
pub const POSES_PER_BLOCK: usize = 1024;

/// Poses in the order of the drive. Copies share what is packed.
#[derive(Debug, Clone, Default)]
pub(super) struct PoseLog {
    packed: Vec<Part>,
    /// Those after the packed ones.
    open: Vec<StampedPose>,
    /// Where what is packed lies, if its memory is bounded.
    shelf: Option<Arc<Shelf>>,
}

impl PoseLog {
    pub(super) fn len(&self) -> usize {
        self.packed_poses() + self.open.len()
    }

    fn packed_poses(&self) -> usize {
        self.packed.len() * POSES_PER_BLOCK
    }

    pub(super) fn last(&self) -> Option<StampedPose> {
        self.open.last().copied().or_else(|| unpack_poses(&self.packed.last()?.bytes())?.pop())
    }

    pub(super) fn push(&mut self, pose: StampedPose) {
        self.open.push(pose);
    }

    /// Packs whole blocks of the first `settled` poses, which do not change any more.
    pub(super) fn pack(&mut self, settled: usize) {
        let whole = settled.min(self.len()).saturating_sub(self.packed_poses()) / POSES_PER_BLOCK * POSES_PER_BLOCK;
        // All at once: taken from the front block by block, those of a long drive would be moved again and again.
        for block in self.open[..whole].chunks(POSES_PER_BLOCK) {
            let part = Part::new(pack_poses(block));
            self.shelf.iter().for_each(|shelf| part.lay_on(shelf));
            self.packed.push(part);
        }
        self.open.drain(..whole);
    }

    /// Lays what is packed on a shelf, now and from now on.
    pub(super) fn lay_on(&mut self, shelf: &Arc<Shelf>) {
        self.packed.iter().for_each(|part| part.lay_on(shelf));
        self.shelf = Some(Arc::clone(shelf));
    }

    /// Gives the poses from `first` on other values.
    pub(super) fn set(&mut self, first: usize, poses: &[Pose2]) {
        // That something packed changes is rare.
        if first < self.packed_poses() {
            self.open = self.since(first / POSES_PER_BLOCK * POSES_PER_BLOCK);
            self.packed.truncate(first / POSES_PER_BLOCK);
        }
        let skipped = first - self.packed_poses();
        self.open.iter_mut().skip(skipped).zip(poses).for_each(|(stamped, pose)| stamped.pose = *pose);
    }

    /// The pose of a frame.
    pub(super) fn get(&self, frame: usize) -> Option<StampedPose> {
        match self.packed.get(frame / POSES_PER_BLOCK) {
            Some(block) => unpack_poses(&block.bytes())?.get(frame % POSES_PER_BLOCK).copied(),
            None => self.open.get(frame - self.packed_poses()).copied(),
        }
    }

    /// The poses from a frame on.
    pub(super) fn since(&self, first: usize) -> Vec<StampedPose> {
        let mut poses = Vec::with_capacity(self.len().saturating_sub(first));
        let block = (first / POSES_PER_BLOCK).min(self.packed.len());
        // What is packed here can be unpacked.
        self.packed[block..].iter().for_each(|block| poses.extend(unpack_poses(&block.bytes()).unwrap_or_default()));
        poses.extend_from_slice(&self.open);
        poses.drain(..(first - block * POSES_PER_BLOCK).min(poses.len()));
        poses
    }

    /// A block of poses, packed; the last one may be short.
    pub(super) fn block(&self, number: usize) -> Arc<[u8]> {
        self.packed.get(number).map_or_else(
            || {
                let open = self.open.chunks(POSES_PER_BLOCK).nth(number - self.packed.len());
                pack_poses(open.unwrap_or_default()).into()
            },
            Part::bytes,
        )
    }

    /// Bytes that it holds.
    pub(super) fn held_bytes(&self) -> usize {
        let packed = self.packed.iter().map(|block| block.held_bytes() + size_of_val(block));
        packed.sum::<usize>() + size_of_val(&self.open[..])
    }
}

impl FromIterator<StampedPose> for PoseLog {
    fn from_iter<T: IntoIterator<Item = StampedPose>>(poses: T) -> Self {
        Self { open: poses.into_iter().collect(), ..Self::default() }
    }
}

/// Packs poses; [`unpack_poses`] gives them back to the bit.
#[must_use]
pub fn pack_poses(poses: &[StampedPose]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(poses.len() * 20);
    let mut before = Before::default();
    for stamped in poses {
        let numbers = numbers_of(stamped);
        let differences: [u64; 4] = std::array::from_fn(|axis| {
            let difference = order(numbers[axis]).wrapping_sub(order(before.expected(axis)));
            ((difference << 1) ^ (difference >> 63)) as u64
        });
        // How many bytes each takes, then those bytes, the lowest first.
        let lengths = differences.map(|difference| (8 - difference.leading_zeros() / 8) as u8);
        bytes.extend([lengths[0] << 4 | lengths[1], lengths[2] << 4 | lengths[3]]);
        for (difference, length) in differences.iter().zip(lengths) {
            bytes.extend_from_slice(&difference.to_le_bytes()[..usize::from(length)]);
        }
        before.push(numbers);
    }
    bytes
}

/// Poses that were packed; `None` if the bytes are no packed poses.
#[must_use]
pub fn unpack_poses(bytes: &[u8]) -> Option<Vec<StampedPose>> {
    let mut bytes = bytes;
    let mut poses = Vec::with_capacity(bytes.len() / 16);
    let mut before = Before::default();
    while !bytes.is_empty() {
        let (lengths, mut rest) = bytes.split_at_checked(2)?;
        let mut numbers = [0.0; 4];
        for (axis, number) in numbers.iter_mut().enumerate() {
            let length = usize::from(lengths[axis / 2] >> (4 * (1 - axis % 2)) & 0xf);
            let (taken, after) = rest.split_at_checked(length)?;
            let mut eight = [0; 8];
            eight.get_mut(..length)?.copy_from_slice(taken);
            let zigzag = u64::from_le_bytes(eight);
            let difference = (zigzag >> 1) as i64 ^ -((zigzag & 1) as i64);
            *number = disorder(order(before.expected(axis)).wrapping_add(difference));
            rest = after;
        }
        before.push(numbers);
        let [stamp_s, x, y, theta] = numbers;
        poses.push(StampedPose { stamp_s, pose: Pose2 { x, y, theta } });
        bytes = rest;
    }
    Some(poses)
}

fn numbers_of(stamped: &StampedPose) -> [f64; 4] {
    let Pose2 { x, y, theta } = stamped.pose;
    [stamped.stamp_s, x, y, theta]
}

/// The numbers of the last two poses.
#[derive(Default)]
struct Before {
    last: [f64; 4],
    /// What the last ones differ by from those before.
    step: [f64; 4],
}

impl Before {
    /// Where a number leads that goes on as it did.
    fn expected(&self, axis: usize) -> f64 {
        let expected = self.last[axis] + self.step[axis];
        if expected.is_finite() { expected } else { self.last[axis] }
    }

    fn push(&mut self, numbers: [f64; 4]) {
        self.step = std::array::from_fn(|axis| numbers[axis] - self.last[axis]);
        self.last = numbers;
    }
}

/// The number of a float among all floats in their order.
fn order(number: f64) -> i64 {
    let bits = number.to_bits() as i64;
    if bits < 0 { bits ^ i64::MAX } else { bits }
}

fn disorder(order: i64) -> f64 {
    let bits = if order < 0 { order ^ i64::MAX } else { order };
    f64::from_bits(bits as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bits(poses: &[StampedPose]) -> Vec<[u64; 4]> {
        poses.iter().map(|stamped| numbers_of(stamped).map(f64::to_bits)).collect()
    }

    /// A robot goes round, with a millimetre of noise.
    fn round(count: usize) -> Vec<StampedPose> {
        let pose = |k: usize| {
            let (angle, noise) = (k as f64 * 0.01, 0.001 * ((k * 7919 % 997) as f64 / 997.0 - 0.5));
            Pose2::new(20.0 * angle.cos() + noise, 20.0 * angle.sin() - noise, angle + noise)
        };
        (0..count).map(|k| StampedPose { stamp_s: 1.7e9 + k as f64 * 0.025, pose: pose(k) }).collect()
    }

    proptest! {
        #[test]
        fn poses_come_back_to_the_bit(
            numbers in prop::collection::vec(prop::array::uniform4(prop_oneof![any::<f64>(), -9.0..9.0_f64]), 0..40),
        ) {
            let poses: Vec<StampedPose> = numbers
                .iter()
                .map(|&[stamp_s, x, y, theta]| StampedPose { stamp_s, pose: Pose2 { x, y, theta } })
                .filter(|stamped| stamped.stamp_s.is_finite() && stamped.pose.is_finite())
                .collect();
            prop_assert_eq!(bits(&unpack_poses(&pack_poses(&poses)).unwrap()), bits(&poses));
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let poses = unpack_poses(&bytes);
            prop_assert!(poses.is_none_or(|poses| poses.len() <= bytes.len() / 2));
        }
    }

    #[test]
    fn a_drive_takes_three_quarters_of_its_numbers_and_a_robot_that_stands_still_a_tenth() {
        let drive = round(10_000);
        assert!(pack_poses(&drive).len() < 23 * drive.len(), "{}", pack_poses(&drive).len());
        let stands: Vec<_> = drive.iter().map(|stamped| StampedPose { pose: drive[0].pose, ..*stamped }).collect();
        assert!(pack_poses(&stands).len() < 4 * stands.len(), "{}", pack_poses(&stands).len());
    }

    #[test]
    fn what_is_packed_is_what_was_pushed() {
        let (mut poses, mut log) = (round(3 * POSES_PER_BLOCK + 7), PoseLog::default());
        for (count, stamped) in poses.iter().enumerate() {
            log.push(*stamped);
            log.pack(count.saturating_sub(100));
        }
        assert_eq!((log.packed.len(), log.open.len()), (2, POSES_PER_BLOCK + 7));
        let moved = Pose2::new(1.0, 2.0, 3.0);
        for changed in [3 * POSES_PER_BLOCK, POSES_PER_BLOCK + 5] {
            poses[changed].pose = moved;
            log.set(changed, &[moved]);
            assert_eq!(log.since(0), poses);
            log.pack(usize::MAX);
        }
        for first in [0, 1, POSES_PER_BLOCK - 1, POSES_PER_BLOCK, 3 * POSES_PER_BLOCK + 6, poses.len(), poses.len() + 9]
        {
            assert_eq!(log.since(first), poses[first.min(poses.len())..]);
            assert_eq!(log.get(first), poses.get(first).copied());
        }
        assert_eq!((log.len(), log.last()), (poses.len(), poses.last().copied()));
        let blocks = (0..4).flat_map(|block| unpack_poses(&log.block(block)).unwrap());
        assert_eq!(blocks.collect::<Vec<_>>(), poses);
        log.open.clear();
        assert_eq!(log.last(), Some(poses[3 * POSES_PER_BLOCK - 1]));
    }
}
