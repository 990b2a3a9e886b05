//! The page in the browser: one small server, without anything from the network.
//!
//! [`Server`] listens, `api` answers whom the guard lets in, `feed` tells each viewer what is new at its own pace.

mod api;
mod feed;
mod server;

#[cfg(feature = "foxglove")]
pub(crate) use server::listen;
pub use server::{Server, ServerError};
