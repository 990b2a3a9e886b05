//! `floorprint completions` and `floorprint man`: what shells and manuals need.

use crate::outcome::Outcome;
use crate::terminal::Terminal;
use clap::{Args, Command};
use clap_complete::Shell;
use std::io::Write;

/// Print completions for a shell.
#[derive(Args)]
pub(crate) struct Completions {
    /// The shell.
    shell: Shell,
}

/// Runs `floorprint completions`.
pub(crate) fn completions(
    arguments: &Completions,
    mut program: Command,
    terminal: &Terminal,
) -> anyhow::Result<Outcome> {
    // The generator cannot report a closed pipe, so it writes into memory.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, "floorprint", &mut script);
    terminal.results().write_all(&script)?;
    Ok(Outcome::Fine)
}

/// Runs `floorprint man`.
pub(crate) fn man(program: Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    clap_mangen::Man::new(program).render(&mut terminal.results())?;
    Ok(Outcome::Fine)
}
