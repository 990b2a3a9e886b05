//! How good this robot's odometry turns out to be, learnt from scans that tell the motion without it.
//!
//! Where a scan says nothing about one direction, as along a bare corridor, the odometry decides. How far
//! it may be believed there is seen everywhere else: the innovations of the filter show its noise (Mehra 1970).

use crate::geometry::Pose2;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// The noise of translations against what `[motion]` states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryTrust {
    /// Mean squared ratio of the error of a translation to its stated standard deviation.
    squared_ratio: f64,
}

/// Share of the newest scan in the mean.
const NEWEST: f64 = 0.02;
/// The noise is never taken to be smaller than this share of what is stated.
const LEAST_NOISE: f64 = 0.6;
/// A single scan counts no more than this ratio.
pub(super) const LARGEST_RATIO: f64 = 3.0;
/// Steps shorter than this tell nothing about the odometry, metres.
const SHORTEST_STEP_M: f64 = 0.005;
/// A scan tells the motion without the odometry if it is this much more certain in every direction.
pub(super) const MORE_CERTAIN: f64 = 4.0;

impl Default for OdometryTrust {
    fn default() -> Self {
        Self { squared_ratio: 1.0 }
    }
}

impl OdometryTrust {
    /// Factor on the stated standard deviation of a translation, at most 1.
    #[must_use]
    pub fn noise(&self) -> f64 {
        self.squared_ratio.sqrt().clamp(LEAST_NOISE, 1.0)
    }

    /// Learns from a step: what the odometry measured and what the scan says, both seen from the pose before;
    /// the standard deviation of the former as stated (metres), and the information of the latter.
    pub fn learn(&mut self, measured: &Pose2, matched: &Pose2, sigma_m: f64, scan_information: &Matrix3<f64>) {
        if !tells_motion(measured, sigma_m, scan_information) {
            return;
        }
        self.squared_ratio += NEWEST * (squared_ratio(error_m(measured, matched), sigma_m) - self.squared_ratio);
    }
}

/// The error of a translation, of each of its axes, metres.
fn error_m(measured: &Pose2, matched: &Pose2) -> f64 {
    (matched.x - measured.x).hypot(matched.y - measured.y) / std::f64::consts::SQRT_2
}

/// The squared ratio of an error to its stated standard deviation, up to what a single step counts.
fn squared_ratio(error: f64, sigma: f64) -> f64 {
    (error / sigma).min(LARGEST_RATIO).powi(2)
}

/// Whether a scan of this information tells a step so much better than odometry with this standard deviation (metres) that
/// it shows how far that errs.
pub(super) fn tells_motion(measured: &Pose2, sigma_m: f64, scan_information: &Matrix3<f64>) -> bool {
    let position = scan_information.fixed_view::<2, 2>(0, 0);
    let half_trace = 0.5 * position.trace();
    let root = (half_trace * half_trace - position.determinant()).max(0.0).sqrt();
    measured.distance() >= SHORTEST_STEP_M && half_trace - root >= MORE_CERTAIN / (sigma_m * sigma_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CERTAIN: f64 = 1e6;

    fn drive(steps: usize, error_m: f64) -> OdometryTrust {
        let mut trust = OdometryTrust::default();
        for step in 0..steps {
            let error = if step % 2 == 0 { error_m } else { -error_m };
            let (matched, measured) = (Pose2::new(0.1, 0.0, 0.0), Pose2::new(0.1 + error, error, 0.0));
            trust.learn(&measured, &matched, 0.02, &(Matrix3::identity() * CERTAIN));
        }
        trust
    }

    #[test]
    fn good_odometry_is_believed_more_and_bad_odometry_no_less_than_stated() {
        assert_eq!(OdometryTrust::default().noise(), 1.0);
        assert_eq!(drive(400, 0.0005).noise(), LEAST_NOISE);
        let middling = drive(400, 0.016).noise();
        assert!((middling - 0.8).abs() < 0.02, "{middling}");
        assert_eq!(drive(400, 0.05).noise(), 1.0);
    }

    #[test]
    fn scans_that_cannot_tell_teach_nothing() {
        let mut trust = OdometryTrust::default();
        let corridor = Matrix3::from_diagonal(&[1.0, CERTAIN, CERTAIN].into());
        trust.learn(&Pose2::new(0.1, 0.0, 0.0), &Pose2::new(0.02, 0.0, 0.0), 0.02, &corridor);
        trust.learn(&Pose2::new(0.001, 0.0, 0.0), &Pose2::IDENTITY, 0.02, &(Matrix3::identity() * CERTAIN));
        assert_eq!(trust, OdometryTrust::default());
    }
}
