//! `floorprint info`: what is in a data set.

use crate::number::number;
use crate::outcome::Outcome;
use crate::terminal::{HEADING, Terminal, prose};
use crate::topics::Topics;
use anyhow::bail;
use clap::Args;
use floorprint::SensorId;
use floorprint::sensors::{Ray, Record, RobotConfig, Scan};
use floorprint::survey::silences;
use floorprint_io::{DataSet, DriveEntry, RoleChoice, TopicSummary, drives, open};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Show what is in a data set: sensors, rates, gaps, spans, what cannot be used.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Data set: a file or a folder, recognised by its content; - for standard input.
    path: PathBuf,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    /// How many times its size a file of the data set may take in memory, besides 256 MB: what unpacks to more
    /// is refused [default: 64].
    #[arg(long, value_name = "TIMES", value_parser = number(0.0, 1e9))]
    max_expansion: Option<f64>,
    #[command(flatten)]
    topics: Topics,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs `floorprint info`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let options = arguments.topics.open_options(arguments.drive, arguments.max_expansion);
    let mut out = terminal.results();
    let drives = drives(&arguments.path, &options)?;
    if drives.len() > 1 {
        list(&drives, &arguments.path, arguments.json, &mut out)?;
        return Ok(Outcome::Fine);
    }
    let data_set = open(&arguments.path, &options)?;
    let info = Info::of(&data_set);
    if arguments.json {
        writeln!(out, "{}", serde_json::to_string_pretty(&info)?)?;
    } else {
        info.print(&mut out)?;
    }
    out.flush()?;
    if let (Some(bag), None) = (&data_set.bag, data_set.scans().next()) {
        bail!(
            "no map can be made of {}: it holds no scan; its topics: {}",
            arguments.path.display(),
            bag.list_of_topics()
        );
    }
    Ok(Outcome::Fine)
}

/// The drives of a folder that holds several, and how each is named.
fn list(drives: &[DriveEntry], path: &Path, json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(drives)?)?;
        return Ok(out.flush()?);
    }
    writeln!(out, "{HEADING}{} holds {} drives; name one:{HEADING:#}", path.display(), drives.len())?;
    let names: Vec<String> = drives.iter().map(DriveEntry::arguments).collect();
    let width = names.iter().map(String::len).max().unwrap_or(0);
    for (name, entry) in names.iter().zip(drives) {
        writeln!(out, "  {name:<width$}  {}", entry.holds)?;
    }
    Ok(out.flush()?)
}

/// What is in a data set.
#[derive(Serialize)]
struct Info {
    format: &'static str,
    sha256: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    topics: Vec<TopicSummary>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    roles: Vec<RoleChoice>,
    sensors: Vec<Stream>,
    lidar: Option<Lidar>,
    calibration: RobotConfig,
    dropped: Vec<Dropped>,
    notes: Vec<String>,
}

/// One sensor's readings.
#[derive(Serialize)]
struct Stream {
    sensor: String,
    readings: usize,
    first_stamp_s: f64,
    last_stamp_s: f64,
    /// Readings over the span; some sensors pause, so the median interval would say less.
    rate_hz: f64,
    largest_gap_s: f64,
    /// How often it fell silent, as the notes of a run count it.
    gaps: usize,
    /// Readings stamped before their predecessor.
    backwards: usize,
}

/// The LiDAR's rays.
#[derive(Serialize)]
struct Lidar {
    rays: usize,
    field_of_view_deg: f64,
    range_min_m: f32,
    range_max_m: f32,
    /// Shares over all rays of all scans.
    hit_share: f64,
    no_return_share: f64,
    /// Rays that say nothing: no number, or nearer than the LiDAR measures.
    invalid_share: f64,
    /// Scans that have another number of rays than the first.
    scans_of_other_size: usize,
}

/// Data that cannot be used.
#[derive(Serialize)]
struct Dropped {
    reason: &'static str,
    count: usize,
}

impl Info {
    fn of(data_set: &DataSet) -> Self {
        let stamps = |wanted: fn(&Record) -> bool| -> Vec<f64> {
            data_set.records.iter().filter(|record| wanted(record)).map(Record::stamp_s).collect()
        };
        let mut lidars: BTreeMap<SensorId, Vec<f64>> = BTreeMap::new();
        for scan in data_set.scans() {
            lidars.entry(scan.sensor).or_default().push(scan.stamp_s);
        }
        let name = |index: usize| if lidars.len() > 1 { format!("LiDAR {}", index + 1) } else { "LiDAR".to_owned() };
        let mut streams: Vec<(String, Vec<f64>)> =
            lidars.values().enumerate().map(|(index, stamps_s)| (name(index), stamps_s.clone())).collect();
        streams.extend([
            ("encoders".to_owned(), stamps(|record| matches!(record, Record::Encoders(_)))),
            ("IMU".to_owned(), stamps(|record| matches!(record, Record::Imu(_)))),
            ("odometry".to_owned(), stamps(|record| matches!(record, Record::Odometry(_)))),
            (
                "odometry of scans".to_owned(),
                stamps(|record| matches!(record, Record::Scan(scan) if scan.odometry.is_some())),
            ),
        ]);
        if let Some(images) = &data_set.images {
            streams.push(("depth images".to_owned(), images.depth.iter().map(|image| image.stamp_s).collect()));
            streams.push(("colour images".to_owned(), images.color.iter().map(|image| image.stamp_s).collect()));
        }
        Self {
            format: data_set.format.description,
            sha256: data_set.input_hash.clone(),
            topics: data_set.bag.as_ref().map_or_else(Vec::new, |bag| bag.topics.clone()),
            roles: data_set.bag.as_ref().map_or_else(Vec::new, |bag| bag.roles.clone()),
            sensors: streams.into_iter().filter_map(|(sensor, stamps_s)| Stream::of(sensor, &stamps_s)).collect(),
            lidar: Lidar::of(data_set.scans()),
            calibration: data_set.robot.clone(),
            dropped: data_set
                .dropped
                .iter()
                .map(|(reason, count)| Dropped { reason: reason.description(), count })
                .collect(),
            notes: data_set.notes.clone(),
        }
    }

    fn print(&self, out: &mut impl Write) -> anyhow::Result<()> {
        writeln!(out, "{}", prose(&format!("{HEADING}{}{HEADING:#}", self.format), 0))?;
        writeln!(out, "sha256 {}\n", self.sha256)?;
        self.print_topics(out)?;
        writeln!(
            out,
            "{HEADING}{:<18}{:>9}{:>11}{:>12}{:>14}{:>7}{:>11}{HEADING:#}",
            "sensor", "readings", "rate Hz", "span s", "largest gap s", "gaps", "backwards"
        )?;
        for stream in &self.sensors {
            writeln!(
                out,
                "{:<18}{:>9}{:>11.2}{:>12.3}{:>14.3}{:>7}{:>11}",
                stream.sensor,
                stream.readings,
                stream.rate_hz,
                stream.last_stamp_s - stream.first_stamp_s,
                stream.largest_gap_s,
                stream.gaps,
                stream.backwards
            )?;
        }
        if let Some(lidar) = &self.lidar {
            let rays = format!(
                "{HEADING}LiDAR{HEADING:#} {} rays over {:.1}°, {}; {:.1} % of the rays hit something, {:.1} % came back \
                 empty, {:.1} % say nothing: no number, or nearer than the LiDAR measures",
                lidar.rays,
                lidar.field_of_view_deg,
                ranges_in_words(lidar.range_min_m, lidar.range_max_m),
                100.0 * lidar.hit_share,
                100.0 * lidar.no_return_share,
                100.0 * lidar.invalid_share
            );
            writeln!(out, "\n{}", prose(&rays, 0))?;
            if lidar.scans_of_other_size > 0 {
                writeln!(out, "scans with another number of rays: {}", lidar.scans_of_other_size)?;
            }
        }
        for dropped in &self.dropped {
            writeln!(
                out,
                "{HEADING}dropped{HEADING:#} {}",
                prose(&format!("{} {}", dropped.count, dropped.reason), 8)
            )?;
        }
        for note in &self.notes {
            writeln!(out, "{}", prose(&format!("{HEADING}note{HEADING:#} {note}"), 0))?;
        }
        writeln!(out, "\n{HEADING}calibration{HEADING:#}")?;
        for line in toml::to_string(&self.calibration)?.lines() {
            writeln!(out, "  {line}")?;
        }
        Ok(())
    }
}

impl Info {
    /// What is in a recording of topics, and what is used of it.
    fn print_topics(&self, out: &mut impl Write) -> anyhow::Result<()> {
        if self.topics.is_empty() {
            return Ok(());
        }
        let widest = |texts: &mut dyn Iterator<Item = &String>| texts.map(|text| text.len()).max().unwrap_or(0);
        let name = widest(&mut self.topics.iter().map(|topic| &topic.name)).max("topic".len());
        let kind = widest(&mut self.topics.iter().map(|topic| &topic.type_name)).max("type".len());
        writeln!(
            out,
            "{HEADING}{:<name$}  {:<kind$}  {:>8}  {:>8}  frames{HEADING:#}",
            "topic", "type", "messages", "rate Hz"
        )?;
        for topic in &self.topics {
            let TopicSummary { name: topic_name, type_name, messages, rate_hz, frames, .. } = topic;
            let frames = frames.join(", ");
            writeln!(
                out,
                "{}",
                format!("{topic_name:<name$}  {type_name:<kind$}  {messages:>8}  {rate_hz:>8.2}  {frames}").trim_end()
            )?;
        }
        writeln!(out)?;
        for RoleChoice { role, what, reason } in &self.roles {
            writeln!(out, "{HEADING}{role:<10}{HEADING:#} {}", prose(&format!("{what}: {reason}"), 11))?;
        }
        writeln!(out)?;
        Ok(())
    }
}

impl Stream {
    /// `None` for a sensor that delivered nothing.
    fn of(sensor: String, stamps_s: &[f64]) -> Option<Self> {
        let steps: Vec<f64> = stamps_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (first_stamp_s, last_stamp_s) = (*stamps_s.first()?, *stamps_s.last()?);
        let silences = silences(stamps_s);
        let longest_s = |silences: &[[f64; 2]]| silences.iter().map(|[from_s, to_s]| to_s - from_s).reduce(f64::max);
        let mean_s = (last_stamp_s - first_stamp_s) / steps.len().max(1) as f64;
        Some(Self {
            sensor,
            readings: stamps_s.len(),
            first_stamp_s,
            last_stamp_s,
            rate_hz: if mean_s > 0.0 { 1.0 / mean_s } else { 0.0 },
            largest_gap_s: longest_s(&silences).unwrap_or_else(|| steps.iter().copied().fold(0.0, f64::max)),
            gaps: silences.len(),
            backwards: steps.iter().filter(|&&step| step < 0.0).count(),
        })
    }
}

/// From where to where a LiDAR measures; text logs and bags may state no end.
fn ranges_in_words(range_min_m: f32, range_max_m: f32) -> String {
    if range_max_m.is_finite() {
        format!("{range_min_m} to {range_max_m} m")
    } else {
        format!("from {range_min_m} m on, no farthest range stated")
    }
}

impl Lidar {
    fn of<'a>(scans: impl Iterator<Item = &'a Scan>) -> Option<Self> {
        let mut scans = scans.peekable();
        let first = scans.peek()?;
        let angles_rad = &first.geometry.angles_rad;
        let span = angles_rad
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &angle| (low.min(angle), high.max(angle)));
        let mut lidar = Self {
            rays: angles_rad.len(),
            field_of_view_deg: (span.1 - span.0).max(0.0).to_degrees(),
            range_min_m: first.geometry.range_min_m,
            range_max_m: first.geometry.range_max_m,
            hit_share: 0.0,
            no_return_share: 0.0,
            invalid_share: 0.0,
            scans_of_other_size: 0,
        };
        let (mut hits, mut no_returns, mut invalid) = (0_usize, 0_usize, 0_usize);
        for scan in scans {
            lidar.scans_of_other_size += usize::from(scan.ranges_m.len() != lidar.rays);
            for &range_m in &scan.ranges_m {
                match scan.geometry.classify(range_m) {
                    Ray::Hit(_) => hits += 1,
                    Ray::NoReturn => no_returns += 1,
                    Ray::Invalid => invalid += 1,
                }
            }
        }
        let share = |count: usize| count as f64 / (hits + no_returns + invalid).max(1) as f64;
        (lidar.hit_share, lidar.no_return_share, lidar.invalid_share) =
            (share(hits), share(no_returns), share(invalid));
        Some(lidar)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::sensors::ScanGeometry;
    use std::sync::Arc;

    #[test]
    fn rates_gaps_and_steps_back_are_seen() {
        let stream = Stream::of("LiDAR".to_owned(), &[0.0, 0.1, 0.2, 0.15, 0.25, 1.5]).unwrap();
        assert!((stream.rate_hz - 5.0 / 1.5).abs() < 1e-9);
        assert_eq!((stream.gaps, stream.backwards, stream.readings), (1, 1, 6));
        assert!((stream.largest_gap_s - 1.25).abs() < 1e-9);
        let stream = Stream::of("LiDAR".to_owned(), &[0.0, 0.1, 0.2, 0.3, 0.4, 1.3]).unwrap();
        assert_eq!(stream.gaps, 0, "as the notes of a run count it");
        assert!(Stream::of("IMU".to_owned(), &[]).is_none());
    }

    #[test]
    fn every_ray_is_counted_as_something() {
        let geometry = Arc::new(ScanGeometry {
            angles_rad: vec![0.0; 4],
            time_offsets_s: vec![0.0; 4],
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return: false,
        });
        let ranges_m = vec![1.0, 30.0, f32::NAN, 0.05];
        let scan = Scan { sensor: SensorId::default(), stamp_s: 0.0, ranges_m, geometry, odometry: None };
        let lidar = Lidar::of([scan].iter()).unwrap();
        assert_eq!([lidar.hit_share, lidar.no_return_share, lidar.invalid_share], [0.25, 0.25, 0.5]);
    }

    #[test]
    fn a_range_without_an_end_is_told_in_words() {
        assert_eq!(ranges_in_words(0.1, 30.0), "0.1 to 30 m");
        assert_eq!(ranges_in_words(0.001, f32::INFINITY), "from 0.001 m on, no farthest range stated");
    }
}
