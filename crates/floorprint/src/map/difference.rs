//! What changed between two maps of one place.

use super::{Occupancy, Raster};

/// What became of a patch of the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Something stands where the floor was free.
    New,
    /// The floor is free where something stood.
    Gone,
}

/// A patch that changed: cells that touch each other, by an edge or a corner.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangedPatch {
    /// What became of it.
    pub change: Change,
    /// Area, square metres.
    pub area_m2: f64,
    /// Its outlines, metres, each closed by its first corner: the outer ones run counter-clockwise, those of holes
    /// clockwise.
    pub outlines_m: Vec<Vec<[f64; 2]>>,
}

/// Patches that changed from `before` to `after`, whose axes lie alike; the largest first.
///
/// Only what was seen both times can have changed. A wall that moved by no more than `tolerance_m` (the maps' own
/// error) did not, and patches smaller than `least_area_m2` are left out.
#[must_use]
pub fn difference(
    before: &Raster<Occupancy>,
    after: &Raster<Occupancy>,
    tolerance_m: f64,
    least_area_m2: f64,
) -> Vec<ChangedPatch> {
    let reach = (tolerance_m / before.resolution_m).ceil() as i64;
    let near: Vec<[f64; 2]> = (-reach..=reach)
        .flat_map(|row| (-reach..=reach).map(move |column| [column as f64, row as f64]))
        .map(|[x, y]| [x * before.resolution_m, y * before.resolution_m])
        .filter(|[x, y]| x.hypot(*y) <= tolerance_m)
        .collect();
    let stands_near = |map: &Raster<Occupancy>, [x, y]: [f64; 2]| {
        near.iter().any(|[dx, dy]| map.at([x + dx, y + dy]) == Some(&Occupancy::Occupied))
    };
    let changes = before.map(|index, center| {
        let was = before.cells[index];
        let is = after.at(center).copied().unwrap_or_default();
        match (was, is) {
            (Occupancy::Free, Occupancy::Occupied) if !stands_near(before, center) => Some(Change::New),
            (Occupancy::Occupied, Occupancy::Free) if !stands_near(after, center) => Some(Change::Gone),
            _ => None,
        }
    });
    let mut patches = patches(&changes);
    patches.retain(|patch| patch.area_m2 >= least_area_m2);
    // A stable sort: of patches of the same size the upper one comes first.
    patches.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    patches
}

/// The patches of a raster, in the order of their first cells.
fn patches(changes: &Raster<Option<Change>>) -> Vec<ChangedPatch> {
    let mut patch_of = vec![usize::MAX; changes.cells.len()];
    let mut patches = Vec::new();
    for first in 0..changes.cells.len() {
        let Some(change) = changes.cells[first].filter(|_| patch_of[first] == usize::MAX) else { continue };
        let number = patches.len();
        let mut cells = vec![first];
        patch_of[first] = number;
        let mut done = 0;
        while let Some(&cell) = cells.get(done) {
            done += 1;
            let (row, column) = changes.row_and_column(cell);
            let around = (-1..=1).flat_map(|down| (-1..=1).map(move |right| (row + down, column + right)));
            for neighbour in around.filter_map(|(row, column)| changes.index(row, column)) {
                if changes.cells[neighbour] == Some(change) && patch_of[neighbour] == usize::MAX {
                    patch_of[neighbour] = number;
                    cells.push(neighbour);
                }
            }
        }
        let belongs = |row: i64, column: i64| changes.index(row, column).is_some_and(|cell| patch_of[cell] == number);
        let corners = outlines(&cells.iter().map(|&cell| changes.row_and_column(cell)).collect::<Vec<_>>(), belongs);
        let in_metres = |(row, column): (i64, i64)| {
            [
                changes.origin_m[0] + column as f64 * changes.resolution_m,
                changes.origin_m[1] + (changes.height as i64 - row) as f64 * changes.resolution_m,
            ]
        };
        patches.push(ChangedPatch {
            change,
            area_m2: cells.len() as f64 * changes.resolution_m * changes.resolution_m,
            outlines_m: corners.into_iter().map(|outline| outline.into_iter().map(in_metres).collect()).collect(),
        });
    }
    patches
}

/// Row and column of a cell or of the corner at its upper left.
type Place = (i64, i64);

/// Follows the edges between cells that belong and cells that do not, keeping those that belong at the left hand. Where
/// two cells touch by a corner only, each has a corner of its own there.
fn outlines(cells: &[Place], belongs: impl Fn(i64, i64) -> bool) -> Vec<Vec<Place>> {
    // Edges by the corner where they start and their direction: east, north, west, south (rows run downwards).
    const STEPS: [Place; 4] = [(0, 1), (-1, 0), (0, -1), (1, 0)];
    let mut edges = std::collections::BTreeSet::new();
    for &(row, column) in cells {
        for (direction, (beside, start)) in [
            ((row + 1, column), (row + 1, column)),
            ((row, column + 1), (row + 1, column + 1)),
            ((row - 1, column), (row, column + 1)),
            ((row, column - 1), (row, column)),
        ]
        .into_iter()
        .enumerate()
        {
            if !belongs(beside.0, beside.1) {
                edges.insert((start, direction));
            }
        }
    }
    let mut outlines = Vec::new();
    while let Some(&(start, first)) = edges.first() {
        let (mut corner, mut direction, mut outline) = (start, first, vec![start]);
        loop {
            edges.remove(&(corner, direction));
            corner = (corner.0 + STEPS[direction].0, corner.1 + STEPS[direction].1);
            // Left, straight on, right.
            let turns = [1, 0, 3].map(|turn| (direction + turn) % 4);
            let Some(next) = turns.into_iter().find(|&turn| edges.contains(&(corner, turn))) else { break };
            if next != direction {
                outline.push(corner);
            }
            direction = next;
        }
        // The first corner is none where the last edge runs on into the first.
        if direction == first {
            outline.remove(0);
        }
        outlines.push(outline);
    }
    outlines
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn map(rows: &[&str]) -> Raster<Occupancy> {
        let cell = |letter: char| match letter {
            '#' => Occupancy::Occupied,
            '.' => Occupancy::Free,
            _ => Occupancy::Unknown,
        };
        let cells: Vec<Occupancy> = rows.iter().flat_map(|row| row.chars().map(cell)).collect();
        Raster { width: rows[0].len(), height: rows.len(), resolution_m: 0.5, origin_m: [-1.0, 2.0], cells }
    }

    #[test]
    fn a_table_that_came_and_a_box_that_went() {
        let before = map(&["#########", "#.......#", "#....##.#", "#.......#", "#########"]);
        let after = map(&["#########", "#.#.....#", "#.#.....#", "#.......#", "#########"]);
        let patches = difference(&before, &after, 0.1, 0.0);
        let expected =
            |change, outline: &[[f64; 2]]| ChangedPatch { change, area_m2: 0.5, outlines_m: vec![outline.to_vec()] };
        assert_eq!(
            patches,
            [
                expected(Change::New, &[[0.0, 4.0], [0.0, 3.0], [0.5, 3.0], [0.5, 4.0]]),
                expected(Change::Gone, &[[1.5, 3.5], [1.5, 3.0], [2.5, 3.0], [2.5, 3.5]]),
            ]
        );
        assert_eq!(difference(&before, &after, 0.1, 0.6), []);
    }

    #[test]
    fn what_was_not_seen_or_moved_a_little_did_not_change() {
        let before = map(&["#.. ", "#.. "]);
        assert_eq!(difference(&before, &map(&[".#. ", ".#.#"]), 0.5, 0.0), []);
        assert_eq!(difference(&before, &map(&["  ..", "  .."]), 0.5, 0.0), []);
    }

    fn area(outline: &[[f64; 2]]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        0.5 * outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>()
    }

    proptest! {
        #[test]
        fn outlines_enclose_just_the_area(cells in prop::collection::vec(any::<bool>(), 30)) {
            let all = |value| Raster { width: 6, height: 5, resolution_m: 0.5, origin_m: [0.0, 0.0], cells: vec![value; 30] };
            let (before, mut after) = (all(Occupancy::Free), all(Occupancy::Free));
            for (cell, stands) in after.cells.iter_mut().zip(&cells) {
                if *stands { *cell = Occupancy::Occupied; }
            }
            let patches = difference(&before, &after, 0.0, 0.0);
            prop_assert_eq!(patches.iter().map(|patch| patch.area_m2).sum::<f64>(), 0.25 * cells.iter().filter(|stands| **stands).count() as f64);
            for patch in patches {
                let enclosed: f64 = patch.outlines_m.iter().map(|outline| area(outline)).sum();
                prop_assert!((enclosed - patch.area_m2).abs() < 1e-9, "{} {}", enclosed, patch.area_m2);
            }
        }
    }
}
