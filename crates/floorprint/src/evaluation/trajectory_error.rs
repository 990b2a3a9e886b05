//! Absolute and relative error of a trajectory against the true one
//! (Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems").

use super::{ErrorStatistics, EvaluationError, PoseError, StampIndex};
use crate::geometry::Pose2;
use crate::sensors::StampedPose;
use serde::Serialize;

/// How the estimate is moved onto the truth before absolute errors are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// Not at all: both are in the same frame already.
    #[default]
    None,
    /// By the first pose that both have.
    FirstPose,
    /// By the rigid motion with the least squared distances between positions
    /// (Horn 1987, Umeyama 1991; the scale stays 1).
    LeastSquares,
}

/// Over how long a stretch a relative error is taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Span {
    /// Metres of true path.
    DistanceM(f64),
    /// Seconds.
    TimeS(f64),
}

/// What [`TrajectoryError::new`] computes, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryErrorOptions {
    /// How the estimate is moved onto the truth.
    pub alignment: Alignment,
    /// The spans of the relative errors.
    pub spans: Vec<Span>,
    /// A true pose within this time of an estimate's stamp is taken as it is, seconds.
    pub stamp_tolerance_s: f64,
    /// Otherwise the truth is interpolated, unless its neighbouring poses are farther apart than this, seconds.
    pub max_truth_gap_s: f64,
}

impl Default for TrajectoryErrorOptions {
    fn default() -> Self {
        Self {
            alignment: Alignment::None,
            spans: vec![Span::DistanceM(1.0), Span::DistanceM(10.0), Span::TimeS(1.0)],
            stamp_tolerance_s: 1e-4,
            max_truth_gap_s: 0.5,
        }
    }
}

/// Errors of an estimated trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrajectoryError {
    /// Poses of the estimate.
    pub poses: usize,
    /// Those with a true pose at their time: all figures are over these.
    pub matched: usize,
    /// Length of the true path, metres.
    pub path_length_m: f64,
    /// How the estimate was moved onto the truth.
    pub alignment: Alignment,
    /// The motion that did it.
    pub truth_from_estimate: Pose2,
    /// Absolute position errors, metres.
    pub translation_m: ErrorStatistics,
    /// Absolute heading errors, degrees.
    pub rotation_deg: ErrorStatistics,
    /// Relative errors, one entry for each span asked for.
    pub relative: Vec<RelativeError>,
}

/// Drift over stretches of one span, from every pose at which such a stretch begins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelativeError {
    /// Length of the stretches.
    pub span: Span,
    /// Position errors at the stretch's end, metres; absent when the drive is shorter than the span.
    pub translation_m: Option<ErrorStatistics>,
    /// Heading errors at the stretch's end, degrees; absent when the drive is shorter than the span.
    pub rotation_deg: Option<ErrorStatistics>,
}

/// An estimated pose and the true pose at the same time.
struct Pair {
    stamp_s: f64,
    /// Metres of true path up to here.
    travelled_m: f64,
    truth: Pose2,
    estimate: Pose2,
}

impl TrajectoryError {
    /// Compares `estimate` with `truth`; both in any order.
    ///
    /// # Errors
    /// [`EvaluationError::NoCommonTime`] when no estimated pose has a true pose at its time.
    pub fn new(
        estimate: &[StampedPose],
        truth: &[StampedPose],
        options: &TrajectoryErrorOptions,
    ) -> Result<Self, EvaluationError> {
        let (estimate, truth) = (StampIndex::new(estimate), StampIndex::new(truth));
        let pairs = pair_by_time(&estimate, &truth, options);
        let truth_from_estimate = align(&pairs, options.alignment);
        let absolute: Vec<_> = pairs
            .iter()
            .map(|pair| PoseError::between(&pair.truth, &truth_from_estimate.compose(&pair.estimate)))
            .collect();
        let (Some((translation_m, rotation_deg)), Some(last)) = (summarise(&absolute), pairs.last()) else {
            return Err(EvaluationError::NoCommonTime {
                estimates: estimate.poses().len(),
                estimate_span: estimate.describe_span(),
                truth_span: truth.describe_span(),
            });
        };
        Ok(Self {
            poses: estimate.poses().len(),
            matched: pairs.len(),
            path_length_m: last.travelled_m,
            alignment: options.alignment,
            truth_from_estimate,
            translation_m,
            rotation_deg,
            relative: options.spans.iter().map(|&span| relative_error(&pairs, span)).collect(),
        })
    }
}

fn pair_by_time(estimate: &StampIndex, truth: &StampIndex, options: &TrajectoryErrorOptions) -> Vec<Pair> {
    let mut pairs: Vec<Pair> = Vec::with_capacity(estimate.poses().len());
    for pose in estimate.poses() {
        let Some(truth) = truth.interpolated(pose.stamp_s, options.stamp_tolerance_s, options.max_truth_gap_s) else {
            continue;
        };
        let travelled_m = pairs.last().map_or(0.0, |last| last.travelled_m + last.truth.between(&truth).distance());
        pairs.push(Pair { stamp_s: pose.stamp_s, travelled_m, truth, estimate: pose.pose });
    }
    pairs
}

/// The motion `truth_from_estimate`.
fn align(pairs: &[Pair], alignment: Alignment) -> Pose2 {
    match (alignment, pairs.first()) {
        (Alignment::None, _) | (_, None) => Pose2::IDENTITY,
        (Alignment::FirstPose, Some(first)) => first.truth.compose(&first.estimate.inverse()),
        (Alignment::LeastSquares, Some(_)) => least_squares_motion(pairs),
    }
}

/// Closed form in the plane: the heading is that of Σ ē*·t̄, with the positions
/// relative to their centroids read as complex numbers.
fn least_squares_motion(pairs: &[Pair]) -> Pose2 {
    let count = pairs.len() as f64;
    let centroid = |pose: fn(&Pair) -> &Pose2| {
        let sum = pairs.iter().fold([0.0, 0.0], |[x, y], p| [x + pose(p).x, y + pose(p).y]);
        [sum[0] / count, sum[1] / count]
    };
    let (true_center, center) = (centroid(|p| &p.truth), centroid(|p| &p.estimate));
    let (mut dot, mut cross) = (0.0, 0.0);
    for pair in pairs {
        let [tx, ty] = [pair.truth.x - true_center[0], pair.truth.y - true_center[1]];
        let [ex, ey] = [pair.estimate.x - center[0], pair.estimate.y - center[1]];
        dot += ex * tx + ey * ty;
        cross += ex * ty - ey * tx;
    }
    let turn = Pose2::new(0.0, 0.0, cross.atan2(dot));
    let [x, y] = turn.transform_point(center);
    Pose2::new(true_center[0] - x, true_center[1] - y, turn.theta)
}

fn relative_error(pairs: &[Pair], span: Span) -> RelativeError {
    let progress = |pair: &Pair| match span {
        Span::DistanceM(_) => pair.travelled_m,
        Span::TimeS(_) => pair.stamp_s,
    };
    let (Span::DistanceM(length) | Span::TimeS(length)) = span;
    let errors: Vec<_> = pairs
        .iter()
        .map_while(|start| {
            let end = pairs.partition_point(|pair| progress(pair) < progress(start) + length);
            let end = pairs.get(end)?;
            Some(PoseError::between(&start.truth.between(&end.truth), &start.estimate.between(&end.estimate)))
        })
        .collect();
    let (translation_m, rotation_deg) = summarise(&errors).unzip();
    RelativeError { span, translation_m, rotation_deg }
}

fn summarise(errors: &[PoseError]) -> Option<(ErrorStatistics, ErrorStatistics)> {
    let translations: Vec<_> = errors.iter().map(|e| e.translation_m).collect();
    let rotations: Vec<_> = errors.iter().map(|e| e.rotation_deg).collect();
    Some((ErrorStatistics::of(&translations)?, ErrorStatistics::of(&rotations)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A circle of 10 m circumference, a pose each 0.1 m and 0.1 s.
    fn circle() -> Vec<StampedPose> {
        let turn = std::f64::consts::TAU / 100.0;
        (0..=100)
            .map(|i| StampedPose {
                stamp_s: 5e8 + 0.1 * f64::from(i),
                pose: Pose2::exp([0.1 * f64::from(i), 0.0, turn * f64::from(i)]),
            })
            .collect()
    }

    fn moved(trajectory: &[StampedPose], frame: &Pose2) -> Vec<StampedPose> {
        trajectory.iter().map(|p| StampedPose { pose: frame.compose(&p.pose), ..*p }).collect()
    }

    fn options(alignment: Alignment) -> TrajectoryErrorOptions {
        TrajectoryErrorOptions { alignment, ..Default::default() }
    }

    #[test]
    fn an_offset_is_seen_only_without_alignment() {
        let truth = circle();
        let estimate = moved(&truth, &Pose2::new(0.3, -0.4, 0.0));
        let error = TrajectoryError::new(&estimate, &truth, &options(Alignment::None)).unwrap();
        assert!((error.translation_m.rmse - 0.5).abs() < 1e-9 && error.rotation_deg.max < 1e-9);
        assert!((error.path_length_m - 10.0).abs() < 0.01);
        assert_eq!((error.poses, error.matched), (101, 101));
        assert!(error.relative[0].translation_m.unwrap().max < 1e-9);
    }

    #[test]
    fn a_heading_drift_shows_in_the_relative_error_of_each_span() {
        let truth = circle();
        let mut estimate = truth.clone();
        for i in 1..truth.len() {
            let drift = Pose2::new(0.0, 0.0, 0.01_f64.to_radians());
            estimate[i].pose = estimate[i - 1].pose.compose(&truth[i - 1].pose.between(&truth[i].pose)).compose(&drift);
        }
        let spans = vec![Span::TimeS(0.95), Span::TimeS(1.95), Span::DistanceM(30.0)];
        let options = TrajectoryErrorOptions { spans, ..options(Alignment::FirstPose) };
        let error = TrajectoryError::new(&estimate, &truth, &options).unwrap();
        let rotation = |i: usize| error.relative[i].rotation_deg.map(|r| r.max);
        assert!((rotation(0).unwrap() - 0.1).abs() < 1e-6);
        assert!((rotation(1).unwrap() - 0.2).abs() < 1e-6);
        assert_eq!(rotation(2), None);
        assert!((error.rotation_deg.max - 1.0).abs() < 1e-6);
    }

    #[test]
    fn truth_at_other_times_is_interpolated_but_not_across_gaps() {
        let truth = circle();
        let estimate: Vec<_> = (0..100)
            .map(|i| StampedPose {
                stamp_s: truth[i].stamp_s + 0.05,
                pose: truth[i].pose.interpolate(&truth[i + 1].pose, 0.5),
            })
            .collect();
        let mut sparse = truth.clone();
        sparse.drain(20..40);
        let error = TrajectoryError::new(&estimate, &sparse, &options(Alignment::None)).unwrap();
        assert_eq!(error.matched, 79);
        assert!(error.translation_m.max < 1e-6);
    }

    #[test]
    fn another_clock_is_an_error_that_names_both_spans() {
        let truth = circle();
        let estimate = vec![StampedPose { stamp_s: 1.0, pose: Pose2::IDENTITY }];
        let message = TrajectoryError::new(&estimate, &truth, &options(Alignment::None)).unwrap_err().to_string();
        assert!(message.contains("1.000 to 1.000 s") && message.contains("500000000.000"), "{message}");
        assert!(TrajectoryError::new(&[], &[], &options(Alignment::LeastSquares)).is_err());
    }

    proptest! {
        #[test]
        fn alignment_undoes_any_rigid_motion(x in -9.0..9.0_f64, y in -9.0..9.0_f64, theta in -3.0..3.0_f64) {
            let truth = circle();
            let estimate = moved(&truth, &Pose2::new(x, y, theta));
            for alignment in [Alignment::FirstPose, Alignment::LeastSquares] {
                let error = TrajectoryError::new(&estimate, &truth, &options(alignment)).unwrap();
                prop_assert!(error.translation_m.max < 1e-9 && error.rotation_deg.max < 1e-6);
            }
        }

        #[test]
        fn no_rigid_motion_is_better_than_least_squares(x in -0.1..0.1_f64, y in -0.1..0.1_f64, theta in -0.1..0.1_f64) {
            let truth = circle();
            let mut estimate = truth.clone();
            for (i, pose) in estimate.iter_mut().enumerate() {
                pose.pose.x += 0.1 * (i as f64 * 0.7).sin();
                pose.pose.y += 0.1 * (i as f64 * 1.3).cos();
            }
            let best = TrajectoryError::new(&estimate, &truth, &options(Alignment::LeastSquares)).unwrap();
            let other = moved(&moved(&estimate, &best.truth_from_estimate), &Pose2::new(x, y, theta));
            let other = TrajectoryError::new(&other, &truth, &options(Alignment::None)).unwrap();
            prop_assert!(best.translation_m.rmse <= other.translation_m.rmse + 1e-12);
        }
    }
}
