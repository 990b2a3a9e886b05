//! `floorprint map merge`.

use super::{Stored, ensure_free};
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::Args;
use floorprint::Slam;
use std::io::Write as _;
use std::path::PathBuf;

/// Arguments of `map merge`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Session that stays where it is.
    first: PathBuf,
    /// Session that is looked for on it.
    second: PathBuf,
    /// Session file to write.
    #[arg(long, value_name = "SESSION")]
    out: PathBuf,
}

impl Arguments {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        ensure_free(&self.out)?;
        let (first, second) = (Stored::load(&self.first)?, Stored::load(&self.second)?);
        let offset = first.session.frames();
        let merged = Slam::resume(first.session, &first.config)
            .and_then(|slam| slam.append(&second.session, &first.config))
            .with_context(|| format!("cannot merge {} and {}", self.first.display(), self.second.display()))?;
        let result = merged.finish();
        let place = result.kidnappings.iter().find(|kidnapping| kidnapping.frame == offset);
        let is_placed = place.is_none_or(|kidnapping| kidnapping.found.is_some());
        Stored { session: result.session, config: first.config, floor: first.floor }.save(&self.out)?;
        let mut out = terminal.results();
        if is_placed {
            writeln!(out, "{} was placed on {}", self.second.display(), self.first.display())?;
        } else {
            writeln!(
                out,
                "{} was not recognised on {}: both are in {}, how they lie to each other is not known",
                self.second.display(),
                self.first.display(),
                self.out.display()
            )?;
        }
        Ok(Outcome::Fine)
    }
}
