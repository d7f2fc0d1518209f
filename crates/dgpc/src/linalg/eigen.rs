//! Eigenvalues and roots of symmetric matrices.

use faer::Par;
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd;

use super::matrix::Matrix;
use crate::error::{Error, Result};

/// Returns the eigenvalues (ascending) and eigenvectors (columns) of a symmetric matrix. O(n³).
///
/// # Errors
/// [`Error::NoEigenvalues`] if the iteration fails, which happens only with entries that are not finite.
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
        return Err(Error::NoEigenvalues { what, size });
    }
    Ok((values, vectors))
}

/// Returns R with A = RRᵀ for a symmetric positive semi-definite A. Eigenvalues below `floor` are raised to `floor`.
/// This includes eigenvalues that rounding made negative.
///
/// # Errors
/// [`Error::NegativeEigenvalue`] if an eigenvalue is more negative than rounding explains, compared with the larger of
/// 1 and the largest eigenvalue.
pub(crate) fn semidefinite_root(what: &'static str, matrix: &Matrix, floor: f64) -> Result<Matrix> {
    let (values, mut root) = symmetric_eigen(what, matrix)?;
    let largest = values.iter().fold(1.0f64, |a, v| a.max(v.abs()));
    for (column, &value) in values.iter().enumerate() {
        if value < -1e-9 * largest {
            return Err(Error::NegativeEigenvalue { what, eigenvalue: value });
        }
        let scale = value.max(floor).sqrt();
        root.column_mut(column).iter_mut().for_each(|v| *v *= scale);
    }
    Ok(root)
}
