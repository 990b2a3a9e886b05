//! One viewer: what it asked for, and what it was told.

use super::protocol::{Offered, Request, Wanted, advertisement, message_data, sent_by_viewer, server_info, warning};
use super::server::Hall;
use super::topics::{Topic, Version, View};
use crate::board::Mode;
use crate::bucket::Bucket;
use crate::connections::Usage;
use crate::health::Health;
use floorprint::localization::Start;
use floorprint_io::ros::{nanoseconds, pose_of};
use futures_util::{SinkExt as _, StreamExt as _};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

/// Viewers are told what is new this often at most.
const PACE: Duration = Duration::from_millis(50);
/// What is large comes so much more seldom that its making and sending take no more than about this share of the time.
const LARGEST_SHARE: u32 = 20;
/// A viewer that takes nothing, or says nothing though it is asked, for so long is gone.
const PATIENCE: Duration = Duration::from_secs(30);
/// It is asked this often.
const PING_EVERY: Duration = Duration::from_secs(10);
/// What a viewer may say: a second in the long run, and at once.
const REQUESTS_PER_S: f64 = 50.0;
const REQUESTS_AT_ONCE: f64 = 200.0;
/// Subscriptions and channels of a viewer at most.
const MOST_SUBSCRIPTIONS: usize = 64;
const TOO_MUCH: &str = "more requests than 50 a second: good bye; connect again and ask less often";
/// The topic on which a viewer says where the robot is.
const INITIAL_POSE: &str = "initialpose";

/// A channel that is wanted, and what of it was sent.
struct Subscription {
    id: u32,
    topic: Topic,
    sent: Option<Version>,
    due: Instant,
}

/// A viewer that has come in.
pub(super) struct Viewer {
    hall: Arc<Hall>,
    socket: WebSocketStream<TcpStream>,
    usage: Usage,
    subscriptions: Vec<Subscription>,
    /// Channels on which it says where the robot is.
    poses: Vec<u32>,
    health: Health,
    bucket: Bucket,
    /// That there are not too many viewers.
    place: Option<OwnedSemaphorePermit>,
}

/// That a viewer is gone, or is sent away.
pub(super) struct Gone;

impl Viewer {
    pub(super) fn new(hall: Arc<Hall>, socket: WebSocketStream<TcpStream>, usage: Usage) -> Self {
        let bucket = Bucket::new(REQUESTS_PER_S, REQUESTS_AT_ONCE);
        let (subscriptions, poses) = (Vec::new(), Vec::new());
        Self { hall, socket, usage, subscriptions, poses, health: Health::default(), bucket, place: None }
    }

    /// Talks with it until it is gone.
    pub(super) async fn talk(mut self) -> Result<(), Gone> {
        let board = Arc::clone(&self.hall.board);
        let takes_poses = board.mode == Mode::Localization;
        self.send(Message::text(server_info(&board.name, &self.hall.session_id, takes_poses))).await?;
        self.send(Message::text(advertisement())).await?;
        let mut ticks = interval(PACE);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let (mut heard, mut asked) = (Instant::now(), Instant::now());
        loop {
            tokio::select! {
                said = self.socket.next() => {
                    let Some(Ok(said)) = said else { return Err(Gone) };
                    heard = Instant::now();
                    if !self.bucket.take() {
                        self.send(Message::text(warning(TOO_MUCH))).await?;
                        return Err(Gone);
                    }
                    self.hear(said).await?;
                }
                _ = ticks.tick() => {
                    self.tell().await?;
                    if heard.elapsed() > PATIENCE {
                        return Err(Gone);
                    }
                    if asked.elapsed() > PING_EVERY {
                        asked = Instant::now();
                        self.send(Message::Ping(Vec::new().into())).await?;
                    }
                }
            }
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), Gone> {
        match timeout(PATIENCE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) | Err(_) => Err(Gone),
        }
    }

    async fn warn(&mut self, text: &str) -> Result<(), Gone> {
        self.send(Message::text(warning(text))).await
    }

    async fn hear(&mut self, said: Message) -> Result<(), Gone> {
        match said {
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(Request::Subscribe { subscriptions }) => self.subscribe(subscriptions).await,
                Ok(Request::Unsubscribe { subscription_ids }) => {
                    self.subscriptions.retain(|subscription| !subscription_ids.contains(&subscription.id));
                    Ok(())
                }
                Ok(Request::Advertise { channels }) => self.offered(channels).await,
                Ok(Request::Unadvertise { channel_ids }) => {
                    self.poses.retain(|id| !channel_ids.contains(id));
                    Ok(())
                }
                Ok(Request::Other) => {
                    self.warn("this is not offered here; there are channels to subscribe to, and /initialpose").await
                }
                Err(error) => {
                    self.warn(&format!("this is not understood; expected a request of Foxglove's protocol: {error}"))
                        .await
                }
            },
            Message::Binary(bytes) => {
                let pose = sent_by_viewer(&bytes).filter(|(channel, _)| self.poses.contains(channel));
                match pose.and_then(|(_, payload)| pose_of(payload)) {
                    Some((_, pose)) if [pose.x, pose.y, pose.theta].iter().all(|number| number.is_finite()) => {
                        self.hall.board.inbox.set_start(Start::At(pose));
                        Ok(())
                    }
                    _ => {
                        self.warn(
                            "this message is not taken; expected a finite PoseWithCovarianceStamped on /initialpose",
                        )
                        .await
                    }
                }
            }
            Message::Close(_) => Err(Gone),
            Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => Ok(()),
        }
    }

    async fn subscribe(&mut self, wanted: Vec<Wanted>) -> Result<(), Gone> {
        if self.place.is_none() {
            self.place = Arc::clone(&self.hall.places).try_acquire_owned().ok();
            if self.place.is_none() {
                self.warn("there are too many viewers; close one of the others and connect again").await?;
                return Err(Gone);
            }
            self.usage.views();
        }
        for Wanted { id, channel_id } in wanted {
            let Some(topic) = Topic::of(channel_id) else {
                self.warn(&format!("there is no channel {channel_id}; the advertisement lists those there are"))
                    .await?;
                continue;
            };
            let is_taken = self.subscriptions.iter().any(|subscription| subscription.id == id);
            if is_taken || self.subscriptions.len() >= MOST_SUBSCRIPTIONS {
                self.warn(
                    "this subscription is not taken: its number is in use, or there are too many; unsubscribe first",
                )
                .await?;
                continue;
            }
            self.subscriptions.push(Subscription { id, topic, sent: None, due: Instant::now() });
        }
        // What there is, there is at once.
        self.tell().await
    }

    async fn offered(&mut self, channels: Vec<Offered>) -> Result<(), Gone> {
        for Offered { id, topic, encoding, schema_name } in channels {
            let is_pose = topic.trim_start_matches('/') == INITIAL_POSE
                && encoding == "cdr"
                && schema_name.ends_with("PoseWithCovarianceStamped");
            if self.hall.board.mode == Mode::Localization && is_pose && self.poses.len() < MOST_SUBSCRIPTIONS {
                self.poses.push(id);
            } else {
                self.warn("nothing is taken but poses on /initialpose, in a finished map").await?;
            }
        }
        Ok(())
    }

    /// Sends what is new of what is wanted.
    async fn tell(&mut self) -> Result<(), Gone> {
        let hall = Arc::clone(&self.hall);
        let (situation, picture) = (hall.board.situation(), hall.board.picture());
        let view = View { mode: hall.board.mode, frames: &hall.frames, situation: &situation, picture: &picture };
        for at in 0..self.subscriptions.len() {
            let Subscription { id, topic, sent, due } = self.subscriptions[at];
            let version = view.version(topic);
            let started = Instant::now();
            if version.is_none() || version == sent || started < due {
                continue;
            }
            if let Some(payload) = view.message(topic, &mut self.health) {
                let data = message_data(id, nanoseconds(view.stamp_s()), &payload);
                self.send(Message::binary(data)).await?;
            }
            let subscription = &mut self.subscriptions[at];
            subscription.sent = version;
            subscription.due = started + topic.period().max(started.elapsed() * LARGEST_SHARE);
        }
        Ok(())
    }
}
