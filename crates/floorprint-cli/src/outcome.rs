//! How a command ended, as the shell sees it.

use std::fmt;
use std::process::ExitCode;

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All is well.
    Fine,
    /// It could not do what was asked.
    Failed,
    /// What was asked makes no sense: arguments or configuration.
    BadArguments,
    /// It finished, but more data were dropped than allowed.
    DataDropped,
    /// The user stopped it; what was computed so far is kept.
    Interrupted,
}

/// Why arguments or configuration make no sense.
#[derive(Debug)]
pub(crate) struct BadArguments(pub(crate) String);

impl fmt::Display for BadArguments {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for BadArguments {}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(outcome.code())
    }
}

impl Outcome {
    /// The exit code.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Fine => 0,
            Self::Failed => 1,
            Self::BadArguments => 2,
            Self::DataDropped => 3,
            // What shells give a program that SIGINT ended.
            Self::Interrupted => 130,
        }
    }
}
