//! Scans of known walls are matched and found.

use super::synthetic::Walls;
use super::{Expectation, MatchResult, MatcherConfig, OdometryVerdict, PoseBelief, match_scan, without_hearsay};
use crate::frame::BodyScan;
use crate::geometry::{Pose2, wrap_angle};
use crate::random::{Stage, generator};
use crate::surface::{SurfaceMap, SurfaceScan, Thinning};
use nalgebra::Matrix3;
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

fn map_seen_from(walls: &Walls, poses: &[Pose2]) -> SurfaceMap {
    let config = MatcherConfig::default();
    let mut map = SurfaceMap::new(config.cell_m);
    for pose in poses {
        map.add_scan(pose, &SurfaceScan::new(&walls.scan_from(pose, 720), &config.thinning()));
    }
    map
}

fn scan(walls: &Walls, pose: &Pose2) -> SurfaceScan {
    SurfaceScan::new(&walls.scan_from(pose, 541), &Thinning::default())
}

fn belief(pose: Pose2, sigma_m: f64, sigma_rad: f64) -> PoseBelief {
    let information = Matrix3::from_diagonal(&[sigma_m.powi(-2), sigma_m.powi(-2), sigma_rad.powi(-2)].into());
    PoseBelief { pose, information }
}

/// [`locate`](super::locate) where the map's scans had all in view that a scan shows.
fn locate(
    map: &SurfaceMap,
    scan: &SurfaceScan,
    prior: &PoseBelief,
    continued: &PoseBelief,
    config: &MatcherConfig,
) -> (MatchResult, OdometryVerdict) {
    let expected = Expectation { prior, continued, seen_before: None, may_have_turned_round: true };
    let found = super::locate(map, scan, &expected, config);
    (found.fit, found.odometry)
}

fn room_map() -> SurfaceMap {
    map_seen_from(&Walls::room(), &[Pose2::IDENTITY, Pose2::new(0.4, 0.1, 0.3), Pose2::new(-0.5, 0.6, -0.8)])
}

/// A corridor along x without ends.
fn corridor() -> Walls {
    Walls::default().with_box([0.0, 0.0], [200.0, 1.0])
}

/// A wall along x at a distance, seen by so many rays from an angle to its mirror image, every range noisy.
fn noisy_wall(distance_m: f64, first_deg: f64, steps: u32, noise_m: f64, random: &mut impl Rng) -> BodyScan {
    let mut scan = BodyScan::default();
    for step in 0..=steps {
        let angle = (first_deg + (180.0 - 2.0 * first_deg) * f64::from(step) / f64::from(steps)).to_radians();
        let error: f64 = StandardNormal.sample(random);
        let range_m = distance_m / angle.sin() + noise_m * error;
        scan.hits.push((range_m * angle.cos()) as f32, (range_m * angle.sin()) as f32);
    }
    scan
}

/// A wall to the left keeps its direction although every range is noisy.
#[test]
fn thinning_does_not_prefer_points_by_their_noise() {
    let mut random = generator(1, Stage::Sensors, 0, 0);
    let (mut slope, mut spread) = (0.0, 0.0);
    for _ in 0..200 {
        let scan = noisy_wall(1.0, 30.0, 400, 0.01, &mut random);
        for ([x, y], _) in SurfaceScan::new(&scan, &Thinning::default()).iter() {
            slope += f64::from(x * (y - 1.0));
            spread += f64::from(x * x);
        }
    }
    assert!((slope / spread).abs() < 3e-4, "turned by {} rad", slope / spread);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_known_offset_is_recovered(
        x in -0.5..0.5_f64, y in -0.5..0.5_f64, theta in -3.0..3.0_f64,
        dx in -0.12..0.12_f64, dy in -0.12..0.12_f64, turn in -0.06..0.06_f64,
    ) {
        let truth = Pose2::new(x, y, theta);
        let guess = Pose2::new(x + dx, y + dy, theta + turn);
        let found = match_scan(&room_map(), &scan(&Walls::room(), &truth), &belief(guess, 0.5, 0.5), &MatcherConfig::default());
        let error = truth.between(&found.belief.pose);
        prop_assert!(error.distance() < 0.002, "{} m", error.distance());
        prop_assert!(error.theta.abs() < 0.05_f64.to_radians(), "{} rad", error.theta);
        prop_assert!(found.inlier_share > 0.95);
    }

    #[test]
    fn a_lost_robot_is_found_in_the_neighbourhood(dx in -0.5..0.5_f64, dy in -0.5..0.5_f64, turn in -0.7..0.7_f64) {
        let truth = Pose2::new(0.2, 0.3, 0.5);
        let guess = Pose2::new(truth.x + dx, truth.y + dy, truth.theta + turn);
        // Odometry that is sure of itself, and wrong.
        let prior = belief(guess, 0.02, 0.02);
        let (found, _) = locate(&room_map(), &scan(&Walls::room(), &truth), &prior, &prior, &MatcherConfig::default());
        let error = truth.between(&found.belief.pose);
        prop_assert!(error.distance() < 0.02 && error.theta.abs() < 0.01, "{error:?}");
    }
}

#[test]
fn a_corridor_leaves_the_way_along_it_to_the_odometry() {
    let map = map_seen_from(&corridor(), &[Pose2::IDENTITY, Pose2::new(1.0, 0.0, 0.0), Pose2::new(-1.0, 0.0, 0.0)]);
    let prior = belief(Pose2::new(0.3, 0.05, 0.02), 0.03, 0.1);
    let found = match_scan(&map, &scan(&corridor(), &Pose2::IDENTITY), &prior, &MatcherConfig::default());
    let pose = found.belief.pose;
    assert!((pose.x - 0.3).abs() < 0.02, "along: {} m", pose.x);
    assert!(pose.y.abs() < 0.002 && pose.theta.abs() < 0.001, "across: {pose:?}");
    let information = found.scan_information;
    assert!(information[(0, 0)] < 0.01 * information[(1, 1)], "{information}");
}

#[test]
fn without_anything_to_match_the_odometry_stands() {
    let config = MatcherConfig::default();
    let prior = belief(Pose2::new(1.0, 2.0, 0.5), 0.1, 0.1);
    let nothing = SurfaceScan::default();
    for (map, scan) in [
        (room_map(), nothing.clone()),
        (SurfaceMap::new(config.cell_m), scan(&Walls::room(), &Pose2::IDENTITY)),
        (SurfaceMap::new(config.cell_m), nothing),
    ] {
        let (found, verdict) = locate(&map, &scan, &prior, &prior, &config);
        assert!(verdict == OdometryVerdict::Confirmed && found.inlier_share == 0.0);
        assert_eq!(found.belief, prior);
    }
}

#[test]
fn a_handful_of_points_does_not_overrule_the_odometry() {
    let mut few = BodyScan::default();
    (0..5).for_each(|k| few.hits.push(1.0, 0.05 * k as f32));
    let prior = belief(Pose2::new(0.0, 0.0, 0.0), 0.05, 0.05);
    let (config, map) = (MatcherConfig::default(), room_map());
    let (found, verdict) = locate(&map, &SurfaceScan::new(&few, &config.thinning()), &prior, &prior, &config);
    assert!(verdict == OdometryVerdict::Confirmed && prior.pose.between(&found.belief.pose).distance() < 0.05);
}

/// A corridor that was seen up to a corner: half of what lies behind is new, and the other way round all would fit.
#[test]
fn a_corridor_is_not_taken_the_other_way_round_for_what_is_new_in_it() {
    let config = MatcherConfig::default();
    let along =
        |from: f32, to: f32, y: f32| (0..=((to - from) / 0.02) as i32).map(move |k| [from + 0.02 * k as f32, y]);
    let walls = |points: &mut dyn Iterator<Item = [f32; 2]>| {
        let mut scan = BodyScan::default();
        points.for_each(|[x, y]| scan.hits.push(x, y));
        SurfaceScan::new(&scan, &config.thinning())
    };
    let mut map = SurfaceMap::new(config.cell_m);
    map.add_scan(&Pose2::IDENTITY, &walls(&mut along(-6.0, 2.0, -1.0).chain(along(-6.0, 2.0, 1.0))));
    let scan = walls(&mut along(-1.5, 6.3, -1.0).chain(along(-1.5, 6.3, 1.0)));
    let prior = belief(Pose2::IDENTITY, 0.03, 0.03);
    let (found, verdict) = locate(&map, &scan, &prior, &prior, &config);
    assert!(found.inlier_share < config.search_below_inlier_share, "the test needs something new: {found:?}");
    assert!(verdict == OdometryVerdict::Confirmed && found.belief.pose.theta.abs() < 0.05, "{:?}", found.belief.pose);
}

/// The end of a wall that is known, and a longer one around the corner that is not: turned by a quarter, that one lies on the
/// other.
#[test]
fn who_sees_new_things_does_not_look_for_them_elsewhere() {
    let config = MatcherConfig::default();
    let wall = |from: [f32; 2], to: [f32; 2], scan: &mut BodyScan| {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 0.02) as usize;
        let at = |k: usize, axis: usize| from[axis] + (to[axis] - from[axis]) * k as f32 / steps as f32;
        (0..=steps).for_each(|k| scan.hits.push(at(k, 0), at(k, 1)));
    };
    let (mut known, mut seen) = (BodyScan::default(), BodyScan::default());
    wall([-6.0, 1.0], [0.5, 1.0], &mut known);
    wall([-0.8, 1.0], [0.5, 1.0], &mut seen);
    wall([0.5, 1.7], [0.5, 5.5], &mut seen);
    let mut map = SurfaceMap::new(config.cell_m);
    map.add_scan(&Pose2::IDENTITY, &SurfaceScan::new(&known, &config.thinning()));
    let scan = SurfaceScan::new(&seen, &config.thinning());
    let prior = belief(Pose2::IDENTITY, 0.03, 0.03);
    let (astray, _) = locate(&map, &scan, &prior, &prior, &config);
    assert!(astray.belief.pose.theta.abs() > 1.0, "the test needs a temptation: {astray:?}");
    let before = |pose: &Pose2| scan.filtered(|[x, y]| pose.transform_point([f64::from(x), f64::from(y)])[1] < 1.2);
    let wide =
        Expectation { prior: &prior, continued: &prior, seen_before: Some(&before), may_have_turned_round: true };
    let found = super::locate(&map, &scan, &wide, &config);
    let heading_rad = found.fit.belief.pose.theta;
    assert!(found.odometry == OdometryVerdict::Confirmed && heading_rad.abs() < 0.05, "{found:?}");
    assert!(found.fit.inlier_share < 0.5 && found.explained_share > 0.9, "{found:?}");
    // Who cannot have turned round has not, whatever was in view.
    let near = Expectation { seen_before: None, may_have_turned_round: false, ..wide };
    let found = super::locate(&map, &scan, &near, &config);
    assert!(found.fit.belief.pose.theta.abs() < 1.0, "{found:?}");
}

/// A wall at 3 m whose points scatter by twice the distance between them.
#[test]
fn noise_makes_no_wall_rough_and_turns_no_normals() {
    let mut random = generator(2, Stage::Sensors, 0, 0);
    let scan = BodyScan { range_noise_m: 0.04, ..noisy_wall(3.0, 60.0, 170, 0.04, &mut random) };
    let scan = SurfaceScan::new(&scan, &Thinning::default());
    let along: f32 = scan.iter().map(|(_, [x, _])| x * x).sum::<f32>() / scan.len() as f32;
    let flatness: f32 = scan.iter().map(|(_, [x, y])| x.hypot(y)).sum::<f32>() / scan.len() as f32;
    assert!(scan.len() > 50 && along.sqrt() < 0.15 && flatness > 0.85, "{} {} {flatness}", scan.len(), along.sqrt());
    // Its points say next to nothing of where along the wall they were taken.
    let config = MatcherConfig::default();
    let mut map = SurfaceMap::new(config.cell_m);
    map.add_scan(&Pose2::IDENTITY, &scan);
    let found = match_scan(&map, &scan, &belief(Pose2::new(0.08, 0.0, 0.0), 0.02, 0.02), &config);
    assert!(found.scan_information[(0, 0)] < 0.03 * found.scan_information[(1, 1)], "{}", found.scan_information);
}

/// A scan with errors along its rays, of a LiDAR that is known for them; it is at the origin.
fn with_noise(mut scan: BodyScan, noise_m: f32, random: &mut impl Rng) -> BodyScan {
    for (x, y) in scan.hits.x_m.iter_mut().zip(&mut scan.hits.y_m) {
        let error: f32 = StandardNormal.sample(random);
        let longer = 1.0 + noise_m * error / x.hypot(*y);
        (*x, *y) = (*x * longer, *y * longer);
    }
    BodyScan { range_noise_m: noise_m, ..scan }
}

/// A room of 6 m × 6 m, seen from its middle.
#[test]
fn noise_does_not_make_walls_thick() {
    let mut random = generator(7, Stage::Sensors, 0, 0);
    let room = Walls::default().with_box([0.0, 0.0], [3.0, 3.0]);
    let off_m = |x: f32, y: f32| f64::from(x.abs().max(y.abs()) - 3.0);
    let spread_m = |noise_m: f32, random: &mut _| {
        let scan = with_noise(room.scan_from(&Pose2::IDENTITY, 720), noise_m, random);
        let rays_m: Vec<f64> = scan.hits.x_m.iter().zip(&scan.hits.y_m).map(|(&x, &y)| off_m(x, y)).collect();
        let surfaces = SurfaceScan::new(&scan, &Thinning::default());
        let points_m: Vec<f64> = surfaces.iter().map(|([x, y], _)| off_m(x, y)).collect();
        [rays_m, points_m]
            .map(|off_m| (off_m.iter().map(|off_m| off_m * off_m).sum::<f64>() / off_m.len() as f64).sqrt())
    };
    let [rays_m, points_m] = spread_m(0.05, &mut random);
    assert!(points_m < 0.5 * rays_m, "points {points_m} m, rays {rays_m} m");
    // What the matcher is made for stays as it is.
    let [rays_m, points_m] = spread_m(0.015, &mut random);
    assert!((points_m / rays_m - 1.0).abs() < 0.15, "points {points_m} m, rays {rays_m} m");
}

/// A robot that stands still has a noisy scan matched with others like it.
#[test]
fn noisy_scans_tell_where_the_robot_is() {
    let mut random = generator(8, Stage::Sensors, 0, 0);
    let config = MatcherConfig::default();
    let mut noisy = || {
        let scan = with_noise(Walls::room().scan_from(&Pose2::IDENTITY, 360), 0.1, &mut random);
        SurfaceScan::new(&scan, &config.thinning())
    };
    let mut map = SurfaceMap::new(config.cell_m);
    (0..10).for_each(|_| map.add_scan(&Pose2::IDENTITY, &noisy()));
    let errors_m = (0..20).map(|_| {
        let found = match_scan(&map, &noisy(), &belief(Pose2::new(0.1, -0.08, 0.03), 0.2, 0.1), &config);
        found.belief.pose.distance()
    });
    let mean_m = errors_m.sum::<f64>() / 20.0;
    assert!(mean_m < 0.03, "{mean_m} m");
}

/// The odometry stood still while the robot turned in a corridor, and makes up for all of it in one step.
#[test]
fn where_late_odometry_leaps_the_robot_just_goes_on() {
    let map = map_seen_from(&corridor(), &[Pose2::IDENTITY, Pose2::new(1.0, 0.0, 0.0), Pose2::new(-1.0, 0.0, 0.0)]);
    let truth = Pose2::new(0.1, 0.02, 0.6);
    let scan = scan(&corridor(), &truth);
    let leap = belief(truth.compose(&Pose2::new(0.4, -0.1, 1.2)), 0.08, 0.25);
    let continued = belief(truth.compose(&Pose2::new(0.01, 0.02, -0.04)), 0.05, 0.05);
    let (found, verdict) = locate(&map, &scan, &leap, &continued, &MatcherConfig::default());
    let error = truth.between(&found.belief.pose);
    assert!(verdict != OdometryVerdict::Confirmed, "{verdict:?}");
    assert!(error.distance() < 0.05 && error.theta.abs() < 0.01, "{error:?}");
    // Nothing else tells where along the corridor it is.
    let (lost, _) = locate(&map, &scan, &leap, &leap, &MatcherConfig::default());
    assert!(truth.between(&lost.belief.pose).distance() > 0.08, "{lost:?}");
}

#[test]
fn the_two_sides_of_a_thin_wall_are_told_apart() {
    let wall = Walls::default().with_box([0.0, -1.0], [30.0, 2.0]);
    let map = map_seen_from(&wall, &[Pose2::IDENTITY]);
    let share_of_fit = |pose: Pose2| {
        match_scan(&map, &scan(&wall, &pose), &belief(pose, 0.01, 0.01), &MatcherConfig::default()).inlier_share
    };
    assert!(share_of_fit(Pose2::new(0.1, 0.1, 0.0)) > 0.9);
    // From outside the same wall is another surface.
    assert!(share_of_fit(Pose2::new(0.0, 2.0, 0.0)) < 0.05);
}

#[test]
fn normals_of_walls_are_exact_and_face_the_robot() {
    let walls = Walls::default().with_box([0.0, 0.0], [3.0, 2.0]);
    let scan = SurfaceScan::new(&walls.scan_from(&Pose2::new(0.5, 0.2, 0.0), 720), &Thinning::default());
    let mut flat = 0;
    for ([x, y], [nx, ny]) in scan.iter() {
        let (wall_x, wall_y) = (f64::from(x) + 0.5, f64::from(y) + 0.2);
        if nx.hypot(ny) > 0.0 {
            assert!(nx * x + ny * y < 0.0, "the normal at {wall_x}, {wall_y} faces away");
        }
        let from_corner = (3.0 - wall_x.abs()).hypot(2.0 - wall_y.abs());
        if from_corner > 0.3 {
            flat += 1;
            let across = if (3.0 - wall_x.abs()).abs() < 1e-3 { nx } else { ny };
            assert!(across.abs() > 0.999, "{nx}, {ny} at {wall_x}, {wall_y}");
        }
    }
    assert!(flat > 200, "{flat} points on walls");
    let corner = scan.iter().min_by_key(|&([x, y], _)| ((x - 2.5).hypot(y - 1.8) * 1e4) as i32).unwrap();
    assert!(corner.1[0].hypot(corner.1[1]) < 0.8, "a corner is not flat: {corner:?}");
}

#[test]
fn a_wall_seen_by_few_rays_has_its_normal_too() {
    let walls = Walls::default().with_box([0.0, 0.0], [12.0, 9.0]);
    let scan = SurfaceScan::new(&walls.scan_from(&Pose2::IDENTITY, 180), &Thinning::default());
    let ahead = scan.iter().filter(|([_, y], _)| y.abs() < 3.0);
    for (_, [nx, ny]) in ahead {
        assert!(nx.abs() > 0.99 && ny.abs() < 0.05, "{nx}, {ny}");
    }
}

/// Far down a corridor the rays graze its walls, a metre and more apart.
#[test]
fn walls_at_a_graze_have_their_normal() {
    let config = MatcherConfig::default();
    for (half_width_m, fewest) in [(1.8, 4), (2.0, 10), (3.0, 30)] {
        for (y, theta) in [(0.0, 0.0), (0.25, 0.004), (-0.4, 0.02)] {
            // As many rays to a degree as a LiDAR of 180 rays over 180° has.
            let walls = Walls::default().with_box([0.0, 0.0], [200.0, half_width_m]);
            let scan = SurfaceScan::new(&walls.scan_from(&Pose2::new(0.0, y, theta), 360), &config.thinning());
            let far: Vec<_> = scan.iter().filter(|([x, y], _)| x.hypot(*y) > 10.0).collect();
            assert!(far.len() >= fewest, "{half_width_m} m: {} points", far.len());
            for ([x, y], [nx, ny]) in far {
                let (sin, cos) = (theta.sin() as f32, theta.cos() as f32);
                let (along, across) = (cos * nx - sin * ny, sin * nx + cos * ny);
                assert!(across.abs() > 0.9 && along.abs() < 0.05, "{along}, {across} at {x}, {y}");
                assert!(nx * x + ny * y < 0.0, "the normal at {x}, {y} faces away");
            }
        }
    }
}

/// A leg of a chair, a trunk: the rays before and after it end elsewhere.
#[test]
fn what_a_single_ray_hits_counts_only_where_there_is_little_else() {
    let config = MatcherConfig::default();
    let seen = |rays: i32, step_deg: f64| {
        let mut scan = BodyScan::default();
        for k in -rays..=rays {
            let angle = (f64::from(k) * step_deg).to_radians();
            let range_m = if k == 0 { 12.0 } else { 25.0 / angle.cos() };
            scan.hits.push((range_m * angle.cos()) as f32, (range_m * angle.sin()) as f32);
        }
        let scan = SurfaceScan::new(&scan, &config.thinning());
        let lone: Vec<_> = scan.iter().filter(|([x, _], _)| *x < 20.0).map(|(_, normal)| normal).collect();
        (scan.len(), lone)
    };
    let (few, lone) = seen(20, 0.5);
    assert!(few < 50 && lone == [[0.0, 0.0]], "{few}, {lone:?}");
    let (many, lone) = seen(240, 0.25);
    assert!(many > 100 && lone.is_empty(), "{many}, {lone:?}");
}

#[test]
fn a_bare_corridor_says_nothing_of_the_way_along_it() {
    let config = MatcherConfig::default();
    let most = config.independent_points / config.sigma_m.powi(2);
    // Next to nothing along, as errors make it; seen from axes at an angle.
    let (sin, cos) = 0.7_f64.sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    let scan = turn * Matrix3::from_diagonal(&[0.01 * most, most, most].into()) * turn.transpose();
    let scale = without_hearsay(&scan, &config);
    let left = turn.transpose() * scale * scan * scale * turn;
    assert!(left[(0, 0)] < 0.1 * 0.01 * most, "along: {left}");
    assert!(left[(1, 1)] > 0.9 * most && left[(2, 2)] > 0.999 * most, "across: {left}");
    // A room tells the place both ways.
    let room = Matrix3::from_diagonal(&[0.5 * most, most, most].into());
    let scale = without_hearsay(&room, &config);
    assert!((scale * room * scale)[(0, 0)] > 0.8 * 0.5 * most);
    assert_eq!(without_hearsay(&Matrix3::zeros(), &config), Matrix3::identity());
}

proptest! {
    /// What is left is never more than there was, and no information of a direction turns negative.
    #[test]
    fn taking_back_hearsay_adds_nothing(entries in prop::array::uniform9(-1.0..1.0_f64), scale in -6.0..7.0_f64) {
        let root = Matrix3::from_row_slice(&entries) * 10.0_f64.powf(scale);
        let information = root * root.transpose();
        let size = information.norm();
        let weights = without_hearsay(&information, &MatcherConfig::default());
        prop_assert!((weights - weights.transpose()).norm() < 1e-9);
        let left = weights * information * weights;
        // The position's block shrinks in every direction: the coupling with the heading shrinks along.
        let loss = (information - left).fixed_view::<2, 2>(0, 0).into_owned();
        prop_assert!(loss.symmetric_eigenvalues().min() > -1e-9 * size, "{loss}");
        prop_assert!((left[(2, 2)] - information[(2, 2)]).abs() <= 1e-9 * size);
        prop_assert!(left.symmetric_eigenvalues().min() > -1e-9 * size, "{left}");
    }

    #[test]
    fn a_balanced_choice_is_small_and_leaves_out_no_direction(
        x in -2.0..2.0_f64, y in -1.0..1.0_f64, theta in -3.0..3.0_f64, most in 1..400_usize
    ) {
        let pose = Pose2::new(x, y, theta);
        let scan = scan(&Walls::room(), &pose);
        let chosen = scan.balanced(most);
        prop_assert!(chosen.len() <= most.max(17) && chosen.len() <= scan.len());
        prop_assert!(chosen.len() >= most.min(scan.len()), "{} of {most}", chosen.len());
        // Each direction has a point of a similar one, even where fewer are asked for than there are directions.
        let directions = |scan: &SurfaceScan| -> Vec<f32> {
            let flat = scan.iter().filter(|(_, [nx, ny])| nx.hypot(*ny) > 0.3);
            flat.map(|(_, [nx, ny])| ny.atan2(nx)).collect()
        };
        let kept = directions(&chosen);
        for direction in directions(&scan) {
            let nearest = kept.iter().map(|other| wrap_angle(f64::from(other - direction)).abs()).fold(9.0, f64::min);
            prop_assert!(nearest < TAU / 16.0 + 1e-4, "nothing within {nearest} of {direction}");
        }
        let all: Vec<_> = scan.iter().collect();
        prop_assert!(chosen.iter().all(|point| all.contains(&point)));
        prop_assert!(chosen.iter().eq(scan.balanced(most).iter()));
        prop_assert_eq!(chosen.origin_m, scan.origin_m);
    }
}

/// Along a corridor the one recess keeps all its points.
#[test]
fn what_is_rare_outweighs_what_is_long() {
    let walls = Walls::default().with_box([0.0, 0.0], [14.0, 1.0]).with_box([3.0, 0.9], [0.3, 0.1]);
    let scan = scan(&walls, &Pose2::IDENTITY);
    let along = |scan: &SurfaceScan| scan.iter().filter(|(_, [nx, _])| nx.abs() > 0.9).count();
    let chosen = scan.balanced(100);
    assert_eq!(along(&chosen), along(&scan));
    assert!(along(&scan) > 0 && chosen.len() <= 100 && scan.len() > 200, "{} of {}", along(&scan), chosen.len());
}

proptest! {
    #[test]
    fn thinned_points_stand_for_all(x in -2.0..2.0_f64, y in -1.0..1.0_f64, theta in -3.0..3.0_f64, spacing in 0.0..0.3_f64) {
        let full = Walls::room().scan_from(&Pose2::new(x, y, theta), 541);
        let hits: Vec<_> = full.hits.iter().collect();
        let config = MatcherConfig { point_spacing_m: spacing, max_points: usize::MAX, ..MatcherConfig::default() };
        let points: Vec<_> = SurfaceScan::new(&full, &config.thinning()).iter().map(|(point, _)| point).collect();
        let distance = |a: &[f32; 2], b: &[f32; 2]| f64::from((a[0] - b[0]).hypot(a[1] - b[1]));
        let outline_m: f64 = hits.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum();
        prop_assert!(0.6 * spacing * points.len() as f64 <= outline_m + 1.0);
        // Nothing is left out but near a point that is kept: within the neighbourhood that a normal
        // is made from, which reaches over a few rays where they stand far apart.
        for (index, hit) in hits.iter().enumerate() {
            let near = &hits[index.saturating_sub(3)..(index + 4).min(hits.len())];
            let gap_m = near.windows(2).map(|pair| distance(&pair[0], &pair[1])).fold(0.0, f64::max);
            let nearest_m = points.iter().map(|point| distance(point, hit)).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest_m <= 1.5 * spacing + 0.12 + 2.5 * gap_m);
        }
    }

    #[test]
    fn seen_from_another_pose_a_scan_is_the_same(x in -5.0..5.0_f64, y in -5.0..5.0_f64, theta in -3.0..3.0_f64) {
        let scan = SurfaceScan::new(&Walls::room().scan_from(&Pose2::IDENTITY, 90), &Thinning::default());
        let pose = Pose2::new(x, y, theta);
        let turn = Pose2::new(0.0, 0.0, theta);
        let distance = |a: [f64; 2], b: [f32; 2]| (a[0] - f64::from(b[0])).hypot(a[1] - f64::from(b[1]));
        prop_assert!(!scan.is_empty());
        for ((point, normal), (moved_point, moved_normal)) in scan.iter().zip(scan.seen_from(&pose).iter()) {
            prop_assert!(distance(pose.transform_point(moved_point.map(f64::from)), point) < 1e-5);
            prop_assert!(distance(turn.transform_point(moved_normal.map(f64::from)), normal) < 1e-5);
        }
    }
}
