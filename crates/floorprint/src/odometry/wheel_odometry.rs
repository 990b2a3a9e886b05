//! Wheel odometry, with the gyro's turn where there is one (report eqs. 14–19), made as the readings come.
//!
//! The step of eq. 14 is taken along the arc of a constant twist instead of along its
//! chord, and the heading is followed at the gyro's own rate between the readings of the
//! wheels. A step waits until the gyro has reached its end or has been silent for too long.

use super::config::OdometryConfig;
use super::corrections::OdometryCorrections;
use super::dead_reckoning::DeadReckoning;
use super::differential_drive::WheelStep;
use super::encoder_clock::EncoderClock;
use super::finding::Finding;
use super::gyro::{Gyro, YawRate};
use super::gyro_bias::BiasTracker;
use super::track_width::TrackWidthFit;
use crate::geometry::Pose2;
use crate::sensors::{EncoderReading, StampedPose, WheelConfig};
use std::collections::VecDeque;

/// No more steps than this wait for the gyro.
const MOST_WAITING: usize = 4096;

/// Dead reckoning from wheels and gyro.
#[derive(Debug)]
pub(super) struct WheelOdometry {
    wheels: WheelConfig,
    /// How late the readings' stamps are beside the LiDAR's, seconds.
    lag_s: f64,
    clock: EncoderClock,
    /// The first reading and when it was counted, until the second tells how long it had counted.
    first: Option<(EncoderReading, f64)>,
    /// End of the last step, seconds.
    until_s: Option<f64>,
    /// Steps that wait for the gyro, each with the stamp of its reading.
    waiting: VecDeque<(WheelStep, f64)>,
    /// `None` where the yaw is to come from the wheels.
    gyro: Option<Gyro>,
    gyro_seen: bool,
    bias: BiasTracker,
    fit: TrackWidthFit,
    /// Known beforehand, metres.
    given_track_width_m: Option<f64>,
    learns: bool,
    pose: Pose2,
    /// The trajectory `odometry_from_body`; it begins with the identity.
    path: DeadReckoning,
    moved_without_gyro_s: f64,
}

impl WheelOdometry {
    /// Nothing seen yet.
    pub(super) fn new(
        wheels: &WheelConfig,
        uses_gyro: bool,
        lag_s: f64,
        config: &OdometryConfig,
        corrections: Option<&OdometryCorrections>,
    ) -> Self {
        Self {
            wheels: wheels.clone(),
            lag_s,
            clock: match corrections {
                Some(corrections) => EncoderClock::given(corrections.encoder_clock.clone()),
                None if config.repair_encoder_stamps => EncoderClock::learning(),
                None => EncoderClock::given(None),
            },
            first: None,
            until_s: None,
            waiting: VecDeque::new(),
            gyro: uses_gyro.then(|| Gyro::new(config.gyro_low_pass_hz)),
            gyro_seen: false,
            bias: match corrections {
                Some(corrections) => BiasTracker::Given(corrections.gyro_bias.clone()),
                None => BiasTracker::learning(config.gyro_bias),
            },
            fit: TrackWidthFit::default(),
            given_track_width_m: corrections.and_then(|corrections| corrections.track_width_m),
            learns: corrections.is_none(),
            pose: Pose2::IDENTITY,
            path: DeadReckoning::default(),
            moved_without_gyro_s: 0.0,
        }
    }

    /// Takes in the wheels' next reading. Stamps that run backwards are held, so that no tick is lost.
    pub(super) fn add_ticks(&mut self, reading: EncoderReading) {
        let counted_s = self.clock.counted_s(&reading) - self.lag_s;
        if let Some(until_s) = self.until_s {
            self.add_step(&reading, until_s, counted_s);
        } else if let Some((first, first_s)) = self.first.take() {
            // The first reading is taken to have counted for as long as the second.
            let interval_s = self.clock.period_s().unwrap_or(counted_s - first_s).max(0.0);
            self.begin(&first, first_s, interval_s);
            self.add_step(&reading, first_s, counted_s);
        } else {
            self.first = Some((reading, counted_s));
        }
    }

    fn begin(&mut self, first: &EncoderReading, first_s: f64, interval_s: f64) {
        let start_s = first_s - interval_s;
        self.path.push(StampedPose { stamp_s: start_s, pose: self.pose }, first.stamp_s);
        self.add_step(first, start_s, first_s);
    }

    fn add_step(&mut self, reading: &EncoderReading, from_s: f64, counted_s: f64) {
        let step = WheelStep::new(reading, from_s, counted_s, &self.wheels);
        self.until_s = Some(step.to_s);
        self.waiting.push_back((step, reading.stamp_s));
    }

    /// Takes in the gyro's next reading; `false` when it is not later than the one before.
    pub(super) fn add_yaw_rate(&mut self, reading: YawRate) -> bool {
        self.gyro_seen = true;
        self.gyro.as_mut().is_none_or(|gyro| gyro.push(reading))
    }

    /// Makes the steps that can be made when all that happened until `known_s` (seconds) has arrived.
    pub(super) fn advance(&mut self, known_s: f64) {
        if known_s == f64::INFINITY
            && let Some((first, first_s)) = self.first.take()
        {
            self.begin(&first, first_s, 0.0);
        }
        if let Some(gyro) = &mut self.gyro {
            gyro.settle(known_s);
        }
        while let Some(&(step, stamp_s)) = self.waiting.front() {
            let mut step_known_s = stamp_s;
            if let Some(gyro) = &self.gyro {
                let gyro_known_s = gyro.known_s(step.to_s);
                if !gyro.reaches(step.to_s) && known_s < gyro_known_s && self.waiting.len() < MOST_WAITING {
                    break;
                }
                step_known_s = step_known_s.max(gyro_known_s);
            }
            self.waiting.pop_front();
            self.make(&step, step_known_s);
        }
    }

    /// Forgets the past before a time, seconds.
    pub(super) fn forget_before(&mut self, stamp_s: f64) {
        self.path.forget_before(stamp_s);
        let needed_s = self.waiting.front().map(|(step, _)| step.from_s).or(self.until_s);
        if let (Some(gyro), Some(needed_s)) = (&mut self.gyro, needed_s) {
            gyro.forget_before(needed_s.min(stamp_s));
        }
    }

    /// The trajectory so far, `odometry_from_body`.
    pub(super) fn path(&self) -> &DeadReckoning {
        &self.path
    }

    /// What the user should know.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        if self.learns {
            findings.extend(self.clock.finding());
        }
        if self.gyro.is_none() || !self.gyro_seen {
            return findings;
        }
        if self.learns {
            findings.extend(self.bias.finding());
            let stated_m = self.wheels.track_width_m;
            findings.extend(self.fit.track_width_m().map(|fitted_m| Finding::TrackWidth { fitted_m, stated_m }));
        }
        if self.moved_without_gyro_s > 0.0 {
            findings.push(Finding::ImuSilent { for_s: self.moved_without_gyro_s });
        }
        findings
    }

    /// Moves along a step, from one reading of the gyro to the next.
    fn make(&mut self, step: &WheelStep, known_s: f64) {
        let Some(gyro) = &self.gyro else {
            let yaw_rad = step.yaw_rad(self.wheels.track_width_m);
            self.pose = self.pose.compose(&Pose2::exp([step.distance_m, 0.0, yaw_rad]));
            self.path.push(StampedPose { stamp_s: step.to_s, pose: self.pose }, known_s);
            return;
        };
        let fitted_m = if self.learns { self.fit.track_width_m() } else { self.given_track_width_m };
        let track_width_m = fitted_m.unwrap_or(self.wheels.track_width_m);
        self.bias.learn(step, gyro);
        let (mut from_s, mut gyro_turn_rad) = (step.from_s, Some(0.0));
        for to_s in gyro.stamps_within(step.from_s, step.to_s).chain([step.to_s]) {
            let share = if step.to_s > step.from_s { (to_s - from_s) / (step.to_s - step.from_s) } else { 1.0 };
            let turn_rad = gyro.turn_rad(from_s, to_s, |stamp_s| self.bias.at(stamp_s));
            gyro_turn_rad = gyro_turn_rad.zip(turn_rad).map(|(sum, turn_rad)| sum + turn_rad);
            let turn_rad = turn_rad.unwrap_or_else(|| {
                if step.distance_m != 0.0 || step.difference_m != 0.0 {
                    self.moved_without_gyro_s += to_s - from_s;
                }
                share * step.yaw_rad(track_width_m)
            });
            self.pose = self.pose.compose(&Pose2::exp([share * step.distance_m, 0.0, turn_rad]));
            self.path.push(StampedPose { stamp_s: to_s, pose: self.pose }, known_s);
            from_s = to_s;
        }
        if self.learns {
            self.fit.add(step, gyro_turn_rad);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WHEELS: WheelConfig = WheelConfig { left_m_per_tick: 0.002, right_m_per_tick: 0.003, track_width_m: 1e12 };

    proptest! {
        #[test]
        fn every_tick_is_used_once_whatever_the_stamps(
            readings in prop::collection::vec((-1.0..9.0_f64, -50i32..50, -50i32..50), 1..60),
            uses_gyro in any::<bool>(),
        ) {
            let mut odometry = WheelOdometry::new(&WHEELS, uses_gyro, 0.0, &OdometryConfig::default(), None);
            let mut distance_m = 0.0;
            for (stamp_s, left, right) in readings {
                let (left_ticks, right_ticks) = (f64::from(left), f64::from(right));
                odometry.add_ticks(EncoderReading { stamp_s, left_ticks, right_ticks });
                odometry.advance(stamp_s - 1.0);
                distance_m += (left_ticks * 0.002 + right_ticks * 0.003) / 2.0;
            }
            odometry.advance(f64::INFINITY);
            prop_assert!((odometry.pose.x - distance_m).abs() < 1e-9);
            let stamps: Vec<f64> = odometry.path().knots().map(|knot| knot.stamp_s).collect();
            prop_assert!(stamps.windows(2).all(|pair| pair[0] <= pair[1]));
        }
    }
}
