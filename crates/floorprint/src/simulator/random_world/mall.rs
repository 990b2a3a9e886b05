//! Wide corridors past shops behind glass, with people.

use super::Site;
use super::route_graph::RouteGraph;
use crate::simulator::floor_plan::{FloorPlan, Rectangle};
use rand::RngExt;

/// How deep the shops are, metres.
const SHOP_M: f64 = 7.0;

/// Two long corridors and those that join them.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2]) -> Site {
    let random = plan.random();
    let width_m = random.random_range(4.5..8.0);
    let columns = random.random_range(2..=3);
    let apart_x = random.random_range(24.0..45.0);
    let apart_y = 2.0 * SHOP_M + width_m + 0.4;
    let glazed = random.random_range(0.4..0.9);
    let half = 0.5 * width_m;
    let xs: Vec<f64> = (0..columns).map(|column| left + half + f64::from(column) * apart_x).collect();
    let ys = [bottom + SHOP_M + half, bottom + SHOP_M + half + apart_y];
    let span = [xs[0] - half, xs[xs.len() - 1] + half];
    for y in ys {
        plan.space(span, [y - half, y + half]);
    }
    for x in &xs {
        plan.space([x - half, x + half], [ys[0] - half, ys[1] + half]);
    }
    let mut site = Site { graph: RouteGraph::default(), rooms: Vec::new(), walks: Vec::new() };
    for (y, sides) in [(ys[0], [1.0, -1.0]), (ys[1], [-1.0, 1.0])] {
        for side in sides {
            let front = y + side * half;
            // Outside there are shops along the whole corridor, inside between the cross corridors.
            let outside = (side > 0.0) == (y == ys[1]);
            let stretches: Vec<[f64; 2]> = if outside {
                vec![span]
            } else {
                xs.windows(2).map(|x| [x[0] + half + 0.2, x[1] - half - 0.2]).collect()
            };
            for [from, to] in stretches {
                let mut x = from;
                while x + 5.0 < to {
                    let end = (x + plan.random().random_range(5.0..12.0)).min(to);
                    shop(plan, &mut site, [x, end], front, side, glazed);
                    x = end + 0.2;
                }
            }
        }
    }
    for x in &xs[1..] {
        for y in ys {
            plan.pillar([x - 0.5 * apart_x, y + 0.3 * half], 0.3);
        }
    }
    site.graph.grid(&xs, &ys);
    for _ in 0..plan.random().random_range(2..10) {
        let y = ys[plan.random().random_range(0..2)] + plan.random().random_range(-0.8 * half..0.8 * half);
        site.walks.push(vec![[span[0] + 1.0, y], [span[1] - 1.0, y]]);
    }
    site
}

/// A shop behind its front: of glass, or a wall with a door.
fn shop(plan: &mut FloorPlan, site: &mut Site, x: [f64; 2], front: f64, side: f64, glazed: f64) {
    let is_glazed = plan.random().random_bool(glazed);
    let near = if is_glazed { front } else { front + side * 0.2 };
    let far = front + side * (SHOP_M - 0.2);
    let room: Rectangle = plan.space(x, [near.min(far), near.max(far)]);
    let door = plan.random().random_range(x[0] + 0.5..x[1] - 2.0);
    if is_glazed {
        plan.glass([x[0], front], [door, front]);
        plan.glass([door + 1.5, front], [x[1], front]);
    } else {
        plan.space([door, door + 1.5], [front.min(near), front.max(near)]);
    }
    site.rooms.push((room, 5));
}
