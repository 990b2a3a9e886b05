//! What the node subscribes to.

use super::node::{Node, NodeError, latched, of_sensors, reliable};
use super::raw_message::RawMessage;
use super::sole_publisher::SolePublisher;
use floorprint_io::ros::MessageStream;
use futures::StreamExt as _;
use futures::executor::block_on;
use futures::stream::select_all;
use ros2_client::Subscription;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Messages that may wait while the engine is being set up: some seconds of everything.
const QUEUE: usize = 4096;

/// A message that came in.
#[derive(Debug)]
pub struct Incoming {
    /// Number of its topic, in the order in which [`Listener::topics`] has them; `None` of an initial pose.
    pub topic: Option<usize>,
    /// When it came, seconds since the listener began.
    pub time_s: f64,
    /// The message in CDR.
    pub cdr: Vec<u8>,
}

/// The node's ears: a thread that puts messages into a queue.
#[derive(Debug)]
pub struct Listener {
    topics: Vec<(String, &'static str)>,
    queue: Receiver<Incoming>,
    began: Instant,
    lost: Arc<AtomicUsize>,
    /// Whether a topic has publishers that are not listened to, and whether that was asked for.
    crowded: Arc<[(AtomicBool, AtomicBool)]>,
}

impl Listener {
    pub(super) fn new(node: &mut Node) -> Result<Self, NodeError> {
        let options = node.options().clone();
        let scans = options.scan_topics.iter().map(|topic| (topic.clone(), "sensor_msgs/msg/LaserScan", of_sensors()));
        let others = [
            (options.odom_topic.clone(), "nav_msgs/msg/Odometry", of_sensors()),
            (options.imu_topic.clone(), "sensor_msgs/msg/Imu", of_sensors()),
            ("/tf".to_owned(), "tf2_msgs/msg/TFMessage", of_sensors()),
            ("/tf_static".to_owned(), "tf2_msgs/msg/TFMessage", latched(100)),
        ];
        let topics: Vec<_> = scans.chain(others).collect();
        let mut subscriptions: Vec<(Option<usize>, Subscription<RawMessage>)> = Vec::new();
        for (number, (topic, type_name, qos)) in topics.iter().enumerate() {
            subscriptions.push((Some(number), node.subscribe(topic, type_name, qos)?));
        }
        let pose = node.subscribe("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", &reliable(1))?;
        subscriptions.push((None, pose));
        let (sender, queue) = sync_channel(QUEUE);
        let (began, lost) = (Instant::now(), Arc::new(AtomicUsize::new(0)));
        let counter = Arc::clone(&lost);
        let crowded: Arc<[(AtomicBool, AtomicBool)]> = topics.iter().map(|_| <_>::default()).collect();
        // Of transforms every node may publish its own.
        let mut sole: Vec<_> = topics
            .iter()
            .map(|(_, type_name, _)| (*type_name != "tf2_msgs/msg/TFMessage").then(SolePublisher::new))
            .collect();
        let is_crowded = Arc::clone(&crowded);
        let listen = move || {
            let streams = subscriptions.iter().map(|(topic, subscription)| {
                subscription.async_stream().map(move |message| (*topic, message)).boxed_local()
            });
            let mut messages = select_all(streams);
            while let Some((topic, message)) = block_on(messages.next()) {
                // What is no message of its type is nobody's.
                let Ok((RawMessage(cdr), info)) = message else { continue };
                if let Some(number) = topic
                    && let Some(sole) = &mut sole[number]
                    && !sole.admits(info.publisher_gid(), Instant::now())
                {
                    is_crowded[number].0.store(true, Ordering::Relaxed);
                    continue;
                }
                match sender.try_send(Incoming { topic, time_s: began.elapsed().as_secs_f64(), cdr }) {
                    Ok(()) => {}
                    Err(TrySendError::Full(_)) => _ = counter.fetch_add(1, Ordering::Relaxed),
                    Err(TrySendError::Disconnected(_)) => return,
                }
            }
        };
        thread::Builder::new()
            .name("ros2-in".to_owned())
            .spawn(listen)
            .map_err(|error| NodeError::of("no thread", error))?;
        let topics = topics.into_iter().map(|(topic, type_name, _)| (options.full_name(&topic), type_name)).collect();
        Ok(Self { topics, queue, began, lost, crowded })
    }

    /// Topics with their types, by number.
    #[must_use]
    pub fn topics(&self) -> &[(String, &'static str)] {
        &self.topics
    }

    /// Tells a stream of messages the topics.
    pub fn register(&self, stream: &mut MessageStream) {
        for (topic, type_name) in &self.topics {
            stream.add_topic(topic, type_name);
        }
    }

    /// Seconds since the listener began.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// The next message, if one comes within some time.
    #[must_use]
    pub fn next(&self, within: Duration) -> Option<Incoming> {
        self.queue.recv_timeout(within).ok()
    }

    /// A topic on which more than one node publishes, each once: only the first one is listened to.
    #[must_use]
    pub fn next_crowded(&self) -> Option<&str> {
        let is_new = |(is_crowded, was_told): &(AtomicBool, AtomicBool)| {
            is_crowded.load(Ordering::Relaxed) && !was_told.swap(true, Ordering::Relaxed)
        };
        self.crowded.iter().position(is_new).map(|number| self.topics[number].0.as_str())
    }

    /// Messages for which there was no room.
    #[must_use]
    pub fn lost(&self) -> usize {
        self.lost.load(Ordering::Relaxed)
    }
}
