//! Puts drives together without saying how they lie: of buildings of one kind that are not the same, none may be put on
//! another; of one building, driven through twice, each must: `cargo run --release -p floorprint-cli --example merges --
//! [SEED] [BUILDINGS]`, with so many buildings of each kind.

use anyhow::Context;
use floorprint::config::Layer;
use floorprint::simulator::{Scenario, SimulatedDrive, simulate};
use floorprint::{Config, Frames, Slam, SlamResult};
use std::io::Write;

/// Kinds of buildings, and a campus.
const KINDS: [&str; 9] = ["office", "dormitory", "home", "warehouse", "mall", "hall", "car_park", "mixture", "campus"];
/// Longer drives only take longer, metres.
const LONGEST_M: f64 = 400.0;
/// Of so many random drives those are taken that suit.
const DRAWN: u64 = 5000;

/// A drive without faults, and what came of it.
struct Solved {
    config: Config,
    drive: SimulatedDrive,
    result: SlamResult,
}

impl Solved {
    fn new(scenario: &Scenario, seed: u64) -> anyhow::Result<Self> {
        let drive = simulate(scenario.world.clone(), scenario.config.clone(), seed)?;
        let config = Config { seed, ..Config::resolve(&[Layer::from_robot(&scenario.config.robot)])? };
        let records = drive.records();
        let mut slam = Slam::new(&config);
        for frame in Frames::new(&records, &config)?.iter() {
            slam.process(&frame)?;
        }
        Ok(Self { config, drive, result: slam.finish() })
    }

    /// Puts another drive onto this one; the largest error of its poses, metres, if it was recognised.
    fn merged(&self, other: &Self) -> anyhow::Result<Option<f64>> {
        let frames = self.result.trajectory.len();
        let slam = Slam::resume(self.result.session.clone(), &self.config)?;
        let merged = slam.append(&other.result.session, &self.config)?.finish();
        let seam = merged.kidnappings.iter().find(|kidnapping| kidnapping.frame == frames);
        let world_from_start = self.drive.start().inverse().compose(&other.drive.start());
        let errors_m = merged.trajectory[frames..].iter().map(|pose| {
            let truth = world_from_start.compose(&other.drive.true_pose(pose.stamp_s));
            truth.between(&pose.pose).distance()
        });
        Ok(seam.is_some_and(|seam| seam.found.is_some()).then(|| errors_m.fold(0.0, f64::max)))
    }
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |position: usize, usual: u64| arguments.get(position).map_or(Ok(usual), |text| text.parse());
    let seed = number(0, 1).context("SEED is a whole number")?;
    let buildings = number(1, 3).context("BUILDINGS is a whole number")? as usize;
    let mut out = std::io::stdout().lock();
    let (mut others, mut together, mut same, mut found) = (0, 0, 0, 0);
    for kind in KINDS {
        let suits = |scenario: &Scenario| {
            scenario.world_kind == kind && scenario.base != "no_odometry" && scenario.world.route_length_m() < LONGEST_M
        };
        let mut scenarios: Vec<Scenario> =
            Scenario::seeds(seed, DRAWN).map(Scenario::random).filter(suits).take(buildings).collect();
        scenarios.iter_mut().for_each(|scenario| scenario.config.faults.clear());
        let solved = scenarios.iter().map(|scenario| Solved::new(scenario, scenario.seed));
        let solved = solved.collect::<anyhow::Result<Vec<Solved>>>()?;
        for (a, first) in solved.iter().enumerate() {
            for (_, second) in solved.iter().enumerate().filter(|(b, _)| *b != a) {
                others += 1;
                together += usize::from(first.merged(second)?.is_some());
            }
            // Another drive through the same building: all errors are drawn anew.
            let again = Solved::new(&scenarios[a], scenarios[a].seed ^ 1)?;
            let error_m = first.merged(&again)?;
            (same, found) = (same + 1, found + usize::from(error_m.is_some()));
            let told =
                error_m.map_or("not recognised".to_owned(), |error_m| format!("off by {error_m:.2} m at the most"));
            writeln!(out, "{kind} {}: driven again and put onto it: {told}", scenarios[a].seed)?;
        }
        writeln!(out, "{kind}: of {others} pairs of different buildings so far {together} were put together")?;
    }
    writeln!(out, "Different buildings: {together} of {others} put together. The same: {found} of {same} recognised.")?;
    Ok(())
}
