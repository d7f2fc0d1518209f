//! Options of fits and of learning, with the callback for Ctrl-C and progress.

use dgpc::{Bounds, FitOptions, HyperPrior, LearnOptions, Observations};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::border::{Count, Numbers, Points, check_memory, long_work, watched};
use crate::posterior::{Summary, references};
use crate::prior::Prior;
use crate::selection::greedy;

/// Inducing points: a number of them, or the points.
pub enum InducingPoints {
    Number(Count),
    Points(Points),
}

impl<'py> FromPyObject<'_, 'py> for InducingPoints {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.len().is_ok() { object.extract().map(Self::Points) } else { object.extract().map(Self::Number) }
    }
}

/// The arguments of a fit that become its options.
pub struct FitArguments {
    pub inducing_points: Option<InducingPoints>,
    pub messages: Vec<Py<Summary>>,
    pub tolerance: f64,
    pub iterations_max: Count,
    pub start: Option<Numbers>,
    pub progress: Option<Py<PyAny>>,
}

/// Runs `compute` with the prior, the events and the options of a fit, without the interpreter's lock.
pub fn with_fit_options<T: Send + 'static>(
    py: Python<'_>,
    prior: &dgpc::Prior,
    observations: Observations,
    arguments: FitArguments,
    compute: impl FnOnce(&dgpc::Prior, &Observations, &FitOptions<'_>) -> dgpc::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (prior, inputs) = (prior.clone(), observations.inputs());
    let FitArguments { inducing_points, messages, tolerance, iterations_max, start, progress } = arguments;
    let points = match inducing_points {
        None => None,
        Some(InducingPoints::Points(points)) => Some(points.0),
        Some(InducingPoints::Number(Count(0))) => {
            return Err(PyValueError::new_err("inducing_points must be at least 1, or None for a dense fit"));
        }
        Some(InducingPoints::Number(Count(count))) => {
            let candidates = count.saturating_mul(4).min(inputs.len());
            check_memory(&[2, candidates, candidates])?;
            let (kernel, inputs) = (prior.kernel().clone(), inputs.clone());
            Some(long_work(py, move || greedy(&kernel, &inputs, count))?)
        }
    };
    check_memory_of_fit(&observations, &references(&messages), points.as_ref().map(dgpc::Inputs::len))?;
    watched(py, progress.as_ref(), move |monitor| {
        let messages = references(&messages);
        let mut options = FitOptions::default()
            .messages(&messages)
            .monitor(monitor)
            .tolerance(tolerance)
            .iterations_max(iterations_max.0);
        options.inducing_points = points.as_ref();
        options.start = start.as_ref().map(|start| start.0.as_slice());
        compute(&prior, &observations, &options)
    })
}

/// Checks that the matrices of a fit can be reserved: four of all events, or four of all inducing points.
fn check_memory_of_fit(
    observations: &Observations,
    messages: &[&dgpc::Summary],
    inducing_points: Option<usize>,
) -> PyResult<()> {
    let of_messages: usize = messages.iter().map(|message| message.len()).sum();
    let size = inducing_points.unwrap_or(observations.len()) + of_messages;
    check_memory(&[4, size, size])
}

/// The arguments of learning that become its options.
pub struct LearnArguments {
    pub messages: Vec<Py<Summary>>,
    pub hyper_prior: Deviations,
    pub bounds: Vec<Limits>,
    pub warm_start: Option<Py<Prior>>,
    pub start: Option<Numbers>,
    pub further_starts: Vec<Py<Prior>>,
    pub start_events_max: Count,
    pub race_events_max: Count,
    pub search_events_max: Count,
    pub dense_events_max: Count,
    pub inducing_points_max: Count,
    pub inducing_points: Option<Points>,
    pub iterations_max: Count,
    pub tolerance: f64,
    pub calibrate: bool,
    pub progress: Option<Py<PyAny>>,
}

/// Bounds of one parameter: `None`, "fixed", or a pair of values.
pub struct Limits(Bounds);

impl<'py> FromPyObject<'_, 'py> for Limits {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.is_none() {
            return Ok(Self(Bounds::Free));
        }
        if object.extract::<String>().is_ok_and(|text| text == "fixed") {
            return Ok(Self(Bounds::Fixed));
        }
        match object.extract::<[f64; 2]>() {
            Ok([lower, upper]) if lower.is_finite() && upper.is_finite() => Ok(Self(Bounds::Between { lower, upper })),
            _ => Err(PyValueError::new_err(format!(
                "bounds of a parameter must be None, \"fixed\" or a pair of finite numbers, found {}",
                object.repr()?
            ))),
        }
    }
}

/// Runs `compute` with the template, the events and the options of learning, without the interpreter's lock.
pub fn with_learn_options<T: Send + 'static>(
    py: Python<'_>,
    template: &dgpc::Prior,
    observations: Observations,
    mut arguments: LearnArguments,
    compute: impl FnOnce(&dgpc::Prior, &Observations, &LearnOptions<'_>) -> dgpc::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (template, hyper_prior) = (template.clone(), hyper_prior(&arguments.hyper_prior)?);
    let further: Vec<dgpc::Prior> = arguments.further_starts.iter().map(|start| start.get().0.clone()).collect();
    let points = arguments.inducing_points.take().map(|points| points.0);
    let is_sparse = observations.len() > arguments.dense_events_max.0;
    let chosen = is_sparse.then_some(arguments.inducing_points_max.0.min(observations.len()));
    let size = points.as_ref().map(dgpc::Inputs::len).or(chosen);
    check_memory_of_fit(&observations, &references(&arguments.messages), size)?;
    let bounds: Vec<Bounds> = arguments.bounds.iter().map(|limits| limits.0).collect();
    let progress = arguments.progress.take();
    watched(py, progress.as_ref(), move |monitor| {
        let messages = references(&arguments.messages);
        let mut options = LearnOptions::default()
            .messages(&messages)
            .monitor(monitor)
            .bounds(&bounds)
            .hyper_prior(hyper_prior)
            .further_starts(&further)
            .start_events_max(arguments.start_events_max.0)
            .race_events_max(arguments.race_events_max.0)
            .search_events_max(arguments.search_events_max.0)
            .sparse_beyond(arguments.dense_events_max.0, arguments.inducing_points_max.0)
            .iterations_max(arguments.iterations_max.0)
            .tolerance(arguments.tolerance)
            .calibrate(arguments.calibrate);
        options.inducing_points = points.as_ref();
        options.warm_start = arguments.warm_start.as_ref().map(|start| &start.get().0);
        options.tilts = arguments.start.as_ref().map(|start| start.0.as_slice());
        compute(&template, &observations, &options)
    })
}

/// Standard deviations of the hyperprior by the names of parameters.
#[derive(Default)]
pub struct Deviations(Vec<(String, f64)>);

impl<'py> FromPyObject<'_, 'py> for Deviations {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        object.cast::<PyMapping>()?.items()?.iter().map(|item| item.extract()).collect::<PyResult<_>>().map(Self)
    }
}

/// Returns the hyperprior with the standard deviations that are named.
fn hyper_prior(Deviations(deviations): &Deviations) -> PyResult<HyperPrior> {
    let mut hyper_prior = HyperPrior::default();
    for &(ref name, deviation) in deviations {
        let place = match name.as_str() {
            "length_scale" => &mut hyper_prior.length_scale,
            "variance" => &mut hyper_prior.variance,
            "reciprocity" => &mut hyper_prior.reciprocity,
            "shape" => &mut hyper_prior.shape,
            "intercept" => &mut hyper_prior.intercept,
            "slope" => &mut hyper_prior.slope,
            other => {
                let known = "length_scale, variance, reciprocity, shape, intercept, slope";
                return Err(PyValueError::new_err(format!(
                    "no parameter is called {other:?}; expected one of {known}"
                )));
            }
        };
        *place = deviation;
    }
    Ok(hyper_prior)
}
