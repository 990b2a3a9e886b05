//! The page in the browser: one small server, without anything from the network.
//!
//! [`Server`] takes connections, [`Guard`](guard) says who may come in, `api` answers, `feed` tells each viewer what is
//! new at its own pace.

mod api;
mod feed;
mod guard;
mod server;

pub use guard::{AccessError, Token};
pub use server::{Server, ServerError};
