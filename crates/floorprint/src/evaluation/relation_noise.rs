//! How exact relations are themselves, found without knowing the truth.
//!
//! Three measurements of the same motions that err independently tell each one's variance from those of
//! their three differences (the "three-cornered hat", Gray & Allan 1974): σ²_a = ½ (σ²_ab + σ²_ac − σ²_bc).
//! Here they are a relation, a trajectory and the odometry. The trajectory should not have been made with the
//! same odometry, or the part of their errors that they share is charged to the relations.

use super::{Relation, StampIndex};
use crate::sensors::StampedPose;
use serde::Serialize;

/// Standard deviations of relative poses over short times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RelationNoise {
    /// How many relations were used.
    pub relations: usize,
    /// Of the relations.
    pub relation: MotionSigma,
    /// Of the trajectory.
    pub trajectory: MotionSigma,
    /// Of the odometry.
    pub odometry: MotionSigma,
}

/// Standard deviations of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MotionSigma {
    /// Along the robot's heading at the start, metres.
    pub forward_m: f64,
    /// Across it, metres.
    pub lateral_m: f64,
    /// Of the heading, degrees.
    pub heading_deg: f64,
}

/// Differences of more than this are blunders, not noise, and count as this: metres, radians.
const LARGEST_M: f64 = 0.3;
const LARGEST_RAD: f64 = 0.1;

impl RelationNoise {
    /// Compares the short relations with a trajectory and with odometry; `None` where fewer than two have both.
    #[must_use]
    pub fn new(trajectory: &[StampedPose], odometry: &[StampedPose], relations: &[Relation]) -> Option<Self> {
        let [trajectory, odometry] = [trajectory, odometry].map(StampIndex::new);
        let differences: Vec<[[f64; 3]; 3]> = relations
            .iter()
            .filter(|relation| relation.is_short())
            .filter_map(|relation| {
                let motion = |index: &StampIndex| relation.motion_of(index);
                let motions = [relation.first_from_second, motion(&trajectory)?, motion(&odometry)?];
                Some([(0, 1), (0, 2), (1, 2)].map(|(a, b)| {
                    let turn = motions[a].between(&motions[b]).theta;
                    let clipped = |value: f64, largest: f64| value.clamp(-largest, largest);
                    [
                        clipped(motions[b].x - motions[a].x, LARGEST_M),
                        clipped(motions[b].y - motions[a].y, LARGEST_M),
                        clipped(turn, LARGEST_RAD),
                    ]
                }))
            })
            .collect();
        if differences.len() < 2 {
            return None;
        }
        let variance = |pair: usize, axis: usize| {
            let values = differences.iter().map(|difference| difference[pair][axis]);
            let mean = values.clone().sum::<f64>() / differences.len() as f64;
            values.map(|value| (value - mean).powi(2)).sum::<f64>() / differences.len() as f64
        };
        // Of the pairs 0-1, 0-2 and 1-2 the first two hold member 0, and so on.
        let sigma = |mine: [usize; 2], others: usize| {
            let along = |axis| {
                let twice = variance(mine[0], axis) + variance(mine[1], axis) - variance(others, axis);
                (0.5 * twice).max(0.0).sqrt()
            };
            MotionSigma { forward_m: along(0), lateral_m: along(1), heading_deg: along(2).to_degrees() }
        };
        Some(Self {
            relations: differences.len(),
            relation: sigma([0, 1], 2),
            trajectory: sigma([0, 2], 1),
            odometry: sigma([1, 2], 0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use crate::random::{Stage, generator};
    use rand_distr::{Distribution, Normal};

    #[test]
    fn each_of_three_independent_measurements_is_told_its_own_noise() {
        let mut random = generator(1, Stage::World, 0, 0);
        let mut noisy = |sigma: f64| {
            let mut draw = |sigma: f64| Normal::new(0.0, sigma).unwrap().sample(&mut random);
            Pose2::new(0.3 + draw(sigma), draw(0.5 * sigma), 0.02 + draw(0.1 * sigma))
        };
        // Each motion stands for itself: chains would add up their errors.
        let (mut trajectory, mut odometry, mut relations) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..4000 {
            let [first_stamp_s, second_stamp_s] = [f64::from(k), f64::from(k) + 0.5];
            relations.push(Relation { first_stamp_s, second_stamp_s, first_from_second: noisy(0.04) });
            for (poses, sigma) in [(&mut trajectory, 0.01), (&mut odometry, 0.03)] {
                let start = Pose2::new(f64::from(k), 2.0, 0.3);
                poses.push(StampedPose { stamp_s: first_stamp_s, pose: start });
                poses.push(StampedPose { stamp_s: second_stamp_s, pose: start.compose(&noisy(sigma)) });
            }
        }
        let noise = RelationNoise::new(&trajectory, &odometry, &relations).unwrap();
        assert_eq!(noise.relations, 4000);
        for (found, sigma) in [(noise.relation, 0.04), (noise.trajectory, 0.01), (noise.odometry, 0.03)] {
            assert!((found.forward_m - sigma).abs() < 0.003, "{found:?}");
            assert!((found.lateral_m - 0.5 * sigma).abs() < 0.0015, "{found:?}");
            assert!((found.heading_deg.to_radians() - 0.1 * sigma).abs() < 0.0004, "{found:?}");
        }
        assert_eq!(RelationNoise::new(&trajectory[..2], &odometry, &relations), None);
        assert_eq!(RelationNoise::new(&[], &odometry, &relations), None);
    }
}
