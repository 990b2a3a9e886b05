//! The robot's true motion: a differential drive that follows its route.
//!
//! Steering is pure pursuit (Coulter 1992) with limits on acceleration and yaw rate;
//! where the route turns sharply or changes direction the robot turns on the spot.

use super::config::MotionConfig;
use super::fault::Fault;
use super::world::{Command, Waypoint, World};
use crate::geometry::{Pose2, wrap_angle};
use std::f64::consts::PI;

/// Time between two samples of the motion, seconds. Within it the motion is uniform.
const STEP_S: f64 = 0.01;
/// How far ahead on its route the robot aims, metres.
const LOOKAHEAD_M: f64 = 0.6;
/// Off its aim by more than this the robot turns on the spot, radians.
const TURN_ON_THE_SPOT_RAD: f64 = 0.7;
/// The sharper a corner, the slower it is taken; from this bend on at the least speed, radians.
const CORNER_RAD: f64 = 1.5;
/// The least speed in a corner, as a share of the speed on straight stretches.
const CORNER_SPEED_SHARE: f64 = 0.3;
/// Standstill at the end of the drive, seconds.
const FINAL_STANDSTILL_S: f64 = 1.0;
/// Samples that are farther apart than this are no motion but a kidnapping, metres.
const KIDNAPPED_M: f64 = 0.1;

/// Where the robot is at any time, and how far its wheels have rolled.
#[derive(Debug, Clone)]
pub(super) struct Trajectory {
    samples: Vec<Sample>,
}

/// The robot's state at a time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sample {
    /// `building_from_body`, metres.
    pub(super) position_m: [f64; 2],
    /// Heading, radians, not wrapped.
    pub(super) heading_rad: f64,
    /// Speed of the body's origin, m/s; negative in reverse.
    pub(super) speed_m_s: f64,
    /// Yaw rate, rad/s.
    pub(super) turn_rate_rad_s: f64,
    /// How far the body's origin has travelled, metres; reverse counts backwards.
    pub(super) travelled_m: f64,
    /// By how much the course has turned, radians, kidnappings aside.
    pub(super) turned_rad: f64,
    /// How far the body looks to the left of its course, radians.
    pub(super) aside_rad: f64,
}

impl Sample {
    /// `building_from_body`.
    pub(super) fn pose(&self) -> Pose2 {
        Pose2::new(self.position_m[0], self.position_m[1], self.heading_rad)
    }
}

impl Trajectory {
    /// Drives the world's route, starting `heading_error_rad` off its direction.
    pub(super) fn drive(world: &World, motion: &MotionConfig, faults: &[Fault], heading_error_rad: f64) -> Self {
        let mut driver = Driver::new(world, motion, heading_error_rad);
        driver.stand(motion.standstill_s);
        let mut kidnappings: Vec<(f64, f64)> = faults
            .iter()
            .filter_map(|fault| match *fault {
                Fault::Kidnapping { at_s, ahead_m } => Some((at_s, ahead_m)),
                _ => None,
            })
            .collect();
        kidnappings.sort_by(|a, b| b.0.total_cmp(&a.0));
        for command in world.commands() {
            driver.obey(command);
        }
        if world.commands().is_empty() {
            let mut pauses_s = motion.pauses_s.clone();
            pauses_s.sort_by(|a, b| b[0].total_cmp(&a[0]));
            for run in Run::split(world.route()) {
                driver.follow(&run, &mut kidnappings, &mut pauses_s);
            }
        }
        driver.stand(FINAL_STANDSTILL_S);
        let mut samples = driver.samples;
        look_aside(&mut samples, motion);
        Self { samples }
    }

    /// The motion of the body's origin between two times in its own axes, by the wheels: a kidnapping is not in it.
    pub(super) fn motion(&self, from_s: f64, to_s: f64) -> Pose2 {
        let (from, to) = (self.at(from_s), self.at(to_s));
        let course = Pose2::exp([to.travelled_m - from.travelled_m, 0.0, to.turned_rad - from.turned_rad]);
        let aside = |sample: &Sample| Pose2::new(0.0, 0.0, sample.aside_rad);
        aside(&from).inverse().compose(&course).compose(&aside(&to))
    }

    /// Time from the first moment to the last, seconds.
    pub(super) fn duration_s(&self) -> f64 {
        (self.samples.len() - 1) as f64 * STEP_S
    }

    /// The state at a time; the nearest end's outside of the drive.
    pub(super) fn at(&self, time_s: f64) -> Sample {
        let place = (time_s / STEP_S).clamp(0.0, (self.samples.len() - 1) as f64);
        let index = (place as usize).min(self.samples.len().saturating_sub(2));
        let share = place - index as f64;
        let (a, b) = (&self.samples[index], &self.samples[(index + 1).min(self.samples.len() - 1)]);
        let [dx, dy] = [b.position_m[0] - a.position_m[0], b.position_m[1] - a.position_m[1]];
        if dx.hypot(dy) > KIDNAPPED_M {
            return if share < 0.5 { *a } else { *b };
        }
        let blend = |from: f64, to: f64| from + share * (to - from);
        Sample {
            position_m: [a.position_m[0] + share * dx, a.position_m[1] + share * dy],
            heading_rad: blend(a.heading_rad, b.heading_rad),
            speed_m_s: blend(a.speed_m_s, b.speed_m_s),
            turn_rate_rad_s: blend(a.turn_rate_rad_s, b.turn_rate_rad_s),
            travelled_m: blend(a.travelled_m, b.travelled_m),
            turned_rad: blend(a.turned_rad, b.turned_rad),
            aside_rad: blend(a.aside_rad, b.aside_rad),
        }
    }
}

/// Turns the body of an omnidirectional robot to either side of its course, to and fro.
fn look_aside(samples: &mut [Sample], motion: &MotionConfig) {
    if motion.look_aside_rad == 0.0 {
        return;
    }
    let rate_rad_s = std::f64::consts::TAU / motion.look_aside_period_s;
    for (index, sample) in samples.iter_mut().enumerate() {
        let moving_s = (index as f64 * STEP_S - motion.standstill_s).max(0.0);
        sample.aside_rad = motion.look_aside_rad * (rate_rad_s * moving_s).sin();
        sample.heading_rad += sample.aside_rad;
        if moving_s > 0.0 {
            sample.turn_rate_rad_s += motion.look_aside_rad * rate_rad_s * (rate_rad_s * moving_s).cos();
        }
    }
}

/// A stretch of the route that is driven in one direction.
struct Run {
    corners_m: Vec<[f64; 2]>,
    /// Distance from the run's start to each corner, metres.
    along_m: Vec<f64>,
    in_reverse: bool,
}

impl Run {
    fn split(route: &[Waypoint]) -> Vec<Self> {
        let mut runs: Vec<Self> = Vec::new();
        for leg in route.windows(2) {
            let in_reverse = leg[1].in_reverse;
            match runs.last_mut() {
                Some(run) if run.in_reverse == in_reverse => run.corners_m.push(leg[1].position_m),
                _ => runs.push(Self {
                    corners_m: vec![leg[0].position_m, leg[1].position_m],
                    along_m: Vec::new(),
                    in_reverse,
                }),
            }
        }
        for run in &mut runs {
            let mut along_m = 0.0;
            run.along_m.push(0.0);
            for ends in run.corners_m.windows(2) {
                along_m += (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1]);
                run.along_m.push(along_m);
            }
        }
        runs
    }

    fn length_m(&self) -> f64 {
        self.along_m.last().copied().unwrap_or(0.0)
    }

    fn leg(&self, along_m: f64) -> usize {
        self.along_m.partition_point(|&corner| corner <= along_m).clamp(1, self.corners_m.len() - 1) - 1
    }

    /// The route's point at a distance from its start; beyond its end, straight on.
    fn point_m(&self, along_m: f64) -> [f64; 2] {
        let leg = self.leg(along_m);
        let (from, to) = (self.corners_m[leg], self.corners_m[leg + 1]);
        let share = (along_m - self.along_m[leg]) / (self.along_m[leg + 1] - self.along_m[leg]).max(1e-9);
        [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]
    }

    /// The speed from which the robot can still slow down for the next corner and stop at the end.
    fn speed_m_s(&self, along_m: f64, motion: &MotionConfig) -> f64 {
        let leg = self.leg(along_m);
        let brakes_m_s = |speed: f64, room_m: f64| (speed * speed + 2.0 * motion.acceleration_m_s2 * room_m).sqrt();
        let mut speed_m_s = motion.speed_m_s.min(brakes_m_s(0.05, self.length_m() - along_m));
        if leg + 2 < self.corners_m.len() {
            let bend_rad = wrap_angle(self.leg_direction_rad(leg + 1) - self.leg_direction_rad(leg)).abs();
            let in_corner_m_s = motion.speed_m_s * (1.0 - bend_rad / CORNER_RAD).max(CORNER_SPEED_SHARE);
            let room_m = (self.along_m[leg + 1] - along_m - LOOKAHEAD_M).max(0.0);
            speed_m_s = speed_m_s.min(brakes_m_s(in_corner_m_s, room_m));
        }
        speed_m_s
    }

    /// Where along the run the robot is: at the nearest point of this leg or the next, never backwards.
    fn progress_m(&self, along_m: f64, [x, y]: [f64; 2]) -> f64 {
        let leg = self.leg(along_m);
        let mut nearest = (f64::INFINITY, along_m);
        for leg in leg..(leg + 2).min(self.corners_m.len() - 1) {
            let (sin, cos) = self.leg_direction_rad(leg).sin_cos();
            let from = self.corners_m[leg];
            let foot_m = self.along_m[leg] + (x - from[0]) * cos + (y - from[1]) * sin;
            let foot_m = foot_m.clamp(self.along_m[leg], self.along_m[leg + 1]).max(along_m);
            let point = self.point_m(foot_m);
            let off_m = (x - point[0]).hypot(y - point[1]);
            if foot_m <= along_m + LOOKAHEAD_M && off_m < nearest.0 {
                nearest = (off_m, foot_m);
            }
        }
        nearest.1
    }

    fn leg_direction_rad(&self, leg: usize) -> f64 {
        let (from, to) = (self.corners_m[leg], self.corners_m[leg + 1]);
        (to[1] - from[1]).atan2(to[0] - from[0])
    }

    fn direction_rad(&self, along_m: f64) -> f64 {
        self.leg_direction_rad(self.leg(along_m))
    }
}

struct Driver<'a> {
    motion: &'a MotionConfig,
    samples: Vec<Sample>,
    state: Sample,
}

impl<'a> Driver<'a> {
    fn new(world: &World, motion: &'a MotionConfig, heading_error_rad: f64) -> Self {
        let start = world.start();
        let state = Sample {
            position_m: [start.x, start.y],
            heading_rad: start.theta + heading_error_rad,
            ..Sample::default()
        };
        Self { motion, samples: vec![state], state }
    }

    fn stand(&mut self, duration_s: f64) {
        for _ in 0..(duration_s / STEP_S).ceil() as usize {
            self.step(0.0, 0.0);
        }
    }

    /// Keeps to a command's speeds, then stops.
    fn obey(&mut self, command: &Command) {
        for _ in 0..(command.for_s / STEP_S).ceil() as usize {
            self.step(command.speed_m_s, command.turn_rate_rad_s);
        }
        self.stop();
    }

    fn stop(&mut self) {
        while self.state.speed_m_s != 0.0 || self.state.turn_rate_rad_s != 0.0 {
            self.step(0.0, 0.0);
        }
    }

    /// Drives to the end of the run. `kidnappings` holds (when, how far ahead), `pauses_s` (when, how long), latest
    /// first.
    fn follow(&mut self, run: &Run, kidnappings: &mut Vec<(f64, f64)>, pauses_s: &mut Vec<[f64; 2]>) {
        let forward = if run.in_reverse { -1.0 } else { 1.0 };
        let mut along_m = 0.0;
        // A bound on the work, far above what any route takes.
        let steps = (20.0 * run.length_m() / self.motion.speed_m_s / STEP_S) as usize + 10_000;
        for _ in 0..steps {
            let remaining_m = run.length_m() - along_m;
            if remaining_m < 0.02 {
                break;
            }
            let time_s = self.samples.len() as f64 * STEP_S;
            if let Some((_, ahead_m)) = kidnappings.pop_if(|&mut (at_s, _)| at_s <= time_s) {
                along_m = (along_m + ahead_m).clamp(0.0, run.length_m() - 0.1);
                self.state.position_m = run.point_m(along_m);
                self.state.heading_rad = run.direction_rad(along_m) + if run.in_reverse { PI } else { 0.0 };
                continue;
            }
            if let Some([_, for_s]) = pauses_s.pop_if(|pause_s| pause_s[0] <= time_s) {
                self.stop();
                self.stand(for_s);
                along_m = run.progress_m(along_m, self.state.position_m);
                continue;
            }
            let aim = run.point_m(along_m + LOOKAHEAD_M);
            let [dx, dy] = [aim[0] - self.state.position_m[0], aim[1] - self.state.position_m[1]];
            let course_rad = self.state.heading_rad + if run.in_reverse { PI } else { 0.0 };
            let off_rad = wrap_angle(dy.atan2(dx) - course_rad);
            let turning = (1.0 - off_rad.abs() / TURN_ON_THE_SPOT_RAD).max(0.0);
            self.step(forward * run.speed_m_s(along_m, self.motion) * turning, 2.5 * off_rad);
            along_m = run.progress_m(along_m, self.state.position_m);
        }
        self.stop();
    }

    fn step(&mut self, speed_m_s: f64, turn_rate_rad_s: f64) {
        let approach = |from: f64, to: f64, most: f64| from + (to - from).clamp(-most, most);
        let motion = self.motion;
        let limit = motion.turn_rate_rad_s;
        let before = self.state;
        let state = &mut self.state;
        state.speed_m_s = approach(state.speed_m_s, speed_m_s, motion.acceleration_m_s2 * STEP_S);
        state.turn_rate_rad_s = approach(
            state.turn_rate_rad_s,
            turn_rate_rad_s.clamp(-limit, limit),
            motion.turn_acceleration_rad_s2 * STEP_S,
        );
        let travelled_m = 0.5 * (before.speed_m_s + state.speed_m_s) * STEP_S;
        let turned_rad = 0.5 * (before.turn_rate_rad_s + state.turn_rate_rad_s) * STEP_S;
        let pose = before.pose().compose(&Pose2::exp([travelled_m, 0.0, turned_rad]));
        state.position_m = [pose.x, pose.y];
        state.heading_rad += turned_rad;
        state.travelled_m += travelled_m;
        state.turned_rad += turned_rad;
        self.samples.push(*state);
    }
}
