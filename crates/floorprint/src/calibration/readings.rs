//! What odometry and gyro state, as small steps that are linear in what is to be found.

use crate::SensorId;
use crate::geometry::Pose2;
use crate::odometry::encoder_clock::EncoderClock;
use crate::odometry::gyro::LONGEST_GAP_S;
use crate::odometry::{OdometryCorrections, OdometrySource};
use crate::sensors::{Record, RobotConfig, StampedPose};

/// A step of two parts, each to be multiplied by a factor of its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Stamps of its sensor, seconds.
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// How the body moved, in its own axes: of the ticks of the left and the right wheels, or the metres that are stated.
    pub(super) moved: [[f64; 2]; 2],
    /// How it turned: radians, or ticks (metres, once multiplied) that are to be divided by the track width.
    pub(super) turned: [f64; 2],
}

/// The steps of a drive by sensor.
#[derive(Debug)]
pub(super) struct Readings {
    /// Where the body's motion comes from.
    pub(super) source: OdometrySource,
    /// Of the wheels, or of the stated poses.
    pub(super) body: Vec<Step>,
    /// Of the gyro, where it is used: seconds, and radians less the bias at standstill.
    pub(super) gyro: Option<Vec<Step>>,
    /// Whether the scans of the first LiDAR carry the stated poses.
    are_carried: bool,
}

impl Readings {
    /// Sorts the readings of a drive whose motion comes from `source`.
    pub(super) fn of(records: &[Record], corrections: OdometryCorrections, robot: &RobotConfig) -> Self {
        let OdometryCorrections { source, encoder_clock, gyro_bias, .. } = corrections;
        let mut clock = EncoderClock::given(encoder_clock);
        // The bias was found of scaled rates and shifted stamps.
        let bias = |stamp_s: f64| gyro_bias.at(stamp_s - robot.lag.imu_s) / robot.scale.gyro;
        let (mut wheels, mut gyro, mut stated, mut carried) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for record in records.iter().filter(|record| record.stamp_s().is_finite()) {
            match record {
                Record::Encoders(reading) => {
                    wheels.push((clock.counted_s(reading), reading.left_ticks, reading.right_ticks));
                }
                Record::Imu(reading) => {
                    let rate_rad_s = reading.angular_velocity_rad_s[2] - bias(reading.stamp_s);
                    gyro.push((reading.stamp_s, rate_rad_s));
                }
                Record::Odometry(pose) => stated.push(*pose),
                Record::Scan(scan) if scan.sensor == SensorId::default() => {
                    carried.extend(scan.odometry.map(|pose| StampedPose { stamp_s: scan.stamp_s, pose }));
                }
                Record::Scan(_) => {}
            }
        }
        let are_carried = stated.is_empty();
        let body = match source {
            OdometrySource::Log if are_carried => steps_of_poses(&carried),
            OdometrySource::Log => steps_of_poses(&stated),
            _ => steps_of_wheels(&wheels),
        };
        let gyro = (source == OdometrySource::WheelsAndGyro).then(|| steps_of_gyro(gyro));
        Self { source, body, gyro, are_carried }
    }

    /// The record as a robot with this LiDAR alone would have it; none where it is another LiDAR's.
    pub(super) fn seen_by(&self, record: &Record, sensor: SensorId) -> Option<Record> {
        let Record::Scan(scan) = record else { return Some(record.clone()) };
        if scan.sensor == sensor {
            let mut scan = scan.clone();
            scan.sensor = SensorId::default();
            return Some(Record::Scan(scan));
        }
        // Another LiDAR's scan may carry the odometry.
        let pose = scan.odometry.filter(|_| self.are_carried && scan.sensor == SensorId::default())?;
        Some(Record::Odometry(StampedPose { stamp_s: scan.stamp_s, pose }))
    }
}

fn steps_of_wheels(readings: &[(f64, f64, f64)]) -> Vec<Step> {
    let step = |pair: &[(f64, f64, f64)]| {
        let &[(from_s, ..), (to_s, left, right)] = pair else { return None };
        let moved = [[0.5 * left, 0.0], [0.5 * right, 0.0]];
        (to_s > from_s).then_some(Step { from_s, to_s, moved, turned: [-left, right] })
    };
    readings.windows(2).filter_map(step).collect()
}

fn steps_of_poses(poses: &[StampedPose]) -> Vec<Step> {
    let step = |pair: &[StampedPose]| {
        let [earlier, later] = pair else { return None };
        let Pose2 { x, y, theta } = earlier.pose.between(&later.pose);
        // In the axes of the middle of the step.
        let (sin, cos) = (-0.5 * theta).sin_cos();
        let moved = [[cos * x - sin * y, sin * x + cos * y], [0.0; 2]];
        let is_step = later.stamp_s > earlier.stamp_s && x.is_finite() && y.is_finite() && theta.is_finite();
        is_step.then_some(Step { from_s: earlier.stamp_s, to_s: later.stamp_s, moved, turned: [0.0, theta] })
    };
    poses.windows(2).filter_map(step).collect()
}

fn steps_of_gyro(mut rates: Vec<(f64, f64)>) -> Vec<Step> {
    rates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let step = |pair: &[(f64, f64)]| {
        let &[(from_s, from), (to_s, to)] = pair else { return None };
        let elapsed_s = to_s - from_s;
        (elapsed_s > 0.0 && elapsed_s <= LONGEST_GAP_S).then_some(Step {
            from_s,
            to_s,
            moved: [[0.0; 2]; 2],
            turned: [elapsed_s, 0.5 * (from + to) * elapsed_s],
        })
    };
    rates.windows(2).filter_map(step).collect()
}
