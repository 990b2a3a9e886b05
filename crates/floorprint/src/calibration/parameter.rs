//! A parameter of the robot with what a drive tells of it.

use super::fit::{FIRST, LAG, SECOND, Solution, WIDTH, X, Y, YAW};
use crate::odometry::OdometrySource;
use crate::sensors::{LidarConfig, RobotConfig};
use serde::Serialize;

/// A drive tells a parameter when its standard deviation is below this: in metres, radians, as a share, seconds. Larger
/// errors than these show in maps.
const TOLD_M: f64 = 0.02;
const TOLD_RAD: f64 = 0.01;
const TOLD_SHARE: f64 = 0.01;
const TOLD_S: f64 = 0.02;

/// Which parameter of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Which {
    MountX,
    MountY,
    MountYaw,
    LeftWheels,
    RightWheels,
    TrackWidth,
    OdometryDistance,
    OdometryTurn,
    Gyro,
    EncoderLag,
    OdometryLag,
    ImuLag,
}

/// What a parameter is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Metres.
    Metres,
    /// Radians.
    Radians,
    /// A factor.
    Factor,
    /// Metres a tick.
    MetresPerTick,
    /// Seconds.
    Seconds,
}

/// A parameter with what a drive tells of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    #[serde(skip)]
    which: Which,
    /// Number of the further LiDAR that it belongs to; `None` for all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    further_lidar: Option<usize>,
    /// Where it stands in the configuration.
    pub key: String,
    /// Its unit.
    pub unit: Unit,
    /// What was configured.
    pub before: f64,
    /// What the drive shows.
    pub found: f64,
    /// Standard deviation of `found`.
    pub sigma: f64,
    /// Whether that is small enough to be used.
    pub is_told: bool,
    /// What to drive so that it can be told.
    pub advice: &'static str,
}

/// The parameters of mount and odometry.
pub(super) fn of_body(solution: &Solution, robot: &RobotConfig, source: OdometrySource) -> Vec<Parameter> {
    let own = match source {
        OdometrySource::Log => {
            vec![(Which::OdometryDistance, FIRST), (Which::OdometryTurn, SECOND), (Which::OdometryLag, LAG)]
        }
        _ => vec![
            (Which::LeftWheels, FIRST),
            (Which::RightWheels, SECOND),
            (Which::TrackWidth, WIDTH),
            (Which::EncoderLag, LAG),
        ],
    };
    let mount = [(Which::MountX, X), (Which::MountY, Y), (Which::MountYaw, YAW)];
    of(mount.into_iter().chain(own), solution, robot)
}

/// Those of the gyro.
pub(super) fn of_gyro(solution: &Solution, robot: &RobotConfig) -> Vec<Parameter> {
    of([(Which::Gyro, SECOND), (Which::ImuLag, LAG)], solution, robot)
}

fn of(sought: impl IntoIterator<Item = (Which, usize)>, solution: &Solution, robot: &RobotConfig) -> Vec<Parameter> {
    let parameter = |(which, index): (Which, usize)| {
        let (found, sigma) = (solution.found[index], solution.sigma[index]);
        Parameter {
            which,
            further_lidar: None,
            key: which.key().to_owned(),
            unit: which.unit(),
            before: which.value(robot, &robot.lidar).unwrap_or(found),
            found,
            sigma,
            is_told: sigma <= which.limit(found),
            advice: which.advice(),
        }
    };
    sought.into_iter().map(parameter).collect()
}

impl Parameter {
    /// Whether it belongs to a LiDAR's mount.
    pub(super) fn is_of_mount(&self) -> bool {
        matches!(self.which, Which::MountX | Which::MountY | Which::MountYaw)
    }

    /// The same as that of a further LiDAR, counted from 0.
    pub(super) fn of_lidar(mut self, further: usize) -> Self {
        self.key = self.key.replace("robot.lidar.", &format!("robot.further_lidars[{further}]."));
        self.further_lidar = Some(further);
        self
    }

    /// Its value in a robot's calibration.
    pub(super) fn in_robot(&self, robot: &RobotConfig) -> Option<f64> {
        let lidar = match self.further_lidar {
            Some(further) => robot.further_lidars.get(further)?,
            None => &robot.lidar,
        };
        self.which.value(robot, lidar)
    }

    /// Puts what was found into a robot's calibration.
    pub(super) fn put_into(&self, robot: &mut RobotConfig) {
        let (found, mount) = (self.found, &mut robot.lidar.mount);
        let place = match self.which {
            Which::MountX => Some(&mut mount.x_m),
            Which::MountY => Some(&mut mount.y_m),
            Which::MountYaw => Some(&mut mount.yaw_rad),
            Which::LeftWheels => robot.wheels.as_mut().map(|wheels| &mut wheels.left_m_per_tick),
            Which::RightWheels => robot.wheels.as_mut().map(|wheels| &mut wheels.right_m_per_tick),
            Which::TrackWidth => robot.wheels.as_mut().map(|wheels| &mut wheels.track_width_m),
            Which::OdometryDistance => Some(&mut robot.scale.odometry_distance),
            Which::OdometryTurn => Some(&mut robot.scale.odometry_turn),
            Which::Gyro => Some(&mut robot.scale.gyro),
            Which::EncoderLag => Some(&mut robot.lag.encoders_s),
            Which::OdometryLag => Some(&mut robot.lag.odometry_s),
            Which::ImuLag => Some(&mut robot.lag.imu_s),
        };
        if let Some(place) = place {
            *place = found;
        }
    }
}

impl Which {
    fn key(self) -> &'static str {
        match self {
            Self::MountX => "robot.lidar.mount.x_m",
            Self::MountY => "robot.lidar.mount.y_m",
            Self::MountYaw => "robot.lidar.mount.yaw_rad",
            Self::LeftWheels => "robot.wheels.left_m_per_tick",
            Self::RightWheels => "robot.wheels.right_m_per_tick",
            Self::TrackWidth => "robot.wheels.track_width_m",
            Self::OdometryDistance => "robot.scale.odometry_distance",
            Self::OdometryTurn => "robot.scale.odometry_turn",
            Self::Gyro => "robot.scale.gyro",
            Self::EncoderLag => "robot.lag.encoders_s",
            Self::OdometryLag => "robot.lag.odometry_s",
            Self::ImuLag => "robot.lag.imu_s",
        }
    }

    fn unit(self) -> Unit {
        match self {
            Self::MountX | Self::MountY | Self::TrackWidth => Unit::Metres,
            Self::MountYaw => Unit::Radians,
            Self::LeftWheels | Self::RightWheels => Unit::MetresPerTick,
            Self::OdometryDistance | Self::OdometryTurn | Self::Gyro => Unit::Factor,
            Self::EncoderLag | Self::OdometryLag | Self::ImuLag => Unit::Seconds,
        }
    }

    /// The largest standard deviation of a value that is used.
    fn limit(self, found: f64) -> f64 {
        match self {
            Self::MountX | Self::MountY => TOLD_M,
            Self::MountYaw => TOLD_RAD,
            Self::EncoderLag | Self::OdometryLag | Self::ImuLag => TOLD_S,
            _ => TOLD_SHARE * found.abs(),
        }
    }

    fn value(self, robot: &RobotConfig, lidar: &LidarConfig) -> Option<f64> {
        let wheels = robot.wheels.as_ref();
        Some(match self {
            Self::MountX => lidar.mount.x_m,
            Self::MountY => lidar.mount.y_m,
            Self::MountYaw => lidar.mount.yaw_rad,
            Self::LeftWheels => wheels?.left_m_per_tick,
            Self::RightWheels => wheels?.right_m_per_tick,
            Self::TrackWidth => wheels?.track_width_m,
            Self::OdometryDistance => robot.scale.odometry_distance,
            Self::OdometryTurn => robot.scale.odometry_turn,
            Self::Gyro => robot.scale.gyro,
            Self::EncoderLag => robot.lag.encoders_s,
            Self::OdometryLag => robot.lag.odometry_s,
            Self::ImuLag => robot.lag.imu_s,
        })
    }

    fn advice(self) -> &'static str {
        match self {
            Self::MountX | Self::MountY => "turn on the spot or in tight bends, some ten times in each direction",
            Self::MountYaw => "drive straight stretches of several metres",
            Self::LeftWheels | Self::RightWheels | Self::OdometryDistance => {
                "drive straight stretches of several metres where walls stand ahead, too"
            }
            Self::TrackWidth | Self::OdometryTurn | Self::Gyro => "turn by a few rounds in each direction",
            Self::EncoderLag | Self::OdometryLag | Self::ImuLag => "begin and end turns briskly, some ten times",
        }
    }
}
