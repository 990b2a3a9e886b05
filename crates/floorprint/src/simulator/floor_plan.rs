//! How worlds are drawn: free rectangles, whose common outline becomes the walls.

use super::floor::{Floor, Paint, Patch};
use super::font;
use super::moving_walls::{Door, LooseBox};
use super::walker::Walker;
use super::world::{Command, Material, Wall, Waypoint, World};
use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::ops::Range;

/// Furniture keeps at least this distance from the route, metres.
const CLEARANCE_M: f64 = 0.75;
/// Share of a LiDAR's rays that glass lets through.
const GLASS_PASS_PROBABILITY: f64 = 0.7;

/// An upright rectangle: lowest and highest x and y, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rectangle {
    pub(super) x: [f64; 2],
    pub(super) y: [f64; 2],
}

/// A world in the making.
pub(super) struct FloorPlan {
    random: Pcg64Mcg,
    seed: u64,
    spaces: Vec<Rectangle>,
    objects: Vec<Wall>,
    walkers: Vec<Walker>,
    route: Vec<Waypoint>,
    loose: Vec<LooseBox>,
    doors: Vec<Door>,
    commands: Vec<Command>,
}

impl FloorPlan {
    /// An empty plan. `world` sets apart the random draws of worlds with the same seed.
    pub(super) fn new(seed: u64, world: u64) -> Self {
        Self {
            random: generator(seed, Stage::World, world, u64::MAX),
            seed,
            spaces: Vec::new(),
            objects: Vec::new(),
            walkers: Vec::new(),
            route: Vec::new(),
            loose: Vec::new(),
            doors: Vec::new(),
            commands: Vec::new(),
        }
    }

    /// The plan's own randomness.
    pub(super) fn random(&mut self) -> &mut Pcg64Mcg {
        &mut self.random
    }

    /// Makes a rectangle free: a room, a corridor, or a doorway between them.
    pub(super) fn space(&mut self, x: [f64; 2], y: [f64; 2]) -> Rectangle {
        let space = Rectangle { x, y };
        self.spaces.push(space);
        space
    }

    /// The easternmost edge of all that is free so far, metres.
    pub(super) fn east_m(&self) -> f64 {
        self.spaces.iter().map(|space| space.x[1]).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The western edge of the spaces that hold a place's x coordinate, or lie farther west but belong to the same
    /// place: the smallest x from which nothing but free ground lies up to `x`, metres.
    pub(super) fn west_of_m(&self, x: f64) -> f64 {
        let mut edge = x;
        while let Some(farther) = self.spaces.iter().find(|space| space.x[0] < edge - 1e-9 && space.x[1] > edge - 0.5) {
            edge = farther.x[0];
        }
        edge
    }

    /// A corridor around a rectangle, which is its outer edge.
    pub(super) fn ring(&mut self, x: [f64; 2], y: [f64; 2], width_m: f64) {
        let sides = [
            self.space(x, [y[0], y[0] + width_m]),
            self.space(x, [y[1] - width_m, y[1]]),
            self.space([x[0], x[0] + width_m], y),
            self.space([x[1] - width_m, x[1]], y),
        ];
        for side in sides {
            self.niches(side);
        }
    }

    /// Shallow recesses, as of doors, at random places along the long sides of a corridor.
    pub(super) fn niches(&mut self, corridor: Rectangle) {
        self.niches_apart(corridor, 0.8..4.0);
    }

    /// The same with so much bare wall between one recess and the next, metres.
    pub(super) fn niches_apart(&mut self, corridor: Rectangle, bare_m: Range<f64>) {
        let lengthwise = corridor.x[1] - corridor.x[0] >= corridor.y[1] - corridor.y[0];
        let (along, across) = if lengthwise { (corridor.x, corridor.y) } else { (corridor.y, corridor.x) };
        for outward in [-1.0, 1.0] {
            let edge = if outward < 0.0 { across[0] } else { across[1] };
            let mut from = along[0] + self.random.random_range(0.5..3.0);
            loop {
                let width = self.random.random_range(0.8..1.3);
                let depth = self.random.random_range(0.06..0.16);
                if from + width > along[1] - 0.5 {
                    break;
                }
                let (low, high) = ((edge + outward * depth).min(edge), (edge + outward * depth).max(edge));
                let niche = ([from, from + width], [low, high]);
                if lengthwise {
                    self.space(niche.0, niche.1)
                } else {
                    self.space(niche.1, niche.0)
                };
                from += width + self.random.random_range(bare_m.clone());
            }
        }
    }

    /// A pane of glass.
    pub(super) fn glass(&mut self, from_m: [f64; 2], to_m: [f64; 2]) {
        let material = Material::Glass { pass_probability: GLASS_PASS_PROBABILITY };
        self.objects.push(Wall { from_m, to_m, material, color: [200, 220, 220] });
    }

    /// A round pillar.
    pub(super) fn pillar(&mut self, center_m: [f64; 2], radius_m: f64) {
        let corners: Vec<[f64; 2]> = (0..16)
            .map(|corner| {
                let angle = std::f64::consts::TAU * f64::from(corner) / 16.0;
                [center_m[0] + radius_m * angle.cos(), center_m[1] + radius_m * angle.sin()]
            })
            .collect();
        self.object(&corners, [150, 150, 160]);
    }

    /// A box at any angle.
    pub(super) fn crate_box(&mut self, center: Pose2, half_size_m: [f64; 2], color: [u8; 3]) {
        let [a, b] = half_size_m;
        let corners = [[-a, -b], [a, -b], [a, b], [-a, b]].map(|corner| center.transform_point(corner));
        self.object(&corners, color);
    }

    fn object(&mut self, corners: &[[f64; 2]], color: [u8; 3]) {
        for (index, &from_m) in corners.iter().enumerate() {
            let to_m = corners[(index + 1) % corners.len()];
            self.objects.push(Wall { from_m, to_m, material: Material::Opaque, color });
        }
    }

    /// Up to `count` boxes at random places of a room, off the route (which must be known by then).
    pub(super) fn furnish(&mut self, room: Rectangle, count: usize) {
        for _ in 0..count {
            let half_size_m: [f64; 2] = [self.random.random_range(0.2..0.6), self.random.random_range(0.15..0.4)];
            let reach_m = half_size_m[0].hypot(half_size_m[1]);
            let inset = |span: [f64; 2]| [span[0] + reach_m + 0.05, span[1] - reach_m - 0.05];
            let ([left, right], [bottom, top]) = (inset(room.x), inset(room.y));
            if left >= right || bottom >= top {
                continue;
            }
            let x = self.random.random_range(left..right);
            let y = self.random.random_range(bottom..top);
            let center = Pose2::new(x, y, self.random.random_range(-0.4..0.4));
            let color = std::array::from_fn(|_| self.random.random_range(60..220));
            if self.is_off_the_route([x, y], reach_m) {
                self.crate_box(center, half_size_m, color);
            }
        }
    }

    /// A crate at a random place of a room, and another place to which it may be moved; nothing where there is no
    /// room for it off the route (which must be known by then).
    pub(super) fn loose_box(&mut self, room: Rectangle) {
        let half_size_m: [f64; 2] = [self.random.random_range(0.2..0.5), self.random.random_range(0.15..0.4)];
        let reach_m = half_size_m[0].hypot(half_size_m[1]);
        let inset = |span: [f64; 2]| [span[0] + reach_m + 0.05, span[1] - reach_m - 0.05];
        let ([left, right], [bottom, top]) = (inset(room.x), inset(room.y));
        if left >= right || bottom >= top {
            return;
        }
        let mut place = || {
            let (x, y) = (self.random.random_range(left..right), self.random.random_range(bottom..top));
            Pose2::new(x, y, self.random.random_range(-0.4..0.4))
        };
        let centers = [place(), place()];
        if centers.iter().all(|center| self.is_off_the_route([center.x, center.y], reach_m)) {
            self.loose.push(LooseBox { centers, half_size_m });
        }
    }

    /// A door that is open unless it is told to swing.
    pub(super) fn door(&mut self, hinge: Pose2, width_m: f64, opens_rad: f64) {
        let period_s = self.random.random_range(6.0..15.0);
        self.doors.push(Door { hinge, width_m, opens_rad, period_s });
    }

    /// Shortens the route to its start, where the robot looks eastwards.
    pub(super) fn face_east(&mut self) {
        self.route.truncate(1);
    }

    /// Speeds to keep to in place of a route.
    pub(super) fn command(&mut self, speed_m_s: f64, turn_rate_rad_s: f64, for_s: f64) {
        self.commands.push(Command { speed_m_s, turn_rate_rad_s, for_s });
    }

    /// Whether something of this radius leaves the route clear.
    pub(super) fn is_off_the_route(&self, center_m: [f64; 2], radius_m: f64) -> bool {
        self.distance_to_route_m(center_m) > radius_m + CLEARANCE_M
    }

    /// A person who walks to and fro along a line.
    pub(super) fn walker(&mut self, line_m: &[[f64; 2]]) {
        let walker = Walker {
            line_m: line_m.to_vec(),
            speed_m_s: self.random.random_range(0.7..1.3),
            ahead_m: self.random.random_range(0.0..20.0),
        };
        self.walkers.push(walker);
    }

    /// The route goes on to these corners.
    pub(super) fn drive_to(&mut self, corners_m: &[[f64; 2]]) {
        self.route.extend(corners_m.iter().map(|&position_m| Waypoint { position_m, in_reverse: false }));
    }

    /// The route goes on to a point in reverse.
    pub(super) fn back_up_to(&mut self, position_m: [f64; 2]) {
        self.route.push(Waypoint { position_m, in_reverse: true });
    }

    fn distance_to_route_m(&self, [x, y]: [f64; 2]) -> f64 {
        let to_leg_m = |leg: &[Waypoint]| {
            let (from, to) = (leg[0].position_m, leg[1].position_m);
            let along = [to[0] - from[0], to[1] - from[1]];
            let square = (along[0] * along[0] + along[1] * along[1]).max(1e-9);
            let share = (((x - from[0]) * along[0] + (y - from[1]) * along[1]) / square).clamp(0.0, 1.0);
            (x - from[0] - share * along[0]).hypot(y - from[1] - share * along[1])
        };
        self.route.windows(2).map(to_leg_m).fold(f64::INFINITY, f64::min)
    }

    /// Puts up the walls and paints the floor.
    pub(super) fn build(mut self, name: &str) -> World {
        let mut walls = outline(&self.spaces);
        for wall in &mut walls {
            let tone: f64 = self.random.random_range(120.0..215.0);
            wall.color = std::array::from_fn(|_| (tone + self.random.random_range(-12.0..12.0)) as u8);
        }
        walls.extend_from_slice(&self.objects);
        let floor = self.paint();
        World {
            name: name.to_owned(),
            walls,
            walkers: self.walkers,
            floor,
            route: self.route,
            loose: self.loose,
            doors: self.doors,
            commands: self.commands,
        }
    }

    /// Tiles; along the route carpets, a stripe on its left and signs to be read by the robot.
    fn paint(&mut self) -> Floor {
        let base: [u8; 3] = std::array::from_fn(|_| self.random.random_range(110..180));
        let mut floor = Floor::new(base, self.seed);
        let legs: Vec<(Pose2, f64)> = self.route.windows(2).filter(|leg| !leg[1].in_reverse).map(leg_pose).collect();
        for (start, length_m) in &legs {
            let mut along_m = self.random.random_range(1.0..4.0);
            while along_m + 1.0 < *length_m {
                let place = start.compose(&Pose2::new(
                    along_m,
                    self.random.random_range(-0.4..0.4),
                    self.random.random_range(-0.2..0.2),
                ));
                let half_size_m = [self.random.random_range(0.4..0.9), self.random.random_range(0.3..0.6)];
                let mut color = || std::array::from_fn(|_| self.random.random_range(20..235));
                floor.lay(Patch { building_from_patch: place, half_size_m, paint: Paint::Bordered(color(), color()) });
                along_m += self.random.random_range(4.0..8.0);
            }
        }
        for (start, length_m) in &legs {
            let building_from_patch = start.compose(&Pose2::new(0.5 * length_m, 0.55, 0.0));
            let half_size_m = [(0.5 * length_m - 0.55).max(0.0), 0.03];
            floor.lay(Patch { building_from_patch, half_size_m, paint: Paint::Plain([225, 180, 30]) });
        }
        let inks = [[15, 15, 15], [240, 240, 240], [190, 25, 25]];
        let mut signs: Vec<Pose2> = Vec::new();
        for (start, length_m) in &legs {
            let mut along_m = 1.2;
            while along_m + 0.5 < *length_m {
                let sign = start.compose(&Pose2::new(along_m, self.random.random_range(-0.15..0.15), 0.0));
                // Where the route comes by again, there is a sign already.
                if signs.iter().all(|other| sign.between(other).distance() > 1.0) {
                    let letter = font::LETTERS[signs.len() % font::LETTERS.len()];
                    let digit = b'0' + (signs.len() % 10) as u8;
                    for (character, left_m) in [(letter, 0.19), (digit, -0.19)] {
                        let place = Pose2::new(0.0, left_m, -std::f64::consts::FRAC_PI_2);
                        floor.lay(Patch {
                            building_from_patch: sign.compose(&place),
                            half_size_m: [0.15, 0.21],
                            paint: Paint::Glyph(character, inks[signs.len() % inks.len()]),
                        });
                    }
                    signs.push(sign);
                }
                along_m += self.random.random_range(2.0..2.8);
            }
        }
        floor
    }
}

/// The pose at a leg's start that looks along it, and the leg's length in metres.
fn leg_pose(leg: &[Waypoint]) -> (Pose2, f64) {
    let (from, to) = (leg[0].position_m, leg[1].position_m);
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    (Pose2::new(from[0], from[1], dy.atan2(dx)), dx.hypot(dy))
}

/// The outline of the union of rectangles.
///
/// The rectangles' edges cut the plane into a coarse grid; a wall stands wherever a free
/// cell meets one that is not, and walls in line are joined.
fn outline(spaces: &[Rectangle]) -> Vec<Wall> {
    let edges = |span: fn(&Rectangle) -> [f64; 2]| {
        let mut edges: Vec<f64> = spaces.iter().flat_map(span).collect();
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        edges
    };
    let (xs, ys) = (edges(|space| space.x), edges(|space| space.y));
    let place = |edges: &[f64], value: f64| edges.partition_point(|&edge| edge < value - 1e-9);
    let (columns, rows) = (xs.len().saturating_sub(1), ys.len().saturating_sub(1));
    let mut free = vec![false; columns * rows];
    for space in spaces {
        for row in place(&ys, space.y[0])..place(&ys, space.y[1]) {
            free[row * columns + place(&xs, space.x[0])..row * columns + place(&xs, space.x[1])].fill(true);
        }
    }
    let is_free = |column: usize, row: usize| column < columns && row < rows && free[row * columns + column];
    let mut walls = Vec::new();
    let mut wall = |from_m: [f64; 2], to_m: [f64; 2]| {
        walls.push(Wall { from_m, to_m, material: Material::Opaque, color: [0; 3] });
    };
    // A wall runs on as long as the same side of the line is free.
    for (line, &y) in ys.iter().enumerate() {
        let side = |column| (is_free(column, line), line > 0 && is_free(column, line - 1));
        for [first, last] in runs(columns, side) {
            wall([xs[first], y], [xs[last], y]);
        }
    }
    for (line, &x) in xs.iter().enumerate() {
        let side = |row| (is_free(line, row), line > 0 && is_free(line - 1, row));
        for [first, last] in runs(rows, side) {
            wall([x, ys[first]], [x, ys[last]]);
        }
    }
    walls
}

/// Stretches of a line of `count` cells on which one and the same side is free.
fn runs(count: usize, side: impl Fn(usize) -> (bool, bool)) -> Vec<[usize; 2]> {
    let mut found = Vec::new();
    let mut index = 0;
    while index < count {
        let here = side(index);
        let first = index;
        while index < count && side(index) == here {
            index += 1;
        }
        if here.0 != here.1 {
            found.push([first, index]);
        }
    }
    found
}
