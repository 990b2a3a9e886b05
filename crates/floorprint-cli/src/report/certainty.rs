//! How certain the poses of a drive are.

use floorprint::back_end::Uncertainty;
use floorprint::sensors::StampedPose;
use serde::Serialize;

/// A circle of so many standard deviations holds 95 % of a Gaussian of the plane, an interval of so many 95 % of one on a
/// line.
const CIRCLE_95: f64 = 2.448;
const INTERVAL_95: f64 = 1.96;

/// The regions that hold the poses with 95 %, seen from the first; where the robot is lost they say nothing.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct Certainty {
    /// Largest radius of a position's region, metres.
    pub(crate) largest_m: f64,
    /// When that is, since the first scan, seconds.
    pub(crate) largest_at_s: f64,
    /// That of the last position, metres.
    pub(crate) at_end_m: f64,
    /// Half the largest interval of a heading, degrees; at 180 nothing is known of it.
    pub(crate) largest_deg: f64,
}

impl Certainty {
    /// That of a drive; `None` where nothing is known of it.
    pub(crate) fn of(uncertainties: &[Uncertainty], trajectory: &[StampedPose]) -> Option<Self> {
        let (last, first) = (uncertainties.last()?, trajectory.first()?);
        let (at, largest) = uncertainties
            .iter()
            .zip(trajectory)
            .max_by(|(a, at), (b, bt)| a.sigma_m.total_cmp(&b.sigma_m).then(bt.stamp_s.total_cmp(&at.stamp_s)))
            .map(|(largest, at)| (at, largest))?;
        let largest_rad = uncertainties.iter().map(|uncertainty| uncertainty.sigma_rad).fold(0.0, f64::max);
        Some(Self {
            largest_m: CIRCLE_95 * largest.sigma_m,
            largest_at_s: at.stamp_s - first.stamp_s,
            at_end_m: CIRCLE_95 * last.sigma_m,
            largest_deg: (INTERVAL_95 * largest_rad.to_degrees()).min(180.0),
        })
    }

    /// The same in a line.
    pub(crate) fn in_words(&self) -> String {
        let Self { largest_m, largest_at_s, at_end_m, largest_deg } = self;
        format!(
            "by up to {largest_m:.2} m, after {largest_at_s:.0} s, and {largest_deg:.1}°; by {at_end_m:.2} m in the end (95 %)"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::geometry::Pose2;

    #[test]
    fn the_least_certain_pose_is_told() {
        let trajectory: Vec<_> =
            (0..4).map(|k| StampedPose { stamp_s: 10.0 + f64::from(k), pose: Pose2::IDENTITY }).collect();
        let uncertainties: Vec<_> =
            [0.0, 0.5, 1.0, 0.25].map(|sigma_m| Uncertainty { sigma_m, sigma_rad: 0.1 * sigma_m }).to_vec();
        let certainty = Certainty::of(&uncertainties, &trajectory).map(|certainty| certainty.in_words());
        assert_eq!(certainty.as_deref(), Some("by up to 2.45 m, after 2 s, and 11.2°; by 0.61 m in the end (95 %)"));
        assert_eq!(Certainty::of(&[], &trajectory), None);
        // No heading is off by more than half a turn.
        let unknown = Certainty::of(&[Uncertainty { sigma_m: 1.0, sigma_rad: 3.0 }], &trajectory);
        assert_eq!(unknown.map(|certainty| certainty.largest_deg), Some(180.0));
    }
}
