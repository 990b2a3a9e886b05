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
mod dead_reckon;
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::{Path, PathBuf};

    /// The words of a line of a shell, up to its comment; quotes hold words together.
    fn words(line: &str) -> Vec<String> {
        let (mut words, mut is_quoted) = (vec![String::new()], false);
        for character in line.chars() {
            match character {
                '"' => is_quoted = !is_quoted,
                ' ' if !is_quoted => words.push(String::new()),
                _ => words.last_mut().unwrap().push(character),
            }
        }
        words.retain(|word| !word.is_empty());
        words.into_iter().take_while(|word| !word.starts_with('#')).collect()
    }

    /// The calls of `floorprint` in a document's blocks of code, each as its words.
    fn calls(document: &str) -> Vec<Vec<String>> {
        let blocks = document.split("```").skip(1).step_by(2).map(|block| block.replace("\\\n", " "));
        let lines: Vec<Vec<String>> = blocks.flat_map(|block| block.lines().map(words).collect::<Vec<_>>()).collect();
        let calls = lines.iter().flat_map(|words| words.split(|word| word == "|" || word == "&&"));
        calls.filter(|call| call.first().is_some_and(|first| first == "floorprint")).map(<[String]>::to_vec).collect()
    }

    #[test]
    fn every_call_in_the_documents_is_understood() {
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folders = [repository.clone(), repository.join("docs"), repository.join("crates/floorprint-python")];
        let entries = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap());
        let documents = entries.map(|entry| entry.unwrap().path());
        let documents: Vec<PathBuf> =
            documents.filter(|path| path.extension().is_some_and(|end| end == "md")).collect();
        let mut count = 0;
        for path in &documents {
            for call in calls(&fs::read_to_string(path).unwrap()) {
                let matches = taking_negative_numbers(Arguments::command()).try_get_matches_from(&call);
                let understood = matches.and_then(|matches| Arguments::from_arg_matches(&matches));
                if let Err(error) = understood {
                    panic!("{}: {}: {error}", path.display(), call.join(" "));
                }
                count += 1;
            }
        }
        assert!(count > 50, "{count} calls in {documents:?}");
    }
}
