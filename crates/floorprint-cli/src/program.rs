//! How the program was called, and how it starts itself.

use std::ffi::OsString;
use std::io;
use std::process::Command;
use std::sync::OnceLock;

/// How the program is called: by itself, or as part of another one.
#[derive(Debug, Clone)]
pub struct Program {
    /// What starts it; empty for its own binary.
    start: Vec<OsString>,
    /// The arguments that follow.
    arguments: Vec<OsString>,
}

/// There is one process, and it was called in one way.
static CALLED: OnceLock<Program> = OnceLock::new();

impl Program {
    /// The program is the process.
    #[must_use]
    pub fn itself() -> Self {
        Self { start: Vec::new(), arguments: std::env::args_os().skip(1).collect() }
    }

    /// The program is part of another one, which `start` starts so that it does what `arguments` say.
    #[must_use]
    pub fn part_of(start: Vec<OsString>, arguments: Vec<OsString>) -> Self {
        Self { start, arguments }
    }

    /// Keeps how it was called, for as long as the process lives.
    pub(crate) fn remember(&self) {
        // Of two calls in one process the first counts: both start the program in the same way.
        let _ = CALLED.set(self.clone());
    }

    /// Name and arguments, as they are parsed.
    pub(crate) fn words(&self) -> impl Iterator<Item = OsString> {
        std::iter::once(OsString::from("floorprint")).chain(self.arguments.iter().cloned())
    }

    /// The arguments of this process's command line; nothing where another program calls functions.
    pub(crate) fn arguments() -> &'static [OsString] {
        CALLED.get().map_or(&[], |program| &program.arguments)
    }

    /// A command that starts the program anew, its arguments still to be given.
    ///
    /// # Errors
    /// The system does not say which program this is.
    pub(crate) fn command() -> io::Result<Command> {
        match CALLED.get().and_then(|program| program.start.split_first()) {
            Some((program, arguments)) => {
                let mut command = Command::new(program);
                command.args(arguments);
                Ok(command)
            }
            None => Ok(Command::new(std::env::current_exe()?)),
        }
    }
}
