//! Sparse Cholesky factorisation of symmetric matrices of 3×3 blocks, by the multifrontal
//! method (Duff & Reid 1983; Liu 1992, "The multifrontal method for sparse matrix solution").
//!
//! The unknowns are eliminated in an order of approximately minimal degree (Amestoy, Davis
//! & Duff 1996) found on the graph of blocks. Neighbours in that order with nearly the same
//! rows form a *front*: a small dense matrix into which the blocks of its columns and what
//! its children in the elimination tree leave over are added, whose columns are factorised,
//! and which leaves over a dense *update* for its parent. So all arithmetic runs on long
//! columns without indices, in one fixed order: the result is the same on every machine
//! with the same floating-point arithmetic.
//!
//! Own code, because faer's sparse solver would bring 35 crates into the core and choose
//! its arithmetic by the processor it finds; the ordering is a library's.

use super::PoseGraphError;
use super::linear_system::{BlockMatrix, Pattern};
use feral_amd::{CscPattern, amd_order};
use nalgebra::{DMatrix, DMatrixView, Matrix3, Vector3};

/// Fronts take in a column as long as at most this share of their factor are zeros stored
/// for it: larger dense fronts are faster than many small ones.
const MAX_ZERO_SHARE: f64 = 0.25;

/// The order of elimination and where every block goes: all that depends on the pattern alone.
#[derive(Debug, Clone)]
pub(super) struct SymbolicCholesky {
    /// The unknown eliminated at each position.
    order: Vec<usize>,
    fronts: Vec<Front>,
}

#[derive(Debug, Clone)]
struct Front {
    /// Positions of the front's rows, ascending; the first `columns` are its columns as well.
    rows: Vec<usize>,
    columns: usize,
    /// The pairs' blocks that belong to the front's columns.
    blocks: Vec<PlacedBlock>,
    /// The front that takes the update, and at which of its rows each row below the columns lies.
    parent: Option<(usize, Vec<usize>)>,
}

#[derive(Debug, Clone)]
struct PlacedBlock {
    pair: usize,
    row: usize,
    column: usize,
    is_transposed: bool,
}

impl SymbolicCholesky {
    pub(super) fn new(pattern: &Pattern) -> Result<Self, PoseGraphError> {
        let order = minimum_degree_order(pattern)?;
        let mut position = vec![0; order.len()];
        for (at, unknown) in order.iter().enumerate() {
            position[*unknown] = at;
        }
        let below = rows_below(pattern, &position);
        let mut fronts = gather_fronts(&below);

        let mut front_of = vec![0; order.len()];
        for (index, front) in fronts.iter().enumerate() {
            for column in &front.rows[..front.columns] {
                front_of[*column] = index;
            }
        }
        for (pair, (larger, smaller)) in pattern.pairs.iter().enumerate() {
            let (larger, smaller) = (position[*larger], position[*smaller]);
            let front = &mut fronts[front_of[larger.min(smaller)]];
            let row_at = |at| front.rows.partition_point(|row| *row < at);
            let (row, column) = (row_at(larger.max(smaller)), row_at(larger.min(smaller)));
            front.blocks.push(PlacedBlock { pair, row, column, is_transposed: larger < smaller });
        }
        for index in 0..fronts.len() {
            let update_rows = &fronts[index].rows[fronts[index].columns..];
            let parent = update_rows.first().map(|first| {
                let parent = front_of[*first];
                let rows = &fronts[parent].rows;
                (parent, update_rows.iter().map(|row| rows.partition_point(|r| r < row)).collect())
            });
            fronts[index].parent = parent;
        }
        Ok(Self { order, fronts })
    }
}

fn minimum_degree_order(pattern: &Pattern) -> Result<Vec<usize>, PoseGraphError> {
    let unknowns = pattern.unknowns;
    let mut neighbours = vec![Vec::new(); unknowns];
    for (larger, smaller) in &pattern.pairs {
        neighbours[*larger].push(*smaller as i32);
        neighbours[*smaller].push(*larger as i32);
    }
    let mut starts = vec![0];
    let mut rows = Vec::new();
    for (unknown, list) in neighbours.iter_mut().enumerate() {
        list.push(unknown as i32);
        list.sort_unstable();
        rows.extend_from_slice(list);
        starts.push(rows.len() as i32);
    }
    let order = CscPattern::new(unknowns, &starts, &rows).and_then(|pattern| amd_order(&pattern).ok());
    let order = order.ok_or(PoseGraphError::TooLarge { nodes: unknowns })?;
    Ok(order.into_iter().map(|unknown| unknown as usize).collect())
}

/// Positions of the blocks below the diagonal in each column of the factor: those of the
/// matrix and those of the columns whose first such row this column is.
fn rows_below(pattern: &Pattern, position: &[usize]) -> Vec<Vec<usize>> {
    let mut below: Vec<Vec<usize>> = vec![Vec::new(); pattern.unknowns];
    for (larger, smaller) in &pattern.pairs {
        let (a, b) = (position[*larger], position[*smaller]);
        below[a.min(b)].push(a.max(b));
    }
    for column in 0..below.len() {
        let mut rows = std::mem::take(&mut below[column]);
        rows.sort_unstable();
        rows.dedup();
        if let Some((parent, rest)) = rows.split_first() {
            below[*parent].extend_from_slice(rest);
        }
        below[column] = rows;
    }
    below
}

/// Joins successive columns of which each is the parent of the one before it.
fn gather_fronts(below: &[Vec<usize>]) -> Vec<Front> {
    let mut fronts = Vec::new();
    let mut first = 0;
    let mut stored = 0;
    for column in 0..below.len() {
        stored += 1 + below[column].len();
        let columns = column + 1 - first;
        let joins_next = below[column].first() == Some(&(column + 1)) && {
            let dense = (columns + 1) * (columns + 2) / 2 + (columns + 1) * below[column + 1].len();
            let zeros = dense - stored - 1 - below[column + 1].len();
            zeros as f64 <= MAX_ZERO_SHARE * dense as f64
        };
        if !joins_next {
            let rows = (first..=column).chain(below[column].iter().copied()).collect();
            fronts.push(Front { rows, columns, blocks: Vec::new(), parent: None });
            first = column + 1;
            stored = 0;
        }
    }
    fronts
}

/// The lower triangular factor of a matrix.
#[derive(Debug, Clone)]
pub(super) struct CholeskyFactor {
    /// Each front's columns, one after the other; of every column all rows of the front.
    panels: Vec<Vec<f64>>,
}

impl SymbolicCholesky {
    /// Factorises a matrix of the pattern given to [`new`](Self::new); `None` when it is
    /// not positive definite.
    pub(super) fn factorize(&self, matrix: &BlockMatrix) -> Option<CholeskyFactor> {
        let mut panels: Vec<_> = self.fronts.iter().map(|f| vec![0.0; 9 * f.columns * f.rows.len()]).collect();
        let mut updates: Vec<_> = self.fronts.iter().map(|_| Vec::new()).collect();
        for (index, front) in self.fronts.iter().enumerate() {
            let height = 3 * front.rows.len();
            let width = 3 * front.columns;
            if updates[index].is_empty() {
                updates[index] = vec![0.0; (height - width) * (height - width)];
            }
            let mut update = std::mem::take(&mut updates[index]);
            let panel = &mut panels[index];
            for (column, position) in front.rows[..front.columns].iter().enumerate() {
                add_block(panel, height, column, column, &matrix.diagonal[self.order[*position]]);
            }
            for placed in &front.blocks {
                let block = &matrix.pairs[placed.pair];
                let block = if placed.is_transposed { block.transpose() } else { *block };
                add_block(panel, height, placed.row, placed.column, &block);
            }
            factorize_front(panel, &mut update, height, width)?;
            if let Some((parent, rows)) = &front.parent {
                let above = &self.fronts[*parent];
                let (above_height, above_width) = (3 * above.rows.len(), 3 * above.columns);
                if updates[*parent].is_empty() {
                    updates[*parent] = vec![0.0; (above_height - above_width) * (above_height - above_width)];
                }
                let target =
                    FrontColumns { panel: &mut panels[*parent], update: &mut updates[*parent], height: above_height };
                target.add(&update, rows, above_width);
            }
        }
        Some(CholeskyFactor { panels })
    }

    /// Solves with the factor of a matrix for one right side, given and returned by unknown.
    pub(super) fn solve(&self, factor: &CholeskyFactor, right_side: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let order = &self.order;
        let mut values: Vec<f64> = order.iter().flat_map(|unknown| right_side[*unknown].iter().copied()).collect();
        let mut local = Vec::new();
        let fronts = || self.fronts.iter().zip(&factor.panels);
        for (front, panel) in fronts() {
            let height = 3 * front.rows.len();
            gather(&values, &front.rows, &mut local);
            for (column, entries) in panel.chunks_exact(height).enumerate() {
                local[column] /= entries[column];
                let value = local[column];
                for (l, entry) in local[column + 1..].iter_mut().zip(&entries[column + 1..]) {
                    *l -= entry * value;
                }
            }
            scatter(&local, &front.rows, &mut values);
        }
        for (front, panel) in fronts().rev() {
            let height = 3 * front.rows.len();
            gather(&values, &front.rows, &mut local);
            for (column, entries) in panel.chunks_exact(height).enumerate().rev() {
                let below: f64 = local[column + 1..].iter().zip(&entries[column + 1..]).map(|(l, e)| l * e).sum();
                local[column] = (local[column] - below) / entries[column];
            }
            scatter(&local, &front.rows, &mut values);
        }
        let mut solution = vec![Vector3::zeros(); order.len()];
        for (unknown, value) in order.iter().zip(values.chunks_exact(3)) {
            solution[*unknown] = Vector3::from_column_slice(value);
        }
        solution
    }
}

impl SymbolicCholesky {
    /// The blocks of the inverse on its diagonal, by unknown: from the last front to the first, each from those entries of the
    /// inverse that belong to the rows below its columns, which are among its parent's (Takahashi, Fagan & Chen 1973).
    pub(super) fn inverse_diagonal(&self, factor: &CholeskyFactor) -> Vec<Matrix3<f64>> {
        let mut inverses: Vec<DMatrix<f64>> = vec![DMatrix::zeros(0, 0); self.fronts.len()];
        let mut diagonal = vec![Matrix3::zeros(); self.order.len()];
        for (index, (front, panel)) in self.fronts.iter().zip(&factor.panels).enumerate().rev() {
            let (height, width) = (3 * front.rows.len(), 3 * front.columns);
            let panel = DMatrixView::from_slice(panel, height, width);
            let top = panel.rows(0, width);
            let identity = DMatrix::identity(width, width);
            // A pivot is never zero, so that a triangle always has an inverse.
            let of_top = top.solve_lower_triangular(&identity).unwrap_or(identity);
            let mut inverse = DMatrix::zeros(height, height);
            let mut of_columns = of_top.tr_mul(&of_top);
            if let Some((parent, rows)) = &front.parent {
                let above = &inverses[*parent];
                let of_rest = DMatrix::from_fn(height - width, height - width, |row, column| {
                    above[(3 * rows[row / 3] + row % 3, 3 * rows[column / 3] + column % 3)]
                });
                let gain = panel.rows(width, height - width) * &of_top;
                let crossed = -(&of_rest * &gain);
                of_columns -= gain.tr_mul(&crossed);
                inverse.view_mut((0, width), (width, height - width)).copy_from(&crossed.transpose());
                inverse.view_mut((width, 0), (height - width, width)).copy_from(&crossed);
                inverse.view_mut((width, width), (height - width, height - width)).copy_from(&of_rest);
            }
            for (column, position) in front.rows[..front.columns].iter().enumerate() {
                diagonal[self.order[*position]] = of_columns.fixed_view::<3, 3>(3 * column, 3 * column).into_owned();
            }
            inverse.view_mut((0, 0), (width, width)).copy_from(&of_columns);
            inverses[index] = inverse;
        }
        diagonal
    }
}

fn add_block(panel: &mut [f64], height: usize, row: usize, column: usize, block: &Matrix3<f64>) {
    for c in 0..3 {
        for r in 0..3 {
            panel[(3 * column + c) * height + 3 * row + r] += block[(r, c)];
        }
    }
}

/// A front while its children add to it.
struct FrontColumns<'a> {
    panel: &'a mut [f64],
    update: &'a mut [f64],
    height: usize,
}

impl FrontColumns<'_> {
    /// Adds a child's update whose block rows lie at `rows` of this front.
    fn add(self, child: &[f64], rows: &[usize], width: usize) {
        let child_height = 3 * rows.len();
        let update_height = self.height - width;
        for (block_column, column) in rows.iter().enumerate() {
            for c in 0..3 {
                let source = &child[(3 * block_column + c) * child_height..][..child_height];
                let column = 3 * column + c;
                // What lies above the diagonal block is never read.
                let (target, skipped) = if column < width {
                    (&mut self.panel[column * self.height..][..self.height], 0)
                } else {
                    (&mut self.update[(column - width) * update_height..][..update_height], width)
                };
                for (block_row, row) in rows.iter().enumerate().skip(block_column) {
                    let target = &mut target[3 * row - skipped..][..3];
                    for (t, s) in target.iter_mut().zip(&source[3 * block_row..][..3]) {
                        *t += s;
                    }
                }
            }
        }
    }
}

/// Factorises the `width` columns of a front and takes their products off its update;
/// `None` when a pivot is not positive.
fn factorize_front(panel: &mut [f64], update: &mut [f64], height: usize, width: usize) -> Option<()> {
    for row in (0..width).step_by(3) {
        let (done, rest) = panel.split_at_mut(row * height);
        let mut target = three_columns(rest, height, row);
        subtract_products(&mut target, done, height, row);
        factorize_block_column(target)?;
    }
    let below = height - width;
    for row in (0..below).step_by(3) {
        let mut target = three_columns(&mut update[row * below..], below, row);
        subtract_products(&mut target, panel, height, width + row);
    }
    Some(())
}

/// The first three columns of a part of a matrix, from a row on.
fn three_columns(columns: &mut [f64], height: usize, row: usize) -> [&mut [f64]; 3] {
    let (first, rest) = columns.split_at_mut(height);
    let (second, rest) = rest.split_at_mut(height);
    [&mut first[row..], &mut second[row..], &mut rest[row..height]]
}

/// `target` −= the products of the panel's columns with the blocks that they have in its
/// first rows, which are those from `row` on. By blocks, so that every number loaded is used three times.
fn subtract_products(target: &mut [&mut [f64]; 3], panel: &[f64], height: usize, row: usize) {
    let [x, y, z] = target;
    let length = x.len();
    let (y, z) = (&mut y[..length], &mut z[..length]);
    for block_column in panel.chunks_exact(3 * height) {
        let column = |i: usize| &block_column[i * height + row..][..length];
        let (a, b, c) = (column(0), column(1), column(2));
        let [by_x, by_y, by_z] = [0, 1, 2].map(|i| [a[i], b[i], c[i]]);
        for i in 0..length {
            x[i] -= by_x[0] * a[i] + by_x[1] * b[i] + by_x[2] * c[i];
            y[i] -= by_y[0] * a[i] + by_y[1] * b[i] + by_y[2] * c[i];
            z[i] -= by_z[0] * a[i] + by_z[1] * b[i] + by_z[2] * c[i];
        }
    }
}

/// Cholesky factorisation of a block and of the columns below it.
fn factorize_block_column(mut columns: [&mut [f64]; 3]) -> Option<()> {
    for current in 0..3 {
        let (done, rest) = columns.split_at_mut(current);
        let target = &mut rest[0][current..];
        for column in done {
            let factor = column[current];
            for (t, value) in target.iter_mut().zip(&column[current..]) {
                *t -= factor * value;
            }
        }
        let pivot = target[0];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let scale = 1.0 / pivot.sqrt();
        target.iter_mut().for_each(|value| *value *= scale);
    }
    Some(())
}

fn gather(values: &[f64], rows: &[usize], local: &mut Vec<f64>) {
    local.clear();
    local.extend(rows.iter().flat_map(|row| &values[3 * row..3 * row + 3]));
}

fn scatter(local: &[f64], rows: &[usize], values: &mut [f64]) {
    for (row, local) in rows.iter().zip(local.chunks_exact(3)) {
        values[3 * row..3 * row + 3].copy_from_slice(local);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A random positive definite matrix over random pairs.
    fn system(unknowns: usize, edges: &[(usize, usize, [f64; 9])]) -> (Pattern, BlockMatrix) {
        let mut pairs: Vec<_> = edges.iter().map(|(a, b, _)| (a % unknowns, b % unknowns)).collect();
        pairs.retain(|(a, b)| a != b);
        let mut pairs: Vec<_> = pairs.into_iter().map(|(a, b)| (a.max(b), a.min(b))).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let blocks: Vec<_> =
            pairs.iter().zip(edges).map(|(_, (_, _, values))| Matrix3::from_column_slice(values)).collect();
        // Rows dominated by their diagonal make the matrix positive definite.
        let diagonal =
            (0..unknowns).map(|i| Matrix3::identity() * (10.0 * (edges.len() + 1) as f64 + i as f64)).collect();
        (Pattern { unknowns, pairs }, BlockMatrix { diagonal, pairs: blocks })
    }

    fn dense(pattern: &Pattern, matrix: &BlockMatrix) -> DMatrix<f64> {
        let mut full = DMatrix::zeros(3 * pattern.unknowns, 3 * pattern.unknowns);
        for (i, block) in matrix.diagonal.iter().enumerate() {
            full.fixed_view_mut::<3, 3>(3 * i, 3 * i).copy_from(block);
        }
        for ((row, column), block) in pattern.pairs.iter().zip(&matrix.pairs) {
            full.fixed_view_mut::<3, 3>(3 * row, 3 * column).copy_from(block);
            full.fixed_view_mut::<3, 3>(3 * column, 3 * row).copy_from(&block.transpose());
        }
        full
    }

    proptest! {
        #[test]
        fn solves_what_it_factorised(
            unknowns in 1..30_usize,
            edges in prop::collection::vec((0..1000_usize, 0..1000_usize, prop::array::uniform9(-1.0..1.0_f64)), 0..80),
        ) {
            let (pattern, matrix) = system(unknowns, &edges);
            let symbolic = SymbolicCholesky::new(&pattern).unwrap();
            let factor = symbolic.factorize(&matrix).unwrap();
            let truth: Vec<_> = (0..unknowns).map(|i| Vector3::new(i as f64, 1.0, -0.5 * i as f64)).collect();
            let flat = nalgebra::DVector::from_iterator(3 * unknowns, truth.iter().flat_map(|v| v.iter().copied()));
            let product = dense(&pattern, &matrix) * flat;
            let right_side: Vec<_> =
                product.as_slice().chunks_exact(3).map(Vector3::from_column_slice).collect();
            let solution = symbolic.solve(&factor, &right_side);
            for (found, expected) in solution.iter().zip(&truth) {
                prop_assert!((found - expected).amax() < 1e-9);
            }
            let inverse = dense(&pattern, &matrix).try_inverse().unwrap();
            for (unknown, block) in symbolic.inverse_diagonal(&factor).iter().enumerate() {
                let expected = inverse.fixed_view::<3, 3>(3 * unknown, 3 * unknown);
                prop_assert!((block - expected).amax() < 1e-9 * expected.amax(), "{} {}", block, expected);
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor() {
        let (pattern, mut matrix) = system(3, &[(0, 1, [0.1; 9]), (1, 2, [0.2; 9])]);
        matrix.diagonal[1][(2, 2)] = -1.0;
        assert!(SymbolicCholesky::new(&pattern).unwrap().factorize(&matrix).is_none());
    }
}
