//! Many simulated drives, each in a process of its own with a limit on its time: one that hangs or fails is a row of the
//! table, too.

use crate::interrupt::Interrupt;
use crate::terminal::Terminal;
use anyhow::bail;
use clap::Args;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// How the drives of --gauntlet and --localization are run.
#[derive(Args, Debug, Clone)]
#[group(skip)]
pub(super) struct Options {
    /// Seed of --gauntlet and --localization.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Print the results of --gauntlet and --localization as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
    /// Drives of --gauntlet and --localization that are run at the same time [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    jobs: Option<u16>,
    /// A drive of --gauntlet or --localization that takes more CPU time than this, or ten times as long, has failed,
    /// seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) time_limit: u32,
}

/// What many drives have in common.
pub(super) struct Surroundings<'a> {
    /// Preset of all of them.
    pub(super) preset: &'static str,
    /// Settings laid over the preset.
    pub(super) set: &'a [String],
    /// Folder of the results.
    pub(super) out: &'a Path,
    /// How they are run.
    pub(super) drives: &'a Options,
    /// Messages and results.
    pub(super) terminal: &'a Terminal,
}

impl Options {
    /// What `work` makes of each item, in their order; those that were not begun before the user stopped it are missing.
    ///
    /// # Errors
    /// A thread failed.
    pub(super) fn side_by_side<I: Sync, O: Send>(
        &self,
        items: &[I],
        interrupt: &Interrupt,
        terminal: &Terminal,
        work: impl Fn(&I) -> O + Sync,
    ) -> anyhow::Result<Vec<O>> {
        let jobs = self.jobs.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
        let progress = terminal.progress("driving", "drives", items.len());
        let next = AtomicUsize::new(0);
        let done: Mutex<Vec<(usize, O)>> = Mutex::new(Vec::with_capacity(items.len()));
        thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(item) = items.get(index).filter(|_| !interrupt.requested()) else { break };
                        let result = work(item);
                        if interrupt.requested() {
                            break;
                        }
                        if let Ok(mut done) = done.lock() {
                            done.push((index, result));
                        }
                        progress.inc(1);
                    }
                });
            }
        });
        progress.finish_and_clear();
        let Ok(mut done) = done.into_inner() else { bail!("a worker failed") };
        done.sort_by_key(|(index, _)| *index);
        Ok(done.into_iter().map(|(_, result)| result).collect())
    }

    /// What a drive's process says.
    ///
    /// # Errors
    /// It cannot be started, fails, or takes too long.
    pub(super) fn ask(&self, command: &mut Command, interrupt: &Interrupt) -> anyhow::Result<Vec<u8>> {
        command.args(["--cpu-limit", &self.time_limit.to_string()]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is for the program that runs the drives, which ends them itself.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut child = command.spawn()?;
        let read = |pipe: Option<Box<dyn Read + Send>>| {
            thread::spawn(move || {
                let mut text = Vec::new();
                // What cannot be read is told by the process's end.
                let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut text));
                text
            })
        };
        let stdout = read(child.stdout.take().map(|pipe| Box::new(pipe) as Box<_>));
        let stderr = read(child.stderr.take().map(|pipe| Box::new(pipe) as Box<_>));
        let started = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            let too_long = started.elapsed().as_secs_f64() > 10.0 * f64::from(self.time_limit);
            if too_long || interrupt.requested() {
                child.kill()?;
                child.wait()?;
                bail!("took longer than {} s", 10 * u64::from(self.time_limit));
            }
            thread::sleep(Duration::from_millis(5));
        };
        let (Ok(stdout), Ok(stderr)) = (stdout.join(), stderr.join()) else { bail!("cannot read what it said") };
        if !status.success() {
            let text = String::from_utf8_lossy(&stderr);
            bail!("{status}: {}", text.lines().find(|line| !line.trim().is_empty()).unwrap_or("nothing said"));
        }
        Ok(stdout)
    }
}

/// Has the system end this process when it has used so many seconds: the clock on the wall also runs while other
/// processes have the processor, or none has.
#[cfg(unix)]
pub(super) fn limit_cpu_time(seconds: u32) -> anyhow::Result<()> {
    use nix::sys::resource::{Resource, setrlimit};
    Ok(setrlimit(Resource::RLIMIT_CPU, seconds.into(), seconds.into())?)
}

#[cfg(not(unix))]
pub(super) fn limit_cpu_time(_seconds: u32) -> anyhow::Result<()> {
    Ok(())
}
