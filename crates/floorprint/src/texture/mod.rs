//! The colour map of the floor (report §III.B, eqs. 23–29).

mod blend;
mod camera;
mod camera_error;
mod config;
mod distortion;
mod exposure;
mod floor_mapper;
mod floor_patch;
mod floor_plane;
mod painter;
mod pairing;
mod spacing;
mod summary;

pub use camera::RgbdCamera;
pub use camera_error::CameraError;
pub use config::{Blend, TextureConfig};
pub use floor_mapper::{FloorMapper, RgbdFrame, SkipReason};
pub use floor_patch::FloorPatch;
pub use floor_plane::FloorTilt;
pub use painter::TextureMap;
pub use pairing::{ImagePair, ImagePairing, pair_by_time};
pub use spacing::spaced;
pub use summary::TextureSummary;
