//! The colour map of the floor.

mod config;

pub use config::TextureConfig;
