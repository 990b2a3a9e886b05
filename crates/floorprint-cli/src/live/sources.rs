//! Where a live session's records come from.

use super::Arguments;
#[cfg(feature = "ros2")]
use super::ros::RosSource;
use crate::interrupt::Interrupt;
use crate::outcome::BadArguments;
use crate::terminal::Terminal;
use anyhow::Context as _;
use floorprint::odometry::OdometryCorrections;
use floorprint::sensors::RobotConfig;
use floorprint::{Config, SensorId};
use floorprint_io::{DataSet, open};
use floorprint_live::{Board, FrameNames, Inbox, JsonLines, play};
use std::borrow::Cow;
use std::io::{BufRead as _, BufReader, Read as _};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Longest line of JSON, bytes: a scan of 65536 rays in all digits.
const LONGEST_LINE: u64 = 4 << 20;
/// Lines that are told one by one when they are wrong; the rest is only counted.
const TOLD_LINES: usize = 5;

/// Where records come from.
pub(super) enum Source {
    /// A recording.
    Recording(Box<DataSet>),
    /// Lines of JSON.
    StandardInput(Terminal),
    /// Topics of ROS 2.
    #[cfg(feature = "ros2")]
    Ros(Box<RosSource>),
}

impl Source {
    /// The source that is asked for; `None` where the user ended it before there was one.
    pub(super) fn open(
        arguments: &Arguments,
        interrupt: &Interrupt,
        terminal: &Terminal,
    ) -> anyhow::Result<Option<Self>> {
        let _ = interrupt;
        if let (None, Some(_), _) | (None, _, Some(_)) = (&arguments.play, arguments.rate, arguments.drive) {
            return Err(BadArguments("--rate and --drive are for --play PATH".to_owned()).into());
        }
        #[cfg(feature = "ros2")]
        if arguments.ros.ros2 {
            if arguments.play.is_some() || arguments.input.is_some() {
                return Err(BadArguments("--ros2 is a source of its own: leave the other one out".to_owned()).into());
            }
            let source = RosSource::open(&arguments.ros, &arguments.topics, interrupt, terminal)?;
            return Ok(source.map(|source| Self::Ros(Box::new(source))));
        }
        let Some(path) = &arguments.play else {
            let message = match arguments.input.as_deref() {
                Some("-") => return Ok(Some(Self::StandardInput(terminal.clone()))),
                Some(found) => format!("{found}: expected - (standard input); --play {found} plays a recording"),
                None => "where do records come from? --play PATH, --ros2, or - for standard input".to_owned(),
            };
            return Err(BadArguments(message).into());
        };
        let reading = terminal.busy("reading");
        let data_set = open(path, &arguments.topics.open_options(arguments.drive, arguments.max_expansion));
        reading.finish_and_clear();
        let data_set = data_set?;
        data_set.notes.iter().for_each(|note| terminal.note(note));
        Ok(Some(Self::Recording(Box::new(data_set))))
    }

    /// The robot's calibration, where the source knows it.
    pub(super) fn robot(&self) -> Option<&RobotConfig> {
        match self {
            Self::Recording(data_set) => Some(&data_set.robot),
            Self::StandardInput(_) => None,
            #[cfg(feature = "ros2")]
            Self::Ros(source) => Some(source.robot()),
        }
    }

    /// What frames are called.
    pub(super) fn frames(&self, config: &Config) -> FrameNames {
        let usual = FrameNames::of(&config.robot);
        match self {
            Self::Recording(_) | Self::StandardInput(_) => usual,
            #[cfg(feature = "ros2")]
            Self::Ros(source) => source.frames(usual),
        }
    }

    /// Begins to tell others of what is on the board, where the source is a network.
    pub(super) fn announce(&mut self, board: &Arc<Board>, frames: &FrameNames) -> anyhow::Result<()> {
        let _ = (board, frames);
        match self {
            Self::Recording(_) | Self::StandardInput(_) => Ok(()),
            #[cfg(feature = "ros2")]
            Self::Ros(source) => source.announce(board, &frames.base),
        }
    }

    /// What can be known beforehand.
    pub(super) fn corrections(&self, config: &Config) -> anyhow::Result<Option<OdometryCorrections>> {
        match self {
            Self::Recording(data_set) => Ok(data_set.frames(config)?.corrections().cloned()),
            Self::StandardInput(_) => Ok(None),
            #[cfg(feature = "ros2")]
            Self::Ros(_) => Ok(None),
        }
    }

    /// Begins to put records into the inbox, which is closed at the end.
    pub(super) fn start(
        self,
        config: &Config,
        rate: f64,
        inbox: &Arc<Inbox>,
        interrupt: &Interrupt,
    ) -> JoinHandle<anyhow::Result<()>> {
        let (config, inbox, interrupt) = (config.clone(), Arc::clone(inbox), interrupt.clone());
        std::thread::spawn(move || {
            let outcome = match self {
                Self::Recording(data_set) => data_set.frames(&config).map_err(anyhow::Error::from).map(|frames| {
                    let records = frames.order().iter().filter_map(|&position| data_set.records.get(position));
                    play(records.map(Cow::Borrowed), rate, &inbox, || interrupt.requested());
                }),
                Self::StandardInput(terminal) => read_lines(&config, &inbox, &terminal),
                #[cfg(feature = "ros2")]
                Self::Ros(source) => {
                    source.feed(&inbox, &interrupt);
                    Ok(())
                }
            };
            inbox.close();
            outcome
        })
    }
}

/// Reads lines of JSON from standard input until it ends. The pipe waits while the engine does not keep up.
fn read_lines(config: &Config, inbox: &Inbox, terminal: &Terminal) -> anyhow::Result<()> {
    let (mut lines, mut wrong, mut number) = (JsonLines::default(), 0_usize, 0_usize);
    let lidars = 1 + config.robot.further_lidars.len();
    let mut input = BufReader::new(std::io::stdin());
    let mut line = String::new();
    loop {
        line.clear();
        number += 1;
        let bytes = match input.by_ref().take(LONGEST_LINE).read_line(&mut line) {
            Err(error) if error.kind() == std::io::ErrorKind::InvalidData => {
                anyhow::bail!("standard input, line {number}: it is no text (UTF-8)")
            }
            bytes => bytes.context("standard input cannot be read")?,
        };
        if bytes == 0 {
            break;
        }
        anyhow::ensure!(
            (bytes as u64) < LONGEST_LINE,
            "standard input, line {number} is longer than {LONGEST_LINE} bytes"
        );
        let problem = match lines.parse(&line) {
            Ok(None) => continue,
            Ok(Some(record))
                if usize::from(record.sensor().1.0) >= lidars && record.sensor().1 != SensorId::default() =>
            {
                format!(
                    "sensor {}, but the robot has {lidars} LiDARs: add [[robot.further_lidars]]",
                    record.sensor().1.0
                )
            }
            Ok(Some(record)) => {
                if !inbox.send(record) {
                    return Ok(());
                }
                continue;
            }
            Err(problem) => problem,
        };
        wrong += 1;
        if wrong <= TOLD_LINES {
            terminal.warn(&format!("standard input, line {number}: {problem}"));
        }
    }
    if wrong > TOLD_LINES {
        terminal.warn(&format!("standard input: {wrong} lines could not be used"));
    }
    Ok(())
}
