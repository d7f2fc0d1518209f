//! Learning of priors.

use dgpc::{Calibration, Stop};
use pyo3::prelude::*;

use super::fitted::Fit;
use super::options::{Deviations, LearnArguments, Limits, with_learn_options};
use crate::border::{Count, Numbers, Outcomes, Points};
use crate::posterior::{Summary, copies, observations};
use crate::prior::Prior;

/// A learned prior, the fit of all events under it, and a report of the search. `learn` returns it.
///
/// Examples
/// --------
///     >>> import dgpc, numpy as np
///     >>> x = np.linspace(-3, 3, 60)[:, None]
///     >>> template = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=4.0, dimension=1))
///     >>> learned = dgpc.learn(template, x, abs(x[:, 0]) < 2)
///     >>> learned.stop, learned.calibration
///     ('converged', 'found')
///     >>> learned.fit.posterior().probability([[0.0]]) > 0.9
///     array([ True])
#[pyclass(frozen, get_all, module = "dgpc")]
pub struct Learned {
    /// The learned prior: the optimum with calibrated variances.
    prior: Py<Prior>,
    /// The fit of all events under the prior.
    fit: Py<Fit>,
    /// The prior that maximises the evidence bound within the hyperprior, before calibration.
    optimum: Py<Prior>,
    /// The evidence bound of the optimum in nats, over the events of the search.
    optimum_evidence: f64,
    /// The factor of all variances from the calibration.
    calibration_factor: f64,
    /// How the calibration ended: `"not asked"`, `"found"`, `"at bound"` or `"failed: …"`.
    calibration: String,
    /// The starts of the search, each with its result in nats or `None`.
    starts: Vec<(Py<Prior>, Option<f64>)>,
    /// Number of events on which the starts were compared.
    start_events: usize,
    /// Number of events in the search.
    searched_events: usize,
    /// Number of evaluations of the evidence bound.
    evaluations: usize,
    /// The reason why the search ended: `"converged"`, `"iterations_max"` or `"no progress: …"`.
    stop: String,
}

impl Learned {
    fn new(py: Python<'_>, learned: dgpc::Learned, messages: Vec<dgpc::Summary>) -> PyResult<Self> {
        let calibration = match &learned.calibration {
            Calibration::NotAsked => "not asked".to_owned(),
            Calibration::AtBound(_) => "at bound".to_owned(),
            Calibration::Failed(reason) => format!("failed: {reason}"),
            _ => "found".to_owned(),
        };
        let stop = match learned.stop {
            Stop::Converged => "converged".to_owned(),
            Stop::IterationsMax => "iterations_max".to_owned(),
            Stop::NoProgress(reason) => format!("no progress: {reason}"),
            _ => "other".to_owned(),
        };
        let start = |start: dgpc::Start| Ok((Py::new(py, Prior(start.prior))?, start.objective));
        Ok(Self {
            prior: Py::new(py, Prior(learned.prior))?,
            fit: Py::new(py, Fit::new(learned.fit, messages))?,
            optimum: Py::new(py, Prior(learned.optimum))?,
            optimum_evidence: learned.optimum_evidence,
            calibration_factor: learned.calibration.factor(),
            calibration,
            starts: learned.starts.into_iter().map(start).collect::<PyResult<_>>()?,
            start_events: learned.start_events,
            searched_events: learned.searched_events,
            evaluations: learned.evaluations,
            stop,
        })
    }
}

/// Finds the parameters of a prior that maximise the evidence bound, then calibrates the variances.
///
/// The template gives the structure and the most probable values of the parameters before the events are seen.
///
/// Parameters
/// ----------
/// template : Prior
/// x : array of shape (N, d)
/// y : array of shape (N,)
///     Outcomes, 0 or 1.
/// weights : array of shape (N,), optional
///     Weights of the events. Learning does not treat a weight of two as two events, because the corrected evidence
///     leaves out one event at a time, with its whole weight.
/// messages : sequence of Summary, optional
///     Messages of other agents.
/// hyper_prior : dict, optional
///     Standard deviations of the parameters about the template, by kind: `length_scale`, `variance`, `reciprocity`,
///     `shape`, `intercept` and `slope`. Those that are missing have their default. 0 fixes all parameters of a kind.
/// bounds : sequence, optional
///     For each of `Prior.parameter_values`: `None`, `"fixed"`, or the smallest and the largest value of the parameter
///     itself, not of its logarithm. The template must keep the bounds.
/// warm_start : Prior, optional
///     The only start apart from `further_starts`: `Learned.optimum` of an earlier search.
/// start : array of shape (N,), optional
///     Tilts from which the first fits start.
/// further_starts : sequence of Prior, optional
///     Further starts, of the template's structure.
/// start_events_max, race_events_max, search_events_max : int, optional
///     Largest numbers of events when starts are compared, raced, and searched from.
/// dense_events_max, inducing_points_max : int, optional
///     Beyond the first number of events, the search uses the second number of inducing points.
/// inducing_points : array of shape (M, d), optional
///     Inducing points of the search and of the fit, in place of a choice among the inputs.
/// iterations_max : int, optional
///     Largest number of steps of a search.
/// tolerance : float, optional
///     A search ends when a step gains less than this, in nats an event.
/// calibrate : bool, optional
///     Whether all variances are finally multiplied by the factor that maximises the corrected evidence.
/// progress : callable, optional
///     Receives a dictionary with the progress about twice a second, from two seconds on.
///
/// Returns
/// -------
/// Learned
///
/// Examples
/// --------
///     >>> import dgpc, numpy as np
///     >>> x = np.linspace(-3, 3, 60)[:, None]
///     >>> template = dgpc.Prior(dgpc.Term("matern52", 0.1, variance=4.0, dimension=1))
///     >>> learned = dgpc.learn(template, x, abs(x[:, 0]) < 2)
///     >>> learned.prior.kernel.terms[0].correlations[0].length_scales[0] > 0.3
///     True
#[pyfunction]
#[pyo3(signature = (template, x, y, *, weights=None, messages=vec![], hyper_prior=Deviations::default(), bounds=vec![],
                    warm_start=None, start=None, further_starts=vec![], start_events_max=Count(150), race_events_max=Count(500),
                    search_events_max=Count(4000), dense_events_max=Count(1200), inducing_points_max=Count(256),
                    inducing_points=None, iterations_max=Count(60), tolerance=1e-7, calibrate=true, progress=None),
       text_signature = "(template, x, y, *, weights=None, messages=(), hyper_prior={}, bounds=(), warm_start=None, start=None, \
                         further_starts=(), start_events_max=150, race_events_max=500, search_events_max=4000, \
                         dense_events_max=1200, inducing_points_max=256, inducing_points=None, iterations_max=60, \
                         tolerance=1e-7, calibrate=True, progress=None)")]
#[expect(clippy::too_many_arguments)]
pub fn learn(
    py: Python<'_>,
    template: &Prior,
    x: Points,
    y: Outcomes,
    weights: Option<Numbers>,
    messages: Vec<Py<Summary>>,
    hyper_prior: Deviations,
    bounds: Vec<Limits>,
    warm_start: Option<Py<Prior>>,
    start: Option<Numbers>,
    further_starts: Vec<Py<Prior>>,
    start_events_max: Count,
    race_events_max: Count,
    search_events_max: Count,
    dense_events_max: Count,
    inducing_points_max: Count,
    inducing_points: Option<Points>,
    iterations_max: Count,
    tolerance: f64,
    calibrate: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Learned> {
    let events = observations(x, y, weights)?;
    let arguments = LearnArguments {
        messages,
        hyper_prior,
        bounds,
        warm_start,
        start,
        further_starts,
        start_events_max,
        race_events_max,
        search_events_max,
        dense_events_max,
        inducing_points_max,
        inducing_points,
        iterations_max,
        tolerance,
        calibrate,
        progress,
    };
    let (learned, messages) = with_learn_options(py, &template.0, events, arguments, |template, events, options| {
        dgpc::learn(template, events, options).map(|learned| (learned, copies(options.messages)))
    })?;
    Learned::new(py, learned, messages)
}
