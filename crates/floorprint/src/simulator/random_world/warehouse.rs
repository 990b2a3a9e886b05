//! Rows of racks with lanes between them: every bay looks like the next.

use super::Site;
use super::route_graph::RouteGraph;
use crate::geometry::Pose2;
use crate::simulator::floor_plan::FloorPlan;
use rand::RngExt;

/// Length of a rack's bay, metres.
const BAY_M: f64 = 2.7;
/// Depth of a rack, metres.
const DEPTH_M: f64 = 1.1;

/// A warehouse of 3 to 7 lanes.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2]) -> Site {
    let random = plan.random();
    let lanes = random.random_range(3..=7);
    let (lane_m, cross_m) = (random.random_range(2.4..3.4), random.random_range(3.0..4.0));
    let (blocks, bays) = (random.random_range(1..=2), random.random_range(4..=9));
    let filled = random.random_range(0.3..0.9);
    let block_m = f64::from(bays) * BAY_M;
    let xs: Vec<f64> =
        (0..=blocks).map(|block| left + 0.5 * cross_m + f64::from(block) * (block_m + cross_m)).collect();
    let ys: Vec<f64> = (0..lanes).map(|lane| bottom + 0.5 * lane_m + f64::from(lane) * (lane_m + DEPTH_M)).collect();
    let hall = plan.space([left, xs[xs.len() - 1] + 0.5 * cross_m], [bottom, ys[ys.len() - 1] + 0.5 * lane_m]);
    plan.niches_apart(hall, 4.0..14.0);
    for block in 0..blocks {
        let from = xs[block as usize] + 0.5 * cross_m;
        for y in ys.windows(2).map(|lanes| 0.5 * (lanes[0] + lanes[1])) {
            for bay in 0..=bays {
                let post = Pose2::new(from + f64::from(bay) * BAY_M, y, 0.0);
                plan.crate_box(post, [0.05, 0.5 * DEPTH_M], [70, 90, 160]);
                if bay < bays && plan.random().random_bool(filled) {
                    let mut about = |value: f64, by: f64| value + plan.random().random_range(-by..by);
                    let pallet = Pose2::new(about(post.x + 0.5 * BAY_M, 0.2), about(y, 0.05), about(0.0, 0.05));
                    let half_size_m = [about(0.9, 0.25), about(0.42, 0.06)];
                    plan.crate_box(pallet, half_size_m, [160, 130, 90]);
                }
            }
        }
    }
    let mut graph = RouteGraph::default();
    graph.grid(&xs, &ys);
    Site { graph, rooms: Vec::new(), walks: Vec::new() }
}
