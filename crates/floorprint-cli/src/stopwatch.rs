//! Where time and memory go.

use floorprint::{Phase, Profiler};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Time by phase: of one thread, or of several that work side by side.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    started: Instant,
    cpu_before_s: Option<f64>,
    lane: Lane,
}

impl Stopwatch {
    /// Starts to measure, with `phase`.
    pub(crate) fn start(phase: Phase) -> Self {
        let mut lane = Lane::default();
        lane.enter(phase);
        Self { started: Instant::now(), cpu_before_s: cpu_time_s(), lane }
    }

    /// Time since the start.
    pub(crate) fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// CPU time of all threads since the start, seconds; `None` where the system does not tell.
    pub(crate) fn cpu_s(&self) -> Option<f64> {
        cpu_time_s().zip(self.cpu_before_s).map(|(now_s, before_s)| now_s - before_s)
    }

    /// Waits for others, whose time [`add`](Self::add) counts.
    pub(crate) fn pause(&mut self) {
        self.lane.leave();
    }

    /// Counts what another thread was busy with.
    pub(crate) fn add(&mut self, lane: &Lane) {
        for (&phase, &busy) in &lane.phases {
            *self.lane.phases.entry(phase).or_default() += busy;
        }
    }

    /// Seconds by phase so far, in the order of the work.
    pub(crate) fn seconds(&mut self) -> Vec<PhaseTime> {
        if let Some((phase, _)) = self.lane.current {
            self.enter(phase);
        }
        let time =
            |(&phase, duration): (&Phase, &Duration)| PhaseTime { phase: name(phase), seconds: duration.as_secs_f64() };
        self.lane.phases.iter().map(time).collect()
    }
}

impl Profiler for Stopwatch {
    fn enter(&mut self, phase: Phase) {
        self.lane.enter(phase);
    }
}

/// What one thread is busy with.
#[derive(Debug, Default)]
pub(crate) struct Lane {
    /// The phase that it is in, and since when; `None` while it waits.
    current: Option<(Phase, Instant)>,
    phases: BTreeMap<Phase, Duration>,
    this_frame: Duration,
    /// How long each frame took, in order.
    frames: Vec<Duration>,
}

impl Lane {
    fn leave(&mut self) {
        let Some((phase, since)) = self.current.take() else { return };
        let busy = since.elapsed();
        *self.phases.entry(phase).or_default() += busy;
        self.this_frame += busy;
    }
}

impl Profiler for Lane {
    fn enter(&mut self, phase: Phase) {
        self.leave();
        self.current = Some((phase, Instant::now()));
    }

    fn end_of_frame(&mut self) {
        self.leave();
        self.frames.push(std::mem::take(&mut self.this_frame));
    }
}

/// How long each scan kept the live part busy, milliseconds.
#[derive(Debug, Default)]
pub(crate) struct ScanTimes(Vec<f32>);

impl ScanTimes {
    /// One more scan.
    pub(crate) fn add(&mut self, seconds: f64) {
        self.0.push((seconds * 1e3) as f32);
    }

    /// Scans on which several threads worked one after the other: what they did together.
    pub(crate) fn add_all(&mut self, lanes: &[Lane; 3]) {
        let [first, second, third] = lanes;
        for ((first, second), third) in first.frames.iter().zip(&second.frames).zip(&third.frames) {
            self.add((*first + *second + *third).as_secs_f64());
        }
    }

    /// Mean, 99th percentile and largest; `None` before the first scan.
    pub(crate) fn summary(&self) -> Option<ScanCost> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f32::total_cmp);
        let max = f64::from(*sorted.last()?);
        let mean = sorted.iter().copied().map(f64::from).sum::<f64>() / sorted.len() as f64;
        let rank = (0.99 * sorted.len() as f64).ceil() as usize;
        Some(ScanCost { mean, p99: f64::from(sorted[rank.max(1) - 1]), max })
    }
}

/// Time of a scan, milliseconds: making its frame and taking it in, live, without what comes at the end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct ScanCost {
    /// Mean over all scans.
    pub(crate) mean: f64,
    /// 99 of 100 scans take no longer.
    pub(crate) p99: f64,
    /// The longest.
    pub(crate) max: f64,
}

/// What a phase took.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PhaseTime {
    /// Name of the phase.
    pub(crate) phase: &'static str,
    /// Time, seconds; where threads work side by side the sum of theirs.
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

/// CPU time of all threads of this process so far, to the microsecond and quickly asked for, seconds;
/// wall time where the system does not tell.
pub(crate) fn fine_cpu_time_s() -> f64 {
    usage::fine_cpu_time_s().unwrap_or_else(|| {
        static STARTED: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        STARTED.get_or_init(Instant::now).elapsed().as_secs_f64()
    })
}

/// The most memory that this process ever held, bytes; `None` where the system does not tell.
///
/// From `/proc`, not from `getrusage`: that figure survives `exec`, so that a child of a large
/// process would be charged with its parent's memory.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    memory_bytes("VmHWM:")
}

/// Memory that is held beyond what is held now.
#[derive(Debug)]
pub(crate) struct MemoryMark(Option<u64>);

impl MemoryMark {
    /// From now on.
    pub(crate) fn set() -> Self {
        // The system forgets the peak so far.
        let forgotten = std::fs::write("/proc/self/clear_refs", "5").is_ok();
        Self(if forgotten { memory_bytes("VmRSS:") } else { None })
    }

    /// The most that was held beyond it since, bytes; `None` where the system does not tell.
    pub(crate) fn peak_beyond_bytes(&self) -> Option<u64> {
        Some(peak_memory_bytes()?.saturating_sub(self.0?))
    }
}

fn memory_bytes(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
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

    pub(super) fn fine_cpu_time_s() -> Option<f64> {
        let time = nix::time::clock_gettime(nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID).ok()?;
        Some(time.tv_sec() as f64 + time.tv_nsec() as f64 * 1e-9)
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

    pub(super) fn fine_cpu_time_s() -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_scans_are_summed_up() {
        let mut times = ScanTimes::default();
        assert_eq!(times.summary(), None);
        (1..=200).rev().for_each(|ms| times.add(f64::from(ms) * 1e-3));
        let cost = times.summary().unwrap();
        assert!((cost.mean - 100.5).abs() < 1e-3 && (cost.p99 - 198.0).abs() < 1e-3 && (cost.max - 200.0).abs() < 1e-3);
    }
}
