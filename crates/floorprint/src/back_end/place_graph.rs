//! What closing loops knows of a drive, and all of it that outlives a step: submaps, what they were compared with,
//! and the hypotheses about how they lie to each other.

use super::hypothesis::{Attached, Hypothesis, Kidnapping, kidnapped_covariance};
use super::place_match::{Comparison, Placement};
use super::submap::{Submap, SubmapBuilder};
use super::uncertainty::Uncertainty;
use super::{ClosureLoad, ClosureReport, Verdict};
use crate::compact_scan::CompactScan;
use crate::geometry::Pose2;
use crate::key_scan::{Drift, Interruption, KeyScan};
use crate::pose_graph::PoseGraph;
use crate::surface::{SurfaceScan, Thinning};
use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

/// The submaps of a drive, the comparisons between them, and the hypotheses that follow.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PlaceGraph {
    pub(super) builder: SubmapBuilder,
    /// They are stored one by one, beside the rest.
    #[serde(skip_serializing, default, deserialize_with = "submaps_of_version_1")]
    pub(super) submaps: Vec<Arc<Submap>>,
    /// Hypotheses about the drive, the heaviest first; at least one.
    pub(super) hypotheses: Vec<Hypothesis>,
    pub(super) comparisons: Vec<Comparison>,
    /// How many submaps were taken into the hypotheses.
    pub(super) taken: usize,
    /// What is being done about the newest of them.
    pub(super) job: Option<Job>,
    /// Submaps whose key scans are not wanted any more, as of the last piece of work.
    #[serde(skip)]
    pub(super) outdated: Vec<usize>,
    /// How uncertain the heaviest hypothesis is where in the world each submap in play lies.
    #[serde(default)]
    pub(super) in_the_world: Vec<Uncertainty>,
}

/// The comparisons of one submap.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Job {
    pub(super) newer: usize,
    /// Number of its first comparison.
    pub(super) first: usize,
    /// What each hypothesis uncertainties of the submaps it has in play.
    pub(super) uncertainties: Vec<Vec<Uncertainty>>,
    /// Comparisons to be made: older submap, where the newer is expected on it, how surely.
    pub(super) due: VecDeque<(usize, Pose2, Uncertainty)>,
}

/// A frame whose pose is known, from which those around it follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Which frame it is, counted from 0.
    pub frame: usize,
    /// Its pose, world from body.
    pub pose: Pose2,
    /// Where the robot was carried here from elsewhere: the first frame at the new place.
    pub interruption: Option<usize>,
}

/// Files of the first version hold the submaps in one piece with the rest.
fn submaps_of_version_1<'de, D: Deserializer<'de>>(file: D) -> Result<Vec<Arc<Submap>>, D::Error> {
    Ok(Vec::<Submap>::deserialize(file)?.into_iter().map(Arc::new).collect())
}

impl PlaceGraph {
    /// Nothing seen yet. Submaps are `submap_length_m` of path long, with surfaces kept in cells of `cell_m`; metres.
    #[must_use]
    pub fn new(submap_length_m: f64, cell_m: f64) -> Self {
        Self {
            builder: SubmapBuilder::new(submap_length_m, cell_m),
            submaps: Vec::new(),
            hypotheses: vec![Hypothesis::default()],
            comparisons: Vec::new(),
            taken: 0,
            job: None,
            outdated: Vec::new(),
            in_the_world: Vec::new(),
        }
    }

    /// Takes in the next key scan; tells whether a submap ended before it. `poses_since(frame)` are the front end's
    /// poses from that frame on.
    pub fn add(&mut self, key_scan: KeyScan, poses_since: impl FnOnce(usize) -> Vec<Pose2>) -> bool {
        let submap = self.builder.add(key_scan, poses_since);
        let has_ended = submap.is_some();
        self.submaps.extend(submap.map(Arc::new));
        has_ended
    }

    /// The submaps that have ended, in the order of the drive.
    #[must_use]
    pub fn submaps(&self) -> &[Arc<Submap>] {
        &self.submaps
    }

    /// Puts submaps in the place of those with the same numbers, or after the last one.
    pub(crate) fn replace_submaps(&mut self, others: impl Iterator<Item = (usize, Arc<Submap>)>) {
        for (number, other) in others {
            match self.submaps.get_mut(number) {
                Some(submap) => *submap = other,
                None => self.submaps.push(other),
            }
        }
    }

    /// The frame with which the submap in the making begins, counted from 0; `None` before the first key scan.
    #[must_use]
    pub fn open_since(&self) -> Option<usize> {
        self.builder.first_frame()
    }

    /// Learns again what the submaps look like, and fills the scans of the submap in the making: neither is stored.
    /// `surfaces` and `points` give what is kept of the key scan of a frame, `poses` are the front end's.
    ///
    /// # Errors
    /// What does not belong together, in words.
    pub(crate) fn restore(
        &mut self,
        poses: &[Pose2],
        frames: &[usize],
        scans: &[CompactScan],
        thinning: &Thinning,
    ) -> Result<(), &'static str> {
        self.validate(poses.len())?;
        let surfaces = |range: std::ops::Range<usize>| -> Vec<Arc<SurfaceScan>> {
            scans[range].par_iter().map(|scan| Arc::new(SurfaceScan::new(&scan.unpack(), thinning))).collect()
        };
        let position = |frame: usize| frames.partition_point(|&other| other < frame);
        let ends: Vec<usize> = self
            .submaps
            .iter()
            .skip(1)
            .map(|next| next.first)
            .chain([self.open_since().unwrap_or(poses.len())])
            .collect();
        let cell_m = self.builder.cell_m();
        let unseen = |submap: &Submap| !submap.is_forgotten && submap.is_forgotten();
        for (submap, &end) in self.submaps.iter_mut().zip(&ends).filter(|(submap, _)| unseen(submap)) {
            let range = position(submap.first)..position(end);
            let shown = surfaces(range.clone());
            let placed: Vec<(Pose2, &SurfaceScan)> = frames[range]
                .iter()
                .zip(&shown)
                .map(|(&frame, scan)| (submap.front_end_from_submap.between(&poses[frame]), scan.as_ref()))
                .collect();
            Arc::make_mut(submap).show(&placed, cell_m);
        }
        for key_scan in self.builder.open_mut() {
            let at =
                frames.binary_search(&key_scan.frame).map_err(|_| "a submap names a key scan that is not there")?;
            key_scan.points = scans[at].clone();
            key_scan.scan = Arc::new(SurfaceScan::new(&scans[at].unpack(), thinning));
        }
        Ok(())
    }

    /// Whether all numbers name what is there.
    fn validate(&self, frames: usize) -> Result<(), &'static str> {
        let holds = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(what) };
        let count = self.submaps.len();
        holds(!self.hypotheses.is_empty() && self.taken <= count, "the number of hypotheses or of submaps is wrong")?;
        holds(self.builder.is_valid(frames), "the submap in the making is no part of the drive")?;
        let firsts: Vec<usize> = self.submaps.iter().map(|submap| submap.first).chain(self.open_since()).collect();
        holds(firsts.is_sorted_by(|a, b| a < b), "submaps do not follow each other")?;
        let are_frames = self.submaps.iter().all(|submap| submap.first < frames && submap.middle_frame < frames);
        holds(are_frames, "a submap names a frame that is not there")?;
        let are_passes =
            |submap: &Arc<Submap>| submap.passes.iter().chain(&submap.shown_by).all(|&other| other < count);
        holds(self.submaps.iter().all(are_passes), "a pass over a submap is not there")?;
        let is_pair = |comparison: &Comparison| {
            comparison.older < count && comparison.newer < count && !comparison.placements.is_empty()
        };
        holds(self.comparisons.iter().all(is_pair), "a comparison names a submap that is not there")?;
        let is_job = self.job.as_ref().is_none_or(|job| {
            job.newer < count
                && job.first <= self.comparisons.len()
                && job.due.iter().all(|(older, ..)| *older < count)
                && job.uncertainties.len() == self.hypotheses.len()
                && job
                    .uncertainties
                    .iter()
                    .zip(&self.hypotheses)
                    .all(|(of, in_play)| of.len() == in_play.graph().poses().len())
        });
        holds(is_job, "the comparisons that are due name what is not there")?;
        let attached = self.submaps.iter().enumerate().filter_map(|(index, submap)| Some((index, submap.attached?)));
        let are_attached = |(index, attached): (usize, Attached)| {
            attached.submap == index && attached.older < index && index < self.taken
        };
        holds(attached.clone().all(are_attached), "a retired submap is attached to what is not there")?;
        let in_play = |index: usize| self.hypotheses.iter().any(|hypothesis| hypothesis.holds(index));
        holds(!attached.clone().any(|(index, _)| in_play(index)), "a submap is retired and is not")?;
        let left = self.taken - attached.count();
        self.hypotheses.iter().try_for_each(|hypothesis| hypothesis.validate([self.taken, left], &self.comparisons))
    }

    /// Whether an older submap was made so long before a newer one that it is no part of the same passage.
    pub(super) fn is_long_before(&self, older: &Submap, newer: usize, window_m: f64) -> bool {
        self.submaps[newer].path_m - older.path_m > 2.0 * window_m
    }

    /// How the heaviest hypothesis moves what the front end says: world from the front end's world.
    #[must_use]
    pub fn correction(&self) -> Pose2 {
        self.hypotheses[0].newest().map_or(Pose2::IDENTITY, |(newest, pose)| {
            pose.compose(&self.submaps[newest].front_end_from_submap.inverse())
        })
    }

    /// How uncertain the pose of the newest key scan is in the world.
    #[must_use]
    pub fn uncertainty(&self) -> Uncertainty {
        let newest = self.in_the_world.last().copied().unwrap_or_default();
        // The way from the newest submap that the hypotheses know to the one in the making is in neither of them. Where that
        // submap lies on known ground, it shows where its last key scan was taken.
        let mut is_known = self.hypotheses[0].newest_is_tied();
        let ended = self.submaps[self.taken..].iter().filter_map(|submap| submap.link.as_ref());
        let ways = ended.chain(self.builder.link()).map(|link| (&link.covariance, &link.drift, link.drift_after));
        let within_the_newest = (self.builder.covariance(), self.builder.drift(), Drift::default());
        let (mut since, mut drift) = (Uncertainty::default(), Drift::default());
        for (covariance, all, after) in ways.chain([within_the_newest]) {
            if std::mem::take(&mut is_known) {
                drift.add(&after);
            } else {
                since = since.and(&Uncertainty::of(covariance));
                drift.add(all);
            }
        }
        let stated = newest.and(&since).after(&drift);
        if self.is_suspected() { stated.and(&Uncertainty::of(&kidnapped_covariance())) } else { stated }
    }

    /// How uncertain each of the first `frames` poses of the drive is in the world: as much as the less certain one
    /// of the submaps before and after it, or as the newest key scan after the last one.
    #[must_use]
    pub fn uncertainties(&self, frames: usize) -> Vec<Uncertainty> {
        let in_play = self.hypotheses[0].in_play().zip(&self.in_the_world);
        let mut known = in_play.map(|((submap, _), uncertainty)| (self.submaps[submap].first, *uncertainty)).peekable();
        let mut before = Uncertainty::default();
        let newest = self.uncertainty();
        (0..frames)
            .map(|frame| {
                while let Some((_, here)) = known.next_if(|(first, _)| *first <= frame) {
                    before = here;
                }
                let after = known.peek().map_or(newest, |(_, after)| *after);
                if after.sigma_m > before.sigma_m { after } else { before }
            })
            .collect()
    }

    /// Learns anew how uncertain the heaviest hypothesis is.
    pub(super) fn learn_uncertainty(&mut self) {
        self.in_the_world = self.hypotheses[0].uncertainties_in_the_world(&self.submaps);
    }

    /// The drive as the heaviest hypothesis has it now.
    #[must_use]
    pub fn anchors(&self) -> Vec<Anchor> {
        let poses = self.hypotheses[0].all_poses(&self.submaps);
        let anchor = |(index, (submap, &pose)): (usize, (&Arc<Submap>, &Pose2))| Anchor {
            frame: submap.first,
            pose,
            interruption: submap.interruption.filter(|_| self.hypotheses[0].is_interrupted(index)).map(|at| at.frame),
        };
        self.submaps.iter().zip(&poses).enumerate().map(anchor).collect()
    }

    /// The frames, from the first to the one after the last, of submaps whose key scans are not wanted any more since
    /// this was last asked for.
    pub(crate) fn take_outdated(&mut self) -> Vec<Range<usize>> {
        let outdated = std::mem::take(&mut self.outdated);
        let first = |submap: usize| self.submaps.get(submap).map(|submap| submap.first);
        let frames = outdated.into_iter().filter_map(|submap| {
            let end = first(submap + 1).or_else(|| self.open_since())?;
            Some(first(submap)?..end)
        });
        frames.collect()
    }

    /// Bytes held: by what submaps look like and by what is remembered of each; by the comparisons; by the hypotheses.
    pub(crate) fn held_bytes(&self) -> [usize; 4] {
        let looks = self.submaps.iter().map(|submap| submap.held_bytes()).sum();
        let of_comparison =
            |comparison: &Comparison| size_of::<Comparison>() + comparison.placements.len() * size_of::<Placement>();
        let comparisons = self.comparisons.iter().map(of_comparison).sum();
        let hypotheses = self.hypotheses.iter().map(Hypothesis::held_bytes).sum();
        [looks, self.submaps.len() * size_of::<Submap>(), comparisons, hypotheses]
    }

    /// Whether the robot was kidnapped and has not been found again yet, or may have been: it is suspected to have been, and
    /// what it has seen since was not compared yet with what it saw before.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.coming_interruptions().next().is_some()
            || self.hypotheses[0].is_suspected()
            || self.hypotheses[0].is_lost()
    }

    /// Whether it may have been, and that is all that is known.
    fn is_suspected(&self) -> bool {
        self.coming_interruptions().any(|at| at.is_suspicion) || self.hypotheses[0].is_suspected()
    }

    /// The interruptions of which the hypotheses have not heard yet.
    fn coming_interruptions(&self) -> impl Iterator<Item = Interruption> {
        let coming = self.submaps[self.taken..].iter().filter_map(|submap| submap.interruption);
        coming.chain(self.builder.interruption())
    }

    /// What is worked with now.
    #[must_use]
    pub fn load(&self) -> ClosureLoad {
        let remembered = self.submaps.iter().filter(|submap| !submap.is_forgotten());
        let largest =
            |size: fn(&PoseGraph) -> usize| self.hypotheses.iter().map(|h| size(h.graph())).max().unwrap_or(0);
        ClosureLoad {
            submaps: remembered.count(),
            nodes: largest(|graph| graph.poses().len()),
            factors: largest(|graph| graph.between_factors().len()),
        }
    }

    /// How many hypotheses about the drive are held for possible.
    #[must_use]
    pub fn hypotheses(&self) -> usize {
        self.hypotheses.len()
    }

    /// Where the robot was kidnapped, as the heaviest hypothesis has it.
    #[must_use]
    pub fn kidnappings(&self) -> Vec<Kidnapping> {
        self.hypotheses[0].kidnappings(&self.submaps, &self.comparisons)
    }

    /// The heaviest hypothesis's graph; its nodes are the submaps.
    #[must_use]
    pub fn graph(&self) -> PoseGraph {
        self.hypotheses[0].whole_graph(&self.submaps)
    }

    /// What became of every comparison, as the heaviest hypothesis has it.
    #[must_use]
    pub fn reports(&self) -> Vec<ClosureReport> {
        let best = &self.hypotheses[0];
        let mut verdicts: Vec<(usize, Verdict)> = self
            .comparisons
            .iter()
            .map(|comparison| match &comparison.placements[0] {
                best if !best.fits() => (0, best.verdict),
                best if best.is_conclusive() => (0, Verdict::Elsewhere),
                _ => (0, Verdict::Inconclusive),
            })
            .collect();
        for closure in best.closures() {
            let verdict = if closure.is_in_force { Verdict::Accepted } else { Verdict::Contradicted };
            verdicts[closure.comparison] = (closure.placement, verdict);
        }
        self.comparisons
            .iter()
            .zip(verdicts)
            .map(|(comparison, (placement, verdict))| {
                let placement = &comparison.placements[placement];
                let [older, newer] = [comparison.older, comparison.newer].map(|index| &self.submaps[index]);
                let correction = comparison
                    .expected
                    .compose(&newer.middle)
                    .between(&placement.older_from_newer.compose(&newer.middle));
                ClosureReport {
                    older: comparison.older,
                    newer: comparison.newer,
                    frames: [older.middle_frame, newer.middle_frame],
                    uncertainty_m: comparison.uncertainty.sigma_m,
                    correction_m: correction.distance(),
                    correction_rad: correction.theta,
                    inlier_shares: placement.inlier_shares,
                    overlap_shares: placement.overlap_shares,
                    distinctness: placement.distinctness,
                    sigma_m: placement.sigma_m(),
                    placements: comparison.placements.iter().filter(|placement| placement.fits()).count(),
                    middle_from_middle: older
                        .middle
                        .inverse()
                        .compose(&placement.older_from_newer)
                        .compose(&newer.middle),
                    verdict,
                }
            })
            .collect()
    }
}
