//! What becomes of a drive when sensors fail, people get in the way, or the robot is carried off.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use floorprint::config::Layer;
use floorprint::evaluation::{Alignment, TrajectoryError, TrajectoryErrorOptions};
use floorprint::simulator::{Fault, Scenario, SimulationConfig, World, simulate};
use floorprint::{Config, Frames, Slam, SlamResult};
use simulation::{Outcome, quick, solve, solve_as};

/// Drives on which the robot moves while the faults last.
const DRIVES: [(&str, u64); 4] = [("rooms", 1), ("rooms", 2), ("rooms", 3), ("pillars", 1)];
/// Those on which it also goes in reverse.
const DRIVES_IN_REVERSE: [(&str, u64); 3] = [("rooms", 1), ("rooms", 2), ("rooms", 3)];

/// Solves all drives with these faults and hands each with its name to `check`.
fn in_every_drive(faults: &[Fault], check: impl Fn(&Outcome, &str)) {
    in_every_one_of(&DRIVES, faults, check);
}

fn in_every_one_of(drives: &[(&str, u64)], faults: &[Fault], check: impl Fn(&Outcome, &str)) {
    for (world, seed) in drives {
        let outcome = solve(world, *seed, faults, "");
        let drive = format!("{world} {seed}: {outcome}");
        assert!(outcome.result.kidnappings.is_empty(), "{drive}");
        check(&outcome, &drive);
    }
}

#[test]
fn without_faults_scan_and_odometry_agree() {
    in_every_drive(&[], |outcome, drive| {
        assert!(outcome.rejected_s.is_empty(), "{drive}");
        assert!(outcome.misfits_s.is_empty(), "{drive}");
        assert!(outcome.error.translation_m.max < 0.03, "{drive}");
    });
}

/// A LiDAR that takes a tenth of a second for its sweep, on a robot that turns by up to 7° meanwhile and has no odometry.
#[test]
fn without_odometry_scans_tell_how_the_robot_moves_while_the_lidar_sweeps() {
    let mut simulation = quick();
    simulation.robot.lidar.sweep_duration_s = 0.1;
    for (world, seed) in [("rooms", 1), ("rooms", 2), ("pillars", 1)] {
        let errors = [true, false].map(|deskews| {
            let settings = format!(
                "robot.lidar.sweep_duration_s = 0.1\nscan.deskew = {deskews}\nodometry.source = \"scan_matching\""
            );
            solve_as(world, seed, simulation.clone(), &settings).error
        });
        let [undone, skewed] = errors.map(|error| (error.translation_m.rmse, error.rotation_deg.rmse));
        assert!(undone.0 < 0.008 && undone.1 < 0.1, "{world} {seed}: {undone:?}, skewed {skewed:?}");
        assert!(
            undone.0 < 0.4 * skewed.0 && undone.1 < 0.4 * skewed.1,
            "{world} {seed}: {undone:?}, skewed {skewed:?}"
        );
    }
}

/// It is put a metre ahead, so that one scan shows it to be as fast as no robot is.
#[test]
fn without_odometry_a_jump_that_is_not_believed_bends_no_scan() {
    let mut simulation = quick();
    simulation.robot.lidar.sweep_duration_s = 0.1;
    simulation.faults = vec![Fault::Kidnapping { at_s: 25.0, ahead_m: 1.0 }];
    for seed in [5, 16] {
        let settings = "robot.lidar.sweep_duration_s = 0.1\nodometry.source = \"scan_matching\"";
        let outcome = solve_as("rooms", seed, simulation.clone(), settings);
        assert!(outcome.error.translation_m.max < 0.1, "rooms {seed}: {outcome}");
    }
}

#[test]
fn spinning_wheels_do_not_move_the_robot() {
    in_every_drive(&[Fault::WheelSlip { from_s: 20.0, for_s: 5.0, share: 1.0 }], |outcome, drive| {
        assert!(outcome.dead_reckoning.translation_m.max > 1.0, "{drive}");
        assert!(outcome.error.translation_m.max < 0.05, "{drive}");
        assert_eq!(outcome.rejected_within(0.0, 19.5), 0, "{drive}");
    });
}

#[test]
fn encoders_that_stick_are_overruled_and_reported() {
    in_every_drive(&[Fault::EncodersStuck { from_s: 20.0, for_s: 5.0 }], |outcome, drive| {
        assert!(outcome.dead_reckoning.translation_m.max > 1.0, "{drive}");
        assert!(outcome.error.translation_m.max < 0.05, "{drive}");
        assert!(outcome.rejected_within(20.0, 26.0) >= 10, "{drive}");
        assert_eq!(outcome.rejected_within(0.0, 19.5), 0, "{drive}");
    });
}

#[test]
fn encoders_that_jump_are_overruled_and_reported() {
    in_every_drive(&[Fault::EncodersJump { from_s: 20.0, for_s: 10.0, jump_m: 0.5 }], |outcome, drive| {
        // The scan during a jump was de-skewed with it; all others are as good as without it.
        assert!(outcome.error.translation_m.max < 0.15, "{drive}");
        assert!(outcome.error.translation_m.rmse < 0.02, "{drive}");
        assert!(outcome.rejected_within(20.0, 31.0) >= 8, "{drive}");
        assert_eq!(outcome.rejected_within(0.0, 19.5), 0, "{drive}");
    });
}

#[test]
fn encoders_without_a_sign_are_overruled_and_reported_in_reverse() {
    let fault = Fault::EncodersSignLost { from_s: 0.0, for_s: 1000.0 };
    in_every_one_of(&DRIVES_IN_REVERSE, &[fault], |outcome, drive| {
        assert!(outcome.dead_reckoning.translation_m.max > 1.0, "{drive}");
        assert!(outcome.error.translation_m.max < 0.05, "{drive}");
        assert!(!outcome.rejected_s.is_empty(), "{drive}");
    });
}

#[test]
fn two_seconds_without_scans_are_bridged_by_the_odometry() {
    in_every_drive(&[Fault::LidarDropout { from_s: 20.0, for_s: 2.0 }], |outcome, drive| {
        let stamps: Vec<f64> = outcome.result.trajectory.iter().map(|pose| pose.stamp_s).collect();
        assert!(stamps.windows(2).any(|pair| pair[1] - pair[0] > 1.9), "nothing was left out in {drive}");
        assert!(outcome.error.translation_m.max < 0.05, "{drive}");
    });
}

#[test]
fn a_third_of_the_rays_can_be_missed() {
    in_every_drive(&[Fault::RaysLost { from_s: 0.0, for_s: 1000.0, share: 0.3 }], |outcome, drive| {
        assert!(outcome.error.translation_m.max < 0.03, "{drive}");
    });
}

#[test]
fn people_who_walk_along_do_not_carry_the_robot_with_them() {
    in_every_drive(&[Fault::PeopleAlong { from_s: 6.0, for_s: 1000.0, people: 4 }], |outcome, drive| {
        assert!(outcome.error.translation_m.max < 0.05, "{drive}");
    });
}

#[test]
fn people_do_not_carry_along_a_robot_whose_encoders_stick() {
    let faults = [
        Fault::PeopleAlong { from_s: 6.0, for_s: 1000.0, people: 4 },
        Fault::EncodersStuck { from_s: 20.0, for_s: 3.0 },
    ];
    in_every_drive(&faults, |outcome, drive| {
        assert!(outcome.error.translation_m.max < 0.06, "{drive}");
        assert!(outcome.rejected_within(20.0, 24.0) >= 5, "{drive}");
    });
}

/// After a gap, and with people all around, much looks different: the robot was not carried for that.
#[test]
fn gaps_and_crowds_are_no_kidnapping() {
    for (seed, fault) in [
        (1, Fault::LidarDropout { from_s: 20.0, for_s: 6.0 }),
        (2, Fault::LidarDropout { from_s: 15.0, for_s: 8.0 }),
        (1, Fault::PeopleAlong { from_s: 10.0, for_s: 30.0, people: 8 }),
        (2, Fault::PeopleAlong { from_s: 10.0, for_s: 30.0, people: 8 }),
    ] {
        let outcome = solve("rooms", seed, std::slice::from_ref(&fault), "");
        assert!(outcome.result.kidnappings.is_empty(), "{seed}, {fault:?}: {outcome}");
        assert!(outcome.error.translation_m.max < 0.05, "{seed}, {fault:?}: {outcome}");
    }
}

/// LiDARs that see little, and gaps where places look alike: the odometry was good, and the scans alone put the robot 5 to 20 m
/// from where it was.
#[test]
fn sparse_lidars_and_gaps_do_not_lose_a_robot_with_good_odometry() {
    let gap = |from_s: f64, for_s: f64| vec![Fault::LidarDropout { from_s, for_s }];
    for (world, seed, range_max_m, faults, most_m) in [
        ("pillars", 1, 3.0, vec![], 1.0),
        ("loop", 2, 80.0, gap(29.0, 15.0), 0.1),
        ("look_alike", 2, 80.0, gap(72.0, 5.0), 0.2),
        ("identical_rooms", 1, 80.0, gap(165.0, 5.0), 0.2),
    ] {
        let mut simulation = SimulationConfig { faults, ..quick() };
        let lidar = &mut simulation.lidar;
        (lidar.beams, lidar.field_of_view_rad, lidar.rate_hz) = (180, std::f64::consts::PI, 5.0);
        lidar.range_max_m = range_max_m;
        let outcome = solve_as(world, seed, simulation, "");
        let largest_m = outcome.error.translation_m.max;
        assert!(outcome.result.kidnappings.is_empty() && largest_m < most_m, "{world} {seed}: {outcome}");
        // What is left is within what is stated.
        let stated_m = outcome.result.uncertainties.iter().map(|stated| 2.45 * stated.sigma_m).fold(0.0, f64::max);
        assert!(largest_m < stated_m, "{world} {seed}, {stated_m} m: {outcome}");
    }
}

/// Thirty rays show too little to correct wheels that are 10 % off; that is said.
#[test]
fn what_thirty_rays_do_not_show_is_stated_to_be_uncertain() {
    let mut simulation = quick();
    (simulation.lidar.beams, simulation.wheels.scale_error) = (30, 0.1);
    let outcome = solve_as("rooms", 0, simulation, "");
    let largest_m = outcome.error.translation_m.max;
    assert!(largest_m < 1.1 * outcome.dead_reckoning.translation_m.max, "{outcome}");
    let stated_m = outcome.result.uncertainties.iter().map(|stated| 2.45 * stated.sigma_m).fold(0.0, f64::max);
    assert!(largest_m < stated_m, "{stated_m} m: {outcome}");
}

/// The robot is carried to a place that it saw before: the map begins anew there, is found on the old one, and the whole
/// drive, up to the scan before and from the scan after, is right again.
#[test]
fn a_robot_that_was_carried_elsewhere_is_found_again() {
    for (world, seed, at_s, ahead_m) in [
        ("rooms", 1, 28.0, -8.0),
        ("rooms", 2, 36.0, -10.0),
        ("pillars", 1, 40.0, 6.0),
        ("pillars", 1, 60.0, -10.0),
        ("corridors", 2, 60.0, -12.0),
        ("figure_of_eight", 1, 200.0, 15.0),
        ("figure_of_eight", 1, 230.0, -25.0),
    ] {
        let outcome = solve(world, seed, &[Fault::Kidnapping { at_s, ahead_m }], "");
        let drive = format!("{world} {seed}, {ahead_m} m at {at_s} s: {outcome}");
        let kidnapped_s = outcome.kidnapped_s();
        assert!(kidnapped_s.len() == 1 && (kidnapped_s[0] - at_s).abs() < 0.7, "{drive}");
        assert!(outcome.result.kidnappings[0].found.is_some() && outcome.wrong_closures == 0, "{drive}");
        assert!(outcome.error.translation_m.max < 0.1 && outcome.error.rotation_deg.max < 1.0, "{drive}");
        // Two submaps of 4 m have to agree, and each is compared with many.
        let driven_m = outcome.driven_until_right_m(kidnapped_s[0], 0.1);
        assert!(driven_m < 12.0, "right again after {driven_m:.1} m; {drive}");
        // It is said to be lost from when that is noticed until its pose is right again, and at no other time.
        let noticed = outcome.live.iter().position(|live| live.is_lost).unwrap();
        let found = noticed + outcome.live[noticed..].iter().position(|live| live.error_m < 0.1).unwrap();
        assert!((at_s - 0.7..at_s + 1.0).contains(&outcome.live[noticed].time_s), "{drive}");
        assert!(outcome.live[noticed..found].iter().all(|live| live.is_lost), "{drive}");
        assert!(outcome.live[found + 1..].iter().all(|live| !live.is_lost), "{drive}");
    }
}

/// What it sees at first is new; only at the end the robot comes back to what it knows.
#[test]
fn a_robot_that_was_carried_to_where_it_never_was_is_found_when_it_comes_back() {
    for (world, seed, at_s, ahead_m) in [("rooms", 1, 20.0, 5.0), ("rooms", 3, 30.0, 8.0), ("corridors", 1, 45.0, 10.0)]
    {
        let outcome = solve(world, seed, &[Fault::Kidnapping { at_s, ahead_m }], "");
        let drive = format!("{world} {seed}, {ahead_m} m at {at_s} s: {outcome}");
        assert!(outcome.result.kidnappings.iter().any(|kidnapping| kidnapping.found.is_some()), "{drive}");
        assert!(outcome.error.translation_m.max < 0.1 && outcome.wrong_closures == 0, "{drive}");
    }
}

#[test]
fn a_robot_can_be_carried_twice() {
    let faults = [Fault::Kidnapping { at_s: 100.0, ahead_m: -15.0 }, Fault::Kidnapping { at_s: 250.0, ahead_m: 12.0 }];
    let outcome = solve("figure_of_eight", 2, &faults, "");
    assert_eq!(outcome.result.kidnappings.len(), 2, "{outcome}");
    assert!(outcome.result.kidnappings.iter().all(|kidnapping| kidnapping.found.is_some()), "{outcome}");
    assert!(outcome.error.translation_m.max < 0.15 && outcome.wrong_closures == 0, "{outcome}");
}

/// Rooms and corridors that look the same within some centimetres: the robot is carried to where it never was, and as
/// much speaks for several places where it was. It must not be put into one of them.
#[test]
fn where_many_places_look_the_same_a_carried_robot_is_said_to_be_lost() {
    for at_s in [150.0, 300.0] {
        let outcome = solve("identical_rooms", 1, &[Fault::Kidnapping { at_s, ahead_m: 12.0 }], "");
        let kidnappings = &outcome.result.kidnappings;
        assert!(kidnappings.len() == 1 && kidnappings[0].found.is_none(), "{outcome}");
        assert!(outcome.error_until(at_s - 0.6) < 0.15 && outcome.wrong_closures == 0, "{outcome}");
        assert!(outcome.live.last().unwrap().is_lost, "{outcome}");
    }
}

/// What became of a random drive.
struct RandomDrive {
    result: SlamResult,
    /// How far each pose of the result is off, metres.
    off_m: Vec<f64>,
    /// How many poses were off by more than was stated at the time, of a robot that was not said to be lost.
    silent: usize,
}

fn solve_random(seed: u64, scenario: &Scenario) -> RandomDrive {
    let drive = scenario.simulate().unwrap();
    let config = Config { seed, ..Config::resolve(&[Layer::from_robot(&scenario.config.robot)]).unwrap() };
    let (records, truth) = (drive.records(), drive.truth());
    let mut slam = Slam::new(&config);
    let frames = Frames::new(&records, &config).unwrap();
    let (mut taken, mut silent) = (Vec::new(), 0);
    for frame in frames.iter() {
        let step = slam.process(&frame).unwrap();
        taken.push(frame.index);
        let off_m = truth[taken[0]].pose.between(&truth[frame.index].pose).between(&step.pose).distance();
        let stated_m = 3.0 * step.uncertainty.unwrap().sigma_m;
        silent += usize::from(!step.is_lost && off_m > 1.0 + stated_m);
    }
    let result = slam.finish();
    let start = truth[taken[0]].pose;
    let off_m = taken
        .iter()
        .zip(&result.trajectory)
        .map(|(&frame, stamped)| start.between(&truth[frame].pose).between(&stamped.pose).distance())
        .collect();
    RandomDrive { result, off_m, silent }
}

/// In a dormitory and in a mixture of kinds of buildings much of what is seen right after fits where the robot was thought to be:
/// a scan alone tells, that fits worse than is ordinary and elsewhere than the odometry says. Until that is certain the robot
/// is said to be who knows where, in the end it is found.
#[test]
fn a_robot_that_was_carried_to_where_much_looks_alike_is_found_again() {
    for (seed, share, ahead_m) in [(1_570_022_541, 0.47, -15.0), (462_022_663, 0.56, -25.0)] {
        let mut scenario = Scenario::random(seed);
        let driven_s = scenario.world.route_length_m() / scenario.config.motion.speed_m_s;
        scenario.config.faults = vec![Fault::Kidnapping { at_s: share * driven_s, ahead_m }];
        let RandomDrive { result, off_m, silent } = solve_random(seed, &scenario);
        let [kidnapping] = &result.kidnappings[..] else { panic!("{seed}: {:?}", result.kidnappings) };
        assert!(kidnapping.found.is_some(), "{seed}: {kidnapping:?}");
        // … but for a moment until it is noticed.
        let wrong = off_m.iter().filter(|&&off_m| off_m > 0.5).count();
        let few = off_m.len() / 100;
        assert!(silent <= few && wrong <= few, "{seed}: {silent} and {wrong} of {} scans", off_m.len());
    }
}

/// Through 70° of a home's rooms much fits when it is turned by a quarter.
#[test]
fn no_single_scan_turns_a_robot_round_whose_odometry_was_right_so_far() {
    let seed = 2_048_959_182;
    let RandomDrive { off_m, silent, .. } = solve_random(seed, &Scenario::random(seed));
    let largest_m = off_m.iter().copied().fold(0.0, f64::max);
    assert!(largest_m < 0.5 && silent == 0, "{largest_m} m, {silent} of {} scans", off_m.len());
}

/// Trees, poles and far walls, scanned a metre apart by few rays, and a pause of minutes in which the robot drives a little:
/// nobody carried it, and odometry that turns too little by 3 mrad with every metre is put right.
#[test]
fn a_campus_is_not_torn_apart() {
    for seed in [6, 7] {
        let simulation = World::own_robot("campus").unwrap();
        let robot = simulation.robot.clone();
        let drive = simulate(World::named("campus", seed).unwrap(), simulation, seed).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&robot)]).unwrap();
        let records = drive.records();
        let mut slam = Slam::new(&config);
        for frame in Frames::new(&records, &config).unwrap().iter() {
            slam.process(&frame).unwrap();
        }
        let result = slam.finish();
        assert!(result.kidnappings.is_empty(), "{seed}: {:?}", result.kidnappings);
        let options =
            TrajectoryErrorOptions { alignment: Alignment::LeastSquares, ..TrajectoryErrorOptions::default() };
        let error = TrajectoryError::new(&result.trajectory, &drive.truth(), &options).unwrap().translation_m;
        assert!(error.rmse < 1.0, "{seed}: {error:?}");
    }
}
