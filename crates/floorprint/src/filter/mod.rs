//! The particle filter.

mod config;

pub use config::{FilterConfig, FilterKind, ResamplerKind};
