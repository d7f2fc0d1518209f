//! Dense linear algebra: the only file that names the linear-algebra crate.
//!
//! Everything runs on the calling thread, so that results do not depend on how many threads a caller uses.

use std::ops::{Index, IndexMut};

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::evd;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::{matmul::matmul, triangular_inverse, triangular_solve};
use faer::{Accum, Mat, MatMut, MatRef, Par};

use crate::error::{Error, Result};

/// A dense matrix of `f64`, stored column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix(Mat<f64>);

/// A borrowed, possibly transposed matrix.
pub(crate) type View<'a> = MatRef<'a, f64>;

impl Matrix {
    /// The rows × columns matrix of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self(Mat::zeros(rows, columns))
    }

    /// The matrix with `entry(row, column)` in each place.
    pub fn from_fn(rows: usize, columns: usize, entry: impl FnMut(usize, usize) -> f64) -> Self {
        Self(Mat::from_fn(rows, columns, entry))
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.0.nrows()
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.0.ncols()
    }

    /// One column.
    pub fn column(&self, column: usize) -> &[f64] {
        self.0.col_as_slice(column)
    }

    /// One column, to write to.
    pub fn column_mut(&mut self, column: usize) -> &mut [f64] {
        self.0.col_as_slice_mut(column)
    }

    /// The diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.rows().min(self.columns())).map(|i| self[(i, i)]).collect()
    }

    /// Adds a number to every entry of the diagonal.
    pub(crate) fn add_to_diagonal(&mut self, value: f64) {
        (0..self.rows().min(self.columns())).for_each(|i| self[(i, i)] += value);
    }

    /// The transposed matrix, copied.
    pub fn transposed(&self) -> Self {
        Self(self.0.transpose().to_owned())
    }

    pub(crate) fn view(&self) -> View<'_> {
        self.0.as_ref()
    }

    pub(crate) fn t(&self) -> View<'_> {
        self.0.transpose()
    }

    pub(crate) fn copy_from(&mut self, other: &Matrix) {
        self.0.copy_from(&other.0);
    }

    /// Matrix × vector. O(rows × columns).
    pub(crate) fn times(&self, vector: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.rows()];
        multiply_vector(self.view(), vector, &mut out);
        out
    }

    /// Transposed matrix × vector. O(rows × columns).
    pub(crate) fn transposed_times(&self, vector: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.columns()];
        multiply_vector(self.t(), vector, &mut out);
        out
    }

    /// Adds `other`, entry by entry, `factor` times.
    pub(crate) fn add_scaled(&mut self, factor: f64, other: &Matrix) {
        for column in 0..self.columns() {
            for (own, other) in self.column_mut(column).iter_mut().zip(other.column(column)) {
                *own += factor * other;
            }
        }
    }

    /// Writes the lower triangle to the upper one.
    pub(crate) fn mirror_lower(&mut self) {
        for column in 1..self.columns() {
            for row in 0..column {
                self[(row, column)] = self[(column, row)];
            }
        }
    }

    /// The last `count` columns, copied.
    pub(crate) fn last_columns(&self, count: usize) -> Self {
        Self(self.view().subcols(self.columns() - count, count).to_owned())
    }

    /// Replaces as many last columns as `other` has.
    pub(crate) fn set_last_columns(&mut self, other: &Matrix) {
        let first = self.columns() - other.columns();
        (0..other.columns()).for_each(|column| self.column_mut(first + column).copy_from_slice(other.column(column)));
    }

    /// ½(A + Aᵀ), in place: takes rounding out of a matrix that is symmetric by its definition.
    pub(crate) fn symmetrise(&mut self) {
        for column in 1..self.columns() {
            for row in 0..column {
                let mean = 0.5 * (self[(row, column)] + self[(column, row)]);
                self[(row, column)] = mean;
                self[(column, row)] = mean;
            }
        }
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.0[(row, column)]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.0[(row, column)]
    }
}

/// aᵀb.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// ‖a‖².
pub(crate) fn squared_norm(a: &[f64]) -> f64 {
    dot(a, a)
}

/// A·B, written to `out`.
pub(crate) fn multiply(a: View<'_>, b: View<'_>, out: &mut Matrix) {
    matmul(out.0.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
}

/// A·B.
pub(crate) fn product(a: View<'_>, b: View<'_>) -> Matrix {
    let mut out = Matrix::zeros(a.nrows(), b.ncols());
    multiply(a, b, &mut out);
    out
}

/// Adds `factor`·A·Aᵀ to `out`, both triangles; half the work of a general product.
pub(crate) fn add_symmetric_product(factor: f64, a: View<'_>, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        a,
        BlockStructure::Rectangular,
        a.transpose(),
        BlockStructure::Rectangular,
        factor,
        Par::Seq,
    );
    out.mirror_lower();
}

/// Adds `factor`·LᵀL to `out`, both triangles, for a lower triangular L. O(n³/3).
pub(crate) fn add_lower_gram(factor: f64, lower: &Matrix, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        lower.t(),
        BlockStructure::TriangularUpper,
        lower.view(),
        BlockStructure::TriangularLower,
        factor,
        Par::Seq,
    );
    out.mirror_lower();
}

/// A·x, written to `out`.
pub(crate) fn multiply_vector(a: View<'_>, x: &[f64], out: &mut [f64]) {
    let x = MatRef::from_column_major_slice(x, a.ncols(), 1);
    let out = MatMut::from_column_major_slice_mut(out, a.nrows(), 1);
    matmul(out, Accum::Replace, a, x, 1.0, Par::Seq);
}

/// L with A = LLᵀ, A symmetric and positive definite.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky {
    factor: Matrix,
    jitter: f64,
}

impl Cholesky {
    /// Factorises `matrix` (its lower triangle is read) as it is. O(n³/3).
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

    /// Factorises `matrix`; where that fails by rounding, adds to its diagonal the smallest of 1e-14, 1e-13 … 1e-8 of its
    /// mean that helps, and says so in [`Cholesky::jitter`].
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when even the largest jitter does not help.
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

    /// Room for the factor of an n×n matrix, to be filled and factorised again and again without allocation.
    pub(crate) fn reserve(size: usize) -> (Self, CholeskyScratch) {
        (Self { factor: Matrix::zeros(size, size), jitter: 0.0 }, CholeskyScratch::new(size))
    }

    /// The factor of [A, X; Xᵀ, C] from that of A (n×n), X (n×m) and C (m×m): O(n²m + m³).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names `what` and the failing pivot.
    pub(crate) fn extended(&self, what: &'static str, mut x: Matrix, mut c: Matrix) -> Result<Self> {
        let (old, size) = (self.size(), self.size() + c.rows());
        self.solve_lower_matrix(&mut x);
        add_symmetric_product(-1.0, x.t(), &mut c);
        let corner = Self::new(what, c).map_err(|error| match error {
            Error::NotPositiveDefinite { pivot, jitter, .. } => {
                Error::NotPositiveDefinite { what, pivot: pivot + old, size, jitter }
            }
            other => other,
        })?;
        let mut factor = Matrix::zeros(size, size);
        factor.0.as_mut().submatrix_mut(0, 0, old, old).copy_from(self.factor.view());
        factor.0.as_mut().submatrix_mut(old, 0, size - old, old).copy_from(x.t());
        factor.0.as_mut().submatrix_mut(old, old, size - old, size - old).copy_from(corner.factor.view());
        Ok(Self { factor, jitter: self.jitter })
    }

    /// Replaces the matrix by what `fill` writes to the lower triangle, and factorises it. O(n³/3), no allocation.
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

    /// Factorises what `factor` holds; the failing pivot otherwise.
    fn factorise(&mut self, scratch: &mut CholeskyScratch) -> std::result::Result<(), usize> {
        let stack = MemStack::new(&mut scratch.0);
        llt::factor::cholesky_in_place(self.factor.0.as_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|llt::factor::LltError::NonPositivePivot { index }| index)?;
        // A NaN passes the pivot test of some code paths; it must not pass this function.
        match (0..self.size()).find(|&i| !(self.factor[(i, i)] > 0.0 && self.factor[(i, i)].is_finite())) {
            Some(pivot) => Err(pivot),
            None => Ok(()),
        }
    }

    /// Order of the matrix.
    pub(crate) fn size(&self) -> usize {
        self.factor.rows()
    }

    /// What was added to the diagonal to make the factorisation succeed; 0 in the ordinary case.
    pub(crate) fn jitter(&self) -> f64 {
        self.jitter
    }

    /// ln|A|.
    pub(crate) fn log_determinant(&self) -> f64 {
        2.0 * (0..self.size()).map(|i| self.factor[(i, i)].ln()).sum::<f64>()
    }

    /// x ← L⁻¹x. O(n²).
    pub(crate) fn solve_lower(&self, x: &mut [f64]) {
        let x = MatMut::from_column_major_slice_mut(x, self.size(), 1);
        triangular_solve::solve_lower_triangular_in_place(self.factor.view(), x, Par::Seq);
    }

    /// x ← L⁻ᵀx. O(n²).
    pub(crate) fn solve_upper(&self, x: &mut [f64]) {
        let x = MatMut::from_column_major_slice_mut(x, self.size(), 1);
        triangular_solve::solve_upper_triangular_in_place(self.factor.t(), x, Par::Seq);
    }

    /// x ← A⁻¹x. O(n²).
    pub(crate) fn solve(&self, x: &mut [f64]) {
        self.solve_lower(x);
        self.solve_upper(x);
    }

    /// X ← L⁻¹X. O(n² columns).
    pub(crate) fn solve_lower_matrix(&self, x: &mut Matrix) {
        triangular_solve::solve_lower_triangular_in_place(self.factor.view(), x.0.as_mut(), Par::Seq);
    }

    /// X ← L⁻ᵀX. O(n² columns).
    pub(crate) fn solve_upper_matrix(&self, x: &mut Matrix) {
        triangular_solve::solve_upper_triangular_in_place(self.factor.t(), x.0.as_mut(), Par::Seq);
    }

    /// L⁻¹XL⁻ᵀ for a symmetric X. O(n³).
    pub(crate) fn whiten(&self, mut x: Matrix) -> Matrix {
        self.solve_lower_matrix(&mut x);
        let mut x = x.transposed();
        self.solve_lower_matrix(&mut x);
        x
    }

    /// Rows `first..first + n` of X ← L⁻¹ of the same rows.
    pub(crate) fn solve_lower_rows(&self, x: &mut Matrix, first: usize) {
        let rows = x.0.as_mut().subrows_mut(first, self.size());
        triangular_solve::solve_lower_triangular_in_place(self.factor.view(), rows, Par::Seq);
    }

    /// Writes L⁻¹ to the lower triangle of `out`. O(n³/3).
    pub(crate) fn invert_lower(&self, out: &mut Matrix) {
        triangular_inverse::invert_lower_triangular(out.0.as_mut(), self.factor.view(), Par::Seq);
    }

    /// L·x. O(n²).
    pub(crate) fn lower_times(&self, x: &[f64]) -> Vec<f64> {
        (0..self.size()).map(|i| (0..=i).map(|j| self.factor[(i, j)] * x[j]).sum()).collect()
    }

    /// L, with zeros above its diagonal.
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

/// Rows `first..` of X ← A·(those rows), for a square A.
pub(crate) fn multiply_rows(a: View<'_>, x: &mut Matrix, first: usize) {
    let old = x.0.as_ref().subrows(first, a.nrows()).to_owned();
    matmul(x.0.as_mut().subrows_mut(first, a.nrows()), Accum::Replace, a, old.as_ref(), 1.0, Par::Seq);
}

/// Eigenvalues (ascending) and eigenvectors (columns) of a symmetric matrix. O(n³).
///
/// # Errors
/// [`Error::NotPositiveDefinite`] if the iteration fails, which takes entries that are not finite.
pub(crate) fn symmetric_eigen(what: &'static str, matrix: &Matrix) -> Result<(Vec<f64>, Matrix)> {
    let size = matrix.rows();
    let mut values = Diag::<f64>::zeros(size);
    let mut vectors = Matrix::zeros(size, size);
    let request =
        evd::self_adjoint_evd_scratch::<f64>(size, evd::ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut buffer = MemBuffer::new(request);
    let done = evd::self_adjoint_evd(
        matrix.view(),
        values.as_mut(),
        Some(vectors.0.as_mut()),
        Par::Seq,
        MemStack::new(&mut buffer),
        Default::default(),
    );
    let values: Vec<f64> = (0..size).map(|i| values[i]).collect();
    if done.is_err() || values.iter().any(|v| !v.is_finite()) {
        return Err(Error::NotPositiveDefinite { what, pivot: 0, size, jitter: 0.0 });
    }
    Ok((values, vectors))
}

/// R with A = RRᵀ for a symmetric positive semi-definite A that stands beside the identity; eigenvalues that rounding made
/// negative count as zero.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when an eigenvalue is more negative than rounding explains.
pub(crate) fn semidefinite_root(what: &'static str, matrix: &Matrix) -> Result<Matrix> {
    let (values, mut root) = symmetric_eigen(what, matrix)?;
    let largest = values.iter().fold(1.0f64, |a, v| a.max(v.abs()));
    for (column, &value) in values.iter().enumerate() {
        if value < -1e-9 * largest {
            return Err(Error::NotPositiveDefinite { what, pivot: column, size: values.len(), jitter: 0.0 });
        }
        let scale = value.max(0.0).sqrt();
        root.column_mut(column).iter_mut().for_each(|v| *v *= scale);
    }
    Ok(root)
}
