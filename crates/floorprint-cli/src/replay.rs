//! `floorprint replay`: a recorded drive, pushed record by record as on a live robot.

use crate::number::number;
use crate::outcome::Outcome;
use crate::run;
use crate::run_folder;
use crate::terminal::Terminal;
use clap::Args;
use floorprint::simulator::Arrival;
use std::path::Path;

/// Solve a drive as if it were live: records come late by a random bit, or never. Where none is lost the results are
/// those of `run`.
#[derive(Args)]
#[group(skip)]
pub(crate) struct Arguments {
    #[command(flatten)]
    run: run::Arguments,
    /// Each record comes up to so many seconds late; a sensor's records stay in their order.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = number(0.0, 3600.0))]
    jitter: f64,
    /// Share of the records that never come.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = number(0.0, 1.0))]
    drop: f64,
}

/// Runs `floorprint replay`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let arrival = Arrival { jitter_s: arguments.jitter, dropped_share: arguments.drop, ..Arrival::default() };
    let name = run_folder::data_set_name(&arguments.run.path);
    let out = arguments.run.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("{name}-replay")));
    run::execute_arriving(&arguments.run, &out, Some(arrival), terminal)
}
