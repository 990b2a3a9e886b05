//! What the user sees: results on stdout, everything else on stderr.
//!
//! Colours are used on terminals only, and never when `NO_COLOR` is set.

use crate::outcome::{BadArguments, Outcome};
use anstyle::{AnsiColor, Style};
use floorprint::config::ConfigError;
use floorprint::odometry::OdometryError;
use floorprint::simulator::SimulationError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{self, Write};

const ERROR: Style = AnsiColor::Red.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
const NOTE: Style = AnsiColor::Cyan.on_default().bold();
/// Style of the heads of tables and of names.
pub(crate) const HEADING: Style = Style::new().bold();

/// The user's terminal, or whatever stands in for it.
#[derive(Clone)]
pub(crate) struct Terminal {
    quiet: bool,
}

impl Terminal {
    /// A terminal that shows only errors and results when `quiet`.
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Where results go. Colours are taken out where they cannot be shown.
    pub(crate) fn results(&self) -> impl Write {
        anstream::stdout().lock()
    }

    /// Tells what happens, unless quiet.
    pub(crate) fn say(&self, text: &str) {
        if !self.quiet {
            report(text);
        }
    }

    /// Tells what the user should know, unless quiet.
    pub(crate) fn note(&self, text: &str) {
        self.say(&format!("{NOTE}note{NOTE:#}: {text}"));
    }

    /// Warns, also when quiet: something is wrong with the result.
    pub(crate) fn warn(&self, text: &str) {
        report(&format!("{WARNING}warning{WARNING:#}: {text}"));
    }

    /// Explains why the command failed; the error decides the exit code.
    ///
    /// A reader that has seen enough (`floorprint … | head`) is no failure.
    pub(crate) fn fail(&self, error: &anyhow::Error) -> Outcome {
        let mut kinds = error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
        if kinds.any(|kind| kind == io::ErrorKind::BrokenPipe) {
            return Outcome::Fine;
        }
        report(&format!("{ERROR}error{ERROR:#}: {error:#}"));
        let is_about_arguments = |cause: &(dyn std::error::Error + 'static)| {
            cause.is::<BadArguments>()
                || cause.is::<ConfigError>()
                || cause.is::<SimulationError>()
                || matches!(cause.downcast_ref(), Some(OdometryError::Setting { .. }))
        };
        if error.chain().any(is_about_arguments) { Outcome::BadArguments } else { Outcome::Failed }
    }

    /// A bar for `length` steps of work with speed and time left; silent when stderr is no terminal.
    pub(crate) fn progress(&self, task: &'static str, unit: &str, length: usize) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let template =
            format!("{{msg:>12.bold}} {{wide_bar:.cyan/dim}} {{pos}}/{{len}} {unit} · {{per_sec}} · {{eta}} left");
        let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::with_draw_target(Some(length as u64), target)
            .with_style(style.progress_chars("━━╌"))
            .with_message(task)
    }
}

/// Writes a line to stderr. Where even that is impossible, nobody is left to be told.
fn report(text: &str) {
    let _ = writeln!(anstream::stderr(), "{text}");
}
