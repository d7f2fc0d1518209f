//! Vectors stored in the rows of a matrix, side by side, so that vectorised loops process several of them at a time.

use super::matrix::Matrix;
use super::wide::{MultiplyAdd, Wide, widest};

/// Returns Xw and the squared norm of every row of X. O(rows × columns).
pub(crate) fn products_and_squared_norms(x: &Matrix, weights: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut products, mut squares) = (vec![0.0; x.rows()], vec![0.0; x.rows()]);
    widest(ProductsAndSquares { x, weights, products: &mut products, squares: &mut squares });
    (products, squares)
}

/// Returns the squared norm of every row of X. O(rows × columns).
pub(crate) fn squared_norms_of_rows(x: &Matrix) -> Vec<f64> {
    products_and_squared_norms(x, &vec![0.0; x.columns()]).1
}

struct ProductsAndSquares<'a> {
    x: &'a Matrix,
    weights: &'a [f64],
    products: &'a mut [f64],
    squares: &'a mut [f64],
}

impl Wide for ProductsAndSquares<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        for (column, &weight) in self.weights.iter().enumerate() {
            let sums = self.products.iter_mut().zip(self.squares.iter_mut());
            for ((product, square), &x) in sums.zip(self.x.column(column)) {
                *product = M::multiply_add(weight, x, *product);
                *square = M::multiply_add(x, x, *square);
            }
        }
    }
}

/// Number of rows and of columns in a tile of the transposition.
const TILE: usize = 4;

/// Writes each row of X, times its factor, to the corresponding column of `out`. Resizes `out` as needed.
pub(crate) fn write_scaled_transpose(x: &Matrix, factors: &[f64], out: &mut Matrix) {
    let (rows, columns) = (x.rows(), x.columns());
    out.resize(columns, rows);
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
    for row in 0..rows {
        let first = if row < whole_rows { whole_columns } else { 0 };
        (first..columns).for_each(|column| out[(column, row)] = factors[row] * x[(row, column)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_sums_and_scaled_transposes_agree_with_plain_loops() {
        for (rows, columns) in [(0, 3), (3, 0), (1, 1), (4, 4), (7, 9), (64, 5), (30, 33)] {
            let x = Matrix::from_fn(rows, columns, |row, column| (row as f64 * 0.7 + column as f64 * 1.3).sin());
            let weights: Vec<f64> = (0..columns).map(|column| (column as f64).cos()).collect();
            let factors: Vec<f64> = (0..rows).map(|row| 1.0 + row as f64).collect();
            let (products, squares) = products_and_squared_norms(&x, &weights);
            let mut scaled = Matrix::default();
            write_scaled_transpose(&x, &factors, &mut scaled);
            assert_eq!((scaled.rows(), scaled.columns()), (columns, rows));
            for row in 0..rows {
                let entries = || (0..columns).map(|column| x[(row, column)]);
                let expected: f64 = entries().zip(&weights).map(|(x, weight)| x * weight).sum();
                assert!((products[row] - expected).abs() < 1e-12);
                assert!((squares[row] - entries().map(|x| x * x).sum::<f64>()).abs() < 1e-12);
                assert!(entries().enumerate().all(|(column, x)| scaled[(column, row)] == factors[row] * x));
            }
        }
    }
}
