//! The Cholesky factor of a symmetric positive definite matrix, and solves with it.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::{triangular_inverse, triangular_solve};
use faer::{MatMut, Par};

use super::matrix::{Matrix, add_scaled, multiply_lower, multiply_lowers, multiply_to_lower};
use super::panels::solve_rows;
use crate::error::{Error, Result};

/// L with A = LLᵀ, A symmetric and positive definite.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky {
    /// L in the lower triangle. The entries above the diagonal are unspecified.
    pub(super) factor: Matrix,
    jitter: f64,
}

impl Cholesky {
    /// Factorises `matrix` without jitter. Only its lower triangle is read. O(n³/3).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names `what` and the failing pivot.
    pub(crate) fn new(what: &'static str, matrix: Matrix) -> Result<Self> {
        let size = matrix.rows();
        let mut cholesky = Self { factor: matrix, jitter: 0.0 };
        match cholesky.factorise(&mut CholeskyScratch::new(size)) {
            Ok(()) => Ok(cholesky),
            Err(pivot) => Err(Error::NotPositiveDefinite { what, pivot, size, jitter: 0.0 }),
        }
    }

    /// Creates the factorisation from L, whose lower triangle is read.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] if an entry of the diagonal is not positive.
    pub(crate) fn of_lower(what: &'static str, factor: Matrix) -> Result<Self> {
        let size = factor.rows();
        match factor.diagonal().iter().position(|&entry| entry.is_nan() || entry <= 0.0) {
            Some(pivot) => Err(Error::NotPositiveDefinite { what, pivot, size, jitter: 0.0 }),
            None => Ok(Self { factor, jitter: 0.0 }),
        }
    }

    /// Returns L in the lower triangle. The entries above the diagonal are unspecified.
    pub(crate) fn factor(&self) -> &Matrix {
        &self.factor
    }

    /// Returns the factor of the identity.
    pub(crate) fn of_identity(size: usize) -> Self {
        let mut factor = Matrix::zeros(size, size);
        factor.add_to_diagonal(1.0);
        Self { factor, jitter: 0.0 }
    }

    /// Factorises `matrix`, with jitter if rounding makes the factorisation fail. The jitter on the diagonal is the
    /// smallest sufficient one of 1e-14, 1e-13 … 1e-8, times the mean of the diagonal. [`Cholesky::jitter`] returns it.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] if even the largest jitter is not sufficient.
    pub(crate) fn with_jitter(what: &'static str, matrix: &Matrix) -> Result<Self> {
        let size = matrix.rows();
        let mean = matrix.diagonal().iter().sum::<f64>() / size.max(1) as f64;
        let mut cholesky = Self { factor: matrix.clone(), jitter: 0.0 };
        let mut scratch = CholeskyScratch::new(size);
        let mut failure = cholesky.factorise(&mut scratch);
        let mut exponent = -14;
        while let Err(pivot) = failure {
            if exponent > -8 {
                return Err(Error::NotPositiveDefinite { what, pivot, size, jitter: cholesky.jitter });
            }
            cholesky.jitter = mean * 10f64.powi(exponent);
            exponent += 1;
            cholesky.factor.copy_from(matrix);
            cholesky.factor.add_to_diagonal(cholesky.jitter);
            failure = cholesky.factorise(&mut scratch);
        }
        Ok(cholesky)
    }

    /// Allocates the factor of an n×n matrix, for repeated factorisations without further allocation.
    pub(crate) fn reserve(size: usize) -> (Self, CholeskyScratch) {
        (Self { factor: Matrix::zeros(size, size), jitter: 0.0 }, CholeskyScratch::new(size))
    }

    /// Lets `fill` write the lower triangle of a new matrix, and factorises that matrix. O(n³/3), no allocation.
    pub(crate) fn refactorise(
        &mut self,
        what: &'static str,
        scratch: &mut CholeskyScratch,
        fill: impl FnOnce(&mut Matrix),
    ) -> Result<()> {
        fill(&mut self.factor);
        let size = self.size();
        self.factorise(scratch).map_err(|pivot| Error::NotPositiveDefinite { what, pivot, size, jitter: 0.0 })
    }

    /// Factorises the matrix in `factor`. If that fails, returns the failing pivot.
    fn factorise(&mut self, scratch: &mut CholeskyScratch) -> std::result::Result<(), usize> {
        let stack = MemStack::new(&mut scratch.0);
        llt::factor::cholesky_in_place(self.factor.0.as_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|llt::factor::LltError::NonPositivePivot { index }| index)?;
        // Some code paths of the library accept a NaN as a pivot. This check refuses it.
        match (0..self.size()).find(|&i| !(self.factor[(i, i)] > 0.0 && self.factor[(i, i)].is_finite())) {
            Some(pivot) => Err(pivot),
            None => Ok(()),
        }
    }

    /// Returns the order of the matrix.
    pub(crate) fn size(&self) -> usize {
        self.factor.rows()
    }

    /// Returns the jitter that was added to the diagonal (ordinarily 0).
    pub(crate) fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Returns ln|A|.
    pub(crate) fn log_determinant(&self) -> f64 {
        2.0 * (0..self.size()).map(|i| self.factor[(i, i)].ln()).sum::<f64>()
    }

    /// Replaces x by L⁻¹x. O(n²).
    pub(crate) fn solve_lower(&self, x: &mut [f64]) {
        assert_eq!(x.len(), self.size(), "entries of x, and size of L");
        // Reading L takes most of the time. Whole columns are read faster than the blocks of a recursive solve.
        for column in 0..x.len() {
            let factor = &self.factor.column(column)[column..];
            let (own, below) = x[column..].split_at_mut(1);
            own[0] /= factor[0];
            add_scaled(-own[0], &factor[1..], below);
        }
    }

    /// Replaces x by L⁻ᵀx. O(n²).
    pub(crate) fn solve_upper(&self, x: &mut [f64]) {
        let x = MatMut::from_column_major_slice_mut(x, self.size(), 1);
        triangular_solve::solve_upper_triangular_in_place(self.factor.t(), x, Par::Seq);
    }

    /// Replaces x by A⁻¹x. O(n²).
    pub(crate) fn solve(&self, x: &mut [f64]) {
        self.solve_lower(x);
        self.solve_upper(x);
    }

    /// Replaces X by L⁻¹X. O(n² columns).
    pub(crate) fn solve_lower_matrix(&self, x: &mut Matrix) {
        if x.columns() == 1 {
            return self.solve_lower(x.column_mut(0));
        }
        triangular_solve::solve_lower_triangular_in_place(self.factor.view(), x.0.as_mut(), Par::Seq);
    }

    /// Replaces X by XL⁻ᵀ: solves for every row of X, for example the rows of many events. O(n² rows).
    pub(crate) fn solve_rows(&self, x: &mut Matrix) {
        solve_rows(self.factor.view(), x.0.as_mut(), 0);
    }

    /// Replaces X by L⁻ᵀX. O(n² columns).
    pub(crate) fn solve_upper_matrix(&self, x: &mut Matrix) {
        triangular_solve::solve_upper_triangular_in_place(self.factor.t(), x.0.as_mut(), Par::Seq);
    }

    /// Returns L⁻¹XL⁻ᵀ for a symmetric X. O(n³).
    pub(crate) fn whiten(&self, mut x: Matrix) -> Matrix {
        self.solve_lower_matrix(&mut x);
        let mut x = x.transposed();
        self.solve_lower_matrix(&mut x);
        x
    }

    /// Returns LXLᵀ for a symmetric X. O(n³).
    pub(crate) fn unwhiten(&self, x: &Matrix) -> Matrix {
        let (mut half, mut whole) = (Matrix::zeros(self.size(), self.size()), Matrix::zeros(self.size(), self.size()));
        multiply_lower(&self.factor, x.view(), &mut half);
        multiply_to_lower(&half, &self.factor, &mut whole);
        whole
    }

    /// Returns the factor of LALᵀ, from the factor of A. O(n³/3).
    pub(crate) fn times(&self, of_a: &Cholesky) -> Self {
        let mut factor = Matrix::zeros(self.size(), self.size());
        multiply_lowers(&self.factor, &of_a.factor, &mut factor);
        Self { factor, jitter: self.jitter }
    }

    /// Multiplies the columns `first..first + n` of X by L⁻ᵀ from the right.
    pub(crate) fn solve_rows_in_columns(&self, x: &mut Matrix, first: usize) {
        solve_rows(self.factor.view(), x.0.as_mut().subcols_mut(first, self.size()), 0);
    }

    /// Multiplies the rows `first..first + n` of X by L⁻¹ from the left.
    pub(crate) fn solve_lower_rows(&self, x: &mut Matrix, first: usize) {
        let rows = x.0.as_mut().subrows_mut(first, self.size());
        triangular_solve::solve_lower_triangular_in_place(self.factor.view(), rows, Par::Seq);
    }

    /// Writes L⁻¹ to the lower triangle of `out`. O(n³/3).
    pub(crate) fn invert_lower(&self, out: &mut Matrix) {
        triangular_inverse::invert_lower_triangular(out.0.as_mut(), self.factor.view(), Par::Seq);
    }

    /// Returns L·x. O(n²).
    pub(crate) fn lower_times(&self, x: &[f64]) -> Vec<f64> {
        (0..self.size()).map(|i| (0..=i).map(|j| self.factor[(i, j)] * x[j]).sum()).collect()
    }

    /// Returns L, with zeros above its diagonal.
    pub(crate) fn lower(&self) -> Matrix {
        Matrix::from_fn(self.size(), self.size(), |i, j| if i >= j { self.factor[(i, j)] } else { 0.0 })
    }
}

/// Working memory of a factorisation.
pub(crate) struct CholeskyScratch(MemBuffer);

impl CholeskyScratch {
    fn new(size: usize) -> Self {
        let request = llt::factor::cholesky_in_place_scratch::<f64>(size, Par::Seq, Default::default());
        Self(MemBuffer::new(request))
    }
}

/// Writes I + diag(roots)·K·diag(roots) to the lower triangle of `b`. For roots of ω this is I + Ω^½KΩ^½, which has no
/// eigenvalue below 1 and can always be factorised. O(n²).
pub(crate) fn fill_scaled(b: &mut Matrix, gram: &Matrix, roots: &[f64]) {
    for column in 0..roots.len() {
        let root = roots[column];
        let entries = b.column_mut(column)[column..].iter_mut().zip(&gram.column(column)[column..]);
        entries.zip(&roots[column..]).for_each(|((out, k), other)| *out = root * k * other);
        b[(column, column)] += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solving_one_column_agrees_with_solving_two_at_every_size() {
        for size in [0, 1, 7, 64, 300] {
            // NaN above the diagonal must not be read.
            let entry = |row: usize, column: usize| (row as f64 * 0.7 + column as f64 * 1.3).sin();
            let factor = Matrix::from_fn(size, size, |i, j| match i.cmp(&j) {
                std::cmp::Ordering::Less => f64::NAN,
                std::cmp::Ordering::Equal => 1.0 + 0.5 * entry(i, j).abs(),
                std::cmp::Ordering::Greater => entry(i, j) / (size as f64).sqrt(),
            });
            let cholesky = Cholesky::of_lower("L", factor).unwrap();
            let mut both = Matrix::from_fn(size, 2, entry);
            let mut single = both.column(1).to_vec();
            cholesky.solve_lower_matrix(&mut both);
            cholesky.solve_lower(&mut single);
            let far = |(a, b): (&f64, &f64)| (a - b).abs();
            let worst = single.iter().zip(both.column(1)).map(far).fold(0.0, f64::max);
            assert!(worst < 1e-11, "{size}: {worst}");
        }
    }
}
