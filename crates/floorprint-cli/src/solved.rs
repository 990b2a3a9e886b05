//! A drive that was solved as `floorprint run` solves it, before anything is written.

use crate::check;
use crate::config::Settings;
use crate::dead_reckon::is_without_lidar;
use crate::interrupt::Interrupt;
use crate::mcap;
use crate::report::Report;
use crate::run::{Task, Work};
use crate::run_folder;
use crate::session_keeper::SessionKeeper;
use crate::snapshots::Snapshots;
use crate::solve::{Earlier, Solution, Surroundings, solve};
use crate::stopwatch::Stopwatch;
use crate::terminal::Terminal;
use crate::truth::TruthFiles;
use crate::watcher::Watcher;
use anyhow::{Context as _, bail};
use floorprint::doctor;
use floorprint::front_end::FilterKind;
use floorprint::map::{Occupancy, Raster};
use floorprint::odometry::Finding;
use floorprint::sensors::StampedPose;
use floorprint::{Config, Phase, Profiler};
use floorprint_io::{Contents, Layers, OpenOptions, RunFolder, SessionFile, open, png_bytes};
use std::path::{Path, PathBuf};

/// A drive with what was made of it.
pub struct Solved {
    /// The configuration in force.
    pub config: Config,
    /// Trajectory, steps, closures, session, floor.
    pub solution: Solution,
    /// The occupancy map; one unknown cell where nothing was seen, and unknown ground around the trajectory without a LiDAR.
    pub map: Raster<Occupancy>,
    pub(crate) report: Report,
    input_sha256: String,
    stopwatch: Stopwatch,
    keeper: Option<SessionKeeper>,
    snapshots: Option<Snapshots>,
}

/// What another program asks to be solved.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Data set: a file or a folder, recognised by its content.
    pub path: PathBuf,
    /// Which drive, and which topics.
    pub options: OpenOptions,
    /// Preset and settings.
    pub settings: Settings,
    /// Threads that share the work; all cores where nothing is said.
    pub threads: Option<u16>,
    /// Whether the floor is painted, where there are images.
    pub paints_floor: bool,
}

/// Solves a drive as `floorprint run` does, without writing anything. `None` where the watcher stopped it.
///
/// # Errors
/// What `floorprint run` would say.
pub fn solve_drive(request: &Request, watcher: &Watcher) -> anyhow::Result<Option<Solved>> {
    let work = Work::in_memory(request.threads, request.paints_floor);
    let task = Task {
        path: &request.path,
        options: request.options.clone(),
        settings: &request.settings,
        work: &work,
        out: Path::new(""),
        arrival: None,
        force: false,
        earlier: None,
        mcap: None,
    };
    let solved = work.pool()?.install(|| task.solve(&watcher.terminal(), &watcher.interrupt, None))?;
    Ok(solved.filter(|solved| !solved.solution.partial))
}

impl Task<'_> {
    /// Solves the drive. What was seen so far is kept beside the folder `beside` on the way, if there is to be one.
    /// `None` when the user stopped it before there was anything to write.
    pub(crate) fn solve(
        &self,
        terminal: &Terminal,
        interrupt: &Interrupt,
        beside: Option<&Path>,
    ) -> anyhow::Result<Option<Solved>> {
        let mut stopwatch = Stopwatch::start(Phase::Read);
        let reading = terminal.busy("reading");
        let data_set = open(self.path, &self.options);
        reading.finish_and_clear();
        let mut data_set = data_set?;
        let config = self.settings.resolve(Some(&data_set.robot))?;
        for note in &data_set.notes {
            terminal.note(note);
        }

        let symptoms = doctor::examine_numbers(&data_set.records);
        check::refuse_hopeless(&symptoms, self.path)?;
        if let Some(arrival) = &self.arrival {
            data_set.records = arrival.of(data_set.records, config.seed);
        }
        let has_lidar = !is_without_lidar(&data_set);
        if let (Some(path), false) = (self.mcap, has_lidar) {
            bail!(
                "--mcap {}: there is no LiDAR, whose scans would be written there: run without --mcap",
                path.display()
            );
        }
        let earlier = match self.earlier {
            Some((path, start)) => Some(Earlier { session: SessionFile::open(path)?.load()?, start }),
            None => None,
        };
        let annotations = self.earlier.map(|(path, _)| SessionFile::read_annotations(path)).transpose()?;
        let mut keeper = beside
            .filter(|_| has_lidar && keeps_session(&config))
            .map(|out| SessionKeeper::beside(out, terminal, notes(&config, &data_set.input_hash)))
            .map(|keeper| keeper.every(self.work.save_every()));
        // What people said of the map stays true where it is gone on with.
        if let (Some(keeper), Some(annotations)) = (&mut keeper, annotations.filter(|all| !all.is_empty())) {
            keeper.annotate(&annotations);
        }
        let mut snapshots = self.work.snapshots().filter(|_| has_lidar);
        let mut around = Surroundings {
            terminal,
            interrupt,
            profiler: &mut stopwatch,
            snapshots: snapshots.as_mut(),
            session: keeper.as_mut(),
            memory: self.work.memory().store(self.out, &config)?,
            earlier,
        };
        let solution = solve(&data_set, &config, self.work.paints_floor(), self.arrival.is_some(), &mut around)
            .with_context(|| format!("cannot solve {}", self.path.display()))?;
        let symptoms = [symptoms, doctor::examine_solved(&solution.steps, &data_set.records)].concat();
        check::tell(&symptoms, terminal);
        for finding in &solution.summary.findings {
            if matches!(finding, Finding::Lag { .. }) {
                terminal.note(&finding.to_string());
            }
        }
        if solution.partial && solution.trajectory.is_empty() {
            terminal.warn("stopped before the first scan: there is nothing to write");
            return Ok(None);
        }

        stopwatch.enter(Phase::Evaluate);
        let map = if solution.is_dead_reckoning() {
            unknown_ground(&solution.trajectory)
        } else {
            solution.map.to_raster().unwrap_or_else(|| nothing_seen(config.map.resolution_m))
        };
        if let Some(path) = self.mcap {
            let _writing = terminal.busy("writing");
            let frames = data_set.frames(&config)?;
            let frames = if self.arrival.is_some() { frames.in_order_of_arrival() } else { frames };
            mcap::write(path, &frames, &config, &solution, &map)?;
        }
        let mut report = Report::new(self.path, &data_set, self.settings.preset.name(), &config, &solution, &map);
        report.notes.extend(symptoms.iter().map(check::sentence));
        if map.resolution_m > config.map.resolution_m && !solution.is_dead_reckoning() {
            report.notes.push(format!(
                "what was seen lies so far apart that the map is drawn in cells of {} m instead of {} m",
                map.resolution_m, config.map.resolution_m
            ));
        }
        report.errors = TruthFiles::beside(self.path).errors(&data_set, &solution, &map, &config, &mut report.notes)?;
        report.take_cost(&mut stopwatch);
        let input_sha256 = data_set.input_hash;
        Ok(Some(Solved { config, solution, map, report, input_sha256, stopwatch, keeper, snapshots }))
    }
}

impl Solved {
    /// `report.json`: what the run was, what it found, how good that is, what it cost.
    ///
    /// # Errors
    /// Never, as far as is known: it holds numbers and text only.
    pub fn report_json(&self) -> anyhow::Result<String> {
        Ok(serde_json::to_string_pretty(&self.report)? + "\n")
    }

    /// Names the call that asked for it, in the report.
    pub fn made_by(&mut self, call: String) {
        self.report.made.command = call;
    }

    /// Names in the report where the recording came from, where it was fetched to be read.
    pub fn fetched_from(&mut self, address: String) {
        self.report.input.path = address;
    }

    /// The true trajectory in the world of the result; empty where it is not known.
    #[must_use]
    pub fn true_trajectory(&self) -> &[StampedPose] {
        &self.report.errors.true_trajectory
    }

    /// The map with trajectory and dead reckoning, as a PNG file's bytes.
    ///
    /// # Errors
    /// It is too large to be a picture.
    pub fn picture_png(&self) -> anyhow::Result<Vec<u8>> {
        let picture = run_folder::with_trajectories(&self.map, &self.solution).into_picture();
        png_bytes(&picture).context("the picture cannot be encoded")
    }

    /// Writes the folder that `floorprint run` writes.
    ///
    /// # Errors
    /// The folder exists, unless it holds a run and is `replaced`; it cannot be written.
    pub fn save(&mut self, out: &Path, replace: bool) -> anyhow::Result<()> {
        let folder = RunFolder::create(out, Contents::Run, replace)?;
        if keeps_session(&self.config) && !self.solution.is_dead_reckoning() {
            let terminal = Terminal::new(true);
            self.keeper = Some(SessionKeeper::beside(out, &terminal, notes(&self.config, &self.input_sha256)));
        }
        self.write(folder.path())?;
        folder.finish()?;
        self.is_in_place();
        Ok(())
    }

    /// Takes away what was kept on the way, now that the folder is in place.
    pub(crate) fn is_in_place(&mut self) {
        if let Some(keeper) = self.keeper.take() {
            keeper.remove();
        }
    }

    /// Writes everything into a folder that exists.
    pub(crate) fn write(&mut self, folder: &Path) -> anyhow::Result<()> {
        self.stopwatch.enter(Phase::Write);
        if let Some(snapshots) = &self.snapshots {
            snapshots.write(&folder.join("snapshots"), &self.solution.steps)?;
        }
        // Before the report, by which a complete run is known.
        if let Some(keeper) = &mut self.keeper {
            let floor = self.solution.floor.as_ref().map(|floor| &floor.map);
            let layers = Layers { session: &self.solution.session, map: &self.map, floor };
            keeper.finish(&layers, &self.config.matcher, Some(&folder.join("session.gpkg")))?;
        }
        let Self { config, solution, map, report, stopwatch, .. } = self;
        run_folder::write(folder, report, solution, map, config, stopwatch)
    }
}

/// Whether there is a session that can be gone on with.
pub(crate) fn keeps_session(config: &Config) -> bool {
    config.filter.kind == FilterKind::RaoBlackwellized && config.loop_closure.enabled
}

/// What is noted in the session's file.
fn notes(config: &Config, input_sha256: &str) -> Vec<(&'static str, String)> {
    vec![("config", config.to_toml()), ("input_sha256", input_sha256.to_owned())]
}

/// Unknown ground around a path, for drawing it where there is no map.
pub(crate) fn unknown_ground(path: &[StampedPose]) -> Raster<Occupancy> {
    const SMALLEST_CELL_M: f64 = 0.05;
    const MOST_CELLS: f64 = 500.0;
    let (mut low_m, mut high_m) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for StampedPose { pose, .. } in path {
        for (axis, position_m) in [pose.x, pose.y].into_iter().enumerate() {
            low_m[axis] = low_m[axis].min(position_m);
            high_m[axis] = high_m[axis].max(position_m);
        }
    }
    let size_m = [high_m[0] - low_m[0], high_m[1] - low_m[1]];
    let resolution_m = (size_m[0].max(size_m[1]) / MOST_CELLS).max(SMALLEST_CELL_M);
    let [width, height] = size_m.map(|length_m| 1 + (length_m / resolution_m) as usize);
    Raster { width, height, resolution_m, origin_m: low_m, cells: vec![Occupancy::Unknown; width * height] }
}

/// A map of a drive on which nothing was seen: one cell, unknown.
pub(crate) fn nothing_seen(resolution_m: f64) -> Raster<Occupancy> {
    Raster { width: 1, height: 1, resolution_m, origin_m: [0.0; 2], cells: vec![Occupancy::Unknown] }
}
