//! Mean field, and its evidence with gradient.

use pyo3::prelude::*;

use super::fitted::Fit;
use super::options::{FitArguments, InducingPoints, with_fit_options};
use crate::border::{Count, Numbers, Outcomes, Points, Vector, vector};
use crate::posterior::{Summary, copies, observations};
use crate::prior::Prior;

/// Fits events by mean field: finds the ω that maximise the evidence bound, and the posterior that belongs to them.
///
/// A dense fit costs O(N³) an iteration and 4N² numbers of memory. With M inducing points it costs O(NM²) an iteration.
///
/// Parameters
/// ----------
/// prior : Prior
/// x : array of shape (N, d)
///     Inputs of the events.
/// y : array of shape (N,)
///     Outcomes, 0 or 1.
/// weights : array of shape (N,), optional
///     The log-likelihood of each event is multiplied by its weight, which is positive. A weight of two counts in the
///     fit like two equal events. `learn` and `Fit.leave_one_out` treat them differently.
/// inducing_points : int or array of shape (M, d), optional
///     Points that support the posterior in place of the events. A number is chosen greedily among the events.
/// messages : sequence of Summary, optional
///     Messages of other agents. Their inducing points are added to those of the fit.
/// tolerance : float, optional
///     The fit stops when no tilt changes by more than this in one iteration.
/// iterations_max : int, optional
///     The fit stops after this number of iterations even without convergence.
/// start : array of shape (N,), optional
///     Tilts to start from, such as `Fit.tilts` of a fit under a similar prior.
/// progress : callable, optional
///     Receives a dictionary with the progress about twice a second, from two seconds on.
///
/// Returns
/// -------
/// Fit
///
/// Raises
/// ------
/// ValueError
///     If an argument is invalid.
/// Error
///     If a matrix cannot be factorised, or numbers overflow.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit = dgpc.fit(prior, [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0])
///     >>> fit.converged
///     True
///     >>> fit.posterior().probability([[0.5], [2.5]]).round(2)
///     array([0.75, 0.25])
#[pyfunction]
#[pyo3(signature = (prior, x, y, *, weights=None, inducing_points=None, messages=vec![], tolerance=1e-10,
                    iterations_max=Count(1000), start=None, progress=None),
       text_signature = "(prior, x, y, *, weights=None, inducing_points=None, messages=(), tolerance=1e-10, \
                         iterations_max=1000, start=None, progress=None)")]
#[expect(clippy::too_many_arguments)]
pub fn fit(
    py: Python<'_>,
    prior: &Prior,
    x: Points,
    y: Outcomes,
    weights: Option<Numbers>,
    inducing_points: Option<InducingPoints>,
    messages: Vec<Py<Summary>>,
    tolerance: f64,
    iterations_max: Count,
    start: Option<Numbers>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Fit> {
    let events = observations(x, y, weights)?;
    let arguments = FitArguments { inducing_points, messages, tolerance, iterations_max, start, progress };
    with_fit_options(py, &prior.0, events, arguments, |prior, events, options| {
        dgpc::fit(prior, events, options).map(|fit| Fit::new(fit, copies(options.messages)))
    })
}

/// Fits events as `fit` does, and returns the gradient of the evidence bound, too.
///
/// Inducing points stay in place for the gradient.
///
/// Returns
/// -------
/// fit : Fit
///     `fit.evidence` is the bound.
/// gradient : array
///     Derivative of the bound by each of `Prior.parameter_values`.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit, gradient = dgpc.evidence(prior, [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0])
///     >>> gradient.shape
///     (2,)
#[pyfunction]
#[pyo3(signature = (prior, x, y, *, weights=None, inducing_points=None, messages=vec![], tolerance=1e-10,
                    iterations_max=Count(1000), start=None, progress=None),
       text_signature = "(prior, x, y, *, weights=None, inducing_points=None, messages=(), tolerance=1e-10, \
                         iterations_max=1000, start=None, progress=None)")]
#[expect(clippy::too_many_arguments)]
pub fn evidence<'py>(
    py: Python<'py>,
    prior: &Prior,
    x: Points,
    y: Outcomes,
    weights: Option<Numbers>,
    inducing_points: Option<InducingPoints>,
    messages: Vec<Py<Summary>>,
    tolerance: f64,
    iterations_max: Count,
    start: Option<Numbers>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Fit, Vector<'py>)> {
    let events = observations(x, y, weights)?;
    let arguments = FitArguments { inducing_points, messages, tolerance, iterations_max, start, progress };
    let (fit, gradient) = with_fit_options(py, &prior.0, events, arguments, |prior, events, options| {
        dgpc::evidence(prior, events, options)
            .map(|found| (Fit::new(found.fit, copies(options.messages)), found.gradient))
    })?;
    Ok((fit, vector(py, gradient)))
}
