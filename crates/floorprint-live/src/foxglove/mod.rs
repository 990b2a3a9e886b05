//! What Foxglove's app connects to: a WebSocket server in its protocol.
//!
//! [`FoxgloveServer`] lets viewers in by the page's rules, `protocol` is what they ask and are told, `viewer` talks with one of
//! them at its own pace, `topics` are what there is to see. The messages are those of [`floorprint_io::foxglove`].
//!
//! Source: <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>.

mod protocol;
mod server;
mod topics;
mod viewer;

pub use server::FoxgloveServer;
