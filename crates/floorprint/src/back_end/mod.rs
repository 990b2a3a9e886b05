//! Closing loops: places recognised again put the whole drive right.

mod association;
#[expect(clippy::module_inception, reason = "one type a file, named after it")]
mod back_end;
mod config;
mod conflict;
mod continuity;
mod evidence;
mod hypothesis;
mod look;
mod place_graph;
mod place_match;
mod report;
mod retirement;
mod second_look;
mod submap;
#[cfg(test)]
mod tests;
mod track_placement;
mod uncertainty;
mod view_cache;

pub use back_end::BackEnd;
pub use config::LoopClosureConfig;
pub use hypothesis::{Closure, Found, Hypothesis, Kidnapping};
pub use look::Look;
pub use place_graph::{Anchor, PlaceGraph};
pub use place_match::{Comparison, Placement};
pub use report::{ClosureLoad, ClosureReport, Verdict};
pub use submap::{Link, Submap, SubmapBuilder};
pub use uncertainty::Uncertainty;
pub use view_cache::ViewCache;
