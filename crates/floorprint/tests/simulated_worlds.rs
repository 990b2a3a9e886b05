//! How close the default configuration comes to the truth in the simulator's worlds.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use floorprint::simulator::{Fault, SimulationConfig};
use rayon::ThreadPoolBuilder;
use simulation::{quick, solve, solve_as};
use std::f64::consts::PI;

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
    assert!(outcome.error.translation_m.max < 0.15, "{outcome}");
    assert!(outcome.final_m < 0.05 && outcome.wrong_closures == 0, "{outcome}");
}

#[test]
fn corridors_that_look_the_same_are_not_confused() {
    let outcome = solve("five_corridors", 2, &[], "");
    assert!(outcome.error.translation_m.max < 0.15, "{outcome}");
    assert!(outcome.final_m < 0.1 && outcome.wrong_closures == 0, "{outcome}");
}

#[test]
fn a_loop_of_half_a_kilometre_closes() {
    for seed in [1, 2] {
        let outcome = solve("long_loop", seed, &[], "");
        assert!(outcome.error.translation_m.max < 0.5, "{outcome}");
        assert!(outcome.final_m < 0.1 && outcome.wrong_closures == 0, "{outcome}");
    }
}

/// Nearly two kilometres of corridors with few doors, most of them driven twice, and a LiDAR that sees them sparsely:
/// nearly everywhere the robot fits well at places along its corridor where it is not.
#[test]
fn bare_corridors_are_tied_together_only_where_they_can_be_told_apart() {
    let mut simulation = quick();
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.lidar.range_max_m) = (180, 5.0, 80.0);
    simulation.lidar.field_of_view_rad = PI;
    for seed in [4, 5] {
        let outcome = solve_as("main_building", seed, simulation.clone(), "");
        assert!(outcome.final_m < 0.1 && outcome.error.translation_m.max < 1.0, "seed {seed}: {outcome}");
        // A few that confirm where the robot is say nothing about where along the corridor.
        assert!(outcome.wrong_closures <= 10, "seed {seed}: {outcome}");
    }
}

/// The wheels spin where the robot sees bare walls only: it comes back 1.5 m behind where it thinks
/// it is, to recesses 2.5 m apart. The nearest that fits is the wrong one.
#[test]
fn places_that_look_alike_are_told_apart_by_what_comes_later() {
    let mut simulation =
        SimulationConfig { faults: vec![Fault::WheelSlip { from_s: 80.0, for_s: 3.0, share: 0.5 }], ..quick() };
    simulation.lidar.range_max_m = 8.0;
    for seed in 1..=3 {
        let drive = |settings| solve_as("look_alike", seed, simulation.clone(), settings);
        let (one, several) = (drive("[loop_closure]\nhypotheses = 1"), drive(""));
        assert!(one.final_m > 0.5 && one.wrong_closures > 0, "a single account, seed {seed}: {one}");
        assert!(several.final_m < 0.15 && several.wrong_closures == 0, "several accounts, seed {seed}: {several}");
    }
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
