//! What becomes of a drive when sensors fail, people get in the way, or the robot is carried off.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use floorprint::simulator::Fault;
use simulation::{Outcome, solve};

fn drive_with(fault: Fault) -> Outcome {
    solve("rooms", 1, &[fault], "")
}

#[test]
fn without_faults_scan_and_odometry_agree() {
    let outcome = solve("rooms", 1, &[], "");
    assert!(outcome.rejected_s.is_empty(), "{outcome}");
    assert!(outcome.error.translation_m.max < 0.03, "{outcome}");
}

#[test]
fn spinning_wheels_do_not_move_the_robot() {
    let outcome = drive_with(Fault::WheelSlip { from_s: 20.0, for_s: 5.0, share: 1.0 });
    assert!(outcome.dead_reckoning.translation_m.max > 2.0, "{outcome}");
    assert!(outcome.error.translation_m.max < 0.05, "{outcome}");
}

#[test]
fn encoders_that_stick_are_overruled_and_reported() {
    let outcome = drive_with(Fault::EncodersStuck { from_s: 20.0, for_s: 5.0 });
    assert!(outcome.dead_reckoning.translation_m.max > 2.0, "{outcome}");
    assert!(outcome.error.translation_m.max < 0.05, "{outcome}");
    assert!(outcome.rejected_within(20.0, 26.0) >= 10, "{outcome}");
    assert_eq!(outcome.rejected_within(0.0, 19.5), 0, "{outcome}");
}

#[test]
fn encoders_that_jump_are_overruled_and_reported() {
    let outcome = drive_with(Fault::EncodersJump { from_s: 20.0, for_s: 10.0, jump_m: 0.5 });
    // The scan during a jump was de-skewed with it; all others are as good as without it.
    assert!(outcome.error.translation_m.max < 0.15, "{outcome}");
    assert!(outcome.error.translation_m.rmse < 0.02, "{outcome}");
    assert!(outcome.rejected_within(20.0, 31.0) >= 8, "{outcome}");
}

#[test]
fn encoders_without_a_sign_are_overruled_and_reported_in_reverse() {
    let outcome = drive_with(Fault::EncodersSignLost { from_s: 0.0, for_s: 1000.0 });
    assert!(outcome.dead_reckoning.translation_m.max > 2.0, "{outcome}");
    assert!(outcome.error.translation_m.max < 0.05, "{outcome}");
    assert!(!outcome.rejected_s.is_empty(), "{outcome}");
}

#[test]
fn two_seconds_without_scans_are_bridged_by_the_odometry() {
    let outcome = drive_with(Fault::LidarDropout { from_s: 20.0, for_s: 2.0 });
    assert!(outcome.error.translation_m.max < 0.05, "{outcome}");
}

#[test]
fn a_third_of_the_rays_can_be_missed() {
    let outcome = drive_with(Fault::RaysLost { from_s: 0.0, for_s: 1000.0, share: 0.3 });
    assert!(outcome.error.translation_m.max < 0.03, "{outcome}");
}

#[test]
fn people_who_walk_along_do_not_carry_the_robot_with_them() {
    let outcome = drive_with(Fault::PeopleAlong { from_s: 6.0, for_s: 1000.0, people: 4 });
    assert!(outcome.error.translation_m.max < 0.05, "{outcome}");
}

/// A robot that was carried elsewhere cannot know where it is, but that it is lost: the scan does not fit.
#[test]
fn a_kidnapping_is_noticed_at_the_first_scan() {
    let outcome = drive_with(Fault::Kidnapping { at_s: 20.0, ahead_m: 5.0 });
    assert!(outcome.misfits_within(19.4, 20.6) >= 1, "{outcome}");
    assert_eq!(outcome.misfits_within(0.0, 19.3), 0, "{outcome}");
    assert!(outcome.error_until(19.3) < 0.05, "{outcome}");
}
