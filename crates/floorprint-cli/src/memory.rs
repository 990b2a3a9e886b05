//! `--memory`: how much of a session lies in memory.

use crate::outcome::BadArguments;
use crate::solved::keeps_session;
use crate::terminal::Terminal;
use anyhow::{Context as _, bail};
use clap::Args;
use floorprint::Config;
use floorprint::storage::{StorageTrouble, Store};
use floorprint_io::ScratchFile;
use std::path::Path;

/// How much of a session lies in memory.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(crate) struct Memory {
    /// Key scans, looks of places and poses take at most about this much memory, megabytes; older ones go to a file without a
    /// name on the disk of the results and come back when they are needed. Results are the same [default: all in memory].
    #[arg(long = "memory", value_name = "MB", value_parser = clap::value_parser!(u32).range(1..))]
    most_mb: Option<u32>,
}

impl Memory {
    /// The store beside the results `out`, and how much lies in memory, bytes; `None` where that is not bounded.
    ///
    /// # Errors
    /// No file can be made there; the configured filter keeps no session.
    pub(crate) fn store(self, out: &Path, config: &Config) -> anyhow::Result<Option<(Box<dyn Store>, usize)>> {
        let Some(most_mb) = self.most_mb else { return Ok(None) };
        if !keeps_session(config) {
            let message = "--memory needs filter.kind = \"rao_blackwellized\" with loop_closure.enabled";
            return Err(BadArguments(message.to_owned()).into());
        }
        let folder = out.parent().unwrap_or(Path::new(""));
        let store = ScratchFile::create_in(folder).context("--memory needs a file beside the results")?;
        Ok(Some((Box::new(store), most_mb as usize * 1_000_000)))
    }
}

/// Tells once when a disk is full.
#[derive(Debug, Default)]
pub(crate) struct StorageWatch {
    has_told: bool,
}

impl StorageWatch {
    /// Looks at what is wrong.
    ///
    /// # Errors
    /// What was put away is lost: nothing that comes of the drive is to be relied on.
    pub(crate) fn look(&mut self, trouble: Option<StorageTrouble>, terminal: &Terminal) -> anyhow::Result<()> {
        match trouble {
            Some(StorageTrouble::Lost(why)) => {
                bail!("{why}; the drive cannot go on without it: run it again with more --memory, or none")
            }
            Some(StorageTrouble::Full(why)) if !self.has_told => {
                self.has_told = true;
                terminal.warn(&format!("all of the session stays in memory from now on: {why}"));
            }
            _ => {}
        }
        Ok(())
    }
}
