//! Concatenation, the paper's fusion.

use pyo3::prelude::*;

use super::fused::pair;
use super::summary::{Summary, references};
use crate::border::{Points, Vector, check_memory, predicted, vector, work};
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
#[pyclass(frozen, module = "dgpc")]
pub struct Concatenation {
    concatenation: dgpc::Concatenation,
    rows: usize,
}

impl Concatenation {
    fn predicted(&self, py: Python<'_>, inputs: &dgpc::Inputs) -> PyResult<dgpc::Latent> {
        predicted(py, inputs, self.rows * self.rows, |part| self.concatenation.latent(part))
    }
}

#[pymethods]
impl Concatenation {
    #[new]
    fn new(py: Python<'_>, prior: &Prior, summaries: Vec<Py<Summary>>) -> PyResult<Self> {
        let summaries = references(&summaries);
        let rows = summaries.iter().map(|summary| summary.len()).sum();
        check_memory(&[3, rows, rows])?;
        let concatenation = work(py, || dgpc::Concatenation::new(&prior.0, &summaries))?;
        Ok(Self { concatenation, rows })
    }

    /// Returns the mean and the variance of the latent function at every point. See `Posterior.latent`.
    fn latent<'py>(&self, py: Python<'py>, x: Points) -> PyResult<(Vector<'py>, Vector<'py>)> {
        Ok(pair(py, self.predicted(py, &x.0)?))
    }

    /// Returns the probability of success at every point.
    fn probability<'py>(&self, py: Python<'py>, x: Points) -> PyResult<Vector<'py>> {
        Ok(vector(py, self.predicted(py, &x.0)?.probability()))
    }

    /// The largest jitter of all factorisations behind the concatenation, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.concatenation.jitter()
    }
}
