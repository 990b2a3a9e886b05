//! Options of the node of ROS 2, and the node as a source.

use crate::interrupt::Interrupt;
use crate::number::number;
use crate::outcome::BadArguments;
use crate::terminal::Terminal;
use crate::topics::Topics;
use clap::Args;
use floorprint::localization::Start;
use floorprint::sensors::RobotConfig;
use floorprint_io::ros::{Decision, MessageStream, pose_of};
use floorprint_live::ros2::{Incoming, Listener, Node, Options};
use floorprint_live::{Board, FrameNames, Inbox};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// How the network is listened to for an end of the session.
const PATIENCE: Duration = Duration::from_millis(100);
/// What is waited for is told once after so long, seconds.
const TOLD_AFTER_S: f64 = 3.0;

/// The node of ROS 2. Names of topics that do not begin with a slash lie in the namespace.
#[derive(Args, Clone, Debug)]
pub(crate) struct Ros {
    /// Be a node of ROS 2: take scans, odometry, IMU and transforms, give map, pose and map→odom. ROS need not be installed.
    #[arg(long)]
    pub(crate) ros2: bool,
    /// Number of the network [default: ROS_DOMAIN_ID, else 0].
    #[arg(long, value_name = "N", requires = "ros2", value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
    /// Namespace of the node.
    #[arg(long, value_name = "NAME", default_value = "/", requires = "ros2")]
    namespace: String,
    /// Name of the node; services are below it.
    #[arg(long, value_name = "NAME", default_value = "floorprint", requires = "ros2")]
    node_name: String,
    /// Topic of the IMU.
    #[arg(long, value_name = "TOPIC", default_value = "imu", requires = "ros2")]
    imu: String,
    /// Topic of the map; patches come on TOPIC_updates.
    #[arg(long, value_name = "TOPIC", default_value = "map", requires = "ros2")]
    map_topic: String,
    /// Frame of the map.
    #[arg(long, value_name = "FRAME", default_value = "map", requires = "ros2")]
    map_frame: String,
    /// Frame of the odometry.
    #[arg(long, value_name = "FRAME", default_value = "odom", requires = "ros2")]
    odom_frame: String,
    /// By how much map→odom is stamped into the future, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.2, requires = "ros2", value_parser = number(0.0, 10.0))]
    transform_timeout: f64,
    /// Shortest time between two whole maps, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, requires = "ros2", value_parser = number(0.1, 3600.0))]
    map_update_interval: f64,
    /// Folder in which the service save_map saves.
    #[arg(long, value_name = "DIR", default_value = ".", requires = "ros2")]
    save_to: PathBuf,
}

impl Ros {
    fn options(&self, topics: &Topics) -> anyhow::Result<Options> {
        let domain = match (self.domain, std::env::var("ROS_DOMAIN_ID")) {
            (Some(domain), _) => domain,
            (None, Ok(text)) if !text.is_empty() => text
                .parse()
                .map_err(|_| BadArguments(format!("ROS_DOMAIN_ID is {text}; expected a number from 0 to 232")))?,
            (None, _) => 0,
        };
        let choice = topics.open_options(None, None).topics;
        let or = |chosen: Vec<String>, usual: &str| if chosen.is_empty() { vec![usual.to_owned()] } else { chosen };
        Ok(Options {
            domain,
            namespace: self.namespace.clone(),
            name: self.node_name.clone(),
            scan_topics: or(choice.scans, "scan"),
            odom_topic: choice.odometry.unwrap_or_else(|| "odom".to_owned()),
            imu_topic: self.imu.clone(),
            map_topic: self.map_topic.clone(),
            map_frame: self.map_frame.clone(),
            odom_frame: self.odom_frame.clone(),
            transform_timeout: Duration::from_secs_f64(self.transform_timeout),
            map_update_interval: Duration::from_secs_f64(self.map_update_interval),
            save_to: self.save_to.clone(),
        })
    }
}

/// The network as a source.
pub(super) struct RosSource {
    node: Node,
    listener: Listener,
    stream: MessageStream,
    decision: Decision,
    terminal: Terminal,
}

impl RosSource {
    /// Joins the network and waits until it is known what comes from where; `None` where the user does not want to wait.
    pub(super) fn open(
        ros: &Ros,
        topics: &Topics,
        interrupt: &Interrupt,
        terminal: &Terminal,
    ) -> anyhow::Result<Option<Self>> {
        let options = ros.options(topics)?;
        let mut choice = topics.open_options(None, None).topics;
        for topic in choice.scans.iter_mut().chain(&mut choice.odometry) {
            *topic = options.full_name(topic);
        }
        let mut node = Node::new(options)?;
        let listener = node.listen()?;
        let mut stream = MessageStream::new(choice);
        listener.register(&mut stream);
        let (mut has_told, mut has_begun) = (false, false);
        while !stream.has_seen_enough(listener.time_s()) {
            if interrupt.requested() {
                return Ok(None);
            }
            if let Some(Incoming { topic: Some(topic), time_s, cdr }) = listener.next(PATIENCE) {
                stream.take(topic, time_s, &cdr);
                has_begun = true;
            }
            if !has_told && listener.time_s() > TOLD_AFTER_S {
                has_told = true;
                let scans = node.options().scan_topics.join(", ");
                let heard = if has_begun { "other messages come" } else { "nothing comes yet" };
                terminal.say(&format!("waiting for scans on {scans} in domain {} ({heard})", node.options().domain));
            }
        }
        let decision = stream.decide()?;
        for reason in &decision.reasons {
            terminal.say(&format!("{}: {} ({})", reason.role, reason.what, reason.reason));
        }
        decision.notes.iter().for_each(|note| terminal.note(note));
        Ok(Some(Self { node, listener, stream, decision, terminal: terminal.clone() }))
    }

    pub(super) fn robot(&self) -> &RobotConfig {
        &self.decision.robot
    }

    /// What frames are called in the network, else as usual.
    pub(super) fn frames(&self, usual: FrameNames) -> FrameNames {
        let Options { map_frame, odom_frame, .. } = self.node.options().clone();
        let base = if self.decision.base.is_empty() { usual.base } else { self.decision.base.clone() };
        FrameNames { map: map_frame, odom: odom_frame, base, lidars: usual.lidars }
    }

    /// Begins to publish; the robot's body is called `base_frame`.
    pub(super) fn announce(&mut self, board: &Arc<Board>, base_frame: &str) -> anyhow::Result<()> {
        Ok(self.node.announce(board, base_frame)?)
    }

    /// Puts what comes into the inbox until the session is to end.
    pub(super) fn feed(mut self, inbox: &Inbox, interrupt: &Interrupt) {
        // What came while roles were open comes in one burst, of which nothing is to be lost.
        for record in std::mem::take(&mut self.decision.records) {
            if !inbox.send(record) {
                return;
            }
        }
        while !interrupt.requested() {
            if let Some(topic) = self.listener.next_crowded() {
                self.terminal.warn(&format!(
                    "several nodes publish on {topic}: only the first one is listened to, until it falls silent"
                ));
            }
            match self.listener.next(PATIENCE) {
                Some(Incoming { topic: Some(topic), time_s, cdr }) => {
                    self.stream.take(topic, time_s, &cdr).into_iter().for_each(|record| inbox.offer(record));
                }
                Some(Incoming { topic: None, cdr, .. }) => {
                    if let Some((_, pose)) = pose_of(&cdr) {
                        inbox.set_start(Start::At(pose));
                    }
                }
                None => {}
            }
        }
    }
}
