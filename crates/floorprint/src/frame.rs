//! What one step of the filter gets: a scan in the body's frame and the motion since the last.

use crate::geometry::Pose2;

/// A scan together with the odometry that leads to it.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Number of the scan in the data set, from 0; scans that were dropped or skipped leave gaps.
    pub index: usize,
    /// The scan's own stamp, seconds.
    pub stamp_s: f64,
    /// Seconds since the previous frame, never negative; 0 where they are unknown: for the
    /// first frame, and where a log's stamps run backwards in file order.
    pub elapsed_s: f64,
    /// Odometry: `previous_body_from_body`. The identity for the first frame; `None` where
    /// nothing measured the motion (no odometry at all, or outside its span).
    pub motion: Option<Pose2>,
    /// Dead reckoning: `start_from_body`, the identity for the first frame. It stays where it
    /// is while the motion is unknown.
    pub dead_reckoning: Pose2,
    /// The scan in the body's frame.
    pub scan: BodyScan,
}

/// A scan's points in the body's frame, filtered by range and (where asked for) de-skewed
/// to the body's pose at the scan's stamp, or with the times that this takes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BodyScan {
    /// Where the LiDAR is in the body's frame, metres.
    pub origin_m: [f64; 2],
    /// Where rays ended on something, in the order of the beams.
    pub hits: Points,
    /// Up to where rays without a return are taken to be free; empty when they are ignored.
    pub free_ends: Points,
    /// Standard deviation of the ranges as far as it is known, metres; 0 where it is not.
    pub range_noise_m: f32,
    /// When the points were seen, where the body's motion in the meantime is yet to be undone.
    pub skew: Option<Skew>,
}

/// When the points of a scan were seen, seconds after its stamp.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skew {
    /// The hits.
    pub hits_s: Vec<f32>,
    /// The free ends.
    pub free_ends_s: Vec<f32>,
}

impl BodyScan {
    /// How far from the body's origin the farthest point lies, metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        let points = self.hits.iter().chain(self.free_ends.iter());
        f64::from(points.map(|[x, y]| x * x + y * y).fold(0.0, f32::max).sqrt())
    }
}

/// Points of the plane, stored by coordinate so that loops over them vectorise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// x of each point, metres.
    pub x_m: Vec<f32>,
    /// y of each point, metres.
    pub y_m: Vec<f32>,
}

impl Points {
    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.x_m.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x_m.is_empty()
    }

    /// Appends a point, metres.
    pub fn push(&mut self, x_m: f32, y_m: f32) {
        self.x_m.push(x_m);
        self.y_m.push(y_m);
    }

    /// The points in order, metres.
    pub fn iter(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        self.x_m.iter().zip(&self.y_m).map(|(&x, &y)| [x, y])
    }
}
