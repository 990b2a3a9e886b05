//! `floorprint map info`.

use super::{Stored, map_path};
use crate::outcome::Outcome;
use crate::terminal::Terminal;
use clap::Args;
use floorprint::map::Occupancy;
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

/// Arguments of `map info`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Session file, or the folder of the run that left it.
    #[arg(value_parser = map_path())]
    session: PathBuf,
}

impl Arguments {
    pub(super) fn execute(&self, terminal: &Terminal) -> anyhow::Result<Outcome> {
        let stored = Stored::load(&self.session)?;
        let session = &stored.session;
        let trajectory = session.trajectory();
        let steps = trajectory.windows(2).map(|pair| pair[0].pose.between(&pair[1].pose).distance());
        let (length_m, bytes) = (steps.sum::<f64>(), fs::metadata(&self.session)?.len());
        let scans = session.scans();
        let scan_bytes: usize = scans.iter().map(|scan| scan.points.packed_len()).sum();
        let mut out = terminal.results();
        writeln!(out, "session     {} ({:.1} MB)", self.session.display(), bytes as f64 * 1e-6)?;
        if let (Some(first), Some(last)) = (trajectory.first(), trajectory.last()) {
            writeln!(
                out,
                "trajectory  {length_m:.1} m, {} frames, stamps {:.3} to {:.3} s",
                trajectory.len(),
                first.stamp_s,
                last.stamp_s
            )?;
        }
        let mean = scan_bytes as f64 / scans.len().max(1) as f64;
        writeln!(out, "key scans   {} ({mean:.0} bytes each)", scans.len())?;
        if let Some(places) = session.places() {
            let closures = places.reports();
            let closed = closures.iter().filter(|closure| closure.verdict == floorprint::back_end::Verdict::Accepted);
            writeln!(out, "submaps     {}, {} loops closed", places.submaps().len(), closed.count())?;
            for kidnapping in places.kidnappings() {
                let state =
                    if kidnapping.found.is_some() { "placed on what was seen before" } else { "not placed yet" };
                writeln!(out, "break       before frame {}: {state}", kidnapping.frame)?;
            }
        }
        let map = stored.map(&self.session)?;
        let free = map.cells.iter().filter(|&&cell| cell == Occupancy::Free).count();
        writeln!(
            out,
            "map         {}×{} cells of {} m, {:.1} m² free",
            map.width,
            map.height,
            map.resolution_m,
            free as f64 * map.resolution_m.powi(2)
        )?;
        if let Some(angle_rad) = session.angle_to_walls(&stored.config.matcher) {
            writeln!(out, "walls       along the axes once turned by {:.1}°", angle_rad.to_degrees())?;
        }
        if let Some(floor) = &stored.floor {
            let painted = floor.cells.iter().flatten().count() as f64 * floor.resolution_m.powi(2);
            writeln!(out, "floor       {painted:.1} m² painted")?;
        }
        Ok(Outcome::Fine)
    }
}
