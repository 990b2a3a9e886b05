//! What the user sees: results on stdout, everything else on stderr.
//!
//! Colours are used on terminals only, and never when `NO_COLOR` is set.

use crate::outcome::{BadArguments, Outcome};
use crate::watcher::Watcher;
use anstream::adapter::strip_str;
use anstyle::{AnsiColor, Style};
use floorprint::config::ConfigError;
use floorprint::odometry::OdometryError;
use floorprint::simulator::SimulationError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt;
use std::io::{self, Write};
use std::time::Duration;

const ERROR: Style = AnsiColor::Red.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
const NOTE: Style = AnsiColor::Cyan.on_default().bold();
/// Style of the heads of tables and of names.
pub(crate) const HEADING: Style = Style::new().bold();

/// The user's terminal, or whatever stands in for it.
#[derive(Clone)]
pub(crate) struct Terminal {
    quiet: bool,
    watcher: Option<Watcher>,
}

impl Terminal {
    /// A terminal that shows only errors and results when `quiet`.
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet, watcher: None }
    }

    /// No terminal: all is told to a watcher.
    pub(crate) fn watched(watcher: Watcher) -> Self {
        Self { quiet: true, watcher: Some(watcher) }
    }

    /// Whether nothing is to be said but warnings, errors and what was asked for.
    pub(crate) fn is_quiet(&self) -> bool {
        self.quiet
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
        match &self.watcher {
            Some(watcher) => watcher.warn(text),
            None => report(&format!("{WARNING}warning{WARNING:#}: {text}")),
        }
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
        if is_about_arguments(error) { Outcome::BadArguments } else { Outcome::Failed }
    }

    /// A bar for `length` steps of work with speed and time left; silent when stderr is no terminal.
    pub(crate) fn progress(&self, task: &'static str, unit: &str, length: usize) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let template =
            format!("{{msg:>12.bold}} {{wide_bar:.cyan/dim}} {{pos}}/{{len}} {unit} · {{speed}} · {{eta}} left");
        let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
        let speed = |state: &ProgressState, out: &mut dyn fmt::Write| _ = write!(out, "{}", in_words(state.per_sec()));
        let style = style.with_key("speed", speed);
        let bar = ProgressBar::with_draw_target(Some(length as u64), target)
            .with_style(style.progress_chars("━━╌"))
            .with_message(task);
        if let Some(watcher) = &self.watcher {
            watcher.show(task, &bar);
        }
        bar
    }
}

impl Terminal {
    /// Shows that a task without steps goes on; silent when stderr is no terminal.
    pub(crate) fn busy(&self, task: &'static str) -> ProgressBar {
        let bar = self.progress(task, "", 0);
        bar.set_style(
            ProgressStyle::with_template("{msg:>12.bold} {spinner} {elapsed}")
                .unwrap_or_else(|_| ProgressStyle::default_spinner()),
        );
        bar.enable_steady_tick(Duration::from_millis(100));
        bar
    }
}

/// Whether arguments or configuration are to blame, rather than data or files.
#[must_use]
pub fn is_about_arguments(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<BadArguments>()
            || cause.is::<ConfigError>()
            || cause.is::<SimulationError>()
            || matches!(cause.downcast_ref(), Some(OdometryError::Setting { .. }))
    })
}

/// How many a second, with as many digits as can be read.
fn in_words(per_second: f64) -> String {
    let digits = if per_second < 10.0 { 1 } else { 0 };
    format!("{per_second:.digits$}/s")
}

/// Columns of the terminal that results go to; without end where they go elsewhere.
fn width_of_results() -> usize {
    terminal_size::terminal_size_of(io::stdout()).map_or(usize::MAX, |(width, _)| usize::from(width.0))
}

/// Prose among the results, broken between words to fit the terminal and in one line where it goes elsewhere; all lines
/// but the first begin with `indent` blanks, for which the first has room to spare.
pub(crate) fn prose(text: &str, indent: usize) -> String {
    wrapped(text, indent, width_of_results())
}

/// Markdown whose paragraphs are broken to fit the terminal; tables keep their lines.
pub(crate) fn markdown(text: &str) -> String {
    fitted_markdown(text, width_of_results())
}

fn fitted_markdown(text: &str, width: usize) -> String {
    let fitted = |line: &str| if line.starts_with('|') { line.to_owned() } else { wrapped(line, 0, width) };
    text.split('\n').map(fitted).collect::<Vec<_>>().join("\n")
}

/// The text in lines of at most `width` columns, broken between words; all but the first begin with `indent`
/// blanks, for which the first has room to spare. A longer word has a line of its own.
fn wrapped(text: &str, indent: usize, width: usize) -> String {
    if indent.saturating_add(columns(text)) <= width {
        return text.to_owned();
    }
    let mut lines = String::new();
    let mut column = indent;
    for word in text.split(' ') {
        let length = columns(word);
        if column > indent && column + 1 + length > width {
            lines.push('\n');
            lines.push_str(&" ".repeat(indent));
            column = indent;
        } else if column > indent {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += length;
    }
    lines
}

/// Columns that a text takes: styles take none.
fn columns(text: &str) -> usize {
    strip_str(text).map(|part| part.chars().count()).sum()
}

/// Writes prose to stderr, broken to fit the terminal there. Where even that is impossible, nobody is left to be told.
fn report(text: &str) {
    let width = terminal_size::terminal_size_of(io::stderr()).map_or(usize::MAX, |(width, _)| usize::from(width.0));
    for line in text.split('\n') {
        let _ = writeln!(anstream::stderr(), "{}", wrapped(line, 0, width));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_broken_between_words_only() {
        assert_eq!(
            wrapped("RMSE 0.0123 m, 0.123° (largest 0.1 m)", 4, 20),
            "RMSE 0.0123 m,\n    0.123° (largest\n    0.1 m)"
        );
        assert_eq!(wrapped("a/very/long/path/that/has/no/blank b", 2, 10), "a/very/long/path/that/has/no/blank\n  b");
        assert_eq!(wrapped("", 2, 10), "");
        assert_eq!(wrapped("  what fits stays", 0, 17), "  what fits stays");
        assert_eq!(
            wrapped(&format!("{ERROR}error{ERROR:#}: no scan"), 0, 14),
            format!("{ERROR}error{ERROR:#}: no scan")
        );
    }

    #[test]
    fn paragraphs_of_markdown_are_broken_and_tables_are_not() {
        let text = "Means over the seeds.\n\n| a | long table |\n";
        assert_eq!(fitted_markdown(text, 12), "Means over\nthe seeds.\n\n| a | long table |\n");
    }

    #[test]
    fn speeds_can_be_read() {
        assert_eq!([561.8812, 3.1251, 0.0].map(in_words), ["562/s", "3.1/s", "0.0/s"]);
    }
}
