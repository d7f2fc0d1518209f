//! Fitted mean fields.

use dgpc::Monitor;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::propagated::Propagated;
use super::stored::{End, StoredFit};
use crate::border::{
    Numbers, Outcomes, Points, Table, Vector, Whole, array, check_memory, decode, encode, indices, long_work, reduce,
    vector, watched, work,
};
use crate::posterior::{Parts, Posterior, Sites, Summary, observations, pair, references};
use crate::prior::Prior;

/// A fitted mean field: the Gaussian approximation to the posterior of events under a prior. `fit` returns it.
///
/// A pickle holds the prior, the events, the tilts, the inducing points and the messages. One iteration computes the
/// fit again. A dense fit is then equal up to rounding. The tilts of a sparse fit differ by about `change`.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit = dgpc.fit(prior, [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0])
///     >>> fit.mean.round(1)
///     array([ 1.5,  0.9, -0.9, -1.5])
///     >>> len(fit.posterior())
///     4
#[pyclass(frozen, module = "dgpc")]
pub struct Fit {
    fit: dgpc::Fit,
    /// The messages that the fit was given.
    messages: Vec<dgpc::Summary>,
    end: End,
    is_amended: bool,
}

impl Fit {
    /// Creates the fit of events and of messages.
    pub fn new(fit: dgpc::Fit, messages: Vec<dgpc::Summary>) -> Self {
        Self { end: End::of(&fit), fit, messages, is_amended: false }
    }

    /// Returns the given messages, or else those of the fit.
    fn messages_or<'a>(&'a self, summaries: Option<&'a [Py<Summary>]>) -> Vec<&'a dgpc::Summary> {
        summaries.map_or_else(|| self.messages.iter().collect(), references)
    }

    /// Returns the number of rows of the fit's posterior with `summaries`.
    fn rows(&self, summaries: &[&dgpc::Summary]) -> usize {
        let own = self.fit.inducing_points().map_or(self.fit.sites().len(), dgpc::Inputs::len);
        own + summaries.iter().map(|summary| summary.len()).sum::<usize>()
    }

    /// Returns the posterior of some events and of summaries.
    fn posterior_of(&self, events: &[usize], summaries: &[&dgpc::Summary]) -> dgpc::Result<Posterior> {
        let condensed = self.fit.summary_of_part(events)?;
        let sites = self.fit.sites().select(if condensed.is_some() { &[] } else { events });
        Posterior::of(Parts::of_fit(self.fit.prior(), sites, condensed, summaries)?)
    }
}

#[pymethods]
impl Fit {
    /// The prior of the fit.
    #[getter]
    fn prior(&self) -> Prior {
        Prior(self.fit.prior().clone())
    }

    /// The sites of the events.
    #[getter]
    fn sites(&self) -> Sites {
        Sites(self.fit.sites().clone())
    }

    /// Posterior means of the latent function at the events, shape (N,).
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.mean())
    }

    /// Posterior variances of the latent function at the events, shape (N,).
    #[getter]
    fn variance<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.variance())
    }

    /// Probabilities of success at the events, shape (N,).
    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.probabilities())
    }

    /// Expected Pólya-Gamma variables ω of the events, times their weights, shape (N,).
    #[getter]
    fn omega<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.sites().omega())
    }

    /// Tilts of the Pólya-Gamma variables, shape (N,). A later fit can start from them.
    #[getter]
    fn tilts<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.tilts())
    }

    /// The weights of the events, shape (N,).
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.fit.weights())
    }

    /// The inducing points of a sparse fit, shape (M, d), or `None` for a dense fit.
    #[getter]
    fn inducing_points<'py>(&self, py: Python<'py>) -> PyResult<Option<Table<'py>>> {
        self.fit.inducing_points().map(|points| array(py, points)).transpose()
    }

    /// The evidence bound in nats: a lower bound on the log marginal likelihood.
    #[getter]
    fn evidence(&self) -> f64 {
        self.fit.evidence()
    }

    /// An estimate of the log marginal likelihood in nats. It is nearer than the bound, but not a bound.
    #[getter]
    fn corrected_evidence(&self) -> f64 {
        self.fit.corrected_evidence()
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> usize {
        self.end.iterations
    }

    /// The largest change of a tilt in the last iteration.
    #[getter]
    fn change(&self) -> f64 {
        self.end.change
    }

    /// The reason why the iteration ended: `"converged"`, `"stagnated"` at the precision of rounding, or
    /// `"iterations_max"`.
    #[getter]
    fn stop(&self) -> &str {
        &self.end.stop
    }

    /// Whether the change reached the tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.end.stop == "converged"
    }

    /// The jitter on the diagonal of the covariance at the inducing points, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.fit.jitter()
    }

    /// Returns approximate log probabilities of every outcome given all other events, shape (N,), in nats.
    ///
    /// Weights do not count.
    fn leave_one_out<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(vector(py, work(py, || Ok(self.fit.leave_one_out()))?))
    }

    /// Returns the posterior of the events and of messages. O(n³).
    ///
    /// Parameters
    /// ----------
    /// summaries : sequence of Summary, optional
    ///     Messages in place of those that the fit was given. An empty list gives the posterior of the events alone.
    #[pyo3(signature = (summaries=None))]
    fn posterior(slf: Py<Self>, py: Python<'_>, summaries: Option<Vec<Py<Summary>>>) -> PyResult<Posterior> {
        let rows = slf.get().rows(&slf.get().messages_or(summaries.as_deref()));
        check_memory(&[3, rows, rows])?;
        long_work(py, move || {
            let this = slf.get();
            let events: Vec<usize> = (0..this.fit.sites().len()).collect();
            this.posterior_of(&events, &this.messages_or(summaries.as_deref()))
        })
    }

    /// Returns the posterior of some of the events, and of messages. The sites stay those of the whole fit.
    ///
    /// Parameters
    /// ----------
    /// events : array of int
    ///     Indices of the events.
    /// summaries : sequence of Summary, optional
    ///     The messages of other agents. Those that the fit was given do not count by themselves.
    #[pyo3(signature = (events, summaries=vec![]), text_signature = "($self, events, summaries=())")]
    fn posterior_of_part(
        slf: Py<Self>,
        py: Python<'_>,
        events: Whole,
        summaries: Vec<Py<Summary>>,
    ) -> PyResult<Posterior> {
        let events = indices(events, slf.get().fit.sites().len())?;
        let rows = slf.get().rows(&references(&summaries)).max(events.len());
        check_memory(&[3, rows, rows])?;
        long_work(py, move || slf.get().posterior_of(&events, &references(&summaries)))
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
        slf: Py<Self>,
        py: Python<'_>,
        removed: Whole,
        x: Points,
        y: Outcomes,
        weights: Option<Numbers>,
    ) -> PyResult<Option<Self>> {
        let (removed, new) = (indices(removed, slf.get().fit.sites().len())?, observations(x, y, weights)?);
        long_work(py, move || {
            let amended = slf.get().fit.amended(&removed, &new)?;
            let messages = slf.get().messages.clone();
            Ok(amended.map(|fit| Self { end: End::of(&fit), fit, messages, is_amended: true }))
        })
    }

    /// Returns the mean and the variance at points that are events of this dense fit, without solving anything.
    ///
    /// The result is `None` for a sparse fit, and if a point is not an event.
    fn latent_at_events<'py>(&self, py: Python<'py>, x: Points) -> PyResult<Option<(Vector<'py>, Vector<'py>)>> {
        Ok(work(py, || Ok(self.fit.latent_at_events(&x.0)))?.map(|latent| pair(py, latent)))
    }

    /// Runs expectation propagation from the sites of this fit. Its variances are nearly those of the exact posterior.
    ///
    /// Parameters
    /// ----------
    /// summaries : sequence of Summary, optional
    ///     Messages in place of those that the fit was given. An empty list runs without messages.
    /// progress : callable, optional
    ///     Receives a dictionary with the progress about twice a second, from two seconds on.
    #[pyo3(signature = (summaries=None, *, progress=None))]
    fn propagated(
        slf: Py<Self>,
        py: Python<'_>,
        summaries: Option<Vec<Py<Summary>>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Propagated> {
        let rows = slf.get().rows(&slf.get().messages_or(summaries.as_deref()));
        check_memory(&[4, rows, rows])?;
        watched(py, progress.as_ref(), move |monitor| {
            let this = slf.get();
            Propagated::of(&this.fit, &this.messages_or(summaries.as_deref()), Monitor::new(monitor))
        })
    }

    /// Returns the fit of the bytes. Damaged and newer bytes raise a `ValueError`.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        let stored: StoredFit = decode(data)?;
        check_memory(&[4, stored.rows(), stored.rows()])?;
        let (fit, stored) = long_work(py, move || Ok((stored.fit()?, stored)))?;
        Ok(Self { fit, messages: stored.messages, end: stored.end, is_amended: false })
    }

    /// Returns the parts of the fit as bytes with a version and a checksum.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     If the fit was amended: its sites are no fixed point, so that no iteration gives them.
    fn to_bytes(&self) -> PyResult<Vec<u8>> {
        if self.is_amended {
            return Err(PyTypeError::new_err(
                "an amended fit cannot be pickled; pickle its posterior, or fit its events",
            ));
        }
        encode(&StoredFit::new(&self.fit, &self.messages, &self.end))
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
        reduce(slf.as_any())
    }

    fn __len__(&self) -> usize {
        self.fit.sites().len()
    }

    fn __repr__(&self) -> String {
        format!("Fit of {} events with evidence {:.4}", self.fit.sites().len(), self.fit.evidence())
    }
}
