//! The report's figures 1 and 2 over time: the map so far, dead reckoning in blue, the best
//! particle in red, every few seconds of the drive; one picture each and one animated picture.

use crate::figure::{DEAD_RECKONING, Figure, TRAJECTORY};
use anyhow::Context as _;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint::{Slam, StepReport};
use floorprint_io::{Picture, write_animated_png, write_png};
use std::fs;
use std::path::Path;

/// How long the animation shows each picture, seconds.
const FRAME_S: f64 = 0.4;

/// What was there at one moment.
struct Moment {
    stamp_s: f64,
    map: Raster<Occupancy>,
    /// How many steps had been taken.
    steps: usize,
    /// The trajectory as it was known then.
    trajectory: Vec<StampedPose>,
}

/// Collects moments on the way and draws them at the end, when the map's extent is known.
pub(crate) struct Snapshots {
    every_s: f64,
    moments: Vec<Moment>,
}

impl Snapshots {
    /// One picture every `every_s` seconds of the drive.
    pub(crate) fn new(every_s: f64) -> Self {
        Self { every_s, moments: Vec::new() }
    }

    /// Keeps the map when the next picture is due.
    pub(crate) fn observe(&mut self, slam: &mut Slam, steps: &[StepReport]) {
        let Some(now) = steps.last() else { return };
        let due = self.moments.last().is_none_or(|last| now.stamp_s >= last.stamp_s + self.every_s);
        if due && let Some(map) = slam.map().to_raster() {
            let trajectory = slam.trajectory();
            self.moments.push(Moment { stamp_s: now.stamp_s, map, steps: steps.len(), trajectory });
        }
    }

    /// Writes `0000.png` … and `animation.png` into a folder, which is made.
    ///
    /// # Errors
    /// A picture cannot be written.
    pub(crate) fn write(&self, folder: &Path, steps: &[StepReport]) -> anyhow::Result<()> {
        fs::create_dir(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let pictures: Vec<Picture> = self.moments.iter().map(|moment| self.draw(moment, steps)).collect();
        for (index, picture) in pictures.iter().enumerate() {
            write_png(&folder.join(format!("{index:04}.png")), picture)?;
        }
        if !pictures.is_empty() {
            write_animated_png(&folder.join("animation.png"), &pictures, FRAME_S)?;
        }
        Ok(())
    }

    fn draw(&self, moment: &Moment, steps: &[StepReport]) -> Picture {
        let mut figure = Figure::of_map(&self.on_common_ground(&moment.map));
        let steps = &steps[..moment.steps];
        figure.draw_line(steps.iter().map(|step| [step.dead_reckoning.x, step.dead_reckoning.y]), DEAD_RECKONING, 2.0);
        figure.draw_line(moment.trajectory.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]), TRAJECTORY, 2.0);
        if let Some(now) = moment.trajectory.last() {
            figure.draw_disc([now.pose.x, now.pose.y], TRAJECTORY, 5.0);
        }
        figure.into_picture()
    }

    /// A map enlarged to the extent of all moments, so that all pictures are of one size.
    fn on_common_ground(&self, map: &Raster<Occupancy>) -> Raster<Occupancy> {
        let resolution_m = map.resolution_m;
        let low = |axis: usize| self.moments.iter().map(|m| m.map.origin_m[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize, cells: fn(&Raster<Occupancy>) -> usize| {
            let ends = self.moments.iter().map(|m| m.map.origin_m[axis] + cells(&m.map) as f64 * resolution_m);
            ends.fold(f64::NEG_INFINITY, f64::max)
        };
        let origin_m = [low(0), low(1)];
        let cells = |from: f64, to: f64| ((to - from) / resolution_m).round().max(0.0) as usize;
        let (width, height) = (cells(origin_m[0], high(0, |m| m.width)), cells(origin_m[1], high(1, |m| m.height)));
        let ground = Raster { width, height, resolution_m, origin_m, cells: vec![(); width * height] };
        ground.map(|_, center_m| map.at(center_m).copied().unwrap_or_default())
    }
}
