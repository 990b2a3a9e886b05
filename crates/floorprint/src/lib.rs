//! Particle-filter SLAM: trajectory, occupancy grid and colour floor map from a robot's drive.
//!
//! The library is pure: no files, no clock, no printing, no global state. Records of
//! sensors go in, poses and maps come out; the same input, configuration and seed
//! give the same bytes for any number of threads.

pub mod config;
pub mod evaluation;
pub mod filter;
mod frame;
pub mod geometry;
mod ids;
pub mod loop_closure;
pub mod map;
pub mod motion_model;
pub mod odometry;
pub mod pose_graph;
mod profiler;
pub mod random;
pub mod scan_matcher;
pub mod sensors;
pub mod simulator;
mod slam;
pub mod texture;

pub use config::Config;
pub use frame::{BodyScan, Frame, Points};
pub use ids::SensorId;
pub use profiler::{NoProfiler, Phase, Profiler};
pub use slam::{Slam, SlamError, SlamResult, StepReport};
