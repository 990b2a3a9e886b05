//! What a simulated robot drives through: walls, people, a painted floor and a route.

use super::fault::{Fault, within};
use super::floor::Floor;
use super::moving_walls::{Door, LooseBox};
use super::ray_caster::RayCaster;
use super::walker::{Walker, companion_legs_m};
use crate::geometry::Pose2;

/// A world, in its own frame: metres, the origin at a corner of the building.
///
/// Everything stands from the floor to the ceiling, so that a LiDAR and a camera of
/// any height see the same outline.
#[derive(Debug, Clone)]
pub struct World {
    pub(super) name: String,
    pub(super) walls: Vec<Wall>,
    pub(super) walkers: Vec<Walker>,
    pub(super) floor: Floor,
    pub(super) route: Vec<Waypoint>,
    /// What stands elsewhere once it was moved.
    pub(super) loose: Vec<LooseBox>,
    pub(super) doors: Vec<Door>,
    /// Speeds to keep to in place of a route.
    pub(super) commands: Vec<Command>,
}

/// Speeds that the robot keeps to for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Speed ahead, m/s.
    pub speed_m_s: f64,
    /// Yaw rate, rad/s.
    pub turn_rate_rad_s: f64,
    /// For how long, seconds.
    pub for_s: f64,
}

/// A straight piece of wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// One end, metres.
    pub from_m: [f64; 2],
    /// The other end, metres.
    pub to_m: [f64; 2],
    /// What it is made of.
    pub material: Material,
    /// Its paint.
    pub color: [u8; 3],
}

impl Wall {
    /// Share of the light of a ray of this direction that comes back: dark and grazed surfaces return little.
    pub(super) fn intensity(&self, direction: [f64; 2]) -> f64 {
        let along = [self.to_m[0] - self.from_m[0], self.to_m[1] - self.from_m[1]];
        let length_m = along[0].hypot(along[1]).max(1e-9);
        let cos_incidence = ((along[0] * direction[1] - along[1] * direction[0]) / length_m).abs();
        let brightness = self.color.iter().map(|&channel| f64::from(channel)).sum::<f64>() / (3.0 * 255.0);
        (0.3 + 0.7 * brightness) * cos_incidence
    }
}

/// What a wall is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Material {
    /// Stops light.
    Opaque,
    /// Invisible to the camera; a LiDAR's ray passes through with this probability.
    Glass {
        /// Probability that a ray passes.
        pass_probability: f64,
    },
}

/// A corner of the robot's route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where, metres.
    pub position_m: [f64; 2],
    /// Whether the robot gets there in reverse.
    pub in_reverse: bool,
}

impl World {
    /// The world's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its walls, furniture and pillars.
    #[must_use]
    pub fn walls(&self) -> &[Wall] {
        &self.walls
    }

    /// The route's corners; the robot starts at the first.
    #[must_use]
    pub fn route(&self) -> &[Waypoint] {
        &self.route
    }

    /// The speeds to keep to in place of the route; most worlds have none.
    #[must_use]
    pub fn commands(&self) -> &[Command] {
        &self.commands
    }

    /// Length of the route, metres.
    #[must_use]
    pub fn route_length_m(&self) -> f64 {
        let leg_m = |leg: &[Waypoint]| {
            let ([from_x, from_y], [to_x, to_y]) = (leg[0].position_m, leg[1].position_m);
            (to_x - from_x).hypot(to_y - from_y)
        };
        self.route.windows(2).map(leg_m).sum()
    }

    /// Where the route starts, looking along its first leg: `building_from_start`.
    #[must_use]
    pub fn start(&self) -> Pose2 {
        match self.route.as_slice() {
            [first, second, ..] => {
                let [dx, dy] = [second.position_m[0] - first.position_m[0], second.position_m[1] - first.position_m[1]];
                let turn = if second.in_reverse { std::f64::consts::PI } else { 0.0 };
                Pose2::new(first.position_m[0], first.position_m[1], dy.atan2(dx) + turn)
            }
            [only] => Pose2::new(only.position_m[0], only.position_m[1], 0.0),
            [] => Pose2::IDENTITY,
        }
    }

    /// The corners of the smallest upright rectangle around the walls: lowest and highest (x, y), metres.
    #[must_use]
    pub fn bounds_m(&self) -> [[f64; 2]; 2] {
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for point in self.walls.iter().flat_map(|wall| [wall.from_m, wall.to_m]) {
            for axis in 0..2 {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        bounds
    }

    /// Where people's legs are at a time, metres, when the robot is at `robot`.
    pub(super) fn legs_m(&self, time_s: f64, robot: &Pose2, faults: &[Fault]) -> Vec<[f64; 2]> {
        let mut legs: Vec<[f64; 2]> = self.walkers.iter().flat_map(|walker| walker.legs_m(time_s, robot)).collect();
        for fault in faults {
            if let Fault::PeopleAlong { from_s, for_s, people } = *fault
                && within(time_s, from_s, for_s)
            {
                legs.extend((0..people).flat_map(|index| companion_legs_m(index, people, time_s, robot)));
            }
        }
        legs
    }

    /// Ends of all walls that can move, where they are at a time, when the robot is at `robot`; none of those farther
    /// than `reach_m` from it.
    pub(super) fn moving_walls_m(
        &self,
        time_s: f64,
        robot: &Pose2,
        reach_m: f64,
        faults: &[Fault],
    ) -> Vec<[[f64; 2]; 2]> {
        let boxes = self.loose.iter().flat_map(|loose| loose.walls_m(time_s, faults));
        let doors = self.doors.iter().map(|door| door.wall_m(time_s, robot, faults));
        let is_near = |ends: &[[f64; 2]; 2]| ends.iter().any(|[x, y]| (x - robot.x).hypot(y - robot.y) < reach_m);
        boxes.chain(doors).filter(is_near).collect()
    }

    pub(super) fn ray_caster(&self) -> RayCaster {
        RayCaster::new(&self.walls)
    }
}
