//! The first pass over a recording: what is in it.

use super::camera::Calibration;
use super::image::ImageHead;
use super::messages::{Kind, LaserScan, Message, decode};
use super::transforms::Transforms;
use super::{Channel, MessageSource, RawMessage};
use std::collections::{BTreeMap, BTreeSet};

/// Most names of frames that are kept for a topic.
const MOST_FRAMES: usize = 16;

/// What is in a recording.
#[derive(Default)]
pub(super) struct Survey {
    /// By name.
    pub(super) topics: BTreeMap<String, Topic>,
    pub(super) transforms: Transforms,
}

/// What is on a topic.
pub(super) struct Topic {
    pub(super) type_name: String,
    pub(super) encoding: String,
    /// What its messages say; `None` for types that do not matter.
    pub(super) kind: Option<Kind>,
    pub(super) messages: usize,
    /// Messages that are not what their type says.
    pub(super) undecodable: usize,
    /// When the first and the last message were recorded, seconds.
    pub(super) log_span_s: [f64; 2],
    /// The stamps of the headers, in order, seconds.
    pub(super) stamps_s: Vec<f64>,
    /// By how much messages were recorded after their stamps, in all, seconds.
    delay_sum_s: f64,
    /// Frames in which its numbers are.
    pub(super) frames: BTreeSet<String>,
    /// Frames whose poses it states.
    pub(super) children: BTreeSet<String>,
    pub(super) rays: Rays,
    /// Of a topic of images: the first, without its pixels.
    pub(super) image: Option<ImageHead>,
    /// Names of joints whose angles it states.
    pub(super) joints: BTreeSet<String>,
    /// Of a topic of intrinsics: the first.
    pub(super) calibration: Option<Calibration>,
}

/// What a topic's rays say.
#[derive(Default)]
pub(super) struct Rays {
    pub(super) hits: usize,
    /// Ranges of exactly 0.
    pub(super) zeros: usize,
    /// Ranges that are infinite or at the longest range.
    pub(super) beyond: usize,
    /// Rays of the longest scan.
    pub(super) per_scan: usize,
    /// From the first ray to the last of each scan as it is stated, seconds.
    sweeps_s: Vec<f64>,
}

impl Survey {
    /// Reads all messages.
    pub(super) fn of(messages: &mut dyn MessageSource) -> Self {
        let mut survey = Self::default();
        while messages.advance() {
            if let Some(message) = messages.message() {
                survey.add(&message);
            }
        }
        survey
    }

    /// Looks at one message.
    pub(super) fn add(&mut self, message: &RawMessage<'_>) {
        let Channel { topic: name, type_name, .. } = message.channel;
        if !self.topics.contains_key(name) {
            self.topics.insert(name.clone(), Topic::new(message));
        }
        let Some(topic) = self.topics.get_mut(name) else { return };
        topic.messages += 1;
        topic.log_span_s[1] = message.log_time_s;
        let Some(kind) = Kind::of(type_name) else { return };
        match decode(kind, message.channel, message.bytes) {
            Some(Message::Transforms(samples)) => {
                let is_static = name.ends_with("tf_static");
                for sample in &samples {
                    self.transforms.add(sample, is_static);
                }
            }
            Some(decoded) => topic.add(&decoded, message.log_time_s),
            None => topic.undecodable += 1,
        }
    }
}

impl Topic {
    fn new(message: &RawMessage<'_>) -> Self {
        Self {
            type_name: message.channel.type_name.clone(),
            encoding: message.channel.encoding.name().to_owned(),
            kind: Kind::of(&message.channel.type_name),
            messages: 0,
            undecodable: 0,
            log_span_s: [message.log_time_s; 2],
            stamps_s: Vec::new(),
            delay_sum_s: 0.0,
            frames: BTreeSet::new(),
            children: BTreeSet::new(),
            rays: Rays::default(),
            image: None,
            joints: BTreeSet::new(),
            calibration: None,
        }
    }

    fn add(&mut self, message: &Message, log_time_s: f64) {
        let (stamp_s, frame) = match message {
            Message::Scan(scan) => {
                self.rays.add(scan);
                (scan.stamp_s, &scan.frame)
            }
            Message::Cloud(cloud) => {
                self.rays.hits += cloud.points_m.len();
                (cloud.stamp_s, &cloud.frame)
            }
            Message::Odometry(placed) | Message::Pose(placed) => {
                note(&mut self.children, &placed.child);
                (placed.stamp_s, &placed.parent)
            }
            Message::Imu(reading) => (reading.stamp_s, &reading.frame),
            Message::Image(head) => {
                if self.image.is_none() {
                    self.image = Some(head.clone());
                }
                (head.stamp_s, &head.frame)
            }
            Message::Calibration(calibration) => {
                if self.calibration.is_none() {
                    self.calibration = Some(calibration.clone());
                }
                (calibration.stamp_s, &calibration.frame)
            }
            Message::Joints(joints) => {
                joints.names.iter().for_each(|name| note(&mut self.joints, name));
                self.stamps_s.push(joints.stamp_s);
                self.delay_sum_s += log_time_s - joints.stamp_s;
                return;
            }
            Message::Transforms(_) => return,
        };
        note(&mut self.frames, frame);
        self.stamps_s.push(stamp_s);
        self.delay_sum_s += log_time_s - stamp_s;
    }

    /// Messages that can be used.
    pub(super) fn usable(&self) -> usize {
        self.stamps_s.len()
    }

    /// Messages a second, as they were recorded.
    pub(super) fn rate_hz(&self) -> f64 {
        let [first_s, last_s] = self.log_span_s;
        let steps = self.messages.saturating_sub(1) as f64;
        if last_s > first_s { steps / (last_s - first_s) } else { 0.0 }
    }

    /// By how much messages were recorded after their stamps on the average, seconds.
    pub(super) fn delay_s(&self) -> f64 {
        self.delay_sum_s / self.stamps_s.len().max(1) as f64
    }

    /// Whether the headers' stamps go on as times do.
    pub(super) fn stamps_advance(&self) -> bool {
        let steps = self.stamps_s.len().saturating_sub(1);
        let advances = self.stamps_s.windows(2).filter(|pair| pair[1] > pair[0]).count();
        steps == 0 || 2 * advances > steps
    }

    /// The frame of its messages; the first by name where there are several.
    pub(super) fn frame(&self) -> &str {
        self.frames.iter().next().map_or("", String::as_str)
    }

    /// From the first ray of a scan to the last, seconds, where the messages state what can be: no sweep takes
    /// longer than the time between two scans. 0 where they do not.
    pub(super) fn sweep_s(&self) -> f64 {
        let median = |mut values: Vec<f64>| {
            let middle = values.len() / 2;
            (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
        };
        let stated_s = median(self.rays.sweeps_s.clone()).unwrap_or(0.0);
        let intervals = self.stamps_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
        let interval_s = median(intervals).unwrap_or(f64::INFINITY);
        if stated_s.is_finite() && stated_s.abs() <= 1.1 * interval_s { stated_s } else { 0.0 }
    }
}

impl Rays {
    fn add(&mut self, scan: &LaserScan) {
        let longest_m = if scan.range_max_m > 0.0 { scan.range_max_m } else { f32::INFINITY };
        for &range_m in &scan.ranges_m {
            self.zeros += usize::from(range_m == 0.0);
            self.beyond += usize::from(range_m >= longest_m);
            self.hits += usize::from(range_m > 0.0 && range_m >= scan.range_min_m && range_m < longest_m);
        }
        self.per_scan = self.per_scan.max(scan.ranges_m.len());
        let steps = scan.ranges_m.len().saturating_sub(1) as f64;
        let turn_share = scan.angle_increment_rad.abs() / std::f64::consts::TAU;
        // Drivers that do not state the time from ray to ray may state that of a turn.
        let step_s = if scan.time_increment_s == 0.0 { scan.scan_time_s * turn_share } else { scan.time_increment_s };
        self.sweeps_s.push(step_s * steps);
    }

    /// Whether a range of 0 stands for "nothing came back": where nothing else does.
    pub(super) fn zero_means_no_return(&self) -> bool {
        self.zeros > 0 && self.beyond == 0
    }
}

fn note(names: &mut BTreeSet<String>, name: &str) {
    if names.len() < MOST_FRAMES && !names.contains(name) {
        names.insert(name.to_owned());
    }
}
