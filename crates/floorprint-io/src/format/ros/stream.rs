//! Messages of ROS 2 as they come in live: looked at for a while, then turned into records as a recording's are.

use super::messages::{Kind, Message, decode};
use super::record_maker::RecordMaker;
use super::roles::Roles;
use super::survey::Survey;
use super::{Channel, Encoding, RawMessage, bag};
use crate::data_set::{RoleChoice, TopicChoice};
use crate::error::ReadError;
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, RobotConfig};
use std::path::Path;

/// Messages are looked at for so long after the first scan, as they come, seconds: wheels, IMU and transforms have spoken then.
const LOOK_S: f64 = 2.0;
/// Where the LiDAR sits may take longer to be known, seconds.
const LONGEST_LOOK_S: f64 = 6.0;

/// Turns messages into records.
///
/// First it is found out, as for recordings, who plays which role and where the sensors sit; the messages that came
/// meanwhile are not lost.
pub struct MessageStream {
    choice: TopicChoice,
    channels: Vec<Channel>,
    survey: Survey,
    /// Channel, time and bytes of the messages that wait for the roles.
    waiting: Vec<(usize, f64, Vec<u8>)>,
    first_scan_s: Option<f64>,
    roles: Option<(Roles, RecordMaker)>,
}

impl MessageStream {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(choice: TopicChoice) -> Self {
        Self {
            choice,
            channels: Vec::new(),
            survey: Survey::default(),
            waiting: Vec::new(),
            first_scan_s: None,
            roles: None,
        }
    }

    /// Adds a topic and gives its number; the type is `package/msg/Type`.
    pub fn add_topic(&mut self, topic: &str, type_name: &str) -> usize {
        let channel = Channel { topic: topic.to_owned(), type_name: type_name.to_owned(), encoding: Encoding::Cdr };
        self.channels.push(channel);
        self.channels.len() - 1
    }

    /// Takes a message that came at a time (seconds, of any clock) and gives its records: none as long as roles are open.
    pub fn take(&mut self, topic: usize, time_s: f64, cdr: &[u8]) -> Vec<Record> {
        let mut records = Vec::new();
        let Some(channel) = self.channels.get(topic) else { return records };
        // Images would have to be kept until the floor is painted.
        if matches!(Kind::of(&channel.type_name), Some(Kind::Image | Kind::CompressedImage)) {
            return records;
        }
        let message = RawMessage { channel, log_time_s: time_s, bytes: cdr };
        match &mut self.roles {
            Some((roles, maker)) => maker.take(roles, &message, &mut records),
            None => {
                let is_scan = matches!(Kind::of(&channel.type_name), Some(Kind::LaserScan | Kind::PointCloud2));
                if is_scan {
                    self.first_scan_s.get_or_insert(time_s);
                }
                // Before the first scan nothing matters but where things sit.
                if self.first_scan_s.is_none() && !channel.topic.ends_with("tf_static") {
                    return records;
                }
                self.survey.add(&message);
                self.waiting.push((topic, time_s, cdr.to_vec()));
            }
        }
        records
    }

    /// Whether enough was seen by a time (seconds) to give out roles.
    #[must_use]
    pub fn has_seen_enough(&self, time_s: f64) -> bool {
        let Some(first_scan_s) = self.first_scan_s else { return false };
        let looked_s = time_s - first_scan_s;
        looked_s >= LONGEST_LOOK_S || (looked_s >= LOOK_S && self.places_are_known())
    }

    fn places_are_known(&self) -> bool {
        Roles::choose(&self.survey, &self.choice).is_ok_and(|roles| roles.all_places_known)
    }

    /// Gives out the roles: the robot as they say it is, notes for the user, and the records of what came meanwhile.
    ///
    /// # Errors
    /// When what was asked for is not there.
    pub fn decide(&mut self) -> Result<Decision, ReadError> {
        let mut roles = Roles::of_one_robot(&mut self.survey, &self.choice)
            .map_err(|unfulfilled| unfulfilled.at(Path::new("ROS 2")))?;
        let mut maker = RecordMaker::new();
        let mut records = Vec::new();
        for (topic, time_s, cdr) in std::mem::take(&mut self.waiting) {
            if let Some(channel) = self.channels.get(topic) {
                let message = RawMessage { channel, log_time_s: time_s, bytes: &cdr };
                maker.take(&roles, &message, &mut records);
            }
        }
        let notes = std::mem::take(&mut roles.notes);
        let reasons = std::mem::take(&mut roles.reasons).into_iter();
        let reasons = reasons.map(|reason| RoleChoice { role: reason.role, what: reason.what, reason: reason.why });
        let decision = Decision {
            robot: bag::robot(&roles),
            base: roles.base.clone(),
            reasons: reasons.collect(),
            notes,
            records,
        };
        self.survey = Survey::default();
        self.roles = Some((roles, maker));
        Ok(decision)
    }
}

/// Who plays which role.
#[derive(Debug)]
pub struct Decision {
    /// The robot's calibration.
    pub robot: RobotConfig,
    /// The frame of its body.
    pub base: String,
    /// Why.
    pub reasons: Vec<RoleChoice>,
    /// What the user ought to know.
    pub notes: Vec<String>,
    /// The records of all that came before.
    pub records: Vec<Record>,
}

/// The pose of a `geometry_msgs/PoseWithCovarianceStamped` or `PoseStamped` in CDR, and its frame; `None` of anything else.
#[must_use]
pub fn pose_of(cdr: &[u8]) -> Option<(String, Pose2)> {
    let channel = Channel {
        topic: String::new(),
        type_name: "geometry_msgs/msg/PoseWithCovarianceStamped".to_owned(),
        encoding: Encoding::Cdr,
    };
    match decode(Kind::PoseWithCovarianceStamped, &channel, cdr)? {
        Message::Pose(placed) => Some((placed.parent, placed.pose.in_plane())),
        _ => None,
    }
}
