//! How sharp a map's walls are, without any truth: doubled and thick walls betray wrong poses.
//!
//! A LiDAR sees the faces of walls, so that a good map draws them as lines one or two
//! cells thick. A scan placed wrongly draws the same face again: close by it thickens
//! the line; farther off it leaves a second, parallel line with free cells in between,
//! where no building has a wall.

use crate::map::{Occupancy, Raster};
use serde::Serialize;

/// The direction of a wall at a cell is that of the occupied cells up to this many cells away.
const NEIGHBOURHOOD_CELLS: i64 = 4;

/// Cells whose neighbours spread across the wall more than this share of their spread along it are
/// corners and clutter, which have no normal.
const MAX_SPREAD_RATIO: f64 = 0.25;

/// A second wall within this distance is taken for a double, metres. Narrower gaps hold
/// no wall in any building, wider ones may be niches and furniture.
const DOUBLE_WITHIN_M: f64 = 0.4;

/// Walls are parallel when the cosine of the angle between them is above this (20°).
const PARALLEL_COSINE: f64 = 0.94;

/// Sharpness of the walls of a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WallSharpness {
    /// Occupied cells that are part of a wall: that have a direction.
    pub wall_cells: usize,
    /// Share of the wall cells that have a parallel wall within 0.4 m across free cells.
    pub doubled_share: f64,
    /// Mean thickness of the walls at these cells, metres.
    pub mean_thickness_m: f64,
}

impl WallSharpness {
    /// Measures a map; `None` when it has no wall.
    #[must_use]
    pub fn of(map: &Raster<Occupancy>) -> Option<Self> {
        let occupied = (0..map.cells.len()).filter(|&index| map.cells[index] == Occupancy::Occupied);
        // In the order of the cells.
        let walls: Vec<(usize, [f64; 2])> =
            occupied.filter_map(|index| Some((index, normal_at(map, index)?))).collect();
        let wall_cells = walls.len();
        if wall_cells == 0 {
            return None;
        }
        let doubled = walls.iter().filter(|(index, normal)| is_doubled(map, &walls, *index, *normal)).count();
        let thickness_cells: f64 = walls.iter().map(|&(index, normal)| thickness_cells(map, index, normal)).sum();
        Some(Self {
            wall_cells,
            doubled_share: doubled as f64 / wall_cells as f64,
            mean_thickness_m: thickness_cells * map.resolution_m / wall_cells as f64,
        })
    }
}

/// The unit normal (columns right, rows down) of the wall through an occupied cell:
/// the axis of the least spread of the occupied cells connected to it nearby.
fn normal_at(map: &Raster<Occupancy>, index: usize) -> Option<[f64; 2]> {
    let (mut count, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy, mut sum_yy) = (0, 0, 0, 0, 0, 0);
    for (y, mut row) in (-NEIGHBOURHOOD_CELLS..).zip(connected_nearby(map, index)) {
        while row != 0 {
            let x = i64::from(row.trailing_zeros()) - NEIGHBOURHOOD_CELLS;
            count += 1;
            (sum_x, sum_y) = (sum_x + x, sum_y + y);
            (sum_xx, sum_xy, sum_yy) = (sum_xx + x * x, sum_xy + x * y, sum_yy + y * y);
            row &= row - 1;
        }
    }
    // The sums' spread about their mean, times the count: whole numbers all along.
    let spread = |square: i64, a: i64, b: i64| (count * square - a * b) as f64;
    let (xx, xy, yy) = (spread(sum_xx, sum_x, sum_x), spread(sum_xy, sum_x, sum_y), spread(sum_yy, sum_y, sum_y));
    let (half_sum, half_difference) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
    let radius = half_difference.hypot(xy);
    let is_line = count >= 3 && half_sum - radius < MAX_SPREAD_RATIO * (half_sum + radius);
    let along = 0.5 * xy.atan2(half_difference);
    is_line.then(|| [-along.sin(), along.cos()])
}

/// Rows of the neighbourhood of a cell.
const SIDE: usize = 2 * NEIGHBOURHOOD_CELLS as usize + 1;

/// The occupied cells that are reached from a cell over occupied cells without leaving its neighbourhood, a bit
/// each, row by row: a double's line stays apart.
fn connected_nearby(map: &Raster<Occupancy>, index: usize) -> [u32; SIDE] {
    let (row, column) = map.row_and_column(index);
    let mut occupied = [0; SIDE];
    for (down, bits) in (-NEIGHBOURHOOD_CELLS..).zip(&mut occupied) {
        for (bit, right) in (-NEIGHBOURHOOD_CELLS..=NEIGHBOURHOOD_CELLS).enumerate() {
            let is_occupied =
                map.index(row + down, column + right).is_some_and(|i| map.cells[i] == Occupancy::Occupied);
            *bits |= u32::from(is_occupied) << bit;
        }
    }
    let mut reached = [0; SIDE];
    reached[SIDE / 2] = 1 << (SIDE / 2);
    loop {
        let mut grown = reached;
        for (row, bits) in grown.iter_mut().enumerate() {
            let near = reached[row.saturating_sub(1)] | reached[row] | reached[(row + 1).min(SIDE - 1)];
            *bits |= (near | near << 1 | near >> 1) & occupied[row];
        }
        if grown == reached {
            return reached;
        }
        reached = grown;
    }
}

/// The cells met from a cell along a direction, one a cell's length apart, without the cell itself.
fn along(map: &Raster<Occupancy>, index: usize, direction: [f64; 2]) -> impl Iterator<Item = usize> {
    let (row, column) = map.row_and_column(index);
    // One step moves by a whole cell along the larger component, so that no cell comes twice.
    let scale = 1.0 / direction[0].abs().max(direction[1].abs());
    (1..).map_while(move |step| {
        let length = f64::from(step) * scale;
        map.index(row + (direction[1] * length).round() as i64, column + (direction[0] * length).round() as i64)
    })
}

fn is_doubled(map: &Raster<Occupancy>, walls: &[(usize, [f64; 2])], index: usize, normal: [f64; 2]) -> bool {
    let step_m = map.resolution_m / normal[0].abs().max(normal[1].abs());
    let reach = (DOUBLE_WITHIN_M / step_m).floor() as usize;
    [normal, normal.map(|v| -v)].into_iter().any(|direction| {
        let beyond = along(map, index, direction).take(reach).skip_while(|i| map.cells[*i] == Occupancy::Occupied);
        let mut gap = 0;
        for cell in beyond {
            match map.cells[cell] {
                Occupancy::Free => gap += 1,
                Occupancy::Unknown => return false,
                Occupancy::Occupied => {
                    let is_parallel =
                        |other: [f64; 2]| (other[0] * normal[0] + other[1] * normal[1]).abs() > PARALLEL_COSINE;
                    let other = walls.binary_search_by_key(&cell, |(index, _)| *index).ok();
                    return gap > 0 && other.is_some_and(|other| is_parallel(walls[other].1));
                }
            }
        }
        false
    })
}

/// Extent of the occupied cells through a cell along the wall's normal, cells.
fn thickness_cells(map: &Raster<Occupancy>, index: usize, normal: [f64; 2]) -> f64 {
    let occupied =
        |direction| along(map, index, direction).take_while(|i| map.cells[*i] == Occupancy::Occupied).count();
    let steps = 1 + occupied(normal) + occupied(normal.map(|v| -v));
    steps as f64 / normal[0].abs().max(normal[1].abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Free space with lines of the given offsets (metres) from the origin along the normal at `angle`.
    fn lines(angle: f64, offsets_m: &[f64], half_thickness_m: f64) -> Raster<Occupancy> {
        let blank =
            Raster { width: 100, height: 100, resolution_m: 0.05, origin_m: [-2.5; 2], cells: vec![(); 10_000] };
        blank.map(|_, [x, y]| {
            let across = x * angle.cos() + y * angle.sin();
            let on_a_line = offsets_m.iter().any(|offset| (across - offset).abs() < half_thickness_m);
            if on_a_line { Occupancy::Occupied } else { Occupancy::Free }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn a_single_wall_is_thin_and_its_double_is_seen(angle in 0.0..3.1_f64) {
            let single = WallSharpness::of(&lines(angle, &[0.1], 0.036)).unwrap();
            prop_assert!(single.doubled_share < 0.05 && single.mean_thickness_m < 0.11, "{single:?}");
            let double = WallSharpness::of(&lines(angle, &[0.1, 0.34], 0.036)).unwrap();
            prop_assert!(double.doubled_share > 0.9, "{double:?}");
        }

        #[test]
        fn a_smeared_wall_is_thick(angle in 0.0..3.1_f64) {
            let thick = WallSharpness::of(&lines(angle, &[0.1], 0.1)).unwrap();
            prop_assert!((thick.mean_thickness_m - 0.2).abs() < 0.05 && thick.doubled_share < 0.05, "{thick:?}");
        }
    }

    #[test]
    fn the_two_faces_of_a_real_wall_are_no_double() {
        let mut map = lines(0.0, &[0.1, 0.34], 0.03);
        map = map.map(|index, [x, _]| if x > 0.13 && x < 0.31 { Occupancy::Unknown } else { map.cells[index] });
        assert_eq!(WallSharpness::of(&map).unwrap().doubled_share, 0.0);
        assert_eq!(WallSharpness::of(&lines(0.0, &[], 0.0)), None);
    }
}
