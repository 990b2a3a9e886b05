//! Drives a log to and fro, again and again, and says what a scan costs the filter and how much memory it holds:
//! `cargo run --release -p floorprint-cli --example soak -- LOG [DRIVES]`.
//!
//! The way back is the log's scans in reverse order with inverted motions. Loops are closed on the way, as on a live robot;
//! from drive to drive only the trajectory and the pose graph grow.

use anyhow::Context;
use floorprint::{Config, Frame, Frames, Slam};
use floorprint_io::OpenOptions;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::io::Write;
use std::path::Path;

fn cpu_s() -> anyhow::Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_SELF)?;
    Ok((usage.user_time() + usage.system_time()).num_microseconds() as f64 * 1e-6)
}

/// Memory held now, megabytes.
fn memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kilobytes| kilobytes / 1024.0)
}

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let log = arguments.next().context("which log?")?;
    let drives: usize = arguments.next().map_or(Ok(20), |drives| drives.parse()).context("how many drives?")?;
    let data_set = floorprint_io::open(Path::new(&log), &OpenOptions::default())?;
    let config = Config::resolve(&[floorprint::config::Layer::from_robot(&data_set.robot)])?;
    let forward: Vec<Frame> = Frames::new(&data_set.records, &config)?.iter().collect();
    let mut slam = Slam::new(&config);
    let mut out = std::io::stdout().lock();
    writeln!(out, "drive  µs/scan  memory MB  submaps  nodes  factors")?;
    for drive in 0..drives {
        let before_s = cpu_s()?;
        for k in 0..forward.len() {
            let mut frame = if drive % 2 == 0 { forward[k].clone() } else { forward[forward.len() - 1 - k].clone() };
            if drive % 2 == 1 {
                // The motion from the scan before, which lies ahead on the way back.
                frame.motion = forward.get(forward.len() - k).and_then(|next| next.motion).map(|step| step.inverse());
            }
            if k == 0 && drive > 0 {
                // A turning point is seen twice from the same place.
                frame.motion = Some(floorprint::geometry::Pose2::IDENTITY);
            }
            slam.process(&frame)?;
        }
        let scan_us = (cpu_s()? - before_s) / forward.len() as f64 * 1e6;
        let (held_mb, load) = (memory_mb().unwrap_or(f64::NAN), slam.closure_load().context("loops are not closed")?);
        let (submaps, nodes, factors) = (load.submaps, load.nodes, load.factors);
        writeln!(out, "{drive:5}  {scan_us:7.1}  {held_mb:9.1}  {submaps:7}  {nodes:5}  {factors:7}")?;
    }
    Ok(())
}
