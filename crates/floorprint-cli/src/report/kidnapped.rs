//! Where the robot was carried elsewhere during the drive.

use super::page::fixed;
use floorprint::back_end::Kidnapping;
use floorprint::sensors::StampedPose;
use serde::Serialize;

/// The robot was carried elsewhere: its wheels did not turn, and its scans showed another place.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct Kidnapped {
    /// Stamp of the first scan at the new place, seconds.
    pub(crate) stamp_s: f64,
    /// The same since the first scan of the drive, seconds.
    pub(crate) time_s: f64,
    /// Where the robot was found again; absent when it was not, and nothing ties the map from there on to the map before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) found: Option<FoundAgain>,
}

/// The place of a robot that was found again.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct FoundAgain {
    /// Where it was set down on the map, metres.
    pub(crate) set_down_m: [f64; 2],
    /// Stamp of the scan by which its place was known, seconds.
    pub(crate) stamp_s: f64,
    /// Stamp of an earlier scan at that place, seconds.
    pub(crate) earlier_stamp_s: f64,
}

impl Kidnapped {
    /// All of a drive, in its order.
    pub(crate) fn all(kidnappings: &[Kidnapping], trajectory: &[StampedPose]) -> Vec<Self> {
        let stamp_s = |frame: usize| trajectory.get(frame).map_or(f64::NAN, |stamped| stamped.stamp_s);
        let kidnapped = |kidnapping: &Kidnapping| Self {
            stamp_s: stamp_s(kidnapping.frame),
            time_s: stamp_s(kidnapping.frame) - stamp_s(0),
            found: kidnapping.found.map(|found| FoundAgain {
                set_down_m: trajectory.get(kidnapping.frame).map_or([f64::NAN; 2], |at| [at.pose.x, at.pose.y]),
                stamp_s: stamp_s(found.frame),
                earlier_stamp_s: stamp_s(found.earlier),
            }),
        };
        kidnappings.iter().map(kidnapped).collect()
    }

    /// The same in a line.
    pub(crate) fn in_words(&self) -> String {
        let Self { stamp_s, time_s, found } = self;
        let what = match found {
            Some(FoundAgain { set_down_m: [x, y], stamp_s: known_s, .. }) => {
                let [x, y] = [*x, *y].map(|metres| fixed(metres, 1));
                format!("set down at ({x} m, {y} m), found again {:.1} s later", known_s - stamp_s)
            }
            None => "not found again: how the map before and after lie to each other is not known".to_owned(),
        };
        format!("carried elsewhere after {time_s:.1} s (stamp {stamp_s:.3} s): {what}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::back_end::Found;
    use floorprint::geometry::Pose2;

    #[test]
    fn a_line_says_when_and_whether_and_where_the_robot_was_found() {
        let at = |k: usize| StampedPose { stamp_s: 100.0 + k as f64, pose: Pose2::new(0.5 * k as f64, -1.0, 0.0) };
        let trajectory: Vec<_> = (0..20).map(at).collect();
        let kidnappings = [
            Kidnapping { frame: 8, found: Some(Found { frame: 12, earlier: 3 }) },
            Kidnapping { frame: 15, found: None },
        ];
        let lines: Vec<_> = Kidnapped::all(&kidnappings, &trajectory).iter().map(Kidnapped::in_words).collect();
        let first = "after 8.0 s (stamp 108.000 s): set down at (4.0 m, -1.0 m), found again 4.0 s later";
        assert_eq!(lines[0], format!("carried elsewhere {first}"));
        assert!(lines[1].contains("after 15.0 s (stamp 115.000 s): not found again"), "{}", lines[1]);
    }
}
