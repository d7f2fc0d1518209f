//! Fitted mean fields.

use pyo3::prelude::*;

use crate::border::{Numbers, Outcomes, Points, Table, Vector, Whole, array, check_memory, indices, vector, work};
use crate::posterior::{Posterior, Sites, Summary, observations, pair, references};
use crate::prior::Prior;

/// A fitted mean field: the Gaussian approximation to the posterior of events under a prior. `fit` returns it.
#[pyclass(frozen, module = "dgpc")]
pub struct Fit(pub dgpc::Fit);

impl Fit {
    /// Returns the number of rows of the fit's posterior with `summaries`.
    fn rows(&self, summaries: &[&dgpc::Summary]) -> usize {
        let own = self.0.inducing_points().map_or(self.0.sites().len(), dgpc::Inputs::len);
        own + summaries.iter().map(|summary| summary.len()).sum::<usize>()
    }
}

/// Returns the name of a reason why a fit ended.
pub fn stop_name(stop: dgpc::FitStop) -> &'static str {
    match stop {
        dgpc::FitStop::Converged => "converged",
        dgpc::FitStop::Stagnated => "stagnated",
        _ => "iterations_max",
    }
}

#[pymethods]
impl Fit {
    /// The prior of the fit.
    #[getter]
    fn prior(&self) -> Prior {
        Prior(self.0.prior().clone())
    }

    /// The sites of the events.
    #[getter]
    fn sites(&self) -> Sites {
        Sites(self.0.sites().clone())
    }

    /// Posterior means of the latent function at the events, shape (N,).
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.mean())
    }

    /// Posterior variances of the latent function at the events, shape (N,).
    #[getter]
    fn variance<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.variance())
    }

    /// Probabilities of success at the events, shape (N,).
    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.probabilities())
    }

    /// Expected Pólya-Gamma variables ω of the events, times their weights, shape (N,).
    #[getter]
    fn omega<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.sites().omega())
    }

    /// Tilts of the Pólya-Gamma variables, shape (N,). A later fit can start from them.
    #[getter]
    fn tilts<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.tilts())
    }

    /// The weights of the events, shape (N,).
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.weights())
    }

    /// The inducing points of a sparse fit, shape (M, d), or `None` for a dense fit.
    #[getter]
    fn inducing_points<'py>(&self, py: Python<'py>) -> PyResult<Option<Table<'py>>> {
        self.0.inducing_points().map(|points| array(py, points)).transpose()
    }

    /// The evidence bound in nats: a lower bound on the log marginal likelihood.
    #[getter]
    fn evidence(&self) -> f64 {
        self.0.evidence()
    }

    /// An estimate of the log marginal likelihood in nats. It is nearer than the bound, but not a bound.
    #[getter]
    fn corrected_evidence(&self) -> f64 {
        self.0.corrected_evidence()
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> usize {
        self.0.iterations()
    }

    /// The largest change of a tilt in the last iteration.
    #[getter]
    fn change(&self) -> f64 {
        self.0.change()
    }

    /// The reason why the iteration ended: `"converged"`, `"stagnated"` at the precision of rounding, or
    /// `"iterations_max"`.
    #[getter]
    fn stop(&self) -> &'static str {
        stop_name(self.0.stop())
    }

    /// Whether the change reached the tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.0.converged()
    }

    /// The jitter on the diagonal of the covariance at the inducing points, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.0.jitter()
    }

    /// Returns approximate log probabilities of every outcome given all other events, shape (N,), in nats.
    ///
    /// Weights do not count.
    fn leave_one_out<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(vector(py, work(py, || Ok(self.0.leave_one_out()))?))
    }

    /// Returns the posterior of the events and of messages. O(n³).
    ///
    /// Parameters
    /// ----------
    /// summaries : sequence of Summary, optional
    ///     Messages in place of those that the fit was given. An empty list gives the posterior of the events alone.
    #[pyo3(signature = (summaries=None))]
    fn posterior(&self, py: Python<'_>, summaries: Option<Vec<Py<Summary>>>) -> PyResult<Posterior> {
        let summaries = summaries.as_deref().map(references);
        let rows = self.rows(summaries.as_deref().unwrap_or_default());
        check_memory(&[3, rows, rows])?;
        work(py, || match summaries {
            Some(summaries) => self.0.posterior_with(&summaries),
            None => self.0.posterior(),
        })
        .map(Posterior)
    }

    /// Returns the posterior of some of the events, and of messages. The sites stay those of the whole fit.
    ///
    /// Parameters
    /// ----------
    /// events : array of int
    ///     Indices of the events.
    /// summaries : sequence of Summary, optional
    #[pyo3(signature = (events, summaries=vec![]), text_signature = "($self, events, summaries=())")]
    fn posterior_of_part(&self, py: Python<'_>, events: Whole, summaries: Vec<Py<Summary>>) -> PyResult<Posterior> {
        let (events, summaries) = (indices(events, self.0.sites().len())?, references(&summaries));
        let rows = self.rows(&summaries).max(events.len());
        check_memory(&[3, rows, rows])?;
        work(py, || self.0.posterior_of_part(&events, &summaries).map(Posterior))
    }

    /// Returns a sparse fit without some events and with new ones, or `None` for a dense fit.
    ///
    /// The remaining events keep their sites. The cost does not depend on their number.
    ///
    /// Parameters
    /// ----------
    /// removed : array of int
    ///     Indices of the events to remove.
    /// x, y, weights : arrays
    ///     The new events.
    #[pyo3(signature = (removed, x, y, weights=None))]
    fn amended(
        &self,
        py: Python<'_>,
        removed: Whole,
        x: Points,
        y: Outcomes,
        weights: Option<Numbers>,
    ) -> PyResult<Option<Self>> {
        let (removed, new) = (indices(removed, self.0.sites().len())?, observations(x, y, weights)?);
        work(py, || self.0.amended(&removed, &new)).map(|fit| fit.map(Self))
    }

    /// Returns the mean and the variance at points that are events of this dense fit, without solving anything.
    ///
    /// The result is `None` for a sparse fit, and if a point is not an event.
    fn latent_at_events<'py>(&self, py: Python<'py>, x: Points) -> PyResult<Option<(Vector<'py>, Vector<'py>)>> {
        Ok(work(py, || Ok(self.0.latent_at_events(&x.0)))?.map(|latent| pair(py, latent)))
    }

    /// Runs expectation propagation from the sites of this fit. Its variances are nearly those of the exact posterior.
    ///
    /// Parameters
    /// ----------
    /// summaries : sequence of Summary, optional
    ///     Messages in place of those of the fit.
    #[pyo3(signature = (summaries=vec![]), text_signature = "($self, summaries=())")]
    fn propagated(&self, py: Python<'_>, summaries: Vec<Py<Summary>>) -> PyResult<Propagated> {
        let summaries = references(&summaries);
        let rows = self.rows(&summaries);
        check_memory(&[4, rows, rows])?;
        work(py, || self.0.propagated_with(&summaries).map(Propagated))
    }

    fn __len__(&self) -> usize {
        self.0.sites().len()
    }

    fn __repr__(&self) -> String {
        format!("Fit of {} events with evidence {:.4}", self.0.sites().len(), self.0.evidence())
    }
}

/// The result of expectation propagation. `Fit.propagated` returns it.
#[pyclass(frozen, module = "dgpc")]
pub struct Propagated(dgpc::Propagated);

#[pymethods]
impl Propagated {
    /// Returns the posterior.
    fn posterior(&self, py: Python<'_>) -> PyResult<Posterior> {
        work(py, || self.0.posterior().map(Posterior))
    }

    /// The sites of the events.
    #[getter]
    fn sites(&self) -> Sites {
        Sites(self.0.sites().clone())
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> usize {
        self.0.iterations()
    }

    /// Whether the iteration reached its tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.0.converged()
    }
}
