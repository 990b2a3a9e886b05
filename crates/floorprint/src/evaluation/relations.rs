//! Error of a trajectory against relative poses known to be true
//! (Kümmerle et al. 2009, "On measuring the accuracy of SLAM algorithms").
//!
//! For a relation between the times *i* and *j* the error is
//! (x_i⁻¹ ∘ x_j) ⊖ δ_ij: what is left between the trajectory's own relative pose
//! and the true one. It does not depend on where the map's frame lies, and a fault
//! at one place is not charged to all that comes after.

use super::{ErrorStatistics, StampIndex};
use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use serde::Serialize;

/// A stamp of a relation means the pose whose stamp is nearest, up to this many
/// seconds away: the files round their stamps to 1e-5 s.
const STAMP_TOLERANCE_S: f64 = 1e-4;

/// Relations over at most this many seconds are *short*: they show local accuracy.
/// The others tie together separate visits of a place and show global consistency.
/// In the public benchmark hardly a relation lies between 5 and 20 s.
const SHORT_UP_TO_S: f64 = 10.0;

/// A true relative pose between two moments of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// Time of the first pose, seconds.
    pub first_stamp_s: f64,
    /// Time of the second pose, seconds; may lie before the first.
    pub second_stamp_s: f64,
    /// The second pose in the frame of the first.
    pub first_from_second: Pose2,
}

impl Relation {
    pub(super) fn is_short(&self) -> bool {
        (self.second_stamp_s - self.first_stamp_s).abs() <= SHORT_UP_TO_S
    }

    /// The same motion as a trajectory has it; `None` where it has no pose at one of the two times.
    pub(super) fn motion_of(&self, trajectory: &StampIndex) -> Option<Pose2> {
        let pose_at = |stamp_s| trajectory.nearest(stamp_s, STAMP_TOLERANCE_S).map(|stamped| stamped.pose);
        Some(pose_at(self.first_stamp_s)?.between(&pose_at(self.second_stamp_s)?))
    }
}

/// How far a relative pose is from the true one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseError {
    /// Length of the residual translation, metres.
    pub translation_m: f64,
    /// Size of the residual rotation, degrees.
    pub rotation_deg: f64,
}

impl PoseError {
    /// The error of `estimate` against `truth`, both in the same frame.
    #[must_use]
    pub fn between(truth: &Pose2, estimate: &Pose2) -> Self {
        let residual = truth.between(estimate);
        Self { translation_m: residual.distance(), rotation_deg: residual.theta.abs().to_degrees() }
    }
}

/// The error of each relation, in order; `None` where the trajectory has no pose
/// at one of its stamps.
///
/// The trajectory may be in any order, as stamps run backwards in some logs.
#[must_use]
pub fn relation_errors(trajectory: &[StampedPose], relations: &[Relation]) -> Vec<Option<PoseError>> {
    let index = StampIndex::new(trajectory);
    relations
        .iter()
        .map(|relation| Some(PoseError::between(&relation.first_from_second, &relation.motion_of(&index)?)))
        .collect()
}

/// The benchmark's figures of a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelationReport {
    /// Every relation.
    pub all: RelationGroup,
    /// Relations over at most 10 s: local accuracy.
    pub short: RelationGroup,
    /// The other relations: consistency between visits.
    pub long: RelationGroup,
}

/// The errors of a group of relations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelationGroup {
    /// Relations in the group.
    pub relations: usize,
    /// Those for which the trajectory has both poses.
    pub matched: usize,
    /// Residual translations, metres; absent when nothing was matched.
    pub translation_m: Option<ErrorStatistics>,
    /// Residual rotations, degrees; absent when nothing was matched.
    pub rotation_deg: Option<ErrorStatistics>,
}

impl RelationReport {
    /// Evaluates a trajectory against relations; see [`relation_errors`].
    #[must_use]
    pub fn new(trajectory: &[StampedPose], relations: &[Relation]) -> Self {
        let errors = relation_errors(trajectory, relations);
        let group = |belongs: fn(&Relation) -> bool| {
            RelationGroup::of(relations.iter().zip(&errors).filter(|(r, _)| belongs(r)).map(|(_, e)| *e))
        };
        Self { all: group(|_| true), short: group(Relation::is_short), long: group(|r| !r.is_short()) }
    }
}

impl RelationGroup {
    fn of(errors: impl Iterator<Item = Option<PoseError>>) -> Self {
        let errors: Vec<_> = errors.collect();
        let matched: Vec<_> = errors.iter().flatten().collect();
        let statistics =
            |value: fn(&PoseError) -> f64| ErrorStatistics::of(&matched.iter().map(|e| value(e)).collect::<Vec<_>>());
        Self {
            relations: errors.len(),
            matched: matched.len(),
            translation_m: statistics(|e| e.translation_m),
            rotation_deg: statistics(|e| e.rotation_deg),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn drive() -> Vec<StampedPose> {
        let step = Pose2::exp([0.3, 0.0, 0.1]);
        let mut pose = Pose2::IDENTITY;
        (0..100)
            .map(|i| {
                pose = pose.compose(&step);
                StampedPose { stamp_s: 1e9 + 0.5 * f64::from(i), pose }
            })
            .collect()
    }

    fn relation(drive: &[StampedPose], i: usize, j: usize) -> Relation {
        Relation {
            first_stamp_s: drive[i].stamp_s,
            second_stamp_s: drive[j].stamp_s + 4e-5,
            first_from_second: drive[i].pose.between(&drive[j].pose),
        }
    }

    #[test]
    fn the_truth_has_no_error_and_what_is_missing_is_counted() {
        let drive = drive();
        let mut relations = vec![relation(&drive, 3, 5), relation(&drive, 9, 2), relation(&drive, 0, 90)];
        relations.push(Relation { first_stamp_s: 0.0, ..relations[0] });
        let backwards: Vec<_> = drive.iter().rev().copied().collect();
        let report = RelationReport::new(&backwards, &relations);
        assert_eq!((report.all.relations, report.all.matched), (4, 3));
        assert_eq!((report.short.relations, report.short.matched), (2, 2));
        assert_eq!((report.long.relations, report.long.matched), (2, 1));
        assert!(report.all.translation_m.unwrap().max < 1e-9);
        assert!(report.all.rotation_deg.unwrap().max < 1e-9);
        assert_eq!(RelationReport::new(&[], &relations).all.translation_m, None);
    }

    #[test]
    fn a_bend_in_the_middle_is_charged_to_the_relations_across_it() {
        let drive = drive();
        let bend = Pose2::new(0.0, 0.0, 2.0_f64.to_radians());
        let pivot = drive[50].pose;
        let bent: Vec<_> = drive
            .iter()
            .enumerate()
            .map(|(i, p)| match i {
                0..=50 => *p,
                _ => StampedPose { pose: pivot.compose(&bend).compose(&pivot.between(&p.pose)), ..*p },
            })
            .collect();
        let relations = [relation(&drive, 10, 20), relation(&drive, 60, 70), relation(&drive, 50, 60)];
        let errors: Vec<_> = relation_errors(&bent, &relations).into_iter().map(Option::unwrap).collect();
        assert!(errors[0].rotation_deg < 1e-9 && errors[1].translation_m < 1e-9);
        assert!((errors[2].rotation_deg - 2.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn the_frame_of_the_map_does_not_matter(x in -9.0..9.0_f64, y in -9.0..9.0_f64, theta in -3.0..3.0_f64) {
            let drive = drive();
            let frame = Pose2::new(x, y, theta);
            let moved: Vec<_> = drive.iter().map(|p| StampedPose { pose: frame.compose(&p.pose), ..*p }).collect();
            let wrong = Relation { first_from_second: Pose2::new(1.0, 2.0, 0.5), ..relation(&drive, 4, 8) };
            let (here, there) = (relation_errors(&drive, &[wrong]), relation_errors(&moved, &[wrong]));
            let (here, there) = (here[0].unwrap(), there[0].unwrap());
            prop_assert!((here.translation_m - there.translation_m).abs() < 1e-9);
            prop_assert!((here.rotation_deg - there.rotation_deg).abs() < 1e-9);
        }
    }
}
