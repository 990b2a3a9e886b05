//! What there is to see, and the newest message of each.

use crate::board::{Mode, Picture, Situation};
use crate::engine::Step;
use crate::frame_names::FrameNames;
use crate::health::Health;
use floorprint::geometry::Pose2;
use floorprint_io::foxglove::{
    FrameTransform, FrameTransforms, Grid, Line, LineKind, Message, PointCloud, PosesInFrame, SceneUpdate, Schema,
    map_grid,
};
use floorprint_io::ros::{Diagnostics, Header, Message as _, PoseWithCovariance, SpacePose};
use std::time::Duration;

/// Cells of a map that are sent at most: larger maps come in larger cells.
const MOST_CELLS: usize = 1 << 22;
/// Colours of lines, as on the page.
const TRAJECTORY: [f64; 4] = [0.15, 0.39, 0.92, 1.0];
const CLOSURES: [f64; 4] = [0.09, 0.64, 0.29, 0.8];

/// A channel, in the order of their numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Topic {
    Map,
    Scene,
    Transforms,
    Pose,
    Scan,
    Hypotheses,
    Diagnostics,
}

/// Which message of a topic it is: another one says something else.
pub(super) type Version = [u64; 2];

impl Topic {
    /// All of them.
    pub(super) const ALL: [Self; 7] =
        [Self::Map, Self::Scene, Self::Transforms, Self::Pose, Self::Scan, Self::Hypotheses, Self::Diagnostics];

    /// Its number.
    pub(super) fn id(self) -> u32 {
        self as u32 + 1
    }

    /// By its number.
    pub(super) fn of(id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.id() == id)
    }

    /// Its name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Map => "/map",
            Self::Scene => "/scene",
            Self::Transforms => "/tf",
            Self::Pose => "/pose",
            Self::Scan => "/scan",
            Self::Hypotheses => "/hypotheses",
            Self::Diagnostics => "/diagnostics",
        }
    }

    /// What its messages are.
    pub(super) fn schema(self) -> Schema {
        match self {
            Self::Map => Schema::of_foxglove::<Grid<'_>>(),
            Self::Scene => Schema::of_foxglove::<SceneUpdate<'_>>(),
            Self::Transforms => Schema::of_foxglove::<FrameTransforms<'_>>(),
            Self::Pose => Schema::of_ros::<PoseWithCovariance<'_>>(),
            Self::Scan => Schema::of_foxglove::<PointCloud<'_>>(),
            Self::Hypotheses => Schema::of_foxglove::<PosesInFrame<'_>>(),
            Self::Diagnostics => Schema::of_ros::<Diagnostics<'_>>(),
        }
    }

    /// Shortest time between two of its messages.
    pub(super) fn period(self) -> Duration {
        match self {
            Self::Diagnostics => crate::health::PERIOD,
            _ => Duration::ZERO,
        }
    }
}

/// A look at the board.
pub(super) struct View<'a> {
    pub(super) mode: Mode,
    pub(super) frames: &'a FrameNames,
    pub(super) situation: &'a Situation,
    pub(super) picture: &'a Picture,
}

impl View<'_> {
    /// Which message of a topic is the newest; `None` where there is none.
    pub(super) fn version(&self, topic: Topic) -> Option<Version> {
        let step = self.situation.step.as_ref();
        match topic {
            Topic::Map | Topic::Scene => (self.picture.revision > 0).then_some([self.picture.revision, 0]),
            // In a picture that is only looked at nothing moves; where the frames are is told nevertheless.
            Topic::Transforms if step.is_none() => Some([0, 0]),
            Topic::Pose if step?.pose.is_none() => None,
            Topic::Transforms => {
                let odometry = self.situation.odometry.map_or(0, |(stamp_s, _)| stamp_s.to_bits());
                Some([step?.stamp_s.to_bits(), odometry])
            }
            Topic::Pose | Topic::Scan | Topic::Hypotheses => Some([step?.stamp_s.to_bits(), 0]),
            Topic::Diagnostics => Some([step?.stamp_s.to_bits(), self.situation.counts.records as u64]),
        }
    }

    /// The time of what is newest, seconds.
    pub(super) fn stamp_s(&self) -> f64 {
        self.situation.now_s()
    }

    /// The newest message of a topic; `None` where there is none.
    pub(super) fn message(&self, topic: Topic, health: &mut Health) -> Option<Vec<u8>> {
        let FrameNames { map, base, .. } = self.frames;
        let step = self.situation.step.as_deref();
        let stamp_s = step.map_or(0.0, |step| step.stamp_s);
        Some(match topic {
            Topic::Map => map_grid(&self.picture.map.coarse_raster(MOST_CELLS)?, stamp_s, map).to_protobuf(),
            Topic::Scene => self.scene(stamp_s).to_protobuf(),
            Topic::Transforms => self.transforms(step).to_protobuf(),
            Topic::Pose => {
                let step = step?;
                let header = Header { stamp_s, frame: map };
                PoseWithCovariance { header, pose: step.pose?, covariance: step.covariance }.to_cdr()
            }
            Topic::Scan => PointCloud { stamp_s, frame: base, points: &step?.scan.hits }.to_protobuf(),
            Topic::Hypotheses => {
                let step = step?;
                let several = step.modes.iter().map(|(pose, _)| SpacePose::from(pose));
                let poses = if self.mode == Mode::Localization {
                    several.collect()
                } else {
                    step.pose.iter().map(SpacePose::from).collect()
                };
                PosesInFrame { stamp_s, frame: map, poses }.to_protobuf()
            }
            Topic::Diagnostics => health.tell(self.situation, step?, self.stamp_s()),
        })
    }

    fn scene(&self, stamp_s: f64) -> SceneUpdate<'_> {
        let trajectory = Line {
            id: "trajectory",
            kind: LineKind::Strip,
            points_m: self.picture.trajectory.clone(),
            color: TRAJECTORY,
        };
        let closures = Line {
            id: "loop closures",
            kind: LineKind::Pairs,
            points_m: self.picture.closures.as_flattened().to_vec(),
            color: CLOSURES,
        };
        SceneUpdate { stamp_s, frame: &self.frames.map, lines: vec![trajectory, closures] }
    }

    /// map→odom as of the newest scan, odom→base as of the newest odometry, and the mounts.
    fn transforms(&self, step: Option<&Step>) -> FrameTransforms<'_> {
        let FrameNames { map, odom, base, lidars } = self.frames;
        let stamp_s = self.stamp_s();
        let map_from_odom = step.map_or(Pose2::IDENTITY, |step| step.map_from_odom);
        let of_step = step.and_then(|step| Some(map_from_odom.inverse().compose(&step.pose?)));
        let odom_from_base = self.situation.odometry.map(|(_, pose)| pose).or(of_step).unwrap_or(Pose2::IDENTITY);
        let moving = [(map, odom, map_from_odom), (odom, base, odom_from_base)]
            .map(|(parent, child, pose)| FrameTransform { stamp_s, parent, child, pose: (&pose).into() });
        let mounts =
            lidars.iter().map(|(child, mount)| FrameTransform { stamp_s, parent: base, child, pose: mount.into() });
        FrameTransforms(moving.into_iter().chain(mounts).collect())
    }
}
