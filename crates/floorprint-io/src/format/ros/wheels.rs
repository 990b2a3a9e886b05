//! Wheels among the joints of a robot, told by their names.

use super::messages::Joints;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::fmt;

/// Joints with these in their names turn wheels about the vertical, or are turned by the floor.
const NOT_DRIVEN: [&str; 4] = ["steer", "caster", "castor", "swivel"];

/// Short words for the left side and the right.
const SIDES: [[&str; 4]; 2] = [["left", "l", "fl", "rl"], ["right", "r", "fr", "rr"]];

/// The joints that turn the wheels of either side.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wheels {
    sides: [Vec<String>; 2],
}

impl Wheels {
    /// The wheels among joints, as many on either side; none where the names tell of none.
    pub(super) fn among(joints: &BTreeSet<String>) -> Option<Self> {
        let is_of = |name: &String, side: &[&str; 4]| {
            let lower = name.to_ascii_lowercase();
            let says_side = lower.split(['_', '/', '-']).any(|word| side.contains(&word)) || lower.contains(side[0]);
            lower.contains("wheel") && says_side && !NOT_DRIVEN.iter().any(|word| lower.contains(word))
        };
        let sides = SIDES.map(|side| joints.iter().filter(|name| is_of(name, &side)).cloned().collect::<Vec<_>>());
        (!sides[0].is_empty() && sides[0].len() == sides[1].len()).then_some(Self { sides })
    }

    /// The mean angles of the wheels of either side, radians, as soon as a message and those before it that `wait` tell of all of
    /// them; none in a message of other joints.
    pub(super) fn angles_rad(&self, joints: &Joints, wait: &mut BTreeMap<String, f64>) -> Option<[f64; 2]> {
        for (name, angle) in joints.names.iter().zip(&joints.positions) {
            if angle.is_finite() && self.sides.iter().flatten().any(|wheel| wheel == name) {
                wait.insert(name.clone(), *angle);
            }
        }
        let mean = |names: &[String]| -> Option<f64> {
            let angles: Vec<f64> = names.iter().map(|name| wait.get(name).copied()).collect::<Option<_>>()?;
            Some(angles.iter().sum::<f64>() / angles.len() as f64)
        };
        let means = [mean(&self.sides[0])?, mean(&self.sides[1])?];
        wait.clear();
        Some(means)
    }

    /// Radians from one angle to the next: drivers that start anew after a turn jump by nearly one, which no wheel does
    /// between two messages.
    pub(super) fn turned_rad(before: f64, after: f64) -> f64 {
        let turned = after - before;
        let is_jump = before.abs() <= TAU + 0.01 && after.abs() <= TAU + 0.01 && turned.abs() > PI;
        if is_jump { turned - (turned / TAU).round() * TAU } else { turned }
    }
}

impl fmt::Display for Wheels {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} and {}", self.sides[0].join(", "), self.sides[1].join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn among(names: &[&str]) -> Option<String> {
        Wheels::among(&names.iter().map(|name| (*name).to_owned()).collect()).map(|wheels| wheels.to_string())
    }

    #[test]
    fn wheels_are_told_by_their_names() {
        assert_eq!(
            among(&["wheel_right_joint", "wheel_left_joint"]).unwrap(),
            "wheel_left_joint and wheel_right_joint"
        );
        let four = ["fl_wheel_joint", "fr_wheel_joint", "rl_wheel_joint", "rr_wheel_joint", "arm_1_joint"];
        assert_eq!(among(&four).unwrap(), "fl_wheel_joint, rl_wheel_joint and fr_wheel_joint, rr_wheel_joint");
        assert_eq!(among(&["leftWheel", "rightWheel"]).unwrap(), "leftWheel and rightWheel");
        assert_eq!(among(&["left_steering_wheel", "right_steering_wheel"]), None);
        assert_eq!(among(&["wheel_left_joint", "lift_joint"]), None);
    }

    #[test]
    fn angles_are_taken_by_name_and_may_start_anew() {
        let wheels = Wheels::among(&["wheel_left", "wheel_right"].map(str::to_owned).into()).unwrap();
        let names = ["arm", "wheel_right", "wheel_left"].map(str::to_owned).to_vec();
        let joints = Joints { stamp_s: 0.0, names, positions: vec![9.0, 2.0, 1.0] };
        let mut wait = BTreeMap::new();
        assert_eq!(wheels.angles_rad(&joints, &mut wait), Some([1.0, 2.0]));
        let mut of_one = |name: &str, angle: f64| {
            wheels.angles_rad(&Joints { stamp_s: 0.0, names: vec![name.to_owned()], positions: vec![angle] }, &mut wait)
        };
        assert_eq!(of_one("arm", 9.0), None);
        // A message for each wheel: the newest angle of either.
        assert_eq!((of_one("wheel_left", 1.0), of_one("wheel_left", 3.0)), (None, None));
        assert_eq!(of_one("wheel_right", 4.0), Some([3.0, 4.0]));
        assert_eq!(of_one("wheel_right", 5.0), None);
        assert!((Wheels::turned_rad(3.0, -3.0) - (TAU - 6.0)).abs() < 1e-12);
        assert_eq!((Wheels::turned_rad(100.0, 104.0), Wheels::turned_rad(0.5, 0.25)), (4.0, -0.25));
    }
}
