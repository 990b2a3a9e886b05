//! Options by which topics and frames of a recording are chosen.

use clap::Args;
use floorprint_io::{OpenOptions, TopicChoice, USUAL_EXPANSION};
use std::process::Command;

/// Which topics and frames of a bag are used; what is not given is found out (`floorprint info` tells how).
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Topics {
    /// Topic of a bag's scans. Can be repeated: several LiDARs are used together.
    #[arg(long, value_name = "TOPIC", alias = "scan_topic")]
    scan: Vec<String>,
    /// Topic of a bag's odometry; /tf for the odometry among its transforms, a topic of joints for its wheels.
    #[arg(long, value_name = "TOPIC", alias = "odom_topic")]
    odom: Option<String>,
    /// Topic of a bag's true poses, with which the trajectory is compared.
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    /// Frame of a bag that is taken for the robot's body.
    #[arg(long, value_name = "FRAME", alias = "base_frame")]
    base: Option<String>,
    /// Topic of a bag's colour images, by which the floor is painted.
    #[arg(long, value_name = "TOPIC")]
    color: Option<String>,
    /// Topic of a bag's depth images, which tell floor from what stands on it.
    #[arg(long, value_name = "TOPIC")]
    depth: Option<String>,
}

impl Topics {
    /// A choice of scans, odometry and base; the truth is given otherwise.
    pub(crate) fn without_truth(scan: Vec<String>, odom: Option<String>, base: Option<String>) -> Self {
        Self { scan, odom, base, ..Self::default() }
    }

    /// How a data set is to be opened.
    pub(crate) fn open_options(&self, drive: Option<u32>, max_expansion: Option<f64>) -> OpenOptions {
        OpenOptions {
            drive,
            max_expansion: max_expansion.unwrap_or(USUAL_EXPANSION),
            topics: TopicChoice {
                scans: self.scan.clone(),
                odometry: self.odom.clone(),
                truth: self.truth.clone(),
                base: self.base.clone(),
                color: self.color.clone(),
                depth: self.depth.clone(),
            },
        }
    }

    /// Gives the same options to another run of this program.
    pub(crate) fn pass_on(&self, command: &mut Command) {
        let scans = self.scan.iter().map(|topic| ("--scan", topic));
        let single = [
            ("--odom", &self.odom),
            ("--truth", &self.truth),
            ("--base", &self.base),
            ("--color", &self.color),
            ("--depth", &self.depth),
        ];
        let single = single.into_iter().filter_map(|(option, value)| Some((option, value.as_ref()?)));
        for (option, value) in scans.chain(single) {
            command.arg(format!("{option}={value}"));
        }
    }
}
