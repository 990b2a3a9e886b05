//! `floorprint evaluate`: results against the truth.

use crate::number::number;
use crate::outcome::{BadArguments, Outcome};
use crate::terminal::{HEADING, Terminal};
use crate::truth::{seeing_camera, seen_floor};
use anyhow::{Context as _, ensure};
use clap::{Args, Subcommand, ValueEnum};
use floorprint::config::{Config, Layer};
use floorprint::evaluation::{
    Alignment, ErrorStatistics, MapQuality, MapQualityOptions, MotionSigma, RelationNoise, RelationReport, Span,
    TextureError, TextureErrorOptions, TrajectoryError, TrajectoryErrorOptions,
};
use floorprint::map::Raster;
use floorprint::sensors::StampedPose;
use floorprint_io::{read_floor, read_map, read_relations, read_text, read_trajectory};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Compare results with the truth: the truth first, then the estimate.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Absolute and relative errors of a trajectory against a true one (both TUM files).
    Trajectory(Trajectory),
    /// Occupied cells of a map against a true map (both map_server YAML files).
    Map(Map),
    /// Colours of a floor against the true floor (both JSON files that name their picture).
    Texture(Texture),
    /// A trajectory against the relations of the Freiburg SLAM benchmark.
    Relations(Relations),
}

/// What is compared.
#[derive(Args)]
struct Files {
    /// The truth (or the relations), then the estimate.
    #[arg(value_names = ["TRUTH", "ESTIMATE"], num_args = 2, required_unless_present_all = ["truth", "estimate"])]
    files: Vec<PathBuf>,
    /// The truth.
    #[arg(
        long,
        alias = "relations",
        value_name = "FILE",
        hide = true,
        conflicts_with = "files",
        requires = "estimate"
    )]
    truth: Option<PathBuf>,
    /// The estimate.
    #[arg(long, aliases = ["trajectory", "map", "texture"], value_name = "FILE", hide = true, requires = "truth")]
    estimate: Option<PathBuf>,
}

impl Files {
    /// The truth and the estimate.
    fn pair(&self) -> anyhow::Result<[&Path; 2]> {
        match (&self.files[..], &self.truth, &self.estimate) {
            ([truth, estimate], _, _) | ([], Some(truth), Some(estimate)) => Ok([truth, estimate]),
            _ => Err(BadArguments("expected two files: the truth and the estimate".to_owned()).into()),
        }
    }
}

#[derive(Args)]
#[command(override_usage = "floorprint evaluate trajectory [OPTIONS] <TRUTH> <ESTIMATE>")]
pub(crate) struct Trajectory {
    #[command(flatten)]
    files: Files,
    /// How the estimate is moved onto the truth first.
    #[arg(long, value_enum, default_value_t = Align::None)]
    align: Align,
    /// Length of a stretch for relative errors, metres. Can be repeated.
    #[arg(long, value_name = "METRES", default_values_t = [1.0, 10.0], value_parser = number(0.001, 1e9))]
    stretch: Vec<f64>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How an estimate is moved onto the truth.
#[derive(Clone, Copy, ValueEnum)]
enum Align {
    /// Not at all.
    None,
    /// By the first common pose.
    First,
    /// By the rigid motion with the least squared distances.
    Best,
}

#[derive(Args)]
#[command(override_usage = "floorprint evaluate map [OPTIONS] <TRUTH> <ESTIMATE>")]
pub(crate) struct Map {
    #[command(flatten)]
    files: Files,
    /// How far apart two occupied cells may be and still be the same wall, cells of the true map.
    #[arg(long, value_name = "CELLS", default_value_t = 1)]
    tolerance: u32,
    /// Search the best shift up to this far, cells of the true map.
    #[arg(long, value_name = "CELLS", default_value_t = 0)]
    max_shift: u32,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
#[command(override_usage = "floorprint evaluate texture [OPTIONS] <TRUTH> <ESTIMATE>")]
pub(crate) struct Texture {
    #[command(flatten)]
    files: Files,
    /// Search the best shift up to this far, cells of the estimate.
    #[arg(long, value_name = "CELLS", default_value_t = 3)]
    max_shift: u32,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
#[command(override_usage = "floorprint evaluate relations [OPTIONS] <RELATIONS> <ESTIMATE>")]
pub(crate) struct Relations {
    #[command(flatten)]
    files: Files,
    /// The odometry as a trajectory (a run's odometry.tum): how exact the relations themselves are then follows from
    /// the three. The trajectory should have been made without it (odometry.source=scan_matching), or what errors the
    /// two share is charged to the relations.
    #[arg(long, value_name = "FILE")]
    odometry: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The benchmark's figures, with those of the relations' own noise where they are asked for.
#[derive(Serialize)]
struct RelationFigures {
    #[serde(flatten)]
    report: RelationReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<RelationNoise>,
}

/// Runs `floorprint evaluate`.
pub(crate) fn execute(command: &Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let mut out = terminal.results();
    match command {
        Command::Trajectory(arguments) => arguments.execute(&mut out)?,
        Command::Map(arguments) => arguments.execute(&mut out)?,
        Command::Texture(arguments) => arguments.execute(&mut out)?,
        Command::Relations(arguments) => arguments.execute(&mut out)?,
    }
    out.flush()?;
    Ok(Outcome::Fine)
}

impl Trajectory {
    fn execute(&self, out: &mut impl Write) -> anyhow::Result<()> {
        let [truth, estimate] = self.files.pair()?;
        let options = TrajectoryErrorOptions {
            alignment: match self.align {
                Align::None => Alignment::None,
                Align::First => Alignment::FirstPose,
                Align::Best => Alignment::LeastSquares,
            },
            spans: self.stretch.iter().map(|&length_m| Span::DistanceM(length_m)).collect(),
            ..TrajectoryErrorOptions::default()
        };
        let error = TrajectoryError::new(&read_poses(estimate)?, &read_poses(truth)?, &options)
            .with_context(|| cannot_compare(estimate, truth))?;
        if self.json {
            return print_json(out, &error);
        }
        writeln!(out, "{} of {} poses matched over {:.2} m", error.matched, error.poses, error.path_length_m)?;
        print_heads(out)?;
        print_statistics(out, "absolute, m", Some(&error.translation_m))?;
        print_statistics(out, "absolute, °", Some(&error.rotation_deg))?;
        for relative in &error.relative {
            let span = match relative.span {
                Span::DistanceM(metres) => format!("{metres} m"),
                Span::TimeS(seconds) => format!("{seconds} s"),
            };
            print_statistics(out, &format!("over {span}, m"), relative.translation_m.as_ref())?;
            print_statistics(out, &format!("over {span}, °"), relative.rotation_deg.as_ref())?;
        }
        Ok(())
    }
}

impl Map {
    fn execute(&self, out: &mut impl Write) -> anyhow::Result<()> {
        let [truth, estimate] = self.files.pair()?;
        let options = MapQualityOptions { tolerance_cells: self.tolerance, max_shift_cells: self.max_shift };
        let quality = MapQuality::new(&read_map(estimate)?, &read_map(truth)?, &options)
            .with_context(|| cannot_compare(estimate, truth))?;
        if self.json {
            return print_json(out, &quality);
        }
        writeln!(out, "precision    {:.4}   of {} occupied cells", quality.precision, quality.estimated_cells)?;
        writeln!(
            out,
            "recall       {:.4}   of {} true cells beside explored floor",
            quality.recall, quality.explored_true_cells
        )?;
        writeln!(out, "{HEADING}F1           {:.4}{HEADING:#}", quality.f1)?;
        writeln!(out, "completeness {:.4}   of all true cells", quality.completeness)?;
        writeln!(out, "explored     {:.4}   of the true free cells", quality.explored)?;
        writeln!(out, "shift        {:+.3} m, {:+.3} m", quality.shift_m[0], quality.shift_m[1])?;
        Ok(())
    }
}

impl Texture {
    fn execute(&self, out: &mut impl Write) -> anyhow::Result<()> {
        let [truth, estimate] = self.files.pair()?;
        let options = TextureErrorOptions { max_shift_cells: self.max_shift };
        let seen = self.seen_floor()?;
        let error = TextureError::new(&read_floor(estimate)?, &read_floor(truth)?, seen.as_ref(), &options)
            .with_context(|| cannot_compare(estimate, truth))?;
        if self.json {
            return print_json(out, &error);
        }
        writeln!(
            out,
            "{HEADING}mean absolute colour error {:.2} / 255{HEADING:#} over {} cells",
            error.mean_absolute_error, error.compared_cells
        )?;
        writeln!(
            out,
            "without the shift of {:+.3} m, {:+.3} m: {:.2} / 255",
            error.shift_m[0], error.shift_m[1], error.unshifted_mean_absolute_error
        )?;
        writeln!(out, "painted off the true floor: {} cells", error.cells_off_the_floor)?;
        match error.coverage {
            Some(share) => writeln!(out, "painted of the floor that the camera saw: {:.2} %", 100.0 * share)?,
            None => writeln!(
                out,
                "coverage unknown: needs images.tum and config.toml beside the texture, truth.tum and truth_map.yaml beside the truth"
            )?,
        }
        Ok(())
    }

    /// The floor that the camera saw, where all that it follows from lies beside the two files.
    fn seen_floor(&self) -> anyhow::Result<Option<Raster<bool>>> {
        let [truth, estimate] = self.files.pair()?;
        let [images, config] = ["images.tum", "config.toml"].map(|name| estimate.with_file_name(name));
        let [truth, map] = ["truth.tum", "truth_map.yaml"].map(|name| truth.with_file_name(name));
        if ![&images, &config, &truth, &map].iter().all(|path| path.is_file()) {
            return Ok(None);
        }
        let text = read_text(&config)?;
        let config = Config::resolve(&[Layer::from_toml(&config.display().to_string(), &text)?])?;
        let Some(camera) = seeing_camera(&config) else { return Ok(None) };
        Ok(Some(seen_floor(&read_trajectory(&images)?, &read_trajectory(&truth)?, &camera, &read_map(&map)?)))
    }
}

impl Relations {
    fn execute(&self, out: &mut impl Write) -> anyhow::Result<()> {
        let [relations_file, estimate] = self.files.pair()?;
        let (trajectory, relations) = (read_poses(estimate)?, read_relations(relations_file)?);
        let report =
            RelationReport::new(&trajectory, &relations).with_context(|| cannot_compare(estimate, relations_file))?;
        let noise = match &self.odometry {
            Some(file) => Some(RelationNoise::new(&trajectory, &read_poses(file)?, &relations).with_context(|| {
                let (trajectory, odometry) = (estimate.display(), file.display());
                format!("fewer than two short relations have poses both in {trajectory} and in {odometry}; are all of the same log?")
            })?),
            None => None,
        };
        if self.json {
            return print_json(out, &RelationFigures { report, noise });
        }
        print_heads(out)?;
        for (name, group) in [("all", &report.all), ("short", &report.short), ("long", &report.long)] {
            print_statistics(out, &format!("{name}, m"), group.translation_m.as_ref())?;
            print_statistics(out, &format!("{name}, °"), group.rotation_deg.as_ref())?;
        }
        writeln!(out, "{} of {} relations matched", report.all.matched, report.all.relations)?;
        if let Some(noise) = noise {
            let heads = ["forward m", "lateral m", "heading °"].map(|head| format!("{head:>12}")).concat();
            writeln!(out, "{HEADING}{:<16}{heads}{HEADING:#}", "own noise, σ")?;
            let rows = [("relations", noise.relation), ("trajectory", noise.trajectory), ("odometry", noise.odometry)];
            for (name, MotionSigma { forward_m, lateral_m, heading_deg }) in rows {
                writeln!(out, "{name:<16}{forward_m:>12.4}{lateral_m:>12.4}{heading_deg:>12.3}")?;
            }
        }
        Ok(())
    }
}

/// A trajectory of at least one pose.
fn read_poses(path: &Path) -> anyhow::Result<Vec<StampedPose>> {
    let poses = read_trajectory(path)?;
    ensure!(!poses.is_empty(), "cannot read {}: it holds no pose", path.display());
    Ok(poses)
}

fn cannot_compare(estimate: &Path, truth: &Path) -> String {
    format!("cannot compare {} with {}", estimate.display(), truth.display())
}

fn print_json(out: &mut impl Write, value: &impl Serialize) -> anyhow::Result<()> {
    writeln!(out, "{}", serde_json::to_string_pretty(value)?)?;
    Ok(())
}

fn print_heads(out: &mut impl Write) -> anyhow::Result<()> {
    let heads = ["RMSE", "mean", "std", "median", "max"].map(|head| format!("{head:>9}")).concat();
    writeln!(out, "{HEADING}{:<16}{heads}{:>9}{HEADING:#}", "error", "count")?;
    Ok(())
}

fn print_statistics(out: &mut impl Write, name: &str, statistics: Option<&ErrorStatistics>) -> anyhow::Result<()> {
    let Some(ErrorStatistics { count, mean, std, rmse, median, max }) = statistics else {
        writeln!(out, "{name:<16}{:>9}", "none")?;
        return Ok(());
    };
    let cells = [rmse, mean, std, median, max].map(|value| format!(" {:>8}", in_eight(*value))).concat();
    writeln!(out, "{name:<16}{cells}{count:>9}")?;
    Ok(())
}

/// A value in at most eight characters: with four decimals, or as many as there is room for.
fn in_eight(value: f64) -> String {
    let with = |decimals: usize| format!("{value:.decimals$}");
    (0..=4).rev().map(with).find(|text| text.len() <= 8).unwrap_or_else(|| format!("{value:.1e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stay_apart_however_large_the_errors_are() {
        let cells = [0.00012, 1.5, 123.456_78, 12_345.678_9, 1_234_567.8, 123_456_789.0, 1e30, f64::NAN].map(in_eight);
        assert_eq!(cells, ["0.0001", "1.5000", "123.4568", "12345.68", "1234568", "1.2e8", "1.0e30", "NaN"]);
    }
}
