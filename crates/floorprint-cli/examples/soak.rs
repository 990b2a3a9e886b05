//! Drives a log to and fro, again and again, or through a large office, and says what a scan costs the filter and how much
//! memory it holds: `cargo run --release -p floorprint-cli --example soak -- LOG [DRIVES]`, or `-- office KM [MB]` for new
//! ground all the way (1081 beams, 40 Hz), with at most so much of the session in memory, which is told of each kilometre.
//!
//! The way back is the log's scans in reverse order with inverted motions. Loops are closed on the way, as on a live robot.
//! Tells after each drive who holds the session's memory, and what it takes to save it after a second more.

use anyhow::Context;
use floorprint::back_end::ClosureLoad;
use floorprint::config::Layer;
use floorprint::geometry::Pose2;
use floorprint::session::SessionMemory;
use floorprint::simulator::{SimulationConfig, World, simulate};
use floorprint::{Config, Frame, Frames, Slam};
use floorprint_io::{OpenOptions, ScratchFile, SessionFile};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// The session is read back after each so many drives.
const LOADED_EVERY: usize = 10;

fn cpu_s() -> anyhow::Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_SELF)?;
    Ok((usage.user_time() + usage.system_time()).num_microseconds() as f64 * 1e-6)
}

/// Memory held now, megabytes.
fn memory_mb() -> Option<f64> {
    status_mb("VmRSS:")
}

/// What the system says of the process, megabytes.
fn status_mb(key: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(key))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kilobytes| kilobytes / 1024.0)
}

/// The most memory that was ever held, megabytes.
fn most_memory_mb() -> Option<f64> {
    status_mb("VmHWM:")
}

/// Drives through an office of this length and says after each kilometre who holds the memory. Of the session at most
/// `most_mb` megabytes lie in memory, if that is bounded.
fn over_new_ground(length_km: f64, most_mb: Option<f64>) -> anyhow::Result<()> {
    let mut simulation = SimulationConfig::default();
    (simulation.lidar.beams, simulation.lidar.rate_hz, simulation.camera.rate_hz) = (1081, 40.0, 0.0);
    let sweep_s = &mut simulation.robot.lidar.sweep_duration_s;
    *sweep_s = sweep_s.min(1.0 / simulation.lidar.rate_hz);
    let drive = simulate(World::office(1e3 * length_km, 0), simulation, 0)?;
    let config = Config::resolve(&[Layer::from_robot(&drive.config().robot)])?;
    let frames = Frames::of(&drive, &config)?;
    let mut slam = Slam::new(&config);
    if let Some(most_mb) = most_mb {
        slam.limit_memory(Box::new(ScratchFile::create_in(&std::env::temp_dir())?), (most_mb * 1e6) as usize);
    }
    let before_mb = memory_mb().unwrap_or(f64::NAN);
    let mut out = std::io::stdout().lock();
    writeln!(out, "   km    scans  memory MB beyond the simulation's | {HOLDERS} | key scans  submaps")?;
    let (mut length_m, mut told_km) = (0.0, 0.0);
    let (mut scans, mut solving_s) = (0, 0.0);
    for frame in frames.iter() {
        length_m += frame.motion.map_or(0.0, |step| step.distance());
        let started = Instant::now();
        slam.process(&frame)?;
        solving_s += started.elapsed().as_secs_f64();
        scans += 1;
        if length_m * 1e-3 > told_km + 1.0 {
            told_km += 1.0;
            let [held, holders] = [memory_mb().unwrap_or(f64::NAN) - before_mb, slam.memory().total() as f64 * 1e-6];
            let [key_scans, submaps] = [slam.session().scans().len(), slam.session().submaps().len()];
            let of = told(&slam.memory());
            writeln!(
                out,
                "{told_km:5.0}  {scans:7}  {held:8.1}, told {holders:8.1} | {of} | {key_scans:9}  {submaps:7}"
            )?;
        }
    }
    let started = Instant::now();
    let result = slam.finish();
    let finish_s = started.elapsed().as_secs_f64();
    let [held, most] = [memory_mb(), most_memory_mb()].map(|mb| mb.unwrap_or(f64::NAN) - before_mb);
    let scans = result.trajectory.len();
    let checksum = result.trajectory.iter().fold(0_u64, |sum, stamped| {
        let Pose2 { x, y, theta } = stamped.pose;
        [x, y, theta].iter().fold(sum, |sum, number| sum.rotate_left(5) ^ number.to_bits())
    });
    writeln!(
        out,
        "{scans} scans in {solving_s:.1} s, their end in {finish_s:.1} s: {held:.1} MB held, {most:.1} MB at most; \
         trajectory {checksum:016x}"
    )?;
    Ok(())
}

/// The columns of [`told`].
const HOLDERS: &str = "MB of: poses  key scans  between  looks  submaps  comparisons  hypotheses  put away";

/// Who holds a session's memory.
fn told(of: &SessionMemory) -> String {
    let [poses, key_scans, between, looks, away] =
        [of.trajectory, of.key_scans, of.scans_between, of.looks, of.put_away].map(|bytes| bytes as f64 * 1e-6);
    let [records, comparisons, hypotheses] =
        [of.submaps, of.comparisons, of.hypotheses].map(|bytes| bytes as f64 * 1e-6);
    format!(
        "{poses:12.1}  {key_scans:9.1}  {between:7.1}  {looks:5.1}  {records:7.2}  {comparisons:11.2}  {hypotheses:10.2}  \
         {away:8.1}"
    )
}

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let log = arguments.next().context("which log?")?;
    if log == "office" {
        let length_km = arguments.next().context("how many kilometres?")?.parse()?;
        return over_new_ground(length_km, arguments.next().map(|most_mb| most_mb.parse()).transpose()?);
    }
    let drives: usize = arguments.next().map_or(Ok(20), |drives| drives.parse()).context("how many drives?")?;
    let data_set = floorprint_io::open(Path::new(&log), &OpenOptions::default())?;
    let config = Config::resolve(&[Layer::from_robot(&data_set.robot)])?;
    let forward: Vec<Frame> = Frames::new(&data_set.records, &config)?.iter().collect();
    let mut slam = Slam::new(&config);
    let path = std::env::temp_dir().join(format!("soak-{}.gpkg", std::process::id()));
    let mut file = SessionFile::create(&path)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "drive     km  µs/scan  memory MB | {HOLDERS} | submaps  nodes  factors | save ms  file MB  load s")?;
    let mut length_m = 0.0;
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
                frame.motion = Some(Pose2::IDENTITY);
            }
            length_m += frame.motion.map_or(0.0, |step| step.distance());
            slam.process(&frame)?;
        }
        let scan_us = (cpu_s()? - before_s) / forward.len() as f64 * 1e6;
        let (held_mb, load) = (memory_mb().unwrap_or(f64::NAN), slam.closure_load().context("loops are not closed")?);
        let ClosureLoad { submaps, nodes, factors } = load;
        let of = told(&slam.memory());
        // Once to bring the file up to date: what counts is the next save, a second of driving later.
        file.save(slam.session(), &config.matcher)?;
        let end = if drive % 2 == 0 { forward.len() - 1 } else { 0 };
        for _ in 0..10 {
            slam.process(&Frame { motion: Some(Pose2::IDENTITY), ..forward[end].clone() })?;
        }
        let started = Instant::now();
        file.save(slam.session(), &config.matcher)?;
        let save_ms = started.elapsed().as_secs_f64() * 1e3;
        let file_mb = std::fs::metadata(&path)?.len() as f64 * 1e-6;
        let started = Instant::now();
        let is_loaded = (drive + 1) % LOADED_EVERY == 0;
        let load_s =
            if is_loaded { SessionFile::read(&path).map(|_| started.elapsed().as_secs_f64())? } else { f64::NAN };
        writeln!(
            out,
            "{drive:5}  {:5.1}  {scan_us:7.1}  {held_mb:9.1} | {of} | {submaps:7}  {nodes:5}  {factors:7} | \
             {save_ms:7.1}  {file_mb:7.1}  {load_s:6.2}",
            length_m * 1e-3
        )?;
    }
    drop(file);
    Ok(std::fs::remove_file(&path)?)
}
