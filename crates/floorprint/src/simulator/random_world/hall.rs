//! A large hall with little in it.

use super::Site;
use super::route_graph::RouteGraph;
use crate::simulator::floor_plan::FloorPlan;
use rand::RngExt;

/// A hall of 25 × 20 to 70 × 50 metres.
pub(super) fn build(plan: &mut FloorPlan, [left, bottom]: [f64; 2]) -> Site {
    let random = plan.random();
    let size_m = [random.random_range(25.0..70.0), random.random_range(20.0..50.0)];
    let margin_m = random.random_range(1.5..4.0);
    let pillars = random.random_range(0..=3);
    let boxes = random.random_range(3..20);
    let hall = plan.space([left, left + size_m[0]], [bottom, bottom + size_m[1]]);
    plan.niches_apart(hall, 3.0..12.0);
    let lanes = |start: f64, length_m: f64| -> Vec<f64> {
        let count = (length_m / 9.0).floor().max(2.0);
        (0..=count as usize).map(|lane| start + margin_m + lane as f64 * (length_m - 2.0 * margin_m) / count).collect()
    };
    let (xs, ys) = (lanes(left, size_m[0]), lanes(bottom, size_m[1]));
    for x in xs.windows(2).step_by(2).take(pillars) {
        for y in ys.windows(2).step_by(2) {
            let radius_m = plan.random().random_range(0.15..0.4);
            let mut about = |ends: &[f64]| 0.5 * (ends[0] + ends[1]) + plan.random().random_range(-0.5..0.5);
            let center = [about(x), about(y)];
            plan.pillar(center, radius_m);
        }
    }
    let mut site = Site { graph: RouteGraph::default(), rooms: vec![(hall, boxes)], walks: Vec::new() };
    site.graph.grid(&xs, &ys);
    for _ in 0..plan.random().random_range(0..8) {
        let mut corner = || {
            let random = plan.random();
            [
                random.random_range(hall.x[0] + 1.0..hall.x[1] - 1.0),
                random.random_range(hall.y[0] + 1.0..hall.y[1] - 1.0),
            ]
        };
        let walk = vec![corner(), corner(), corner()];
        site.walks.push(walk);
    }
    site
}
