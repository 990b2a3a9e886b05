//! Corridors that cross each other, with rooms between them.

use super::Site;
use super::route_graph::RouteGraph;
use crate::geometry::Pose2;
use crate::simulator::floor_plan::{FloorPlan, Rectangle};
use rand::RngExt;

/// Thickness of the walls, metres.
const WALL_M: f64 = 0.2;
/// How far the robot drives into a room beyond its wall, metres.
const VISIT_M: f64 = 1.5;

/// An office; where `alike`, all of its rooms look the same and corridors are bare.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2], alike: bool) -> Site {
    let random = plan.random();
    let width_m = random.random_range(1.7..2.6);
    let (columns, rows) = (random.random_range(2..=3), random.random_range(2..=3));
    let room_m = random.random_range(3.2..5.5);
    let per_block = random.random_range(3..=6);
    let depth_m = random.random_range(3.2..5.0);
    let door_m = random.random_range(1.0..1.2);
    let visited = random.random_range(0.15..0.6);
    let apart_x = per_block as f64 * (room_m + WALL_M) + WALL_M + width_m;
    let apart_y = 2.0 * depth_m + 3.0 * WALL_M + width_m;
    let xs: Vec<f64> = (0..columns).map(|column| left + 0.5 * width_m + f64::from(column) * apart_x).collect();
    let ys: Vec<f64> = (0..rows).map(|row| bottom + 0.5 * width_m + f64::from(row) * apart_y).collect();
    let half = 0.5 * width_m;
    let span = |along: &[f64]| [along[0] - half, along[along.len() - 1] + half];
    let mut corridors: Vec<Rectangle> = ys.iter().map(|y| plan.space(span(&xs), [y - half, y + half])).collect();
    corridors.extend(xs.iter().map(|x| plan.space([x - half, x + half], span(&ys))));
    if !alike {
        for corridor in corridors {
            plan.niches_apart(corridor, 1.0..8.0);
        }
    }
    let mut site = Site { graph: RouteGraph::default(), rooms: Vec::new(), walks: Vec::new() };
    let first = site.graph.grid(&xs, &ys);
    for (column, west) in xs[..xs.len() - 1].iter().enumerate() {
        for row in 0..ys.len() {
            let mut before = first + column * ys.len() + row;
            let last = first + (column + 1) * ys.len() + row;
            for index in 0..per_block {
                let x = west + half + WALL_M + f64::from(index) * (room_m + WALL_M);
                for (side, has_room) in [(1.0, row + 1 < ys.len()), (-1.0, row > 0)] {
                    if !has_room {
                        continue;
                    }
                    let wall = ys[row] + side * half;
                    let (near, far) = (wall + side * WALL_M, wall + side * (WALL_M + depth_m));
                    let room = plan.space([x, x + room_m], [near.min(far), near.max(far)]);
                    let from_corner_m =
                        if alike { 0.4 } else { plan.random().random_range(0.2..room_m - door_m - 0.2) };
                    let door_x = x + from_corner_m;
                    plan.space([door_x, door_x + door_m], [wall.min(near), wall.max(near)]);
                    let opens_rad = -side * plan.random().random_range(1.5..1.9);
                    // Hinged so that it opens into the room.
                    plan.door(Pose2::new(door_x, near, 0.0), door_m, -opens_rad);
                    if alike {
                        plan.crate_box(
                            Pose2::new(x + room_m - 0.7, far - side * 0.5, 0.0),
                            [0.6, 0.35],
                            [150, 110, 70],
                        );
                    } else {
                        site.rooms.push((room, 4));
                    }
                    if plan.random().random_bool(visited) {
                        let at = [door_x + 0.5 * door_m, ys[row]];
                        let behind_m = at[0] - site.graph.nodes[before][0];
                        // Crossings follow one another from west to east; a door across and farther west is not visited.
                        if behind_m > 0.1 {
                            before = site.graph.split(before, last, at);
                        }
                        if behind_m > -0.1 {
                            let inside = site.graph.node([at[0], near + side * VISIT_M]);
                            site.graph.join(before, inside);
                        }
                    }
                }
            }
        }
    }
    for _ in 0..plan.random().random_range(0..4) {
        let row = plan.random().random_range(0..ys.len());
        site.walks.push(vec![[xs[0], ys[row] + 0.4], [xs[xs.len() - 1], ys[row] + 0.4]]);
    }
    site
}
