//! Drives of known shape are cut, closed and put right.

use super::continuity::discontinuity;
use super::{
    Anchor, BackEnd, ClosureReport, Comparison, Hypothesis, LoopClosureConfig, PlaceGraph, Placement, Submap,
    SubmapBuilder, Uncertainty, Verdict, ViewCache,
};
use crate::geometry::Pose2;
use crate::key_scan::{Drift, Interruption, KeyScan};
use crate::pose_graph::PoseGraph;
use crate::scan_matcher::MatcherConfig;
use crate::scan_matcher::synthetic::{Walls, poses_along};
use crate::session::corrected_poses;
use crate::surface::{SurfaceScan, Thinning};
use crate::{BodyScan, CompactScan, StopSignal};
use nalgebra::Matrix3;
use proptest::prelude::*;
use std::sync::Arc;

/// The key scans that a drive along `truth` takes, at the poses that drifting odometry gives.
fn key_scans(walls: &Walls, truth: &[Pose2], poses: &[Pose2]) -> Vec<KeyScan> {
    let key_scan = |(position, (truth, pose)): (usize, (&Pose2, &Pose2))| KeyScan {
        frame: position,
        pose: *pose,
        covariance: Matrix3::identity() * 1e-8,
        drift: Drift::default(),
        scan: Arc::new(SurfaceScan::new(&walls.scan_from(truth, 361), &Thinning::default())),
        points: CompactScan::default(),
        interruption: None,
    };
    truth.iter().zip(poses).enumerate().map(key_scan).collect()
}

/// A drive put right.
struct ClosedLoops {
    anchors: Vec<Anchor>,
    closures: Vec<ClosureReport>,
    graph: PoseGraph,
}

/// Places and what puts them right, as a session has them.
struct Closer {
    places: PlaceGraph,
    back_end: BackEnd,
}

impl Closer {
    fn new(config: &LoopClosureConfig) -> Self {
        let matcher = MatcherConfig::default();
        Self {
            places: PlaceGraph::new(config.submap_length_m, matcher.cell_m),
            back_end: BackEnd::new(config, &matcher),
        }
    }

    fn work(&mut self) -> bool {
        self.back_end.work(&mut self.places)
    }

    fn finish(mut self) -> ClosedLoops {
        self.back_end.finish(&mut self.places, &StopSignal::default());
        ClosedLoops { anchors: self.places.anchors(), closures: self.places.reports(), graph: self.places.graph() }
    }
}

/// Closes the loops of a drive, doing a piece of the work after every key scan.
fn close_loops(key_scans: &[KeyScan], config: &LoopClosureConfig) -> ClosedLoops {
    let mut closer = Closer::new(config);
    for key_scan in key_scans {
        closer.places.add(key_scan.clone(), poses_since(key_scans, key_scan.frame));
        closer.work();
    }
    closer.finish()
}

/// The front end's poses up to a frame.
fn poses_since(key_scans: &[KeyScan], last: usize) -> impl Fn(usize) -> Vec<Pose2> {
    move |first| key_scans[first..=last].iter().map(|key_scan| key_scan.pose).collect()
}

/// Dead reckoning that turns a little too far with every metre.
fn drifted(truth: &[Pose2], rad_per_m: f64) -> Vec<Pose2> {
    let mut poses = vec![Pose2::IDENTITY];
    for pair in truth.windows(2) {
        let step = pair[0].between(&pair[1]);
        let last = poses[poses.len() - 1];
        poses.push(last.compose(&Pose2::new(step.x, step.y, step.theta + rad_per_m * step.distance())));
    }
    poses
}

/// Largest distance from the truth, both seen from the first pose, metres.
fn largest_error_m(truth: &[Pose2], poses: &[Pose2]) -> f64 {
    let error =
        |(truth_here, pose): (&Pose2, &Pose2)| truth[0].between(truth_here).between(&poses[0].between(pose)).distance();
    truth.iter().zip(poses).map(error).fold(0.0, f64::max)
}

/// The same of the last fifth of a drive around the ring, which passes its first side again.
fn largest_error_on_second_pass_m(truth: &[Pose2], poses: &[Pose2]) -> f64 {
    let error = |k: usize| truth[0].between(&truth[k]).between(&poses[0].between(&poses[k])).distance();
    (truth.len() * 4 / 5..truth.len()).map(error).fold(0.0, f64::max)
}

/// A corridor around a block, with niches and pillars so that its sides differ.
fn ring() -> (Walls, Vec<Pose2>) {
    let walls = Walls::default()
        .with_box([0.0, 0.0], [11.0, 11.0])
        .with_box([0.0, 0.0], [8.0, 8.0])
        .with_box([-6.0, -10.8], [0.6, 0.2])
        .with_box([2.0, -8.2], [0.3, 0.2])
        .with_box([10.7, -3.0], [0.3, 1.1])
        .with_box([8.1, 4.0], [0.1, 0.4])
        .with_box([4.0, 10.8], [1.5, 0.2])
        .with_box([-10.8, 1.5], [0.2, 0.5]);
    let side = 9.5;
    let corners = [[-side, -side], [side, -side], [side, side], [-side, side], [-side, -side], [side, -side]];
    (walls, poses_along(&corners, 0.3))
}

#[test]
fn a_ring_is_closed() {
    let (walls, truth) = ring();
    let poses = drifted(&truth, 0.0006);
    let key_scans = key_scans(&walls, &truth, &poses);
    let closed = close_loops(&key_scans, &LoopClosureConfig::default());
    let accepted = closed.closures.iter().filter(|closure| closure.verdict == Verdict::Accepted).count();
    assert!(accepted >= 3, "{accepted} closures: {:#?}", closed.closures);
    let corrected = corrected_poses(&poses, &closed.anchors);
    let (before_m, after_m) = (largest_error_m(&truth, &poses), largest_error_m(&truth, &corrected));
    // What a closed ring cannot show is how its middle bends.
    assert!(before_m > 0.5 && after_m < 0.3 * before_m, "{before_m} m, then {after_m} m");
    let again_m = largest_error_on_second_pass_m(&truth, &corrected);
    assert!(again_m < 0.05, "the second pass lies {again_m} m off the first");
}

/// What was not compared on the way is compared in the end, where it is known well enough that it lies there.
#[test]
fn places_that_lie_on_each_other_in_the_end_are_tied_together() {
    let (walls, truth) = ring();
    let poses = drifted(&truth, 0.00012);
    let key_scans = key_scans(&walls, &truth, &poses);
    let config = LoopClosureConfig { candidates: 0, ..LoopClosureConfig::default() };
    let closed = close_loops(&key_scans, &config);
    let is_tied = |closure: &&ClosureReport| closure.verdict == Verdict::Accepted;
    let across: Vec<_> = closed.closures.iter().filter(is_tied).filter(|c| c.newer > c.older + 10).collect();
    assert!(across.len() >= 2, "{:#?}", closed.closures);
    let mut pairs: Vec<_> = closed.closures.iter().map(|closure| [closure.older, closure.newer]).collect();
    pairs.dedup();
    assert_eq!(pairs.len(), closed.closures.len(), "each pair is compared once");
    let error_m = largest_error_on_second_pass_m(&truth, &corrected_poses(&poses, &closed.anchors));
    let before_m = largest_error_on_second_pass_m(&truth, &poses);
    assert!(before_m > 0.1 && error_m < 0.05, "{before_m} m, then {error_m} m");
}

/// Who drives the same corridor again and again neither remembers nor computes more and more.
#[test]
fn what_is_known_costs_no_more() {
    let (walls, lap) = ring();
    // The ring's drive comes back along its first side.
    let lap = &lap[..lap.len() * 4 / 5];
    let truth: Vec<Pose2> = lap.iter().cycle().take(LAPS * lap.len()).copied().collect();
    let seen = key_scans(&walls, lap, lap);
    let poses = drifted(&truth, 0.0002);
    let key_scan = |(frame, pose): (usize, &Pose2)| KeyScan { frame, pose: *pose, ..seen[frame % lap.len()].clone() };
    let key_scans: Vec<KeyScan> = poses.iter().enumerate().map(key_scan).collect();
    let mut closer = Closer::new(&LoopClosureConfig::default());
    let mut loads = Vec::new();
    for key_scan in &key_scans {
        closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame));
        while closer.work() {}
        if (key_scan.frame + 1) % lap.len() == 0 {
            loads.push(closer.places.load());
        }
    }
    let (half_way, end) = (loads[LAPS / 2 - 1], loads[LAPS - 1]);
    assert!(end.submaps <= half_way.submaps + 1, "{loads:?}");
    assert!(end.nodes <= half_way.nodes + 2 && end.factors <= half_way.factors + 6, "{loads:?}");
    let closed = closer.finish();
    assert_eq!(closed.graph.poses().len(), closed.anchors.len());
    let error_m = largest_error_m(&truth, &corrected_poses(&poses, &closed.anchors));
    assert!(largest_error_m(&truth, &poses) > 1.0 && error_m < 0.3, "{error_m} m");
}

const LAPS: usize = 10;

#[test]
fn the_same_drive_without_drift_is_left_alone() {
    let (walls, truth) = ring();
    let poses = drifted(&truth, 0.0);
    let key_scans = key_scans(&walls, &truth, &poses);
    let closed = close_loops(&key_scans, &LoopClosureConfig::default());
    let moved_m = largest_error_m(&truth, &corrected_poses(&poses, &closed.anchors));
    assert!(moved_m < 0.02, "{moved_m} m");
}

/// Two corridors side by side look the same; they must not be taken for one.
#[test]
fn twin_corridors_are_not_tied_together() {
    let walls = Walls::default().with_loop(&[
        [0.0, 0.0],
        [34.0, 0.0],
        [34.0, 6.4],
        [0.0, 6.4],
        [0.0, 4.4],
        [30.0, 4.4],
        [30.0, 2.0],
        [0.0, 2.0],
    ]);
    let truth = poses_along(&[[1.0, 1.0], [32.0, 1.0], [32.0, 5.4], [1.0, 5.4]], 0.3);
    let poses = drifted(&truth, 0.0);
    let key_scans = key_scans(&walls, &truth, &poses);
    let closed = close_loops(&key_scans, &LoopClosureConfig::default());
    let tried = closed.closures.iter().filter(|closure| closure.newer - closure.older > 6).count();
    assert!(tried > 0, "the test needs candidates");
    let moved_m = largest_error_m(&truth, &corrected_poses(&poses, &closed.anchors));
    assert!(moved_m < 0.1, "{moved_m} m: {:#?}", closed.closures);
}

/// A corridor around a block in which one recess follows another on the side where the robot comes back, all alike.
fn ring_of_recesses() -> (Walls, Vec<Pose2>) {
    let mut walls = Walls::default().with_box([0.0, 0.0], [14.0, 8.0]).with_box([0.0, 0.0], [12.0, 6.0]);
    for k in -4..=4 {
        walls = walls.with_box([RECESS_SPACING_M * f64::from(k), -7.9], [0.4, 0.1]);
    }
    let corners = [[-6.0, -7.0], [13.0, -7.0], [13.0, 7.0], [-13.0, 7.0], [-13.0, -7.0], [13.0, -7.0], [13.0, 0.0]];
    (walls, poses_along(&corners, 0.3))
}

const RECESS_SPACING_M: f64 = 2.7;

/// The same key scans from a LiDAR that sees no farther than this.
fn short_sighted(mut key_scans: Vec<KeyScan>, range_m: f32) -> Vec<KeyScan> {
    for key_scan in &mut key_scans {
        key_scan.scan = Arc::new(key_scan.scan.filtered(|[x, y]| x.hypot(y) < range_m));
    }
    key_scans
}

/// The robot seems to come back to the wrong one of several places that look the same: which it was is clear only
/// at the next corner.
#[test]
fn of_places_that_look_the_same_the_right_one_is_held_for_possible_and_wins() {
    let (walls, truth) = ring_of_recesses();
    let mut poses = vec![Pose2::IDENTITY];
    for pair in truth.windows(2) {
        let step = pair[0].between(&pair[1]);
        // The front end takes the side to the north for longer than it is.
        let stretch = if pair[0].y > 6.9 && pair[1].y > 6.9 { 1.07 } else { 1.0 };
        poses.push(poses[poses.len() - 1].compose(&Pose2::new(step.x * stretch, step.y, step.theta)));
    }
    let last = truth.len() - 1;
    let error_of = |poses: &[Pose2]| truth[0].between(&truth[last]).between(&poses[0].between(&poses[last]));
    let drift_m = error_of(&poses).distance();
    assert!((0.6..0.8).contains(&(drift_m / RECESS_SPACING_M)), "{drift_m} m");

    let key_scans = short_sighted(key_scans(&walls, &truth, &poses), 6.0);
    let config = LoopClosureConfig { drift_sigma_m: 0.1, ..LoopClosureConfig::default() };
    let mut closer = Closer::new(&config);
    let mut most = 0;
    for key_scan in &key_scans {
        closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame));
        while closer.work() {
            most = most.max(closer.places.hypotheses());
        }
    }
    let closed = closer.finish();
    assert!(most > 1, "there was nothing to be uncertain of");
    let error = error_of(&corrected_poses(&poses, &closed.anchors));
    // The right recess; the drift is spread over both passes.
    assert!(error.distance() < 0.2 * RECESS_SPACING_M && error.theta.abs() < 0.02, "{error:?}: {:#?}", closed.closures);
    assert_closures_are_true(&closed, &truth);
}

/// No closure in force between the end of a drive and its beginning may say what is not so.
fn assert_closures_are_true(closed: &ClosedLoops, truth: &[Pose2]) {
    let in_force = closed.closures.iter().filter(|closure| closure.verdict == Verdict::Accepted);
    let across: Vec<_> = in_force.filter(|closure| closure.newer - closure.older > 6).collect();
    assert!(!across.is_empty());
    for closure in across {
        let [older, newer] = closure.frames.map(|frame| truth[frame]);
        let error = older.between(&newer).between(&closure.middle_from_middle);
        assert!(error.distance() < 0.2 && error.theta.abs() < 0.05, "{error:?}: {closure:#?}");
    }
}

/// Submaps of a drive whose poses are right.
fn true_submaps(walls: &Walls, truth: &[Pose2]) -> Vec<Arc<Submap>> {
    cut(&key_scans(walls, truth, truth), LoopClosureConfig::default().submap_length_m)
}

/// Compares two submaps where the newer one is expected `shift` off where it is.
fn compare(submaps: &[Arc<Submap>], pair: [usize; 2], shift: Pose2, uncertainty: Uncertainty) -> (Comparison, Pose2) {
    let [older, newer] = pair.map(|index| submaps[index].front_end_from_submap);
    let truth = older.between(&newer);
    let (config, matcher) = (LoopClosureConfig::default(), MatcherConfig::default());
    let comparison = ViewCache::default().compare(submaps, pair, truth.compose(&shift), uncertainty, &config, &matcher);
    (comparison, truth)
}

#[test]
fn a_submap_is_found_on_an_older_one_that_shows_the_same() {
    let (walls, truth) = ring();
    let submaps = true_submaps(&walls, &truth);
    // In the side that is driven twice, the second time and the first.
    let middle = |index: &usize| truth[submaps[*index].middle_frame];
    let distance_m = |a: &usize, b: &usize| middle(a).between(&middle(b)).distance();
    let newer = submaps.len() - 3;
    assert!(middle(&newer).y < -9.0 && middle(&newer).x.abs() < 5.0, "{:?}", middle(&newer));
    let older = (0..4).min_by(|a, b| distance_m(a, &newer).total_cmp(&distance_m(b, &newer))).unwrap();
    let uncertainty = Uncertainty { sigma_m: 0.6, sigma_rad: 0.05 };
    let (comparison, there) = compare(&submaps, [older, newer], Pose2::new(0.7, -0.5, 0.06), uncertainty);
    let best = &comparison.placements[0];
    let error = there.between(&best.older_from_newer);
    assert!(best.fits() && error.distance() < 0.03 && error.theta.abs() < 0.01, "{error:?} {best:#?}");
    assert!(best.overlap_shares.iter().all(|share| *share > 0.6), "{best:#?}");
    assert!(best.inlier_shares.iter().all(|share| *share > 0.9), "{best:#?}");
    for (index, placement) in comparison.placements.iter().enumerate() {
        for other in &comparison.placements[..index] {
            let offset = other.older_from_newer.between(&placement.older_from_newer);
            assert!(offset.distance() >= 0.15 || offset.theta.abs() >= 0.05, "{:#?}", comparison.placements);
        }
    }
}

#[test]
fn of_places_that_look_the_same_all_are_found() {
    let (walls, truth) = ring_of_recesses();
    let key_scans = short_sighted(key_scans(&walls, &truth, &truth), 6.0);
    let submaps = cut(&key_scans, LoopClosureConfig::default().submap_length_m);
    let newer = (0..submaps.len()).rfind(|&index| truth[submaps[index].middle_frame].x < 1.0).unwrap();
    let uncertainty = Uncertainty { sigma_m: 2.0, sigma_rad: 0.03 };
    for older in 0..3 {
        let (comparison, there) = compare(&submaps, [older, newer], Pose2::IDENTITY, uncertainty);
        let fits = comparison.placements.iter().filter(|placement| placement.fits());
        let along: Vec<f64> = fits.map(|fit| there.between(&fit.older_from_newer).x).collect();
        for expected_m in [-RECESS_SPACING_M, 0.0, RECESS_SPACING_M] {
            let is_found = along.iter().any(|along_m| (along_m - expected_m).abs() < 0.05);
            // At its end the corridor does not go on.
            assert!(is_found || (older == 2 && expected_m < 0.0), "nothing at {expected_m} m of {older}: {along:?}");
        }
    }
}

#[test]
fn along_a_bare_corridor_no_place_is_distinct() {
    let bare = Walls::default().with_box([0.0, 0.0], [40.0, 1.2]);
    let there_and_on = |from_x: f64| poses_along(&[[from_x, 0.0], [from_x + 20.0, 0.0]], 0.3);
    let distinctness = |walls: &Walls, shift_m: f64| {
        let key_scans = key_scans(walls, &there_and_on(-10.0), &there_and_on(-10.0));
        let submaps = cut(&short_sighted(key_scans, 8.0), LoopClosureConfig::default().submap_length_m);
        let uncertainty = Uncertainty { sigma_m: 1.0, sigma_rad: 0.02 };
        let (comparison, there) = compare(&submaps, [1, 3], Pose2::new(shift_m, 0.0, 0.0), uncertainty);
        let best = &comparison.placements[0];
        assert!(best.fits() && best.quality() > 0.9, "{best:#?}");
        (best.distinctness, there.between(&best.older_from_newer).distance())
    };
    for shift_m in [0.0, 0.7] {
        let (little, _) = distinctness(&bare, shift_m);
        assert!(little < 0.03, "{little}");
        let niches = [[-3.0, 0.7], [1.5, -0.8], [5.0, 0.9]];
        let with_cupboards = niches.iter().fold(bare.clone(), |walls, at| walls.with_box(*at, [0.7, 0.35]));
        let (much, error_m) = distinctness(&with_cupboards, shift_m);
        assert!(much > 0.08 && error_m < 0.05, "{much} {error_m} m");
    }
}

/// 12 m straight on, in which every key scan may be 2 cm off.
#[test]
fn what_is_not_known_of_the_way_stays_unknown_when_a_submap_ends() {
    let mut key_scans = bare(&poses_along(&[[0.0, 0.0], [12.0, 0.0]], 0.3));
    key_scans.iter_mut().for_each(|key_scan| key_scan.drift = Drift { sigma_m: 0.02, sigma_rad: 0.001 });
    let mut closer = Closer::new(&LoopClosureConfig { submap_length_m: 4.0, ..LoopClosureConfig::default() });
    let mut before_m = 0.0;
    for (number, key_scan) in key_scans.iter().enumerate() {
        let ended = closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame));
        // A submap that has ended waits until the back end hears of it.
        if number % 5 == 0 {
            while closer.work() {}
        }
        let sigma_m = closer.places.uncertainty().sigma_m;
        assert!(sigma_m >= 0.999 * before_m, "key scan {number}: {sigma_m} m after {before_m} m ({ended:?})");
        before_m = sigma_m;
    }
    let drifted_m = 0.02 * key_scans.len() as f64;
    assert!((0.6..1.5).contains(&(before_m / drifted_m)), "{before_m} m of {drifted_m} m");
    let Closer { mut places, back_end } = closer;
    back_end.finish(&mut places, &StopSignal::default());
    let stated = places.uncertainties(key_scans.len());
    let last_m = stated[key_scans.len() - 1].sigma_m;
    assert!((last_m / before_m - 1.0).abs() < 0.2, "{last_m} m at the end, {before_m} m before");
}

/// On known ground a submap shows where its last key scan was taken, not how the robot came from there to the next.
#[test]
fn what_is_not_known_of_the_step_into_a_submap_is_stated_at_once() {
    let (walls, truth) = ring();
    let key_scans = key_scans(&walls, &truth, &truth);
    let mut closer = Closer::new(&LoopClosureConfig::default());
    let mut steps_from_known_ground = 0;
    for key_scan in &key_scans {
        let doubtful = KeyScan { drift: Drift { sigma_m: 5.0, sigma_rad: 1.0 }, ..key_scan.clone() };
        let mut after_step = Closer { places: closer.places.clone(), ..Closer::new(&LoopClosureConfig::default()) };
        if closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame)) {
            after_step.places.add(doubtful, poses_since(&key_scans, key_scan.frame));
            while after_step.work() {}
            let stated = after_step.places.uncertainty();
            assert!(stated.sigma_m > 4.99 && stated.sigma_rad > 0.99, "key scan {}: {stated:?}", key_scan.frame);
            steps_from_known_ground += usize::from(after_step.places.hypotheses[0].newest_is_tied());
        }
        while closer.work() {}
    }
    assert!(steps_from_known_ground > 0);
}

/// The last submap of a drive that ends on known ground lies there as a whole, its last key scan, too.
#[test]
fn where_a_drive_ends_on_known_ground_its_end_is_known() {
    let (walls, truth) = ring();
    let mut key_scans = key_scans(&walls, &truth, &truth);
    let last = key_scans.len() - 1;
    key_scans[last - 2].drift = Drift { sigma_m: 5.0, sigma_rad: 1.0 };
    let mut closer = Closer::new(&LoopClosureConfig::default());
    for key_scan in &key_scans {
        closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame));
        while closer.work() {}
    }
    assert!(closer.places.uncertainty().sigma_m > 4.99, "{:?}", closer.places.uncertainty());
    let Closer { mut places, back_end } = closer;
    back_end.finish(&mut places, &StopSignal::default());
    assert!(places.hypotheses[0].newest_is_tied());
    let at_end = places.uncertainties(key_scans.len())[last];
    assert!(at_end.sigma_m < 0.2 && at_end.sigma_rad < 0.05, "{at_end:?}");
}

/// What a hypothesis of a drive there and back makes of its last submap when that was compared with the first one.
/// `compare` says what was found, given where the newer one lies on the older.
fn accounts_of(compare: impl Fn([usize; 2], Pose2) -> Vec<Comparison>) -> Vec<Hypothesis> {
    let truth = poses_along(&[[0.0, 0.0], [30.0, 0.0], [30.0, 1.0], [0.0, 1.0]], 0.3);
    let submaps = cut(&bare(&truth), 4.0);
    let config = LoopClosureConfig { drift_sigma_m: 0.1, ..LoopClosureConfig::default() };
    let mut account = Hypothesis::default();
    submaps.iter().for_each(|submap| account.extend(submap, &config));
    let pair = [0, submaps.len() - 1];
    let [older, newer] = pair.map(|index| submaps[index].front_end_from_submap);
    let uncertainties = account.uncertainties();
    account.decide(&submaps, &uncertainties, &compare(pair, older.between(&newer)), 0, &config)
}

/// A fit found from where the newer submap was expected.
fn found(
    [older, newer]: [usize; 2],
    expected: Pose2,
    older_from_newer: Pose2,
    sigma_m: f64,
    distinctness: f64,
) -> Comparison {
    let placement = Placement {
        older_from_newer,
        covariance: Matrix3::from_diagonal(&[sigma_m * sigma_m, 1e-4, 1e-6].into()),
        overlap_shares: [0.9; 2],
        inlier_shares: [0.95; 2],
        distinctness,
        verdict: Verdict::Accepted,
    };
    let uncertainty = Uncertainty { sigma_m: 1.5, sigma_rad: 0.02 };
    Comparison { older, newer, expected, uncertainty, placements: vec![placement], discontinuity: None }
}

/// Along a bare corridor a submap fits anywhere: such a fit may confirm where the robot is, not say that it is elsewhere.
#[test]
fn what_fits_as_well_farther_on_moves_nothing() {
    let closures_of_likeliest = |along_m: f64, distinctness: f64| {
        let shifted = |expected: &Pose2| Pose2::new(along_m, 0.0, 0.0).compose(expected);
        let accounts = accounts_of(|pair, there| vec![found(pair, there, shifted(&there), 2.0, distinctness)]);
        let likeliest = accounts.iter().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight)).unwrap();
        likeliest.closures().count()
    };
    assert_eq!(closures_of_likeliest(1.5, 0.0), 0);
    assert_eq!(closures_of_likeliest(-1.5, 0.02), 0);
    assert_eq!(closures_of_likeliest(1.5, 0.12), 1);
    assert_eq!(closures_of_likeliest(0.1, 0.0), 1);
}

/// Whether a robot is found again that was carried off after a drive of 30 m: submaps of the drive since were looked for on
/// those of the first, and of the same numbers some were seen there; others were not.
fn is_found_again(seen: &[usize], missed: &[usize]) -> bool {
    let first = poses_along(&[[0.0, 0.0], [30.0, 0.0]], 0.3);
    let carried = Pose2::new(0.0, 50.0, 1.0);
    let all: Vec<Pose2> = first.iter().copied().chain(first.iter().map(|pose| carried.compose(pose))).collect();
    let mut key_scans = bare(&all);
    key_scans[first.len()].interruption =
        Some(Interruption { frame: first.len(), is_certain: true, is_suspicion: false });
    let (submaps, config) = (cut(&key_scans, 4.0), LoopClosureConfig::default());
    let mut account = Hypothesis::default();
    submaps.iter().for_each(|submap| account.extend(submap, &config));
    let compared = |&number: &usize| {
        let newer = number + submaps.iter().position(|submap| submap.interruption.is_some()).unwrap();
        found([number, newer], Pose2::IDENTITY, Pose2::IDENTITY, 0.05, 0.5)
    };
    let mut comparisons: Vec<Comparison> = seen.iter().map(compared).collect();
    comparisons.extend(missed.iter().map(compared).map(|mut comparison| {
        comparison.placements[0].verdict = Verdict::DoesNotFit;
        comparison
    }));
    account.relocate(&submaps, &comparisons, true, &config);
    let [kidnapping] = &account.kidnappings(&submaps, &comparisons)[..] else { panic!("it was carried once") };
    kidnapping.found.is_some()
}

/// One room of another building looks like one of this: what lies around it tells.
#[test]
fn who_misses_what_should_be_seen_is_not_put_there() {
    assert!(is_found_again(&[1, 3], &[]) && is_found_again(&[1, 3], &[5]));
    assert!(!is_found_again(&[1, 3], &[0, 2, 4, 5]));
    assert!(is_found_again(&[0, 1, 2, 3, 4], &[5]));
}

/// What becomes of a suspicion in the middle of a drive, given what the submaps right before and after it look like together,
/// if they were compared: whether the robot is lost, and how often it was carried.
fn judged(across: Option<Comparison>) -> (bool, usize) {
    let mut key_scans = bare(&poses_along(&[[0.0, 0.0], [30.0, 0.0]], 0.3));
    let frame = key_scans.len() / 2;
    key_scans[frame].interruption = Some(Interruption { frame, is_certain: false, is_suspicion: true });
    let (submaps, config) = (cut(&key_scans, 4.0), LoopClosureConfig::default());
    let after = submaps.iter().position(|submap| submap.interruption.is_some()).unwrap();
    let mut account = Hypothesis::default();
    submaps[..=after].iter().for_each(|submap| account.extend(submap, &config));
    // Until they have been compared the graph goes on as if nothing were.
    assert!(account.is_suspected() && !account.is_lost() && !account.uncertainties()[0].is_lost());
    let comparisons: Vec<Comparison> =
        across.into_iter().map(|across| Comparison { older: after - 1, newer: after, ..across }).collect();
    account.relocate(&submaps, &comparisons, false, &config);
    assert!(!account.is_suspected());
    assert_eq!(account.is_lost(), account.uncertainties()[0].is_lost());
    (account.is_lost(), account.kidnappings(&submaps, &comparisons).len())
}

#[test]
fn a_suspicion_is_decided_by_what_was_in_view_before_and_after() {
    let across = |inlier_share, discontinuity, verdict| {
        let mut across = found([0, 1], Pose2::IDENTITY, Pose2::IDENTITY, 0.05, 0.3);
        let placement = &mut across.placements[0];
        (placement.inlier_shares, placement.verdict, across.discontinuity) =
            ([inlier_share; 2], verdict, discontinuity);
        Some(across)
    };
    let [stayed, carried] = [(false, 0), (true, 1)];
    assert_eq!(judged(None), stayed);
    // The drive says what is ordinary …
    assert_eq!(judged(across(0.7, Some(1.0), Verdict::Accepted)), stayed);
    assert_eq!(judged(across(0.9, Some(4.0), Verdict::Accepted)), carried);
    assert_eq!(judged(across(0.4, Some(-1.0), Verdict::DoesNotFit)), stayed);
    // … unless nothing is known of it.
    assert_eq!(judged(across(0.95, None, Verdict::Accepted)), stayed);
    assert_eq!(judged(across(0.75, None, Verdict::Accepted)), carried);
    assert_eq!(judged(across(0.95, None, Verdict::TooLittleInCommon)), stayed);
    assert_eq!(judged(across(0.1, None, Verdict::TooLittleInCommon)), carried);
    // In between it may have stayed: it is lost, but not said to have been carried.
    assert_eq!(judged(across(0.8, Some(2.0), Verdict::Accepted)), (true, 0));
}

/// By how many standard deviations less than is ordinary a drive around the ring goes on alike after 24 m, where it is carried
/// on by so many metres, and this share of each scan is of what stands 1 m off.
fn discontinuity_of(carried_m: f64, share_in_the_way: f64) -> f64 {
    let (walls, truth) = ring();
    let (frame, carried) = (80, (carried_m / 0.3) as usize);
    let mut seen_from = truth[..frame + 20].to_vec();
    seen_from[frame..].copy_from_slice(&truth[frame + carried..frame + carried + 20]);
    let mut key_scans = key_scans(&walls, &seen_from, &truth[..frame + 20]);
    key_scans[frame].interruption = Some(Interruption { frame, is_certain: false, is_suspicion: true });
    // Who walks along stands elsewhere around the robot in each scan.
    for (number, key_scan) in key_scans.iter_mut().enumerate() {
        let seen = walls.scan_from(&seen_from[number], 361);
        let mut scan = BodyScan::default();
        for (ray, [x_m, y_m]) in seen.hits.iter().enumerate() {
            let is_in_the_way = (ray + 37 * number) % 361 < (361.0 * share_in_the_way) as usize;
            let nearer = if is_in_the_way { 1.0 / x_m.hypot(y_m) } else { 1.0 };
            scan.hits.push(nearer * x_m, nearer * y_m);
        }
        key_scan.scan = Arc::new(SurfaceScan::new(&scan, &Thinning::default()));
    }
    let submaps = cut(&key_scans, 4.0);
    let newer = submaps.iter().position(|submap| submap.interruption.is_some()).unwrap();
    let pose = submaps[newer].link.unwrap().previous_from_submap;
    discontinuity(newer, &pose, &submaps, &mut ViewCache::default(), &MatcherConfig::default()).unwrap()
}

#[test]
fn who_is_suspected_is_lost_until_what_he_sees_then_was_compared() {
    let (walls, truth) = ring();
    let frame = 80;
    let mut key_scans = key_scans(&walls, &truth[..2 * frame], &truth[..2 * frame]);
    key_scans[frame].interruption = Some(Interruption { frame, is_certain: false, is_suspicion: true });
    let mut closer = Closer::new(&LoopClosureConfig::default());
    for key_scan in &key_scans {
        closer.places.add(key_scan.clone(), poses_since(&key_scans, key_scan.frame));
        if key_scan.frame == frame {
            assert!(closer.places.is_lost() && closer.places.uncertainty().sigma_m > 20.0);
        }
        while closer.work() {}
    }
    assert!(!closer.places.is_lost() && closer.places.uncertainty().sigma_m < 1.0);
    assert!(closer.places.comparisons.iter().any(|comparison| comparison.discontinuity.is_some_and(|d| d < 1.5)));
}

#[test]
fn who_was_not_carried_sees_what_he_saw_before() {
    let [stayed, crowded, carried] = [(0.0, 0.0), (0.0, 0.2), (9.0, 0.0)].map(|(m, share)| discontinuity_of(m, share));
    assert!(stayed < 1.5 && crowded < 1.5 && carried > 3.0, "{stayed} {crowded} {carried}");
}

/// What a suspicion begins is to be long enough to decide it by.
#[test]
fn one_suspicion_after_the_other_is_one() {
    let begun = |is_suspicion: [bool; 2]| {
        let mut key_scans = bare(&poses_along(&[[0.0, 0.0], [30.0, 0.0]], 0.3));
        for (frame, is_suspicion) in [10, 13].into_iter().zip(is_suspicion) {
            key_scans[frame].interruption = Some(Interruption { frame, is_certain: false, is_suspicion });
        }
        let submaps = cut(&key_scans, 4.0);
        let begun = submaps.iter().filter_map(|submap| submap.interruption.map(|at| (submap.first, at.frame)));
        begun.collect::<Vec<_>>()
    };
    assert_eq!(begun([true, true]), [(10, 10)]);
    assert_eq!(begun([true, false]), [(10, 10), (13, 13)]);
    assert_eq!(begun([false, true]), [(10, 10)]);
}

/// Hypotheses that expect a submap in different places have it compared with the same older one several times.
#[test]
fn the_same_place_found_from_two_expectations_counts_once() {
    let likeliest_of = |expectations_m: &[f64]| {
        let from = |there: &Pose2, along_m: f64| there.compose(&Pose2::new(along_m, 0.0, 0.0));
        let compare = |pair, there: Pose2| {
            expectations_m.iter().map(|&along_m| found(pair, from(&there, along_m), there, 0.01, 0.5)).collect()
        };
        accounts_of(compare).swap_remove(0)
    };
    let [once, twice] = [likeliest_of(&[0.0]), likeliest_of(&[0.0, 1.0])];
    assert_eq!((once.closures().count(), twice.closures().count()), (1, 1));
    assert_eq!(once.log_weight, twice.log_weight);
}

#[test]
fn a_drive_without_scans_stays_as_it_is() {
    let poses = [Pose2::IDENTITY, Pose2::new(1.0, 0.0, 0.0)];
    let closed = close_loops(&[], &LoopClosureConfig::default());
    assert!(closed.anchors.is_empty() && closed.closures.is_empty());
    assert_eq!(corrected_poses(&poses, &closed.anchors), poses);
}

/// Key scans at these poses, without any points.
fn bare(poses: &[Pose2]) -> Vec<KeyScan> {
    let scan = Arc::new(SurfaceScan::default());
    let key_scan = |(position, pose): (usize, &Pose2)| KeyScan {
        frame: position,
        pose: *pose,
        covariance: Matrix3::zeros(),
        drift: Drift::default(),
        scan: Arc::clone(&scan),
        points: CompactScan::default(),
        interruption: None,
    };
    poses.iter().enumerate().map(key_scan).collect()
}

/// Cuts key scans into submaps.
fn cut(key_scans: &[KeyScan], length_m: f64) -> Vec<Arc<Submap>> {
    let mut builder = SubmapBuilder::new(length_m, 0.05);
    let mut submaps: Vec<Submap> =
        key_scans.iter().filter_map(|scan| builder.add(scan.clone(), poses_since(key_scans, scan.frame))).collect();
    submaps.extend(builder.finish());
    submaps.into_iter().map(Arc::new).collect()
}

proptest! {
    #[test]
    fn submaps_cover_the_drive_and_their_links_lead_from_one_to_the_next(
        steps in prop::collection::vec(0.0..1.5_f64, 0..60), length_m in 0.5..6.0_f64
    ) {
        let mut poses = vec![Pose2::IDENTITY];
        steps.iter().for_each(|step| poses.push(poses[poses.len() - 1].compose(&Pose2::new(*step, 0.0, 0.1))));
        let submaps = cut(&bare(&poses), length_m);
        prop_assert_eq!(submaps[0].first, 0);
        prop_assert!(submaps[0].link.is_none());
        for (before, submap) in submaps.iter().zip(&submaps[1..]) {
            prop_assert!(before.first <= before.middle_frame && before.middle_frame < submap.first);
            let path_m: f64 = steps[..submap.first].iter().sum();
            prop_assert!((submap.path_m - path_m).abs() < 1e-9);
            // The path up to the last key scan of a submap is not longer than asked for.
            let length: f64 = steps[before.first..submap.first - 1].iter().sum();
            prop_assert!(length <= length_m + 1e-9);
            let link = submap.link.unwrap();
            let led_to = before.front_end_from_submap.compose(&link.previous_from_submap);
            prop_assert!(led_to.between(&submap.front_end_from_submap).distance() < 1e-9);
            prop_assert!((link.path_m - steps[before.first..submap.first].iter().sum::<f64>()).abs() < 1e-9);
        }
    }

    #[test]
    fn corrections_meet_the_anchors_and_change_evenly_in_between(
        moves in prop::collection::vec((-0.4..0.4_f64, -0.4..0.4_f64, -0.02..0.02_f64), 8)
    ) {
        let poses = poses_along(&[[0.0, 0.0], [12.0, 0.0], [12.0, 10.0]], 0.1);
        let anchors: Vec<Anchor> = moves
            .iter()
            .enumerate()
            .map(|(k, &(x, y, theta))| Anchor {
                frame: 25 * k,
                pose: poses[25 * k].compose(&Pose2::new(x, y, theta)),
                interruption: None,
            })
            .collect();
        let corrected = corrected_poses(&poses, &anchors);
        prop_assert_eq!(corrected.len(), poses.len());
        for anchor in &anchors {
            prop_assert!(corrected[anchor.frame].between(&anchor.pose).distance() < 1e-9);
        }
        for (before, after) in poses.windows(2).zip(corrected.windows(2)) {
            let change = before[0].between(&before[1]).between(&after[0].between(&after[1]));
            // Corrections of up to 1.2 m spread over 2.5 m, 0.1 m at a time.
            prop_assert!(change.distance() < 0.08 && change.theta.abs() < 0.003, "{change:?}");
        }
    }
}
