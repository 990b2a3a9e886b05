//! What outlives a step: the trajectory, the key scans, the places and how they lie to each other. Trajectory and map
//! can be had of it at any time, and a drive can be gone on with.

mod edit;
mod memory;
mod pose_log;
mod refinement;
mod renderer;
#[expect(clippy::module_inception, reason = "one type a file, named after it")]
mod session;
mod trajectory;

pub use edit::Region;
pub use memory::SessionMemory;
pub use pose_log::{POSES_PER_BLOCK, pack_poses, unpack_poses};
pub use renderer::{RenderedScan, Renderer};
pub use session::{Session, SessionError, SessionState, StoredScan};
pub use trajectory::correct_poses;
#[cfg(test)]
pub(crate) use trajectory::corrected_poses;
