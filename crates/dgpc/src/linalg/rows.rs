//! Vectors that lie in the rows of a matrix, one beside the other, so that loops take as many of them at a time as the
//! processor does.

use super::matrix::Matrix;
use super::wide::{MultiplyAdd, Wide, widest};

/// Xw, and the squared norm of every row of X. O(rows × columns).
pub(crate) fn row_moments(x: &Matrix, weights: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut along, mut squares) = (vec![0.0; x.rows()], vec![0.0; x.rows()]);
    widest(RowMoments { x, weights, along: &mut along, squares: &mut squares });
    (along, squares)
}

struct RowMoments<'a> {
    x: &'a Matrix,
    weights: &'a [f64],
    along: &'a mut [f64],
    squares: &'a mut [f64],
}

impl Wide for RowMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        for (column, &weight) in self.weights.iter().enumerate() {
            let sums = self.along.iter_mut().zip(self.squares.iter_mut());
            for ((along, square), &x) in sums.zip(self.x.column(column)) {
                *along = M::multiply_add(weight, x, *along);
                *square = M::multiply_add(x, x, *square);
            }
        }
    }
}

/// Rows and columns of a tile that is transposed at a time.
const TILE: usize = 4;

/// Writes the rows of X, each times its factor, to the columns of `out`, which becomes as large as it needs to be.
pub(crate) fn write_scaled_columns(x: &Matrix, factors: &[f64], out: &mut Matrix) {
    let (rows, columns) = (x.rows(), x.columns());
    out.shape(columns, rows);
    let (whole_rows, whole_columns) = (rows / TILE * TILE, columns / TILE * TILE);
    for first in (0..whole_columns).step_by(TILE) {
        let sources: [_; TILE] = std::array::from_fn(|column| x.column(first + column).as_chunks::<TILE>().0);
        for (tile, factors) in factors.as_chunks::<TILE>().0.iter().enumerate() {
            for (row, factor) in factors.iter().enumerate() {
                let target = &mut out.column_mut(tile * TILE + row)[first..first + TILE];
                target.iter_mut().zip(sources).for_each(|(target, source)| *target = factor * source[tile][row]);
            }
        }
    }
    let edges = (0..rows).map(|row| (row, if row < whole_rows { whole_columns } else { 0 }));
    for (row, first) in edges {
        (first..columns).for_each(|column| out[(column, row)] = factors[row] * x[(row, column)]);
    }
}
