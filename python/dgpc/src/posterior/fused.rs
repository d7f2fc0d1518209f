//! Posteriors of events and summaries.

use dgpc::Matrix;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rand_distr::{Distribution, StandardNormal};

use super::parts::Parts;
use super::shift::Shift;
use super::sites::{Sites, observations};
use super::summary::{Summary, references};
use crate::border::{
    Count, Deviation, Numbers, Outcomes, Points, Table, Vector, check_memory, decode, encode, generator, long_work,
    matrix, predicted, reduce, vector,
};
use crate::prior::Prior;

/// A Gaussian posterior over the latent function that predicts anywhere.
///
/// The prior counts once, however many summaries there are and wherever their regions overlap. No method changes a
/// posterior; each returns a new one. O(n³) for n events and inducing points.
///
/// Parameters
/// ----------
/// prior : Prior
/// sites : Sites, optional
///     The events of this agent.
/// summaries : sequence of Summary, optional
///     The messages of other agents, formed under the same prior.
/// dimension : int, optional
///     Number of columns of the inputs. It is needed only without sites and summaries.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=2.0, dimension=1))
///     >>> own = dgpc.fit(prior, [[0.0], [0.5]], [1, 1])
///     >>> other = dgpc.fit(prior, [[3.0], [3.5]], [0, 0])
///     >>> message = dgpc.Summary.marginal(prior, other.sites, [[3.2]])
///     >>> fused = dgpc.Posterior(prior, own.sites, [message])
///     >>> fused.probability([[0.2], [3.3]]).round(2)
///     array([0.7, 0.3])
#[pyclass(frozen, module = "dgpc")]
pub struct Posterior {
    pub posterior: dgpc::Posterior,
    parts: Parts,
}

/// Returns means and variances as two arrays.
pub fn pair<'py>(py: Python<'py>, latent: dgpc::Latent) -> (Vector<'py>, Vector<'py>) {
    (vector(py, latent.mean), vector(py, latent.variance))
}

impl Posterior {
    /// Computes the posterior of its parts. O(n³).
    pub fn of(parts: Parts) -> dgpc::Result<Self> {
        parts.fused().map(|posterior| Self { posterior, parts })
    }

    /// Returns the mean and the variance at every point.
    fn predicted(this: Py<Self>, py: Python<'_>, x: Points) -> PyResult<dgpc::Latent> {
        let rows = this.get().posterior.len();
        predicted(py, x.0, rows * rows, move |part| this.get().posterior.latent(part))
    }

    /// Returns the posterior that `absorb` made from a copy of `this` posterior and of its parts, and the result of
    /// `absorb`.
    fn changed<T: Send + 'static>(
        this: Py<Self>,
        py: Python<'_>,
        new_rows: usize,
        absorb: impl FnOnce(&mut dgpc::Posterior, &mut Parts) -> dgpc::Result<T> + Send + 'static,
    ) -> PyResult<(Self, T)> {
        let rows = this.get().posterior.len() + new_rows;
        check_memory(&[2, rows, rows])?;
        long_work(py, move || {
            let Self { posterior, parts } = this.get();
            let (mut posterior, mut parts) = (posterior.clone(), parts.clone());
            absorb(&mut posterior, &mut parts).map(|found| (Self { posterior, parts }, found))
        })
    }
}

#[pymethods]
impl Posterior {
    #[new]
    #[pyo3(signature = (prior, sites=None, summaries=vec![], *, dimension=None),
           text_signature = "(prior, sites=None, summaries=(), *, dimension=None)")]
    fn new(
        py: Python<'_>,
        prior: &Prior,
        sites: Option<&Sites>,
        summaries: Vec<Py<Summary>>,
        dimension: Option<Count>,
    ) -> PyResult<Self> {
        let summaries = references(&summaries);
        if let Some(Count(0)) = dimension {
            return Err(PyValueError::new_err("dimension must be at least 1"));
        }
        let of_summaries = summaries.first().map(|summary| summary.inducing_points().dimension());
        let dimension = dimension.map(|Count(dimension)| dimension).or(of_summaries);
        let found = sites.map(|sites| sites.0.inputs().dimension());
        if let (Some(dimension), Some(found)) = (dimension, found)
            && dimension != found
        {
            return Err(PyValueError::new_err(format!("expected sites of {dimension} columns, found {found}")));
        }
        let nothing = dgpc::Sites::empty(dimension.unwrap_or(1));
        let parts = Parts::new(&prior.0, sites.map_or(&nothing, |sites| &sites.0), &summaries);
        parts.check_memory()?;
        long_work(py, move || Self::of(parts))
    }

    /// Returns the posterior of the bytes. Damaged and newer bytes raise a `ValueError`. O(n³).
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        let parts: Parts = decode(data)?;
        parts.check_memory()?;
        long_work(py, move || Self::of(parts))
    }

    /// Returns the prior, the sites and the summaries as bytes with a version and a checksum.
    ///
    /// `from_bytes` computes the posterior again. Its numbers are equal up to rounding, and to the bit if no method
    /// absorbed events or summaries.
    fn to_bytes(&self) -> PyResult<Vec<u8>> {
        encode(&self.parts)
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
        reduce(slf.as_any())
    }

    /// Returns the mean and the variance of the latent function at every point. O(n²) a point.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    ///
    /// Returns
    /// -------
    /// mean : array of shape (N,)
    ///     Log-odds of success.
    /// variance : array of shape (N,)
    fn latent(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<(Vector<'_>, Vector<'_>)> {
        Ok(pair(py, Self::predicted(slf, py, x)?))
    }

    /// Returns the probability of success at every point, averaged over the latent function.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    ///
    /// Returns
    /// -------
    /// array of shape (N,)
    fn probability(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<Vector<'_>> {
        Ok(vector(py, Self::predicted(slf, py, x)?.probability()))
    }

    /// Returns the joint mean and covariance of the latent function at the points.
    ///
    /// Returns
    /// -------
    /// mean : array of shape (N,)
    /// covariance : array of shape (N, N)
    fn joint(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<(Vector<'_>, Table<'_>)> {
        check_memory(&[x.0.len(), x.0.len() + slf.get().posterior.len()])?;
        let (mean, covariance) = long_work(py, move || slf.get().posterior.joint(&x.0))?;
        Ok((vector(py, mean), matrix(py, &covariance)?))
    }

    /// Draws functions from the posterior at the points.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    /// count : int
    ///     Number of functions.
    /// seed : int
    ///     Equal seeds give equal draws.
    ///
    /// Returns
    /// -------
    /// array of shape (count, N)
    #[pyo3(signature = (x, count, *, seed))]
    fn draws(slf: Py<Self>, py: Python<'_>, x: Points, count: Count, seed: Count) -> PyResult<Table<'_>> {
        check_memory(&[x.0.len(), x.0.len() + slf.get().posterior.len()])?;
        check_memory(&[3, x.0.len(), count.0])?;
        let draws = long_work(py, move || {
            let mut generator = generator(seed, 0);
            let normals = Matrix::from_fn(x.0.len(), count.0, |_, _| StandardNormal.sample(&mut generator));
            slf.get().posterior.draws(&x.0, &normals).map(|(draws, _)| draws.transposed())
        })?;
        matrix(py, &draws)
    }

    /// Returns the summary of this posterior at inducing points.
    ///
    /// Parameters
    /// ----------
    /// points : array of shape (M, d)
    fn summarise(slf: Py<Self>, py: Python<'_>, points: Points) -> PyResult<Summary> {
        check_memory(&[points.0.len(), points.0.len() + slf.get().posterior.len()])?;
        long_work(py, move || slf.get().posterior.summarise(&points.0).map(Summary))
    }

    /// Returns the message at inducing points that a receiver lacks if it holds the posterior `known`.
    fn residual(slf: Py<Self>, py: Python<'_>, known: Py<Self>, points: Points) -> PyResult<Summary> {
        let rows = slf.get().posterior.len().max(known.get().posterior.len());
        check_memory(&[points.0.len(), points.0.len() + rows])?;
        long_work(py, move || slf.get().posterior.residual(&known.get().posterior, &points.0).map(Summary))
    }

    /// Returns the posterior with more events. The existing sites stay as they are. O(n²m) for m events.
    fn absorb_events(slf: Py<Self>, py: Python<'_>, sites: Py<Sites>) -> PyResult<Self> {
        let changed = Self::changed(slf, py, sites.get().0.len(), move |posterior, parts| {
            posterior.absorb_events(&sites.get().0)?;
            parts.absorb_events(&sites.get().0)
        });
        changed.map(|(posterior, ())| posterior)
    }

    /// Returns the posterior with more summaries, formed under its prior.
    fn absorb_summaries(slf: Py<Self>, py: Python<'_>, summaries: Vec<Py<Summary>>) -> PyResult<Self> {
        let rows = references(&summaries).iter().map(|summary| summary.len()).sum();
        let changed = Self::changed(slf, py, rows, move |posterior, parts| {
            let summaries = references(&summaries);
            parts.absorb_summaries(&summaries);
            posterior.absorb_summaries(&summaries)
        });
        changed.map(|(posterior, ())| posterior)
    }

    /// Returns the posterior with more events whose ω is not known yet, and their sites.
    ///
    /// Each event gets its own fixed point given the events before it. O(n²) an event.
    ///
    /// Returns
    /// -------
    /// posterior : Posterior
    /// sites : Sites
    #[pyo3(signature = (x, y, weights=None))]
    fn absorb_observations(
        slf: Py<Self>,
        py: Python<'_>,
        x: Points,
        y: Outcomes,
        weights: Option<Numbers>,
    ) -> PyResult<(Self, Sites)> {
        let new = observations(x, y, weights)?;
        Self::changed(slf, py, new.len(), move |posterior, parts| {
            let sites = dgpc::absorb_observations(posterior, &new)?;
            parts.absorb_events(&sites).map(|()| Sites(sites))
        })
    }

    /// Returns the sites of more events given this posterior, each on its own.
    #[pyo3(signature = (x, y, weights=None))]
    fn sites_given(slf: Py<Self>, py: Python<'_>, x: Points, y: Outcomes, weights: Option<Numbers>) -> PyResult<Sites> {
        let new = observations(x, y, weights)?;
        long_work(py, move || dgpc::sites_given(&slf.get().posterior, &new).map(Sites))
    }

    /// Returns the shift that summaries would cause. The posterior must not hold them yet.
    fn shift_by(slf: Py<Self>, py: Python<'_>, summaries: Vec<Py<Summary>>) -> PyResult<Shift> {
        long_work(py, move || slf.get().posterior.shift_by(&references(&summaries)).map(Shift))
    }

    /// Returns the shift that summaries have caused. The posterior must hold them.
    fn shift_of(slf: Py<Self>, py: Python<'_>, summaries: Vec<Py<Summary>>) -> PyResult<Shift> {
        long_work(py, move || slf.get().posterior.shift_of(&references(&summaries)).map(Shift))
    }

    /// Returns how strongly outcomes contradict this posterior, in standard deviations. It must not hold them.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    /// y : array of shape (N,)
    /// offset_sd : float, optional
    ///     Standard deviation of a common offset of the latent function that is no contradiction.
    #[pyo3(signature = (x, y, *, offset_sd=Deviation(0.0)), text_signature = "($self, x, y, *, offset_sd=0.0)")]
    fn contradiction(slf: Py<Self>, py: Python<'_>, x: Points, y: Outcomes, offset_sd: Deviation) -> PyResult<f64> {
        check_memory(&[4, x.0.len(), x.0.len()])?;
        let reported = observations(x, y, None)?;
        long_work(py, move || slf.get().posterior.contradiction(&reported, offset_sd.0))
    }

    /// The prior of the posterior.
    #[getter]
    fn prior(&self) -> Prior {
        Prior(self.posterior.prior().clone())
    }

    /// The largest jitter of all factorisations behind the posterior, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.posterior.jitter()
    }

    fn __len__(&self) -> usize {
        self.posterior.len()
    }

    fn __repr__(&self) -> String {
        format!("Posterior of {} events and inducing points", self.posterior.len())
    }
}
