//! Scans of a few straight walls, for tests.

use crate::frame::{BodyScan, Frame};
use crate::geometry::Pose2;
use std::f64::consts::TAU;

/// Walls from point to point, metres.
#[derive(Debug, Clone, Default)]
pub struct Walls(Vec<[[f64; 2]; 2]>);

impl Walls {
    /// Adds a closed line through corners.
    pub fn with_loop(mut self, corners: &[[f64; 2]]) -> Self {
        let ends = corners.iter().cycle().skip(1);
        self.0.extend(corners.iter().zip(ends).map(|(&from, &to)| [from, to]));
        self
    }

    /// Adds a rectangle around a centre.
    pub fn with_box(self, [x, y]: [f64; 2], [half_x, half_y]: [f64; 2]) -> Self {
        self.with_loop(&[
            [x - half_x, y - half_y],
            [x + half_x, y - half_y],
            [x + half_x, y + half_y],
            [x - half_x, y + half_y],
        ])
    }

    /// A room of 8 m × 6 m with a cupboard and a pillar, the robot's start in its middle.
    pub fn room() -> Self {
        Self::default()
            .with_box([0.0, 0.0], [4.0, 3.0])
            .with_box([3.5, 2.0], [0.5, 0.4])
            .with_box([-2.0, -1.7], [0.2, 0.2])
    }

    /// What a LiDAR in the body's origin sees all around, without noise, up to 30 m.
    pub fn scan_from(&self, pose: &Pose2, beams: usize) -> BodyScan {
        let mut scan = BodyScan::default();
        for beam in 0..beams {
            let angle = (beam as f64 + 0.5) / beams as f64 * TAU;
            let (sin, cos) = (pose.theta + angle).sin_cos();
            let distance = |&[[ax, ay], [bx, by]]: &[[f64; 2]; 2]| {
                let (wx, wy) = (bx - ax, by - ay);
                let determinant = cos * wy - sin * wx;
                let (dx, dy) = (ax - pose.x, ay - pose.y);
                let (range, share) = ((dx * wy - dy * wx) / determinant, (dx * sin - dy * cos) / determinant);
                (range > 0.0 && (0.0..=1.0).contains(&share)).then_some(range)
            };
            let range = self.0.iter().filter_map(distance).fold(f64::INFINITY, f64::min);
            if range < 30.0 {
                scan.hits.push((range * angle.cos()) as f32, (range * angle.sin()) as f32);
            }
        }
        scan
    }
}

/// A frame with its odometry.
pub fn frame(index: usize, motion: Option<Pose2>, scan: BodyScan) -> Frame {
    Frame { index, stamp_s: index as f64 * 0.1, elapsed_s: 0.1, motion, dead_reckoning: Pose2::IDENTITY, scan }
}

/// Poses at equal steps along a path with rounded corners, `step_m` apart, heading along it.
pub fn poses_along(corners: &[[f64; 2]], step_m: f64) -> Vec<Pose2> {
    let mut poses: Vec<Pose2> = Vec::new();
    for leg in corners.windows(2) {
        let (dx, dy) = (leg[1][0] - leg[0][0], leg[1][1] - leg[0][1]);
        let (length, heading) = (dx.hypot(dy), dy.atan2(dx));
        if let Some(&last) = poses.last() {
            let turn = Pose2::new(0.0, 0.0, heading).theta - last.theta;
            let turn = Pose2::new(0.0, 0.0, turn).theta;
            let steps = (turn.abs() / 0.15).ceil() as usize;
            poses.extend((1..=steps).map(|k| Pose2::new(last.x, last.y, last.theta + turn * k as f64 / steps as f64)));
        }
        let steps = (length / step_m).round() as usize;
        let first = usize::from(!poses.is_empty());
        poses.extend((first..=steps).map(|k| {
            let share = k as f64 / steps as f64;
            Pose2::new(leg[0][0] + share * dx, leg[0][1] + share * dy, heading)
        }));
    }
    poses
}
