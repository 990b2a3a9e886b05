//! What goes wrong on a random drive.

use super::fault::Fault;
use super::world::World;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// The kinds, as a table names them.
pub(super) const KINDS: [&str; 15] = [
    "people",
    "crowd",
    "doors",
    "furniture",
    "wheel_slip",
    "left_wheels_slip",
    "stuck_encoders",
    "jumps",
    "sign_lost",
    "rays_lost",
    "short_gap",
    "long_gap",
    "gap_and_stuck",
    "kidnapping",
    "clock_step",
];

/// Faults of a drive that takes `duration_s` on a route of `world`, and what they are called: half of all drives have
/// none, a few two.
pub(super) fn random_faults(random: &mut Pcg64Mcg, world: &World, duration_s: f64) -> (Vec<Fault>, String) {
    let count = [0, 0, 0, 0, 0, 1, 1, 1, 1, 2][random.random_range(0..10)];
    let mut faults = Vec::new();
    let mut names: Vec<&str> = Vec::new();
    for _ in 0..count {
        let kind = KINDS[random.random_range(0..KINDS.len())];
        if !names.contains(&kind) {
            names.push(kind);
            faults.extend(draw(kind, random, world, duration_s));
        }
    }
    names.sort_unstable();
    (faults, if names.is_empty() { "none".to_owned() } else { names.join("+") })
}

/// The faults of one kind, as they come about on a drive that takes `duration_s` on a route of `world`.
pub(super) fn draw(kind: &str, random: &mut Pcg64Mcg, world: &World, duration_s: f64) -> Vec<Fault> {
    let at_s = duration_s * random.random_range(0.25..0.75);
    let from_s = at_s;
    let mut seconds = |least: f64, most: f64| random.random_range(least..most).min(0.25 * duration_s);
    match kind {
        "people" => vec![Fault::PeopleAlong { from_s, for_s: seconds(20.0, 80.0), people: random.random_range(2..6) }],
        "crowd" => vec![Fault::PeopleAlong { from_s, for_s: seconds(10.0, 60.0), people: random.random_range(8..16) }],
        "doors" => vec![Fault::DoorsMove { from_s: 0.0, for_s: duration_s }],
        "furniture" => vec![Fault::FurnitureMoved { at_s }],
        "wheel_slip" => {
            let for_s = seconds(3.0, 25.0);
            let share =
                if random.random_bool(0.3) { random.random_range(-0.7..-0.1) } else { random.random_range(0.2..1.5) };
            vec![Fault::WheelSlip { from_s, for_s, share }]
        }
        "left_wheels_slip" => {
            let for_s = seconds(2.0, 10.0);
            vec![Fault::LeftWheelsSlip { from_s, for_s, share: random.random_range(0.1..1.0) }]
        }
        "stuck_encoders" => vec![Fault::EncodersStuck { from_s, for_s: seconds(5.0, 30.0) }],
        "jumps" => {
            let for_s = seconds(10.0, 40.0);
            vec![Fault::EncodersJump { from_s, for_s, jump_m: random.random_range(0.2..1.0) }]
        }
        "sign_lost" => vec![Fault::EncodersSignLost { from_s: 0.0, for_s: duration_s }],
        "rays_lost" => {
            let for_s = seconds(10.0, 60.0);
            vec![Fault::RaysLost { from_s, for_s, share: random.random_range(0.4..0.95) }]
        }
        "short_gap" => vec![Fault::LidarDropout { from_s, for_s: seconds(2.0, 6.0) }],
        "long_gap" => vec![Fault::LidarDropout { from_s, for_s: seconds(8.0, 25.0) }],
        "gap_and_stuck" => {
            let for_s = seconds(4.0, 15.0);
            vec![Fault::LidarDropout { from_s, for_s }, Fault::EncodersStuck { from_s, for_s }]
        }
        "kidnapping" => {
            let route_m = world.route_length_m();
            let ahead_m = random.random_range(0.05..0.45) * route_m;
            vec![Fault::Kidnapping {
                at_s: 0.6 * at_s,
                ahead_m: if random.random_bool(0.4) { -ahead_m } else { ahead_m },
            }]
        }
        _ => {
            let by_s = random.random_range(0.1..3.0) * if random.random_bool(0.5) { 1.0 } else { -1.0 };
            vec![Fault::ClockStep { at_s, by_s, lidar_only: random.random_bool(0.5) }]
        }
    }
}
