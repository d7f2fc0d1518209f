//! A Cholesky factor to which rows can be appended.

use super::cholesky::Cholesky;
use super::matrix::{Matrix, add_symmetric_product};
use super::panels::solve_rows;
use crate::error::{Error, Result};

/// L with A = LLᵀ. Lᵀ is stored above its diagonal, so that rows can be read as fast as columns.
#[derive(Debug, Clone)]
pub(crate) struct GrowingCholesky(Cholesky);

/// The m rows that turn the factor of A (n×n) into the factor of [A, X; Xᵀ, C].
pub(crate) struct Extension {
    /// L⁻¹X, n×m.
    between: Matrix,
    /// Cholesky factor of C − XᵀA⁻¹X.
    corner: Cholesky,
}

impl Extension {
    /// Computes the rows from L⁻¹X (n×m) and C (m×m). [`GrowingCholesky::extend`] appends them. O(nm² + m³).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names `what` and the failing pivot.
    pub(crate) fn new(what: &'static str, between: Matrix, mut c: Matrix) -> Result<Self> {
        let (old, size) = (between.rows(), between.rows() + c.rows());
        add_symmetric_product(-1.0, between.t(), &mut c);
        let corner = Cholesky::new(what, c).map_err(|error| match error {
            Error::NotPositiveDefinite { pivot, jitter, .. } => {
                Error::NotPositiveDefinite { what, pivot: pivot + old, size, jitter }
            }
            other => other,
        })?;
        Ok(Self { between, corner })
    }

    /// Continues a solve with the extended factor. `solved` holds the first n entries of the solution. Replaces the
    /// right side in `last` by the other m entries. O(nm + m²).
    pub(crate) fn solve_lower(&self, solved: &[f64], last: &mut [f64]) {
        let contribution = self.between.transposed_times(solved);
        last.iter_mut().zip(contribution).for_each(|(entry, contribution)| *entry -= contribution);
        self.corner.solve_lower(last);
    }
}

impl GrowingCholesky {
    /// Returns a factor without rows.
    pub(crate) fn empty() -> Self {
        Self(Cholesky::of_identity(0))
    }

    /// Appends m rows to the factor. O((n + m)m), except when the storage must be enlarged.
    pub(crate) fn extend(&mut self, Extension { between, mut corner }: Extension) {
        let old = self.0.size();
        corner.factor.mirror_lower();
        if old == 0 {
            self.0 = corner;
            return;
        }
        self.0.factor.grow(old + corner.size(), |row, column| match (row >= old, column >= old) {
            (true, true) => corner.factor[(row - old, column - old)],
            (true, false) => between[(column, row - old)],
            (false, _) => between[(row, column - old)],
        });
    }

    /// Returns the diagonal of L.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        self.0.factor.diagonal()
    }

    /// Replaces X by L⁻¹X. O(n² columns).
    pub(crate) fn solve_lower_matrix(&self, x: &mut Matrix) {
        self.0.solve_lower_matrix(x);
    }

    /// Replaces X by XL⁻ᵀ: solves for every row of X. The columns before `first_unsolved` are solved already. O(nm
    /// rows) for the other m columns.
    pub(crate) fn solve_rows(&self, x: &mut Matrix, first_unsolved: usize) {
        solve_rows(self.0.factor.t(), x.0.as_mut(), first_unsolved);
    }
}
