//! Frames, front end and back end each on a core of their own.
//!
//! The front end needs nothing of the back end, and a frame nothing of the front end: what one of them has done goes to
//! the next through a channel, and the results are to the bit those of one after the other.

use super::{Slam, SlamError, StepReport, Tracked, check, remember};
use crate::frame::Frame;
use crate::front_end::PreparedScan;
use crate::profiler::{Phase, Profiler};
use std::sync::mpsc::sync_channel;
use std::thread;

/// Frames that are handed on together: waking a thread that waits takes about as long as tracking a frame …
const BATCH: usize = 16;
/// … and how many batches may wait between one thread and the next.
const QUEUE: usize = 4;

impl Slam {
    /// Takes in up to `most` of the frames, which are made, tracked and mapped on three threads. `profilers` are told
    /// what each of these is at, and when it is done with a frame.
    ///
    /// The reports are those that [`process`](Self::process) would give, one for each frame.
    pub fn process_side_by_side(
        &mut self,
        frames: &mut (dyn Iterator<Item = Frame> + Send),
        most: usize,
        profilers: [&mut (dyn Profiler + Send); 3],
    ) -> Vec<Result<StepReport, SlamError>> {
        let Self { front_end, session, back_end, settled, stop, .. } = self;
        let [making, tracking, mapping] = profilers;
        let thinning = front_end.thinning();
        let (first, keeps_points) = (*settled, back_end.is_some());
        let (made, to_track) = sync_channel::<Vec<(Frame, Option<PreparedScan>)>>(QUEUE);
        let (tracked, to_map) = sync_channel::<Vec<Result<Tracked, SlamError>>>(QUEUE);
        let (back_end, newly_settled) = (back_end.as_mut(), &mut *settled);
        let reports = thread::scope(|scope| {
            scope.spawn(move || {
                let mut make = || {
                    making.enter(Phase::Synchronise);
                    let frame = frames.next()?;
                    // What is skewed yet is undone by the filter, which alone knows how the body moves.
                    let thinning = thinning.as_ref().filter(|_| frame.scan.skew.is_none());
                    let prepared = thinning.map(|thinning| PreparedScan::of(&frame.scan, thinning));
                    making.end_of_frame();
                    Some((frame, prepared))
                };
                let mut left = most;
                while left > 0 {
                    let batch: Vec<_> = (0..left.min(BATCH)).map_while(|_| make()).collect();
                    left -= batch.len();
                    let is_last = batch.len() < BATCH;
                    if made.send(batch).is_err() || is_last {
                        break;
                    }
                }
            });
            let mapper = scope.spawn(move || {
                let (mut back_end, settled) = (back_end, newly_settled);
                let mut reports = Vec::with_capacity(most);
                for tracked in to_map.into_iter().flatten() {
                    mapping.enter(Phase::LoopClosure);
                    let report = tracked.map(|mut tracked| {
                        let poses = std::mem::take(&mut tracked.poses);
                        let poses_since = |frame: usize| poses[(frame - first).min(poses.len())..].to_vec();
                        let back_end = back_end.as_deref_mut().filter(|_| !stop.is_given());
                        remember(tracked, poses_since, session, back_end, settled)
                    });
                    reports.push(report);
                    mapping.end_of_frame();
                }
                reports
            });
            for batch in to_track {
                let track = |(frame, prepared): (Frame, Option<PreparedScan>)| {
                    let outcome = check(&frame).map(|()| {
                        let step = front_end.process(&frame, prepared, tracking);
                        let mut tracked = Tracked::of(&frame, step, front_end, keeps_points);
                        if tracked.key_scan.is_some() {
                            tracked.poses = front_end.poses_since(first);
                        }
                        tracked
                    });
                    tracking.end_of_frame();
                    outcome
                };
                if tracked.send(batch.into_iter().map(track).collect()).is_err() {
                    break;
                }
            }
            drop(tracked);
            mapper.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        self.front_end.forget_poses_before(self.settled);
        reports
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::frame::Skew;
    use crate::geometry::Pose2;
    use crate::profiler::NoProfiler;
    use crate::scan_matcher::synthetic::{Walls, frame, poses_along};

    /// Two laps through a room with odometry that errs; the scan of one frame is broken.
    fn frames() -> Vec<Frame> {
        let corners: Vec<[f64; 2]> =
            (0..9).map(|k| [[-1.5, -1.0], [1.5, -1.0], [1.5, 1.0], [-1.5, 1.0]][k % 4]).collect();
        let truth = poses_along(&corners, 0.12);
        let odometry = |k: usize| {
            let step = if k == 0 { Pose2::IDENTITY } else { truth[k - 1].between(&truth[k]) };
            step.compose(&Pose2::new(0.004, -0.003, 0.002))
        };
        let room = Walls::room();
        let mut frames: Vec<Frame> =
            (0..truth.len()).map(|k| frame(k, Some(odometry(k)), room.scan_from(&truth[k], 181))).collect();
        frames[40].scan.hits.x_m[3] = f32::NAN;
        frames
    }

    /// The same frame with points that were seen one after the other, over the time from scan to scan.
    fn without_odometry(mut frame: Frame) -> Frame {
        let hits = frame.scan.hits.len();
        let hits_s = (0..hits).map(|hit| 0.1 * hit as f32 / hits as f32 - 0.05).collect();
        frame.scan.skew = Some(Skew { hits_s, free_ends_s: vec![0.0; frame.scan.free_ends.len()] });
        Frame { motion: None, ..frame }
    }

    #[test]
    fn side_by_side_and_one_after_the_other_are_the_same() {
        for (particles, has_odometry) in [(1, true), (3, true), (1, false), (3, false)] {
            let mut config = Config::default();
            config.filter.particles = particles;
            let frames = || if has_odometry { frames() } else { frames().into_iter().map(without_odometry).collect() };
            let (mut one_by_one, mut side_by_side) = (Slam::new(&config), Slam::new(&config));
            let expected: Vec<_> = frames().iter().map(|frame| one_by_one.process(frame)).collect();
            let (mut frames, mut reports) = (frames().into_iter(), Vec::new());
            loop {
                let mut profilers = [NoProfiler; 3];
                let more = side_by_side.process_side_by_side(&mut frames, 50, profilers.each_mut().map(|p| p as _));
                if more.is_empty() {
                    break;
                }
                reports.extend(more);
            }
            assert!(reports[40].is_err());
            assert_eq!(reports, expected);
            let (expected, result) = (one_by_one.finish(), side_by_side.finish());
            assert_eq!(result.trajectory, expected.trajectory);
            assert_eq!(result.map.to_raster().unwrap().cells, expected.map.to_raster().unwrap().cells);
        }
    }
}
