//! A car park: pillars in a grid, cars side by side.

use super::Site;
use super::route_graph::RouteGraph;
use crate::geometry::Pose2;
use crate::simulator::floor_plan::FloorPlan;
use rand::RngExt;
use std::f64::consts::FRAC_PI_2;

/// Width of a parking space and depth of a row of them, metres.
const SPACE_M: [f64; 2] = [2.5, 5.0];
/// Width of a lane, metres.
const LANE_M: f64 = 6.0;

/// A car park of 2 to 4 lanes.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2]) -> Site {
    let random = plan.random();
    let lanes = random.random_range(2..=4);
    let spaces = 3 * random.random_range(4..=8);
    let taken = random.random_range(0.2..0.9);
    let row_m = f64::from(spaces) * SPACE_M[0];
    let pitch_m = LANE_M + 2.0 * SPACE_M[1];
    let size_m = [row_m + 2.0 * LANE_M, f64::from(lanes) * pitch_m];
    let hall = plan.space([left, left + size_m[0]], [bottom, bottom + size_m[1]]);
    plan.niches_apart(hall, 6.0..20.0);
    let xs = [left + 0.5 * LANE_M, left + LANE_M + row_m + 0.5 * LANE_M];
    let ys: Vec<f64> = (0..lanes).map(|lane| bottom + SPACE_M[1] + 0.5 * LANE_M + f64::from(lane) * pitch_m).collect();
    for y in &ys {
        for side in [-1.0, 1.0] {
            let row = y + side * 0.5 * (LANE_M + SPACE_M[1]);
            for space in 0..spaces {
                let x = left + LANE_M + (f64::from(space) + 0.5) * SPACE_M[0];
                if space % 3 == 0 {
                    plan.pillar([x - 0.5 * SPACE_M[0], row + side * 1.8], 0.25);
                }
                if plan.random().random_bool(taken) {
                    let mut about = |value: f64, by: f64| value + plan.random().random_range(-by..by);
                    let car = Pose2::new(about(x, 0.12), about(row, 0.2), about(FRAC_PI_2, 0.04));
                    let half_size_m = [about(2.05, 0.25), about(0.85, 0.06)];
                    plan.crate_box(car, half_size_m, [90, 90, 110]);
                }
            }
        }
    }
    let mut graph = RouteGraph::default();
    graph.grid(&xs, &ys);
    Site { graph, rooms: Vec::new(), walks: Vec::new() }
}
