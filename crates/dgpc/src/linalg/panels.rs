//! Triangular solves and symmetric products by panels of a few columns.
//!
//! The work is done by matrix products. They are fastest when their right side has so few columns that nothing is
//! rearranged first. Recursive halving of a triangle does not produce such products.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::wide::{MultiplyAdd, Wide, widest};

/// Number of columns in a panel.
const PANEL: usize = 8;

/// Rows of a panel that are processed at a time.
const LANES: usize = 4;

/// Number of columns in a stretch of successive panels. With a few hundred rows, a stretch stays in the second-level
/// cache.
const STRETCH: usize = 256;

/// Largest number of rows for which a symmetric product goes panel by panel. Beyond it, recursive halves are large
/// enough.
pub(super) const PANELS_MAX: usize = 256;

/// Replaces X by XL⁻ᵀ: solves for every row of X. The columns of X must be contiguous. The columns before
/// `first_unsolved` are solved already. O(nm rows) for the other m columns.
///
/// If L has more than 200 rows, it should be a transposed view, so that each row is contiguous in memory.
pub(super) fn solve_rows(lower: MatRef<'_, f64>, mut x: MatMut<'_, f64>, first_unsolved: usize) {
    let size = lower.nrows();
    for first in (first_unsolved..size).step_by(STRETCH) {
        let end = size.min(first + STRETCH);
        let (solved, mut stretch) = x.as_mut().subcols_mut(0, end).split_at_col_mut(first);
        take_off(solved, lower.submatrix(first, 0, end - first, first), stretch.as_mut());
        for own in (first..end).step_by(PANEL) {
            let width = PANEL.min(end - own);
            let before = own - first;
            let (solved, mut panel) = stretch.as_mut().subcols_mut(0, before + width).split_at_col_mut(before);
            take_off(solved, lower.submatrix(own, first, width, before), panel.as_mut());
            widest(SolvePanel { lower: lower.submatrix(own, own, width, width), columns: columns_mut(panel) });
        }
    }
}

/// Returns all columns as separate mutable slices. Each column must be contiguous.
pub(super) fn columns_mut(x: MatMut<'_, f64>) -> Vec<&mut [f64]> {
    let columns = x.col_iter_mut();
    columns.map(|column| column.try_as_col_major_mut().expect("columns without gaps").as_slice_mut()).collect()
}

/// Subtracts the contribution of solved columns Y: X ← X − YLᵀ.
fn take_off(solved: MatMut<'_, f64>, lower: MatRef<'_, f64>, x: MatMut<'_, f64>) {
    if solved.ncols() > 0 {
        matmul(x, Accum::Add, solved.as_ref(), lower.transpose(), -1.0, Par::Seq);
    }
}

/// Computes X ← XL⁻ᵀ for a few columns.
struct SolvePanel<'a> {
    lower: MatRef<'a, f64>,
    columns: Vec<&'a mut [f64]>,
}

impl Wide for SolvePanel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        let mut factors = [[0.0; PANEL]; PANEL];
        for (own, factors) in factors[..self.columns.len()].iter_mut().enumerate() {
            (0..own).for_each(|other| factors[other] = -self.lower[(own, other)]);
            factors[own] = self.lower[(own, own)].recip();
        }
        let (mut wholes, mut rests): ([&mut [_]; PANEL], [&mut [_]; PANEL]) = Default::default();
        for ((whole, rest), column) in wholes.iter_mut().zip(&mut rests).zip(self.columns) {
            let (chunks, left) = column.as_chunks_mut::<LANES>();
            (*whole, *rest) = (chunks, left.as_chunks_mut::<1>().0);
        }
        solve_chunks::<M, LANES>(&factors, &mut wholes);
        solve_chunks::<M, 1>(&factors, &mut rests);
    }
}

/// Solves for `ROWS` rows at a time. If a panel has fewer than `PANEL` columns, the missing columns are empty.
#[inline(always)]
fn solve_chunks<M: MultiplyAdd, const ROWS: usize>(
    factors: &[[f64; PANEL]; PANEL],
    columns: &mut [&mut [[f64; ROWS]]; PANEL],
) {
    for at in 0..columns[0].len() {
        let mut x = [[0.0; ROWS]; PANEL];
        x.iter_mut().zip(&*columns).for_each(|(x, column)| *x = column.get(at).copied().unwrap_or([0.0; ROWS]));
        solve_few::<M, ROWS>(factors, &mut x);
        columns
            .iter_mut()
            .zip(x)
            .filter_map(|(column, x)| Some((column.get_mut(at)?, x)))
            .for_each(|(out, x)| *out = x);
    }
}

/// Computes x ← xL⁻ᵀ for a few rows. `factors` contains −L off the diagonal and the reciprocals of the diagonal of L.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "loops of known length are unrolled, and all of x stays in registers")]
fn solve_few<M: MultiplyAdd, const ROWS: usize>(factors: &[[f64; PANEL]; PANEL], x: &mut [[f64; ROWS]; PANEL]) {
    for own in 0..PANEL {
        for other in 0..own {
            for row in 0..ROWS {
                x[own][row] = M::multiply_add(factors[own][other], x[other][row], x[own][row]);
            }
        }
        for row in 0..ROWS {
            x[own][row] *= factors[own][own];
        }
    }
}

/// Adds `factor`·XXᵀ to the lower triangle of `out`, panel by panel, for an X of at most [`PANELS_MAX`] rows. Some
/// entries next to the diagonal in the upper triangle are overwritten, too.
pub(super) fn add_symmetric_product_by_panels(factor: f64, x: MatRef<'_, f64>, mut out: MatMut<'_, f64>) {
    let rows = x.nrows();
    for first in (0..rows).step_by(PANEL) {
        let width = PANEL.min(rows - first);
        let panel = out.as_mut().submatrix_mut(first, first, rows - first, width);
        let (below, own) = (x.subrows(first, rows - first), x.subrows(first, width));
        matmul(panel, Accum::Add, below, own.transpose(), factor, Par::Seq);
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use faer::linalg::triangular_solve::solve_lower_triangular_in_place;

    use super::*;

    fn entry(row: usize, column: usize) -> f64 {
        (row as f64 * 0.7 + column as f64 * 1.3).sin()
    }

    /// Returns a lower triangle, well-conditioned at every size, with NaN above the diagonal, which must not be read.
    fn lower(size: usize) -> Mat<f64> {
        Mat::from_fn(size, size, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => f64::NAN,
            std::cmp::Ordering::Equal => 1.0 + 0.5 * entry(i, j).abs(),
            std::cmp::Ordering::Greater => entry(i, j) / (size as f64).sqrt(),
        })
    }

    #[test]
    fn solving_rows_agrees_with_solving_columns_at_every_size() {
        for size in [0, 1, 7, 8, 9, 20, 255, 256, 257, 530] {
            let lower = lower(size);
            let by_rows = lower.transpose().to_owned();
            for rows in [0, 1, 3, 4, 21] {
                let x = Mat::from_fn(rows, size, entry);
                let mut expected = x.transpose().to_owned();
                solve_lower_triangular_in_place(lower.as_ref(), expected.as_mut(), Par::Seq);
                let unsolved = [0, 3, 8, 257].into_iter().filter(|&first| first <= size);
                for (first, lower) in unsolved.flat_map(|first| [(first, lower.as_ref()), (first, by_rows.transpose())])
                {
                    let mut solved =
                        Mat::from_fn(rows, size, |i, j| if j < first { expected[(j, i)] } else { x[(i, j)] });
                    solve_rows(lower, solved.as_mut(), first);
                    let far = |(i, j): (usize, usize)| (solved[(i, j)] - expected[(j, i)]).abs();
                    let worst = (0..rows).flat_map(|i| (0..size).map(move |j| (i, j))).map(far).fold(0.0, f64::max);
                    assert!(worst < 1e-11, "{rows} rows of {size}: {worst}");
                }
            }
        }
    }

    #[test]
    fn symmetric_products_are_added_below_the_diagonal_only() {
        for rows in [0, 1, 7, 8, 9, 50, PANELS_MAX] {
            let x = Mat::from_fn(rows, 30, entry);
            let mut out = Mat::from_fn(rows, rows, |_, _| 2.0);
            add_symmetric_product_by_panels(-3.0, x.as_ref(), out.as_mut());
            for column in 0..rows {
                // The diagonal block of a panel is written as a whole.
                for row in (0..rows).filter(|row| *row >= column || column / PANEL > row / PANEL) {
                    let sum: f64 = (0..30).map(|k| x[(row, k)] * x[(column, k)]).sum();
                    let expected = if row >= column { 2.0 - 3.0 * sum } else { 2.0 };
                    assert!((out[(row, column)] - expected).abs() < 1e-12, "{rows}: {row}, {column}");
                }
            }
        }
    }
}
