//! The named worlds.

use super::SimulationError;
use super::config::SimulationConfig;
use super::floor_plan::{FloorPlan, Rectangle};
use super::world::World;
use super::worlds_of_their_own::{campus, maneuver, maneuvers, robot_of};
use crate::geometry::Pose2;
use rand::RngExt;

type Builder = fn(u64) -> FloorPlan;

/// Every world with the function that draws it, but for the six maneuvers.
const WORLDS: [(&str, Builder); 15] = [
    ("rooms", rooms),
    ("corridors", corridors),
    ("loop", small_loop),
    ("pillars", pillars),
    ("glass", glass),
    ("people", people),
    ("figure_of_eight", figure_of_eight),
    ("five_corridors", five_corridors),
    ("long_loop", long_loop),
    ("long_office", long_office),
    ("main_building", main_building),
    ("large_hall", large_hall),
    ("identical_rooms", identical_rooms),
    ("look_alike", look_alike),
    ("campus", campus),
];

impl World {
    /// The names of all worlds.
    pub fn names() -> impl Iterator<Item = &'static str> {
        WORLDS.iter().map(|(name, _)| *name).chain(maneuvers())
    }

    /// The robot that drives through a named world, where that has one of its own.
    #[must_use]
    pub fn own_robot(name: &str) -> Option<SimulationConfig> {
        robot_of(name)
    }

    /// The world of a name; furniture, recesses and colours come from the seed.
    ///
    /// # Errors
    /// When no world has that name.
    pub fn named(name: &str, seed: u64) -> Result<Self, SimulationError> {
        if maneuvers().any(|maneuver| maneuver == name) {
            return Ok(maneuver(name, seed).build(name));
        }
        let builder = WORLDS.iter().find(|(known, _)| *known == name).map(|(_, builder)| builder);
        let builder = builder.ok_or_else(|| SimulationError::unknown_world(name))?;
        Ok(builder(seed).build(name))
    }

    /// An office like "long_office" of a size to choose: its route is `length_m` long, within a few per cent.
    #[must_use]
    pub fn office(length_m: f64, seed: u64) -> Self {
        // Small offices have short corridors, so that they still have several.
        let rooms = if length_m < 1000.0 { 9 } else { 24 };
        let size = OfficeSize { corridors: 0, rooms, visit_every: 3 };
        let corridors = (length_m / size.route_of_a_corridor_m()).round().clamp(2.0, 1000.0) as usize;
        office(FloorPlan::new(seed, 14), OfficeSize { corridors, ..size }).build("office")
    }
}

/// An office: a corridor with rooms on both sides, two of which are joined by a door.
fn rooms(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 1);
    let corridor = plan.space([0.0, 14.0], [0.0, 2.0]);
    let north = [plan.space([0.0, 6.8], [2.2, 7.0]), plan.space([7.0, 14.0], [2.2, 7.0])];
    let south = [
        plan.space([0.0, 4.5], [-4.4, -0.2]),
        plan.space([4.7, 9.3], [-4.4, -0.2]),
        plan.space([9.5, 14.0], [-4.4, -0.2]),
    ];
    plan.space([1.1, 2.3], [2.0, 2.2]);
    plan.space([10.9, 12.1], [2.0, 2.2]);
    plan.space([6.8, 7.0], [3.9, 5.1]);
    plan.space([2.0, 3.0], [-0.2, 0.0]);
    plan.space([6.3, 7.5], [-0.2, 0.0]);
    plan.space([11.0, 12.0], [-0.2, 0.0]);
    plan.niches(corridor);
    plan.drive_to(&[[6.0, 1.0], [1.7, 1.0], [1.7, 4.5], [11.5, 4.5], [11.5, 1.0], [6.9, 1.0], [6.9, -2.6]]);
    plan.back_up_to([6.9, 1.0]);
    plan.drive_to(&[[3.5, 1.0]]);
    for room in north.into_iter().chain(south) {
        plan.furnish(room, 7);
    }
    plan
}

/// A main corridor, three that branch off and one that joins them.
fn corridors(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 2);
    let mut spaces = vec![plan.space([0.0, 26.0], [0.0, 2.0]), plan.space([4.0, 21.8], [12.0, 14.0])];
    spaces.extend([4.0, 12.0, 20.0].map(|left| plan.space([left, left + 1.8], [2.0, 12.0])));
    for space in spaces {
        plan.niches(space);
    }
    plan.drive_to(&[[1.0, 1.0], [4.9, 1.0], [4.9, 13.0], [20.9, 13.0], [20.9, 1.0], [12.9, 1.0], [12.9, 8.0]]);
    plan.back_up_to([12.9, 1.2]);
    plan.drive_to(&[[2.0, 1.0]]);
    plan
}

/// A corridor around a block.
fn small_loop(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 3);
    plan.ring([0.0, 18.0], [0.0, 12.0], 2.0);
    plan.drive_to(&[[5.0, 1.0], [17.0, 1.0], [17.0, 11.0], [1.0, 11.0], [1.0, 1.0], [9.0, 1.0]]);
    plan
}

/// A hall with round pillars.
fn pillars(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 4);
    let hall = plan.space([0.0, 18.0], [0.0, 13.0]);
    plan.niches(hall);
    for column in 1..=3 {
        for row in 1..=2 {
            let [dx, dy] = std::array::from_fn(|_| plan.random().random_range(-0.4..0.4));
            let radius_m = plan.random().random_range(0.2..0.45);
            plan.pillar([4.5 * f64::from(column) + dx, 4.33 * f64::from(row) + dy], radius_m);
        }
    }
    plan.drive_to(&[
        [2.0, 2.0],
        [16.0, 2.0],
        [16.0, 6.5],
        [2.0, 6.5],
        [2.0, 11.0],
        [16.0, 11.0],
        [16.0, 6.6],
        [11.25, 6.4],
        [11.25, 2.5],
    ]);
    plan.furnish(hall, 6);
    plan
}

/// A corridor between rooms behind glass; one of them is open.
fn glass(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 5);
    let corridor = plan.space([0.0, 20.0], [0.0, 2.4]);
    plan.niches(Rectangle { x: corridor.x, y: [0.0, 2.0] });
    let rooms = [plan.space([1.0, 9.0], [2.4, 7.0]), plan.space([10.0, 19.0], [2.4, 7.0])];
    for [from, to] in [[1.0, 3.8], [5.2, 9.0], [10.0, 19.0]] {
        plan.glass([from, 2.4], [to, 2.4]);
    }
    plan.drive_to(&[[1.5, 1.2], [4.5, 1.2], [4.5, 5.0], [7.5, 5.0], [4.5, 4.6], [4.5, 1.2], [18.5, 1.2], [10.0, 1.2]]);
    for room in rooms {
        plan.furnish(room, 6);
    }
    plan
}

/// A hall in which people walk about.
fn people(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 6);
    let hall = plan.space([0.0, 16.0], [0.0, 10.0]);
    let corridor = plan.space([16.0, 26.0], [4.0, 6.0]);
    plan.niches(corridor);
    plan.drive_to(&[
        [2.0, 2.0],
        [13.0, 2.0],
        [13.0, 5.0],
        [24.0, 5.0],
        [13.0, 5.2],
        [13.0, 8.0],
        [2.0, 8.0],
        [2.0, 3.0],
    ]);
    plan.furnish(hall, 10);
    for _ in 0..8 {
        let mut corner = || [plan.random().random_range(0.6..15.4), plan.random().random_range(0.6..9.4)];
        let line = [corner(), corner(), corner()];
        plan.walker(&line);
    }
    plan.walker(&[[14.0, 4.5], [25.5, 4.5]]);
    plan
}

/// Two loops that share a corridor.
fn figure_of_eight(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 7);
    plan.ring([0.0, 30.0], [0.0, 20.0], 2.0);
    plan.ring([28.0, 58.0], [0.0, 20.0], 2.0);
    for _ in 0..2 {
        plan.drive_to(&[[29.0, 6.0], [29.0, 19.0], [1.0, 19.0], [1.0, 1.0], [29.0, 1.0]]);
        plan.drive_to(&[[29.0, 6.0], [29.0, 19.0], [57.0, 19.0], [57.0, 1.0], [29.0, 1.0]]);
    }
    plan.drive_to(&[[29.0, 10.0]]);
    plan
}

/// Five corridors that look the same, joined at both ends.
fn five_corridors(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 8);
    for index in 0..5 {
        let y = 8.0 * f64::from(index);
        plan.space([0.0, 24.0], [y, y + 2.0]);
        for door in [5.0, 11.0, 17.0] {
            plan.space([door, door + 1.0], [y - 0.12, y + 2.12]);
        }
    }
    plan.space([0.0, 2.0], [0.0, 34.0]);
    plan.space([22.0, 24.0], [0.0, 34.0]);
    plan.drive_to(&[[12.0, 1.0], [23.0, 1.0], [23.0, 9.0], [1.0, 9.0], [1.0, 17.0], [23.0, 17.0], [23.0, 25.0]]);
    plan.drive_to(&[[1.0, 25.0], [1.0, 33.0], [23.0, 33.0], [23.0, 1.0], [1.0, 1.0], [1.0, 33.0], [12.0, 33.0]]);
    plan
}

/// A corridor of 500 m around a block, driven once and a bit.
fn long_loop(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 9);
    plan.ring([0.0, 152.0], [0.0, 102.0], 2.0);
    plan.drive_to(&[[70.0, 1.0], [151.0, 1.0], [151.0, 101.0], [1.0, 101.0], [1.0, 1.0], [85.0, 1.0]]);
    plan
}

/// An office of ten corridors: a drive of two kilometres past and into its rooms.
fn long_office(seed: u64) -> FloorPlan {
    office(FloorPlan::new(seed, 10), OfficeSize { corridors: 10, rooms: 24, visit_every: 3 })
}

/// A university's main building: corridors of 60 to 250 m with few doors, joined to loops, and two
/// lobbies; a drive of 1.9 km that takes most of them twice.
fn main_building(seed: u64) -> FloorPlan {
    const WIDTH_M: f64 = 2.5;
    let [west, middle, east] = [1.25, 131.25, 248.75];
    let [south, center, north] = [1.25, 61.25, 131.25];
    let mut plan = FloorPlan::new(seed, 11);
    let from_to = |from: f64, to: f64| [from - 0.5 * WIDTH_M, to + 0.5 * WIDTH_M];
    for (x, y) in [
        ([west, east], [south; 2]),
        ([west, east], [center; 2]),
        ([west, middle], [north; 2]),
        ([west; 2], [south, north]),
        ([middle; 2], [south, north]),
        ([east; 2], [south, center]),
    ] {
        let corridor = plan.space(from_to(x[0], x[1]), from_to(y[0], y[1]));
        plan.niches_apart(corridor, 6.0..25.0);
    }
    let lobbies = [plan.space([125.0, 138.0], [57.0, 67.0]), plan.space([68.0, 84.0], [-8.0, 2.5])];
    for pillar in [[127.0, 58.5], [136.0, 58.5], [127.0, 65.5], [136.0, 65.5], [72.0, -3.0], [80.0, -3.0]] {
        plan.pillar(pillar, 0.3);
    }
    plan.drive_to(&[[60.0, south], [east, south], [east, center], [middle, center], [middle, north]]);
    plan.drive_to(&[[west, north], [west, south], [middle, south], [middle, center], [west, center]]);
    plan.drive_to(&[[west, north], [middle, north], [middle, south], [east, south], [east, center]]);
    plan.drive_to(&[[west, center], [west, south], [60.0, south]]);
    for lobby in lobbies {
        plan.furnish(lobby, 4);
    }
    plan
}

/// A hall of 60 by 40 m with few pillars: from its middle a LiDAR of short range sees little else.
fn large_hall(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 12);
    let hall = plan.space([0.0, 60.0], [0.0, 40.0]);
    plan.niches_apart(hall, 5.0..15.0);
    for column in 1..=4 {
        for row in 1..=2 {
            let [dx, dy] = std::array::from_fn(|_| plan.random().random_range(-0.3..0.3));
            plan.pillar([12.0 * f64::from(column) + dx, 13.3 * f64::from(row) + dy], 0.25);
        }
    }
    plan.drive_to(&[[4.0, 4.0], [56.0, 4.0], [56.0, 20.0], [4.0, 20.0], [4.0, 36.0], [56.0, 36.0], [56.0, 20.0]]);
    plan.drive_to(&[[30.0, 20.0], [30.0, 4.0], [4.0, 4.0], [4.0, 36.0], [30.0, 36.0], [30.0, 8.0]]);
    plan.furnish(hall, 8);
    plan
}

/// An office whose rooms are all furnished the same, but for some centimetres.
fn identical_rooms(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan::new(seed, 13);
    let rooms = office_rooms(&mut plan, OfficeSize { corridors: 3, rooms: 9, visit_every: 2 }, false);
    for (index, room) in rooms.into_iter().enumerate() {
        // Rooms come in pairs, north and south of their corridor, with the door at other ends.
        let from_corner_m = if index % 2 == 0 { [3.9, 2.9] } else { [0.9, 0.8] };
        let mut about = |value: f64| value + plan.random().random_range(-0.03..0.03);
        let center = Pose2::new(about(room.x[0] + from_corner_m[0]), about(room.y[0] + from_corner_m[1]), about(0.0));
        plan.crate_box(center, [0.7, 0.4], [150, 110, 70]);
    }
    plan
}

/// A ring whose first side has a recess every few metres, all alike, and nothing else until a side
/// corridor tells which is which. Across it 36 m of wall are bare: a robot that sees no farther than
/// some metres has but its wheels there, and comes round unsure at which recess it is.
fn look_alike(seed: u64) -> FloorPlan {
    const PERIOD_M: f64 = 2.5;
    let mut plan = FloorPlan::new(seed, 15);
    plan.space([0.0, 60.0], [0.0, 2.0]);
    for recess in 1..=16 {
        let from = PERIOD_M * f64::from(recess);
        plan.space([from, from + 1.0], [-0.12, 2.12]);
    }
    plan.space([44.0, 46.0], [2.0, 8.0]);
    plan.space([0.0, 60.0], [14.0, 16.0]);
    plan.space([0.0, 2.0], [0.0, 16.0]);
    plan.space([58.0, 60.0], [0.0, 16.0]);
    for (x, y) in [
        ([46.5, 58.0], [0.0, 2.0]),
        ([58.0, 60.0], [2.0, 14.0]),
        ([46.0, 58.0], [14.0, 16.0]),
        ([2.0, 10.0], [14.0, 16.0]),
        ([0.0, 2.0], [2.0, 14.0]),
    ] {
        plan.niches(Rectangle { x, y });
    }
    plan.drive_to(&[[28.0, 1.0], [59.0, 1.0], [59.0, 15.0], [1.0, 15.0], [1.0, 1.0], [48.0, 1.0]]);
    plan
}

/// Side of an office's room along its corridor, wall included, metres.
const ROOM_M: f64 = 5.0;
/// From one corridor of an office to the next, metres.
const CORRIDOR_SPACING_M: f64 = 12.0;
/// How far the robot drives into a room, from the middle of the corridor, metres.
const VISIT_M: f64 = 2.6;

/// How large an office is.
#[derive(Debug, Clone, Copy)]
struct OfficeSize {
    /// Parallel corridors, joined at both ends.
    corridors: usize,
    /// Rooms on each side of a corridor.
    rooms: usize,
    /// The route leads into one room of so many.
    visit_every: usize,
}

impl OfficeSize {
    /// Length of a corridor, metres.
    fn corridor_m(&self) -> f64 {
        2.0 * 2.4 + self.rooms as f64 * ROOM_M
    }

    /// Along which rooms of a corridor the route turns off.
    fn visits(self) -> impl Iterator<Item = usize> {
        (0..self.rooms).filter(move |room| room % self.visit_every == 1)
    }

    /// What a corridor adds to the route, its share of the way back included, metres.
    fn route_of_a_corridor_m(&self) -> f64 {
        self.corridor_m() - 2.0 + self.visits().count() as f64 * 2.0 * VISIT_M + 2.0 * CORRIDOR_SPACING_M
    }
}

/// An office with furniture at random.
fn office(mut plan: FloorPlan, size: OfficeSize) -> FloorPlan {
    for room in office_rooms(&mut plan, size, true) {
        plan.furnish(room, 4);
    }
    plan
}

/// Parallel corridors joined at both ends, each with rooms on both sides. The route takes the
/// corridors in turn, looks into some rooms and returns to its start.
fn office_rooms(plan: &mut FloorPlan, size: OfficeSize, niches: bool) -> Vec<Rectangle> {
    let OfficeSize { corridors, rooms, .. } = size;
    let length_m = size.corridor_m();
    let mut all_rooms = Vec::new();
    for index in 0..corridors {
        let y = CORRIDOR_SPACING_M * index as f64;
        let corridor = plan.space([0.0, length_m], [y, y + 2.0]);
        if niches {
            plan.niches(corridor);
        }
        for room in 0..rooms {
            let x = 2.4 + room as f64 * ROOM_M;
            for (north, [bottom, top], door) in
                [(true, [y + 2.2, y + 5.9], [y + 2.0, y + 2.2]), (false, [y - 3.9, y - 0.2], [y - 0.2, y])]
            {
                let door_m = x + if north { 1.4 } else { 3.0 };
                all_rooms.push(plan.space([x, x + ROOM_M - 0.2], [bottom, top]));
                plan.space([door_m - 0.6, door_m + 0.6], door);
            }
        }
    }
    let height_m = CORRIDOR_SPACING_M * (corridors - 1) as f64 + 2.0;
    plan.space([0.0, 2.0], [0.0, height_m]);
    plan.space([length_m - 2.0, length_m], [0.0, height_m]);
    for index in 0..corridors {
        let y = CORRIDOR_SPACING_M * index as f64 + 1.0;
        let eastwards = index % 2 == 0;
        plan.drive_to(&[[if eastwards { 1.0 } else { length_m - 1.0 }, y]]);
        for step in size.visits() {
            let room = if eastwards { step } else { rooms - 1 - step };
            let north = step % 2 == 0;
            let x = 2.4 + room as f64 * ROOM_M + if north { 1.4 } else { 3.0 };
            let inside = [x, if north { y + VISIT_M } else { y - VISIT_M }];
            plan.drive_to(&[[x, y], inside]);
            plan.back_up_to([x, y]);
        }
        plan.drive_to(&[[if eastwards { length_m - 1.0 } else { 1.0 }, y]]);
    }
    plan.drive_to(&[[1.0, height_m - 1.0], [1.0, 1.0], [6.0, 1.0]]);
    all_rooms
}
