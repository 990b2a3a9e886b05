//! `report.json` of a localization: where the robot was found and lost, how sure that was, how right and how quick.

use super::Arguments;
use super::update::Listed;
use crate::report::Made;
use crate::stopwatch::{ScanCost, ScanTimes, peak_memory_bytes};
use crate::summary::counted;
use crate::terminal::{HEADING, prose};
use floorprint::Config;
use floorprint::evaluation::{ErrorStatistics, PoseError, StampIndex};
use floorprint::geometry::Pose2;
use floorprint::localization::{LocalizationReport, Start};
use floorprint::sensors::StampedPose;
use floorprint_io::{Contents, DataSet};
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;

/// Modes that are listed of a moment.
const MODES_LISTED: usize = 12;
/// Moments of `over_time` at most.
const MOMENTS: usize = 2000;
/// Poses farther from the truth than these are wrong, metres and degrees.
const WRONG_M: f64 = 0.5;
const WRONG_DEG: f64 = 10.0;
/// A pose is compared with the truth between true poses that are no farther apart than this, seconds.
const TRUTH_GAP_S: f64 = 2.0;

/// What a report is made of.
pub(super) struct Inputs<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) data_set: &'a DataSet,
    pub(super) config: &'a Config,
    pub(super) free_m2: f64,
    pub(super) steps: &'a [LocalizationReport],
    pub(super) dead_reckoning: &'a [Pose2],
    pub(super) truth: Option<&'a [StampedPose]>,
    pub(super) prepared_s: f64,
    /// Of scans with a claimed pose, and of the others.
    pub(super) times: &'a [ScanTimes; 2],
    pub(super) refused: usize,
    pub(super) partial: bool,
    /// What changed of the map, where that was asked for.
    pub(super) changes: Option<Vec<Listed>>,
}

/// Everything about a localization. All but `cost` and `made` is the same for any number of threads.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// What the file is: by it a later run knows that it may replace the folder.
    what: &'static str,
    /// Version of the program.
    version: &'static str,
    /// When and how it was made.
    pub(super) made: Made,
    /// Path of the map as given.
    pub(super) map: String,
    /// Free floor of the map, square metres.
    pub(super) map_free_m2: f64,
    /// Path of the data set as given.
    pub(super) input: String,
    /// Hash of the data set's content.
    input_sha256: String,
    /// Seed of all random draws.
    seed: u64,
    /// Whether the user stopped it before its end.
    pub(super) partial: bool,
    /// Whether the start was given.
    start_is_known: bool,
    /// Scans that were localised in.
    pub(super) scans: usize,
    /// Scans that could not be used.
    refused: usize,
    /// Length of the drive by the odometry, metres, and its time, seconds.
    pub(super) length_m: f64,
    pub(super) duration_s: f64,
    /// When the pose was first claimed: metres and seconds from the start; absent where it never was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) found: Option<Found>,
    /// Share of the scans with a claimed pose.
    pub(super) localised_share: f64,
    /// Where the pose was found and lost.
    pub(super) events: Vec<Event>,
    /// What is known at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) ended: Option<End>,
    /// Errors of the claimed poses against the truth, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) errors: Option<Errors>,
    /// What changed since the map was made; absent where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    changes: Option<Vec<Listed>>,
    /// Modes and health over time, thinned.
    over_time: Vec<Moment>,
    /// What the user should know.
    pub(super) notes: Vec<String>,
    /// Time and memory.
    pub(super) cost: Cost,
    /// The claimed poses.
    #[serde(skip)]
    pub(crate) trajectory: Vec<StampedPose>,
    /// The same in pieces without interruption, and the truth.
    #[serde(skip)]
    pub(super) pieces: Vec<Vec<StampedPose>>,
    #[serde(skip)]
    pub(super) true_pieces: Vec<Vec<StampedPose>>,
}

/// When a pose was first claimed.
#[derive(Debug, Serialize)]
pub(super) struct Found {
    /// Driven by then, metres.
    pub(super) after_m: f64,
    /// Passed by then, seconds.
    pub(super) after_s: f64,
}

/// The pose was found or lost.
#[derive(Debug, Serialize)]
pub(super) struct Event {
    /// Stamp, seconds, and seconds since the start.
    stamp_s: f64,
    pub(super) at_s: f64,
    /// Driven by then, metres.
    pub(super) at_m: f64,
    /// `found` or `lost`.
    pub(super) what: &'static str,
}

/// What is known at the end.
#[derive(Debug, Serialize)]
pub(super) struct End {
    /// Whether a pose is claimed.
    pub(super) is_localised: bool,
    /// How probable it is that the robot is where nothing was proposed.
    pub(super) elsewhere_probability: f64,
    /// How many places are considered.
    pub(super) count: usize,
    /// Those with the largest weights.
    pub(super) modes: Vec<Place>,
}

/// A place that is considered.
#[derive(Debug, Serialize)]
pub(super) struct Place {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) yaw_rad: f64,
    pub(super) weight: f64,
}

/// Errors of the claimed poses.
#[derive(Debug, Serialize)]
pub(super) struct Errors {
    /// Poses with a true pose at their time.
    matched: usize,
    /// Distance from the true position, metres.
    pub(super) translation_m: ErrorStatistics,
    /// Difference from the true heading, degrees.
    pub(super) rotation_deg: ErrorStatistics,
    /// Claimed poses that are more than half a metre or ten degrees off.
    pub(super) wrong: usize,
}

/// One moment.
#[derive(Debug, Serialize)]
struct Moment {
    stamp_s: f64,
    is_localised: bool,
    lost_probability: f64,
    /// Shares of the rays that end on the map, before it, went through it, and where it knows nothing.
    on_map: f64,
    in_front: f64,
    through: f64,
    in_unknown: f64,
    /// Standard deviations: metres and degrees.
    sigma_m: f64,
    sigma_deg: f64,
    particles: usize,
    modes: Vec<Place>,
}

/// What it cost. Differs from run to run.
#[derive(Debug, Serialize)]
pub(super) struct Cost {
    /// Threads that shared the work.
    threads: usize,
    /// Making the map ready, seconds.
    prepared_s: f64,
    /// Wall time of a scan while the pose is claimed, and while it is not, milliseconds.
    pub(super) tracking_ms: Option<ScanCost>,
    pub(super) searching_ms: Option<ScanCost>,
    peak_memory_bytes: Option<u64>,
}

fn places(step: &LocalizationReport) -> Vec<Place> {
    let place = |mode: &floorprint::localization::Mode| Place {
        x_m: mode.pose.x,
        y_m: mode.pose.y,
        yaw_rad: mode.pose.theta,
        weight: mode.weight,
    };
    step.modes.iter().take(MODES_LISTED).map(place).collect()
}

impl Report {
    pub(super) fn new(inputs: Inputs<'_>) -> Self {
        let Inputs { arguments, data_set, config, steps, .. } = inputs;
        let start_s = steps.first().map_or(0.0, |first| first.stamp_s);
        let mut path_m = Vec::with_capacity(steps.len());
        let mut driven_m = 0.0;
        for (number, pose) in inputs.dead_reckoning.iter().enumerate() {
            driven_m +=
                number.checked_sub(1).map_or(0.0, |before| inputs.dead_reckoning[before].between(pose).distance());
            path_m.push(driven_m);
        }
        let stamped = |step: &LocalizationReport| step.pose.map(|pose| StampedPose { stamp_s: step.stamp_s, pose });
        let trajectory: Vec<StampedPose> = steps.iter().filter_map(stamped).collect();
        let mut events = Vec::new();
        let mut pieces: Vec<Vec<StampedPose>> = Vec::new();
        let mut was_localised = arguments.start != Start::Unknown;
        for (step, &at_m) in steps.iter().zip(&path_m) {
            let is_localised = step.pose.is_some();
            if is_localised != was_localised {
                let what = if is_localised { "found" } else { "lost" };
                events.push(Event { stamp_s: step.stamp_s, at_s: step.stamp_s - start_s, at_m, what });
            }
            if let Some(pose) = stamped(step) {
                if !was_localised || pieces.is_empty() {
                    pieces.push(Vec::new());
                }
                pieces.last_mut().into_iter().for_each(|piece| piece.push(pose));
            }
            was_localised = is_localised;
        }
        let found = steps.iter().zip(&path_m).find(|(step, _)| step.pose.is_some());
        let found = found.map(|(step, &after_m)| Found { after_m, after_s: step.stamp_s - start_s });
        let ended = steps.last().map(|last| End {
            is_localised: last.pose.is_some(),
            elsewhere_probability: last.elsewhere_probability,
            count: last.modes.len(),
            modes: places(last),
        });
        let moment = |step: &LocalizationReport| Moment {
            stamp_s: step.stamp_s,
            is_localised: step.pose.is_some(),
            lost_probability: step.lost_probability,
            on_map: step.explained.on_map,
            in_front: step.explained.in_front,
            through: step.explained.through,
            in_unknown: step.explained.in_unknown,
            sigma_m: (step.covariance[(0, 0)] + step.covariance[(1, 1)]).max(0.0).sqrt(),
            sigma_deg: step.covariance[(2, 2)].max(0.0).sqrt().to_degrees(),
            particles: step.particles,
            modes: places(step),
        };
        let every = steps.len().div_ceil(MOMENTS).max(1);
        let mut notes = data_set.notes.clone();
        let errors = inputs.truth.and_then(|truth| {
            let errors = Errors::new(&trajectory, truth);
            if errors.is_none() && !trajectory.is_empty() {
                notes.push("not compared with the truth: no true pose at the time of any claimed pose".to_owned());
            }
            errors
        });
        Self {
            what: Contents::Localization.what(),
            version: env!("CARGO_PKG_VERSION"),
            made: Made::now(),
            map: arguments.map.display().to_string(),
            map_free_m2: inputs.free_m2,
            input: arguments.path.display().to_string(),
            input_sha256: data_set.input_hash.clone(),
            seed: config.seed,
            partial: inputs.partial,
            start_is_known: arguments.start != Start::Unknown,
            scans: steps.len(),
            refused: inputs.refused,
            length_m: driven_m,
            duration_s: steps.last().map_or(0.0, |last| last.stamp_s - start_s),
            found,
            localised_share: trajectory.len() as f64 / steps.len().max(1) as f64,
            events,
            ended,
            errors,
            changes: inputs.changes,
            over_time: steps.iter().step_by(every).map(moment).collect(),
            notes,
            cost: Cost {
                threads: rayon::current_num_threads(),
                prepared_s: inputs.prepared_s,
                tracking_ms: inputs.times[0].summary(),
                searching_ms: inputs.times[1].summary(),
                peak_memory_bytes: peak_memory_bytes(),
            },
            trajectory,
            pieces,
            true_pieces: inputs.truth.map(<[StampedPose]>::to_vec).into_iter().collect(),
        }
    }

    /// Prints the summary of a localization whose results lie in `folder`.
    pub(super) fn print(&self, out: &mut impl Write, folder: &Path) -> io::Result<()> {
        const NAME: usize = 12;
        let mut line =
            |name: &str, text: String| writeln!(out, "{HEADING}{name:<NAME$}{HEADING:#}{}", prose(&text, NAME));
        line("drive", format!("{:.1} m in {:.1} s, {}", self.length_m, self.duration_s, counted(self.scans, "scan")))?;
        line("map", format!("{:.0} m² free", self.map_free_m2))?;
        match &self.found {
            Some(_) if self.start_is_known => line("start", "given".to_owned())?,
            Some(found) => line("found", format!("after {:.1} m, {:.1} s", found.after_m, found.after_s))?,
            None => line("found", "no: no place stands alone, and none is claimed".to_owned())?,
        }
        line("localised", format!("{:.1} % of the scans", 100.0 * self.localised_share))?;
        for event in self.events.iter().skip(usize::from(!self.start_is_known)) {
            line(event.what, format!("after {:.1} m, at {:.1} s", event.at_m, event.at_s))?;
        }
        if let Some(errors) = &self.errors {
            let (translation, rotation) = (&errors.translation_m, &errors.rotation_deg);
            line(
                "errors",
                format!(
                    "RMSE {:.3} m, {:.2}°  (median {:.3} m, largest {:.3} m, {:.2}°), {} of {} wrong by more than {WRONG_M} m or {WRONG_DEG}°",
                    translation.rmse,
                    rotation.rmse,
                    translation.median,
                    translation.max,
                    rotation.max,
                    errors.wrong,
                    counted(errors.matched, "claimed pose"),
                ),
            )?;
        }
        if let Some(end) = self.ended.as_ref().filter(|end| !end.is_localised) {
            line("undecided", format!("{} at the end, none of them claimed:", counted(end.count, "place")))?;
            for place in &end.modes {
                line(
                    "",
                    format!(
                        "{:5.1} %  x {:.2} m, y {:.2} m, yaw {:.1}°",
                        100.0 * place.weight,
                        place.x_m,
                        place.y_m,
                        place.yaw_rad.to_degrees()
                    ),
                )?;
            }
            line("", format!("{:5.1} %  somewhere else", 100.0 * end.elsewhere_probability))?;
        }
        let cost = |cost: &Option<ScanCost>| {
            cost.as_ref().map(|cost| {
                format!("{:.2} ms a scan (99 %: {:.2} ms, largest {:.1} ms)", cost.mean, cost.p99, cost.max)
            })
        };
        if let Some(text) = cost(&self.cost.tracking_ms) {
            line("tracking", text)?;
        }
        if let Some(text) = cost(&self.cost.searching_ms) {
            line("searching", text)?;
        }
        line("results", folder.join("report.html").display().to_string())?;
        out.flush()
    }
}

impl Errors {
    fn new(trajectory: &[StampedPose], truth: &[StampedPose]) -> Option<Self> {
        let truth = StampIndex::new(truth);
        let error = |stamped: &StampedPose| {
            Some(PoseError::between(&truth.interpolated(stamped.stamp_s, 1e-4, TRUTH_GAP_S)?, &stamped.pose))
        };
        let errors: Vec<PoseError> = trajectory.iter().filter_map(error).collect();
        let (translations, rotations): (Vec<f64>, Vec<f64>) =
            errors.iter().map(|error| (error.translation_m, error.rotation_deg)).unzip();
        Some(Self {
            matched: errors.len(),
            translation_m: ErrorStatistics::of(&translations)?,
            rotation_deg: ErrorStatistics::of(&rotations)?,
            wrong: errors.iter().filter(|e| e.translation_m > WRONG_M || e.rotation_deg > WRONG_DEG).count(),
        })
    }
}
