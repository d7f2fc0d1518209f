//! The shift of a posterior by summaries.

use pyo3::prelude::*;

use crate::border::{Deviation, Table, Vector, matrix, vector};

/// The shift of the latent function by summaries, and the uncertainty without them. `Posterior.shift_by` returns it.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> own = dgpc.fit(prior, [[0.0], [0.2], [0.4]], [1, 1, 1])
///     >>> other = dgpc.fit(prior, [[0.0], [0.2], [0.4]], [0, 0, 0])
///     >>> message = dgpc.Summary.marginal(prior, other.sites, [[0.2]])
///     >>> own.posterior().shift_by([message]).largest() > 1
///     True
#[pyclass(frozen, module = "dgpc")]
pub struct Shift(pub dgpc::Shift);

#[pymethods]
impl Shift {
    /// The mean with the summaries minus the mean without them, at all inducing points, shape (M,).
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.mean.as_slice())
    }

    /// The covariance without the summaries, shape (M, M).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Table<'py>> {
        matrix(py, &self.0.covariance)
    }

    /// Returns the largest shift in standard deviations, at points that the posterior determines without the summaries.
    ///
    /// Parameters
    /// ----------
    /// offset_sd : float, optional
    ///     Standard deviation of a common offset of the latent function that is no surprise.
    #[pyo3(signature = (offset_sd=Deviation(0.0)), text_signature = "($self, offset_sd=0.0)")]
    fn largest(&self, offset_sd: Deviation) -> f64 {
        self.0.largest(offset_sd.0)
    }
}
