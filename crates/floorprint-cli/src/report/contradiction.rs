//! Stretches of a drive on which scan and odometry contradicted each other.

use floorprint::StepReport;
use serde::Serialize;

/// Contradictions at most this far apart belong to the same stretch, seconds.
const GAP_S: f64 = 1.0;

/// A stretch on which the odometry was not believed and the scan decided.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct Contradiction {
    /// Stamp of the first scan, seconds.
    pub(crate) from_s: f64,
    /// Stamp of the last scan, seconds.
    pub(crate) to_s: f64,
    /// Scans that contradicted the odometry.
    pub(crate) scans: usize,
}

impl Contradiction {
    /// All of a drive, in its order.
    pub(crate) fn all(steps: &[StepReport]) -> Vec<Self> {
        let mut stretches: Vec<Self> = Vec::new();
        for step in steps.iter().filter(|step| step.filter.odometry_rejected) {
            match stretches.last_mut() {
                Some(last) if (step.stamp_s - last.to_s).abs() <= GAP_S => {
                    last.to_s = step.stamp_s;
                    last.scans += 1;
                }
                _ => stretches.push(Self { from_s: step.stamp_s, to_s: step.stamp_s, scans: 1 }),
            }
        }
        stretches
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::front_end::FilterStep;
    use floorprint::geometry::Pose2;

    #[test]
    fn contradictions_close_in_time_are_one_stretch() {
        let step = |index: usize, odometry_rejected| StepReport {
            world_from_odom: Pose2::IDENTITY,
            uncertainty: None,
            index,
            stamp_s: 0.5 * index as f64,
            dead_reckoning: Pose2::IDENTITY,
            pose: Pose2::IDENTITY,
            is_lost: false,
            filter: FilterStep {
                pose: Pose2::IDENTITY,
                effective_particles: 1.0,
                inlier_share: 1.0,
                score: 0.0,
                resampled: false,
                odometry_rejected,
                covariance: Default::default(),
                drift: Default::default(),
            },
        };
        let steps: Vec<_> = (0..12).map(|index| step(index, [2, 4, 5, 9].contains(&index))).collect();
        let expected =
            [Contradiction { from_s: 1.0, to_s: 2.5, scans: 3 }, Contradiction { from_s: 4.5, to_s: 4.5, scans: 1 }];
        assert_eq!(Contradiction::all(&steps), expected);
        assert!(Contradiction::all(&steps[..2]).is_empty());
    }
}
