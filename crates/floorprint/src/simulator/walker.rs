//! People: two legs each, walking to and fro.

use crate::geometry::Pose2;

/// Radius of a leg, metres.
pub(super) const LEG_RADIUS_M: f64 = 0.08;
/// A person steps aside from the robot's centre up to this distance, metres.
const PERSONAL_SPACE_M: f64 = 0.7;
/// Half the distance between the legs, metres.
const HALF_STANCE_M: f64 = 0.11;
/// How far a foot swings ahead of the body and back, metres.
const STRIDE_M: f64 = 0.25;
/// Steps a second.
const CADENCE_HZ: f64 = 0.9;

/// A person who walks to and fro along a line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Walker {
    /// Corners of the line, metres.
    pub(super) line_m: Vec<[f64; 2]>,
    /// Walking speed, m/s.
    pub(super) speed_m_s: f64,
    /// How far along the line the person is at the start, metres.
    pub(super) ahead_m: f64,
}

impl Walker {
    /// Where the legs are at a time, metres, when the robot is at `robot`.
    pub(super) fn legs_m(&self, time_s: f64, robot: &Pose2) -> [[f64; 2]; 2] {
        let length_m: f64 = self.line_m.windows(2).map(|ends| distance_m(ends[0], ends[1])).sum();
        let along_m = (self.ahead_m + self.speed_m_s * time_s).rem_euclid(2.0 * length_m.max(0.1));
        let returns = along_m > length_m;
        let mut left_m = if returns { 2.0 * length_m - along_m } else { along_m };
        let mut person = Pose2::IDENTITY;
        for ends in self.line_m.windows(2) {
            let leg_m = distance_m(ends[0], ends[1]).max(1e-9);
            let share = (left_m / leg_m).min(1.0);
            let [dx, dy] = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
            let turn = if returns { std::f64::consts::PI } else { 0.0 };
            person = Pose2::new(ends[0][0] + share * dx, ends[0][1] + share * dy, dy.atan2(dx) + turn);
            left_m -= leg_m;
            if left_m <= 0.0 {
                break;
            }
        }
        legs_m(&person, time_s, robot)
    }
}

/// The legs of the `index`-th of `people` who walk around the robot.
pub(super) fn companion_legs_m(index: usize, people: usize, time_s: f64, robot: &Pose2) -> [[f64; 2]; 2] {
    let turn = std::f64::consts::TAU * (index as f64 + 0.5) / people as f64;
    let phase = index as f64;
    let away_m = 1.1 + 0.3 * (0.5 * time_s + phase).sin();
    let sway = 0.3 * (0.37 * time_s + 2.0 * phase).sin();
    let beside = Pose2::new(away_m * (turn + sway).cos(), away_m * (turn + sway).sin(), 0.0);
    legs_m(&robot.compose(&beside), time_s, robot)
}

fn legs_m(person: &Pose2, time_s: f64, robot: &Pose2) -> [[f64; 2]; 2] {
    let [dx, dy] = [person.x - robot.x, person.y - robot.y];
    let near_m = dx.hypot(dy).max(1e-6);
    let aside = (PERSONAL_SPACE_M / near_m).max(1.0);
    let person = Pose2 { x: robot.x + dx * aside, y: robot.y + dy * aside, theta: person.theta };
    let swing_m = STRIDE_M * (std::f64::consts::TAU * CADENCE_HZ * time_s).sin();
    [person.transform_point([swing_m, HALF_STANCE_M]), person.transform_point([-swing_m, -HALF_STANCE_M])]
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// Distance along a ray of direction length one at which it enters a leg.
pub(super) fn leg_range_m(leg_m: [f64; 2], from_m: [f64; 2], direction: [f64; 2]) -> Option<f64> {
    let [dx, dy] = [leg_m[0] - from_m[0], leg_m[1] - from_m[1]];
    let along_m = dx * direction[0] + dy * direction[1];
    let beside_m = dx * direction[1] - dy * direction[0];
    let half_chord = LEG_RADIUS_M * LEG_RADIUS_M - beside_m * beside_m;
    (half_chord >= 0.0 && along_m > LEG_RADIUS_M).then(|| along_m - half_chord.sqrt())
}
