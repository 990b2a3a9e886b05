//! What the node publishes: transforms and poses with each scan, the map as it grows, and how it goes.

use super::node::{Node, NodeError, latched, of_sensors, reliable};
use super::options::Options;
use super::raw_message::RawMessage;
use crate::board::{Board, Mode, Picture, Situation};
use crate::health::{self, Health};
use crate::map_picture::{MapPicture, PICTURE_SIDE};
use floorprint::geometry::Pose2;
use floorprint::map::Occupancy;
use floorprint_io::ros::{
    Diagnostics, Header, MapMetaData, Message, OccupancyGrid, OccupancyGridUpdate, ParticleCloud, PoseWithCovariance,
    Transform, Transforms,
};
use futures::executor::block_on;
use futures::future::{Either, select};
use ros2_client::Publisher;
use std::pin::pin;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Transforms are published no more often than this (`transform_publish_period` of slam_toolbox).
const TRANSFORM_PERIOD: Duration = Duration::from_millis(20);

/// The node's mouth.
pub(super) struct Announcer {
    board: Arc<Board>,
    options: Options,
    base_frame: String,
    map: Publisher<RawMessage>,
    meta_data: Publisher<RawMessage>,
    updates: Publisher<RawMessage>,
    transforms: Publisher<RawMessage>,
    pose: Publisher<RawMessage>,
    /// What a localizer considers; nothing where a map is made.
    particles: Option<Publisher<RawMessage>>,
    diagnostics: Publisher<RawMessage>,
    /// What of the map was published, and when all of it.
    published: Option<(Layout, Instant)>,
    /// Revision of the last picture that was published, whole or in patches.
    revision: u64,
    stamp_s: f64,
    transformed: Option<Instant>,
    diagnosed: Instant,
    health: Health,
}

/// Where the published map lies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Layout {
    /// First column and row of pictures.
    first: [i32; 2],
    /// Columns and rows of pictures.
    size: [usize; 2],
    /// Where pictures are counted from, metres: another map may have another corner.
    corner_m: [f64; 2],
    /// Side of a cell, metres.
    resolution_m: f64,
    /// Revision of the map that was published whole.
    revision: u64,
}

impl Announcer {
    pub(super) fn start(node: &mut Node, board: &Arc<Board>, base_frame: &str) -> Result<(), NodeError> {
        let options = node.options().clone();
        let map = options.map_topic.clone();
        let pose = if board.mode == Mode::Localization { "amcl_pose" } else { "pose" };
        let mut announcer = Self {
            board: Arc::clone(board),
            base_frame: base_frame.to_owned(),
            map: node.publisher::<OccupancyGrid<'_>>(&map, &latched(1))?,
            meta_data: node.publisher::<MapMetaData>(&format!("{map}_metadata"), &latched(1))?,
            updates: node.publisher::<OccupancyGridUpdate<'_>>(&format!("{map}_updates"), &reliable(100))?,
            transforms: node.publisher::<Transforms<'_>>("/tf", &reliable(100))?,
            pose: node.publisher::<PoseWithCovariance<'_>>(pose, &latched(1))?,
            particles: match board.mode {
                Mode::Localization => Some(node.publisher::<ParticleCloud<'_>>("particle_cloud", &of_sensors())?),
                Mode::Mapping | Mode::Viewing => None,
            },
            diagnostics: node.publisher::<Diagnostics<'_>>("/diagnostics", &reliable(10))?,
            options,
            published: None,
            revision: 0,
            stamp_s: f64::NEG_INFINITY,
            transformed: None,
            diagnosed: Instant::now(),
            health: Health::default(),
        };
        let announce = move || block_on(announcer.announce());
        let thread = thread::Builder::new().name("ros2-out".to_owned()).spawn(announce);
        thread.map(drop).map_err(|error| NodeError::of("no thread", error))
    }

    async fn announce(&mut self) {
        let (mut situation, mut picture) = self.board.watch();
        situation.mark_changed();
        picture.mark_changed();
        loop {
            let changed = {
                let (of_situation, of_picture) = (pin!(situation.changed()), pin!(picture.changed()));
                match select(of_situation, of_picture).await {
                    Either::Left((changed, _)) => changed.map(|()| true),
                    Either::Right((changed, _)) => changed.map(|()| false),
                }
            };
            match changed {
                Ok(true) => {
                    let newest = situation.borrow_and_update().clone();
                    self.of_situation(&newest);
                }
                Ok(false) => {
                    let newest = picture.borrow_and_update().clone();
                    self.of_picture(&newest);
                }
                Err(_) => return,
            }
        }
    }

    fn of_situation(&mut self, situation: &Situation) {
        let Some(step) = &situation.step else { return };
        let is_new = step.stamp_s != self.stamp_s;
        let now_s = situation.now_s();
        if is_new || self.transformed.is_none_or(|transformed| transformed.elapsed() >= TRANSFORM_PERIOD) {
            self.transformed = Some(Instant::now());
            let Options { map_frame, odom_frame, transform_timeout, .. } = &self.options;
            let ahead_s = now_s + transform_timeout.as_secs_f64();
            let mut all = vec![Transform {
                header: Header { stamp_s: ahead_s, frame: map_frame },
                child: odom_frame,
                pose: (&step.map_from_odom).into(),
            }];
            if situation.odometry.is_none() {
                // Nobody else says where the body is in the odometry's frame.
                let header = Header { stamp_s: ahead_s, frame: odom_frame };
                all.push(Transform { header, child: &self.base_frame, pose: (&Pose2::IDENTITY).into() });
            }
            publish(&self.transforms, &Transforms(all));
        }
        if is_new {
            self.stamp_s = step.stamp_s;
            if let Some(pose) = step.pose {
                let header = Header { stamp_s: step.stamp_s, frame: &self.options.map_frame };
                publish(&self.pose, &PoseWithCovariance { header, pose, covariance: step.covariance });
            }
            if let Some(particles) = &self.particles {
                let header = Header { stamp_s: step.stamp_s, frame: &self.options.map_frame };
                publish(particles, &ParticleCloud { header, particles: &step.modes });
            }
        }
        if self.diagnosed.elapsed() >= health::PERIOD {
            self.diagnosed = Instant::now();
            let _ = self.diagnostics.publish(RawMessage(self.health.tell(situation, step, now_s)));
        }
    }

    /// Publishes the whole map where it has grown or it is time to, and else the patches that changed.
    fn of_picture(&mut self, picture: &Picture) {
        let map = &picture.map;
        let Some(layout) = Layout::of(map, picture.revision) else { return };
        let is_due = match &self.published {
            None => true,
            Some((last, at)) => {
                let has_grown = *last != Layout { revision: last.revision, ..layout };
                let changed = map.changed.values().any(|revision| *revision > last.revision);
                has_grown || (changed && at.elapsed() >= self.options.map_update_interval)
            }
        };
        let stamp_s = self.board.situation().step.as_ref().map_or(0.0, |step| step.stamp_s);
        let header = Header { stamp_s, frame: &self.options.map_frame };
        if is_due {
            let _ = self.map.publish(RawMessage(occupancy_grid_in(layout, map, header)));
            publish(&self.meta_data, &layout.meta_data());
            self.published = Some((layout, Instant::now()));
        } else {
            for (&(column, row), _) in map.changed.iter().filter(|(_, revision)| **revision > self.revision) {
                let Some(pixels) = map.picture(0, (column, row)) else { continue };
                let cells: Vec<u8> =
                    pixels.chunks_exact(PICTURE_SIDE).rev().flatten().map(|pixel| byte(*pixel)).collect();
                let corner = [column - layout.first[0], row - layout.first[1]].map(|at| at * PICTURE_SIDE as i32);
                let size = [PICTURE_SIDE as u32; 2];
                publish(&self.updates, &OccupancyGridUpdate { header: header.clone(), corner, size, cells: &cells });
            }
        }
        self.revision = picture.revision;
    }
}

/// The whole map as a `nav_msgs/OccupancyGrid` in CDR; without a cell where there is none.
pub(super) fn occupancy_grid(map: &MapPicture, stamp_s: f64, frame: &str) -> Vec<u8> {
    let header = Header { stamp_s, frame };
    match Layout::of(map, 0) {
        Some(layout) => occupancy_grid_in(layout, map, header),
        None => {
            let info = MapMetaData { resolution_m: 0.0, size: [0; 2], origin_m: [0.0; 2] };
            OccupancyGrid { header, info, cells: &[] }.to_cdr()
        }
    }
}

fn occupancy_grid_in(layout: Layout, map: &MapPicture, header: Header<'_>) -> Vec<u8> {
    let [columns, rows] = layout.size.map(|pictures| pictures * PICTURE_SIDE);
    let mut cells = vec![UNKNOWN; columns * rows];
    for &(column, row) in map.changed.keys() {
        let at = [column - layout.first[0], row - layout.first[1]].map(|at| at as usize * PICTURE_SIDE);
        let Some(pixels) = map.picture(0, (column, row)) else { continue };
        for (up, line) in pixels.chunks_exact(PICTURE_SIDE).rev().enumerate() {
            let start = (at[1] + up) * columns + at[0];
            cells[start..start + PICTURE_SIDE].iter_mut().zip(line).for_each(|(cell, pixel)| *cell = byte(*pixel));
        }
    }
    OccupancyGrid { header, info: layout.meta_data(), cells: &cells }.to_cdr()
}

impl Layout {
    fn meta_data(&self) -> MapMetaData {
        let size_m = PICTURE_SIDE as f64 * self.resolution_m;
        MapMetaData {
            resolution_m: self.resolution_m as f32,
            size: self.size.map(|pictures| (pictures * PICTURE_SIDE) as u32),
            origin_m: [0, 1].map(|axis| self.corner_m[axis] + f64::from(self.first[axis]) * size_m),
        }
    }

    /// The rectangle of all pictures; `None` where there is none.
    fn of(map: &MapPicture, revision: u64) -> Option<Self> {
        let columns = map.changed.keys().map(|place| place.0);
        let rows = map.changed.keys().map(|place| place.1);
        let first = [columns.clone().min()?, rows.clone().min()?];
        let last = [columns.max()?, rows.max()?];
        let size = [0, 1].map(|axis| (last[axis] - first[axis] + 1) as usize);
        Some(Self { first, size, corner_m: map.origin_m(), resolution_m: map.resolution_m(), revision })
    }
}

/// −1.
const UNKNOWN: u8 = 255;

fn byte(cell: Occupancy) -> u8 {
    match cell {
        Occupancy::Unknown => UNKNOWN,
        Occupancy::Free => 0,
        Occupancy::Occupied => 100,
    }
}

/// Publishes; who is too slow gets the next one.
fn publish<M: Message>(publisher: &Publisher<RawMessage>, message: &M) {
    let _ = publisher.publish(RawMessage(message.to_cdr()));
}
