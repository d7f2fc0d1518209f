//! Concatenation, the paper's fusion.

use pyo3::prelude::*;

use super::fused::pair;
use super::summary::{Summary, references};
use crate::border::{Points, Vector, check_memory, long_work, predicted, vector};
use crate::prior::Prior;

/// The paper's fusion of summaries: their means and covariances, stacked block by block.
///
/// It counts the prior once for every summary, so the regions of the summaries must not overlap. `Posterior` has no
/// such condition.
///
/// Parameters
/// ----------
/// prior : Prior
/// summaries : sequence of Summary
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> west = dgpc.fit(prior, [[0.0], [0.5]], [1, 1])
///     >>> east = dgpc.fit(prior, [[9.0], [9.5]], [0, 0])
///     >>> messages = [dgpc.Summary.marginal(prior, fit.sites, fit.sites.x) for fit in (west, east)]
///     >>> dgpc.Concatenation(prior, messages).probability([[0.2], [9.2]]).round(2)
///     array([0.77, 0.23])
#[pyclass(frozen, module = "dgpc")]
pub struct Concatenation {
    concatenation: dgpc::Concatenation,
    rows: usize,
}

impl Concatenation {
    fn predicted(this: Py<Self>, py: Python<'_>, x: Points) -> PyResult<dgpc::Latent> {
        let rows = this.get().rows;
        predicted(py, x.0, rows * rows, move |part| this.get().concatenation.latent(part))
    }
}

#[pymethods]
impl Concatenation {
    #[new]
    fn new(py: Python<'_>, prior: Py<Prior>, summaries: Vec<Py<Summary>>) -> PyResult<Self> {
        let rows = references(&summaries).iter().map(|summary| summary.len()).sum();
        check_memory(&[3, rows, rows])?;
        let concatenation = long_work(py, move || dgpc::Concatenation::new(&prior.get().0, &references(&summaries)))?;
        Ok(Self { concatenation, rows })
    }

    /// Returns the mean and the variance of the latent function at every point. See `Posterior.latent`.
    fn latent(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<(Vector<'_>, Vector<'_>)> {
        Ok(pair(py, Self::predicted(slf, py, x)?))
    }

    /// Returns the probability of success at every point.
    fn probability(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<Vector<'_>> {
        Ok(vector(py, Self::predicted(slf, py, x)?.probability()))
    }

    /// The largest jitter of all factorisations behind the concatenation, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.concatenation.jitter()
    }
}
