//! How much the odometry's turns can be trusted, learnt from scans that tell the heading without it.
//!
//! A gyro knows a turn to a fraction of a degree, wheels that scrub over the floor hardly at all, and nothing in a recording
//! says which it is. It matters where scans know the heading badly: a short piece of one wall, seen a little bent by a LiDAR
//! whose ranges are off by millimetres, bends a corridor by degrees a metre, if it is believed more than a good gyro. A
//! scan's error does not grow from step to step and the odometry's does, so that they are compared over a stretch of the way.

use crate::geometry::{Pose2, wrap_angle};
use crate::motion_model::MotionConfig;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// The noise of headings against what `[motion]` states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeadingTrust {
    /// Mean squared ratio of the error over a stretch to its stated standard deviation: straight on, and in turns.
    squared_ratio: [f64; 2],
    stretch: Stretch,
}

/// A stretch of the way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Stretch {
    length_m: f64,
    turned_rad: f64,
    /// Turn by the scans less that by the odometry, radians.
    error_rad: f64,
    /// Variance of that as stated, rad²: of what comes from going on, and of what comes from turning.
    stated_rad2: [f64; 2],
}

/// A stretch ends after this way or turn, metres and radians.
const STRETCH_M: f64 = 1.0;
const STRETCH_RAD: f64 = 0.5;
/// Share of the newest stretch in the mean.
const NEWEST: f64 = 0.1;
/// The noise is never taken to be smaller than this share of what is stated.
const LEAST_NOISE: f64 = 0.1;
/// A single stretch counts no more than this ratio.
const LARGEST_RATIO: f64 = 3.0;
/// Steps shorter than this tell nothing about the odometry, metres and radians.
const SHORTEST_STEP_M: f64 = 0.005;
const SHORTEST_STEP_RAD: f64 = 0.005;
/// A scan tells the heading without the odometry if it is this much more certain than that states of the whole stretch.
const MORE_CERTAIN: f64 = 4.0;

impl Default for HeadingTrust {
    fn default() -> Self {
        Self { squared_ratio: [1.0; 2], stretch: Stretch::default() }
    }
}

impl HeadingTrust {
    /// Factors on the stated standard deviations of a heading, at most 1: of what comes from going on, of what comes
    /// from turning.
    #[must_use]
    pub fn noise(&self) -> [f64; 2] {
        self.squared_ratio.map(|squared| squared.sqrt().clamp(LEAST_NOISE, 1.0))
    }

    /// Learns from a step: what the odometry measured and what the scan says, both seen from the pose before, and the
    /// information of the latter. Without a scan that is believed, the stretch begins anew.
    pub fn learn(&mut self, measured: &Pose2, matched: &Pose2, motion: &MotionConfig, scan: Option<&Matrix3<f64>>) {
        let Some(scan) = scan else {
            self.stretch = Stretch::default();
            return;
        };
        if measured.distance() < SHORTEST_STEP_M && measured.theta.abs() < SHORTEST_STEP_RAD {
            return;
        }
        let stretch = &mut self.stretch;
        let [ahead_rad, turning_rad] = motion.heading_sigmas(measured);
        stretch.length_m += measured.distance();
        stretch.turned_rad += measured.theta.abs();
        stretch.error_rad += wrap_angle(matched.theta - measured.theta);
        stretch.stated_rad2[0] += ahead_rad * ahead_rad;
        stretch.stated_rad2[1] += turning_rad * turning_rad;
        if stretch.length_m < STRETCH_M && stretch.turned_rad < STRETCH_RAD {
            return;
        }
        let Stretch { error_rad, stated_rad2: [ahead_rad2, turning_rad2], .. } = std::mem::take(stretch);
        let stated_rad2 = ahead_rad2 + turning_rad2;
        // The scan's position is known about as well as the odometry's.
        let (sigma_m, _) = motion.sigmas(measured);
        let place = Matrix3::from_diagonal(&[sigma_m.powi(-2), sigma_m.powi(-2), 0.0].into());
        let heading_rad2 = (scan + place).try_inverse().map_or(f64::INFINITY, |covariance| covariance[(2, 2)]);
        if heading_rad2 * MORE_CERTAIN >= stated_rad2 {
            return;
        }
        let squared = (error_rad * error_rad / stated_rad2).min(LARGEST_RATIO * LARGEST_RATIO);
        let kind = usize::from(turning_rad2 > ahead_rad2);
        self.squared_ratio[kind] += NEWEST * (squared - self.squared_ratio[kind]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drives so many metres in steps of 10 cm, on each of which the odometry errs by `error_rad` and the scan, which knows the
    /// heading this well, by as much to and fro; in turns or straight on.
    fn drive(metres: usize, error_rad: f64, scan_sigma_rad: f64, turn_rad: f64) -> HeadingTrust {
        let (mut trust, motion) = (HeadingTrust::default(), MotionConfig::default());
        let scan = Matrix3::from_diagonal(&[1e6, 1e6, scan_sigma_rad.powi(-2)].into());
        for step in 0..10 * metres {
            let measured = Pose2::new(0.1, 0.0, turn_rad);
            let jitter_rad = if step % 2 == 0 { scan_sigma_rad } else { -scan_sigma_rad };
            let matched = Pose2::new(0.1, 0.0, turn_rad + error_rad + jitter_rad);
            trust.learn(&measured, &matched, &motion, Some(&scan));
        }
        trust
    }

    #[test]
    fn a_gyro_is_believed_more_and_wheels_that_drift_are_not() {
        assert_eq!(HeadingTrust::default().noise(), [1.0; 2]);
        assert_eq!(drive(60, 0.0, 0.003, 0.0).noise(), [LEAST_NOISE, 1.0]);
        let [drifting, _] = drive(40, 0.003, 0.003, 0.0).noise();
        assert!((0.5..0.8).contains(&drifting), "{drifting}");
        assert_eq!(drive(40, 0.02, 0.003, 0.0).noise()[0], 1.0);
    }

    #[test]
    fn turns_are_judged_apart() {
        let [straight, turning] = drive(20, 0.0, 0.003, 0.2).noise();
        assert!(straight == 1.0 && turning < 0.3, "{straight} {turning}");
        let [straight, turning] = drive(20, 0.06, 0.003, 0.2).noise();
        assert_eq!([straight, turning], [1.0; 2], "wheels that scrub read a third too much");
    }

    #[test]
    fn scans_that_do_not_tell_the_heading_teach_nothing() {
        assert_eq!(drive(40, 0.0, 0.1, 0.0).noise(), [1.0; 2]);
        let (mut trust, motion) = (HeadingTrust::default(), MotionConfig::default());
        for _ in 0..400 {
            trust.learn(&Pose2::new(0.1, 0.0, 0.0), &Pose2::new(0.1, 0.0, 0.0), &motion, None);
        }
        assert_eq!(trust, HeadingTrust::default());
    }
}
