//! `report.json`: what a run was, what it found, how good that is, what it cost.

mod certainty;
pub(crate) mod chart;
mod contradiction;
mod kidnapped;
mod loops;
pub(crate) mod page;

pub(crate) use page::{Exhibits, page};

use self::certainty::Certainty;
use self::contradiction::Contradiction;
use self::kidnapped::Kidnapped;
pub(crate) use self::loops::Loops;
use crate::program::Program;
use crate::solve::Solution;
use crate::stopwatch::{PhaseTime, ScanCost, Stopwatch, peak_memory_bytes};
use crate::truth::Errors;
use floorprint::Config;
use floorprint::evaluation::WallSharpness;
use floorprint::map::{Occupancy, Raster};
use floorprint::odometry::OdometrySource;
use floorprint_io::{Contents, DataSet, DropReason};
use serde::Serialize;
use std::path::Path;

/// Everything about a run. All but `cost` and `made` is the same for any number of threads.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// What the file is: by it a later run knows that it may replace the folder.
    pub(crate) what: &'static str,
    /// Version of the program.
    pub(crate) version: &'static str,
    /// When and how it was made.
    pub(crate) made: Made,
    /// What was read.
    pub(crate) input: Input,
    /// Preset that the configuration started from.
    pub(crate) preset: &'static str,
    /// Seed of all random draws.
    pub(crate) seed: u64,
    /// Whether the user stopped the run before its end.
    pub(crate) partial: bool,
    /// The drive.
    pub(crate) drive: Drive,
    /// The filter; absent without a LiDAR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) filter: Option<FilterSummary>,
    /// Loop closures; absent when none were looked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) loops: Option<Loops>,
    /// How certain the poses are; absent where loops are not closed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) uncertain: Option<Certainty>,
    /// Where the robot was carried elsewhere; absent when it was not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) kidnappings: Vec<Kidnapped>,
    /// The map; absent without a LiDAR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) map: Option<MapSummary>,
    /// The floor; absent when it was not painted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) texture: Option<TextureSummary>,
    /// Errors against the truth, as far as it is known.
    pub(crate) errors: Errors,
    /// Data that were not used.
    pub(crate) dropped: Vec<Dropped>,
    /// Share of all readings that were dropped.
    pub(crate) dropped_share: f64,
    /// What the user should know.
    pub(crate) notes: Vec<String>,
    /// Time and memory.
    pub(crate) cost: Cost,
}

/// When and how a report was made.
#[derive(Debug, Serialize)]
pub(crate) struct Made {
    /// Date, UTC, as 2026-01-31.
    pub(crate) date: String,
    /// The command, as a shell takes it.
    pub(crate) command: String,
}

impl Made {
    /// Now, by this process.
    pub(crate) fn now() -> Self {
        let is_plain = |word: &str| {
            !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c))
        };
        let quoted = |word: String| {
            if is_plain(&word) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
        };
        let words = Program::arguments().iter().map(|word| quoted(word.to_string_lossy().into_owned()));
        let command = std::iter::once("floorprint".to_owned()).chain(words).collect::<Vec<_>>().join(" ");
        Self { date: crate::bench::today(), command }
    }
}

/// What was read.
#[derive(Debug, Serialize)]
pub(crate) struct Input {
    /// Path as given.
    pub(crate) path: String,
    /// Format as recognised.
    pub(crate) format: &'static str,
    /// Name of the calibration.
    pub(crate) robot: String,
    /// Hash of the content.
    pub(crate) sha256: String,
}

/// The drive as it was estimated.
#[derive(Debug, Serialize)]
pub(crate) struct Drive {
    /// Scans in the data set.
    pub(crate) scans: usize,
    /// Poses in the trajectory.
    pub(crate) poses: usize,
    /// Stamp of the first pose, seconds.
    pub(crate) start_s: f64,
    /// From the first pose to the last, seconds.
    pub(crate) duration_s: f64,
    /// Length of the path, metres.
    pub(crate) length_m: f64,
    /// Where the motion between scans came from.
    pub(crate) odometry: OdometrySource,
}

/// What the filter went through.
#[derive(Debug, Serialize)]
pub(crate) struct FilterSummary {
    /// Number of particles at the start.
    pub(crate) particles: usize,
    /// How often they were drawn anew.
    pub(crate) resamplings: usize,
    /// Scans that contradicted the odometry; there the scan decided.
    pub(crate) odometry_rejections: usize,
    /// The stretches on which they did.
    pub(crate) contradictions: Vec<Contradiction>,
    /// The true length of what the odometry states as one, where the filter learnt it; the trajectory uses it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) odometry_scale: Option<f64>,
    /// Mean effective number of particles.
    pub(crate) mean_effective_particles: f64,
    /// Mean match score.
    pub(crate) mean_score: f64,
    /// Mean share of points that lie on the map.
    pub(crate) mean_inlier_share: f64,
}

/// The map in figures.
#[derive(Debug, Serialize)]
pub(crate) struct MapSummary {
    /// Side of a cell, metres.
    pub(crate) resolution_m: f64,
    /// Columns and rows.
    pub(crate) size_cells: [usize; 2],
    /// Free floor, square metres.
    pub(crate) free_m2: f64,
    /// Occupied cells.
    pub(crate) occupied_cells: usize,
    /// Thickness of walls, double walls; absent when there is no wall.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) walls: Option<WallSharpness>,
}

/// The floor in figures.
#[derive(Debug, Serialize)]
pub(crate) struct TextureSummary {
    /// Side of a cell, metres.
    pub(crate) resolution_m: f64,
    /// Floor that was painted, square metres.
    pub(crate) painted_m2: f64,
    /// Pairs of images that show floor.
    pub(crate) images: usize,
    /// Pairs left out because the robot had hardly moved since the one before.
    pub(crate) images_of_nothing_new: usize,
}

/// Data of one kind that were not used.
#[derive(Debug, Serialize)]
pub(crate) struct Dropped {
    /// Why.
    pub(crate) reason: String,
    /// How many.
    pub(crate) count: usize,
}

/// What a run cost. Differs from run to run.
#[derive(Debug, Serialize)]
pub(crate) struct Cost {
    /// Threads that shared the work.
    pub(crate) threads: usize,
    /// Wall time, seconds.
    pub(crate) wall_s: f64,
    /// CPU time of all threads, seconds.
    pub(crate) cpu_s: Option<f64>,
    /// Most memory ever held, bytes.
    pub(crate) peak_memory_bytes: Option<u64>,
    /// Seconds of drive per second of wall time.
    pub(crate) real_time_factor: f64,
    /// Wall time of a scan, live, milliseconds: mean, 99th percentile, largest.
    pub(crate) scan_ms: Option<ScanCost>,
    /// Wall time from the last scan to the final map, seconds.
    pub(crate) finish_s: f64,
    /// Wall time by phase.
    pub(crate) phases: Vec<PhaseTime>,
}

impl Report {
    /// Sums up a run.
    pub(crate) fn new(
        path: &Path,
        data_set: &DataSet,
        preset: &'static str,
        config: &Config,
        solution: &Solution,
        map: &Raster<Occupancy>,
    ) -> Self {
        let mut notes = data_set.notes.clone();
        notes.extend(solution.summary.findings.iter().map(ToString::to_string));
        let dropped = dropped(data_set, solution);
        // What came twice was used once.
        let lost = dropped.iter().map(|dropped| dropped.count).sum::<usize>() - solution.summary.dropped.repeated();
        let images = data_set.images.as_ref().map_or(0, |images| images.depth.len() + images.color.len());
        let has_lidar = !solution.is_dead_reckoning();
        let unread: usize = dropped_by_reader(data_set).map(|(_, count)| count).sum();
        let readings = data_set.records.len() + images + unread;
        Self {
            made: Made::now(),
            what: Contents::Run.what(),
            version: env!("CARGO_PKG_VERSION"),
            input: Input {
                path: path.display().to_string(),
                format: data_set.format.name,
                robot: config.robot.name.clone(),
                sha256: data_set.input_hash.clone(),
            },
            preset,
            seed: config.seed,
            partial: solution.partial,
            drive: Drive::new(solution),
            filter: has_lidar.then(|| FilterSummary::new(config, solution)),
            loops: (has_lidar && config.loop_closure.enabled)
                .then(|| Loops::new(&solution.closures, &solution.trajectory)),
            uncertain: Certainty::of(&solution.uncertainties, &solution.trajectory),
            kidnappings: Kidnapped::all(&solution.kidnappings, &solution.trajectory),
            map: has_lidar.then(|| MapSummary::new(map)),
            texture: solution.floor.as_ref().map(|floor| TextureSummary {
                resolution_m: floor.map.resolution_m,
                painted_m2: floor.painted_m2(),
                images: floor.images.len(),
                images_of_nothing_new: floor.nothing_new,
            }),
            errors: Errors::default(),
            dropped,
            dropped_share: lost as f64 / readings.max(1) as f64,
            notes,
            cost: Cost {
                threads: rayon::current_num_threads(),
                wall_s: 0.0,
                cpu_s: None,
                peak_memory_bytes: None,
                real_time_factor: 0.0,
                scan_ms: solution.scan_times.summary(),
                finish_s: solution.finish_s,
                phases: Vec::new(),
            },
        }
    }

    /// Takes the time and the memory until now.
    pub(crate) fn take_cost(&mut self, stopwatch: &mut Stopwatch) {
        let wall_s = stopwatch.elapsed().as_secs_f64();
        self.cost.wall_s = wall_s;
        self.cost.cpu_s = stopwatch.cpu_s();
        self.cost.peak_memory_bytes = peak_memory_bytes();
        self.cost.real_time_factor = self.drive.duration_s / wall_s.max(f64::MIN_POSITIVE);
        self.cost.phases = stopwatch.seconds();
    }
}

impl Drive {
    fn new(solution: &Solution) -> Self {
        let poses = &solution.trajectory;
        let stamps = poses.first().zip(poses.last());
        Self {
            scans: solution.summary.scans,
            poses: poses.len(),
            start_s: stamps.map_or(0.0, |(first, _)| first.stamp_s),
            duration_s: stamps.map_or(0.0, |(first, last)| last.stamp_s - first.stamp_s),
            length_m: poses.windows(2).fold(0.0, |sum, pair| sum + pair[0].pose.between(&pair[1].pose).distance()),
            odometry: solution.summary.source,
        }
    }
}

impl FilterSummary {
    fn new(config: &Config, solution: &Solution) -> Self {
        let steps = &solution.steps;
        let count = |is: fn(&floorprint::StepReport) -> bool| steps.iter().filter(|step| is(step)).count();
        let mean =
            |of: fn(&floorprint::StepReport) -> f64| steps.iter().map(of).sum::<f64>() / steps.len().max(1) as f64;
        Self {
            particles: config.filter.first_particles(),
            resamplings: count(|step| step.filter.resampled),
            odometry_rejections: count(|step| step.filter.odometry_rejected),
            contradictions: Contradiction::all(steps),
            odometry_scale: solution.odometry_scale,
            mean_effective_particles: mean(|step| step.filter.effective_particles),
            mean_score: mean(|step| step.filter.score),
            mean_inlier_share: mean(|step| step.filter.inlier_share),
        }
    }
}

impl MapSummary {
    fn new(map: &Raster<Occupancy>) -> Self {
        let count = |what| map.cells.iter().filter(|cell| **cell == what).count();
        Self {
            resolution_m: map.resolution_m,
            size_cells: [map.width, map.height],
            free_m2: count(Occupancy::Free) as f64 * map.resolution_m * map.resolution_m,
            occupied_cells: count(Occupancy::Occupied),
            walls: WallSharpness::of(map),
        }
    }
}

/// What the reader left out. Who leaves all images out has lost none.
fn dropped_by_reader(data_set: &DataSet) -> impl Iterator<Item = (DropReason, usize)> {
    let is_lost = |(reason, _): &(DropReason, usize)| data_set.images.is_some() || *reason != DropReason::MissingImage;
    data_set.dropped.iter().filter(is_lost)
}

/// All data that were not used, by reason, from the reader to the painter.
fn dropped(data_set: &DataSet, solution: &Solution) -> Vec<Dropped> {
    let summary = &solution.summary.dropped;
    let synchroniser = summary.by_reason();
    let reader = dropped_by_reader(data_set).map(|(reason, count)| (reason.description().to_owned(), count));
    let synchroniser = synchroniser.into_iter().map(|(reason, count)| (reason.to_owned(), count));
    let filter = solution.refused.clone().into_iter();
    let painter = solution.floor.iter().flat_map(|floor| floor.skipped.clone());
    let all = reader.chain(synchroniser).chain(filter).chain(painter);
    all.filter(|(_, count)| *count > 0).map(|(reason, count)| Dropped { reason, count }).collect()
}
