//! Paths between buildings under the sky: trees, poles, parked cars, walls far away.

use super::Site;
use super::route_graph::RouteGraph;
use crate::geometry::Pose2;
use crate::simulator::floor_plan::FloorPlan;
use rand::RngExt;

/// Nothing limits the view within this distance of the outermost path, metres.
const OPEN_M: f64 = 120.0;
/// From a path's middle to what stands beside it, metres.
const VERGE_M: f64 = 2.6;

/// A campus of 100 to 450 metres.
pub(super) fn build(plan: &mut FloorPlan, origin_m: [f64; 2]) -> Site {
    let columns = plan.random().random_range(3..=6);
    let rows = plan.random().random_range(3..=5);
    let apart_m = plan.random().random_range(45.0..85.0);
    of_size(plan, origin_m, [columns, rows], apart_m)
}

/// A campus of so many paths either way, metres apart.
pub(super) fn of_size(
    plan: &mut FloorPlan,
    [left, bottom]: [f64; 2],
    [columns, rows]: [usize; 2],
    apart_m: f64,
) -> Site {
    let mut lanes = |start: f64, count: usize| -> Vec<f64> {
        let mut about = |lane: usize| start + apart_m * lane as f64 + plan.random().random_range(-0.1..0.1) * apart_m;
        (0..count).map(&mut about).collect()
    };
    let (xs, ys) = (lanes(left, columns), lanes(bottom, rows));
    let around = |lanes: &[f64]| [lanes[0] - OPEN_M, lanes[lanes.len() - 1] + OPEN_M];
    plan.space(around(&xs), around(&ys));
    for x in xs.windows(2) {
        for y in ys.windows(2) {
            building(plan, [x[0], x[1]], [y[0], y[1]]);
        }
    }
    let trees_m = plan.random().random_range(7.0..16.0);
    let parked = plan.random().random_range(0.0..0.5);
    for column in 0..xs.len() {
        for row in 0..ys.len() {
            let here = [xs[column], ys[row]];
            if column + 1 < xs.len() {
                verge(plan, here, xs[column + 1] - xs[column], true, trees_m, parked);
            }
            if row + 1 < ys.len() {
                verge(plan, here, ys[row + 1] - ys[row], false, trees_m, parked);
            }
        }
    }
    let mut graph = RouteGraph::default();
    graph.grid(&xs, &ys);
    let walks = (0..plan.random().random_range(0..6))
        .map(|_| {
            let y = ys[plan.random().random_range(0..ys.len())];
            vec![[xs[0], y + 1.2], [xs[xs.len() - 1], y + 1.2]]
        })
        .collect();
    Site { graph, rooms: Vec::new(), walks }
}

/// A building in a block between paths, or none.
fn building(plan: &mut FloorPlan, x: [f64; 2], y: [f64; 2]) {
    if plan.random().random_bool(0.25) {
        return;
    }
    let mut half = |span: [f64; 2]| 0.5 * (span[1] - span[0]) * plan.random().random_range(0.3..0.8);
    let half_size_m = [half(x), half(y)];
    let center = Pose2::new(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), plan.random().random_range(-0.05..0.05));
    plan.crate_box(center, half_size_m, [170, 150, 130]);
    // Stairs, bays and extensions.
    for _ in 0..plan.random().random_range(2..7) {
        let random = plan.random();
        let along = random.random_range(-0.9..0.9);
        let (dx, dy) = if random.random_bool(0.5) {
            (along * half_size_m[0], if random.random_bool(0.5) { half_size_m[1] } else { -half_size_m[1] })
        } else {
            (if random.random_bool(0.5) { half_size_m[0] } else { -half_size_m[0] }, along * half_size_m[1])
        };
        let size_m = [random.random_range(0.5..2.0), random.random_range(0.5..2.0)];
        plan.crate_box(center.compose(&Pose2::new(dx, dy, 0.0)), size_m, [150, 150, 150]);
    }
}

/// What stands on either side of a path from a crossing eastwards or northwards.
fn verge(plan: &mut FloorPlan, [x, y]: [f64; 2], length_m: f64, eastwards: bool, trees_m: f64, parked: f64) {
    let path = Pose2::new(x, y, if eastwards { 0.0 } else { std::f64::consts::FRAC_PI_2 });
    for side in [-1.0, 1.0] {
        let has_cars = plan.random().random_bool(parked);
        let mut along_m = 4.0;
        while along_m < length_m - 6.0 {
            let random = plan.random();
            let aside_m = side * (VERGE_M + random.random_range(0.0..2.5));
            let what = random.random_range(0.0..1.0);
            if has_cars && what < 0.5 {
                let car = Pose2::new(along_m + 1.5, side * (VERGE_M + 1.3), random.random_range(-0.05..0.05));
                plan.crate_box(path.compose(&car), [2.1, 0.85], [90, 90, 110]);
                along_m += plan.random().random_range(5.0..8.0);
            } else if what < 0.85 {
                // A trunk, a pole or a bush.
                let radius_m = if what < 0.65 {
                    random.random_range(0.12..0.4)
                } else if what < 0.75 {
                    0.06
                } else {
                    random.random_range(0.5..1.2)
                };
                let place = path.transform_point([along_m, aside_m + side * radius_m]);
                plan.pillar(place, radius_m);
                along_m += plan.random().random_range(0.4 * trees_m..1.6 * trees_m);
            } else {
                along_m += trees_m;
            }
        }
    }
}
