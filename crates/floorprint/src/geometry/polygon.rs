//! Parts of the plane with straight edges.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A polygon: its corners in order, the last joined to the first. Points are inside by the even–odd rule, so that the
/// order may run either way round and edges may cross.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Polygon {
    corners_m: Vec<[f64; 2]>,
}

/// Why corners make no polygon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PolygonError {
    /// There are fewer than three.
    #[error("a polygon has three corners or more")]
    TooFewCorners,
    /// A coordinate is infinite or no number.
    #[error("a corner is not finite")]
    NotFinite,
}

impl Polygon {
    /// A polygon of its corners, metres.
    ///
    /// # Errors
    /// When there are fewer than three corners, or one is not finite.
    pub fn new(corners_m: Vec<[f64; 2]>) -> Result<Self, PolygonError> {
        if corners_m.iter().flatten().any(|coordinate| !coordinate.is_finite()) {
            return Err(PolygonError::NotFinite);
        }
        if corners_m.len() < 3 { Err(PolygonError::TooFewCorners) } else { Ok(Self { corners_m }) }
    }

    /// The corners in order, metres.
    #[must_use]
    pub fn corners_m(&self) -> &[[f64; 2]] {
        &self.corners_m
    }

    /// Whether a point (metres) lies inside.
    #[must_use]
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let is_crossed =
            |[[x0, y0], [x1, y1]]: [[f64; 2]; 2]| (y0 > y) != (y1 > y) && x < x0 + (y - y0) / (y1 - y0) * (x1 - x0);
        self.edges().filter(|edge| is_crossed(*edge)).count() % 2 == 1
    }

    /// The share of the way from one point to another (metres) at which an edge is first met; `None` where none is.
    #[must_use]
    pub fn first_crossing(&self, from_m: [f64; 2], to_m: [f64; 2]) -> Option<f64> {
        let [dx, dy] = [to_m[0] - from_m[0], to_m[1] - from_m[1]];
        let crossing = |[start, end]: [[f64; 2]; 2]| {
            let [ex, ey] = [end[0] - start[0], end[1] - start[1]];
            let [sx, sy] = [start[0] - from_m[0], start[1] - from_m[1]];
            let cross = dx * ey - dy * ex;
            let (along_way, along_edge) = ((sx * ey - sy * ex) / cross, (sx * dy - sy * dx) / cross);
            // A way along the edge gives no number, which is in no range.
            ((0.0..=1.0).contains(&along_way) && (0.0..=1.0).contains(&along_edge)).then_some(along_way)
        };
        self.edges().filter_map(crossing).min_by(f64::total_cmp)
    }

    fn edges(&self) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
        let next = self.corners_m.iter().cycle().skip(1);
        self.corners_m.iter().zip(next).map(|(&start, &end)| [start, end])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hall_with_a_corner() -> Polygon {
        Polygon::new(vec![[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]]).unwrap()
    }

    #[test]
    fn what_lies_in_the_corner_is_outside() {
        let hall = hall_with_a_corner();
        assert!(hall.contains([0.5, 2.5]) && hall.contains([3.5, 0.5]));
        assert!(!hall.contains([3.0, 2.0]) && !hall.contains([-0.1, 0.5]));
    }

    #[test]
    fn a_way_out_ends_at_the_edge() {
        let hall = hall_with_a_corner();
        assert_eq!(hall.first_crossing([0.5, 2.0], [2.5, 2.0]), Some(0.25));
        assert_eq!(hall.first_crossing([0.5, 2.0], [0.5, 0.5]), None);
    }

    #[test]
    fn two_corners_are_no_polygon() {
        assert_eq!(Polygon::new(vec![[0.0, 0.0], [1.0, 0.0]]), Err(PolygonError::TooFewCorners));
        assert_eq!(Polygon::new(vec![[0.0, 0.0], [1.0, f64::NAN], [1.0, 1.0]]), Err(PolygonError::NotFinite));
    }

    proptest! {
        #[test]
        fn whoever_goes_from_inside_to_outside_meets_an_edge(
            inside in (0.05..0.95_f64, 0.05..2.9_f64), outside in (1.1..6.0_f64, 1.1..6.0_f64),
        ) {
            let hall = hall_with_a_corner();
            let (inside, outside) = ([inside.0, inside.1], [outside.0, outside.1]);
            prop_assert!(hall.contains(inside) && !hall.contains(outside));
            let share = hall.first_crossing(inside, outside).unwrap();
            let before = [0, 1].map(|axis| inside[axis] + (share - 1e-9) * (outside[axis] - inside[axis]));
            prop_assert!(hall.contains(before));
        }
    }
}
