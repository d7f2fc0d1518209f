//! Fits of events that lie in shards.

use std::borrow::Cow;
use std::sync::{Arc, Mutex};

use dgpc::{FitOptions, ShardContribution, ShardRequest};
use pyo3::prelude::*;

use super::stored::stop_name;
use crate::border::{
    Count, Numbers, Outcomes, Points, Table, Vector, array, bad_input, locked, long_work, vector, work_on,
};
use crate::posterior::{Parts, Posterior, Sites, Summary, copies, observations, references};
use crate::prior::Prior;

/// Some of the events of a sharded fit.
///
/// A shard answers requests of a `ShardedFit`. It keeps results between requests to save work, but its answers depend
/// on its events and the request alone.
///
/// Parameters
/// ----------
/// prior : Prior
/// x : array of shape (N, d)
///     Inputs of the events.
/// y : array of shape (N,)
///     Outcomes, 0 or 1.
/// inducing_points : array of shape (M, d)
///     `ShardedFit.inducing_points`.
/// weights : array of shape (N,), optional
///     Weights of the events, positive.
/// covariances_max : int, optional
///     Largest number of covariances that the shard keeps in memory, 8 bytes each.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit = dgpc.ShardedFit(prior, [[0.0], [1.5], [3.0]])
///     >>> shard = dgpc.Shard(prior, [[0.0], [1.0]], [1, 1], fit.inducing_points)
///     >>> shard.contribute(fit.request()).dtype
///     dtype('float64')
#[pyclass(frozen, module = "dgpc")]
pub struct Shard(Arc<Mutex<dgpc::Shard<'static>>>);

#[pymethods]
impl Shard {
    #[new]
    #[pyo3(signature = (prior, x, y, inducing_points, *, weights=None, covariances_max=Count(7 << 20)),
           text_signature = "(prior, x, y, inducing_points, *, weights=None, covariances_max=7340032)")]
    fn new(
        py: Python<'_>,
        prior: Py<Prior>,
        x: Points,
        y: Outcomes,
        inducing_points: Points,
        weights: Option<Numbers>,
        covariances_max: Count,
    ) -> PyResult<Self> {
        let events = observations(x, y, weights)?;
        let shard = long_work(py, move || {
            dgpc::Shard::with_memory(&prior.get().0, Cow::Owned(events), &inducing_points.0, covariances_max.0)
        })?;
        Ok(Self(Arc::new(Mutex::new(shard))))
    }

    /// Returns the contribution of the events to a request, as an array of numbers.
    fn contribute<'py>(&self, py: Python<'py>, request: Numbers) -> PyResult<Vector<'py>> {
        let request = ShardRequest::from_numbers(&request.0).map_err(bad_input)?;
        let contribution = work_on(py, &self.0, move |shard| shard.contribute(&request))?;
        Ok(vector(py, contribution.to_numbers()))
    }

    /// Posterior means of f at the events, after the last request.
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, py.detach(|| locked(&self.0).mean().to_vec()))
    }

    /// Posterior variances of f at the events, after the last request.
    #[getter]
    fn variance<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, py.detach(|| locked(&self.0).variance().to_vec()))
    }

    /// Gaussian sites of the events, after the last request.
    fn sites(&self, py: Python<'_>) -> PyResult<Sites> {
        work_on(py, &self.0, |shard| shard.sites()).map(Sites)
    }

    fn __len__(&self, py: Python<'_>) -> usize {
        py.detach(|| locked(&self.0).len())
    }
}

/// A sparse fit of events that lie in several shards.
///
/// `dgpc.sharded.fit` runs one to its end. In each round, every shard answers `request`, and `absorb` takes the sum of
/// the answers.
///
/// Parameters
/// ----------
/// prior : Prior
/// inducing_points : array of shape (M, d)
/// messages : sequence of Summary, optional
///     Messages of other agents.
/// tolerance : float, optional
///     The fit stops when no tilt changes by more than this in one iteration.
/// iterations_max : int, optional
///     The fit stops after this number of iterations even without convergence.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit = dgpc.ShardedFit(prior, [[0.0], [1.5], [3.0]])
///     >>> events = ([[0.0], [1.0]], [1, 1]), ([[2.0], [3.0]], [0, 0])
///     >>> shards = [dgpc.Shard(prior, x, y, fit.inducing_points) for x, y in events]
///     >>> while (request := fit.request()) is not None:
///     ...     fit.absorb([shard.contribute(request) for shard in shards])
///     >>> fit.summary()
///     Summary at 3 inducing points
#[pyclass(frozen, module = "dgpc")]
pub struct ShardedFit {
    fit: Arc<Mutex<dgpc::ShardedFit>>,
    messages: Arc<[dgpc::Summary]>,
}

#[pymethods]
impl ShardedFit {
    #[new]
    #[pyo3(signature = (prior, inducing_points, *, messages=vec![], tolerance=1e-10, iterations_max=Count(1000)),
           text_signature = "(prior, inducing_points, *, messages=(), tolerance=1e-10, iterations_max=1000)")]
    fn new(
        py: Python<'_>,
        prior: Py<Prior>,
        inducing_points: Points,
        messages: Vec<Py<Summary>>,
        tolerance: f64,
        iterations_max: Count,
    ) -> PyResult<Self> {
        let (fit, messages) = long_work(py, move || {
            let messages = references(&messages);
            let options = FitOptions::default().inducing_points(&inducing_points.0).messages(&messages);
            let options = options.tolerance(tolerance).iterations_max(iterations_max.0);
            Ok((dgpc::ShardedFit::new(&prior.get().0, &options)?, copies(&messages)))
        })?;
        Ok(Self { fit: Arc::new(Mutex::new(fit)), messages: messages.into() })
    }

    /// Inducing points, with those of the messages; an array of shape (M, d).
    #[getter]
    fn inducing_points<'py>(&self, py: Python<'py>) -> PyResult<Table<'py>> {
        let points = py.detach(|| locked(&self.fit).inducing_points().clone());
        array(py, &points)
    }

    /// Returns the next request to all shards as an array of numbers, or None at the end of the fit.
    fn request<'py>(&self, py: Python<'py>) -> Option<Vector<'py>> {
        let request = py.detach(|| locked(&self.fit).request());
        request.map(|request| vector(py, request.to_numbers()))
    }

    /// Absorbs the contributions of all shards to the present request, in the order of the shards.
    ///
    /// A contribution does not name its shard, so the caller must pass each shard's contribution once.
    /// `dgpc.sharded.fit` does so.
    fn absorb(&self, py: Python<'_>, contributions: Vec<Numbers>) -> PyResult<()> {
        work_on(py, &self.fit, move |fit| fit.absorb(sum(&contributions)?))
    }

    /// Returns the request for the gradient at the end of the fit, as an array of numbers.
    fn gradient_request<'py>(&self, py: Python<'py>) -> Vector<'py> {
        let request = py.detach(|| locked(&self.fit).gradient_request());
        vector(py, request.to_numbers())
    }

    /// Returns the gradient of the evidence bound by each of `Prior.parameter_values`, from the contributions of all
    /// shards to `gradient_request`.
    fn gradient<'py>(&self, py: Python<'py>, contributions: Vec<Numbers>) -> PyResult<Vector<'py>> {
        Ok(vector(py, work_on(py, &self.fit, move |fit| fit.gradient(sum(&contributions)?))?))
    }

    /// Returns the posterior of the events and the messages, after the end of the fit.
    fn posterior(&self, py: Python<'_>) -> PyResult<Posterior> {
        let messages = self.messages.clone();
        work_on(py, &self.fit, move |fit| {
            let (summary, no_sites) = (fit.summary()?, dgpc::Sites::empty(fit.inducing_points().dimension()));
            let (prior, messages) = (summary.prior().clone(), messages.iter().collect::<Vec<_>>());
            Posterior::of(Parts::of_fit(&prior, no_sites, Some(summary), &messages)?)
        })
    }

    /// Returns the summary of the events at the inducing points, after the end of the fit.
    fn summary(&self, py: Python<'_>) -> PyResult<Summary> {
        work_on(py, &self.fit, |fit| fit.summary()).map(Summary)
    }

    /// The evidence bound, in nats.
    #[getter]
    fn evidence(&self, py: Python<'_>) -> f64 {
        py.detach(|| locked(&self.fit).evidence())
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self, py: Python<'_>) -> usize {
        py.detach(|| locked(&self.fit).iterations())
    }

    /// Largest change of a tilt in the last iteration.
    #[getter]
    fn change(&self, py: Python<'_>) -> f64 {
        py.detach(|| locked(&self.fit).change())
    }

    /// The reason why the iteration ended, as `Fit.stop`, or None before its end.
    #[getter]
    fn stop(&self, py: Python<'_>) -> Option<&'static str> {
        py.detach(|| locked(&self.fit).stop()).map(stop_name)
    }
}

fn sum(contributions: &[Numbers]) -> dgpc::Result<ShardContribution> {
    let read = contributions.iter().map(|numbers| ShardContribution::from_numbers(&numbers.0));
    ShardContribution::sum(read.collect::<dgpc::Result<_>>()?)
}
