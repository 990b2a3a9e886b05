//! The node: its place in the network, and all that lives as long as it does.

use super::announcer::Announcer;
use super::listener::Listener;
use super::options::Options;
use super::raw_message::RawMessage;
use super::service::Service;
use super::services;
use crate::board::Board;
use floorprint_io::ros::Message;
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::{
    Context, ContextOptions, MessageTypeName, Name, NodeName, NodeOptions, Publisher, Subscription,
    dds::rustdds::{Topic, TopicKind},
};
use std::fmt::Display;
use std::sync::Arc;
use std::thread;
use thiserror::Error;

/// Why there is no node.
#[derive(Debug, Error)]
#[error("ROS 2: {0}")]
pub struct NodeError(String);

impl NodeError {
    pub(super) fn of(what: &str, error: impl Display) -> Self {
        Self(format!("{what}: {error}"))
    }
}

/// A node of ROS 2.
pub struct Node {
    pub(super) node: ros2_client::Node,
    context: Context,
    options: Options,
}

impl Node {
    /// Joins the network.
    ///
    /// # Errors
    /// When there is no network, or a name is none of ROS.
    pub fn new(options: Options) -> Result<Self, NodeError> {
        let context = Context::with_options(ContextOptions::new().domain_id(options.domain))
            .map_err(|error| NodeError::of("the network cannot be joined", error))?;
        let name = NodeName::new(&options.namespace, &options.name)
            .map_err(|error| NodeError::of(&format!("{}/{}", options.namespace, options.name), format!("{error:?}")))?;
        let node_options = NodeOptions::new().enable_rosout(false);
        let mut node =
            context.new_node(name, node_options).map_err(|error| NodeError::of("no node", format!("{error:?}")))?;
        let spinner = node.spinner().map_err(|error| NodeError::of("no node", error))?;
        // It answers what other nodes ask of every node.
        let spin = move || _ = futures::executor::block_on(spinner.spin());
        thread::Builder::new()
            .name("ros2-spin".to_owned())
            .spawn(spin)
            .map_err(|error| NodeError::of("no thread", error))?;
        Ok(Self { node, context, options })
    }

    /// What it is called and listens to.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Begins to listen.
    ///
    /// # Errors
    /// When a name is none of ROS.
    pub fn listen(&mut self) -> Result<Listener, NodeError> {
        Listener::new(self)
    }

    /// Begins to publish what is on the board, and to answer services. `base_frame` is the robot's body.
    ///
    /// # Errors
    /// When a name is none of ROS.
    pub fn announce(&mut self, board: &Arc<Board>, base_frame: &str) -> Result<(), NodeError> {
        services::serve(self, board)?;
        Announcer::start(self, board, base_frame)
    }

    pub(super) fn subscribe(
        &mut self,
        topic: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Subscription<RawMessage>, NodeError> {
        let topic = self.topic(topic, type_name, qos)?;
        self.node
            .create_subscription(&topic, Some(qos.clone()))
            .map_err(|error| NodeError::of("no subscription", error))
    }

    pub(super) fn publisher<M: Message>(
        &mut self,
        topic: &str,
        qos: &QosProfile,
    ) -> Result<Publisher<RawMessage>, NodeError> {
        let topic = self.topic(topic, M::TYPE, qos)?;
        self.node.create_publisher(&topic, Some(qos.clone())).map_err(|error| NodeError::of("no publisher", error))
    }

    /// A service by its full name; `kind` are its package and type.
    pub(super) fn service(&mut self, name: &str, (package, kind): (&str, &str)) -> Result<Service, NodeError> {
        let name = if name.starts_with('/') { name.to_owned() } else { format!("/{name}") };
        Name::parse(&name).map_err(|error| NodeError::of(&name, format!("{error:?}")))?;
        let participant = self.context.domain_participant();
        let qos = reliable(10);
        let topic = |start: &str, end: &str, part: &str| {
            let kind = format!("{package}::srv::dds_::{kind}_{part}_");
            participant.create_topic(format!("{start}{name}{end}"), kind, &(&qos).into(), TopicKind::NoKey)
        };
        let refused = |error| NodeError::of(&name, error);
        let (requests, answers) =
            (topic("rq", "Request", "Request").map_err(refused)?, topic("rr", "Reply", "Response").map_err(refused)?);
        let requests = self.node.create_subscription(&requests, Some(qos.clone()));
        let requests = requests.map_err(|error| NodeError::of(&name, error))?;
        let publisher = participant.create_publisher(&(&qos).into()).map_err(refused)?;
        let answers = publisher.create_datawriter_no_key_cdr(&answers, Some((&qos).into())).map_err(refused)?;
        Ok(Service { requests, answers })
    }

    fn topic(&self, topic: &str, type_name: &str, qos: &QosProfile) -> Result<Topic, NodeError> {
        let full = self.options.full_name(topic);
        let name = Name::parse(&full).map_err(|error| NodeError::of(&full, format!("{error:?}")))?;
        let (package, kind) = type_name.split_once("/msg/").unwrap_or(("", type_name));
        self.node
            .create_topic(&name, MessageTypeName::new(package, kind), qos)
            .map_err(|error| NodeError::of(&full, error))
    }
}

/// Sensors: what is late is of no use.
pub(super) fn of_sensors() -> QosProfile {
    QosProfile::subscription_default()
        .reliability(Reliability::BestEffort)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 100 })
}

/// What must come, and goes to whoever is there.
pub(super) fn reliable(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability(Reliability::Reliable { when_full: WhenFull::Fail })
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth })
}

/// What must come, and also to who joins later.
pub(super) fn latched(depth: usize) -> QosProfile {
    reliable(depth).durability(Durability::TransientLocal)
}
