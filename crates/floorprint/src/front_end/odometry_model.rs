//! What is learnt of this robot's odometry on the way.

use super::odometry_record::OdometryRecord;
use super::odometry_scale::OdometryScale;
use super::odometry_trust::OdometryTrust;
use super::odometry_turn::OdometryTurn;
use crate::geometry::Pose2;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// How noisy the odometry is, and by how much it reads long or short.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct OdometryModel {
    trust: OdometryTrust,
    scale: OdometryScale,
    #[serde(default)]
    record: OdometryRecord,
    #[serde(default)]
    turn: OdometryTurn,
}

impl OdometryModel {
    /// A motion as the odometry states it, at its true length.
    #[must_use]
    pub fn correct(&self, measured: &Pose2) -> Pose2 {
        self.scale.correct(measured)
    }

    /// The true length of what the odometry states as one.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale.ratio()
    }

    /// Factor on the stated standard deviation of a translation.
    #[must_use]
    pub fn noise(&self) -> f64 {
        self.trust.noise()
    }

    /// A motion at its true length, as [`correct`](Self::correct) gives it, with the turn that the odometry has turned out to
    /// miss.
    #[must_use]
    pub fn straightened(&self, motion: &Pose2) -> Pose2 {
        self.turn.correct(motion)
    }

    /// Information of a motion with errors as they have turned out to be on this drive, given what is stated.
    #[must_use]
    pub fn proven(&self, stated: &Matrix3<f64>) -> Matrix3<f64> {
        self.record.proven(stated)
    }

    /// Standard deviations of the odometry's errors on this drive as shares of what is stated: of a translation and of a turn.
    #[must_use]
    pub fn proven_shares(&self) -> [f64; 2] {
        self.record.shares()
    }

    /// Learns from a step: what the odometry `measured` and what scan and odometry together `matched`, both seen from
    /// the pose before, in which the body had a `heading_rad`; the standard deviation of a translation as stated
    /// (metres), and what the scan alone knows, as information in the axes of the front end's frame. The length is
    /// learnt only where the scan `confirmed` the odometry.
    pub fn learn(
        &mut self,
        measured: &Pose2,
        matched: &Pose2,
        heading_rad: f64,
        sigma_m: f64,
        scan: &Matrix3<f64>,
        confirmed: bool,
    ) {
        self.trust.learn(&self.scale.correct(measured), matched, sigma_m, scan);
        if confirmed {
            self.scale.learn(measured, matched, heading_rad, scan);
        }
    }

    /// Notes how far the odometry erred in a step of which the scan is clear: what it `measured` and what scan and odometry
    /// together `matched`; standard deviations of position and heading as stated (metres, radians), and what the scan alone
    /// knows, as information.
    pub fn note(&mut self, measured: &Pose2, matched: &Pose2, sigmas: [f64; 2], scan: &Matrix3<f64>) {
        let measured = self.scale.correct(measured);
        self.record.learn(&self.turn.correct(&measured), matched, sigmas, scan);
        self.turn.learn(&measured, matched, sigmas[1], scan[(2, 2)]);
    }

    /// Hears of a step of which no scan tells.
    pub fn note_nothing(&mut self) {
        self.record.miss();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_learnt_of_the_odometry_is_put_right_and_what_is_left_is_its_noise() {
        // Ten per cent too long, and three degrees short in every metre.
        let (measured, matched) = (Pose2::new(1.1, 0.0, 0.0), Pose2::new(1.0, 0.026, 0.052));
        let scan = Matrix3::identity() * 1e6;
        let mut model = OdometryModel::default();
        for _ in 0..2000 {
            model.learn(&measured, &matched, 0.0, 0.17, &scan, true);
            model.note(&measured, &matched, [0.17, 0.06], &scan);
        }
        let corrected = model.correct(&measured);
        assert!((corrected.x - 1.0).abs() < 0.01 && corrected.theta == 0.0, "{corrected:?}");
        let straightened = model.straightened(&corrected);
        assert!(
            (straightened.theta - 0.052).abs() < 0.004 && (straightened.y - 0.026).abs() < 0.004,
            "{straightened:?}"
        );
        // What is always the same does not count as noise.
        let stated = Matrix3::identity();
        assert!(model.proven(&stated)[(2, 2)] > 100.0, "{}", model.proven(&stated));
    }
}
