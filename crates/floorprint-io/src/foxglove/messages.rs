//! The messages.
//!
//! Source: <https://docs.foxglove.dev/docs/sdk/schemas>.

use super::Message;
use super::protobuf_writer::ProtobufWriter;
use crate::ros::{SpacePose, seconds_and_nanoseconds};
use floorprint::Points;
use floorprint::map::{Occupancy, Raster};

/// Colours of a map's cells, with opacity: what is unknown is not drawn.
const FREE: [u8; 4] = [255, 255, 255, 255];
const OCCUPIED: [u8; 4] = [20, 24, 32, 255];
const NOTHING: [u8; 4] = [0; 4];
/// Numbers of `PackedElementField.NumericType`.
const UINT8: i64 = 1;
const FLOAT32: i64 = 7;

impl ProtobufWriter {
    fn time(&mut self, field: u32, stamp_s: f64) {
        let (seconds, nanoseconds) = seconds_and_nanoseconds(stamp_s);
        self.nested(field, |time| {
            time.integer(1, seconds.into());
            time.integer(2, nanoseconds.into());
        });
    }

    /// `Vector2`, `Vector3`, `Point3`, `Quaternion` or `Color`.
    fn doubles(&mut self, field: u32, values: &[f64]) {
        self.nested(field, |vector| (1..).zip(values).for_each(|(number, &value)| vector.double(number, value)));
    }

    fn pose(&mut self, field: u32, pose: &SpacePose) {
        self.nested(field, |nested| {
            nested.doubles(1, &pose.position_m);
            nested.doubles(2, &pose.quaternion);
        });
    }

    /// Fields of packed elements of one type, one behind the other.
    fn packed_fields(&mut self, field: u32, names: &[&str], size: u32, kind: i64) {
        for (offset, name) in (0..).step_by(size as usize).zip(names) {
            self.nested(field, |packed| {
                packed.text(1, name);
                packed.fixed32(2, offset);
                packed.integer(3, kind);
            });
        }
    }
}

/// No translation, no rotation.
const IDENTITY: SpacePose = SpacePose { position_m: [0.0; 3], quaternion: [0.0, 0.0, 0.0, 1.0] };

/// `foxglove.Grid`: coloured squares on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which the origin is.
    pub frame: &'a str,
    /// Columns.
    pub columns: usize,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Lower left corner of the first cell, metres.
    pub origin_m: [f64; 2],
    /// Height above the ground, metres: of two grids at one height it is open which is seen.
    pub height_m: f64,
    /// Red, green, blue, opacity; row by row from the least y.
    pub cells: Vec<[u8; 4]>,
}

impl Message for Grid<'_> {
    const TYPE: &'static str = "foxglove.Grid";

    fn to_protobuf(&self) -> Vec<u8> {
        const CELL_BYTES: u32 = 4;
        let [x_m, y_m] = self.origin_m;
        ProtobufWriter::message(|grid| {
            grid.time(1, self.stamp_s);
            grid.text(2, self.frame);
            grid.pose(3, &SpacePose { position_m: [x_m, y_m, self.height_m], ..IDENTITY });
            grid.fixed32(4, self.columns as u32);
            grid.doubles(5, &[self.resolution_m; 2]);
            grid.fixed32(6, self.columns as u32 * CELL_BYTES);
            grid.fixed32(7, CELL_BYTES);
            grid.packed_fields(8, &["red", "green", "blue", "alpha"], 1, UINT8);
            grid.bytes(9, self.cells.as_flattened());
        })
    }
}

/// An occupancy map as a grid.
#[must_use]
pub fn map_grid<'a>(map: &Raster<Occupancy>, stamp_s: f64, frame: &'a str) -> Grid<'a> {
    let color = |cell: &Occupancy| match cell {
        Occupancy::Unknown => NOTHING,
        Occupancy::Free => FREE,
        Occupancy::Occupied => OCCUPIED,
    };
    grid(map, color, 0.0, stamp_s, frame)
}

/// The floor's colours as a grid that covers the map by a millimetre.
#[must_use]
pub fn floor_grid<'a>(floor: &Raster<Option<[u8; 3]>>, stamp_s: f64, frame: &'a str) -> Grid<'a> {
    grid(floor, |cell| cell.map_or(NOTHING, |[r, g, b]| [r, g, b, 255]), 0.001, stamp_s, frame)
}

fn grid<'a, T>(
    raster: &Raster<T>,
    color: impl Fn(&T) -> [u8; 4],
    height_m: f64,
    stamp_s: f64,
    frame: &'a str,
) -> Grid<'a> {
    Grid {
        stamp_s,
        frame,
        columns: raster.width,
        resolution_m: raster.resolution_m,
        origin_m: raster.origin_m,
        height_m,
        // A raster's first row is its top.
        cells: raster.cells.chunks_exact(raster.width.max(1)).rev().flatten().map(color).collect(),
    }
}

/// `foxglove.PointCloud` of points of the plane.
///
/// Scans are sent so: a `foxglove.LaserScan` cannot have rays at uneven angles, and cannot be corrected for the motion during
/// the sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which the points are.
    pub frame: &'a str,
    /// The points, metres.
    pub points: &'a Points,
}

impl Message for PointCloud<'_> {
    const TYPE: &'static str = "foxglove.PointCloud";

    fn to_protobuf(&self) -> Vec<u8> {
        let data: Vec<u8> = self.points.iter().flat_map(|[x, y]| [x, y, 0.0]).flat_map(f32::to_le_bytes).collect();
        ProtobufWriter::message(|cloud| {
            cloud.time(1, self.stamp_s);
            cloud.text(2, self.frame);
            cloud.pose(3, &IDENTITY);
            cloud.fixed32(4, 12);
            cloud.packed_fields(5, &["x", "y", "z"], 4, FLOAT32);
            cloud.bytes(6, &data);
        })
    }
}

/// `foxglove.CompressedImage`.
#[derive(Debug, Clone, PartialEq)]
pub struct CompressedImage<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which it was taken.
    pub frame: &'a str,
    /// `png`, `jpeg` or `webp`.
    pub format: &'a str,
    /// The file's bytes.
    pub bytes: &'a [u8],
}

impl Message for CompressedImage<'_> {
    const TYPE: &'static str = "foxglove.CompressedImage";

    fn to_protobuf(&self) -> Vec<u8> {
        ProtobufWriter::message(|image| {
            image.time(1, self.stamp_s);
            image.bytes(2, self.bytes);
            image.text(3, self.format);
            image.text(4, self.frame);
        })
    }
}

/// `foxglove.PosesInFrame`.
#[derive(Debug, Clone, PartialEq)]
pub struct PosesInFrame<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which the poses are.
    pub frame: &'a str,
    /// The poses.
    pub poses: Vec<SpacePose>,
}

impl Message for PosesInFrame<'_> {
    const TYPE: &'static str = "foxglove.PosesInFrame";

    fn to_protobuf(&self) -> Vec<u8> {
        ProtobufWriter::message(|poses| {
            poses.time(1, self.stamp_s);
            poses.text(2, self.frame);
            self.poses.iter().for_each(|pose| poses.pose(3, pose));
        })
    }
}

/// `foxglove.FrameTransforms`.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTransforms<'a>(pub Vec<FrameTransform<'a>>);

/// A frame's pose in its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTransform<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The parent.
    pub parent: &'a str,
    /// The frame whose pose it is.
    pub child: &'a str,
    /// `parent_from_child`.
    pub pose: SpacePose,
}

impl Message for FrameTransforms<'_> {
    const TYPE: &'static str = "foxglove.FrameTransforms";

    fn to_protobuf(&self) -> Vec<u8> {
        ProtobufWriter::message(|all| {
            for transform in &self.0 {
                all.nested(1, |message| {
                    message.time(1, transform.stamp_s);
                    message.text(2, transform.parent);
                    message.text(3, transform.child);
                    message.doubles(4, &transform.pose.position_m);
                    message.doubles(5, &transform.pose.quaternion);
                });
            }
        })
    }
}

/// `foxglove.SceneUpdate` of lines, each an entity that takes the place of the one with the same name.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneUpdate<'a> {
    /// Time, seconds.
    pub stamp_s: f64,
    /// The frame in which the lines are.
    pub frame: &'a str,
    /// The lines.
    pub lines: Vec<Line<'a>>,
}

/// A line over the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Line<'a> {
    /// Its name.
    pub id: &'a str,
    /// How its points hang together.
    pub kind: LineKind,
    /// Its points, metres.
    pub points_m: Vec<[f32; 2]>,
    /// Red, green, blue, opacity, from 0 to 1.
    pub color: [f64; 4],
}

/// How a line's points hang together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineKind {
    /// One behind the other.
    Strip = 0,
    /// In pairs.
    Pairs = 2,
}

/// Width of lines, pixels.
const LINE_WIDTH: f64 = 2.0;
/// Above the map and the floor, metres.
const LINE_HEIGHT_M: f64 = 0.01;

impl Message for SceneUpdate<'_> {
    const TYPE: &'static str = "foxglove.SceneUpdate";

    fn to_protobuf(&self) -> Vec<u8> {
        ProtobufWriter::message(|update| {
            for line in &self.lines {
                update.nested(2, |entity| {
                    entity.time(1, self.stamp_s);
                    entity.text(2, self.frame);
                    entity.text(3, line.id);
                    // No lifetime: it stays until another one takes its place.
                    entity.nested(11, |primitive| {
                        primitive.integer(1, line.kind as i64);
                        primitive.pose(2, &SpacePose { position_m: [0.0, 0.0, LINE_HEIGHT_M], ..IDENTITY });
                        primitive.double(3, LINE_WIDTH);
                        primitive.integer(4, 1);
                        for point in &line.points_m {
                            primitive.doubles(5, &[point[0].into(), point[1].into(), 0.0]);
                        }
                        primitive.doubles(6, &line.color);
                    });
                });
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_begin_at_the_lower_left() {
        let cells = vec![Occupancy::Occupied, Occupancy::Free, Occupancy::Unknown, Occupancy::Free];
        let raster = Raster { width: 2, height: 2, resolution_m: 0.1, origin_m: [1.0, 2.0], cells };
        assert_eq!(map_grid(&raster, 0.0, "map").cells, [NOTHING, FREE, OCCUPIED, FREE]);
    }
}
