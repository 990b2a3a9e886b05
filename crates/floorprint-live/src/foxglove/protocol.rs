//! What is said in the protocol: JSON, and messages behind a few bytes of head.

use super::topics::Topic;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use floorprint_io::foxglove::Schema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Names of the protocol, those of newer apps first; what is used of it is the same in both.
pub(super) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// What begins a message, in either direction.
const MESSAGE_DATA: u8 = 1;

/// What a viewer asks.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(super) enum Request {
    /// To be told of channels.
    Subscribe { subscriptions: Vec<Wanted> },
    /// Not to be told any more.
    Unsubscribe { subscription_ids: Vec<u32> },
    /// It will send messages itself.
    Advertise { channels: Vec<Offered> },
    /// It will not any more.
    Unadvertise { channel_ids: Vec<u32> },
    /// What was not offered.
    #[serde(other)]
    Other,
}

/// A channel that a viewer wants.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Wanted {
    /// How the viewer calls the subscription.
    pub(super) id: u32,
    /// The channel's number.
    pub(super) channel_id: u32,
}

/// A channel on which a viewer sends.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Offered {
    /// How the viewer calls it.
    pub(super) id: u32,
    /// Its topic.
    pub(super) topic: String,
    /// How its messages are encoded.
    pub(super) encoding: String,
    /// What they are.
    pub(super) schema_name: String,
}

/// A channel as it is offered.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Channel {
    id: u32,
    topic: &'static str,
    encoding: &'static str,
    schema_name: &'static str,
    schema: String,
    schema_encoding: &'static str,
}

/// The first thing that is said. Viewers may send poses where `takes_poses`.
pub(super) fn server_info(name: &str, session_id: &str, takes_poses: bool) -> String {
    let capabilities: &[&str] = if takes_poses { &["clientPublish"] } else { &[] };
    let encodings: &[&str] = if takes_poses { &["cdr"] } else { &[] };
    json!({
        "op": "serverInfo",
        "name": format!("floorprint: {name}"),
        "capabilities": capabilities,
        "supportedEncodings": encodings,
        "sessionId": session_id,
    })
    .to_string()
}

/// What there is to see.
pub(super) fn advertisement() -> String {
    let channels: Vec<Channel> = Topic::ALL
        .into_iter()
        .map(|topic| {
            let Schema { name, message_encoding, encoding, description } = topic.schema();
            let schema = match encoding {
                "protobuf" => BASE64_STANDARD.encode(&description),
                _ => String::from_utf8_lossy(&description).into_owned(),
            };
            let (encoding, schema_encoding) = (message_encoding, encoding);
            Channel { id: topic.id(), topic: topic.name(), encoding, schema_name: name, schema, schema_encoding }
        })
        .collect();
    json!({ "op": "advertise", "channels": channels }).to_string()
}

/// That something cannot be done, as a warning.
pub(super) fn warning(message: &str) -> String {
    json!({ "op": "status", "level": 1, "message": message }).to_string()
}

/// A message of a subscription; its time is in nanoseconds.
pub(super) fn message_data(subscription: u32, time_ns: u64, payload: &[u8]) -> Vec<u8> {
    [&[MESSAGE_DATA][..], &subscription.to_le_bytes(), &time_ns.to_le_bytes(), payload].concat()
}

/// A message that a viewer sent: its channel, and the rest.
pub(super) fn sent_by_viewer(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (&[MESSAGE_DATA, a, b, c, d], payload) = bytes.split_first_chunk::<5>()? else { return None };
    Some((u32::from_le_bytes([a, b, c, d]), payload))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_understood_and_others_are_no_errors() {
        let subscribe = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":2}]}"#;
        let Ok(Request::Subscribe { subscriptions }) = serde_json::from_str(subscribe) else { panic!("{subscribe}") };
        assert_eq!((subscriptions[0].id, subscriptions[0].channel_id), (7, 2));
        let other = serde_json::from_str(r#"{"op":"getParameters","parameterNames":[],"id":"x"}"#);
        assert!(matches!(other, Ok(Request::Other)));
        assert!(serde_json::from_str::<Request>("[]").is_err());
        assert_eq!(sent_by_viewer(&[1, 2, 0, 0, 0, 9]), Some((2, &[9][..])));
        assert_eq!(sent_by_viewer(&[1, 2, 0, 0]), None);
    }
}
