//! What changes in a world while the robot drives: doors and furniture.

use super::fault::{Fault, within};
use crate::geometry::Pose2;

/// A door stays open while the robot is nearer than this, metres.
const DOOR_CLEARANCE_M: f64 = 2.0;

/// A box that stands in one place, and in another once it was moved.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LooseBox {
    /// Where its middle is, before and after.
    pub(super) centers: [Pose2; 2],
    /// Half its length and half its width, metres.
    pub(super) half_size_m: [f64; 2],
}

impl LooseBox {
    /// Ends of its four sides at a time, metres.
    pub(super) fn walls_m(&self, time_s: f64, faults: &[Fault]) -> [[[f64; 2]; 2]; 4] {
        let was_moved = faults.iter().any(|fault| matches!(*fault, Fault::FurnitureMoved { at_s } if time_s >= at_s));
        let center = self.centers[usize::from(was_moved)];
        let [a, b] = self.half_size_m;
        let corners = [[-a, -b], [a, -b], [a, b], [-a, b]].map(|corner| center.transform_point(corner));
        std::array::from_fn(|side| [corners[side], corners[(side + 1) % 4]])
    }
}

/// A door on its hinge.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Door {
    /// Where it is hinged, looking along the closed door.
    pub(super) hinge: Pose2,
    /// Its width, metres.
    pub(super) width_m: f64,
    /// How far it opens, radians, to the left if positive.
    pub(super) opens_rad: f64,
    /// Time to close and to open again, seconds.
    pub(super) period_s: f64,
}

impl Door {
    /// Its ends at a time, metres, when the robot is at `robot`.
    pub(super) fn wall_m(&self, time_s: f64, robot: &Pose2, faults: &[Fault]) -> [[f64; 2]; 2] {
        let swings = faults
            .iter()
            .any(|fault| matches!(*fault, Fault::DoorsMove { from_s, for_s } if within(time_s, from_s, for_s)));
        let is_near = (robot.x - self.hinge.x).hypot(robot.y - self.hinge.y) < DOOR_CLEARANCE_M;
        let open_share = if swings && !is_near {
            0.5 + 0.5 * (std::f64::consts::TAU * time_s / self.period_s + self.hinge.x).cos()
        } else {
            1.0
        };
        let (sin, cos) = (open_share * self.opens_rad).sin_cos();
        let end = self.hinge.transform_point([self.width_m * cos, self.width_m * sin]);
        [[self.hinge.x, self.hinge.y], end]
    }
}

/// Distance along a ray of direction length one at which it crosses a wall between two points.
pub(super) fn crossing_m(ends: [[f64; 2]; 2], from_m: [f64; 2], direction: [f64; 2]) -> Option<f64> {
    let along = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
    let to_start = [ends[0][0] - from_m[0], ends[0][1] - from_m[1]];
    let determinant = direction[0] * along[1] - direction[1] * along[0];
    let share = (to_start[0] * direction[1] - to_start[1] * direction[0]) / determinant;
    let range_m = (to_start[0] * along[1] - to_start[1] * along[0]) / determinant;
    ((0.0..=1.0).contains(&share) && range_m > 0.0).then_some(range_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_a_wall_that_it_crosses() {
        let wall = [[2.0, -1.0], [2.0, 1.0]];
        assert_eq!(crossing_m(wall, [0.0, 0.0], [1.0, 0.0]), Some(2.0));
        assert_eq!(crossing_m(wall, [0.0, 0.0], [-1.0, 0.0]), None);
        assert_eq!(crossing_m(wall, [0.0, 3.0], [1.0, 0.0]), None);
    }

    #[test]
    fn doors_swing_when_they_are_told_to_and_never_into_the_robot() {
        let door = Door { hinge: Pose2::IDENTITY, width_m: 1.0, opens_rad: 1.5, period_s: 4.0 };
        let fault = [Fault::DoorsMove { from_s: 0.0, for_s: 100.0 }];
        let far = Pose2::new(9.0, 0.0, 0.0);
        assert!((door.wall_m(2.0, &far, &fault)[1][0] - 1.0).abs() < 1e-9);
        assert!(door.wall_m(2.0, &far, &[])[1][0] < 0.1);
        assert!(door.wall_m(2.0, &Pose2::new(0.5, 0.5, 0.0), &fault)[1][0] < 0.1);
    }
}
