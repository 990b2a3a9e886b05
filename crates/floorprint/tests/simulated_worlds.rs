//! How close the default configuration comes to the truth in the simulator's worlds.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use rayon::ThreadPoolBuilder;
use simulation::{Outcome, solve, solve_sparse};

#[test]
fn small_worlds_are_mapped_to_a_few_centimetres() {
    for world in ["rooms", "corridors", "loop", "pillars", "glass", "people"] {
        let outcome = solve(world, 2, &[], "");
        assert!(outcome.error.translation_m.rmse < 0.02, "{world}: {outcome}");
        assert!(outcome.error.translation_m.max < 0.06, "{world}: {outcome}");
        assert!(outcome.error.rotation_deg.rmse < 0.15, "{world}: {outcome}");
        assert!(outcome.rejected_s.is_empty(), "{world}: {outcome}");
    }
}

#[test]
fn loops_that_share_a_corridor_close() {
    let outcome = solve("figure_of_eight", 1, &[], "");
    assert!(outcome.error.translation_m.max < 0.25, "{outcome}");
    assert!(outcome.final_m < 0.05, "{outcome}");
    assert_closures_are_true(&outcome);
}

#[test]
fn corridors_that_look_the_same_are_not_confused() {
    let outcome = solve("five_corridors", 2, &[], "");
    assert!(outcome.error.translation_m.max < 0.15, "{outcome}");
    assert!(outcome.final_m < 0.1, "{outcome}");
    assert_closures_are_true(&outcome);
}

#[test]
fn a_loop_of_half_a_kilometre_closes() {
    let outcome = solve("long_loop", 1, &[], "");
    assert!(outcome.error.translation_m.max < 0.5, "{outcome}");
    assert!(outcome.final_m < 0.1, "{outcome}");
}

#[test]
#[ignore = "not reached yet: closures along the bare corridor are up to 0.28 m off"]
fn closures_of_a_loop_of_half_a_kilometre_are_true() {
    assert_closures_are_true(&solve("long_loop", 1, &[], ""));
}

#[test]
#[ignore = "not reached yet: some closures join niches that look the same, up to 15 m apart"]
fn a_building_of_long_bare_corridors_is_mapped_with_a_sparse_lidar() {
    let outcome = solve_sparse("main_building", 1);
    assert!(outcome.error.translation_m.rmse < 1.0, "{outcome}");
    assert!(outcome.final_m < 0.1, "{outcome}");
}

/// No closure in force may say what is not so.
fn assert_closures_are_true(outcome: &Outcome) {
    let (off_m, off_rad) = outcome.worst_closure();
    assert!(!outcome.closure_errors.is_empty() && off_m < 0.2 && off_rad < 0.05, "{outcome}");
}

#[test]
fn the_fast_preset_stays_within_a_few_centimetres() {
    let outcome = solve("rooms", 1, &[], floorprint::config::Preset::Fast.toml());
    assert!(outcome.error.translation_m.rmse < 0.03, "{outcome}");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    for settings in ["", "[filter]\nparticles = 6"] {
        let outcomes = [1, 2, 8].map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| solve("corridors", 3, &[], settings))
        });
        assert!(!outcomes[0].result.closures.is_empty());
        for other in &outcomes[1..] {
            assert_eq!(outcomes[0].result.trajectory, other.result.trajectory);
            assert_eq!(outcomes[0].result.closures, other.result.closures);
            assert_eq!(outcomes[0].result.map.to_raster(), other.result.map.to_raster());
        }
    }
}
