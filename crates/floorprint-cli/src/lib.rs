//! The command line of Floorprint: one file per command.
//!
//! It is a library, so that other programs can bring it: [`run`] is the whole program, and [`solve_drive`] what its
//! command `run` does before anything is written.

mod batch;
mod bench;
mod calibrate;
mod check;
mod compare;
mod config;
mod demo;
mod evaluate;
mod figure;
mod info;
mod interrupt;
mod live;
mod localize;
mod map;
mod map_drawing;
mod mcap;
mod memory;
mod number;
mod optimize;
mod outcome;
mod plot;
mod program;
mod replay;
mod report;
mod run;
mod run_folder;
mod session_keeper;
mod shell;
mod simulate;
mod snapshots;
mod solve;
mod solved;
mod stopwatch;
mod summary;
mod terminal;
mod topics;
mod truth;
mod view;
mod watcher;

pub use check::{Told, examine_recording};
pub use compare::distances;
pub use config::Settings;
pub use figure::map_picture;
pub use map::{Placement, Stored};
pub use outcome::Outcome;
pub use program::Program;
pub use simulate::write_simulation;
pub use solve::{Floor, Solution};
pub use solved::{Request, Solved, solve_drive};
pub use terminal::is_about_arguments;
pub use watcher::{Progress, Watcher};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use terminal::Terminal;

/// Particle-filter SLAM: trajectory, occupancy grid and colour floor map from a robot's drive.
#[derive(Parser)]
#[command(name = "floorprint", version, max_term_width = 100, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Say nothing but warnings and errors: results are where they were asked for, or printed by commands that
    /// do nothing but show them.
    #[arg(long, short, global = true)]
    quiet: bool,
}

const EXIT_CODES: &str = "Exit codes: 0 fine, 1 failed, 2 bad arguments or configuration, \
    3 finished but more data were dropped than allowed, 130 interrupted (what was computed is kept).";

#[derive(Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Run(run::Arguments),
    Replay(replay::Arguments),
    // Boxed: it has many options.
    Live(Box<live::Arguments>),
    Localize(localize::Arguments),
    Simulate(simulate::Arguments),
    #[command(subcommand)]
    Evaluate(evaluate::Command),
    View(view::Arguments),
    Info(info::Arguments),
    Check(check::Arguments),
    Compare(compare::Arguments),
    Plot(plot::Arguments),
    Calibrate(calibrate::Arguments),
    #[command(subcommand)]
    Map(map::Command),
    Optimize(optimize::Arguments),
    #[command(subcommand)]
    Config(config::Command),
    // Boxed: it has many options.
    Bench(Box<bench::Arguments>),
    Batch(Box<batch::Arguments>),
    /// One simulated drive of `bench`.
    #[command(hide = true)]
    BenchDrive(Box<bench::DriveArguments>),
    /// One drive of the gauntlet of `bench`.
    #[command(hide = true)]
    GauntletDrive(Box<bench::GauntletDriveArguments>),
    /// One case of the benchmark of localization of `bench`.
    #[command(hide = true)]
    LocalizationDrive(Box<bench::LocalizationDriveArguments>),
    Completions(shell::Completions),
    Man(shell::Manual),
}

impl Command {
    fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        match self {
            Self::Demo(arguments) => demo::execute(arguments, terminal),
            Self::Run(arguments) => run::execute(arguments, terminal),
            Self::Replay(arguments) => replay::execute(arguments, terminal),
            Self::Live(arguments) => live::execute(arguments, terminal),
            Self::Localize(arguments) => localize::execute(arguments, terminal),
            Self::Simulate(arguments) => simulate::execute(arguments, terminal),
            Self::Evaluate(command) => evaluate::execute(command, terminal),
            Self::View(arguments) => view::execute(arguments, terminal),
            Self::Info(arguments) => info::execute(arguments, terminal),
            Self::Check(arguments) => check::execute(arguments, terminal),
            Self::Compare(arguments) => compare::execute(arguments, terminal),
            Self::Plot(arguments) => plot::execute(arguments, terminal),
            Self::Calibrate(arguments) => calibrate::execute(arguments, terminal),
            Self::Map(command) => map::execute(command, terminal),
            Self::Optimize(arguments) => optimize::execute(arguments, terminal),
            Self::Config(command) => config::execute(command, terminal),
            Self::Bench(arguments) => bench::execute(arguments, terminal),
            Self::Batch(arguments) => batch::execute(arguments, terminal),
            Self::BenchDrive(arguments) => bench::execute_drive(arguments, terminal),
            Self::GauntletDrive(arguments) => bench::execute_gauntlet_drive(arguments, terminal),
            Self::LocalizationDrive(arguments) => bench::execute_localization_drive(arguments, terminal),
            Self::Completions(arguments) => shell::completions(arguments, Arguments::command(), terminal),
            Self::Man(arguments) => shell::man(arguments, Arguments::command(), terminal),
        }
    }
}

/// Runs the command line: parses, executes, and tells what went wrong.
pub fn run(program: &Program) -> Outcome {
    program.remember();
    let matches = taking_negative_numbers(Arguments::command()).try_get_matches_from(program.words());
    let arguments = match matches.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and versions are such errors, too. Where they cannot be printed nobody is left to be told.
            let _ = error.print();
            return if error.exit_code() == 0 { Outcome::Fine } else { Outcome::BadArguments };
        }
    };
    let terminal = Terminal::new(arguments.quiet);
    arguments.command.execute(&terminal).unwrap_or_else(|error| terminal.fail(&error))
}

/// Lets every option take a negative number as its value, so that it can say what it expects instead.
fn taking_negative_numbers(command: clap::Command) -> clap::Command {
    let takes_values = |option: &clap::Arg| !option.is_positional() && option.get_action().takes_values();
    command
        .mut_args(|option| if takes_values(&option) { option.allow_negative_numbers(true) } else { option })
        .mut_subcommands(taking_negative_numbers)
}
