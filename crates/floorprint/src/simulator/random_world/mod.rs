//! Worlds drawn at random: no two are alike, and each follows from a number.

mod campus;
mod car_park;
mod hall;
mod home;
mod mall;
mod office;
mod route_graph;
mod warehouse;

use super::floor_plan::{FloorPlan, Rectangle};
use super::world::World;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
pub(super) use route_graph::RouteGraph;

/// What a world is like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WorldKind {
    Office,
    /// An office whose rooms look the same.
    Dormitory,
    Home,
    Warehouse,
    Mall,
    Hall,
    CarPark,
    Campus,
    /// Two of the others side by side.
    Mixture,
}

/// Every kind with its name.
const KINDS: [(WorldKind, &str); 9] = [
    (WorldKind::Office, "office"),
    (WorldKind::Dormitory, "dormitory"),
    (WorldKind::Home, "home"),
    (WorldKind::Warehouse, "warehouse"),
    (WorldKind::Mall, "mall"),
    (WorldKind::Hall, "hall"),
    (WorldKind::CarPark, "car_park"),
    (WorldKind::Campus, "campus"),
    (WorldKind::Mixture, "mixture"),
];

/// Walls and lanes, before the route through them is known.
struct Site {
    graph: RouteGraph,
    /// Rooms to be furnished, each with so many boxes at most.
    rooms: Vec<(Rectangle, usize)>,
    /// Where people walk.
    walks: Vec<Vec<[f64; 2]>>,
}

impl WorldKind {
    /// Any of the kinds.
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        KINDS[random.random_range(0..KINDS.len())].0
    }

    /// Its name.
    pub(super) fn name(self) -> &'static str {
        KINDS.iter().find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }

    /// Whether there is no roof.
    pub(super) fn is_outdoors(self) -> bool {
        self == Self::Campus
    }

    fn build(self, plan: &mut FloorPlan, origin_m: [f64; 2]) -> Site {
        match self {
            Self::Office => office::build(plan, origin_m, false),
            Self::Dormitory => office::build(plan, origin_m, true),
            Self::Home => home::build(plan, origin_m),
            Self::Warehouse => warehouse::build(plan, origin_m),
            Self::Mall => mall::build(plan, origin_m),
            Self::Hall => hall::build(plan, origin_m),
            Self::CarPark => car_park::build(plan, origin_m),
            Self::Campus => campus::build(plan, origin_m),
            Self::Mixture => mixture(plan),
        }
    }
}

/// A world of a kind whose route is about so long, metres.
pub(super) fn random_world(kind: WorldKind, seed: u64, length_m: f64) -> World {
    let mut plan = FloorPlan::new(seed, 100);
    let Site { graph, rooms, walks } = kind.build(&mut plan, [0.0, 0.0]);
    let route = graph.walk(plan.random(), length_m);
    plan.drive_to(&route);
    let can_be_moved = plan.random().random_range(0.0..0.6);
    for (room, count) in rooms {
        for _ in 0..count {
            if plan.random().random_bool(can_be_moved) {
                plan.loose_box(room);
            } else {
                plan.furnish(room, 1);
            }
        }
    }
    for walk in walks {
        plan.walker(&walk);
    }
    plan.build(kind.name())
}

/// A campus of so many paths either way, metres apart; where one can drive on it.
pub(super) fn campus_of_size(plan: &mut FloorPlan, paths: [usize; 2], apart_m: f64) -> RouteGraph {
    campus::of_size(plan, [0.0, 0.0], paths, apart_m).graph
}

/// Two places side by side, joined by a corridor.
fn mixture(plan: &mut FloorPlan) -> Site {
    const WIDTH_M: f64 = 2.2;
    let kinds = [
        WorldKind::Office,
        WorldKind::Home,
        WorldKind::Warehouse,
        WorldKind::Mall,
        WorldKind::Hall,
        WorldKind::CarPark,
        WorldKind::Dormitory,
    ];
    let mut draw = || kinds[plan.random().random_range(0..kinds.len())];
    let (west, east) = (draw(), draw());
    let mut site = west.build(plan, [0.0, 0.0]);
    let other = east.build(plan, [plan.east_m() + 12.0, 0.0]);
    let (gate, other_gate) = (site.graph.easternmost(), other.graph.westernmost());
    let ([x, y], [other_x, other_y]) = (site.graph.nodes[gate], other.graph.nodes[other_gate]);
    let middle_x = plan.west_of_m(other_x) - 6.0;
    let half = 0.5 * WIDTH_M;
    plan.space([x, middle_x + half], [y - half, y + half]);
    plan.space([middle_x - half, middle_x + half], [y.min(other_y) - half, y.max(other_y) + half]);
    plan.space([middle_x - half, other_x], [other_y - half, other_y + half]);
    let first = site.graph.nodes.len();
    site.graph.append(other.graph);
    let corners = [[middle_x, y], [middle_x, other_y]].map(|corner| site.graph.node(corner));
    for (a, b) in [(gate, corners[0]), (corners[0], corners[1]), (corners[1], first + other_gate)] {
        site.graph.join(a, b);
    }
    site.rooms.extend(other.rooms);
    site.walks.extend(other.walks);
    site
}
