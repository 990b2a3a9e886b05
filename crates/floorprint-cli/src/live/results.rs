//! What a live session leaves: its session, trajectory and map, in a folder that appears whole or not at all.

use super::{Session, Tally};
use crate::session_keeper::SessionKeeper;
use crate::solved::nothing_seen;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint::{Config, Slam, SlamResult};
use floorprint_io::{Contents, Layers, RunFolder, write_file, write_map, write_trajectory};
use floorprint_live::{DelaySummary, Engine, Step};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::mpsc::channel;
use std::time::Duration;

/// Who asks to end gets an end within a second: the last loops are to be closed so long after that. What is left is for
/// writing the results.
const LAST_LOOPS: Duration = Duration::from_millis(500);

/// The folder of the results.
pub(super) struct Results {
    out: PathBuf,
    folder: RunFolder,
    config: String,
    /// Poses that a localizer claimed.
    claimed: Vec<StampedPose>,
}

/// `live.json`: what became of the session.
#[derive(Serialize)]
struct Report {
    what: &'static str,
    version: &'static str,
    /// Whether all loops were closed; else the trajectory and the map are as they were when the session was ended.
    finished: bool,
    records: usize,
    scans: usize,
    lost: floorprint_live::Lost,
    /// From a scan's coming in to its pose.
    delays: DelaySummary,
    refused: usize,
    synchronisation: floorprint::odometry::SynchronisationSummary,
}

impl Results {
    pub(super) fn create(out: &Path, config: &Config, force: bool) -> anyhow::Result<Self> {
        let folder = RunFolder::create(out, Contents::Live, force)?;
        Ok(Self { out: out.to_path_buf(), folder, config: config.to_toml(), claimed: Vec::new() })
    }

    /// Where it is filled.
    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What is to be told about the folder.
    pub(super) fn notes(&self) -> &[String] {
        self.folder.notes()
    }

    /// Remembers the poses that a localizer claimed.
    pub(super) fn add(&mut self, steps: &[Step]) {
        let claimed = steps.iter().filter_map(|step| Some(StampedPose { stamp_s: step.stamp_s, pose: step.pose? }));
        self.claimed.extend(claimed);
    }
}

/// What a session amounts to.
enum End {
    /// All loops are closed.
    Finished(Box<SlamResult>),
    /// It was ended before that; the trajectory and the map as of then.
    Broken(Vec<StampedPose>, Raster<Occupancy>),
    /// A robot was localised.
    Localized,
}

/// Ends the session and writes what there is to write; tells whether its end was reached.
pub(super) fn end(
    mut engine: Engine,
    keeper: Option<SessionKeeper>,
    results: Option<Results>,
    tally: &Tally,
    session: &Session<'_>,
) -> anyhow::Result<bool> {
    let Session { config, terminal, interrupt, board, .. } = *session;
    let counts = tally.counts;
    let mut keeper = keeper;
    // First of all what was seen is made safe.
    if let (Some(keeper), Some(session)) = (&mut keeper, engine.session()) {
        keeper.save_now(session, &config.matcher);
    }
    let summary = engine.summary();
    let trajectory = if interrupt.requested() { engine.session().map(|session| session.trajectory()) } else { None };
    let end = match engine.into_slam()? {
        None => End::Localized,
        Some(slam) if interrupt.requested() => {
            let map = || board.picture().map.to_raster().unwrap_or_else(|| nothing_seen(config.map.resolution_m));
            finish_in_time(slam, LAST_LOOPS.saturating_sub(interrupt.elapsed()))
                .map_or_else(|| End::Broken(trajectory.unwrap_or_default(), map()), End::Finished)
        }
        Some(slam) => End::Finished(Box::new(slam.finish())),
    };
    let finished = matches!(end, End::Finished(_) | End::Localized);
    if !finished {
        terminal.note("the session is saved; its last loops are closed once it is gone on with");
    }
    if matches!(&end, End::Finished(result) if result.trajectory.is_empty()) && counts.steps == 0 {
        terminal.warn("no scan came: there is nothing to write");
        return Ok(finished);
    }
    let raster = match &end {
        End::Finished(result) => result.map.to_raster().unwrap_or_else(|| nothing_seen(config.map.resolution_m)),
        End::Broken(_, map) => map.clone(),
        End::Localized => nothing_seen(config.map.resolution_m),
    };
    if let Some(keeper) = &mut keeper {
        let target = results.as_ref().map(|results| results.folder().join("session.gpkg"));
        let layers = match &end {
            End::Finished(result) => Some(Layers { session: &result.session, map: &raster, floor: None }),
            End::Broken(..) | End::Localized => None,
        };
        keeper.finish_live(layers.as_ref(), &config.matcher, target.as_deref())?;
    }
    let Some(results) = results else { return Ok(finished) };
    let folder = results.folder();
    match &end {
        End::Finished(result) => write_trajectory(&folder.join("trajectory.tum"), &result.trajectory)?,
        End::Broken(trajectory, _) => write_trajectory(&folder.join("trajectory.tum"), trajectory)?,
        End::Localized => write_trajectory(&folder.join("trajectory.tum"), &results.claimed)?,
    }
    if !matches!(end, End::Localized) {
        write_map(&folder.join("map.yaml"), &raster)?;
    }
    write_file(&folder.join("config.toml"), results.config.as_bytes())?;
    let report = Report {
        what: Contents::Live.what(),
        version: env!("CARGO_PKG_VERSION"),
        finished,
        records: counts.records,
        scans: counts.steps,
        lost: counts.lost,
        delays: tally.delays.summary(),
        refused: counts.refused,
        synchronisation: summary,
    };
    // Last: a folder with it is complete.
    write_file(&folder.join("live.json"), (serde_json::to_string_pretty(&report)? + "\n").as_bytes())?;
    interrupt.is_finishing();
    let out = results.out;
    results.folder.finish()?;
    if let Some(keeper) = keeper {
        keeper.remove();
    }
    terminal.say(&format!("{} scans; results in {}", counts.steps, out.display()));
    Ok(finished)
}

/// Closes the last loops, if that does not take too long.
fn finish_in_time(slam: Slam, most: Duration) -> Option<Box<SlamResult>> {
    if most.is_zero() {
        return None;
    }
    let (done, wait) = channel();
    // What is not done in time ends with the process.
    std::thread::spawn(move || done.send(Box::new(slam.finish())));
    wait.recv_timeout(most).ok()
}
