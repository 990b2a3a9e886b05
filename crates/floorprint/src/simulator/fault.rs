//! What can go wrong on a simulated drive.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A fault, with the seconds since the start of the drive at which it happens.
///
/// The truth knows of all of them: it is always where the robot really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fault {
    /// The robot is lifted and set down farther along its route; neither wheels nor gyro notice.
    Kidnapping {
        /// When, seconds.
        at_s: f64,
        /// How far along the route, metres.
        ahead_m: f64,
    },
    /// The wheels spin: they turn farther than the robot drives.
    WheelSlip {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
        /// By which share they turn too far; 1 means twice the distance.
        share: f64,
    },
    /// The encoders count nothing.
    EncodersStuck {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
    },
    /// Once a second the encoders count a distance that was not driven, forwards or backwards.
    EncodersJump {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
        /// Length of each jump, metres.
        jump_m: f64,
    },
    /// The encoders lose their sign: what is driven in reverse counts as driven ahead.
    EncodersSignLost {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
    },
    /// The wheels of the left side spin: the odometry turns although the robot does not.
    LeftWheelsSlip {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
        /// By which share they turn too far.
        share: f64,
    },
    /// A clock is set: stamps jump.
    ClockStep {
        /// When, seconds.
        at_s: f64,
        /// By how much, seconds.
        by_s: f64,
        /// Whether only the LiDAR's stamps jump; else those of all sensors do.
        lidar_only: bool,
    },
    /// All that can be moved in this world is somewhere else from now on.
    FurnitureMoved {
        /// When, seconds.
        at_s: f64,
    },
    /// Doors swing to and fro; they are open otherwise.
    DoorsMove {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
    },
    /// No scan arrives.
    LidarDropout {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
    },
    /// Nothing comes back from many of the rays.
    RaysLost {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
        /// Share of the rays.
        share: f64,
    },
    /// People walk along with the robot, around it.
    PeopleAlong {
        /// From when, seconds.
        from_s: f64,
        /// For how long, seconds.
        for_s: f64,
        /// How many people.
        people: usize,
    },
}

/// What a setting may be: the least, the most, and both in words.
type Bounds = (f64, f64, &'static str);

const SECONDS: Bounds = (0.0, 1e9, "seconds from 0 to 1e9");
const METRES: Bounds = (-1e6, 1e6, "metres, no more than a million");
const SHARE: Bounds = (0.0, 1.0, "a share from 0 to 1");
const STEP: Bounds = (-1e6, 1e6, "seconds, no more than a million");
const SLIP: Bounds = (-1e3, 1e3, "a share, no more than a thousandfold");

impl Fault {
    /// Its first setting that cannot be, if there is one: the key, the value and what is expected.
    pub(super) fn impossible_setting(&self) -> Option<(&'static str, f64, &'static str)> {
        let settings = match *self {
            Self::Kidnapping { at_s, ahead_m } => {
                vec![("faults.kidnapping.at_s", at_s, SECONDS), ("faults.kidnapping.ahead_m", ahead_m, METRES)]
            }
            Self::WheelSlip { from_s, for_s, share } => vec![
                ("faults.wheel_slip.from_s", from_s, SECONDS),
                ("faults.wheel_slip.for_s", for_s, SECONDS),
                ("faults.wheel_slip.share", share, SLIP),
            ],
            Self::EncodersStuck { from_s, for_s } => {
                vec![("faults.encoders_stuck.from_s", from_s, SECONDS), ("faults.encoders_stuck.for_s", for_s, SECONDS)]
            }
            Self::EncodersJump { from_s, for_s, jump_m } => vec![
                ("faults.encoders_jump.from_s", from_s, SECONDS),
                ("faults.encoders_jump.for_s", for_s, SECONDS),
                ("faults.encoders_jump.jump_m", jump_m, METRES),
            ],
            Self::EncodersSignLost { from_s, for_s } => vec![
                ("faults.encoders_sign_lost.from_s", from_s, SECONDS),
                ("faults.encoders_sign_lost.for_s", for_s, SECONDS),
            ],
            Self::LeftWheelsSlip { from_s, for_s, share } => vec![
                ("faults.left_wheels_slip.from_s", from_s, SECONDS),
                ("faults.left_wheels_slip.for_s", for_s, SECONDS),
                ("faults.left_wheels_slip.share", share, SLIP),
            ],
            Self::ClockStep { at_s, by_s, .. } => {
                vec![("faults.clock_step.at_s", at_s, SECONDS), ("faults.clock_step.by_s", by_s, STEP)]
            }
            Self::FurnitureMoved { at_s } => vec![("faults.furniture_moved.at_s", at_s, SECONDS)],
            Self::DoorsMove { from_s, for_s } => {
                vec![("faults.doors_move.from_s", from_s, SECONDS), ("faults.doors_move.for_s", for_s, SECONDS)]
            }
            Self::LidarDropout { from_s, for_s } => {
                vec![("faults.lidar_dropout.from_s", from_s, SECONDS), ("faults.lidar_dropout.for_s", for_s, SECONDS)]
            }
            Self::RaysLost { from_s, for_s, share } => vec![
                ("faults.rays_lost.from_s", from_s, SECONDS),
                ("faults.rays_lost.for_s", for_s, SECONDS),
                ("faults.rays_lost.share", share, SHARE),
            ],
            Self::PeopleAlong { from_s, for_s, .. } => {
                vec![("faults.people_along.from_s", from_s, SECONDS), ("faults.people_along.for_s", for_s, SECONDS)]
            }
        };
        let is_impossible = |&(_, value, (least, most, _)): &(&str, f64, Bounds)| !(least..=most).contains(&value);
        settings.into_iter().find(is_impossible).map(|(key, value, (_, _, expected))| (key, value, expected))
    }
}

/// By how much the stamp of a reading at `time_s` is wrong, seconds: of a scan, or of another sensor.
pub(super) fn clock_error_s(faults: &[Fault], time_s: f64, is_scan: bool) -> f64 {
    let step_s = |fault: &Fault| match *fault {
        Fault::ClockStep { at_s, by_s, lidar_only } if time_s >= at_s && (is_scan || !lidar_only) => by_s,
        _ => 0.0,
    };
    faults.iter().map(step_s).sum()
}

/// Whether `time_s` lies within `for_s` seconds from `from_s` on.
pub(super) fn within(time_s: f64, from_s: f64, for_s: f64) -> bool {
    time_s >= from_s && time_s < from_s + for_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::SimulationConfig;

    #[test]
    fn numbers_that_cannot_be_are_refused_by_their_key() {
        for (fault, key) in [
            (Fault::Kidnapping { at_s: 5.0, ahead_m: f64::NAN }, "faults.kidnapping.ahead_m"),
            (Fault::Kidnapping { at_s: -1.0, ahead_m: 3.0 }, "faults.kidnapping.at_s"),
            (Fault::RaysLost { from_s: 0.0, for_s: 1.0, share: 1.5 }, "faults.rays_lost.share"),
            (Fault::LidarDropout { from_s: 0.0, for_s: f64::INFINITY }, "faults.lidar_dropout.for_s"),
            (Fault::EncodersJump { from_s: 0.0, for_s: 1.0, jump_m: 1e300 }, "faults.encoders_jump.jump_m"),
        ] {
            let config = SimulationConfig { faults: vec![fault], ..SimulationConfig::default() };
            let message = config.validate().unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
        let fine = vec![
            Fault::Kidnapping { at_s: 5.0, ahead_m: -3.0 },
            Fault::RaysLost { from_s: 0.0, for_s: 9.0, share: 0.3 },
        ];
        assert_eq!(SimulationConfig { faults: fine, ..SimulationConfig::default() }.validate(), Ok(()));
    }
}
