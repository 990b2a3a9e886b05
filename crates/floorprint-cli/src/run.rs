//! `floorprint run`: from a data set to a folder of results.

use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::number::number;
use crate::outcome::Outcome;
use crate::report::Report;
use crate::run_folder;
use crate::snapshots::Snapshots;
use crate::solve::{Surroundings, solve};
use crate::stopwatch::Stopwatch;
use crate::summary;
use crate::terminal::Terminal;
use crate::topics::Topics;
use crate::truth::TruthFiles;
use anyhow::Context as _;
use clap::Args;
use floorprint::map::{Occupancy, Raster};
use floorprint::{Phase, Profiler};
use floorprint_io::{Contents, OpenOptions, RunFolder, open};
use std::path::{Path, PathBuf};

/// Solve a drive: trajectory, map, floor and a report, in one folder.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file or a folder, recognised by its content.
    path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    work: Work,
    /// Folder of the results [default: runs/NAME-PRESET, after the data set].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the folder if it exists.
    #[arg(long)]
    force: bool,
    /// Largest share of the data that may be dropped; beyond it the exit code is 3.
    #[arg(long, value_name = "SHARE", default_value_t = 0.05, value_parser = number(0.0, 1.0))]
    max_dropped: f64,
}

/// How the work is done, whatever is solved.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Work {
    /// Threads that share the work; the results are the same for any number [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: Option<u16>,
    /// Leave the floor unpainted.
    #[arg(long)]
    no_texture: bool,
    /// Draw the map so far every so many seconds of the drive, and an animation. Each map is drawn anew
    /// from all scans until then: the time grows with the square of the drive.
    #[arg(long, value_name = "SECONDS", value_parser = number(0.001, 1e9))]
    snapshots: Option<f64>,
}

impl Work {
    /// The threads that share the work.
    ///
    /// # Errors
    /// The system gives no threads.
    pub(crate) fn pool(&self) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
        rayon::ThreadPoolBuilder::new().num_threads(self.threads.map_or(0, usize::from)).build()
    }
}

/// What to solve and where to put it.
pub(crate) struct Task<'a> {
    /// Data set.
    pub(crate) path: &'a Path,
    /// Which drive and which topics.
    pub(crate) options: OpenOptions,
    /// Configuration.
    pub(crate) settings: &'a Settings,
    /// Threads and extras.
    pub(crate) work: &'a Work,
    /// Folder of the results.
    pub(crate) out: &'a Path,
    /// Whether an existing folder is replaced.
    pub(crate) force: bool,
}

/// Runs `floorprint run`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let out = arguments.out.clone().unwrap_or_else(|| {
        let name = run_folder::data_set_name(&arguments.path);
        let drive = arguments.drive.map_or(String::new(), |drive| format!("-{drive}"));
        Path::new("runs").join(format!("{name}{drive}-{}", arguments.settings.preset.name()))
    });
    let task = Task {
        path: &arguments.path,
        options: arguments.topics.open_options(arguments.drive),
        settings: &arguments.settings,
        work: &arguments.work,
        out: &out,
        force: arguments.force,
    };
    let Some(report) = task.execute(terminal)? else { return Ok(Outcome::Interrupted) };
    summary::print(&mut terminal.results(), &report, &out)?;
    if report.partial {
        terminal.warn("stopped before its end: the results are partial");
        return Ok(Outcome::Interrupted);
    }
    if report.dropped_share > arguments.max_dropped {
        terminal.warn(&format!(
            "{:.1} % of the data were dropped, more than the {:.1} % that --max-dropped allows; the report lists them",
            100.0 * report.dropped_share,
            100.0 * arguments.max_dropped
        ));
        return Ok(Outcome::DataDropped);
    }
    Ok(Outcome::Fine)
}

impl Task<'_> {
    /// Solves the drive on its own pool of threads and writes the folder; `None`, and no folder, when the
    /// user stopped it before there was anything to write.
    pub(crate) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Option<Report>> {
        let interrupt = Interrupt::listen();
        self.work.pool()?.install(|| self.solve_and_write(terminal, &interrupt))
    }

    fn solve_and_write(&self, terminal: &Terminal, interrupt: &Interrupt) -> anyhow::Result<Option<Report>> {
        let mut stopwatch = Stopwatch::start(Phase::Read);
        let folder = RunFolder::create(self.out, Contents::Run, self.force)?;
        interrupt.removes(folder.path());
        let data_set = open(self.path, &self.options)?;
        let config = self.settings.resolve(Some(&data_set.robot))?;
        for note in &data_set.notes {
            terminal.note(note);
        }

        let mut snapshots = self.work.snapshots.map(Snapshots::new);
        let mut around = Surroundings { terminal, interrupt, profiler: &mut stopwatch, snapshots: snapshots.as_mut() };
        let solution = solve(&data_set, &config, !self.work.no_texture, &mut around)
            .with_context(|| format!("cannot solve {}", self.path.display()))?;
        if solution.partial && solution.trajectory.is_empty() {
            terminal.warn("stopped before the first scan: there is nothing to write");
            return Ok(None);
        }

        stopwatch.enter(Phase::Evaluate);
        let map = solution.map.to_raster().unwrap_or_else(|| nothing_seen(config.map.resolution_m));
        let mut report = Report::new(self.path, &data_set, self.settings.preset.name(), &config, &solution, &map);
        report.errors = TruthFiles::beside(self.path).errors(&data_set, &solution, &map, &config, &mut report.notes)?;
        stopwatch.enter(Phase::Write);
        if let Some(snapshots) = &snapshots {
            snapshots.write(&folder.path().join("snapshots"), &solution.steps)?;
        }
        run_folder::write(folder.path(), &mut report, &solution, &map, &config, &mut stopwatch)?;
        folder.finish()?;
        Ok(Some(report))
    }
}

/// The map of a drive on which nothing was seen: one unknown cell.
fn nothing_seen(resolution_m: f64) -> Raster<Occupancy> {
    Raster { width: 1, height: 1, resolution_m, origin_m: [0.0, 0.0], cells: vec![Occupancy::Unknown] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn what_is_stopped_before_its_first_scan_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (log, out) = (folder.path().join("drive.clf"), folder.path().join("runs/drive"));
        fs::write(&log, "FLASER 3 2.0 2.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n").unwrap();
        let (settings, work) = (Settings::default(), Work::default());
        let task = Task {
            path: &log,
            options: OpenOptions::default(),
            settings: &settings,
            work: &work,
            out: &out,
            force: false,
        };
        let interrupt = Interrupt::default();
        interrupt.request();
        assert!(task.solve_and_write(&Terminal::new(true), &interrupt).unwrap().is_none());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
