//! What people change of a finished map: what was never a wall, what is not wanted, which way is up.

use super::{Session, SessionError};
use crate::compact_scan::CompactScan;
use crate::frame::{BodyScan, Points};
use crate::geometry::{Polygon, Pose2};
use crate::scan_matcher::MatcherConfig;
use crate::surface::SurfaceScan;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

/// A part of the world, whose frame is that of the session's trajectory.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// What lies inside the polygon.
    Inside(Polygon),
    /// What lies outside the polygon.
    Outside(Polygon),
}

impl Region {
    fn contains(&self, point_m: [f64; 2]) -> bool {
        match self {
            Self::Inside(polygon) => polygon.contains(point_m),
            Self::Outside(polygon) => !polygon.contains(point_m),
        }
    }

    fn polygon(&self) -> &Polygon {
        match self {
            Self::Inside(polygon) | Self::Outside(polygon) => polygon,
        }
    }

    /// What a scan saw of the region: rays that end elsewhere are free up to where they leave it. A ray frees all that
    /// it passes, so that nothing is kept of scans that were taken outside of what is to be all.
    fn seen(&self, world_from_body: &Pose2, scan: &BodyScan) -> BodyScan {
        let origin = world_from_body.transform_point(scan.origin_m);
        let starts_inside = self.contains(origin);
        let mut seen = BodyScan { origin_m: scan.origin_m, range_noise_m: scan.range_noise_m, ..BodyScan::default() };
        if matches!(self, Self::Inside(_)) && !starts_inside {
            return seen;
        }
        let mut add = |point: [f32; 2], is_hit: bool| {
            let end = world_from_body.transform_point(point.map(f64::from));
            if self.contains(end) {
                let points = if is_hit { &mut seen.hits } else { &mut seen.free_ends };
                points.push(point[0], point[1]);
            } else if let Some(share) = self.polygon().first_crossing(origin, end).filter(|_| starts_inside) {
                push_between(&mut seen.free_ends, scan.origin_m, point, share);
            }
        };
        scan.hits.iter().for_each(|point| add(point, true));
        scan.free_ends.iter().for_each(|point| add(point, false));
        seen
    }
}

/// Appends the point at a share of the way from `from_m` to `to_m`.
fn push_between(points: &mut Points, from_m: [f64; 2], to_m: [f32; 2], share: f64) {
    let [x, y] = [0, 1].map(|axis| (from_m[axis] + share * (f64::from(to_m[axis]) - from_m[axis])) as f32);
    points.push(x, y);
}

/// Directions of walls are counted in so many classes of a right angle.
const CLASSES: usize = 360;

impl Session {
    /// The session with nothing but what was seen of a region: people who walked along and furniture that is gone are
    /// taken out, or all but a part of the building. Trajectory and loops stay as they are; whoever goes on from it, or
    /// looks for himself in it, does not see what was taken out.
    ///
    /// `matcher` is how scans were matched.
    ///
    /// # Errors
    /// When the session's parts do not belong together.
    pub fn restricted_to(&self, region: &Region, matcher: &MatcherConfig) -> Result<Self, SessionError> {
        let world_from_bodies = self.world_from_bodies();
        let mut scans = self.scans().to_vec();
        scans.par_iter_mut().for_each(|scan| {
            scan.points = CompactScan::new(&region.seen(&world_from_bodies[scan.frame], &scan.points.unpack()));
        });
        Self::restore(self.state(matcher), self.poses(), scans)
    }

    /// By how much the session must be turned so that most walls run along the axes: the least such angle, radians,
    /// between −π/4 and π/4. `None` where no wall was seen.
    #[must_use]
    pub fn angle_to_walls(&self, matcher: &MatcherConfig) -> Option<f64> {
        let world_from_bodies = self.world_from_bodies();
        let thinning = matcher.thinning();
        let angles_of = |scan: &super::StoredScan| -> Vec<f64> {
            let heading = world_from_bodies[scan.frame].theta;
            let surfaces = SurfaceScan::new(&scan.points.unpack(), &thinning);
            let walls = surfaces.iter().filter(|(_, [x, y])| x.hypot(*y) > 0.5);
            walls.map(|(_, [x, y])| (f64::from(y).atan2(f64::from(x)) + heading).rem_euclid(FRAC_PI_2)).collect()
        };
        let angles: Vec<f64> = self.scans().par_iter().flat_map_iter(angles_of).collect();
        let mut counts = vec![0_usize; CLASSES];
        for angle in &angles {
            counts[((angle / FRAC_PI_2 * CLASSES as f64) as usize).min(CLASSES - 1)] += 1;
        }
        // The class with the most walls in and beside it …
        let around = |class: usize| (0..5).map(|step| counts[(class + CLASSES - 2 + step) % CLASSES]).sum::<usize>();
        let fullest = (0..CLASSES).max_by_key(|&class| (around(class), std::cmp::Reverse(class)))?;
        // … and the mean of what lies within two degrees, by mean shift.
        let mut direction = (fullest as f64 + 0.5) / CLASSES as f64 * FRAC_PI_2;
        for _ in 0..10 {
            let offset = |angle: f64| (angle - direction + 1.5 * FRAC_PI_2).rem_euclid(FRAC_PI_2) - 0.5 * FRAC_PI_2;
            let near = angles.iter().map(|&angle| offset(angle)).filter(|offset| offset.abs() < TAU / 180.0);
            let (sum, count) = near.fold((0.0, 0), |(sum, count), offset| (sum + offset, count + 1));
            if count == 0 {
                return None;
            }
            direction += sum / f64::from(count);
        }
        let direction = direction.rem_euclid(FRAC_PI_2);
        Some(if direction > 0.5 * FRAC_PI_2 { FRAC_PI_2 - direction } else { -direction })
    }
}
