//! What a robot is localised in: a random world with a random robot, what goes wrong, and what is known of the start.

use floorprint::Frame;
use floorprint::geometry::Pose2;
use floorprint::simulator::{Fault as Simulated, Scenario, SimulationError, World};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// So long is the drive that is looked at, seconds.
pub(super) const DURATION_S: f64 = 60.0;
/// The robot is kidnapped so long after its beginning, seconds.
const KIDNAPPED_AFTER_S: f64 = 20.0;
/// How far wheels turn too far that slip.
const SLIP: f64 = 0.3;
/// Speed of the robot that is kidnapped to a place that looks alike, m/s, and how far the next such place is along its
/// route, metres.
const ALIKE_SPEED_M_S: f64 = 0.8;
const ALIKE_AHEAD_M: f64 = 60.0;
/// The second of five corridors that look alike lies between these along the route, metres.
const ALIKE_FROM_TO_M: [f64; 2] = [24.0, 36.0];

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Fault {
    None,
    /// People walk around the robot all the time.
    People,
    /// All that can be moved stands elsewhere than on the map.
    Furniture,
    /// Both.
    PeopleAndFurniture,
    /// The wheels turn too far.
    Slip,
    /// The robot is lifted and set down elsewhere on its route …
    Kidnapped,
    /// … or in a place that looks the same.
    KidnappedAlike,
    /// Nothing measures the motion.
    NoOdometry,
    /// Left and right are mixed up in the odometry.
    Mirrored,
    /// The odometry says that the robot stands still.
    Stuck,
}

impl Fault {
    pub(super) const ALL: [Self; 10] = [
        Self::None,
        Self::People,
        Self::Furniture,
        Self::PeopleAndFurniture,
        Self::Slip,
        Self::Kidnapped,
        Self::KidnappedAlike,
        Self::NoOdometry,
        Self::Mirrored,
        Self::Stuck,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::People => "people",
            Self::Furniture => "furniture",
            Self::PeopleAndFurniture => "people+furniture",
            Self::Slip => "slip",
            Self::Kidnapped => "kidnapped",
            Self::KidnappedAlike => "kidnapped_alike",
            Self::NoOdometry => "no_odometry",
            Self::Mirrored => "mirrored",
            Self::Stuck => "stuck",
        }
    }
}

/// What is known of the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Start {
    Known,
    Unknown,
}

impl Start {
    pub(super) const ALL: [Self; 2] = [Self::Known, Self::Unknown];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Known => "known",
            Self::Unknown => "unknown",
        }
    }
}

/// A case, which follows from its three parts alone; written as `people/unknown/123`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Case {
    pub(super) fault: Fault,
    pub(super) start: Start,
    pub(super) seed: u64,
}

impl fmt::Display for Case {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}/{}/{}", self.fault.name(), self.start.name(), self.seed)
    }
}

impl FromStr for Case {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.split('/').collect();
        let case = if let &[fault, start, seed] = parts.as_slice() {
            Fault::ALL.into_iter().find(|known| known.name() == fault).and_then(|fault| {
                let start = Start::ALL.into_iter().find(|known| known.name() == start)?;
                Some(Self { fault, start, seed: seed.parse().ok()? })
            })
        } else {
            None
        };
        let faults = Fault::ALL.map(Fault::name).join(", ");
        case.ok_or_else(|| {
            format!("expected FAULT/START/SEED, as people/unknown/123; faults are {faults}, starts known and unknown")
        })
    }
}

/// A case made ready.
pub(super) struct Setting {
    pub(super) scenario: Scenario,
    /// What is looked at: from when to when, seconds into the drive.
    pub(super) from_to_s: [f64; 2],
    /// When the robot is kidnapped, seconds into the drive.
    pub(super) kidnapped_s: Option<f64>,
    /// How far off the start is that is given, in standard deviations of its three coordinates.
    pub(super) start_off: [f64; 3],
}

impl Case {
    /// So many cases: of each fault and start in turn.
    pub(super) fn all(seed: u64, count: u64) -> Vec<Self> {
        let kinds = Fault::ALL.into_iter().flat_map(|fault| Start::ALL.map(|start| (fault, start)));
        let kinds: Vec<(Fault, Start)> = kinds.collect();
        let seeds = Scenario::seeds(seed, count).enumerate();
        seeds
            .map(|(number, seed)| (kinds[number % kinds.len()], seed))
            .map(|((fault, start), seed)| Self { fault, start, seed })
            .collect()
    }

    /// World, robot and fault.
    pub(super) fn setting(&self) -> Result<Setting, SimulationError> {
        // The robot has odometry; whether it is of use is up to the fault.
        let mut seeds = std::iter::once(self.seed).chain(Scenario::seeds(self.seed, 100));
        let drawn = seeds.by_ref().map(Scenario::random).find(|scenario| scenario.base != "no_odometry");
        let mut scenario = drawn.unwrap_or_else(|| Scenario::random(self.seed));
        let shares: Vec<f64> = Scenario::seeds(self.seed ^ 0x10ca_117e, 6).map(|n| n as f64 / 2_f64.powi(32)).collect();
        let between = |number: usize, from: f64, to: f64| from + shares[number] * (to - from);
        if self.fault == Fault::KidnappedAlike {
            scenario.world = World::named("five_corridors", self.seed)?;
            scenario.world_kind = "five_corridors";
            scenario.config.motion.speed_m_s = ALIKE_SPEED_M_S;
        }
        let whole_s = scenario.world.route_length_m() / scenario.config.motion.speed_m_s;
        let room_s = match self.fault {
            Fault::Kidnapped => 0.3 * whole_s,
            _ => (whole_s - DURATION_S).max(0.0),
        };
        let from_s = between(0, 0.0, room_s);
        let mut from_to_s = [from_s, from_s + DURATION_S];
        let mut kidnapped_s = None;
        let long_s = 10.0 * whole_s + 1e3;
        let people = Simulated::PeopleAlong { from_s: 0.0, for_s: long_s, people: between(1, 4.0, 11.0) as usize };
        let moved = Simulated::FurnitureMoved { at_s: 0.0 };
        scenario.config.faults = match self.fault {
            Fault::None | Fault::NoOdometry | Fault::Mirrored | Fault::Stuck => Vec::new(),
            Fault::People => vec![people],
            Fault::Furniture => vec![moved],
            Fault::PeopleAndFurniture => vec![people, moved],
            Fault::Slip => vec![Simulated::WheelSlip { from_s: from_s + 5.0, for_s: long_s, share: SLIP }],
            Fault::Kidnapped => {
                let at_s = from_s + KIDNAPPED_AFTER_S;
                kidnapped_s = Some(at_s);
                vec![Simulated::Kidnapping { at_s, ahead_m: between(1, 0.15, 0.4) * scenario.world.route_length_m() }]
            }
            Fault::KidnappedAlike => {
                let [from_m, to_m] = ALIKE_FROM_TO_M;
                let at_s = scenario.config.motion.standstill_s + 4.0 + between(1, from_m, to_m) / ALIKE_SPEED_M_S;
                from_to_s = [at_s - KIDNAPPED_AFTER_S, at_s + DURATION_S - KIDNAPPED_AFTER_S];
                kidnapped_s = Some(at_s);
                vec![Simulated::Kidnapping { at_s, ahead_m: ALIKE_AHEAD_M }]
            }
        };
        self.fault.name().clone_into(&mut scenario.fault_kind);
        let start_off = [2, 3, 4].map(|number| between(number, -1.5, 1.5));
        Ok(Setting { scenario, from_to_s, kidnapped_s, start_off })
    }

    /// A frame as its odometry has it once the fault had its way.
    pub(super) fn spoil(&self, frame: &mut Frame) {
        match self.fault {
            Fault::NoOdometry => frame.motion = None,
            Fault::Stuck => frame.motion = frame.motion.map(|_| Pose2::IDENTITY),
            Fault::Mirrored => {
                frame.motion = frame.motion.map(|motion| Pose2 { y: -motion.y, theta: -motion.theta, ..motion });
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_named_and_follow_from_their_names() {
        let cases = Case::all(3, 40);
        assert_eq!(cases.iter().filter(|case| case.fault == Fault::People && case.start == Start::Unknown).count(), 2);
        for case in cases {
            assert_eq!(case.to_string().parse(), Ok(case));
        }
        let message = "people/unknown".parse::<Case>().unwrap_err();
        assert!(message.contains("people/unknown/123") && message.contains("kidnapped_alike"), "{message}");
    }

    #[test]
    fn a_kidnapped_robot_is_in_sight_of_its_kidnapping() {
        for case in Case::all(1, 20) {
            let setting = case.setting().unwrap();
            let [from_s, to_s] = setting.from_to_s;
            let is_inside = setting.kidnapped_s.is_none_or(|at_s| at_s > from_s + 10.0 && at_s < to_s - 10.0);
            assert!(is_inside && from_s >= 0.0, "{case}: {:?} in {:?}", setting.kidnapped_s, setting.from_to_s);
        }
    }
}
