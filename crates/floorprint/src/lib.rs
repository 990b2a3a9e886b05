//! Particle-filter SLAM: trajectory, occupancy grid and colour floor map from a robot's drive.
//!
//! The library is pure: no files, no clock, no printing, no global state. Records of
//! sensors go in, poses and maps come out; the same input, configuration and seed
//! give the same bytes for any number of threads.

pub mod back_end;
pub mod calibration;
mod compact_scan;
pub mod config;
pub mod doctor;
pub mod evaluation;
mod frame;
mod frames;
pub mod front_end;
pub mod geometry;
mod ids;
mod key_scan;
pub mod localization;
pub mod map;
pub mod motion_model;
pub mod odometry;
mod pace;
pub mod pose_graph;
pub mod prelude;
mod profiler;
pub mod random;
pub mod scan_matcher;
pub mod sensors;
pub mod session;
pub mod simulator;
mod slam;
mod stop_signal;
pub mod storage;
pub mod surface;
pub mod survey;
pub mod texture;

pub use compact_scan::CompactScan;
pub use config::Config;
pub use frame::{BodyScan, Frame, Points};
pub use frames::{Frames, Pass};
pub use ids::SensorId;
pub use key_scan::{Drift, Interruption, KeyScan};
pub use profiler::{NoProfiler, Phase, Profiler};
pub use slam::{Slam, SlamError, SlamResult, StepReport};
pub use stop_signal::StopSignal;
