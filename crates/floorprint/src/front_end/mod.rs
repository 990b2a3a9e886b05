//! The front end: particle filters that track the robot from scan to scan.
//!
//! [`ParticleFilter::process`] is the filter's loop.

mod config;
mod correlation;
#[expect(clippy::module_inception, reason = "one type a file, named after it")]
mod front_end;
mod genealogy;
mod grisetti;
mod kld_sampling;
mod local_map;
mod loss;
mod odometry_model;
mod odometry_record;
mod odometry_scale;
mod odometry_trust;
mod odometry_turn;
mod particle_filter;
mod prepared_scan;
mod report;
mod resampler;
mod seen_velocity;
mod shared_map;
mod tracker;
mod unseen_motion;
mod weights;

pub use config::{AdaptiveConfig, FilterConfig, FilterKind, ResamplerKind};
pub use front_end::FrontEnd;
pub use grisetti::{GrisettiConfig, GrisettiFilter, Proposal};
pub use kld_sampling::particles_needed;
pub(crate) use kld_sampling::samples_for_bins;
pub(crate) use odometry_model::OdometryModel;
pub use particle_filter::{FrontEndState, ParticleFilter};
pub use prepared_scan::PreparedScan;
pub use report::FilterStep;
pub use resampler::resample;
pub use shared_map::SharedMapFilter;
