//! A finished map made ready for localization: for each cell what is there, and the nearest surface.
//!
//! The nearest surface of every cell comes from an exact distance transform (Felzenszwalb & Huttenlocher 2012) that also
//! keeps which surface it is. Each surface is a piece of line fitted to the cells around it, so that a map of 5 cm cells
//! is matched far more finely than its cells are.
//!
//! Inside, everything is in the *grid's* frame: the map's, moved so that the lower left corner is its origin. Single
//! precision then suffices wherever in the world the map lies.

use crate::geometry::Pose2;
use crate::map::{Occupancy, Raster};
use crate::session::Session;
use rayon::prelude::*;

/// Surfaces farther from a cell than this are not looked for, metres.
pub(super) const REACH_M: f64 = 2.0;
/// Cells around the map that nothing is known of, so that rays that end a little outside find the outermost walls.
const RIM_M: f64 = 0.5;
/// Lines are fitted to the surfaces within this distance, metres and cells.
const LINE_REACH_M: f64 = 0.2;
const LINE_REACH_CELLS: f64 = 2.5;
/// Points of scans count for a surface up to this far from the middle of its cell, in cells.
const POINT_REACH_CELLS: f64 = 1.5;
/// So many points of scans tell where in its cell a surface lies.
const FEWEST_POINTS: u32 = 3;
/// What is so many cells deep is solid, and no wall that was smeared.
const SOLID_DEPTH: u8 = 3;
/// In a map whose walls are this thick at the median, in cells, walls were drawn thicker than they are: a scan ends anywhere
/// in the first cells behind the free ones.
const SMEARED_CELLS: std::ops::RangeInclusive<usize> = 3..=8;
const SMEAR_DEPTH: usize = 3;
/// Thicker walls are not told apart, cells.
const SOLID_CELLS: usize = 20;
/// A wall of more cells than this is smeared; its line shows over so many times its thickness.
const THICK_CELLS: f64 = 1.6;
const LENGTH_PER_THICKNESS: f64 = 2.0;
const MOST_REACH_CELLS: usize = 8;
/// A surface lies within this of where the map shows it even where all its cells are in a row: standard deviation, in cells.
const LEAST_SIGMA_CELLS: f64 = 0.25;
/// No surface within reach.
const NONE: u32 = u32::MAX;

/// A piece of a wall or of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSurface {
    /// Where it lies, metres, in the grid's frame.
    pub mean_m: [f32; 2],
    /// Unit normal; towards the free side where there is only one.
    pub normal: [f32; 2],
    /// How much it is a line: 1 a wall, 0 an object without direction.
    pub flatness: f32,
    /// Variance of what was seen of it across it, m²: how smeared it is.
    pub variance_m2: f32,
    /// Whether it can be seen from one side only.
    pub is_one_sided: bool,
}

/// What robots are localised in.
#[derive(Debug, Clone)]
pub struct LocalizationMap {
    columns: usize,
    rows: usize,
    resolution_m: f64,
    inverse_resolution: f32,
    /// Lower left corner of the lower left cell in the map's frame, metres.
    origin_m: [f64; 2],
    /// What is in each cell, row by row from below.
    cells: Vec<Occupancy>,
    /// For each cell the nearest surface, or [`NONE`].
    nearest: Vec<u32>,
    /// Whole cells to the nearest surface, rounded down; 255 where it is farther or out of reach.
    clearance: Vec<u8>,
    surfaces: Vec<MapSurface>,
    free_cells: usize,
}

/// What a ray from a pose meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    /// How far away, metres.
    pub(super) range_m: f32,
    pub(super) surface: MapSurface,
}

impl LocalizationMap {
    /// The map of an occupancy grid.
    #[must_use]
    pub fn new(raster: &Raster<Occupancy>) -> Self {
        Self::with_points(raster, std::iter::empty())
    }

    /// The map of a session: its grid, and where in their cells its scans saw the surfaces.
    #[must_use]
    pub fn of_session(session: &Session) -> Option<Self> {
        let raster = session.map().to_raster()?;
        let poses = session.world_from_bodies();
        let points = session.scans().iter().flat_map(|scan| {
            let pose = poses.get(scan.frame).copied().unwrap_or(Pose2::IDENTITY);
            let hits = scan.points.unpack().hits;
            (0..hits.len()).map(move |k| pose.transform_point([f64::from(hits.x_m[k]), f64::from(hits.y_m[k])]))
        });
        Some(Self::with_points(&raster, points))
    }

    /// The map of an occupancy grid and of points that were seen on its surfaces, metres, in the grid's frame.
    #[must_use]
    pub fn with_points(raster: &Raster<Occupancy>, points_m: impl Iterator<Item = [f64; 2]>) -> Self {
        let rim = (RIM_M / raster.resolution_m).ceil() as usize;
        let (columns, rows) = (raster.width + 2 * rim, raster.height + 2 * rim);
        let mut cells = vec![Occupancy::Unknown; columns * rows];
        for row in 0..raster.height {
            let from = &raster.cells[(raster.height - 1 - row) * raster.width..][..raster.width];
            cells[(row + rim) * columns + rim..][..raster.width].copy_from_slice(from);
        }
        let mut map = Self {
            columns,
            rows,
            resolution_m: raster.resolution_m,
            inverse_resolution: (1.0 / raster.resolution_m) as f32,
            origin_m: raster.origin_m.map(|origin| origin - rim as f64 * raster.resolution_m),
            free_cells: cells.iter().filter(|cell| **cell == Occupancy::Free).count(),
            cells,
            nearest: Vec::new(),
            clearance: Vec::new(),
            surfaces: Vec::new(),
        };
        let seeds = map.seeds();
        map.find_nearest(&seeds);
        map.fit_lines(&seeds, points_m);
        map
    }

    /// Occupied cells at which rays may have ended: all of thin walls, however smeared, and of what is solid those that face
    /// free space; behind those nothing is ever seen.
    fn seeds(&self) -> Vec<usize> {
        if SMEARED_CELLS.contains(&self.median_thickness()) {
            return self.within_smear();
        }
        let is_inside = |cell: usize| {
            let (column, row) = (cell % self.columns, cell / self.columns);
            column > 0 && row > 0 && column + 1 < self.columns && row + 1 < self.rows
        };
        // How many cells deep each occupied cell lies, up to one more than a smeared wall has.
        let mut depth: Vec<u8> = self.cells.iter().map(|cell| u8::from(*cell == Occupancy::Occupied)).collect();
        let mut deepest: Vec<usize> = (0..depth.len()).filter(|&cell| depth[cell] == 1 && is_inside(cell)).collect();
        for level in 1..SOLID_DEPTH {
            let is_deeper = |&cell: &usize| {
                [cell - 1, cell + 1, cell - self.columns, cell + self.columns].iter().all(|&next| depth[next] >= level)
            };
            deepest.retain(is_deeper);
            deepest.iter().for_each(|&cell| depth[cell] = level + 1);
        }
        let mut is_solid = vec![false; depth.len()];
        let reach = usize::from(SOLID_DEPTH);
        for &cell in &deepest {
            let (column, row) = (cell % self.columns, cell / self.columns);
            for row in row.saturating_sub(reach)..=(row + reach).min(self.rows - 1) {
                let begin = row * self.columns + column.saturating_sub(reach);
                is_solid[begin..=row * self.columns + (column + reach).min(self.columns - 1)].fill(true);
            }
        }
        let touches_free = |cell: usize| {
            !is_inside(cell)
                || [cell - self.columns - 1, cell - 1, cell + self.columns - 1]
                    .iter()
                    .any(|&corner| self.cells[corner..corner + 3].contains(&Occupancy::Free))
        };
        let is_seed = |&cell: &usize| match depth[cell] {
            0 => false,
            _ if !is_solid[cell] => true,
            1 => touches_free(cell),
            _ => false,
        };
        (0..depth.len()).filter(is_seed).collect()
    }

    /// How many occupied cells lie behind each other where free ones begin: the median over rows and columns.
    fn median_thickness(&self) -> usize {
        let mut of_thickness = [0_usize; SOLID_CELLS + 1];
        let mut count_runs = |cells: &mut dyn Iterator<Item = Occupancy>| {
            let mut before = Occupancy::Unknown;
            let (mut length, mut begins_free) = (0, false);
            for cell in cells {
                if cell == Occupancy::Occupied {
                    if length == 0 {
                        begins_free = before == Occupancy::Free;
                    }
                    length += 1;
                } else if length > 0 {
                    if begins_free || cell == Occupancy::Free {
                        of_thickness[length.min(SOLID_CELLS)] += 1;
                    }
                    length = 0;
                }
                before = cell;
            }
        };
        for row in self.cells.chunks_exact(self.columns) {
            count_runs(&mut row.iter().copied());
        }
        for column in 0..self.columns {
            count_runs(&mut self.cells.iter().skip(column).step_by(self.columns).copied());
        }
        let half = of_thickness.iter().sum::<usize>() / 2;
        let mut sum = 0;
        of_thickness
            .iter()
            .position(|count| {
                sum += count;
                sum > half
            })
            .unwrap_or(0)
    }

    /// Occupied cells that lie no deeper behind free ones than a smeared wall is seen.
    fn within_smear(&self) -> Vec<usize> {
        let mut depth: Vec<usize> =
            self.cells.iter().map(|cell| if *cell == Occupancy::Free { 0 } else { usize::MAX }).collect();
        let mut front: Vec<usize> = (0..depth.len()).filter(|&cell| depth[cell] == 0).collect();
        for level in 1..=SMEAR_DEPTH {
            let mut next = Vec::new();
            for cell in front {
                let column = cell % self.columns;
                let beside = [
                    cell.checked_sub(self.columns),
                    cell.checked_add(self.columns).filter(|&cell| cell < depth.len()),
                    (column > 0).then(|| cell - 1),
                    (column + 1 < self.columns).then(|| cell + 1),
                ];
                for cell in beside.into_iter().flatten() {
                    if depth[cell] == usize::MAX && self.cells[cell] == Occupancy::Occupied {
                        depth[cell] = level;
                        next.push(cell);
                    }
                }
            }
            front = next;
        }
        (0..depth.len()).filter(|&cell| (1..=SMEAR_DEPTH).contains(&depth[cell])).collect()
    }

    /// The nearest seed of every cell within reach.
    fn find_nearest(&mut self, seeds: &[usize]) {
        let (columns, rows) = (self.columns, self.rows);
        let mut seed_at = vec![NONE; columns * rows];
        for (number, &cell) in seeds.iter().enumerate() {
            seed_at[cell] = number as u32;
        }
        // First along the columns: the nearest seed above or below.
        let mut in_column = vec![NONE; columns * rows];
        for upwards in [true, false] {
            let mut last = vec![NONE; columns];
            for step in 0..rows {
                let row = if upwards { step } else { rows - 1 - step };
                for (column, last) in last.iter_mut().enumerate() {
                    let cell = row * columns + column;
                    if seed_at[cell] != NONE {
                        *last = seed_at[cell];
                    }
                    let distance = |seed: u32| (seeds[seed as usize] / columns).abs_diff(row);
                    let best = in_column[cell];
                    if *last != NONE && (best == NONE || distance(*last) < distance(best)) {
                        in_column[cell] = *last;
                    }
                }
            }
        }
        // Then along the rows: the lower envelope of parabolas.
        let reach = (REACH_M / self.resolution_m).ceil() as i64;
        self.nearest = vec![NONE; columns * rows];
        self.clearance = vec![u8::MAX; columns * rows];
        let of_rows = self.nearest.par_chunks_mut(columns).zip(self.clearance.par_chunks_mut(columns)).enumerate();
        of_rows.for_each(|(row, (nearest, clearance))| {
            let candidates = &in_column[row * columns..][..columns];
            let square = |column: usize| (seeds[candidates[column] as usize] / columns).abs_diff(row).pow(2) as i64;
            let mut envelope: Vec<(usize, f64)> = Vec::new();
            for column in (0..columns).filter(|&column| candidates[column] != NONE) {
                let value = (square(column) + (column * column) as i64) as f64;
                loop {
                    let Some(&(other, from)) = envelope.last() else {
                        envelope.push((column, f64::NEG_INFINITY));
                        break;
                    };
                    let other_value = (square(other) + (other * other) as i64) as f64;
                    let meets = (value - other_value) / (2.0 * (column - other) as f64);
                    if meets <= from {
                        envelope.pop();
                    } else {
                        envelope.push((column, meets));
                        break;
                    }
                }
            }
            let mut at = 0;
            for column in 0..columns {
                while at + 1 < envelope.len() && envelope[at + 1].1 < column as f64 {
                    at += 1;
                }
                let Some(&(candidate, _)) = envelope.get(at) else { continue };
                let squared = square(candidate) + candidate.abs_diff(column).pow(2) as i64;
                if squared <= reach * reach {
                    nearest[column] = candidates[candidate];
                    clearance[column] = (squared as f64).sqrt().min(254.0) as u8;
                }
            }
        });
    }

    /// Fits a piece of line to each seed and those around it that face the same way.
    fn fit_lines(&mut self, seeds: &[usize], points_m: impl Iterator<Item = [f64; 2]>) {
        let facings: Vec<[f64; 2]> = seeds.iter().map(|&cell| self.facing(cell)).collect();
        let mut sums = vec![[0.0_f64; 2]; seeds.len()];
        let mut counts = vec![0_u32; seeds.len()];
        let reach_m = POINT_REACH_CELLS * self.resolution_m;
        for point_m in points_m {
            let [x, y] = [0, 1].map(|axis| point_m[axis] - self.origin_m[axis]);
            let Some(seed) = self.cell_at([x as f32, y as f32]).map(|cell| self.nearest[cell]) else { continue };
            if seed == NONE {
                continue;
            }
            let seed = seed as usize;
            let center = self.center_m(seeds[seed]);
            if (x - center[0]).abs() <= reach_m && (y - center[1]).abs() <= reach_m {
                sums[seed][0] += x;
                sums[seed][1] += y;
                counts[seed] += 1;
            }
        }
        let places: Vec<[f64; 2]> = (0..seeds.len())
            .map(|seed| match counts[seed] {
                count if count >= FEWEST_POINTS => sums[seed].map(|sum| sum / f64::from(count)),
                _ => self.center_m(seeds[seed]),
            })
            .collect();
        let mut number_at = vec![NONE; self.cells.len()];
        for (number, &cell) in seeds.iter().enumerate() {
            number_at[cell] = number as u32;
        }
        let reach = (LINE_REACH_M / self.resolution_m).max(LINE_REACH_CELLS).ceil() as usize;
        let least_m2 = (LEAST_SIGMA_CELLS * self.resolution_m).powi(2);
        let surfaces = (0..seeds.len())
            .into_par_iter()
            .map(|seed| {
                let (row, column) = (seeds[seed] / self.columns, seeds[seed] % self.columns);
                let facing = facings[seed];
                let around = |reach: usize| {
                    let mut around = Vec::with_capacity(32);
                    for row in row.saturating_sub(reach)..=(row + reach).min(self.rows - 1) {
                        for column in column.saturating_sub(reach)..=(column + reach).min(self.columns - 1) {
                            let other = number_at[row * self.columns + column];
                            if other == NONE {
                                continue;
                            }
                            let its = facings[other as usize];
                            if facing[0] * its[0] + facing[1] * its[1] >= 0.0 {
                                around.push(places[other as usize]);
                            }
                        }
                    }
                    around
                };
                let line = line_through(&around(reach), places[seed], facing, least_m2);
                let thickness_cells = (12.0 * f64::from(line.variance_m2)).sqrt() / self.resolution_m;
                if thickness_cells < THICK_CELLS {
                    return line;
                }
                // The line of a smeared wall shows only over a length of several times its thickness.
                let reach = reach.max((LENGTH_PER_THICKNESS * thickness_cells).ceil() as usize).min(MOST_REACH_CELLS);
                line_through(&around(reach), places[seed], facing, least_m2)
            })
            .collect();
        self.surfaces = surfaces;
    }

    /// The direction in which a seed's neighbours are free, of length up to one; none where they are on both sides.
    fn facing(&self, cell: usize) -> [f64; 2] {
        let (column, row) = ((cell % self.columns) as i64, (cell / self.columns) as i64);
        // As far as it takes to come out of a smeared wall.
        for reach in [1, i64::from(SOLID_DEPTH)] {
            let (mut sum, mut count) = ([0.0_f64; 2], 0);
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let (x, y) = (column + dx, row + dy);
                    let is_inside = x >= 0 && y >= 0 && x < self.columns as i64 && y < self.rows as i64;
                    if is_inside && self.cells[(y * self.columns as i64 + x) as usize] == Occupancy::Free {
                        sum[0] += dx as f64;
                        sum[1] += dy as f64;
                        count += 1;
                    }
                }
            }
            let length = sum[0].hypot(sum[1]);
            if length >= 0.5 {
                return sum.map(|part| part / length);
            }
            if count > 0 {
                break;
            }
        }
        [0.0; 2]
    }

    fn center_m(&self, cell: usize) -> [f64; 2] {
        let (row, column) = (cell / self.columns, cell % self.columns);
        [(column as f64 + 0.5) * self.resolution_m, (row as f64 + 0.5) * self.resolution_m]
    }

    /// Side of a cell, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Area that is known to be free, square metres.
    #[must_use]
    pub fn free_m2(&self) -> f64 {
        self.free_cells as f64 * self.resolution_m * self.resolution_m
    }

    /// Whether there is nothing to be localised by.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty() || self.free_cells == 0
    }

    /// Median of the variances of its surfaces, m².
    pub(super) fn median_variance_m2(&self) -> f64 {
        let mut variances: Vec<f32> = self.surfaces.iter().map(|surface| surface.variance_m2).collect();
        variances.sort_by(f32::total_cmp);
        variances.get(variances.len() / 2).map_or(0.0, |&median| f64::from(median))
    }

    /// Number of columns and rows.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// A pose of the map's frame in the grid's.
    pub(super) fn grid_from_map(&self, pose: &Pose2) -> Pose2 {
        Pose2::new(pose.x - self.origin_m[0], pose.y - self.origin_m[1], pose.theta)
    }

    /// A pose of the grid's frame in the map's.
    pub(super) fn map_from_grid(&self, pose: &Pose2) -> Pose2 {
        Pose2::new(pose.x + self.origin_m[0], pose.y + self.origin_m[1], pose.theta)
    }

    /// What is in each cell, row by row from below.
    pub(super) fn cells(&self) -> &[Occupancy] {
        &self.cells
    }

    /// The cell at a point (metres); `None` outside.
    #[inline]
    fn cell_at(&self, point_m: [f32; 2]) -> Option<usize> {
        let [x, y] = point_m.map(|coordinate| coordinate * self.inverse_resolution);
        if x < 0.0 || y < 0.0 {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        (column < self.columns && row < self.rows).then(|| row * self.columns + column)
    }

    /// The surface nearest to a point (metres, grid's frame), if one is within reach.
    #[inline]
    #[must_use]
    pub fn nearest(&self, point_m: [f32; 2]) -> Option<&MapSurface> {
        let cell = self.cell_at(point_m)?;
        self.surfaces.get(self.nearest[cell] as usize)
    }

    /// What the map says of a point (metres, grid's frame).
    #[inline]
    #[must_use]
    pub fn occupancy(&self, point_m: [f32; 2]) -> Occupancy {
        self.cell_at(point_m).map_or(Occupancy::Unknown, |cell| self.cells[cell])
    }

    /// The first surface that a ray crosses before `most_m`, of those that `counts`, given how far away they are.
    ///
    /// The clearance of the cells on the way tells how far it is safe to go at once (sphere tracing, Hart 1996).
    #[inline]
    pub(super) fn trace(
        &self,
        from_m: [f32; 2],
        direction: [f32; 2],
        most_m: f32,
        counts: impl Fn(f32, &MapSurface) -> bool,
    ) -> Option<Crossing> {
        let side_m = self.resolution_m as f32;
        let mut range_m = 0.0;
        for _ in 0..MOST_STEPS {
            if range_m >= most_m {
                return None;
            }
            let at = [from_m[0] + range_m * direction[0], from_m[1] + range_m * direction[1]];
            let cell = self.cell_at(at)?;
            let clearance = self.clearance[cell];
            if clearance == 0 {
                let surface = self.surfaces[self.nearest[cell] as usize];
                if counts(range_m, &surface) {
                    return Some(Crossing { range_m, surface });
                }
            }
            let safe_m = match clearance {
                u8::MAX => REACH_M as f32 - 1.5 * side_m,
                cells => (f32::from(cells) - 1.0) * side_m,
            };
            range_m += safe_m.max(0.7 * side_m);
        }
        None
    }
}

/// Steps along a ray; more would be a ray that runs along a wall.
const MOST_STEPS: usize = 400;

/// The piece of line through points, at the foot of `place` on it.
fn line_through(points: &[[f64; 2]], place: [f64; 2], facing: [f64; 2], least_m2: f64) -> MapSurface {
    let count = points.len().max(1) as f64;
    let mean = [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for [x, y] in points {
        let (dx, dy) = (x - mean[0], y - mean[1]);
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
    }
    let half_trace = 0.5 * (xx + yy);
    let root = (half_trace * half_trace - (xx * yy - xy * xy)).max(0.0).sqrt();
    let (small, large) = ((half_trace - root).max(0.0), half_trace + root);
    let along = 0.5 * (2.0 * xy).atan2(xx - yy);
    let mut normal = [-along.sin(), along.cos()];
    let is_one_sided = facing != [0.0; 2];
    if is_one_sided && normal[0] * facing[0] + normal[1] * facing[1] < 0.0 {
        normal = normal.map(|part| -part);
    }
    // A line of cells has a thickness of about a third of a cell; what is as thick as it is long has no direction.
    let ratio = if large > 0.0 { small / large } else { 1.0 };
    let flatness = if points.len() < 3 { 0.0 } else { (1.0 - 4.0 * ratio).max(0.0) };
    let off = (place[0] - mean[0]) * normal[0] + (place[1] - mean[1]) * normal[1];
    let foot = [0, 1].map(|axis| place[axis] - flatness * off * normal[axis]);
    MapSurface {
        mean_m: foot.map(|v| v as f32),
        normal: normal.map(|v| v as f32),
        flatness: flatness as f32,
        variance_m2: (small / count).max(least_m2) as f32,
        is_one_sided,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn raster(width: usize, height: usize, occupied: &[(usize, usize)]) -> Raster<Occupancy> {
        let mut cells = vec![Occupancy::Free; width * height];
        occupied.iter().for_each(|&(x, y)| cells[(height - 1 - y) * width + x] = Occupancy::Occupied);
        Raster { width, height, resolution_m: 0.1, origin_m: [-1.0, 2.0], cells }
    }

    proptest! {
        #[test]
        fn the_nearest_surface_is_the_one_that_a_plain_search_finds(
            occupied in prop::collection::btree_set((0..40_usize, 0..30_usize), 1..25),
        ) {
            let occupied: Vec<_> = occupied.into_iter().collect();
            let map = LocalizationMap::new(&raster(40, 30, &occupied));
            let seeds = map.seeds();
            for cell in 0..map.cells.len() {
                let square = |seed: usize| {
                    let (dx, dy) = ((seed % map.columns).abs_diff(cell % map.columns), (seed / map.columns).abs_diff(cell / map.columns));
                    dx * dx + dy * dy
                };
                let truth = seeds.iter().map(|&seed| square(seed)).min().filter(|&square| square <= 400);
                let found = (map.nearest[cell] != NONE).then(|| square(seeds[map.nearest[cell] as usize]));
                prop_assert_eq!(found, truth);
            }
        }

        #[test]
        fn a_ray_meets_the_first_cell_on_its_way(
            occupied in prop::collection::btree_set((0..40_usize, 0..30_usize), 1..25), angle in -3.1..3.1_f64
        ) {
            let occupied: Vec<_> = occupied.into_iter().filter(|&(x, y)| (x, y) != (20, 15)).collect();
            let map = LocalizationMap::new(&raster(40, 30, &occupied));
            let from = [2.55_f64, 2.05];
            let direction = [angle.cos(), angle.sin()];
            let found = map.trace(from.map(|v| v as f32), direction.map(|v| v as f32), 5.0, |_, _| true);
            let occupied_at = |range: f64| map.occupancy([from[0] + range * direction[0], from[1] + range * direction[1]].map(|v| v as f32)) == Occupancy::Occupied;
            let truth = (0..5000).map(|step| f64::from(step) * 0.001).find(|&range| occupied_at(range));
            match (found, truth) {
                // A ray may cut a corner unseen.
                (Some(found), Some(truth)) => prop_assert!(f64::from(found.range_m) > truth - 0.002),
                (Some(_), None) => prop_assert!(false, "nothing is there"),
                _ => {}
            }
        }
    }

    #[test]
    fn a_wall_is_a_line_that_faces_the_room() {
        // Unknown below the wall, free above.
        let mut raster = raster(60, 30, &[]);
        for y in 0..10 {
            for x in 0..60 {
                raster.cells[(29 - y) * 60 + x] = if y == 9 { Occupancy::Occupied } else { Occupancy::Unknown };
            }
        }
        let map = LocalizationMap::new(&raster);
        let surface = map.nearest([3.5, 1.8]).unwrap();
        assert!(surface.is_one_sided && surface.flatness > 0.99, "{surface:?}");
        assert!(surface.normal[1] > 0.999 && (surface.mean_m[1] - 1.45).abs() < 1e-4, "{surface:?}");
        assert!((map.free_m2() - 12.0).abs() < 1e-9);
        // Points that were seen on it tell where in its cell it lies.
        let seen = (0..600).map(|k| [-0.5 + 0.008 * f64::from(k), 2.97]);
        let map = LocalizationMap::with_points(&raster, seen);
        assert!((map.nearest([3.5, 1.8]).unwrap().mean_m[1] - 1.47).abs() < 1e-3);
    }
}
