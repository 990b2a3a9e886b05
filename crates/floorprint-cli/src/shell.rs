//! `floorprint completions` and `floorprint man`: what shells and manuals need.

use crate::outcome::{BadArguments, Outcome};
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::{Args, Command};
use clap_complete::Shell;
use floorprint_io::write_file;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

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

/// Print the manual page of the program or of one of its commands.
#[derive(Args)]
pub(crate) struct Manual {
    /// The command, e.g. `run` or `evaluate map`.
    command: Vec<String>,
    /// Write the pages of all commands into this folder instead.
    #[arg(long, value_name = "DIR", conflicts_with = "command")]
    out: Option<PathBuf>,
}

/// Runs `floorprint man`.
pub(crate) fn man(arguments: &Manual, mut program: Command, terminal: &Terminal) -> anyhow::Result<Outcome> {
    program.build();
    if let Some(folder) = &arguments.out {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        return write_pages(&program, folder).map(|()| Outcome::Fine);
    }
    let mut chosen = &program;
    for name in &arguments.command {
        chosen = visible(chosen).find(|command| command.get_name() == name).ok_or_else(|| {
            let known: Vec<&str> = visible(chosen).map(Command::get_name).collect();
            BadArguments(format!("there is no command {name}; expected one of: {}", known.join(", ")))
        })?;
    }
    terminal.results().write_all(&page(chosen)?)?;
    Ok(Outcome::Fine)
}

/// The commands of a program that are listed in its help.
fn visible(program: &Command) -> impl Iterator<Item = &Command> {
    program.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help")
}

/// The manual page of a program or of one of its commands.
fn page(command: &Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
    clap_mangen::Man::new(command.clone()).title(name).render(&mut page)?;
    Ok(page)
}

/// Writes the page of a program and those of its commands.
fn write_pages(command: &Command, folder: &Path) -> anyhow::Result<()> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    write_file(&folder.join(format!("{name}.1")), &page(command)?)?;
    visible(command).try_for_each(|command| write_pages(command, folder))
}
