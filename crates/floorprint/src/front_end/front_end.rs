//! The filter that was chosen.

use super::{FilterKind, FilterStep, FrontEndState, GrisettiFilter, ParticleFilter, PreparedScan, SharedMapFilter};
use crate::Config;
use crate::compact_scan::CompactScan;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::key_scan::KeyScan;
use crate::map::OccupancyGrid;
use crate::profiler::Profiler;
use crate::surface::Thinning;

/// What tracks the robot from scan to scan, in a frame of its own that drifts slowly: `odom`.
#[derive(Debug)]
pub enum FrontEnd {
    /// The report's: many poses, one occupancy grid.
    SharedMap(Box<SharedMapFilter>),
    /// A map of surfaces for every particle.
    RaoBlackwellized(Box<ParticleFilter>),
    /// That of Grisetti et al. 2007.
    Grisetti2007(Box<GrisettiFilter>),
}

impl FrontEnd {
    /// The filter that the configuration asks for, nothing seen yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        match config.filter.kind {
            FilterKind::SharedMap => Self::SharedMap(Box::new(SharedMapFilter::new(config))),
            FilterKind::RaoBlackwellized => Self::RaoBlackwellized(Box::new(ParticleFilter::new(config))),
            FilterKind::Grisetti2007 => Self::Grisetti2007(Box::new(GrisettiFilter::new(config))),
        }
    }

    /// How scans are thinned that may be [prepared](PreparedScan) ahead; `None` for filters that do not need it.
    #[must_use]
    pub fn thinning(&self) -> Option<Thinning> {
        match self {
            Self::RaoBlackwellized(filter) => Some(filter.thinning()),
            Self::SharedMap(_) | Self::Grisetti2007(_) => None,
        }
    }

    /// One step of the filter; `prepared` is the frame's scan, where that was prepared ahead.
    pub fn process(
        &mut self,
        frame: &Frame,
        prepared: Option<PreparedScan>,
        profiler: &mut dyn Profiler,
    ) -> FilterStep {
        match self {
            Self::SharedMap(filter) => filter.process(frame, profiler),
            Self::RaoBlackwellized(filter) => match prepared {
                Some(prepared) => filter.process_prepared(frame, prepared, profiler),
                None => filter.process(frame, profiler),
            },
            Self::Grisetti2007(filter) => filter.process(frame, profiler),
        }
    }

    /// Whether its key scans say how certain the way from one to the next is, so that loops can be closed.
    #[must_use]
    pub fn can_close_loops(&self) -> bool {
        matches!(self, Self::RaoBlackwellized(_))
    }

    /// The scan that the last step wrote into the map, where the filter tells.
    pub fn take_key_scan(&mut self) -> Option<KeyScan> {
        match self {
            Self::SharedMap(_) => None,
            Self::RaoBlackwellized(filter) => filter.take_key_scan(),
            Self::Grisetti2007(filter) => filter.take_key_scan(),
        }
    }

    /// The points of the last scan, where they are worth being fitted to the map again at the end.
    #[must_use]
    pub fn points(&self) -> Option<&CompactScan> {
        match self {
            Self::RaoBlackwellized(filter) => Some(filter.points()),
            Self::SharedMap(_) | Self::Grisetti2007(_) => None,
        }
    }

    /// The poses from a frame on (counted from 0) of the particle that is the best now, `odom_from_body`.
    #[must_use]
    pub fn poses_since(&self, frame: usize) -> Vec<Pose2> {
        let all = match self {
            Self::RaoBlackwellized(filter) => return filter.poses_since(frame),
            Self::SharedMap(filter) => filter.trajectory(),
            Self::Grisetti2007(filter) => filter.trajectory(),
        };
        all.into_iter().skip(frame).map(|stamped| stamped.pose).collect()
    }

    /// What is needed to go on later; `None` for filters that cannot.
    #[must_use]
    pub fn state(&self) -> Option<FrontEndState> {
        match self {
            Self::RaoBlackwellized(filter) => Some(filter.state()),
            Self::SharedMap(_) | Self::Grisetti2007(_) => None,
        }
    }

    /// Takes it that the next scan may have been taken anywhere.
    pub fn interrupt(&mut self) {
        if let Self::RaoBlackwellized(filter) = self {
            filter.interrupt();
        }
    }

    /// The same of a robot that is said to be at `odom_from_body`.
    pub fn interrupt_at(&mut self, odom_from_body: &Pose2) {
        if let Self::RaoBlackwellized(filter) = self {
            filter.interrupt_at(odom_from_body);
        }
    }

    /// Forgets the poses before a frame, where that is possible: they are the session's from now on.
    pub fn forget_poses_before(&mut self, frame: usize) {
        if let Self::RaoBlackwellized(filter) = self {
            filter.forget_poses_before(frame);
        }
    }

    /// The map that the filter itself draws, where it draws one.
    #[must_use]
    pub fn drawn_map(&self) -> Option<&OccupancyGrid> {
        match self {
            Self::SharedMap(filter) => Some(filter.map()),
            Self::RaoBlackwellized(_) | Self::Grisetti2007(_) => None,
        }
    }

    /// The true length of what the odometry states as one, where the filter learns it.
    #[must_use]
    pub fn odometry_scale(&self) -> Option<f64> {
        match self {
            Self::RaoBlackwellized(filter) => Some(filter.odometry_scale()),
            Self::SharedMap(_) | Self::Grisetti2007(_) => None,
        }
    }
}
