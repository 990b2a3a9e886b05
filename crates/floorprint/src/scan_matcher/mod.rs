//! Finding the pose at which a scan fits a map.

mod config;

pub use config::MatcherConfig;
