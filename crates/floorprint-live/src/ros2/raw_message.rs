//! A message as its bytes, whatever its type is: no second description of the messages is needed.

use serde::de::{Deserializer, SeqAccess, Visitor};
use serde::ser::{SerializeTuple as _, Serializer};
use serde::{Deserialize, Serialize};
use std::fmt;

/// What announces little-endian CDR; the middleware puts it there and takes it away.
const HEADER: [u8; 4] = [0, 1, 0, 0];
/// Largest message that is taken, bytes: a cloud of half a million points.
const LARGEST: usize = 16 << 20;

/// A message in CDR with its header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RawMessage(pub(super) Vec<u8>);

impl ros2_client::Message for RawMessage {}

impl Serialize for RawMessage {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // A tuple of bytes is its bytes: no length before them, and nothing between them.
        let fields = self.0.get(HEADER.len()..).unwrap_or_default();
        let mut tuple = serializer.serialize_tuple(fields.len())?;
        fields.iter().try_for_each(|byte| tuple.serialize_element(byte))?;
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for RawMessage {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_tuple(LARGEST, AllBytes)
    }
}

struct AllBytes;

impl<'de> Visitor<'de> for AllBytes {
    type Value = RawMessage;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("bytes")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<RawMessage, A::Error> {
        let mut message = HEADER.to_vec();
        // The message ends where there is no byte more.
        while let Ok(Some(byte)) = bytes.next_element::<u8>() {
            message.push(byte);
        }
        Ok(RawMessage(message))
    }
}
