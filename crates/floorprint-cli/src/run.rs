//! `floorprint run`: from a data set to a folder of results.

use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::map::map_path;
use crate::mcap;
use crate::memory::Memory;
use crate::number::number;
use crate::outcome::Outcome;
use crate::report::Report;
use crate::run_folder;
use crate::session_keeper;
use crate::snapshots::Snapshots;
use crate::solve::Start;
use crate::summary;
use crate::terminal::Terminal;
use crate::topics::Topics;
use clap::Args;
use floorprint::simulator::Arrival;
use floorprint_io::{Contents, OpenOptions, RunFolder, free_beside};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Solve a drive: trajectory, map, floor and a report, in one folder.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file, a folder or a zip archive, recognised by its content; - for standard input.
    pub(crate) path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    work: Work,
    /// Session of an earlier run (its session.gpkg or its folder) to go on with: one trajectory, one map.
    #[arg(long = "continue", value_name = "SESSION", value_parser = map_path())]
    earlier: Option<PathBuf>,
    /// Where the robot is at the start of a drive that goes on: where the session ended, or anywhere. Else it is taken to
    /// be where the session ended if the drive begins within seconds of it.
    #[arg(long, value_name = "WHERE", requires = "earlier", default_value = "auto")]
    start: Start,
    /// Folder of the results [default: runs/NAME-PRESET after the data set, with a number where that exists].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Also write map, poses with covariance, scans, closures and floor as an MCAP file, for Foxglove and Rerun.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Replace the folder if it exists.
    #[arg(long)]
    force: bool,
    /// Largest share of the data that may be dropped; beyond it the exit code is 3.
    #[arg(long, value_name = "SHARE", default_value_t = 0.05, value_parser = number(0.0, 1.0))]
    max_dropped: f64,
    /// The system refuses more memory than this, megabytes: `batch` asks for it.
    #[arg(long, value_name = "MB", hide = true)]
    memory_limit: Option<u64>,
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
    /// Draw the map so far every so many seconds of the drive, and an animation. Only what
    /// changed is drawn anew.
    #[arg(long, value_name = "SECONDS", value_parser = number(0.001, 1e9))]
    snapshots: Option<f64>,
    /// How many times its size a file of the data set may take in memory, besides 256 MB: what unpacks to more
    /// is refused [default: 64].
    #[arg(long, value_name = "TIMES", value_parser = number(0.0, 1e9))]
    max_expansion: Option<f64>,
    /// Save what was seen so far this often while the drive goes on; seldomer where that would take a twentieth of the
    /// time [default: 1].
    #[arg(long, value_name = "SECONDS", value_parser = number(0.001, 1e6))]
    save_every: Option<f64>,
    #[command(flatten)]
    memory: Memory,
}

impl Work {
    /// Work of which nothing is written on the way.
    pub(crate) fn in_memory(threads: Option<u16>, paints_floor: bool) -> Self {
        Self { threads, no_texture: !paints_floor, ..Self::default() }
    }

    /// How often what was seen so far is saved.
    pub(crate) fn save_every(&self) -> Duration {
        self.save_every.map_or(session_keeper::PERIOD, Duration::from_secs_f64)
    }

    /// How much of the session lies in memory.
    pub(crate) fn memory(&self) -> Memory {
        self.memory
    }

    /// Whether the floor is painted.
    pub(crate) fn paints_floor(&self) -> bool {
        !self.no_texture
    }

    /// What draws pictures on the way, where they are asked for.
    pub(crate) fn snapshots(&self) -> Option<Snapshots> {
        self.snapshots.map(Snapshots::new)
    }

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
    /// How the records come in; as they stand in the files where nothing is said.
    pub(crate) arrival: Option<Arrival>,
    /// Whether an existing folder is replaced.
    pub(crate) force: bool,
    /// Session to go on with, and where the robot is then.
    pub(crate) earlier: Option<(&'a Path, Start)>,
    /// File for viewers, besides the folder.
    pub(crate) mcap: Option<&'a Path>,
}

/// Runs `floorprint run`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    if let Some(megabytes) = arguments.memory_limit {
        limit_memory(megabytes)?;
    }
    let out = arguments.out.clone().unwrap_or_else(|| {
        let name = run_folder::data_set_name(&arguments.path);
        let drive = arguments.drive.map_or(String::new(), |drive| format!("-{drive}"));
        let plain = Path::new("runs").join(format!("{name}{drive}-{}", arguments.settings.preset.name()));
        // The same drive with other settings, or once more: each run has a folder of its own.
        if plain.exists() && !arguments.force { free_beside(&plain) } else { plain }
    });
    execute_arriving(arguments, &out, None, terminal)
}

/// Runs a drive whose records come in as told.
pub(crate) fn execute_arriving(
    arguments: &Arguments,
    out: &Path,
    arrival: Option<Arrival>,
    terminal: &Terminal,
) -> anyhow::Result<Outcome> {
    let task = Task {
        path: &arguments.path,
        options: arguments.topics.open_options(arguments.drive, arguments.work.max_expansion),
        settings: &arguments.settings,
        work: &arguments.work,
        out,
        arrival,
        force: arguments.force,
        earlier: arguments.earlier.as_deref().map(|path| (path, arguments.start)),
        mcap: arguments.mcap.as_deref(),
    };
    let Some((report, out)) = task.execute(terminal)? else { return Ok(Outcome::Interrupted) };
    if !terminal.is_quiet() {
        summary::print(&mut terminal.results(), &report, &out)?;
    }
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
    /// Solves the drive on its own pool of threads and writes the folder; gives the report and where it is.
    /// `None`, and no folder, when the user stopped it before there was anything to write.
    pub(crate) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Option<(Report, PathBuf)>> {
        let interrupt = Interrupt::listen();
        self.work.pool()?.install(|| self.solve_and_write(terminal, &interrupt))
    }

    fn solve_and_write(&self, terminal: &Terminal, interrupt: &Interrupt) -> anyhow::Result<Option<(Report, PathBuf)>> {
        self.mcap.map_or(Ok(()), mcap::check_place)?;
        let folder = RunFolder::create(self.out, Contents::Run, self.force)?;
        interrupt.removes(folder.path());
        interrupt.is_preparing(true);
        for note in folder.notes() {
            terminal.warn(note);
        }
        let Some(mut solved) = self.solve(terminal, interrupt, Some(self.out))? else { return Ok(None) };
        let _writing = terminal.busy("writing");
        solved.write(folder.path())?;
        interrupt.is_finishing();
        let is_partial = solved.report.partial;
        let out =
            if is_partial { folder.finish_partial()? } else { folder.finish().map(|()| self.out.to_path_buf())? };
        solved.is_in_place();
        let report = solved.report;
        if out != *self.out && report.partial {
            let (earlier, kept) = (self.out.display(), out.display());
            terminal.warn(&format!("{earlier} holds the complete results of an earlier run: these lie in {kept}"));
        }
        Ok(Some((report, out)))
    }
}

/// Has the system refuse this process more memory; what then asks for it ends the process.
#[cfg(target_os = "linux")]
fn limit_memory(megabytes: u64) -> anyhow::Result<()> {
    use nix::sys::resource::{Resource, setrlimit};
    let bytes = megabytes.saturating_mul(1_000_000);
    // Data, not addresses: threads reserve far more of those than they ever use.
    Ok(setrlimit(Resource::RLIMIT_DATA, bytes, bytes)?)
}

#[cfg(not(target_os = "linux"))]
fn limit_memory(_megabytes: u64) -> anyhow::Result<()> {
    Ok(())
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
            arrival: None,
            force: false,
            earlier: None,
            mcap: None,
        };
        let interrupt = Interrupt::default();
        interrupt.request();
        assert!(task.solve_and_write(&Terminal::new(true), &interrupt).unwrap().is_none());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
