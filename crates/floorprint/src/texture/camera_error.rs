//! What can be wrong with a camera's calibration.

/// The camera's calibration cannot be that of a camera that sees the floor.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`robot.{section}`: {found}, expected {expected}; correct the robot's calibration")]
pub struct CameraError {
    /// The section of the configuration.
    pub section: &'static str,
    /// What is wrong.
    pub found: String,
    /// What was expected.
    pub expected: &'static str,
}
