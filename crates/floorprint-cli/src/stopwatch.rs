//! Where time and memory go.

use floorprint::{Phase, Profiler};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Wall time by phase.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    started: Instant,
    cpu_before_s: Option<f64>,
    current: Phase,
    since: Instant,
    phases: BTreeMap<Phase, Duration>,
}

impl Stopwatch {
    /// Starts to measure, with `phase`.
    pub(crate) fn start(phase: Phase) -> Self {
        let now = Instant::now();
        Self { started: now, cpu_before_s: cpu_time_s(), current: phase, since: now, phases: BTreeMap::new() }
    }

    /// Time since the start.
    pub(crate) fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// CPU time of all threads since the start, seconds; `None` where the system does not tell.
    pub(crate) fn cpu_s(&self) -> Option<f64> {
        cpu_time_s().zip(self.cpu_before_s).map(|(now_s, before_s)| now_s - before_s)
    }

    /// Seconds by phase so far, in the order of the work.
    pub(crate) fn seconds(&mut self) -> Vec<PhaseTime> {
        self.enter(self.current);
        let time =
            |(&phase, duration): (&Phase, &Duration)| PhaseTime { phase: name(phase), seconds: duration.as_secs_f64() };
        self.phases.iter().map(time).collect()
    }
}

impl Profiler for Stopwatch {
    fn enter(&mut self, phase: Phase) {
        let now = Instant::now();
        *self.phases.entry(self.current).or_default() += now - self.since;
        (self.current, self.since) = (phase, now);
    }
}

/// What a phase took.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PhaseTime {
    /// Name of the phase.
    pub(crate) phase: &'static str,
    /// Wall time, seconds.
    pub(crate) seconds: f64,
}

/// The name of a phase in reports.
fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Read => "read",
        Phase::Synchronise => "synchronise",
        Phase::Predict => "predict",
        Phase::Match => "match",
        Phase::Resample => "resample",
        Phase::Map => "map",
        Phase::LoopClosure => "close loops",
        Phase::Texture => "texture",
        Phase::Evaluate => "evaluate",
        Phase::Write => "write",
    }
}

/// CPU time of this process so far, user and system, seconds; `None` where the system does not tell.
fn cpu_time_s() -> Option<f64> {
    usage::cpu_time_s(usage::Who::Process)
}

/// CPU time of all children that have ended, seconds; `None` where the system does not tell.
pub(crate) fn children_cpu_time_s() -> Option<f64> {
    usage::cpu_time_s(usage::Who::Children)
}

/// The most memory that this process ever held, bytes; `None` where the system does not tell.
///
/// From `/proc`, not from `getrusage`: that figure survives `exec`, so that a child of a large
/// process would be charged with its parent's memory.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix(" kB")?.parse::<u64>().ok()? * 1024)
}

#[cfg(unix)]
mod usage {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeVal;

    pub(super) enum Who {
        Process,
        Children,
    }

    pub(super) fn cpu_time_s(who: Who) -> Option<f64> {
        let who = match who {
            Who::Process => UsageWho::RUSAGE_SELF,
            Who::Children => UsageWho::RUSAGE_CHILDREN,
        };
        let usage = getrusage(who).ok()?;
        let seconds = |time: TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
        Some(seconds(usage.user_time()) + seconds(usage.system_time()))
    }
}

#[cfg(not(unix))]
mod usage {
    pub(super) enum Who {
        Process,
        Children,
    }

    pub(super) fn cpu_time_s(_who: Who) -> Option<f64> {
        None
    }
}
