//! Simulated worlds and sensors with exact truth.
//!
//! [`World::named`] draws a world, [`simulate`] drives the robot through it, and the
//! [`SimulatedDrive`] yields scans, ticks, gyro readings and images together with the
//! true trajectory, map and floor. Equal seeds give equal bytes.

mod arrival;
mod camera;
mod config;
mod drive;
mod error;
mod fault;
mod floor;
mod floor_plan;
mod floor_raster;
mod font;
mod inertial_unit;
mod lidar;
mod lidar_profile;
mod moving_walls;
mod pose_odometry;
mod random_faults;
mod random_robot;
mod random_world;
mod ray_caster;
mod scenario;
#[cfg(test)]
mod tests;
mod trajectory;
mod truth;
mod walker;
mod wheel_encoders;
mod world;
mod worlds;
mod worlds_of_their_own;

pub use arrival::Arrival;
pub use config::{
    CameraSimulationConfig, ImuSimulationConfig, LidarSimulationConfig, MotionConfig, PoseOdometryConfig,
    SimulationConfig, WheelSimulationConfig,
};
pub use drive::{SimulatedDrive, simulate};
pub use error::SimulationError;
pub use fault::Fault;
pub use lidar_profile::LidarProfile;
pub use scenario::Scenario;
pub use wheel_encoders::WheelCounts;
pub use world::{Command, Material, Wall, Waypoint, World};

/// The sensors' streams of random numbers.
const SENSOR_LIDAR: u64 = 1;
const SENSOR_WHEELS: u64 = 2;
const SENSOR_IMU: u64 = 3;
const SENSOR_DISPARITY: u64 = 4;
const SENSOR_COLOR: u64 = 5;
const SENSOR_ODOMETRY: u64 = 6;
