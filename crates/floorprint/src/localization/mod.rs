//! Localization: where a robot is in a finished map, with or without a first guess, and whether it is lost.
//!
//! [`Localizer::process`] is the loop.

mod config;
mod global_search;
mod health;
mod history;
mod hypothesis;
mod localization_map;
mod localizer;
mod map_changes;
mod report;
mod scan_odometry;
mod sensing;
#[cfg(test)]
mod tests;

pub use config::LocalizationConfig;
pub use localization_map::{LocalizationMap, MapSurface};
pub use localizer::{Localizer, Start};
pub use map_changes::{MapChange, MapChanges};
pub use report::{Explained, LocalizationReport, Mode};
