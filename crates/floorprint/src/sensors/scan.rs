//! Planar laser scans: a range, an angle and a time for every ray.

use crate::geometry::Pose2;
use crate::ids::SensorId;
use std::sync::Arc;

/// What a scanner's rays have in common from scan to scan.
///
/// Every ray has its own angle and time; nothing assumes that the number of rays
/// equals the field of view over the increment.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanGeometry {
    /// Angle of each ray in the LiDAR's frame, radians, counter-clockwise from its x axis.
    pub angles_rad: Vec<f64>,
    /// When each ray was taken relative to the scan's stamp, seconds.
    pub time_offsets_s: Vec<f32>,
    /// Ranges below this are no measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or beyond this mean that nothing came back, metres.
    pub range_max_m: f32,
    /// Whether a range below `range_min_m` means that nothing came back (some drivers write 0 for it).
    pub below_minimum_is_no_return: bool,
}

impl ScanGeometry {
    /// Number of rays.
    #[must_use]
    pub fn len(&self) -> usize {
        self.angles_rad.len()
    }

    /// Whether there is no ray at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.angles_rad.is_empty()
    }

    /// What a raw range (metres) says.
    #[must_use]
    pub fn classify(&self, range_m: f32) -> Ray {
        if range_m.is_nan() {
            Ray::Invalid
        } else if range_m >= self.range_max_m {
            Ray::NoReturn
        } else if range_m < self.range_min_m {
            if self.below_minimum_is_no_return { Ray::NoReturn } else { Ray::Invalid }
        } else {
            Ray::Hit(range_m)
        }
    }
}

/// One ray's outcome.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ray {
    /// Something was hit at this range, metres.
    Hit(f32),
    /// Nothing came back from within the sensor's reach.
    NoReturn,
    /// The reading says nothing.
    Invalid,
}

/// One turn of a planar LiDAR.
#[derive(Debug, Clone)]
pub struct Scan {
    /// The LiDAR that took it.
    pub sensor: SensorId,
    /// Time of the scan, seconds (the clock of the data set).
    pub stamp_s: f64,
    /// Raw ranges, metres, one per ray of `geometry`.
    pub ranges_m: Vec<f32>,
    /// Angles, times and limits of the rays.
    pub geometry: Arc<ScanGeometry>,
    /// The base's odometry pose that the log itself states for this scan, if it does.
    pub odometry: Option<Pose2>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geometry(below_minimum_is_no_return: bool) -> ScanGeometry {
        ScanGeometry {
            angles_rad: vec![0.0],
            time_offsets_s: vec![0.0],
            range_min_m: 0.1,
            range_max_m: 30.0,
            below_minimum_is_no_return,
        }
    }

    #[test]
    fn ranges_are_told_apart() {
        let plain = geometry(false);
        assert_eq!(plain.classify(1.0), Ray::Hit(1.0));
        assert_eq!(plain.classify(f32::INFINITY), Ray::NoReturn);
        assert_eq!(plain.classify(30.0), Ray::NoReturn);
        assert_eq!(plain.classify(0.001), Ray::Invalid);
        assert_eq!(plain.classify(-1.0), Ray::Invalid);
        assert_eq!(plain.classify(f32::NAN), Ray::Invalid);
        assert_eq!(geometry(true).classify(0.0), Ray::NoReturn);
    }
}
