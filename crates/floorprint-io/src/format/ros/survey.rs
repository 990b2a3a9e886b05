//! The first pass over a recording: what is in it.

use super::camera::Calibration;
use super::image::ImageHead;
use super::messages::{Kind, LaserScan, Message, decode};
use super::transforms::Transforms;
use super::{Channel, MessageSource, RawMessage};
use floorprint::survey::no_return_mark_m;
use std::collections::{BTreeMap, BTreeSet};

/// Most names of frames that are kept for a topic.
const MOST_FRAMES: usize = 16;

/// About so many scans of a topic, spread over the recording, tell which range its driver writes where nothing came back.
const KEPT_SCANS: usize = 512;

/// Fewer scans may all show the same wall before a robot at rest.
const LEAST_SCANS: usize = 100;

/// Of a robot at rest a gyro may say nothing for a while, seconds.
const REST_S: f64 = 10.0;

/// What a scan states of its rays contradicts itself from this share of its field of view on; drivers count one ray too many
/// or too few.
const CONTRADICTORY_SHARE: f64 = 0.05;

/// What is in a recording.
#[derive(Default)]
pub(super) struct Survey {
    /// By name.
    pub(super) topics: BTreeMap<String, Topic>,
    /// Of all namespaces, until [`leave_one_robot`](Self::leave_one_robot).
    pub(super) transforms: Transforms,
    /// The same by what is before `tf` and `tf_static` in the topics' names.
    by_namespace: BTreeMap<String, Transforms>,
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
    /// Frames in which its numbers are, and in how many messages.
    pub(super) frames: BTreeMap<String, usize>,
    /// Frames whose poses it states.
    pub(super) children: BTreeSet<String>,
    pub(super) rays: Rays,
    /// Of a topic of IMUs: whether any reading says that it turns.
    pub(super) turns: bool,
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
    /// The widest field of view of a scan, radians.
    pub(super) field_of_view_rad: f64,
    /// Scans that state two fields of view, and the first of them: by the rays' number and distance, and by the angles of the
    /// first and the last ray, radians.
    pub(super) contradictory: (usize, Option<[f64; 2]>),
    /// Ranges of every so many scans, metres.
    kept_m: Vec<Vec<f32>>,
    scans: usize,
    kept_each: usize,
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
                let namespace = namespace_of(name);
                if !self.by_namespace.contains_key(namespace) {
                    self.by_namespace.insert(namespace.to_owned(), Transforms::default());
                }
                let Some(of_namespace) = self.by_namespace.get_mut(namespace) else { return };
                for sample in &samples {
                    for transforms in [&mut self.transforms, of_namespace] {
                        transforms.add(sample, is_static, message.log_time_s - sample.stamp_s);
                    }
                }
            }
            Some(decoded) => topic.add(&decoded, message.log_time_s),
            None => topic.undecodable += 1,
        }
    }
}

impl Survey {
    /// Leaves the topics and transforms of one robot where several, each with a namespace and transforms of its own, say different
    /// things of frames of the same names: of the one of which something is `wanted`, else of the first that has scans, the one
    /// without a namespace before the others. Gives the namespaces of the others.
    pub(super) fn leave_one_robot(&mut self, wanted: &[&str]) -> Vec<String> {
        let contradicts = |(name, transforms): &(&String, &Transforms)| {
            self.by_namespace.iter().any(|(other, others)| other != *name && transforms.contradicts(others))
        };
        let robots: Vec<String> = self.by_namespace.iter().filter(contradicts).map(|(name, _)| name.clone()).collect();
        let bare = |name: &str| name.trim_start_matches('/').to_owned();
        // The longest namespace that a topic's name begins with.
        let robot_of = |topic: &str| {
            let begins_so = robots.iter().filter(|robot| bare(topic).starts_with(&bare(robot)));
            begins_so.max_by_key(|robot| robot.len())
        };
        let of_wanted = wanted.iter().find_map(|topic| robot_of(topic));
        let with_scans = || {
            let has_scans = |topic: &Topic| topic.kind.is_some_and(Kind::is_scan) && topic.usable() > 0;
            self.topics.iter().filter(|(_, topic)| has_scans(topic)).filter_map(|(name, _)| robot_of(name)).min()
        };
        let Some(chosen) = of_wanted.or_else(with_scans).or(robots.first()).cloned() else { return Vec::new() };
        let of_others: Vec<String> =
            self.topics.keys().filter(|name| robot_of(name).is_some_and(|robot| *robot != chosen)).cloned().collect();
        let mut by_namespace = std::mem::take(&mut self.by_namespace);
        self.transforms = by_namespace.remove(&chosen).unwrap_or_default();
        for (name, transforms) in by_namespace {
            // What is said without a namespace may be said for all.
            if bare(&name).is_empty() || !robots.contains(&name) {
                self.transforms.add_unknown(transforms);
            }
        }
        for name in of_others {
            if let Some(topic) = self.topics.get_mut(&name) {
                topic.kind = None;
            }
        }
        robots.into_iter().filter(|robot| *robot != chosen).collect()
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
            frames: BTreeMap::new(),
            children: BTreeSet::new(),
            rays: Rays::default(),
            turns: false,
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
            Message::Imu(reading) => {
                self.turns |= reading.angular_velocity_rad_s.iter().any(|rate| *rate != 0.0);
                (reading.stamp_s, &reading.frame)
            }
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
        if let Some(messages) = self.frames.get_mut(frame) {
            *messages += 1;
        } else if self.frames.len() < MOST_FRAMES {
            self.frames.insert(frame.clone(), 1);
        }
        self.stamps_s.push(stamp_s);
        self.delay_sum_s += log_time_s - stamp_s;
    }

    /// Whether it is certain that a topic of an IMU has no gyro: for long it never says that anything turns.
    pub(super) fn has_no_gyro(&self) -> bool {
        !self.turns && self.log_span_s[1] - self.log_span_s[0] > REST_S
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

    /// Whether the headers' stamps go on as times do. Messages may be recorded twice, or be of two sensors that measure at the
    /// same times.
    pub(super) fn stamps_advance(&self) -> bool {
        let steps = self.stamps_s.len().saturating_sub(1);
        let advances = self.stamps_s.windows(2).filter(|pair| pair[1] > pair[0]).count();
        steps == 0 || 3 * advances > steps
    }

    /// The frame of most of its messages; of several the first by name.
    pub(super) fn frame(&self) -> &str {
        self.frames.iter().rev().max_by_key(|(_, messages)| **messages).map_or("", |(name, _)| name)
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
        self.keep(&scan.ranges_m);
        let steps = scan.ranges_m.len().saturating_sub(1) as f64;
        let [made_rad, stated_rad] = [scan.angle_increment_rad * steps, scan.angle_max_rad - scan.angle_min_rad];
        self.field_of_view_rad = self.field_of_view_rad.max(made_rad.abs());
        let allowed_rad = (CONTRADICTORY_SHARE * stated_rad.abs()).max(2.0 * scan.angle_increment_rad.abs());
        if steps > 0.0 && (made_rad - stated_rad).abs() > allowed_rad {
            self.contradictory.0 += 1;
            self.contradictory.1.get_or_insert([made_rad, stated_rad]);
        }
        let turn_share = scan.angle_increment_rad.abs() / std::f64::consts::TAU;
        // Drivers that do not state the time from ray to ray may state that of a turn.
        let step_s = if scan.time_increment_s == 0.0 { scan.scan_time_s * turn_share } else { scan.time_increment_s };
        self.sweeps_s.push(step_s * steps);
    }

    /// Keeps a scan's ranges, or not: of a long recording fewer.
    fn keep(&mut self, ranges_m: &[f32]) {
        let each = self.kept_each.max(1);
        if self.scans.is_multiple_of(each) {
            self.kept_m.push(ranges_m.to_vec());
        }
        self.scans += 1;
        if self.kept_m.len() == 2 * KEPT_SCANS {
            let mut number = 0;
            self.kept_m.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.kept_each = 2 * each;
        }
    }

    /// The range from which on readings mean that nothing came back, metres, where the driver writes one within the range that
    /// it states, and nothing beyond.
    pub(super) fn no_return_mark_m(&self) -> Option<f32> {
        if self.scans < LEAST_SCANS {
            return None;
        }
        let readings_m = || self.kept_m.iter().flatten().copied().filter(|range_m| range_m.is_finite());
        if self.beyond > 0 { None } else { no_return_mark_m(readings_m) }
    }

    /// Whether a range of 0 stands for "nothing came back": where nothing else does.
    pub(super) fn zero_means_no_return(&self) -> bool {
        self.zeros > 0 && self.beyond == 0
    }
}

/// What is before `tf` and `tf_static` in the name of a topic of transforms.
pub(super) fn namespace_of(topic: &str) -> &str {
    topic.strip_suffix("tf_static").or(topic.strip_suffix("tf")).unwrap_or_default()
}

fn note(names: &mut BTreeSet<String>, name: &str) {
    if names.len() < MOST_FRAMES && !names.contains(name) {
        names.insert(name.to_owned());
    }
}
