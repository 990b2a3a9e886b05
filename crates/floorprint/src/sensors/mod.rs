//! What the robot's sensors deliver, and how they are calibrated.

mod depth_camera;
mod ece276a;
mod encoders;
mod image;
mod imu;
mod record;
mod robot;
mod scan;

pub use depth_camera::{DepthCameraConfig, PinholeConfig};
pub use encoders::EncoderReading;
pub use image::{ColorImage, DepthImage};
pub use imu::ImuReading;
pub use record::{Record, Records, StampedPose, Stream};
pub use robot::{CameraConfig, LagConfig, LidarConfig, RobotConfig, ScaleConfig, StampAt, WheelConfig};
pub use scan::{Ray, Scan, ScanGeometry};
