//! Scans that wait for their turn: each LiDAR's in the order in which they came, several LiDARs by their stamps.

use super::stamp_filter::StampFilter;
use super::summary::Dropped;
use crate::SensorId;
use crate::sensors::{Ray, Scan};
use std::collections::VecDeque;

/// A scan is taken to repeat one of so many before it when stamp and ranges are the same.
const REMEMBERED: usize = 4;
/// Of each LiDAR no more scans than this wait, whatever their stamps say.
pub(super) const MOST_WAITING: usize = 1024;

/// A scan with its place in time.
#[derive(Debug)]
pub(super) struct Waiting {
    /// Its stamp, or the latest of its LiDAR before it where its own runs backwards or is not to be believed, seconds.
    pub(super) key_s: f64,
    /// The scan; `None` where it cannot be used: it takes a number only.
    pub(super) scan: Option<Scan>,
}

/// What a scan waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wait {
    /// A scan of another LiDAR may come before it.
    ForOtherLidars,
    /// Nothing but odometry.
    ForOdometry,
    /// Nothing any more: too many scans wait behind it.
    TooLong,
}

/// The scans of all LiDARs.
#[derive(Debug)]
pub(super) struct ScanQueue {
    lidars: Vec<Lidar>,
}

#[derive(Debug)]
struct Lidar {
    sensor: SensorId,
    filter: StampFilter<(f64, Option<Scan>)>,
    /// The latest stamp so far, seconds.
    reached_s: Option<f64>,
    waiting: VecDeque<Waiting>,
    /// Stamps and fingerprints of the last scans.
    remembered: VecDeque<(u64, u64)>,
}

impl ScanQueue {
    /// Queues of the robot's LiDARs.
    pub(super) fn new(lidars: usize) -> Self {
        Self {
            lidars: (0..lidars)
                .map_while(|number| u8::try_from(number).ok())
                .map(|id| Lidar::new(SensorId(id)))
                .collect(),
        }
    }

    /// Takes in a LiDAR's next scan while it is `clock_s` (seconds) by all sensors. Gives the latest stamp that is to be
    /// believed now, seconds.
    pub(super) fn push(&mut self, scan: Scan, clock_s: f64, dropped: &mut Dropped) -> Option<f64> {
        let position = self.lidars.iter().position(|lidar| lidar.sensor == scan.sensor).unwrap_or_else(|| {
            self.lidars.push(Lidar::new(scan.sensor));
            self.lidars.len() - 1
        });
        self.lidars[position].push(scan, clock_s, dropped)
    }

    /// Takes in the scans whose stamps are still in question; nothing else comes.
    pub(super) fn finish(&mut self) {
        for lidar in &mut self.lidars {
            if let Some(held) = lidar.filter.finish() {
                lidar.enqueue(held, true);
            }
        }
    }

    /// The scan whose turn is next with the number of its queue, and what it waits for when all that happened until
    /// `known_s` (seconds) has arrived.
    pub(super) fn front(&self, known_s: f64) -> Option<(usize, &Waiting, Wait)> {
        let fronts = self.lidars.iter().enumerate().filter_map(|(index, lidar)| Some((index, lidar.waiting.front()?)));
        let (index, front) = fronts.min_by(|(_, a), (_, b)| a.key_s.total_cmp(&b.key_s))?;
        let passed = |lidar: &Lidar| lidar.reached_s.is_some_and(|reached_s| reached_s >= front.key_s);
        let wait = if self.lidars[index].waiting.len() > MOST_WAITING {
            Wait::TooLong
        } else if known_s >= front.key_s || self.lidars.iter().all(|lidar| !lidar.waiting.is_empty() || passed(lidar)) {
            Wait::ForOdometry
        } else {
            Wait::ForOtherLidars
        };
        Some((index, front, wait))
    }

    /// Takes out a scan that [`front`](Self::front) found.
    pub(super) fn pop(&mut self, index: usize) -> Option<Waiting> {
        self.lidars[index].waiting.pop_front()
    }

    /// Number of scans that wait.
    pub(super) fn len(&self) -> usize {
        self.lidars.iter().map(|lidar| lidar.waiting.len()).sum()
    }
}

impl Lidar {
    fn new(sensor: SensorId) -> Self {
        Self {
            sensor,
            filter: StampFilter::default(),
            reached_s: None,
            waiting: VecDeque::new(),
            remembered: VecDeque::new(),
        }
    }

    fn push(&mut self, scan: Scan, clock_s: f64, dropped: &mut Dropped) -> Option<f64> {
        let stamp_s = scan.stamp_s;
        let scan = self.is_usable(&scan, dropped).then_some(scan);
        if !stamp_s.is_finite() {
            self.enqueue((stamp_s, None), false);
            return None;
        }
        let judged = self.filter.push(stamp_s, (stamp_s, scan), clock_s).into_iter().flatten();
        judged.filter_map(|(held, is_believed)| self.enqueue(held, is_believed)).last()
    }

    /// Puts a scan at the queue's end; gives its stamp where that is to be believed.
    fn enqueue(&mut self, (stamp_s, scan): (f64, Option<Scan>), is_believed: bool) -> Option<f64> {
        if is_believed {
            self.reached_s = Some(self.reached_s.map_or(stamp_s, |reached_s| reached_s.max(stamp_s)));
        }
        self.waiting.push_back(Waiting { key_s: self.reached_s.unwrap_or(f64::NEG_INFINITY), scan });
        is_believed.then_some(stamp_s)
    }

    /// Whether a scan can become a frame; counts why not.
    fn is_usable(&mut self, scan: &Scan, dropped: &mut Dropped) -> bool {
        let counter = if !scan.stamp_s.is_finite() {
            &mut dropped.scans_without_stamp
        } else if scan.ranges_m.len() != scan.geometry.len() {
            &mut dropped.scans_of_wrong_length
        } else if !says_something(scan) {
            &mut dropped.scans_without_valid_ray
        } else {
            let fingerprint = (scan.stamp_s.to_bits(), fingerprint(&scan.ranges_m));
            if !self.remembered.contains(&fingerprint) {
                self.remembered.push_back(fingerprint);
                if self.remembered.len() > REMEMBERED {
                    self.remembered.pop_front();
                }
                return true;
            }
            &mut dropped.scans_repeated
        };
        *counter += 1;
        false
    }
}

/// Whether a scan can become a frame, unless it comes twice.
pub(crate) fn is_complete(scan: &Scan) -> bool {
    scan.stamp_s.is_finite() && scan.ranges_m.len() == scan.geometry.len() && says_something(scan)
}

/// Whether any ray says something: a hit, or that nothing came back.
fn says_something(scan: &Scan) -> bool {
    scan.ranges_m.iter().any(|&range_m| scan.geometry.classify(range_m) != Ray::Invalid)
}

/// FNV-1a over the ranges' bits.
fn fingerprint(ranges_m: &[f32]) -> u64 {
    ranges_m.iter().fold(0xcbf2_9ce4_8422_2325, |hash, range_m| {
        (hash ^ u64::from(range_m.to_bits())).wrapping_mul(0x0100_0000_01b3)
    })
}
