//! The floor's paint: tiles, carpets, stripes and letters.

use super::font;
use crate::geometry::Pose2;
use crate::random::{Stage, generator};
use rand::RngExt;

/// Side of a tile, metres.
const TILE_M: f64 = 0.5;
/// Width of the joint between tiles, metres.
const JOINT_M: f64 = 0.012;
/// Width of a carpet's border, metres.
const BORDER_M: f64 = 0.05;

/// A painted floor, in the building's frame.
#[derive(Debug, Clone)]
pub(super) struct Floor {
    /// Mean colour of the tiles.
    base: [f64; 3],
    /// Seed of the tiles' colours.
    seed: u64,
    /// What lies on the tiles, later ones on top.
    patches: Vec<Patch>,
}

/// Something painted or laid on the tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// `building_from_patch`: the patch's centre and direction.
    pub(super) building_from_patch: Pose2,
    /// Half its length and half its width, metres.
    pub(super) half_size_m: [f64; 2],
    /// What it shows.
    pub(super) paint: Paint,
}

/// What a patch shows.
#[derive(Debug, Clone, Copy)]
pub(super) enum Paint {
    /// One colour.
    Plain([u8; 3]),
    /// One colour with a border of another.
    Bordered([u8; 3], [u8; 3]),
    /// A letter or digit; between its strokes the floor shows. It is read along the patch's x axis.
    Glyph(u8, [u8; 3]),
}

impl Floor {
    pub(super) fn new(base: [u8; 3], seed: u64) -> Self {
        Self { base: base.map(f64::from), seed, patches: Vec::new() }
    }

    /// Lays a patch on top of all others.
    pub(super) fn lay(&mut self, patch: Patch) {
        self.patches.push(patch);
    }

    /// Ready to give the colours inside a circle of the building.
    pub(super) fn painter(&self, center_m: [f64; 2], radius_m: f64) -> Painter {
        let near = |patch: &&Patch| {
            let [dx, dy] = [patch.building_from_patch.x - center_m[0], patch.building_from_patch.y - center_m[1]];
            dx.hypot(dy) <= radius_m + patch.half_size_m[0].hypot(patch.half_size_m[1])
        };
        let first_tile = center_m.map(|center| ((center - radius_m) / TILE_M).floor() as i64);
        let tiles_across = (2.0 * radius_m / TILE_M) as usize + 2;
        let tiles = (0..tiles_across * tiles_across).map(|index| {
            self.tile_color([
                first_tile[0] + (index % tiles_across) as i64,
                first_tile[1] + (index / tiles_across) as i64,
            ])
        });
        Painter {
            patches: self.patches.iter().filter(near).copied().collect(),
            first_tile,
            tiles_across,
            tiles: tiles.collect(),
            joint: self.base.map(|channel| (0.45 * channel) as u8),
        }
    }

    fn tile_color(&self, tile: [i64; 2]) -> [u8; 3] {
        let mut random = generator(self.seed, Stage::World, tile[0] as u64, tile[1] as u64);
        let shade = random.random_range(-22.0..22.0);
        // A slow change of hue across the building, so that no two places look alike.
        let [x, y] = tile.map(|index| index as f64 * TILE_M);
        let hue = [0.21 * x + 0.13 * y, 0.17 * y - 0.11 * x + 2.0, 0.15 * x + 0.19 * y + 4.0];
        std::array::from_fn(|channel| {
            let tint = random.random_range(-8.0..8.0);
            (self.base[channel] + 20.0 * hue[channel].sin() + shade + tint).clamp(0.0, 255.0) as u8
        })
    }
}

/// The colours of a part of the floor.
#[derive(Debug)]
pub(super) struct Painter {
    patches: Vec<Patch>,
    first_tile: [i64; 2],
    tiles_across: usize,
    tiles: Vec<[u8; 3]>,
    joint: [u8; 3],
}

impl Painter {
    /// The colour at a point of the building (metres), which must lie in the painter's circle.
    pub(super) fn color(&self, point_m: [f64; 2]) -> [u8; 3] {
        self.patches.iter().rev().find_map(|patch| patch.color(point_m)).unwrap_or_else(|| self.tile(point_m))
    }

    fn tile(&self, point_m: [f64; 2]) -> [u8; 3] {
        let place = point_m.map(|m| m / TILE_M);
        let half_joint = 0.5 * JOINT_M / TILE_M;
        if place.iter().any(|m| (m - m.round()).abs() < half_joint) {
            return self.joint;
        }
        let [column, row] = [0, 1].map(|axis| (place[axis].floor() as i64 - self.first_tile[axis]).max(0) as usize);
        self.tiles[row.min(self.tiles_across - 1) * self.tiles_across + column.min(self.tiles_across - 1)]
    }
}

impl Patch {
    fn color(&self, [x, y]: [f64; 2]) -> Option<[u8; 3]> {
        let pose = &self.building_from_patch;
        let (sin, cos) = pose.theta.sin_cos();
        let (dx, dy) = (x - pose.x, y - pose.y);
        let [along_m, across_m] = [cos * dx + sin * dy, cos * dy - sin * dx];
        let [half_length_m, half_width_m] = self.half_size_m;
        if along_m.abs() >= half_length_m || across_m.abs() >= half_width_m {
            return None;
        }
        match self.paint {
            Paint::Plain(color) => Some(color),
            Paint::Bordered(color, border) => {
                let edge_m = (half_length_m - along_m.abs()).min(half_width_m - across_m.abs());
                Some(if edge_m < BORDER_M { border } else { color })
            }
            Paint::Glyph(character, color) => {
                let column = (0.5 * (along_m / half_length_m + 1.0) * font::COLUMNS as f64) as usize;
                let row = (0.5 * (1.0 - across_m / half_width_m) * font::ROWS as f64) as usize;
                font::is_inked(character, column.min(font::COLUMNS - 1), row.min(font::ROWS - 1)).then_some(color)
            }
        }
    }
}
