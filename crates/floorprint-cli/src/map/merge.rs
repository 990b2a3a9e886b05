//! `floorprint map merge`.

use super::{Placement, Stored, ensure_free, map_path};
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::Args;
use std::io::Write as _;
use std::path::PathBuf;

/// Arguments of `map merge`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Session that stays where it is: a file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    first: PathBuf,
    /// Session that is looked for on it.
    #[arg(value_parser = map_path())]
    second: PathBuf,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

impl Arguments {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        ensure_free(&self.out)?;
        let (first, second) = (Stored::load(&self.first)?, Stored::load(&self.second)?);
        let (merged, placement) = first
            .merged(&second)
            .with_context(|| format!("cannot merge {} and {}", self.first.display(), self.second.display()))?;
        merged.save_as_new(&self.out)?;
        let mut out = terminal.results();
        if placement == Placement::Placed {
            writeln!(out, "{} was placed on {}", self.second.display(), self.first.display())?;
        } else {
            writeln!(
                out,
                "{} was not recognised on {}: both are in {}, how they lie to each other is not known",
                self.second.display(),
                self.first.display(),
                self.out.display()
            )?;
            if !second.annotations.is_empty() {
                writeln!(out, "its places and keep-out areas are left out: draw them in {} anew", self.out.display())?;
            }
        }
        Ok(Outcome::Fine)
    }
}
