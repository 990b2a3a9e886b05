//! A node of ROS 2, without ROS: speaks DDS as its nodes do.
//!
//! [`Node`] is the node, `listener` what it subscribes to, `announcer` what it publishes, `services` what it can be
//! asked to do, each by a `service`. Messages pass as bytes, made and taken apart where recordings are.

mod announcer;
mod listener;
mod node;
mod options;
mod raw_message;
mod service;
mod services;
mod sole_publisher;

pub use listener::{Incoming, Listener};
pub use node::{Node, NodeError};
pub use options::Options;
