//! What is true of a simulated world: its occupancy map and its floor.

use super::drive::SimulatedDrive;
use super::world::Material;
use crate::map::{Occupancy, Raster};
use rayon::prelude::*;
use std::collections::VecDeque;

/// How far the true map reaches beyond the outermost walls, metres.
const MARGIN_M: f64 = 1.0;
/// Columns of the floor that are painted together.
const BLOCK: usize = 256;

impl SimulatedDrive {
    /// The true map, in the frame of the first scan's pose: walls, glass and furniture that face
    /// free space are occupied, what the route's start connects to (also by sight through glass)
    /// is free, the rest is unknown. People and doors are not part of it; furniture that can be moved stands where it
    /// stood first.
    #[must_use]
    pub fn true_map(&self, resolution_m: f64) -> Raster<Occupancy> {
        let mut solid = self.empty_raster(resolution_m, false);
        let mut glass = self.empty_raster(resolution_m, false);
        let start_from_building = self.start.inverse();
        let walls = self.world.walls().iter().map(|wall| ([wall.from_m, wall.to_m], wall.material));
        let loose = self.world.loose.iter().flat_map(|loose| loose.walls_m(0.0, &[]));
        for (ends, material) in walls.chain(loose.map(|ends| (ends, Material::Opaque))) {
            let cells = match material {
                Material::Opaque => &mut solid,
                Material::Glass { .. } => &mut glass,
            };
            let [from, to] = ends.map(|point| start_from_building.transform_point(point));
            // Steps of a fifth of a cell miss no cell in which the wall has a noticeable part.
            let steps = (5.0 * (to[0] - from[0]).hypot(to[1] - from[1]) / resolution_m).ceil().max(1.0);
            for step in 0..=steps as usize {
                let share = step as f64 / steps;
                let point = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
                let (row, column) = cells.row_and_column_at(point);
                if let Some(index) = cells.index(row, column) {
                    cells.cells[index] = true;
                }
            }
        }
        let reached = flood(&solid);
        let faces_free = |index: usize| {
            let (row, column) = solid.row_and_column(index);
            let mut neighbours = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (row + dy, column + dx)));
            neighbours.any(|(row, column)| solid.index(row, column).is_some_and(|neighbour| reached[neighbour]))
        };
        solid.map(|index, _| match (solid.cells[index] || glass.cells[index], reached[index]) {
            (true, _) if faces_free(index) => Occupancy::Occupied,
            (false, true) => Occupancy::Free,
            _ => Occupancy::Unknown,
        })
    }

    /// The true floor, in the frame of the first scan's pose: the colour of each cell that is free
    /// in the true map of 5 cm cells, `None` elsewhere.
    #[must_use]
    pub fn true_floor(&self, resolution_m: f64) -> Raster<Option<[u8; 3]>> {
        let map = self.true_map(0.05);
        let mut floor = self.empty_raster(resolution_m, None);
        let geometry = self.empty_raster(resolution_m, ());
        let radius_m = (BLOCK as f64).hypot(1.0) * resolution_m;
        floor.cells.par_chunks_mut(geometry.width).enumerate().for_each(|(row, cells)| {
            for (block, cells) in cells.chunks_mut(BLOCK).enumerate() {
                let first = row * geometry.width + block * BLOCK;
                let centers = (first..first + cells.len()).map(|index| geometry.center_m(index));
                if !centers.clone().any(|center| map.at(center) == Some(&Occupancy::Free)) {
                    continue;
                }
                let middle = geometry.center_m(first + cells.len() / 2);
                let painter = self.world.floor.painter(self.start.transform_point(middle), radius_m);
                for (cell, center) in cells.iter_mut().zip(centers) {
                    if map.at(center) == Some(&Occupancy::Free) {
                        *cell = Some(painter.color(self.start.transform_point(center)));
                    }
                }
            }
        });
        floor
    }

    /// A raster in the frame of the first scan's pose that holds the whole building.
    fn empty_raster<T: Clone>(&self, resolution_m: f64, value: T) -> Raster<T> {
        let [low, high] = self.world.bounds_m();
        let corners = [low, [low[0], high[1]], high, [high[0], low[1]]];
        let start_from_building = self.start.inverse();
        let corners = corners.map(|corner| start_from_building.transform_point(corner));
        let bound = |axis: usize, pick: fn(f64, f64) -> f64, outward: f64| {
            let extreme = corners.iter().map(|corner| corner[axis]).reduce(pick).unwrap_or(0.0);
            ((extreme + outward * MARGIN_M) / resolution_m).round()
        };
        let origin = [bound(0, f64::min, -1.0), bound(1, f64::min, -1.0)];
        let [width, height] = [0, 1].map(|axis| (bound(axis, f64::max, 1.0) - origin[axis]) as usize);
        Raster {
            width,
            height,
            resolution_m,
            origin_m: origin.map(|cells| cells * resolution_m),
            cells: vec![value; width * height],
        }
    }
}

/// Which cells can be reached from the frame's origin without crossing a solid cell.
fn flood(solid: &Raster<bool>) -> Vec<bool> {
    let mut reached = vec![false; solid.cells.len()];
    let (row, column) = solid.row_and_column_at([0.0, 0.0]);
    let mut open: VecDeque<(i64, i64)> = VecDeque::from([(row, column)]);
    while let Some((row, column)) = open.pop_front() {
        let Some(index) = solid.index(row, column) else { continue };
        if !solid.cells[index] && !reached[index] {
            reached[index] = true;
            open.extend([(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]);
        }
    }
    reached
}
