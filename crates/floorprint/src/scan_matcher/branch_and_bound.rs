//! The best places of a scan on a map within a large window, found without looking at all of
//! them: branch and bound over a pyramid of grids (Olson 2015; Hess et al. 2016).
//!
//! A block of 2^h × 2^h neighbouring offsets cannot score more than its points score on a grid
//! in which each cell holds the largest value of all cells that the block's offsets can reach.
//! Blocks that cannot beat what is known are left out whole; the result is that of the
//! exhaustive search.

use super::correlative::SearchWindow;
use super::pooled_grid::Grid;
use crate::geometry::{Pose2, wrap_angle};
use crate::surface::SurfaceScan;
use multiversion::multiversion;

/// Side of a cell of the finest grid, metres: also the step of the search in x and y.
const CELL_M: f64 = 0.1;
/// Base-2 logarithm of the side, in cells, of the largest block of offsets.
const TOP_LEVEL: usize = 5;
/// Surfaces and points farther from the middle than this are left out, metres.
const REACH_M: f64 = 15.0;
/// Points of the scan that are looked up.
const POINTS: usize = 128;
/// Value of a cell that holds a surface, and of those next to one.
const ON_SURFACE: u8 = 4;
const NEAR_SURFACE: u8 = 3;
const AT_CORNER: u8 = 2;
/// The step in heading moves a point that is farther away than three quarters of the others by a cell.
const FAR_QUANTILE: f64 = 0.75;
/// Bounds of that step, radians.
const STEP_RAD: [f64; 2] = [0.005, 0.05];
/// Places nearer to each other than this count as one, metres and radians.
const SAME_PLACE_M: f64 = 0.6;
const SAME_PLACE_RAD: f64 = 0.15;

/// What a search looks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceQuery {
    /// The poses to look at.
    pub window: SearchWindow,
    /// A pose of the scan on the map that may fit well, if one is known: it spares looking at what fits worse. What is found
    /// is the same.
    pub likely: Option<Pose2>,
    /// Places that score less are not found; 1 is a perfect fit.
    pub min_score: f64,
    /// Places that score less than the best by more than this are not found.
    pub margin: f64,
    /// Largest number of places.
    pub most: usize,
    /// Blocks that are looked at, at most: what bounds the work.
    pub max_blocks: usize,
}

/// A place where a scan fits, coarsely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Pose of the scan on the map.
    pub pose: Pose2,
    /// Mean value of the points, from 0 to 1.
    pub score: f64,
}

/// A map as a pyramid of grids of which each holds the largest values of the one below.
#[derive(Debug, Clone)]
pub struct PlaceSearch {
    /// Cell coordinates of the grids' first cell.
    first: [i32; 2],
    /// `levels[h]` bounds blocks of 2^h × 2^h offsets.
    levels: Vec<Quads>,
}

/// Values of four neighbouring cells, a byte each: a cell's, that of the one to its right, and of the two above these.
/// Added up they are the scores of four neighbouring blocks of offsets, found by one look-up a point.
type Quad = u32;

/// A grid of which one look-up gives four cells.
#[derive(Debug, Clone)]
struct Quads {
    /// Besides the quads that begin in the grid there are those that begin right before it, and around all of them a rim of
    /// quads that hold nothing.
    columns: i32,
    rows: i32,
    /// Row by row.
    quads: Vec<Quad>,
}

/// How many quads there are before the grid's first column and row.
const BEFORE: usize = 2;

impl Quads {
    fn of(grid: &Grid) -> Self {
        let (columns, rows) = (grid.columns + BEFORE as i32 + 1, grid.rows + BEFORE as i32 + 1);
        let mut quads = vec![0; (columns * rows) as usize];
        let mut put = |first: usize, cells: &[u8], shift: u32| {
            for (quad, cell) in quads[first..].iter_mut().zip(cells) {
                *quad |= Quad::from(*cell) << shift;
            }
        };
        for (row, cells) in grid.cells.chunks_exact(grid.columns as usize).enumerate() {
            let as_lower = (row + BEFORE) * columns as usize + BEFORE;
            let as_upper = as_lower - columns as usize;
            put(as_lower, cells, 0);
            put(as_lower - 1, cells, 8);
            put(as_upper, cells, 16);
            put(as_upper - 1, cells, 24);
        }
        Self { columns, rows, quads }
    }

    /// Where the quad is of which the cell is the first; for a cell outside that of one in the rim.
    #[inline(always)]
    fn place_of(&self, x: i32, y: i32) -> u32 {
        // Largest and least, not a choice of two values: they vectorise.
        let column = (x + BEFORE as i32).max(0).min(self.columns - 1);
        let row = (y + BEFORE as i32).max(0).min(self.rows - 1);
        (row * self.columns + column) as u32
    }
}

/// A block of offsets at one heading.
#[derive(Debug, Clone, Copy)]
struct Block {
    heading: usize,
    level: usize,
    /// Smallest offset of the block, cells.
    offset: [i32; 2],
    /// No offset of the block scores more.
    bound: u32,
}

/// How far a search has come.
struct Progress {
    /// Blocks that may still be looked at.
    blocks_left: usize,
    /// Single offsets whose score is known.
    met: Vec<Block>,
}

impl PlaceSearch {
    /// The surfaces of a map, given as if seen from its middle.
    #[must_use]
    pub fn new(surfaces: &SurfaceScan) -> Self {
        let [middle_x, middle_y] = surfaces.origin_m;
        let near = |x: f64, y: f64| (x - middle_x).abs() < REACH_M && (y - middle_y).abs() < REACH_M;
        let cells: Vec<[i32; 2]> = surfaces
            .iter()
            .map(|(point, _)| point.map(f64::from))
            .filter(|&[x, y]| near(x, y))
            .map(|point| point.map(|v| (v / CELL_M).floor() as i32))
            .collect();
        // Blocks of offsets that begin before the first surface may reach it: the grids begin so much earlier that
        // what they hold of such blocks is no bound that is too low.
        let rim = 1 << TOP_LEVEL;
        let low = |axis: usize| cells.iter().map(|cell| cell[axis]).min().unwrap_or(0) - rim;
        let high = |axis: usize| cells.iter().map(|cell| cell[axis]).max().unwrap_or(0) + 1;
        let first = [low(0), low(1)];
        let mut finest = Grid::new(high(0) - first[0] + 1, high(1) - first[1] + 1);
        for [x, y] in cells {
            let (x, y) = (x - first[0], y - first[1]);
            for (dx, dy) in [(-1, -1), (1, -1), (-1, 1), (1, 1)] {
                finest.raise(x + dx, y + dy, AT_CORNER);
            }
            for (dx, dy) in [(0, -1), (-1, 0), (1, 0), (0, 1)] {
                finest.raise(x + dx, y + dy, NEAR_SURFACE);
            }
            finest.raise(x, y, ON_SURFACE);
        }
        let mut levels = Vec::with_capacity(TOP_LEVEL + 1);
        // Pooled without overlap each level follows from the one before; a block of offsets straddles two cells a side.
        let mut without_overlap = finest.clone();
        levels.push(Quads::of(&finest));
        for _ in 0..TOP_LEVEL {
            without_overlap = without_overlap.halved();
            levels.push(Quads::of(&without_overlap.widened(1)));
        }
        Self { first, levels }
    }

    /// The best places of `scan` around `center`, best first, each apart from the others. `None`
    /// when the search would take too long.
    #[must_use]
    pub fn find(&self, scan: &SurfaceScan, center: &Pose2, query: &PlaceQuery) -> Option<Vec<Place>> {
        let points = self.points_of(scan);
        if points.is_empty() {
            return Some(Vec::new());
        }
        let full_score = f64::from(ON_SURFACE) * points.len() as f64;
        let step_rad = step_rad(&points);
        let turns = (query.window.angle_rad / step_rad).ceil() as i32;
        let headings: Vec<f64> = (-turns..=turns).map(|turn| center.theta + f64::from(turn) * step_rad).collect();
        let rotated: Vec<Cells> = headings.iter().map(|&theta| self.cells_at(&points, center, theta)).collect();
        let radius = (query.window.distance_m / CELL_M).ceil() as i32;
        let mut progress = Progress { blocks_left: query.max_blocks, met: Vec::new() };
        let roots = self.roots(&rotated, radius, &mut progress.blocks_left)?;

        let mut found: Vec<Place> = Vec::new();
        let likely = query.likely.map(|pose| {
            let heading = (wrap_angle(pose.theta - center.theta) / step_rad).round() as i32 + turns;
            let offset = [pose.x - center.x, pose.y - center.y].map(|distance_m| (distance_m / CELL_M).round() as i32);
            (heading, offset)
        });
        if let Some((heading, offset)) = likely
            && let Some(cells) = usize::try_from(heading).ok().and_then(|heading| rotated.get(heading))
            && offset.iter().all(|cells| cells.abs() <= radius)
            && let Some([bound, ..]) = self.bounds(0, cells, 0, offset)
        {
            progress.met.push(Block { heading: heading as usize, level: 0, offset, bound });
        }
        let mut least = (query.min_score * full_score).ceil() as u32;
        while found.len() < query.most {
            let pose_of = |block: &Block| {
                let [x, y] = block.offset.map(|cells| f64::from(cells) * CELL_M);
                Pose2::new(center.x + x, center.y + y, headings[block.heading])
            };
            // A block that lies within the neighbourhood of a place that was found holds nothing new.
            let is_new = |block: &Block| {
                let last = (1 << block.level) - 1;
                found.iter().all(|place| {
                    [[0, 0], [last, 0], [0, last], [last, last]].iter().any(|[x, y]| {
                        let corner = Block { offset: [block.offset[0] + x, block.offset[1] + y], ..*block };
                        is_elsewhere(&place.pose, &pose_of(&corner))
                    })
                })
            };
            // Only what is as good as the best that is known to be there is worth a look.
            let known = progress.met.iter().filter(|block| is_new(block)).map(|block| block.bound).max();
            let least_now = known.map_or(least, |known| known.max(least));
            let Some(best) = self.best(&roots, &rotated, radius, least_now, is_new, &mut progress)? else {
                break;
            };
            let score = f64::from(best.bound) / full_score;
            if found.is_empty() {
                least = least.max(((score - query.margin) * full_score).ceil().max(0.0) as u32);
            }
            found.push(Place { pose: pose_of(&best), score });
        }
        Some(found)
    }

    /// Up to [`POINTS`] points of a scan that are not too far off.
    fn points_of(&self, scan: &SurfaceScan) -> Vec<[f64; 2]> {
        let near: Vec<[f64; 2]> = scan
            .iter()
            .map(|(point, _)| point.map(f64::from))
            .filter(|[x, y]| (x - scan.origin_m[0]).hypot(y - scan.origin_m[1]) < REACH_M)
            .collect();
        let stride = near.len().div_ceil(POINTS).max(1);
        near.into_iter().step_by(stride).collect()
    }

    /// The cells of points turned to a heading, relative to the grids' first.
    fn cells_at(&self, points: &[[f64; 2]], center: &Pose2, theta: f64) -> Cells {
        let to_map = Pose2 { theta, ..*center }.point_transform();
        let cells = points.iter().map(|&point| {
            let [x, y] = to_map(point).map(|v| (v / CELL_M).floor() as i32);
            [x - self.first[0], y - self.first[1]]
        });
        Cells::of(cells)
    }

    /// Blocks of the largest size that cover the window at every heading, the most promising first.
    fn roots(&self, rotated: &[Cells], radius: i32, blocks_left: &mut usize) -> Option<Vec<Block>> {
        let level = (0..TOP_LEVEL).find(|&level| 1 << level > 2 * radius).unwrap_or(TOP_LEVEL);
        let mut roots = Vec::new();
        let side = ((2 * radius as usize) >> level) + 1;
        for (heading, cells) in rotated.iter().enumerate() {
            *blocks_left = blocks_left.checked_sub(side * side)?;
            let first = roots.len();
            for y in 0..side {
                for x in 0..side {
                    let offset = [x, y].map(|step| -radius + ((step as i32) << level));
                    roots.push(Block { heading, level, offset, bound: 0 });
                }
            }
            let roots = &mut roots[first..];
            for (y, x) in (0..side).step_by(2).flat_map(|y| (0..side).step_by(2).map(move |x| (y, x))) {
                let bounds = self.bounds(0, cells, level, roots[y * side + x].offset).unwrap_or_default();
                for ((dx, dy), bound) in QUAD.into_iter().zip(bounds) {
                    if x + dx < side && y + dy < side {
                        roots[(y + dy) * side + x + dx].bound = bound;
                    }
                }
            }
        }
        roots.sort_by_key(|block| std::cmp::Reverse(block.bound));
        Some(roots)
    }

    /// The best single offset that scores at least `least` and is wanted; those met on the way are noted.
    /// `None` outside when the work would be too much.
    fn best(
        &self,
        roots: &[Block],
        rotated: &[Cells],
        radius: i32,
        least: u32,
        is_wanted: impl Fn(&Block) -> bool,
        progress: &mut Progress,
    ) -> Option<Option<Block>> {
        let mut best: Option<Block> = None;
        let mut stack: Vec<Block> = Vec::new();
        // The most promising come first.
        for root in roots {
            if root.bound < best.as_ref().map_or(least, |best| best.bound + 1) {
                break;
            }
            stack.push(*root);
            while let Some(block) = stack.pop() {
                if block.bound < best.as_ref().map_or(least, |best| best.bound + 1) || !is_wanted(&block) {
                    continue;
                }
                if block.level == 0 {
                    progress.met.push(block);
                    best = Some(block);
                    continue;
                }
                let (level, half) = (block.level - 1, 1 << (block.level - 1));
                let first_child = stack.len();
                let needed = best.as_ref().map_or(least, |best| best.bound + 1);
                let bounds = self.bounds(needed, &rotated[block.heading], level, block.offset);
                for (child, (dx, dy)) in QUAD.into_iter().enumerate() {
                    let offset = [block.offset[0] + half * dx as i32, block.offset[1] + half * dy as i32];
                    if offset[0] > radius || offset[1] > radius {
                        continue;
                    }
                    progress.blocks_left = progress.blocks_left.checked_sub(1)?;
                    if let Some(bound) = bounds.map(|bounds| bounds[child]).filter(|&bound| bound >= needed) {
                        stack.push(Block { level, offset, bound, ..block });
                    }
                }
                // The most promising child is taken from the stack first.
                stack[first_child..].sort_by_key(|block| block.bound);
            }
        }
        Some(best)
    }

    /// What the points score at most at any offset of the block that begins at `offset`, of the one to its right, and
    /// of the two above these, if any of the four is at least `needed`; given up once that is out of reach.
    #[inline]
    fn bounds(&self, needed: u32, cells: &Cells, level: usize, offset: [i32; 2]) -> Option<[u32; 4]> {
        bounds_on(&self.levels[level], needed, cells, level, offset)
    }
}

/// What [`PlaceSearch::bounds`] says, on the grid of the level.
// Plain loops: closures that are handed on do not have the wider units' instructions.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn bounds_on(grid: &Quads, needed: u32, cells: &Cells, level: usize, offset: [i32; 2]) -> Option<[u32; 4]> {
    let (mut sums, mut left) = ([0; 4], cells.count);
    for (x, y) in cells.x.iter().zip(&cells.y) {
        let mut places = [0; PART];
        for point in 0..PART {
            places[point] = grid.place_of((x[point] + offset[0]) >> level, (y[point] + offset[1]) >> level);
        }
        let mut quad: Quad = 0;
        for place in places {
            quad += grid.quads[place as usize];
        }
        for (sum, value) in sums.iter_mut().zip(quad.to_le_bytes()) {
            *sum += u32::from(value);
        }
        left = left.saturating_sub(PART as u32);
        if sums[0].max(sums[1]).max(sums[2]).max(sums[3]) + left * u32::from(ON_SURFACE) < needed {
            return None;
        }
    }
    Some(sums)
}

/// Cells of points, by coordinate and in parts of so many, so that loops over them vectorise.
struct Cells {
    x: Vec<[i32; PART]>,
    y: Vec<[i32; PART]>,
    count: u32,
}

impl Cells {
    fn of(cells: impl ExactSizeIterator<Item = [i32; 2]>) -> Self {
        let count = cells.len();
        // What the last part is filled up with lies outside of all grids.
        let parts = || vec![[i32::MIN / 2; PART]; count.div_ceil(PART)];
        let (mut x, mut y) = (parts(), parts());
        for (index, cell) in cells.enumerate() {
            [x[index / PART][index % PART], y[index / PART][index % PART]] = cell;
        }
        Self { x, y, count: count as u32 }
    }
}

/// Columns and rows from a quad's first cell to each of its cells.
const QUAD: [(usize, usize); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];
/// Points after which it is seen whether a block can still be good enough: so few that their values fit a byte.
const PART: usize = 16;

/// The step in heading at which few points move by more than a cell.
fn step_rad(points: &[[f64; 2]]) -> f64 {
    let mut ranges: Vec<f64> = points.iter().map(|[x, y]| x.hypot(*y)).collect();
    let far = (FAR_QUANTILE * (ranges.len() - 1) as f64) as usize;
    let (_, far_m, _) = ranges.select_nth_unstable_by(far, f64::total_cmp);
    (CELL_M / far_m.max(CELL_M)).clamp(STEP_RAD[0], STEP_RAD[1])
}

fn is_elsewhere(a: &Pose2, b: &Pose2) -> bool {
    (a.x - b.x).hypot(a.y - b.y) > SAME_PLACE_M || wrap_angle(a.theta - b.theta).abs() > SAME_PLACE_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_matcher::synthetic::Walls;
    use crate::surface::Thinning;
    use proptest::prelude::*;

    /// Points without direction.
    fn scan_of(points: &[(f32, f32)]) -> SurfaceScan {
        let (x_m, y_m) = points.iter().copied().unzip();
        let nothing = vec![0.0; points.len()];
        SurfaceScan { origin_m: [0.0; 2], x_m, y_m, normal_x: nothing.clone(), normal_y: nothing }
    }

    fn query(distance_m: f64, angle_rad: f64) -> PlaceQuery {
        PlaceQuery {
            window: SearchWindow { distance_m, angle_rad },
            likely: None,
            min_score: 0.1,
            margin: 1.0,
            most: 1,
            max_blocks: usize::MAX,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_best_place_is_the_one_that_an_exhaustive_search_finds(
            map in prop::collection::vec((-3.0..3.0_f32, -3.0..3.0_f32), 5..80),
            scan in prop::collection::vec((-3.0..3.0_f32, -3.0..3.0_f32), 5..40),
            radius in 1..48_i32,
            thickness in 0.05..1.0_f32,
        ) {
            // Maps and scans may be much longer than they are wide.
            let flattened = |points: &[(f32, f32)]| -> Vec<_> { points.iter().map(|(x, y)| (*x, thickness * y)).collect() };
            let (search, scan) = (PlaceSearch::new(&scan_of(&flattened(&map))), scan_of(&flattened(&scan)));
            let found = search.find(&scan, &Pose2::IDENTITY, &query(f64::from(radius) * CELL_M - 0.01, 0.0)).unwrap();
            let points = search.points_of(&scan);
            let cells = search.cells_at(&points, &Pose2::IDENTITY, 0.0);
            let best = (-radius..=radius)
                .flat_map(|y| (-radius..=radius).map(move |x| [x, y]))
                .map(|offset| search.bounds(0, &cells, 0, offset).unwrap()[0])
                .max()
                .unwrap();
            let score = f64::from(best) / (f64::from(ON_SURFACE) * points.len() as f64);
            prop_assert_eq!(found.first().map_or(0.0, |place| place.score), if score >= 0.1 { score } else { 0.0 });
        }

        /// What is known beforehand only spares work.
        #[test]
        fn a_likely_pose_changes_nothing_but_the_work(
            map in prop::collection::vec((-3.0..3.0_f32, -3.0..3.0_f32), 5..60),
            there in (-0.9..0.9_f64, -0.9..0.9_f64, -0.3..0.3_f64),
            likely in (-1.5..1.5_f64, -1.5..1.5_f64, -0.6..0.6_f64),
        ) {
            let map = scan_of(&map);
            let scan = map.seen_from(&Pose2::new(there.0, there.1, there.2));
            let search = PlaceSearch::new(&map);
            let many = PlaceQuery { most: 4, margin: 0.2, ..query(1.2, 0.4) };
            let found = search.find(&scan, &Pose2::IDENTITY, &many).unwrap();
            for pose in [Pose2::new(likely.0, likely.1, likely.2), Pose2::new(there.0, there.1, there.2)] {
                let sooner = search.find(&scan, &Pose2::IDENTITY, &PlaceQuery { likely: Some(pose), ..many }).unwrap();
                prop_assert_eq!(&sooner, &found);
            }
        }
    }

    #[test]
    fn a_scan_taken_elsewhere_is_found_where_it_was_taken() {
        let room = Walls::room();
        let map = SurfaceScan::new(&room.scan_from(&Pose2::IDENTITY, 720), &Thinning::default());
        let there = Pose2::new(0.8, -0.6, 2.3);
        let scan = SurfaceScan::new(&room.scan_from(&there, 720), &Thinning::default());
        let search = PlaceSearch::new(&map);
        let found =
            search.find(&scan, &Pose2::IDENTITY, &PlaceQuery { most: 3, margin: 0.1, ..query(2.0, 3.2) }).unwrap();
        assert!(found[0].score > 0.8, "{found:?}");
        let error = there.between(&found[0].pose);
        assert!(error.distance() < 0.2 && error.theta.abs() < 0.06, "{found:?}");
        for (index, place) in found.iter().enumerate() {
            assert!(found[..index].iter().all(|better| is_elsewhere(&better.pose, &place.pose)));
            assert!(found[..index].iter().all(|better| better.score >= place.score));
        }
    }

    #[test]
    fn a_likely_pose_spares_work() {
        let room = Walls::room();
        let map = SurfaceScan::new(&room.scan_from(&Pose2::IDENTITY, 720), &Thinning::default());
        let there = Pose2::new(0.8, -0.6, 0.4);
        let scan = SurfaceScan::new(&room.scan_from(&there, 720), &Thinning::default());
        let search = PlaceSearch::new(&map);
        let blocks_needed = |likely: Option<Pose2>| {
            let is_enough = |max_blocks: usize| {
                let query = PlaceQuery { max_blocks, likely, ..query(2.0, 1.0) };
                search.find(&scan, &Pose2::IDENTITY, &query).is_some()
            };
            let (mut too_few, mut enough) = (0, 1 << 20);
            assert!(is_enough(enough));
            while enough - too_few > 1 {
                let middle = (too_few + enough) / 2;
                if is_enough(middle) { enough = middle } else { too_few = middle }
            }
            enough
        };
        let (with, without) = (blocks_needed(Some(there)), blocks_needed(None));
        assert!(with < without, "{with} blocks instead of {without}");
    }

    #[test]
    fn a_row_of_equal_pillars_has_as_many_places() {
        let pillar = |x: f32| (0..12).map(move |k| (x + 0.3 * (k as f32 * 0.5).cos(), 0.3 * (k as f32 * 0.5).sin()));
        let map: Vec<(f32, f32)> = [-4.0, -2.0, 0.0, 2.0, 4.0].into_iter().flat_map(pillar).collect();
        let scan: Vec<(f32, f32)> = pillar(0.0).collect();
        let search = PlaceSearch::new(&scan_of(&map));
        let many = PlaceQuery { most: 10, margin: 0.1, ..query(4.5, 0.0) };
        assert_eq!(search.find(&scan_of(&scan), &Pose2::IDENTITY, &many).unwrap().len(), 5);
        let no_time = PlaceQuery { max_blocks: 10, ..many };
        assert_eq!(search.find(&scan_of(&scan), &Pose2::IDENTITY, &no_time), None);
    }
}
