//! What becomes of a drive when sensors fail, people get in the way, or the robot is carried off.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use floorprint::simulator::Fault;
use simulation::{Outcome, solve};

/// Drives on which the robot moves while the faults last.
const DRIVES: [(&str, u64); 4] = [("rooms", 1), ("rooms", 2), ("rooms", 3), ("pillars", 1)];
/// Those on which it also goes in reverse.
const DRIVES_IN_REVERSE: [(&str, u64); 3] = [("rooms", 1), ("rooms", 2), ("rooms", 3)];

fn drive_with(fault: Fault) -> Outcome {
    solve("rooms", 1, &[fault], "")
}

/// Solves all drives with these faults and hands each with its name to `check`.
fn in_every_drive(faults: &[Fault], check: impl Fn(&Outcome, &str)) {
    in_every_one_of(&DRIVES, faults, check);
}

fn in_every_one_of(drives: &[(&str, u64)], faults: &[Fault], check: impl Fn(&Outcome, &str)) {
    for (world, seed) in drives {
        let outcome = solve(world, *seed, faults, "");
        check(&outcome, &format!("{world} {seed}: {outcome}"));
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

/// A robot that was carried elsewhere cannot know where it is, but that it is lost: the scan does not fit.
#[test]
fn a_kidnapping_is_noticed_at_the_first_scan() {
    let outcome = drive_with(Fault::Kidnapping { at_s: 20.0, ahead_m: 5.0 });
    assert!(outcome.misfits_within(19.4, 20.6) >= 1, "{outcome}");
    assert_eq!(outcome.misfits_within(0.0, 19.3), 0, "{outcome}");
    assert!(outcome.error_until(19.3) < 0.05, "{outcome}");
}
