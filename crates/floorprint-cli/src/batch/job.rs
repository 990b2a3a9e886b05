//! One run of a batch, in a process of its own.

use crate::interrupt::Interrupt;
use crate::program::Program;
use crate::topics::Topics;
use anyhow::Context as _;
use floorprint::config::Preset;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// What is to be solved, and how.
#[derive(Debug, Clone)]
pub(super) struct Job {
    pub(super) log: PathBuf,
    /// Name of the run's folder.
    pub(super) name: String,
    pub(super) input_sha256: String,
    pub(super) config_sha256: String,
    pub(super) preset: Preset,
    pub(super) config: Option<PathBuf>,
    pub(super) set: Vec<String>,
    pub(super) seed: u64,
    pub(super) topics: Topics,
    pub(super) no_texture: bool,
}

/// What a run may take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) threads: u16,
    pub(super) time_s: f64,
    pub(super) memory_mb: Option<u64>,
    /// Whether its folder is kept.
    pub(super) keeps: bool,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Status {
    /// There is a report.
    Done,
    /// It says why there is none.
    Failed,
    /// A signal ended it: a fault of the program, or too little memory.
    Crashed,
    /// It took too long.
    TimedOut,
}

impl Status {
    pub(super) const ALL: [Self; 4] = [Self::Done, Self::Failed, Self::Crashed, Self::TimedOut];

    /// Its name in the table.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Crashed => "crashed",
            Self::TimedOut => "timed out",
        }
    }
}

/// What became of a run.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) status: Status,
    pub(super) error: Option<String>,
    /// Wall time, seconds.
    pub(super) wall_s: f64,
    /// The run's folder, where it is kept.
    pub(super) folder: Option<PathBuf>,
    /// What `report.json` says.
    pub(super) report: Option<String>,
}

/// Processes are looked after this often.
const PERIOD: Duration = Duration::from_millis(10);
/// Of what a process says on stderr no more is kept, bytes.
const LONGEST_MESSAGE: u64 = 4096;

impl Job {
    /// By what two runs are the same, beside the version of the program.
    pub(super) fn key(&self) -> (&str, &str, u64) {
        (&self.input_sha256, &self.config_sha256, self.seed)
    }

    /// Runs it; `None` when the user stopped it.
    ///
    /// # Errors
    /// No process can be started, or what it left cannot be read.
    pub(super) fn run(&self, limits: &Limits, out: &Path, interrupt: &Interrupt) -> anyhow::Result<Option<Row>> {
        // What a process that was killed leaves lies beside its folder: both lie in a folder of the run's own.
        let place = out.join(format!(".running-{}", self.name));
        let folder = place.join("run");
        let _ = fs::remove_dir_all(&place);
        fs::create_dir_all(&place).with_context(|| format!("cannot make the folder {}", place.display()))?;
        let started = Instant::now();
        let mut child = self.spawn(&folder, limits)?;
        let stderr = child.stderr.take();
        let listener = thread::spawn(move || {
            let mut text = Vec::new();
            if let Some(mut stderr) = stderr {
                // What cannot be read is told by the process's end.
                let _ = stderr.by_ref().take(LONGEST_MESSAGE).read_to_end(&mut text);
                let _ = std::io::copy(&mut stderr, &mut std::io::sink());
            }
            String::from_utf8_lossy(&text).trim().to_owned()
        });
        let ended = wait(&mut child, started, limits.time_s, interrupt)?;
        let wall_s = started.elapsed().as_secs_f64();
        let said = listener.join().unwrap_or_default();
        let mut row = match ended {
            Ended::Stopped => {
                let _ = fs::remove_dir_all(&place);
                return Ok(None);
            }
            Ended::TimedOut => Row::without_report(Status::TimedOut, format!("took longer than {} s", limits.time_s)),
            Ended::ByItself(status) => match fs::read_to_string(folder.join("report.json")) {
                Ok(report) if status.success() => {
                    Row { status: Status::Done, error: None, wall_s, folder: None, report: Some(report) }
                }
                _ => {
                    let how = if status.code().is_some() { Status::Failed } else { Status::Crashed };
                    let said = said.strip_prefix("error: ").unwrap_or(&said);
                    let why = match (how, said.is_empty()) {
                        (Status::Failed, false) => said.to_owned(),
                        (_, true) => status.to_string(),
                        _ => format!("{status}: {said}"),
                    };
                    Row::without_report(how, why)
                }
            },
        };
        row.wall_s = wall_s;
        if limits.keeps && row.status == Status::Done {
            let kept = out.join("runs").join(&self.name);
            let _ = fs::remove_dir_all(&kept);
            fs::create_dir_all(out.join("runs"))
                .and_then(|()| fs::rename(&folder, &kept))
                .with_context(|| format!("cannot keep {}", kept.display()))?;
            row.folder = Some(kept);
        }
        let _ = fs::remove_dir_all(&place);
        Ok(Some(row))
    }

    fn spawn(&self, folder: &Path, limits: &Limits) -> anyhow::Result<Child> {
        let mut command = Program::command()?;
        command.args(["run", "--quiet", "--max-dropped", "1", "--preset", self.preset.name()]);
        command.args(["--seed", &self.seed.to_string(), "--threads", &limits.threads.to_string()]);
        command.arg("--out").arg(folder);
        if let Some(config) = &self.config {
            command.arg("--config").arg(config);
        }
        for setting in &self.set {
            command.arg(format!("--set={setting}"));
        }
        if let Some(megabytes) = limits.memory_mb {
            command.args(["--memory-limit", &megabytes.to_string()]);
        }
        if self.no_texture {
            command.arg("--no-texture");
        }
        self.topics.pass_on(&mut command);
        // Its name may begin as an option does.
        command.arg("--").arg(&self.log);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        // Ctrl-C is for the batch, which ends its runs itself.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command.spawn().context("cannot start a run")
    }
}

impl Row {
    fn without_report(status: Status, error: String) -> Self {
        Self { status, error: Some(error), wall_s: 0.0, folder: None, report: None }
    }
}

/// How a process ended.
enum Ended {
    ByItself(ExitStatus),
    TimedOut,
    Stopped,
}

/// Waits for a process; ends it when it takes too long, or the user stops it.
fn wait(child: &mut Child, started: Instant, limit_s: f64, interrupt: &Interrupt) -> anyhow::Result<Ended> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Ended::ByItself(status));
        }
        let takes_too_long = started.elapsed().as_secs_f64() > limit_s;
        if takes_too_long || interrupt.requested() {
            child.kill()?;
            child.wait()?;
            return Ok(if takes_too_long { Ended::TimedOut } else { Ended::Stopped });
        }
        thread::sleep(PERIOD);
    }
}
