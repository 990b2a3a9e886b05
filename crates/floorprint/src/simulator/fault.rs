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

impl Fault {
    /// Its setting that cannot be, if there is one: the key, the value and what is expected.
    pub(super) fn impossible_setting(&self) -> Option<(&'static str, f64, &'static str)> {
        let (span, own) = match *self {
            Self::Kidnapping { at_s, ahead_m } => ([at_s, 0.0], ("faults.kidnapping.ahead_m", ahead_m, MOST_METRES)),
            Self::WheelSlip { from_s, for_s, share } => ([from_s, for_s], ("faults.wheel_slip.share", share, NUMBER)),
            Self::EncodersJump { from_s, for_s, jump_m } => {
                ([from_s, for_s], ("faults.encoders_jump.jump_m", jump_m, MOST_METRES))
            }
            Self::RaysLost { from_s, for_s, share } => ([from_s, for_s], ("faults.rays_lost.share", share, SHARE)),
            Self::EncodersStuck { from_s, for_s }
            | Self::EncodersSignLost { from_s, for_s }
            | Self::LidarDropout { from_s, for_s }
            | Self::PeopleAlong { from_s, for_s, .. } => ([from_s, for_s], ("faults", 0.0, NUMBER)),
        };
        let (key, value, expected) = own;
        let is_possible = match expected {
            SHARE => (0.0..=1.0).contains(&value),
            MOST_METRES => value.abs() <= 1e6,
            _ => value.is_finite(),
        };
        let time = span.into_iter().find(|time_s| !(0.0..=1e9).contains(time_s));
        let of_time = time.map(|time_s| ("the time of a fault", time_s, "seconds from 0 on"));
        of_time.or((!is_possible).then_some((key, value, expected)))
    }
}

const SHARE: &str = "a share from 0 to 1";
const MOST_METRES: &str = "metres, no more than a million";
const NUMBER: &str = "a number";

/// Whether `time_s` lies within `for_s` seconds from `from_s` on.
pub(super) fn within(time_s: f64, from_s: f64, for_s: f64) -> bool {
    time_s >= from_s && time_s < from_s + for_s
}
