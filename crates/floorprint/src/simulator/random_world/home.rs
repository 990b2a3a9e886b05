//! A flat: rooms of all sizes with doors between them, much furniture.

use super::Site;
use super::route_graph::RouteGraph;
use crate::geometry::Pose2;
use crate::simulator::floor_plan::FloorPlan;
use rand::RngExt;

const WALL_M: f64 = 0.14;
const DOOR_M: f64 = 0.95;
/// Doors keep this far from a room's corners, metres.
const CORNER_M: f64 = 0.35;

/// A home of 2 × 2 to 3 × 3 rooms.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2]) -> Site {
    let random = plan.random();
    let (columns, rows) = (random.random_range(2..=3), random.random_range(2..=3));
    let mut edges = |start: f64, count: usize| {
        let mut at = start;
        let spans: Vec<[f64; 2]> = (0..count)
            .map(|_| {
                let span = [at, at + random.random_range(3.0..5.2)];
                at = span[1] + WALL_M;
                span
            })
            .collect();
        spans
    };
    let (xs, ys) = (edges(left, columns), edges(bottom, rows));
    let mut site = Site { graph: RouteGraph::default(), rooms: Vec::new(), walks: Vec::new() };
    let middle = |span: [f64; 2]| 0.5 * (span[0] + span[1]);
    let mut centers = vec![vec![0; rows]; columns];
    for (column, &x) in xs.iter().enumerate() {
        for (row, &y) in ys.iter().enumerate() {
            let room = plan.space(x, y);
            site.rooms.push((room, 6));
            centers[column][row] = site.graph.node([middle(x), middle(y)]);
        }
    }
    for column in 0..columns {
        for row in 0..rows {
            // Every room but the first has a door to the west or to the south, and some have both.
            let (to_west, to_south) = match (column > 0, row > 0) {
                (false, false) => (false, false),
                (true, false) => (true, false),
                (false, true) => (false, true),
                (true, true) => {
                    let both = plan.random().random_bool(0.5);
                    let west = both || plan.random().random_bool(0.5);
                    (west, both || !west)
                }
            };
            let place = |span: [f64; 2], plan: &mut FloorPlan| {
                plan.random().random_range(span[0] + CORNER_M..span[1] - CORNER_M - DOOR_M)
            };
            if to_west {
                let (from, wall) = (place(ys[row], plan), [xs[column - 1][1], xs[column][0]]);
                plan.space(wall, [from, from + DOOR_M]);
                plan.door(Pose2::new(wall[1], from, std::f64::consts::FRAC_PI_2), DOOR_M, -1.6);
                let y = from + 0.5 * DOOR_M;
                let ends = [wall[0] - 0.7, wall[1] + 0.7].map(|x| site.graph.node([x, y]));
                connect(&mut site.graph, [centers[column - 1][row], ends[0], ends[1], centers[column][row]]);
            }
            if to_south {
                let (from, wall) = (place(xs[column], plan), [ys[row - 1][1], ys[row][0]]);
                plan.space([from, from + DOOR_M], wall);
                plan.door(Pose2::new(from, wall[1], 0.0), DOOR_M, 1.6);
                let x = from + 0.5 * DOOR_M;
                let ends = [wall[0] - 0.7, wall[1] + 0.7].map(|y| site.graph.node([x, y]));
                connect(&mut site.graph, [centers[column][row - 1], ends[0], ends[1], centers[column][row]]);
            }
        }
    }
    site
}

fn connect(graph: &mut RouteGraph, way: [usize; 4]) {
    way.windows(2).for_each(|ends| graph.join(ends[0], ends[1]));
}
