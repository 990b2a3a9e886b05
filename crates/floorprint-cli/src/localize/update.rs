//! `localize --update`: what changed is kept apart, proposed, and put into a new session only on request.

use crate::map::{Stored, diff, is_session};
use crate::outcome::BadArguments;
use anyhow::{Context as _, ensure};
use floorprint::geometry::Polygon;
use floorprint::localization::{LocalizationReport, MapChange, MapChanges};
use floorprint::map::{Change, ChangedPatch, MapConfig, Occupancy, Raster};
use floorprint::session::Region;
use floorprint::{Frame, Slam};
use floorprint_io::{DataSet, write_file, write_png};
use serde::Serialize;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Poses that are more probably wrong than this show no changes.
const LARGEST_LOST_PROBABILITY: f64 = 0.01;

/// What changed, as a drive shows it.
pub(super) struct Update {
    changes: MapChanges,
    start_s: Option<f64>,
    scans: usize,
}

/// A patch that changed, as a report lists it; the outlines are in `changes.geojson`.
#[derive(Debug, Serialize)]
pub(super) struct Listed {
    /// `new` or `gone`.
    change: &'static str,
    area_m2: f64,
    /// Stamps of the first and of the last scan that showed it, seconds.
    first_seen_s: f64,
    last_seen_s: f64,
}

impl Update {
    pub(super) fn new(map: &Raster<Occupancy>, config: &MapConfig) -> Self {
        Self { changes: MapChanges::new(map.clone(), config), start_s: None, scans: 0 }
    }

    /// Takes in a scan where its pose is certain.
    pub(super) fn observe(&mut self, frame: &Frame, step: &LocalizationReport) {
        self.start_s.get_or_insert(frame.stamp_s);
        if let Some(pose) = step.pose.filter(|_| step.lost_probability < LARGEST_LOST_PROBABILITY) {
            self.scans += usize::from(self.changes.observe(frame.stamp_s, &pose, &frame.scan));
        }
    }

    pub(super) fn found(self) -> Found {
        let map = self.changes.map();
        let changes = self.changes.found(diff::TOLERANCE_M, diff::least_area_m2(map, map));
        Found { changes, map: self.changes.map().clone(), start_s: self.start_s.unwrap_or(0.0), scans: self.scans }
    }
}

/// What was found to have changed.
pub(super) struct Found {
    changes: Vec<MapChange>,
    map: Raster<Occupancy>,
    start_s: f64,
    scans: usize,
}

impl Found {
    fn dated(&self, from_s: f64) -> impl Iterator<Item = (&ChangedPatch, Option<[f64; 2]>)> + Clone {
        self.changes
            .iter()
            .map(move |change| (&change.patch, Some([change.first_seen_s - from_s, change.last_seen_s - from_s])))
    }

    /// As the report has them.
    pub(super) fn listed(&self) -> Vec<Listed> {
        let listed = |change: &MapChange| Listed {
            change: diff::word(change.patch.change),
            area_m2: change.patch.area_m2,
            first_seen_s: change.first_seen_s,
            last_seen_s: change.last_seen_s,
        };
        self.changes.iter().map(listed).collect()
    }

    /// Writes `changes.geojson` and `changes.png`.
    pub(super) fn write(&self, folder: &Path) -> anyhow::Result<()> {
        let document = diff::geojson(self.dated(0.0)).to_string() + "\n";
        write_file(&folder.join("changes.geojson"), document.as_bytes())?;
        let figure = diff::figure(&self.map, self.changes.iter().map(|change| &change.patch));
        write_png(&folder.join("changes.png"), &figure.into_picture())?;
        Ok(())
    }

    /// Prints them as `map diff` does; times count from the start of the drive.
    pub(super) fn print(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "changes of the map, which stays as it is ({} scans looked at):", self.scans)?;
        diff::print(out, self.dated(self.start_s))
    }

    /// Writes a new session: that of the map with the drive appended, without what is gone.
    ///
    /// # Errors
    /// The session cannot be gone on with, the drive is not recognised on it, or the file cannot be written.
    pub(super) fn write_session(&self, map: &Path, data_set: &DataSet, out: &Path) -> anyhow::Result<()> {
        let mut stored = Stored::load(map)?;
        let cannot = || format!("cannot update {}", map.display());
        let offset = stored.session.frames();
        let mut slam = Slam::resume(stored.session, &stored.config).with_context(cannot)?;
        slam.interrupt();
        let frames = data_set.frames(&stored.config)?;
        for frame in frames.iter() {
            // What cannot be used was told when it was localised.
            let _ = slam.process(&frame);
        }
        let result = slam.finish();
        let place = result.kidnappings.iter().find(|kidnapping| kidnapping.frame == offset);
        ensure!(
            place.is_none_or(|kidnapping| kidnapping.found.is_some()),
            "{}: the drive was not recognised on it, so that no session is written",
            cannot()
        );
        stored.session = result.session;
        for change in self.changes.iter().filter(|change| change.patch.change == Change::Gone) {
            for outline in &change.patch.outlines_m {
                let Ok(polygon) = Polygon::new(outline.clone()) else { continue };
                let region = Region::Outside(polygon);
                stored.session = stored.session.restricted_to(&region, &stored.config.matcher).with_context(cannot)?;
            }
        }
        // What the floor was painted with is not of this drive.
        stored.save_as_new(out)
    }
}

/// That a new session can be written before an hour of work.
pub(super) fn check(map: &Path, out: &Path) -> anyhow::Result<()> {
    if !is_session(map) {
        let text = format!("{} is no session: only a session can be updated to a new one", map.display());
        return Err(BadArguments(text).into());
    }
    ensure!(
        fs::symlink_metadata(out).is_err(),
        "{}: a file stands there. Choose another name, or remove it",
        out.display()
    );
    Ok(())
}
